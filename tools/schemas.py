"""Write the JSON Schema of every structured message, and an index of them: ``python tools/schemas.py``."""

from __future__ import annotations

from pathlib import Path

import msgspec

from socialbot.core.messages import Structured
from socialbot.core.registry import message_types

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"
INDEX = FOLDER / "README.md"
HEADING = (
    "# Schemas",
    "",
    "The JSON Schemas of the messages that nodes send as text, and that `socialbot topic pub` takes;"
    " made by `python tools/schemas.py`.",
    "",
    "| message | what it says |",
    "|---|---|",
)


def schema_text(message_type: type[Structured]) -> str:
    """Return the JSON Schema of ``message_type``, indented."""
    return msgspec.json.format(msgspec.json.encode(msgspec.json.schema(message_type)), indent=2).decode() + "\n"


def schema_file(message_type: type[Structured]) -> Path:
    """Return the path of the schema of ``message_type``."""
    return FOLDER / f"{message_type.__name__}.json"


def index_text() -> str:
    """Return the page that lists the schemas."""
    rows = [f"| [{kind.__name__}]({kind.__name__}.json) | {summary(kind)} |" for kind in message_types()]
    return "\n".join([*HEADING, *rows, ""])


def summary(message_type: type[Structured]) -> str:
    """Return the summary line of ``message_type``."""
    return (message_type.__doc__ or "").partition("\n")[0].replace("``", "`")


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for structured in message_types():
        schema_file(structured).write_text(schema_text(structured), encoding="utf-8")
    INDEX.write_text(index_text(), encoding="utf-8")
