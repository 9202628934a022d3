"""The published schemas are those of the code."""

from __future__ import annotations

import pytest

from socialbot.core.messages import Structured
from socialbot.core.registry import message_types
from tools.schemas import FOLDER, INDEX, index_text, schema_file, schema_text


@pytest.mark.parametrize("message_type", message_types(), ids=lambda kind: kind.__name__)
def test_the_schema_in_docs_is_up_to_date(message_type: type[Structured]) -> None:
    assert schema_file(message_type).read_text() == schema_text(message_type), "run python tools/schemas.py"


def test_docs_hold_no_schema_of_the_past() -> None:
    assert {file.stem for file in FOLDER.glob("*.json")} == {kind.__name__ for kind in message_types()}


def test_the_list_of_schemas_in_docs_is_up_to_date() -> None:
    assert INDEX.read_text() == index_text(), "run python tools/schemas.py"
