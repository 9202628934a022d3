# ruff: noqa: N803 - functions name the variables they look at

import itertools
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Engine, Sensor, ask, library, wait
from socialbot.bdi._intention_stack import CHAIN
from socialbot.bdi._interpreter import STEPS
from socialbot.bdi.compiler._source import Unit
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, Y, Z, _, crash, deep, do, go, mood, p, ping, q, sub

# Events


def test_addition_and_removal_of_a_belief_are_events():
    lab = Lab(+p(X) >> [do("came", X)], -p(X) >> [do("went", X)])
    lab.tell(+p(1), -p(1))
    assert lab.done == [("came", 1), ("went", 1)]


def test_repeated_belief_raises_no_event():
    lab = Lab(+p(X) >> [do(X)])
    lab.tell(+p(1))
    lab.clock.advance(1)
    lab.tell(+p(1), +p(1))
    assert lab.done == [1]
    (held,) = lab.engine.beliefs
    assert held.since == 0


def test_removing_a_missing_belief_raises_no_event():
    lab = Lab(-p(X) >> [do(X)])
    lab.tell(-p(1))
    assert lab.done == []


def test_removing_a_pattern_removes_all_matches():
    lab = Lab(-p(X, Y) >> [do(X, Y)])
    lab.tell(+p(1, 1), +p(1, 2), +p(2, 2), -p(1, _))
    assert lab.done == [(1, 2), (1, 1)]
    assert lab.beliefs == ["p(2, 2)"]


def test_singleton_replaces_the_previous_belief():
    lab = Lab(+mood(X) >> [do("+", X)], -mood(X) >> [do("-", X)])
    lab.tell(+mood("sad"), +mood("glad"), +mood("glad"))
    assert lab.beliefs == ['mood("glad")']
    assert lab.done == [("+", "sad"), ("-", "sad"), ("+", "glad")]


def test_removed_singleton_does_not_hold_in_conditions():
    lab = Lab(-mood(X) / mood(Y) >> [do(X, Y)])
    lab.tell(+mood("sad"), +mood("glad"))
    assert lab.done == [("sad", "glad")]


def test_a_reactor_is_an_event_each_time_and_never_held():
    lab = Lab(+ping(X) >> [do(X), +q(X)])
    lab.tell(+ping(1), +ping(1))
    assert lab.done == [1, 1]
    assert lab.beliefs == ["q(1)"]


def test_a_short_pulse_is_seen_both_ways():
    lab = Lab(+p(1) >> [do("up")], -p(1) >> [do("down")])
    lab.post(+p(1), -p(1), +p(1), -p(1))
    lab.engine.run_until_idle()
    assert lab.done == ["up", "down", "up", "down"]


def test_a_plan_believes_and_forgets():
    lab = Lab(go(X) >> [+p(X), +p(X + 1), -p(X)], +p(X) >> [do("+", X)], -p(X) >> [do("-", X)])
    lab.tell(go(1))
    assert lab.beliefs == ["p(2)"]
    assert lab.done == [("+", 1), ("+", 2), ("-", 1)]


def test_arity_distinguishes_events():
    lab = Lab(+p(X) >> [do("one")], +p(X, Y) >> [do("two")])
    lab.tell(+p(1, 2))
    assert lab.done == ["two"]


# The choice of a rule


def test_the_first_rule_that_applies_is_the_only_one():
    lab = Lab(+p(2) >> [do("two")], +p(X) / q(X) >> [do("q")], +p(X) >> [do("any")], +p(X) >> [do("too late")])
    lab.tell(+q(1), +p(1), +p(2), +p(3))
    assert lab.done == ["q", "two", "any"]


def test_a_rule_whose_condition_fails_leaves_no_variables_to_the_next():
    lab = Lab(+p(X) / (q(Y) & (Y > 9)) >> [do("big")], +p(X) / q(X, Y) >> [do(X, Y)])
    lab.tell(+q(5), +q(1, 7), +p(1))
    assert lab.done == [(1, 7)]


def test_a_condition_joins_beliefs_from_left_to_right_and_takes_the_first_solution():
    lab = Lab(go(X) / (p(X, Y) & q(Y, Z)) >> [do(X, Y, Z)])
    lab.tell(+p(1, 2), +p(1, 3), +q(3, 4), +q(3, 5), go(1))
    assert lab.done == [(1, 3, 5)]


def test_a_negation_holds_when_nothing_matches():
    lab = Lab(go(X) / ~p(X, _) >> [do("none")], go(X) >> [do("some")])
    for item in (go(1), +p(2, 1), go(1), +p(1, 1), go(1), -p(1, 1), go(1)):
        lab.tell(item)
    assert lab.done == ["none", "none", "some", "none"]


