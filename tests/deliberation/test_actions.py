"""Actions of plans that advance bit by bit."""
# ruff: noqa: N801 - actions are written as plans write them

from __future__ import annotations

import math
from typing import Any

import pytest

from socialbot.bdi import Atom, Engine, Trace
from socialbot.bdi.literals import literal
from socialbot.core.clock import SECOND, ManualClock
from socialbot.deliberation.actions import PlanAction, progress_of, register
from socialbot.testing import run_engine


class Carrier:
    """Robot of the actions below."""

    def __init__(self):
        self.log = []


class carry(PlanAction):
    rate_hz = 4.0

    def begin(self, *args):
        self.agent.log.append(("begin", args))

    def advance(self):
        self.agent.log.append(("advance", self.engine.clock.now() / SECOND, self.args))
        return self.progress_made + 0.25


class Lab:
    def __init__(self, *kinds, name="", parameters=2):
        self.clock = ManualClock()
        self.carrier = Carrier()
        self.trace = Trace()
        self.engine = Engine("lab", self.clock, robot=self.carrier, sink=self.trace)
        self.ends = []
        self.intention: Any = None
        for kind in kinds:
            register(self.engine, kind, parameters, name)

    def attempt(self, name, *args):
        goal = literal(name, tuple(map(Atom, args)))
        self.engine.call(lambda: setattr(self, "intention", self.engine.attempt(goal, self.ends.append)))
        self.engine.run_until_idle()

    def drop(self):
        self.engine.call(lambda: self.engine.intentions.drop(self.intention, lambda: self.ends.append("stopped")))
        self.engine.run_until_idle()

    def until(self, seconds):
        run_engine(self.engine, seconds - self.clock.now() / SECOND)


def ended(lab):
    return [record.detail for record in lab.trace.find("action_end")]


def test_an_action_advances_at_its_rate_until_its_progress_is_one():
    lab = Lab(carry)
    lab.attempt("carry", "a", "b")
    lab.until(5)
    assert lab.carrier.log == [("begin", ("a", "b")), *(("advance", n / 4, ("a", "b")) for n in (1, 2, 3, 4))]
    assert lab.ends == [None]
    assert lab.engine.next_wakeup() is None


def test_an_action_may_have_another_name_than_its_class():
    lab = Lab(carry, name="carrier-move")
    lab.attempt("carrier-move", "a", "b")
    lab.until(1)
    assert lab.ends == [None]


def test_a_plan_in_agentspeak_may_use_it_like_any_action():
    lab = Lab()
    lab.engine.add_action(carry)
    lab.engine.add_text("+!haul(X, Y) <- carry(X, Y); carry(Y, X).")
    lab.attempt("haul", "a", "b")
    lab.until(3)
    assert [what for what in lab.carrier.log if what[0] == "begin"] == [("begin", ("a", "b")), ("begin", ("b", "a"))]
    assert lab.ends == [None]


def test_its_progress_is_reported_while_it_runs():
    lab = Lab(carry)
    lab.attempt("carry", "a", "b")
    lab.until(0.5)
    assert progress_of(lab.intention) == 0.5
    assert [record.detail["fraction"] for record in lab.trace.find("progress")] == [0.25, 0.5]
    lab.until(1)
    assert progress_of(lab.intention) is None


def test_steps_that_are_no_plan_action_have_no_progress():
    lab = Lab()
    lab.engine.add_text("+!rest(X) <- .wait(2000).")
    lab.attempt("rest", "a")
    assert progress_of(lab.intention) is None


def test_unchanged_progress_is_reported_once_and_within_range():
    class creep(PlanAction):
        values = iter([-3, 0.5, 0.5, 7])

        def advance(self):
            return next(self.values)

    lab = Lab(creep, parameters=0)
    lab.attempt("creep")
    lab.until(5)
    assert [record.detail["fraction"] for record in lab.trace.find("progress")] == [0.5]
    assert lab.ends == [None]


def failing(action):
    lab = Lab(action, parameters=0)
    lab.attempt(action.__name__)
    lab.until(5)
    (end,) = lab.ends
    assert lab.engine.next_wakeup() is None
    return end


def test_an_action_that_failed_with_a_reason_stops_advancing():
    class slip(PlanAction):
        times = 0

        def advance(self):
            type(self).times += 1
            self.fail("the floor is wet")
            return 0.5

    end = failing(slip)
    assert (end.reason, end.message) == ("action_failed", "the floor is wet")
    assert slip.times == 1


def test_an_action_that_fails_at_its_start_never_advances():
    class refuse(PlanAction):
        def begin(self, *args):
            self.fail("not today")

        def advance(self):
            raise AssertionError("it must not be called")

    assert failing(refuse).message == "not today"


def test_an_exception_in_begin_or_advance_fails_it():
    class stumble(PlanAction):
        def begin(self, *args):
            raise ValueError("no legs")

    class tumble(PlanAction):
        def advance(self):
            raise ValueError("no arms")

    assert "no legs" in failing(stumble).message
    assert "no arms" in failing(tumble).message


@pytest.mark.parametrize("made", [None, "far", math.nan])
def test_invalid_progress_fails_the_action(made):
    class babble(PlanAction):
        def advance(self):
            return made

    assert failing(babble).reason == "exception"


def test_an_unimplemented_action_fails_with_the_remedy():
    class idle(PlanAction): ...

    assert "override advance()" in failing(idle).message


def test_a_rate_has_to_be_above_zero():
    class frozen(PlanAction):
        rate_hz = 0.0

    assert "must be > 0" in failing(frozen).message


def test_an_action_that_reports_its_end_stops_advancing():
    class know(PlanAction):
        times = 0

        def advance(self):
            type(self).times += 1
            self.done()
            return 0.1

    assert failing(know) is None
    assert know.times == 1


def test_one_that_is_given_up_stops_at_once():
    lab = Lab(carry)
    lab.attempt("carry", "a", "b")
    lab.until(0.5)
    lab.drop()
    lab.until(5)
    assert lab.ends[-1] == "stopped"
    assert len(lab.carrier.log) == 3
    assert ended(lab) == [{"outcome": "cancelled"}]


def test_one_that_is_given_up_may_take_its_time_to_stop():
    class drive(carry):
        def stop(self):
            self.agent.log.append("brakes")
            self.engine.timers.after(1.5, self.stopped)

    lab = Lab(drive)
    lab.attempt("drive", "a", "b")
    lab.until(0.25)
    lab.drop()
    lab.until(1.7)
    assert (lab.ends, lab.carrier.log[-1]) == ([], "brakes")
    lab.until(2)
    assert lab.ends[-1] == "stopped"


def test_an_exception_in_stop_does_not_block_the_plan():
    class mad(carry):
        def stop(self):
            raise ValueError("never")

    lab = Lab(mad)
    lab.attempt("mad", "a", "b")
    lab.drop()
    assert lab.ends[-1] == "stopped"
    assert "never" in str([record.detail for record in lab.trace.find("failure")])


def test_missed_steps_are_not_repeated_after_a_pause():
    lab = Lab(carry)
    lab.attempt("carry", "a", "b")
    lab.clock.set(10 * SECOND)
    lab.engine.run_until_idle()
    assert len(lab.carrier.log) == 2
    lab.until(12)
    assert lab.ends == [None]
