from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from socialbot.bdi import Goal, Inference, Plan, apart, ask, wait, wait_for
from socialbot.bdi.literals import Change, Event, Literal
from socialbot.bdi.society import Society
from socialbot.bdi.steps import Do, For, Forget, If, Update, While
from socialbot.bdi.terms import conjunction
from socialbot.core.clock import SECOND
from tests.bdi.lab import Lab, X, Y, Z, crash, do, go, mood, nap, p, ping, q, sub
from tests.bdi.programs import PROGRAMS, RULES, SOCIAL_PROGRAMS, SOCIAL_STIMULI, STIMULI, can_be_spoken, spoken
from tests.bdi.reference import Reference

TURNS = 80
SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]


class Speaking(Lab):
    """A lab whose program was printed as AgentSpeak and read again."""

    def __init__(self, program: list[Plan]) -> None:
        super().__init__()
        for kind in (mood, ping):
            self.engine.library.declare(kind)
        for action in (do, crash, nap):
            self.engine.add_action(action)
        for plan in spoken(program):
            self.engine.add_rules(plan)


class Both:
    """The engine and the reference, given the same program and the same stimuli."""

    def __init__(self, program: list[Plan], lab: Lab | None = None) -> None:
        self.lab = Lab(*program) if lab is None else lab
        self.reference = Reference(program)

    def post(self, what: str, literal: Literal) -> None:
        getattr(self.lab.engine, what)(literal)
        getattr(self.reference, what)(literal)

    def settle(self) -> bool:
        """Lets both deal with what was posted; False for a program without end, which they follow differently far."""
        left = self.lab.engine.run_until_idle(TURNS)
        for _ in range(4 * TURNS):
            self.reference.turn()
        both = self.done, self.reference.done
        common = min(map(len, both))
        assert both[0][:common] == both[1][:common]
        if left or self.reference.busy():
            return False
        assert both[0] == both[1]
        assert self.believed() == self.reference.believed()
        return True

    def advance(self, seconds: int) -> None:
        self.lab.clock.advance(seconds)
        self.reference.now += seconds

    @property
    def done(self) -> list[tuple[object, ...]]:
        return [what if isinstance(what, tuple) else (what,) for what in self.lab.done]

    def believed(self) -> dict[str, list[tuple[tuple[object, ...], tuple[str, ...]]]]:
        found: dict[str, list[tuple[tuple[object, ...], tuple[str, ...]]]] = {}
        for held in self.lab.engine.beliefs:
            found.setdefault(held.belief.key, []).append((held.belief.args, held.sources))
        return found


class unused(Goal):  # noqa: N801 - a goal like those of the lab
    """A goal that nobody has."""


class Social(Both):
    """Both in the company of other agents: messages come from ``bob`` and ``eve``, and go to ``bob``."""

    def __init__(self, program: list[Plan], rules: tuple[Inference, ...]) -> None:
        super().__init__(program)
        # A plan makes the class of a belief known to the engine, in case it is only told.
        self.lab.engine.add_rules(*rules, unused() / mood(0) >> [do("never")])
        self.reference.rules = rules
        self.society = Society(self.lab.clock)
        self.others = {name: self.society.add(Lab(name=name).engine) for name in ("bob", "eve")}
        self.society.add(self.lab.engine)

    def told(self, performative: str, literal: Literal, sender: str) -> None:
        self.others[sender].messaging.send("lab", performative, literal)
        self.reference.told(sender, performative, literal)

    def settle(self) -> bool:
        settled = super().settle()
        if settled:
            self.others["bob"].run_until_idle()
            heard = {(held.belief.key, held.belief.args) for held in self.others["bob"].beliefs}
            assert heard == set(self.reference.sent)
        return settled


def compare(both: Both, stimuli) -> None:
    for what, value, *sender in [*stimuli, ("seconds", 2), ("seconds", 2), ("seconds", 0)]:
        if sender:
            assert isinstance(both, Social)
            both.told(what, value, *sender)
        elif isinstance(value, Literal):
            both.post(what, value)
        elif both.settle():
            both.advance(value)
        else:
            return


@settings(deadline=None, max_examples=75, suppress_health_check=SLOW)
@given(PROGRAMS, STIMULI)
def test_engine_matches_reference(program, stimuli):
    compare(Both(program), stimuli)
    if can_be_spoken(program):
        compare(Both(program, Speaking(program)), stimuli)


