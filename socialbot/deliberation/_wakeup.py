"""The wake-up loop of deliberation: one step for any number of changes, and for times that are due."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.bdi import Engine

_NEVER = 1 << 62


class WakeupLoop:
    """Runs ``step`` in the thread of the engine after `wake`, and at the earliest time that `is_due` deferred.

    Args:
        name: Name in the trace for errors of callbacks.
    """

    def __init__(self, engine: Engine, step: Callable[[], object], name: str) -> None:
        self._engine = engine
        self._step = step
        self._name = name
        self._posted = False
        self._next = _NEVER
        self._scheduled = _NEVER

    @property
    def now(self) -> int:
        """Time (ns) of the engine."""
        return self._engine.clock.now()

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
        if time <= self.now:
            return True
        self._next = min(self._next, time)
        return False

    def guarded(self, callback: Callable[[], object], cause: str = "") -> None:
        """Call a callback; its errors are recorded and never stop the agent."""
        try:
            callback()
        except Exception as problem:  # noqa: BLE001 - user code
            self._engine.trace.record_failure(self._name, cause, problem)

    def _run(self) -> None:
        self._next = _NEVER
        self._step()
        if self._scheduled <= self.now:
            self._scheduled = _NEVER
        if self._next < self._scheduled:
            self._scheduled = self._next
            self._engine.timers.at(self._next, self.wake)
