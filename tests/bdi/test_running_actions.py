"""Actions that take their time, and are given up."""
# ruff: noqa: N801 - actions are written as agents write them

from __future__ import annotations

from typing import Any

import pytest

from socialbot.bdi import LongAction, error, first_of, together, wait
from socialbot.bdi.intentions import PlanFailed
from socialbot.bdi.terms import Atom, Variable
from tests.bdi.lab import Lab, X, deep, do, ends, go, p, sub

E = Variable("E")


class Workshop(Lab):
    """A lab that remembers the action that is kept going, and how often it was asked to stop."""

    kept: Any
    asked = 0


class drive(LongAction):
    """Drives for some seconds of simulated time; stops in half a second when asked to."""

    brakes_s = 0.5
    stopped = 0

    def start(self, seconds: float) -> None:
        self.engine.robot.note(f"drive {seconds}")
        self.engine.timers.after(seconds, self.done)

    def cancel(self) -> None:
        self.engine.robot.note("brake")
        self.engine.timers.after(self.brakes_s, self._stop)

    def _stop(self) -> None:
        self.engine.robot.note("stopped")
        self.cancelled()


class kept(LongAction):
    """Only begins; the test does the rest."""

    made: list[kept]

    def start(self) -> None:
        self.engine.robot.kept = self

    def cancel(self) -> None:
        self.engine.robot.asked = getattr(self.engine.robot, "asked", 0) + 1


class plain(LongAction):
    def start(self) -> None: ...