@pytest.mark.parametrize(
    "block",
    [
        If(p(0), (), (Do(do("in", X)),)),
        If(p(0), (Do(do("in", X)),), (Do(do("not", X)), Do(do("in", X)))),
        For(q(Y, Z), (Do(do("in", Y)),)),
        While(q(0, Z), (Forget(q(0, Z)), Do(do("in", X)))),
    ],
    ids=lambda block: type(block).__name__,
)
def test_a_step_in_a_block_takes_one_turn_like_any_other(block):
    walk = (Do(do("a", X)), block, Do(do("b", X)), Do(do("c", X)), Do(do("d", X)))
    clock = Plan(+ping(0), conjunction(), (Do(do("tick")), Do(do("tock")), Update("++", ping(0))))
    both = Both([Plan(Event(Change.WANTED, go(X)), conjunction(), walk), clock])
    compare(
        both, [("believe", q(0, 0)), ("believe", q(1, 1)), ("achieve", go(0)), ("achieve", go(1)), ("believe", ping(0))]
    )


@settings(deadline=None, max_examples=75, suppress_health_check=SLOW)
@given(SOCIAL_PROGRAMS, RULES, SOCIAL_STIMULI)
def test_waits_rules_annotations_and_messages_match_the_reference(program, rules, stimuli):
    compare(Social(program, rules), stimuli)


@pytest.mark.slow
@settings(deadline=None, max_examples=5000, suppress_health_check=SLOW)
@given(SOCIAL_PROGRAMS, RULES, SOCIAL_STIMULI)
def test_waits_rules_annotations_and_messages_match_the_reference_in_many_cases(program, rules, stimuli):
    compare(Social(program, rules), stimuli)


@pytest.mark.slow
@settings(deadline=None, max_examples=5000, suppress_health_check=SLOW)
@given(PROGRAMS, STIMULI)
def test_engine_matches_reference_in_many_cases(program, stimuli):
    compare(Both(program), stimuli)
    if can_be_spoken(program):
        compare(Both(program, Speaking(program)), stimuli)


def test_the_reference_handles_failures_as_a_person_would_tell_it():
    program = [
        +p(X) / q(X, Y) >> [go(X), do("b", 0)],
        go(X) >> [sub(1, X), do("a", 9)],
        -go(X) >> [do("a", 0)],
    ]
    both = Both(program)
    for belief in (q(1, 0), p(0), p(1)):
        both.post("believe", belief)
    assert both.settle()
    assert both.done == both.reference.done == [("a", 0), ("b", 0)]


def test_the_first_steps_of_a_failure_plan_are_a_turn_as_in_the_reference():
    program = [
        go(0) >> [do("go")],
        sub(0, 0) / p(0) >> [do("sub")],
        +p(0) >> [do("+p")],
        -sub(0, 0) >> [do("f"), apart(go(0)), Update("+", p(0))],
    ]
    both = Both(program)
    both.post("achieve", sub(0, 0))
    assert both.settle()
    assert both.done == [("f",), ("go",), ("+p",)]


def test_an_intention_that_waited_for_an_event_precedes_the_second_step_of_its_plan_as_in_the_reference():
    program = [
        +p(X) >> [Update("++", q(X, 0)), do("first"), do("second")],
        +q(X, Y) >> [do("event")],
        go(0) >> [wait_for(+p(1)), do("woken")],
    ]
    both = Both(program)
    both.post("achieve", go(0))
    assert both.settle()
    both.post("believe", p(1))
    assert both.settle()
    assert both.done == [("woken",), ("first",), ("event",), ("second",)]


@pytest.mark.parametrize("later", [go(2), sub(2, 0)], ids=["limit", "time"])
@pytest.mark.parametrize("swapped", [False, True])
def test_waits_that_end_at_the_same_time_take_turns_as_in_the_reference(later, swapped):
    program = [
        go(X) >> [wait_for(+p(X), 2)],
        -go(X) >> [do("first", X), do("second", X), do("third", X)],
        sub(X, Y) >> [nap(2), do("first", X), do("second", X)],
    ]
    both = Both(program)
    for goal in (later, go(1)) if swapped else (go(1), later):
        both.post("achieve", goal)
    assert both.settle()
    both.advance(2)
    assert both.settle()
    assert {what for what, _ in both.done[:2]} == {"first"}


