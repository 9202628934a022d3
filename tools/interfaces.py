"""Write the definition of each structured message to interfaces/socialbot_msgs: ``python tools/interfaces.py``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from socialbot.bags.types import definitions

PACKAGE = Path(__file__).parents[1] / "interfaces" / "socialbot_msgs"


def definition_files() -> Mapping[str, str]:
    """Return the texts of the .msg files by name."""
    return {f"{name.rpartition('/')[2]}.msg": text for name, text in definitions().items()}


if __name__ == "__main__":
    folder = PACKAGE / "msg"
    folder.mkdir(parents=True, exist_ok=True)
    files = definition_files()
    for old in set(folder.glob("*.msg")) - {folder / name for name in files}:
        old.unlink()
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
