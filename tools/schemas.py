"""Writes the JSON Schema of every structured message to docs/schemas: ``python tools/schemas.py``."""

from __future__ import annotations

from pathlib import Path

import msgspec

from socialbot.messages import Structured
from socialbot.schemas import STRUCTURED

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"


def schema_text(message_type: type[Structured]) -> str:
    """The JSON Schema of ``message_type``, indented."""
    return msgspec.json.format(msgspec.json.encode(msgspec.json.schema(message_type)), indent=2).decode() + "\n"


def schema_file(message_type: type[Structured]) -> Path:
    """Where the schema of ``message_type`` stands."""
    return FOLDER / f"{message_type.__name__}.json"


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for structured in STRUCTURED:
        schema_file(structured).write_text(schema_text(structured), encoding="utf-8")