def test_plans_of_queued_events_take_turns_as_in_the_reference():
    program = [
        +p(X) / (X < 2) >> [Update("-", p(X)), do(X), do("end", X)],
        +p(X) >> [do(X), Forget(p(X))],
        -p(X) >> [do("gone", X)],
    ]
    both = Both(program)
    for number in range(3):
        both.post("believe", p(number))
    assert both.settle()
    assert len(both.done) == 8


def test_a_goal_binds_variables_as_in_the_reference():
    program = [go(X) >> [sub(X, Y), do(Y), Update("+", p(Y)), do("end")], sub(X, Y) / q(X, Y) >> [], +p(X) >> [do("p")]]
    both = Both(program)
    for belief in (q(0, 1), q(0, 2), q(1, 3)):
        both.post("believe", belief)
    both.post("achieve", go(0))
    assert both.settle()
    assert both.reference.done == [(2,), ("p",), ("end",)]


def test_a_failure_plan_sees_what_head_and_context_gave_as_in_the_reference():
    program = [
        go(X) >> [sub(X, Y), do("after")],
        sub(0, Z) / q(0, Z) >> [crash()],
        sub(1, Z) >> [ask(q(0, Z)), crash()],
        -sub(X, Z) / p(Z) >> [do("failed", X, Z)],
    ]
    both = Both(program)
    for belief in (q(0, 1), p(2), p(1)):
        both.post("believe", belief)
    both.post("achieve", go(0))
    both.post("achieve", go(1))
    assert both.settle()
    assert both.done == [("failed", 0, 1), ("after",), ("failed", 1, 1), ("after",)]


def test_a_separate_goal_with_a_variable_starts_in_the_next_turn_like_any_other():
    program = [
        sub(X, Y) >> [do("sub"), apart(go(X)), crash()],
        -go(0) >> [do("failed"), sub(X, X)],
        go(0) / p(0) >> [do("go")],
    ]
    social = Social(program, ())
    social.told("achieve", go(0), "eve")
    compare(social, [("achieve", sub(0, 1))])
    assert len(social.reference.done) > TURNS


@pytest.mark.parametrize("told_before", [0, 1, 2])
def test_the_plan_for_a_told_goal_has_a_step_in_its_turn(told_before):
    program = [go(0) >> [do("go"), apart(go(0)), do("end")], +p(X) >> [do("p")]]
    social = Social(program, ())
    for number in range(told_before):
        social.told("tell", p(number), "bob")
    compare(social, [("achieve", go(0), "bob")])
    assert social.done[told_before : told_before + 3] == [("go",), ("end",), ("go",)]


def test_a_plan_for_a_message_shares_the_turns_with_what_was_posted_after_it():
    program = [go(0) >> [do("go"), do("end")], +q(X, Y) >> [do("q"), ask(p(1))]]
    social = Social(program, ())
    social.told("tell", q(0, 0), "eve")
    compare(social, [("achieve", go(0)), ("believe", q(0, 0)), ("believe", q(0, 1))])
    assert social.done[0] == ("q",)
    assert social.done.count(("q",)) == 3


def test_the_clocks_of_both_agree():
    both = Both([go(0) >> [nap(2), do("a", 1)]])
    both.post("achieve", go(0))
    assert both.settle()
    assert both.done == []
    both.advance(2)
    assert both.settle()
    assert both.done == both.reference.done == [("a", 1)]
    assert both.lab.clock.now() == 2 * SECOND


@settings(deadline=None, max_examples=50, suppress_health_check=SLOW)
@given(PROGRAMS, STIMULI, st.integers(1, 5))
def test_thinking_in_small_portions_changes_nothing(program, stimuli, portion):
    whole, portions = Both(program), Both(program)
    for what, value in stimuli:
        if isinstance(value, Literal):
            whole.post(what, value)
            portions.post(what, value)
    whole.lab.engine.run_until_idle(budget=20 * portion)
    for _ in range(20):
        portions.lab.engine.run_until_idle(budget=portion)
    assert whole.lab.trace == portions.lab.trace


def test_a_nap_is_a_wait():
    labs = [Lab(go() >> [step, do("end")]) for step in (wait(1), nap(1))]
    for lab in labs:
        lab.tell(go())
        lab.until(2)
    assert labs[0].timeline == labs[1].timeline == [(1, "end")]
