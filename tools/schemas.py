"""Write the JSON Schema of every structured message, and an index of them: ``python tools/schemas.py``."""

from __future__ import annotations

import inspect
from pathlib import Path

import msgspec

from socialbot.core._trace_details import COMMON, DETAILS
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

RECORDS = (
    "",
    "## Records of a trace",
    "",
    "The `detail` of a TraceRecord has these entries, by the `kind` of the record. All these kinds may also have the"
    " texts `message`, `reason`, `outcome`, `label` and `text`, and each kind the list `rejected` of objects with the"
    " texts `plan` and `because`. Each entry may be missing. Others, and those of kinds of your own, may have any type."
    " A record with an entry of another type is refused as a message, and skipped in a file.",
    "",
    "| kind | entries |",
    "|---|---|",
)


def schema_text(message_type: type[Structured]) -> str:
    """Return the JSON Schema of ``message_type``, indented."""
    schema = msgspec.json.schema(message_type)
    for defined in schema["$defs"].values():
        if "description" in defined:  # a docstring, whose indentation Python 3.13 removes
            defined["description"] = inspect.cleandoc(defined["description"])
    return msgspec.json.format(msgspec.json.encode(schema), indent=2).decode() + "\n"


def schema_file(message_type: type[Structured]) -> Path:
    """Return the path of the schema of ``message_type``."""
    return FOLDER / f"{message_type.__name__}.json"


def index_text() -> str:
    """Return the page that lists the schemas."""
    rows = [f"| [{kind.__name__}]({kind.__name__}.json) | {summary(kind)} |" for kind in message_types()]
    return "\n".join([*HEADING, *rows, *RECORDS, *map(_record_row, sorted(DETAILS)), ""])


def _record_row(kind: str) -> str:
    type_info = msgspec.inspect.type_info(DETAILS[kind])
    assert isinstance(type_info, msgspec.inspect.StructType)
    own = (field for field in type_info.fields if field.name not in COMMON)
    return f"| `{kind}` | {', '.join(f'`{field.name}` ({_type_name(field.type)})' for field in own)} |"


def _type_name(type: msgspec.inspect.Type) -> str:
    """Return the name of a type in JSON."""
    match type:
        case msgspec.inspect.UnionType(types=types):
            return " or ".join(map(_type_name, types))
        case msgspec.inspect.VarTupleType(item_type=item):
            return f"list of {_type_name(item)}"
        case msgspec.inspect.StructType(fields=fields, cls=cls):
            return (
                cls.__name__ if not cls.__name__.startswith("_") else f"object of {', '.join(f.name for f in fields)}"
            )
        case msgspec.inspect.Metadata():
            return _type_name(type.type)
    names = {"StrType": "text", "IntType": "integer", "FloatType": "number", "BoolType": "boolean", "NoneType": "null"}
    return names[type.__class__.__name__]


def summary(message_type: type[Structured]) -> str:
    """Return the summary line of ``message_type``."""
    return (message_type.__doc__ or "").partition("\n")[0].replace("``", "`")


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for structured in message_types():
        schema_file(structured).write_text(schema_text(structured), encoding="utf-8")
    INDEX.write_text(index_text(), encoding="utf-8")