def test_comparisons_and_functions_look_at_the_variables_by_name():
    lab = Lab(
        go(X) / (p(Y) & (Y > X) & (lambda Y, X: Y % X == 0)) >> [do(Y)],
        go(X) / (lambda: True) >> [do("none")],
    )
    lab.tell(+p(1), +p(4), +p(6), go(3), go(7))
    assert lab.done == [6, "none"]


def test_the_condition_is_judged_when_the_event_is_looked_at():
    lab = Lab(+p(1) >> [+q(1)], +p(2) / q(1) >> [do("seen")])
    lab.post(+p(1), +p(2))
    lab.engine.run_until_idle()
    assert lab.done == ["seen"]


def test_a_rule_added_later_reacts_from_then_on():
    lab = Lab()
    lab.tell(+p(1))
    lab.engine.add_rules(+p(X) >> [do(X)])
    lab.tell(+p(2))
    assert lab.done == [2]


# Goals


def test_a_goal_is_carried_out_before_the_plan_goes_on():
    lab = Lab(go() >> [do(1), sub("a"), do(4)], sub(X) >> [do(2), deep(), do(3)], deep() >> [do("deep")])
    lab.tell(go())
    assert lab.done == [1, 2, "deep", 3, 4]
    assert lab.kinds("achieved") == ["deep()", 'sub("a")', "go()"]


def test_the_variables_of_a_plan_are_its_own():
    lab = Lab(go(X) >> [sub(X + 1), do(X)], sub(X) >> [do(X)])
    lab.tell(go(1))
    assert lab.done == [2, 1]


def test_a_goal_may_pursue_itself_deeply():
    lab = Lab(go(0) >> [do("down")], go(X) >> [go(X - 1), +p(X)])
    lab.tell(go(3000))
    assert lab.done == ["down"]
    assert len(lab.beliefs) == 3000


def test_a_plan_without_steps_achieves_its_goal():
    lab = Lab(go() >> [sub(), do("after")], sub() >> [])
    lab.tell(go(), sub())
    assert lab.done == ["after"]
    assert lab.kinds("achieved") == ["sub()", "sub()", "go()"]


# Intentions


def test_intentions_take_turns():
    lab = Lab(go(X) >> [do(X), do(X), do(X)])
    lab.tell(go("a"), go("b"))
    # When the second one is taken up, the first one has made a step already.
    assert lab.done == ["a", "a", "b", "a", "b", "b"]


def test_an_endless_intention_starves_no_other():
    lab = Lab(go() >> [do("tick"), go()], +p(X) >> [do(X), do(X)])
    lab.post(go())
    assert lab.engine.run_until_idle(budget=6)
    lab.post(+p("a"))
    assert lab.engine.run_until_idle(budget=6)
    assert lab.done.count("a") == 2


def test_the_budget_bounds_the_thinking():
    lab = Lab(go(X) >> [do(X), go(X + 1)])
    lab.post(go(0))
    turn = (len(STEPS) + 1) * len(CHAIN)
    for turns in (1, 2, 4):
        before = len(lab.done)
        assert lab.engine.run_until_idle(budget=turns)
        assert turns <= len(lab.done) - before <= turns * turn
    assert lab.done == list(range(len(lab.done)))


def test_each_intention_makes_one_step_in_a_turn():
    lab = Lab(go(X) >> [do(X), go(X)])
    lab.post(go("a"), go("b"))
    assert lab.engine.run_until_idle(budget=42)
    assert 20 <= len(lab.done) <= 42
    assert abs(lab.done.count("a") - lab.done.count("b")) <= 2


def test_thinking_ends_when_nothing_is_left():
    lab = Lab(go() >> [do(1)])
    assert lab.engine.run_until_idle() is False
    lab.post(go())
    assert lab.engine.run_until_idle() is False
    assert lab.engine.next_wakeup() is None


def test_waiting_suspends_one_intention_and_no_other():
    lab = Lab(go(X) >> [do(X, 1), wait(X), do(X, 2)], +p(1) >> [do("p")])
    lab.tell(go(2), go(1))
    lab.tell(+p(1))
    assert lab.engine.next_wakeup() == SECOND
    lab.until(5)
    assert lab.timeline == [(0, (2, 1)), (0, (1, 1)), (0, "p"), (1, (1, 2)), (2, (2, 2))]


def test_waiting_in_a_subgoal_holds_up_the_goal():
    lab = Lab(go() >> [sub(), do("after")], sub() >> [wait(1.5)])
    lab.tell(go())
    assert lab.kinds("achieved") == []
    lab.until(3)
    assert lab.timeline == [(1.5, "after")]
    assert lab.kinds("achieved") == ["sub()", "go()"]


