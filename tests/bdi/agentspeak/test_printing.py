from __future__ import annotations

import pytest
from hypothesis import given

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

pytestmark = pytest.mark.filterwarnings("ignore:Generating overly large repr")


@SLOW
@given(PLANS)
def test_a_printed_plan_reads_as_the_same_plan(plan):
    assert shape(parse_plan(agentspeak(plan))) == shape(plan)


@SLOW
@given(INFERENCES)
def test_a_printed_inference_reads_as_the_same(inference):
    (read,) = parse(agentspeak(inference)).inferences
    assert shape(read) == shape(inference)


@SLOW
@given(TERMS)
def test_a_printed_term_reads_as_the_same(term):
    assert shape(parse_term(agentspeak(term))) == shape(term)


@SLOW
@given(LITERALS)
def test_a_printed_literal_reads_as_the_same(literal):
    assert shape(parse_literal(agentspeak(literal))) == shape(literal)


@SLOW
@given(CONTEXTS)
def test_a_printed_condition_reads_as_the_same(condition):
    assert shape(parse_condition(agentspeak(condition))) == shape(condition)


@SLOW
@given(TRIGGERS)
def test_a_printed_event_reads_as_the_same(event):
    assert shape(parse_event(agentspeak(event))) == shape(event)
