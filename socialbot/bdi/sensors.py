"""Sensors turn what comes in from the world into beliefs. Subclass `Sensor` and override `Sensor.sense`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import Belief, Change, Event
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.engine import Engine

Sensed = Belief | Event | Iterable[Belief | Event] | None
"""What a sensor may return: nothing, one belief (to hold it), one change, or several of them."""


class Sensor:
    """Looks at the world for the agent.

    A pushed sensor gets each percept through `push` or `Engine.perceive`; one with a ``period_s`` is asked that
    often, with None; with ``once`` it ends with the first percept that tells something. `sense` runs in the engine's
    thread, and its exceptions never stop the agent. Everything else here may be called from any thread.
    """

    period_s: float | None = None
    once: bool = False
    engine: Engine | None = None
    running: bool = False
    _ticking: Callable[[], None] | None = None
    _rung = False

    def sense(self, percept: Any) -> Sensed:
        """The beliefs that follow from ``percept``."""
        raise RuleError(f"the sensor {type(self).__name__} senses nothing", remedy="override sense()")

    def attach(self, engine: Engine) -> None:
        """Makes it a sensor of ``engine``, and starts it."""
        if self.period_s is not None and not self.period_s > 0:
            where = type(self).__name__
            raise RuleError(f"a period of {self.period_s} s", where=where, remedy="give more than 0 s, or None")
        if self.engine is not None and self.engine is not engine:
            raise RuleError(
                f"the sensor {type(self).__name__} belongs to {self.engine.name}", remedy="make one for each agent"
            )
        self.engine = engine
        self.start()

    def start(self) -> None:
        """Begins, or begins again. One with a period is asked at once, and then in each period."""
        if not self.running:
            self.running = True
            self._ring()

    def suspend(self) -> None:
        """Senses nothing until `resume`: it is not asked, and what is pushed meanwhile is lost."""
        if self.running:
            self.running = False
            self._ring()

    def resume(self) -> None:
        """Goes on after `suspend`."""
        self.start()

    def stop(self) -> None:
        """Ends; `start` begins it anew."""
        self.suspend()

    def push(self, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Shows it a percept. Raises RuleError when it belongs to no engine."""
        if self.engine is None:
            raise RuleError(f"the sensor {type(self).__name__} has no engine", remedy="call engine.add_sensor(sensor)")
        self.engine.perceive(self, percept, cause=cause, since=since)

    def _ring(self) -> None:
        """Has the engine's thread set or clear the timer."""
        if self.engine is not None and self.period_s is not None and not self._rung:
            self._rung = True
            self.engine.call(self._reset)

    def _reset(self) -> None:
        assert self.engine is not None
        self._rung = False
        if self._ticking is not None:
            self.engine.timers.cancel(self._ticking)
            self._ticking = None
        if self.running:
            self._tick()

    def _tick(self) -> None:
        """Asks a sensor with a period, and sees to it that it is asked again."""
        assert self.engine is not None
        assert self.period_s is not None
        self._ticking = None
        self.engine.interpreter.sense(self, None, "", None)
        if self.running and self._ticking is None:
            self._ticking = self._tick
            self.engine.timers.after(self.period_s, self._ticking)


class ThreadSensor(Sensor):
    """A sensor that waits for the world in a thread of its own: override `read`, and `sense` for what it returned.

    The thread begins with `start` and ends with `suspend` or `stop`, as soon as `read` has returned; ``ending`` is
    set then, for a `read` that can look at it.
    """

    retry_s: float = 1.0
    """So long it rests after `read` has raised, before it tries again."""

    ending: threading.Event

    def read(self) -> Any:
        """Waits for a percept and returns it; None is no percept. EOFError says that there will be no more."""
        raise EOFError(f"the sensor {type(self).__name__} reads nothing: override read()")

    def start(self) -> None:
        """Starts a thread for it, unless there is one."""
        if not self.running:
            super().start()
            self.ending = threading.Event()
            threading.Thread(
                target=self._watch, args=(self.ending,), name=type(self).__name__, daemon=True
            ).start()  # fmt: skip

    def suspend(self) -> None:
        """Tells the thread to end."""
        if self.running:
            self.ending.set()
        super().suspend()

    def _watch(self, ending: threading.Event) -> None:
        assert self.engine is not None, "add the sensor to an engine first"
        while not ending.is_set():
            try:
                percept = self.read()
            except EOFError:
                return
            except Exception as problem:  # noqa: BLE001 - user code
                self._report(problem)
                ending.wait(self.retry_s)
                continue
            if percept is not None and not ending.is_set():
                self.push(percept)

    def _report(self, problem: Exception) -> None:
        engine = self.engine
        assert engine is not None
        engine.call(lambda: engine.trace.record_failure(type(self).__name__, "", problem))


def changes(sensed: Sensed) -> list[Event]:
    """What a sensor returned, as changes of beliefs. Raises RuleError for anything else."""
    if sensed is None:
        return []
    items = [sensed] if isinstance(sensed, (Belief, Event)) else list(sensed)
    for item in items:
        change = item.change if isinstance(item, Event) else Change.ADDED
        if not isinstance(item, (Belief, Event)) or change not in (Change.ADDED, Change.REMOVED):
            raise RuleError(f"a sensor returned {item!r}", remedy="return beliefs, +belief, -belief or None")
    return [+item if isinstance(item, Belief) else item for item in items]
