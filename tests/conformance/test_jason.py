"""Each conformance case prints what it says."""

from __future__ import annotations

import pytest

from socialbot.bdi.agentspeak import AgentSpeakError
from socialbot.bdi.compiler._conditions import COLLECTORS
from socialbot.bdi.compiler._runtime import FUNCTIONS
from socialbot.bdi.stdlib import internals
from tests.bdi.mas import Mas
from tests.conformance.jason import Case, all_items
from tools.conformance import PAGE, description, page

CASES = [(item.name, case) for item in all_items() for case in item.cases]


def printed(case: Case) -> list[str]:
    try:
        mas = Mas(me=case.text).until(20)
    except AgentSpeakError:
        return ["refused"]
    return [line[2:] for line in mas.lines if line.startswith("> ")]


@pytest.mark.parametrize(("name", "case"), CASES, ids=[f"{name} {case.body}" for name, case in CASES])
def test_case(name: str, case: Case):
    assert printed(case) == case.expected


def test_the_page_is_up_to_date():
    assert PAGE.read_text("utf-8") == page(), "run python -m tools.conformance"


def test_every_internal_action_and_function_is_an_item():
    names = [item.name for item in all_items()]
    shipped = {name for name in internals() if name[0] == "."}
    for name in sorted(shipped | COLLECTORS | FUNCTIONS.keys()):
        group = "." + name.split(".")[1]
        assert name in names or (group != name and group in names), name
        assert name in FUNCTIONS or description(name) or name in COLLECTORS, name


def test_items_that_differ_say_why():
    for item in all_items():
        assert bool(item.cases) != bool(item.missing or item.extra), item.name
        for case in item.cases:
            assert (case.here is None) == (not case.why), case.body
