"""Watch over the thread of an observer."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge.environment import BLOCKED_S
from socialbot.bridge.graph_observer import SpinWatch

pytestmark = pytest.mark.ros


class Time:
    """Steady clock, and the timers of a node that the tests call."""

    def __init__(self) -> None:
        self.now = 100.0
        self.timers: list[Callable[[], None]] = []
        ros = SimpleNamespace(create_timer=lambda period_s, callback, clock: self.timers.append(callback))
        self.watch = SpinWatch(ros, lambda: self.now)

    def passes(self, seconds: float, step_s: float, *, spins: bool = False) -> bool:
        """Check now and then; return whether the thread is blocked in the end."""
        blocked: Any = None
        for _ in range(round(seconds / step_s)):
            self.now += step_s
            if spins:
                self.timers[0]()
            blocked = self.watch.is_blocked()
        return bool(blocked)


def test_a_thread_that_does_not_answer_for_long_is_blocked() -> None:
    time = Time()
    assert not time.passes(3 * BLOCKED_S, 0.5, spins=True)
    assert not time.passes(BLOCKED_S - 1.0, 0.5)
    assert time.passes(2.0, 0.5)


def test_an_answer_begins_anew() -> None:
    time = Time()
    assert not time.passes(BLOCKED_S - 1.0, 0.5)
    assert not time.passes(0.5, 0.5, spins=True)
    assert not time.passes(BLOCKED_S - 1.0, 0.5)


def test_a_suspended_process_is_not_blocked() -> None:
    time = Time()
    assert not time.passes(5000.0, 1000.0)
    assert not time.passes(0.5, 0.5, spins=True)
