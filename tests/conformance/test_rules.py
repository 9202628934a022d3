"""Meaning of the Python notation, and its agreement with AgentSpeak."""
# ruff: noqa: N801 - beliefs, goals and actions are written as agents write them, functions name variables

from __future__ import annotations

from collections.abc import Iterator

import pytest

from socialbot.bdi import (
    ANYTHING,
    Atom,
    Belief,
    Computed,
    Goal,
    PlanFailed,
    action,
    apart,
    as_long_as,
    ask,
    atomic,
    enter,
    error,
    fail,
    first_of,
    for_each,
    labelled,
    priority,
    source,
    stage,
    together,
    variables,
    wait,
    wait_for,
    when,
)
from socialbot.bdi import (
    test as holds,
)
from socialbot.bdi.agentspeak import agentspeak, parse_plan, rules
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, do, go, mood, p, q, sub

X, Y, Z, E, S, _ = variables("X Y Z E S _")

NOTATIONS = [
    (+p(X) >> [sub(X)], "+p(X) <- !sub(X)."),
    (-p(X) >> [do(X)], "-p(X) <- do(X)."),
    (+p(X) / q(X) >> [do(X)], "+p(X) : q(X) <- do(X)."),
    (+p(X) / (q(X) & ~q(2) & (X > 1)) >> [do(X)], "+p(X) : q(X) & not q(2) & X > 1 <- do(X)."),
    (+p(X) / (q(X) | mood(X)) >> [do(X)], "+p(X) : q(X) | mood(X) <- do(X)."),
    (go(X) >> [do(X)], "+!go(X) <- do(X)."),
    (-go(X) >> [do(X)], "-!go(X) <- do(X)."),
    ((-go(X)[error(E)]) >> [do(E)], "-!go(X)[error(E)] <- do(E)."),
    (+p(X)[source(S)] >> [do(S)], "+p(X)[source(S)] <- do(S)."),
    (+p(X).held_for(5) >> [do(X)], "+p(X)[held_for(5)] <- do(X)."),
    (go() >> [sub(1), apart(sub(2)), sub(3).within(5)], "+!go <- !sub(1); !!sub(2); !sub(3)[within(5)]."),
    (go() >> [+p(1), -q(_)], "+!go <- ++p(1); .abolish(q(_))."),
    (go() >> [ask(p(X)), do(X)], "+!go <- ?p(X); do(X)."),
    (go(X) >> [holds(X > 1)], "+!go(X) <- X > 1."),
    (go() >> [wait(0.5), wait_for(+p(X), 2)], "+!go <- .wait(500); .wait({+p(X)}, 2000)."),
    (go() >> [wait_for(p(X))], "+!go <- .wait(p(X))."),
    (go(X) >> [when(p(X), [do(1)], [do(2)])], "+!go(X) <- if (p(X)) { do(1) } else { do(2) }."),
    (go() >> [as_long_as(p(1), [do(1)])], "+!go <- while (p(1)) { do(1) }."),
    (go() >> [for_each(p(X), [do(X)])], "+!go <- for (p(X)) { do(X) }."),
    (go() >> [together([do(1)], [do(2), do(3)])], "+!go <- do(1) |&| { do(2); do(3) }."),
    (go() >> [first_of([do(1)], [do(2)])], "+!go <- do(1) ||| do(2)."),
    (go() >> [enter("night"), fail("no")], '+!go <- .enter(night); .fail(error_msg("no")).'),
    (atomic(go() >> [do(1)])[0], "@[atomic] +!go <- do(1)."),
    (priority(2, go() >> [do(1)])[0], "@[priority(2)] +!go <- do(1)."),
    (stage("night", go() >> [do(1)])[0], "@[stage(night)] +!go <- do(1)."),
    (labelled("l", go() >> [do(1)]), "@l +!go <- do(1)."),
    (p(X) << (q(X) & (X > 1)), "p(X) :- q(X) & X > 1."),
    (go() >> [do(Atom("yes"), "yes", (1, 2), 1.5)], '+!go <- do(yes, "yes", [1, 2], 1.5).'),
]  # fmt: skip