class TestLongActions:
    def test_the_plan_continues_after_the_action_and_others_run_meanwhile(self):
        lab = Workshop(go() >> [drive(2), do("there")], sub() >> [wait(1), do("other")])
        lab.tell(go(), sub())
        lab.until(5)
        assert lab.timeline == [(0, "drive 2"), (1, "other"), (2, "there")]
        assert ends(lab) == [("drive(2)", "finished")]

    def test_two_runs_in_simulated_time_are_the_same(self):
        def run() -> tuple[object, str]:
            lab = Workshop(
                go() >> [first_of([drive(2)], [drive(1)], [wait(3)]), do("one")],
                sub() >> [together([drive(1)], [drive(1), drive(1)]), do("all")],
            )
            lab.tell(go(), sub())
            lab.until(9)
            return lab.timeline, repr(lab.trace)

        assert run() == run()
        assert [what for _, what in run()[0]][-2:] == ["one", "all"]  # type: ignore[index]

    def test_its_progress_is_on_the_trace_with_its_time_and_nowhere_else(self):
        lab = Workshop(go() >> [kept(), do("done")])
        lab.tell(go())
        lab.clock.advance(1)
        lab.kept.progress(0.25, "a quarter")
        lab.kept.progress(7)
        assert not lab.engine.run_until_idle()
        records = [record for record in lab.trace if record.kind == "progress"]
        begun = next(record for record in lab.trace if record.kind == "action")
        assert [(record.time, record.what, record.cause) for record in records] == [
            (1_000_000_000, "kept()", begun.id)
        ] * 2
        assert [record.detail for record in records] == [
            {"fraction": 0.25, "text": "a quarter"}, {"fraction": 1.0, "text": ""},
        ]  # fmt: skip
        assert lab.done == []
        assert "100%" in str(next(iter(lab.engine.intentions)))

    def test_the_record_of_its_end_has_the_action_as_cause(self):
        lab = Workshop(go() >> [drive(1)])
        lab.tell(go())
        lab.until(2)
        begun = next(record for record in lab.trace if record.kind == "action")
        ended = next(record for record in lab.trace if record.kind == "action_end")
        assert (ended.cause, ended.time) == (begun.id, 1_000_000_000)

    @pytest.mark.parametrize(
        ("said", "reason"),
        [("no way", "action_failed"), (PlanFailed("no way"), "action_failed"), (OSError("no way"), "exception")],
        ids=repr,
    )
    def test_its_failure_is_one_of_the_goal(self, said, reason):
        lab = Workshop(go() >> [kept(), do("done")], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.kept.failed(said)
        lab.engine.run_until_idle()
        assert lab.done == [Atom(reason)]
        assert ends(lab) == [("kept()", "failed")]

    def test_an_exception_at_its_start_is_a_failure(self):
        class broken(LongAction):
            def start(self):
                raise ValueError("broken")

        for body in ([broken(), do("done")], [broken().within(1), do("done")]):
            lab = Workshop(go() >> body, -go() >> [do("failed")])
            lab.tell(go())
            lab.until(3)
            assert lab.done == ["failed"]
            assert ends(lab) == [("broken()", "failed")]

    def test_action_without_start_fails_with_a_remedy(self):
        lab = Workshop(go() >> [LongAction()])
        lab.tell(go())
        assert any("override start()" in str(record.detail.get("message")) for record in lab.trace)

    def test_done_within_start_ends_the_action(self):
        class quick(LongAction):
            def start(self):
                self.progress(1)
                self.done()

        lab = Workshop(go() >> [quick(), do("done")])
        lab.tell(go())
        assert lab.done == ["done"]

    def test_reports_after_the_end_have_no_effect(self):
        lab = Workshop(go() >> [kept(), kept(), do("done")])
        lab.tell(go())
        first = lab.kept
        for say in (first.done, first.done, first.failed, first.cancelled, lambda: first.progress(1)):
            say()
        lab.engine.run_until_idle()
        assert lab.kept is not first
        assert (lab.done, ends(lab)) == ([], [("kept()", "finished")])
        assert lab.kinds("progress") == []

    def test_unrequested_cancellation_is_a_failure(self):
        lab = Workshop(go() >> [kept()], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.kept.cancelled()
        lab.engine.run_until_idle()
        assert lab.done == [Atom("cancelled")]


class TestGivingUp:
    @pytest.mark.parametrize(
        "rules",
        [
            [go() >> [drive(9).within(2), do("there")]],
            [go() >> [sub().within(2), do("there")], sub() >> [drive(9)]],
            [go() >> [sub().within(2), do("there")], sub() >> [deep(), do("deep")], deep() >> [drive(9)]],
            [go() >> [deep().within(2)], deep() >> [together([drive(9)], [wait(1)])]],
        ],
        ids=["action", "goal", "goal of a goal", "branch"],
    )
    def test_a_failure_plan_runs_when_the_action_has_stopped(self, rules):
        lab = Workshop(*rules, -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.until(20)
        assert lab.timeline == [(0, "drive 9"), (2, "brake"), (2.5, "stopped"), (2.5, Atom("timeout"))]
        assert ends(lab) == [("drive(9)", "cancelled")]

    def test_an_action_in_time_has_no_limit_later(self):
        lab = Workshop(go() >> [drive(1).within(2), drive(4), do("there")])
        lab.tell(go())
        lab.until(20)
        assert lab.timeline == [(0, "drive 1"), (1, "drive 4"), (5, "there")]

    def test_a_branch_that_loses_is_waited_for(self):
        lab = Workshop(go() >> [first_of([drive(9), do("never")], [wait(1)]), do("after")])
        lab.tell(go())
        lab.until(20)
        assert lab.timeline == [(0, "drive 9"), (1, "brake"), (1.5, "stopped"), (1.5, "after")]

    def test_a_dropped_intention_is_gone_when_the_action_has_stopped(self):
        lab = Workshop(go() >> [drive(9), do("never")])
        lab.tell(go())
        gone: list[float] = []
        lab.engine.call(
            lambda: lab.engine.intentions.drop(
                next(iter(lab.engine.intentions)), lambda: gone.append(lab.clock.now() / 1e9)
            )
        )
        lab.until(20)
        assert lab.done == ["drive 9", "brake", "stopped"]
        assert gone == [0.5]
        assert lab.kinds("dropped") == ["intention"]

    def test_without_a_cancel_of_its_own_it_stops_at_once(self):
        lab = Workshop(go() >> [first_of([plain()], [wait(1)]), do("after")])
        lab.tell(go())
        lab.until(1)
        assert lab.timeline == [(1, "after")]
        assert ends(lab) == [("plain()", "cancelled")]

    def test_it_is_asked_to_stop_once_however_often_it_is_given_up(self):
        lab = Workshop(
            go() >> [sub().within(4), do("no")],
            -go() >> [do("outer")],
            sub() >> [deep().within(3)],
            -sub() >> [do("inner")],
            deep() >> [kept().within(2)],
            -deep() >> [do("innermost")],
        )
        lab.tell(go())
        lab.until(10)
        assert lab.asked == 1
        assert lab.done == []
        assert "is asked to stop" in str(next(iter(lab.engine.intentions)))
        lab.kept.cancelled()
        lab.engine.run_until_idle()
        # The goal that was given up last has failed; what lies within it is not taken up any more.
        assert lab.done == ["inner", "no"]
        assert lab.engine.mind().intentions == ()

    def test_a_drop_outranks_a_time_limit_that_waits(self):
        lab = Workshop(go() >> [kept().within(1)], -go() >> [do("failed")])
        lab.tell(go())
        lab.until(2)
        gone: list[bool] = []
        lab.engine.intentions.drop(next(iter(lab.engine.intentions)), lambda: gone.append(True))
        assert gone == []
        lab.kept.cancelled()
        lab.engine.run_until_idle()
        assert (gone, lab.done, lab.asked) == ([True], [], 1)

    def test_branches_that_are_given_up_twice_are_waited_for_once(self):
        lab = Workshop(go() >> [sub().within(2)], -go() >> [do("failed")], sub() >> [first_of([kept()], [wait(1)])])
        lab.tell(go())
        lab.until(5)
        assert lab.done == []
        lab.kept.cancelled()
        lab.engine.run_until_idle()
        assert lab.done == ["failed"]
        assert lab.asked == 1

    @pytest.mark.parametrize("word", ["done", "failed"])
    def test_it_may_end_in_another_way_when_asked_to_stop(self, word):
        lab = Workshop(go() >> [kept().within(1), do("no")], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.until(2)
        getattr(lab.kept, word)()
        lab.engine.run_until_idle()
        assert lab.done == [Atom("timeout")]

    def test_failing_cancel_does_not_block_the_agent(self):
        class stubborn(LongAction):
            def start(self): ...

            def cancel(self):
                raise OSError("no")

        lab = Workshop(go() >> [stubborn().within(1)], -go()[error(E)] >> [do(E)])
        lab.tell(go())
        lab.until(2)
        assert lab.done == [Atom("timeout")]
        assert "stubborn()" in lab.kinds("failure")

    def test_end_of_an_action_resumes_an_atomic_plan(self):
        from socialbot.bdi import atomic

        lab = Workshop(*atomic(go() >> [drive(2), do("there")]), +p(X) >> [do("p")])
        lab.tell(go())
        lab.tell(+p(1))
        lab.until(3)
        assert lab.timeline == [(0, "drive 2"), (2, "there"), (2, "p")]
