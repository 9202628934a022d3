"""The tables of docs/deliberation.md are complete and right."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

import socialbot.deliberation
from socialbot.agents.base.deliberating import Deliberating
from socialbot.deliberation.messages import AgentReply, Desire, Fact, FactCondition, LifecycleStatus
from socialbot.deliberation.options import DeliberationOptions
from socialbot.deliberation.requests import SentRequest
from socialbot.deliberation.rules import ReactiveRule
from socialbot.graph.ports import Delivery

ROOT = Path(__file__).parents[2] / "docs"
DOCUMENT = (ROOT / "deliberation.md").read_text("utf-8")
FOLDER = Path(str(socialbot.deliberation.__file__)).parent


def section(title: str) -> str:
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", DOCUMENT, re.DOTALL | re.MULTILINE)
    assert found is not None, title
    return found[1]


def rows(text: str) -> dict[str, str]:
    """Return the code in the first column of the tables, with the rest of its row."""
    found = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if line.startswith("|") and len(cells) > 3:
            for name in re.findall(r"`([^`]+)`", cells[1]):
                found[name] = "|".join(cells[2:])
    return found


def words_of(kind: object) -> set[str]:
    """The words of a Literal, wherever it stands in a type."""
    if get_origin(kind) is Literal:
        return set(get_args(kind))
    return {word for part in get_args(kind) for word in words_of(part)}


def recorded() -> Iterator[str]:
    """The kinds of all records that deliberation makes."""
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith((".record", "_hold")) and node.args:
                kind = node.args[0]
                if isinstance(kind, ast.Constant) and isinstance(kind.value, str):
                    yield kind.value


def test_every_parameter_stands_there_with_its_default():
    table = rows(section("Parameters"))
    declared = Deliberating.parameters()
    assert table.keys() == declared.keys()
    for name, parameter in declared.items():
        default = parameter.default
        if default not in ("", False):
            assert str(default) in table[name], name


def test_every_topic_stands_there_and_is_marked_when_it_is_latched():
    text = section("Topics")
    told = set(re.findall(r"`((?:~|/agents)/\w+)`", text))
    ports = {**Deliberating.inputs(), **Deliberating.outputs()}
    assert {port.topic for port in ports.values()} == told
    for port in ports.values():
        marked = re.search(rf"`{port.topic}` L\b", text) is not None
        assert marked == (port.delivery is Delivery.LATCHED), port.topic


def test_every_kind_of_record_stands_there():
    kinds = set(recorded())
    assert "plan_start" in kinds
    assert kinds - {"failure"} <= rows(section("The trace")).keys()


def test_every_kind_of_record_that_stands_there_exists():
    source = "\n".join(path.read_text("utf-8") for path in FOLDER.glob("*.py"))
    for kind in rows(section("The trace")):
        stem = "desire_{how}" if kind in ("desire_fulfilled", "desire_dropped") else kind
        assert f'"{stem}"' in source, kind


def test_every_field_of_a_desire_stands_there():
    assert rows(section("Desires")).keys() >= set(Desire.__struct_fields__)


@pytest.mark.parametrize("check", sorted(words_of(get_type_hints(FactCondition)["check"])))
def test_every_check_is_told(check):
    assert f"`{check}`" in section("Desires")


def test_every_option_stands_there_with_its_default():
    table = rows(section("Parameters"))
    for option in fields(DeliberationOptions):
        told = table.get(option.name) or next(
            line for line in section("Plan execution").splitlines() if f"`{option.name}`" in line
        )
        if option.default is not False:
            assert str(option.default) in told, option.name


def test_the_keys_of_files_are_those_of_what_they_make():
    table = section("Files")
    (belief, desire, rule) = (
        next(line for line in table.splitlines() if line.startswith(f"| {kind} |"))
        for kind in ("belief", "desire", "rule")
    )
    for kind, line in ((Fact, belief), (Desire, desire)):
        assert set(kind.__struct_fields__) <= set(re.findall(r"`(\w+)`", line))
    assert {field.name for field in fields(ReactiveRule)} - {"effects"} <= set(re.findall(r"`(\w+)`", rule))


def test_every_state_of_a_request_is_told():
    states = words_of(get_type_hints(SentRequest)["state"]) | words_of(get_type_hints(AgentReply)["state"])
    page = (ROOT / "howto" / "requests.md").read_text("utf-8")
    assert states <= rows(page).keys()


def test_every_status_of_an_agent_is_told():
    for status in words_of(get_type_hints(LifecycleStatus)["status"]):
        assert status in section("Topics")