def test_equal_waits_end_in_order():
    lab = Lab(go(X) >> [wait(1), do(X)])
    lab.tell(go("a"), go("b"), go("c"))
    lab.until(1)
    assert lab.done == ["a", "b", "c"]


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(1, 4), min_size=1, max_size=4))
def test_each_intention_makes_a_step_before_any_makes_a_second(lengths):
    lab = Lab(*(go(n) >> [wait(1), *[do(n)] * length] for n, length in enumerate(lengths)))
    lab.tell(*map(go, range(len(lengths))))
    lab.until(1)
    rounds = itertools.zip_longest(*([n] * length for n, length in enumerate(lengths)))
    assert lab.done == [n for served in rounds for n in served if n is not None]


def test_mind_shows_beliefs_desires_and_intentions():
    lab = Lab(go() >> [sub(1), do("after")], sub(X) >> [wait(1), do(X)], +p(X) >> [go()])
    lab.tell(+p(1))
    mind = lab.engine.mind()
    assert [str(held.belief) for held in mind.beliefs] == ["p(1)"]
    assert list(map(str, mind.desires)) == ["go()", "sub(1)"]
    assert list(map(str, mind.intentions)) == ["sub(X) < go() (waits 1 s)"]
    lab.until(1)
    assert lab.engine.mind().intentions == ()


# Perceiving


class Words(Sensor):
    def sense(self, percept):
        return [+p(word) for word in percept]


def test_a_sensor_turns_a_percept_into_beliefs():
    lab = Lab(+p(X) >> [do(X)])
    lab.engine.perceive(Words(), ["a", "b"], cause="frame-7", since=-3)
    lab.engine.run_until_idle()
    assert lab.done == ["a", "b"]
    held = next(iter(lab.engine.beliefs))
    assert (held.source, held.since) == ("percept", -3)
    assert {record.cause for record in lab.trace if record.kind == "belief"} == {"frame-7"}


@pytest.mark.parametrize(
    ("sensed", "beliefs"),
    [
        (None, ["p(0)"]),
        (p(1), ["p(0)", "p(1)"]),
        (+p(1), ["p(0)", "p(1)"]),
        (-p(0), []),
        (-p(_), []),
        ([p(1), -p(0)], ["p(1)"]),
        ((p(n) for n in (1, 2)), ["p(0)", "p(1)", "p(2)"]),
        (+ping(1), ["p(0)"]),
    ],
)
def test_a_sensor_may_return_beliefs_and_changes(sensed, beliefs):
    class Given(Sensor):
        def sense(self, percept):
            return sensed

    lab = Lab()
    lab.tell(+p(0))
    lab.engine.perceive(Given(), None)
    lab.engine.run_until_idle()
    assert lab.beliefs == beliefs
    assert lab.kinds("failure") == []


@pytest.mark.parametrize(
    "sensed", ["p", [3], go(), +p(X), p(1).held_for(1), +p(0).held_for(1), -go(), do("x")], ids=str
)
def test_other_result_of_a_sensor_is_a_failure_on_the_trace(sensed):
    class Odd(Sensor):
        def sense(self, percept):
            return sensed

    lab = Lab(+p(1) >> [do("alive")])
    lab.tell(+p(0))
    lab.engine.perceive(Odd(), None, cause="frame-1")
    lab.tell(+p(1))
    assert lab.done == ["alive"]
    assert lab.beliefs == ["p(0)", "p(1)"]
    assert [(record.what, record.cause) for record in lab.trace if record.kind == "failure"] == [("Odd", "frame-1")]


def test_exception_of_a_sensor_is_on_the_trace_with_its_place():
    class Eyes(Sensor):
        def sense(self, percept):
            return +p(json.loads(percept))

    lab = Lab(+p(1) >> [do("alive")])
    lab.engine.perceive(Eyes(), "{")
    lab.tell(+p(1))
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    line = Eyes.sense.__code__.co_firstlineno + 1
    assert (failure.detail["reason"], failure.detail["where"]) == ("JSONDecodeError", f"test_engine.py:{line}")


class Thermometer(Sensor):
    period_s = 0.5

    def __init__(self, clock: ManualClock) -> None:
        self.clock = clock

    def sense(self, percept):
        assert percept is None
        return mood(self.clock.now() / SECOND)


def test_a_sensor_that_was_late_is_asked_only_once():
    lab = Lab(+mood(X) >> [do(X)])
    lab.engine.add_sensor(Thermometer(lab.clock))
    lab.engine.run_until_idle()
    lab.clock.advance(2.2)
    lab.engine.run_until_idle()
    assert lab.timeline == [(0, 0), (2.2, 2.2)]
    assert lab.engine.next_wakeup() == round(2.7 * SECOND)


