"""The wake-up loop of deliberation: one step for any number of changes, and for times that are due."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.bdi import Engine

_NEVER = 1 << 62


class WakeupLoop:
    """Runs ``step`` in the thread of the engine after `wake`, and at the earliest time that `is_due` deferred."""

    def __init__(self, engine: Engine, step: Callable[[], object]) -> None:
        self._engine = engine
        self._step = step
        self._posted = False
        self._next = _NEVER
        self._scheduled = _NEVER

    def wake(self) -> None:
        """Schedule one step; further calls have no effect until the step calls `rearm`."""
        if not self._posted:
            self._posted = True
            self._engine.call(self._run)

    def rearm(self) -> None:
        """Let `wake` schedule another step. Each step calls this once."""
        self._posted = False

    def is_due(self, time: int) -> bool:
        """Return whether ``time`` (ns) has come; otherwise run a step at that time."""
        if time <= self._engine.clock.now():
            return True
        self._next = min(self._next, time)
        return False

    def _run(self) -> None:
        self._next = _NEVER
        self._step()
        if self._scheduled <= self._engine.clock.now():
            self._scheduled = _NEVER
        if self._next < self._scheduled:
            self._scheduled = self._next
            self._engine.timers.at(self._next, self.wake)
