from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bdi.agentspeak import (
    agentspeak,
    parse,
    parse_condition,
    parse_event,
    parse_literal,
    parse_plan,
    parse_term,
)
from tests.bdi.agentspeak.programs import CONTEXTS, INFERENCES, LITERALS, PLANS, SLOW, TERMS, TRIGGERS
from tests.bdi.agentspeak.shape import shape

KINDS = {
    "plan": (PLANS, parse_plan),
    "inference": (INFERENCES, lambda text: parse(text).inferences[0]),
    "term": (TERMS, parse_term),
    "literal": (LITERALS, parse_literal),
    "condition": (CONTEXTS, parse_condition),
    "event": (TRIGGERS, parse_event),
}


@pytest.mark.filterwarnings("ignore:Generating overly large repr")
@pytest.mark.parametrize("kind", KINDS)
@SLOW
@given(st.data())
def test_a_printed_item_parses_to_an_equal_item(kind, data):
    items, read = KINDS[kind]
    item = data.draw(items)
    assert shape(read(agentspeak(item))) == shape(item)


@pytest.mark.parametrize("text", ["+a : 'f.g'(0) > 1", "+a : math.pi > 'f.g'(0)", "+a : [] > 'f.g'(0)[0]"])
def test_quotes_tell_a_structure_with_a_dot_from_a_call(text):
    plan = parse_plan(text)
    assert shape(parse_plan(agentspeak(plan))) == shape(plan)
    assert "'f.g'(0)" in agentspeak(plan)