@pytest.mark.parametrize(("rule", "text"), NOTATIONS, ids=[text for _, text in NOTATIONS])
def test_both_notations(rule, text):
    assert agentspeak(rule) == text
    if ":-" not in text and "abolish" not in text and ".fail" not in text and ".enter" not in text:
        assert agentspeak(parse_plan(text)) == text
        assert rules(parse_plan(text))


# Beliefs


def test_a_belief_of_python_is_an_event_of_its_own():
    lab = Lab(go() >> [+p(1), do("on")], +p(X) >> [do(X)])
    lab.tell(go())
    assert lab.done == ["on", 1]


def test_minus_of_python_removes_all_matches_of_any_source():
    lab = Lab(go() >> [-p(_)])
    lab.engine.believe(p(1), source="bob")
    lab.tell(+p(2), +q(3), go())
    assert lab.beliefs == ["q(3)"]


class larger(Computed):
    def solutions(self, a: object, b: object) -> bool:
        return a > b  # type: ignore[operator]


class digit(Computed):
    def solutions(self, n: object) -> Iterator[tuple[object, ...]]:
        return ((i,) for i in range(10)) if n is ANYTHING else iter([(n,)] if n in range(10) else [])


def test_a_computed_belief_is_asked_when_it_is_needed():
    lab = Lab(go(X) / larger(X, 3) >> [do("large")], go(X) / ~larger(X, 3) >> [do("small")])
    lab.tell(go(5), go(1))
    assert lab.done == ["large", "small"]


def test_a_computed_belief_gives_values():
    lab = Lab(go() / (digit(X) & (X > 7)) >> [do(X)], sub(X) / digit(X) >> [do("digit")], sub(X) >> [do("none")])
    lab.tell(go(), sub(3), sub(30))
    assert lab.done == [8, "digit", "none"]


def test_a_computed_belief_cannot_be_held():
    with pytest.raises(RuleError, match="is computed"):
        _ = go() >> [+digit(3)]
    lab = Lab()
    with pytest.raises(RuleError, match="is computed"):
        lab.engine.believe(digit(3))


# Conditions


def test_any_object_that_never_changes_is_a_value():
    place = frozenset({1, 2})
    lab = Lab(+p(X) / q(X, Y) >> [do(Y)])
    lab.tell(+q(place, None), +p(place))
    assert lab.done == [None]


# Steps


def test_the_limit_of_a_goal_may_be_a_variable():
    lab = Lab(go(X) >> [sub("a").within(X), do("never")], sub(_) >> [wait(9)], -go(X)[error(E)] >> [do(X, E)])
    lab.tell(go(2))
    lab.until(10)
    assert lab.timeline == [(2.0, (2, Atom("timeout")))]


def test_a_goal_from_outside_may_have_a_limit():
    lab = Lab(go() >> [wait(9), do("never")], -go()[error(E)] >> [do(E)])
    lab.tell(go().within(3))
    lab.until(10)
    assert lab.timeline == [(3.0, Atom("timeout"))]


def test_a_goal_from_outside_waits_for_the_events_before_it():
    lab = Lab(+p(X) >> [+q(X)], go() / q(1) >> [do("knows")], go() >> [do("too early")])
    lab.post(+p(1), go())
    lab.engine.run_until_idle()
    assert lab.done == ["knows"]


def test_plan_failed_has_the_reason():
    @action
    def refuse(engine: object) -> None:
        raise PlanFailed("the door is shut")

    lab = Lab(go() >> [refuse()], -go()[error(E)] >> [do(E)])
    lab.tell(go())
    assert lab.done == [Atom("action_failed")]
    (record,) = [record for record in lab.trace if record.kind == "failure"]
    assert record.detail["message"] == "the door is shut"


def test_a_rule_needs_no_event_but_a_goal():
    class tidy(Goal): ...

    class dirty(Belief): ...

    lab = Lab(tidy() / dirty() >> [do("cleans"), -dirty(), tidy()], tidy() >> [do("done")])
    lab.tell(+dirty(), tidy())
    assert lab.done == ["cleans", "done"]


def test_refuses_a_comparison_as_an_argument():
    with pytest.raises(RuleError, match="X > 1 is not a value"):
        _ = go() >> [do(X > 1)]


def test_refuses_a_class_as_an_event():
    with pytest.raises(RuleError, match="go is a class"):
        _ = go >> [do(1)]  # type: ignore[operator]
