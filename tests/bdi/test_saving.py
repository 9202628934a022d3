"""A mind is saved, restored in an engine made anew, and goes on as if nothing had happened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import (
    Action,
    Atom,
    Belief,
    Engine,
    apart,
    atomic,
    enter,
    first_of,
    for_each,
    source,
    stage,
    wait,
    wait_for,
)
from socialbot.bdi.literals import Literal, literal
from socialbot.bdi.saving import MindError, restore, save
from socialbot.bdi.society import Society
from socialbot.bdi.steps import Update
from socialbot.core.clock import SECOND, ManualClock
from tests.bdi.lab import Lab, X, Y, deep, do, go, mood, p, ping, q, sub
from tests.bdi.minds import again, mind


class roll(Action):  # noqa: N801 - reads as a step of a plan
    """Notes a random number."""

    def execute(self) -> None:
        self.engine.robot.note(self.engine.random.randrange(1000))


# What beliefs keep


def test_beliefs_keep_their_annotations_sources_and_beginnings():
    lab = Lab()
    lab.clock.advance(2)
    lab.engine.believe(p(1)[literal("certain", (0.5,))], source="bob", since=7)
    lab.engine.believe(p(1), source="percept")
    lab.engine.believe(q("x"))
    lab.tell()
    twin = again(lab)
    assert mind(twin.engine) == mind(lab.engine)
    held = twin.engine.beliefs.get(p(1))
    assert held is not None
    assert (held.sources, held.since) == (("bob", "percept"), 7)
    assert twin.kinds("belief") == []


class seen(Belief):  # noqa: N801 - reads as a belief
    """Belief that occurs in the body of a plan only."""


class hidden(Belief):  # noqa: N801 - reads as a belief
    """Belief that occurs in the condition of an inference only."""


def test_restored_beliefs_have_the_classes_of_the_program():
    rules = [go() >> [for_each(seen(X), [+p(X)])], q(X) << hidden(X)]
    lab = Lab(*rules)
    lab.engine.believe(seen(1))
    lab.engine.believe(hidden(2))
    lab.tell()
    other = Lab(*rules)
    restore(other.engine, save(lab.engine))
    assert {type(held.belief) for held in other.engine.beliefs} == {seen, hidden}


TERMS = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(allow_nan=False),
        st.text(max_size=5),
        st.sampled_from("abc").map(Atom),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(tuple),
        st.builds(
            lambda name, args, notes, negated: literal(name, tuple(args), tuple(notes), negated=negated),
            st.sampled_from("fgh"),
            st.lists(inner, max_size=2),
            st.lists(inner, max_size=1),
            st.booleans(),
        ),
    ),
    max_leaves=6,
)


def shape(term: object) -> object:
    """A term with the types of everything in it."""
    if isinstance(term, tuple):
        return tuple(map(shape, term))
    if isinstance(term, Literal):
        return term.functor, shape(term.args), shape(term.annotations), term.negated
    return type(term), term


@settings(deadline=None, max_examples=100)
@given(st.lists(TERMS, min_size=1, max_size=4), st.booleans())
def test_restores_all_terms(terms, negated):
    lab = Lab()
    belief = literal("b", tuple(terms), (source(Atom("bob")),), negated=negated)
    lab.engine.believe(belief, source="ann")
    lab.engine.run_until_idle()
    twin = again(lab)
    (before,), (after,) = lab.engine.beliefs, twin.engine.beliefs
    assert shape(after.belief) == shape(before.belief)
    assert after.sources == before.sources


@pytest.mark.parametrize("value", [frozenset({1}), Path("x"), b"x", type, 1j], ids=repr)
def test_unsupported_value_is_an_error_with_the_belief(value):
    lab = Lab()
    lab.tell(+p((1, value)))
    with pytest.raises(MindError, match=r"belief p\(.*cannot be saved"):
        save(lab.engine)


def test_a_singleton_of_a_saved_mind_is_replaced_as_usual():
    rules = [+mood(X) >> [do(X)]]
    lab = Lab(*rules)
    lab.tell(+mood("glad"))
    twin = again(lab, *rules)
    twin.tell(+mood("sad"))
    assert twin.done == ["glad", "sad"]
    assert twin.beliefs == ['mood("sad")']


def test_restoring_discards_initial_beliefs_and_goals():
    from socialbot.bdi.agentspeak.loading import load

    lab = Lab()
    lab.tell(+p(1))
    data = save(lab.engine)
    twin = Lab(go() >> [do("begun")])
    asked: list[str] = []
    twin.post(+p(2), -p(1), go())
    load(twin.engine, "b(1). !start. +!start <- .print(1).")
    twin.engine.call(lambda: asked.append("a sensor begins"))
    restore(twin.engine, data)
    twin.engine.run_until_idle()
    assert (twin.beliefs, twin.done, asked) == (["p(1)"], [], ["a sensor begins"])
    assert twin.kinds("failure") == []


def test_restoring_replaces_a_running_mind():
    rules = [go() >> [wait(5), do("late")], +p(X).held_for(5) >> [do(X)]]
    lab = Lab(*rules)
    lab.tell(+q(1))
    data = save(lab.engine)
    lab.tell(go(), +p(1))
    restore(lab.engine, data)
    assert lab.engine.next_wakeup() is None
    lab.until(9)
    assert (lab.done, lab.beliefs) == ([], ["q(1)"])


# What is pursued


def test_adopts_the_outermost_goal_again():
    rules = [go() >> [do("a"), sub(), do("c")], sub() >> [do("b"), wait(2), do("bb")]]
    lab = Lab(*rules)
    lab.engine.achieve(go()[literal("note")], cause="caller")
    lab.engine.run_until_idle()
    twin = again(lab, *rules)
    twin.until(3)
    assert twin.done == ["a", "b", "a", "b", "bb", "c"]
    assert next(record.cause for record in twin.trace if record.kind == "goal") == "lab-1"


def test_adopts_the_last_continued_goal():
    rules = [go(X) >> [do(X), wait(1), go(X + 1)]]
    lab = Lab(*rules)
    lab.tell(go(0))
    lab.until(3.5)
    twin = again(lab, *rules)
    twin.until(5)
    assert twin.done == [0, 1, 2, 3, 3, 4]


def test_raises_the_event_of_an_intention_again():
    rules = [+p(X) / q(X) >> [do(X), wait(2), do("end")], -p(X) >> [wait(1), do("gone")]]
    lab = Lab(*rules)
    lab.tell(+q(1), +p(1), +p(2), -p(2))
    twin = again(lab, *rules)
    twin.until(9)
    assert twin.done == [1, 1, "gone", "end"]


def test_discards_an_event_without_plans():
    lab = Lab(+p(X) >> [wait(2)])
    lab.tell(+p(1))
    twin = again(lab)
    twin.until(3)
    assert twin.engine.mind().intentions == ()
    assert twin.kinds("failure") == []


def test_branches_restart_with_their_goal():
    rules = [go() >> [first_of([wait(3), do("slow")], [wait(2), do("fast")]), do("end")]]
    lab = Lab(*rules)
    lab.tell(go())
    twin = again(lab, *rules)
    assert len(twin.engine.interpreter.events) == 1
    twin.until(9)
    assert twin.done == ["fast", "end"]


def test_waiting_goal_waits_again():
    rules = [go() >> [wait_for(+ping(X)), do(X)], sub() >> [wait_for(q(X)), do(X)]]
    lab = Lab(*rules)
    lab.tell(go(), sub())
    twin = again(lab, *rules)
    twin.engine.run_until_idle()
    twin.tell(+ping(1), +q(2))
    assert twin.done == [1, 2]


def test_a_goal_after_a_long_chain_is_not_lost():
    rules = [go(X) / (X < 10_000) >> [go(X + 1)], go(X) / (X >= 10_000) >> [do(X)]]
    lab = Lab(*rules)
    lab.post(go(0))
    lab.engine.run_until_idle(1)
    assert lab.done == []
    twin = again(lab, *rules)
    twin.engine.run_until_idle()
    assert twin.done == [10_000]
    begun = next(record.what for record in twin.trace if record.kind == "goal")
    assert begun != "go(0)"


def test_a_suspended_intention_remains_suspended():
    rules = [go() >> [do("a"), wait(1), do("b")]]
    lab = Lab(*rules)
    lab.tell(go())
    next(iter(lab.engine.intentions)).suspended = True
    twin = again(lab, *rules)
    twin.until(5)
    assert twin.done == ["a"]
    (intention,) = twin.engine.intentions
    assert intention.state == "suspended"
    intention.suspended = False
    twin.engine.interpreter.ready.append(intention)
    twin.until(9)
    assert twin.done == ["a", "a", "b"]


def test_saves_posted_items():
    rules = [+p(X) >> [do(X)], -q(X) >> [do("gone")], go(X) >> [do(X)], +ping(X) >> [do(X)]]
    lab = Lab(*rules)
    lab.tell(+q(1))
    lab.post(+p(1), -q(1), go(2), +ping(3))
    twin = again(lab, *rules)
    twin.engine.run_until_idle()
    lab.engine.run_until_idle()
    assert twin.done == lab.done == [1, "gone", 2, 3]


def test_saves_all_beliefs_that_were_told():
    rule = +p(X) >> [do(X)]
    lab = Lab(rule)
    society = Society(lab.clock)
    bob = society.add(Lab(name="bob").engine)
    society.add(lab.engine)
    for number in (1, 2):
        bob.messaging.send("lab", "tell", p(number))
    twin = again(lab, rule)
    twin.engine.run_until_idle()
    assert twin.done == [1, 2]


def test_the_ids_of_the_trace_go_on():
    lab = Lab()
    lab.tell(+p(1), +p(2))
    twin = again(lab)
    twin.tell(+p(3))
    assert [record.id for record in twin.trace] == ["lab-3"]


# Time


HELD = [+p(X).held_for(5) >> [do(X)], +p(X).held_for(8) >> [do("long")]]


@pytest.mark.parametrize(
    ("saved_at", "later", "expected"),
    [
        (2, 0, [(5, 1), (8, "long")]),
        (5, 0, [(5, 1), (8, "long")]),
        (6, 0, [(5, 1), (8, "long")]),
        (6, 10, [(5, 1), (16, "long")]),
        (2, 4, [(6, 1), (8, "long")]),
        (2, 100, [(102, 1), (102, "long")]),
        (9, 0, [(5, 1), (8, "long")]),
    ],
)
def test_held_for_event_occurs_once_and_in_time(saved_at, later, expected):
    lab = Lab(*HELD)
    lab.tell(+p(1))
    lab.until(saved_at)
    twin = again(lab, *HELD, later=later)
    twin.until(200)
    assert twin.timeline == expected


def test_due_timer_runs_before_saving():
    lab = Lab(*HELD)
    lab.tell(+p(1))
    lab.clock.advance(6)
    twin = again(lab, *HELD)
    twin.until(9)
    assert twin.timeline == [(6, 1), (8, "long")]


def test_removed_belief_raises_no_held_for_event():
    lab = Lab(*HELD)
    lab.tell(+p(1))
    twin = again(lab, *HELD)
    twin.tell(-p(1))
    twin.until(9)
    assert twin.done == []


def test_duration_is_computed_once():
    seconds = iter([3.0])
    lab = Lab(+p(X).held_for(lambda: next(seconds)) >> [do(X)])
    lab.tell(+p(1))
    twin = again(lab, +p(X).held_for(lambda: 99.0) >> [do(X)])
    twin.until(4)
    assert twin.timeline == [(3, 1)]


def test_new_held_for_plan_starts_and_removed_plan_ends():
    lab = Lab(HELD[0])
    lab.tell(+p(1))
    lab.until(1)
    twin = again(lab, HELD[1])
    twin.until(9)
    assert twin.timeline == [(8, "long")]


def test_restarts_an_intention_of_a_held_for_plan():
    rules = [+p(X).held_for(1) >> [do(X), wait(3), do("end")]]
    lab = Lab(*rules)
    lab.tell(+p(1))
    lab.until(2)
    twin = again(lab, *rules)
    twin.until(9)
    assert twin.timeline == [(1, 1), (2, 1), (5, "end")]


# The stage and chance


def test_the_stage_is_kept_and_is_no_event():
    rules = [go() >> [enter("night")], *stage("night", sub() >> [do("dark")]), sub() >> [do("light")]]
    lab = Lab(*rules)
    lab.tell(go())
    twin = again(lab, *rules)
    twin.tell(sub())
    assert twin.done == (["dark"] if twin.engine.interpreter.stage == "night" else [])
    assert twin.kinds("event") == []


def test_the_random_numbers_go_on():
    rules = [go() >> [roll()]]
    lab = Lab(*rules)
    lab.tell(*[go()] * 3)
    twin = again(lab, *rules)
    lab.tell(*[go()] * 3)
    twin.tell(*[go()] * 3)
    assert twin.done == lab.done
    assert len(set(lab.done)) > 3


# Random minds


RULES = [
    +p(X).held_for(2) >> [do("held", X)],
    +p(X) / (q(Y) & (Y > X)) >> [do("more", X, Y), +q(X)],
    +p(X) >> [do("p", X), roll()],
    -p(X) >> [do("gone", X)],
    +q(X) / p(X) >> [go(X)],
    +mood(X) >> [apart(sub(X))],
    go(X) / (X > 2) >> [do("large", X), enter("large")],
    *stage("large", go(X) >> [do("in large", X), Update("-+", mood(X))]),
    go(X) / ~q(5) >> [do("small", X), -q(X)],
    *atomic(sub(X) >> [do("sub", X), roll(), do("after", X)]),
    deep(X) / p(Y) >> [do("deep", X, Y)],
]
ITEMS = st.one_of(
    st.builds(lambda kind, value: +kind(value), st.sampled_from([p, q, mood]), st.integers(0, 5)),
    st.builds(lambda kind, value: -kind(value), st.sampled_from([p, q, mood]), st.integers(0, 5)),
    st.builds(lambda kind, value: kind(value), st.sampled_from([go, sub, deep]), st.integers(0, 5)),
    st.floats(0, 3).map(lambda seconds: round(seconds, 1)),
)


def live(lab: Lab, items: list[Any]) -> None:
    for item in items:
        if isinstance(item, float):
            lab.until(lab.clock.now() / 1e9 + item)
        else:
            lab.post(item)


@settings(deadline=None, max_examples=200)
@given(st.lists(ITEMS, max_size=15), st.booleans(), st.lists(ITEMS, max_size=15))
def test_restored_mind_behaves_the_same(before, idle, after):
    lab = Lab(*RULES)
    live(lab, before)
    if idle:
        lab.engine.run_until_idle()
    twin = again(lab, *RULES)
    assert mind(twin.engine)[:3] == mind(lab.engine)[:3]
    for each in (lab, twin):
        live(each, after)
        live(each, [10.0])
    assert mind(twin.engine) == mind(lab.engine)
    assert twin.timeline == lab.timeline


@settings(deadline=None, max_examples=50)
@given(st.lists(ITEMS, max_size=15))
def test_saving_twice_saves_the_same(items):
    lab = Lab(*RULES)
    live(lab, items)
    data = save(lab.engine)
    assert save(lab.engine) == data
    twin = Engine("lab", ManualClock(lab.clock.now()))
    twin.add_rules(*RULES)
    restore(twin, data)
    assert save(twin) == data


@pytest.mark.parametrize("behind_s", [2, 3600])
def test_shifts_times_for_a_clock_that_was_set_back(behind_s):
    lab = Lab(+p(X).held_for(5) >> [do(X)])
    lab.clock.advance(7200)
    lab.engine.believe(p(1))
    lab.tell()
    lab.clock.advance(3)
    data = save(lab.engine)
    now = lab.clock.now() - behind_s * SECOND
    twin = Lab(+p(X).held_for(5) >> [do(X)])
    twin.clock.set(now)
    restore(twin.engine, data)
    held = twin.engine.beliefs.get(p(1))
    assert held is not None
    assert held.since == now - 3 * SECOND
    assert twin.engine.next_wakeup() == now + 2 * SECOND
    assert save(twin.engine)["ripening"] != []