@pytest.mark.parametrize("period", [0.0, -1.0])
def test_a_period_that_is_none_is_refused(period):
    lab = Lab()
    sensor = Thermometer(lab.clock)
    sensor.period_s = period
    with pytest.raises(RuleError, match="period"):
        lab.engine.add_sensor(sensor)


# Several engines


def test_engines_that_share_rules_share_no_state():
    class Count(do):
        calls = 0

        def execute(self, *what):
            self.calls += 1
            super().execute(self.calls, self.engine.name, *what)

    rules = [go(X) >> [Count(X), +p(X), wait(1), Count(X)], +p(X) / (p(X) & (lambda X: X > 0)) >> [do("p", X)]]
    labs = [Lab(*rules, name=name) for name in ("one", "two")]
    labs[0].tell(go(1))
    labs[1].tell(go(2))
    for lab in labs:
        lab.until(1)
    assert labs[0].done == [(1, "one", 1), ("p", 1), (1, "one", 1)]
    assert labs[1].done == [(1, "two", 2), ("p", 2), (1, "two", 2)]
    assert [lab.beliefs for lab in labs] == [["p(1)"], ["p(2)"]]
    assert not hasattr(rules[0].body[0], "engine")


def test_engines_have_beliefs_of_their_own():
    first, second = Engine("a", ManualClock()), Engine("b", ManualClock())
    first.believe(p(1))
    first.run_until_idle()
    second.run_until_idle()
    assert len(list(first.beliefs)) == 1
    assert list(second.beliefs) == []


def test_a_crash_in_one_intention_leaves_the_others_alone():
    lab = Lab(go(X) >> [do(X), crash(), do("never")], +p(X) >> [do(X), do(X), do(X)])
    lab.tell(+p("p"), go("g"))
    assert sorted(lab.done) == ["g", "p", "p", "p"]


# The public interface

API = {
    "achieve", "actions", "add_action", "add_rules", "add_sensor", "add_text", "attempt", "beliefs", "believe", "call",
    "clock", "compile_plans", "forget", "intentions", "interpreter", "library", "messaging", "mind", "name",
    "next_wakeup", "out", "perceive", "query", "random", "remove_plan", "robot", "run", "run_until_idle", "stop",
    "timers", "trace", "wake", "why_not",
}  # fmt: skip


def test_the_engine_has_only_the_names_of_its_api():
    assert {name for name in dir(Engine) if not name.startswith("_")} == API


@pytest.fixture
def compiled(monkeypatch):
    """The units that were compiled."""
    units, build = [], Unit.build
    monkeypatch.setattr(Unit, "build", lambda unit: (units.append(unit.title), build(unit))[1])
    return units


def test_the_first_event_compiles_nothing_after_compile_plans(compiled):
    lab = Lab(
        q(X) << (p(X) & (X > 1)),
        +p(X) / (q(X) & ~mood("sad") & (X > 5)) >> [do("large", X)],
        +p(X) / q(X) >> [go(X, Y), do(Y), ask(q(_)), wait(1), sub(X)],
        go(X, Y) / (X > 5) >> [],
        go(X, Y) / q(Y) >> [],
        sub(X) >> [crash()],
        -sub(X) >> [do("failed")],
    )
    lab.engine.compile_plans()
    assert len(compiled) > 7
    compiled.clear()
    lab.tell(+p(2))
    lab.until(2)
    assert lab.done == [2, "failed"]
    assert compiled == []


def test_the_first_belief_searches_no_rules_after_compile_plans(monkeypatch):
    searches, search = [], library.beliefs_by_name
    monkeypatch.setattr(library, "beliefs_by_name", lambda rules: (searches.append(rules), search(rules))[1])
    lab = Lab(+mood(X) / ~p(X) >> [do(X)])
    lab.engine.compile_plans()
    assert len(searches) == 1
    lab.tell(+mood("sad"))
    assert lab.done == ["sad"]
    assert len(searches) == 1


def test_plans_that_are_added_later_are_compiled_at_their_first_event(compiled):
    lab = Lab(+p(X) >> [do(X)])
    lab.engine.compile_plans()
    lab.engine.add_rules(+ping(X) >> [do(X)])
    compiled.clear()
    lab.tell(+ping(1), +ping(2), +p(3))
    assert lab.done == [1, 2, 3]
    assert len(compiled) == 1


def test_the_text_of_a_deep_intention_is_short():
    lab = Lab(go(X) / (X > 0) >> [go(X - 1), do(X)], go(0) >> [wait(1)])
    lab.tell(go(1000))
    (intention,) = lab.engine.intentions
    assert str(intention).startswith("go(0) < go(X) < go(X) < ")
    assert "994 more < go(X)" in str(intention)
