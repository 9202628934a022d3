"""The event that a belief took the place of another one."""

from __future__ import annotations

import pytest

from socialbot.bdi.agentspeak import agentspeak, parse_plan
from socialbot.bdi.literals import literal
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, Y, do, mood, p, ping


def test_a_singleton_that_takes_the_place_of_another_is_a_change():
    lab = Lab(mood(X).changed(Y) >> [do(Y, X)])
    for value in ("calm", "calm", "merry", "sad"):
        lab.tell(+mood(value))
    assert lab.done == [("calm", "merry"), ("merry", "sad")]


def test_change_event_follows_the_removal_and_precedes_the_addition():
    lab = Lab(-mood(X) >> [do("gone", X)], mood(X).changed(Y) >> [do("now", X)], +mood(X) >> [do("new", X)])
    lab.tell(+mood(1))
    lab.tell(+mood(2))
    assert lab.done == [("new", 1), ("gone", 1), ("now", 2), ("new", 2)]


def test_constants_tell_which_change_is_meant():
    lab = Lab(mood("sad").changed("merry") >> [do("alas")], mood("merry").changed(X) >> [do("hurrah")])
    for value in ("sad", "merry", "calm", "sad", "merry", "sad"):
        lab.tell(+mood(value))
    assert lab.done == ["hurrah", "hurrah", "alas"]


def test_in_agentspeak_a_replaced_belief_has_changed():
    lab = Lab()
    lab.engine.add_rules(parse_plan("+n(X)[changed(Y)] <- do(Y, X)"))
    lab.engine.add_rules(parse_plan("+!count(N) : N > 0 <- -+n(N); !count(N - 1)"))
    lab.engine.add_action(do)
    lab.engine.achieve(literal("count", (3,)))
    lab.engine.run_until_idle()
    assert lab.done == [(3, 2), (2, 1)]


def test_it_is_printed_in_both_notations():
    rule = mood(X).changed(Y) >> [do(X)]
    assert str(rule) == "mood(X).changed(Y) >> [do(X)]"
    assert agentspeak(rule) == "+mood(X)[changed(Y)] <- do(X)."
    assert str(parse_plan(agentspeak(rule)).event) == "mood(X).changed(Y)"


@pytest.mark.parametrize("change", [lambda: mood(X).changed(), lambda: p().changed()])
def test_a_change_has_as_many_arguments_before_as_after(change):
    with pytest.raises(RuleError):
        change()


def test_reactor_never_changes():
    with pytest.raises(RuleError, match="never happens"):
        Lab(ping(X).changed(Y) >> [do("never")])
