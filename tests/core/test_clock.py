"""Clocks advance evenly despite changes of the system clock."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import pytest

from socialbot.bdi import Action, Engine, wait
from socialbot.core.clock import EPOCH_VARIABLE, SECOND, ForwardClock, SteadyStamps, WallClock
from tests.bdi.lab import go, p


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A computer whose clock may be set: by how much (ns) it was."""
    real, offset = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: real() + offset[0])
    monkeypatch.delenv(EPOCH_VARIABLE, raising=False)
    return offset


@pytest.mark.parametrize("seconds", [-3600, -2, 2, 3600])
def test_a_change_of_the_clock_does_not_affect_earlier_waits(computer, seconds):
    clock = WallClock()
    before = clock.now()
    assert abs(before - time.time_ns()) < SECOND
    computer[0] = seconds * SECOND
    assert 0 <= clock.now() - before < SECOND
    assert clock.behind_s == pytest.approx(seconds, abs=0.5)


@pytest.mark.parametrize("seconds", [-3600, 3600])
def test_waits_of_an_agent_end_in_time_despite_clock_changes(computer, seconds):
    """A belief held for 0.3 s and a wait of 0.6 s; the system clock is set after 0.1 s."""
    happened: list[tuple[str, float]] = []

    class note(Action):  # noqa: N801 - reads as a step of a plan
        def execute(self, what: str) -> None:
            happened.append((what, time.monotonic() - begun))
            if len(happened) == 2:
                self.engine.stop()

    engine = Engine("ann", WallClock())
    engine.add_rules(
        +p(1).held_for(0.3) >> [note("held")],
        go(1) >> [wait(0.6), note("rested")],
    )
    begun = time.monotonic()
    engine.believe(p(1))
    engine.achieve(go(1))
    steps = [threading.Timer(0.1, computer.__setitem__, (0, seconds * SECOND)), threading.Timer(30.0, engine.stop)]
    for step in steps:
        step.start()
    engine.run()
    steps[-1].cancel()
    assert [what for what, _ in happened] == ["held", "rested"]
    assert happened[0][1] >= 0.3
    assert happened[1][1] >= 0.6


def test_processes_of_one_run_tell_the_same_time_though_the_clock_was_set_in_between(computer):
    computer[0] = 3600 * SECOND
    ours = WallClock()
    ask = [sys.executable, "-c", "from socialbot.core.clock import WallClock; print(WallClock().now())"]
    theirs = int(subprocess.run(ask, capture_output=True, check=True, timeout=60).stdout)
    assert ours.now() - 60 * SECOND < theirs <= ours.now()


def test_simulated_time_continues_after_a_jump_back():
    told = iter([10, 12, 2, 3, 1, 5])
    clock = ForwardClock(lambda: next(told))
    assert [clock.now() for _ in range(6)] == [10, 12, 12, 13, 13, 17]


@pytest.mark.parametrize("leap_s", [-3600.0, -1.0, -0.3, 3600.0, 8.0])
def test_stamps_go_on_where_the_clock_of_the_sender_is_set(leap_s):
    steady = SteadyStamps()
    found = [steady.at(n * SECOND // 5 + round(leap_s * SECOND) * (n >= 7), n * SECOND // 5) for n in range(20)]
    assert found == [n * SECOND // 5 for n in range(20)]


def test_stamps_of_messages_that_waited_are_kept():
    """A link stands still for three seconds; the messages of that time arrive at once, or are lost."""
    steady = SteadyStamps()
    for stamp, now in ((0, 0), (1, 1), (2, 5), (3, 5), (6, 6), (7, 7)):
        assert steady.at(stamp * SECOND, now * SECOND) == stamp * SECOND
    steady = SteadyStamps(late_s=1.0)
    for tenth in (0, 5, 3, 6, 20, 11, 21):
        assert steady.at(tenth * SECOND // 10, SECOND) == tenth * SECOND // 10
