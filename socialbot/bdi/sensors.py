"""Sensors derive beliefs from percepts: subclass `Sensor` and override `Sensor.sense`."""

from __future__ import annotations

import functools
import inspect
import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import PERCEPT, Belief, Change, Event, distinct
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.engine import Engine

Sensed = Belief | Event | Iterable[Belief | Event] | None
"""Result of a sensor: nothing, one belief (to add it), one change, or several of them."""


BROKEN = 3
"""Number of percepts in a row after which a sensor that fails counts as broken."""


class Sensor:
    """Sensor of an agent.

    `push` and `Engine.perceive` pass percepts to a sensor; a sensor with a ``period_s`` is polled with None. With
    ``once`` the first percept that yields beliefs stops the sensor. `sense` runs in the engine's thread, and its
    exceptions never stop the agent. Any thread may call the other methods.
    """

    period_s: float | None = None
    once: bool = False
    engine: Engine | None = None
    running: bool = False
    _ticking: Callable[[], None] | None = None
    _rung = False
    _failures = 0
    """Number of percepts at which the sensor failed, since the last one that it understood."""

    def sense(self, percept: Any) -> Sensed:
        """Return the beliefs for ``percept``."""
        raise RuleError(f"sensor {type(self).__name__} has no sense()", remedy="override sense()")

    def attach(self, engine: Engine) -> None:
        """Assign the sensor to ``engine`` and start it."""
        if self.period_s is not None and not self.period_s > 0:
            where = type(self).__name__
            raise RuleError(f"invalid period of {self.period_s} s", where=where, remedy="give more than 0 s, or None")
        if self.engine is not None and self.engine is not engine:
            raise RuleError(
                f"the sensor {type(self).__name__} belongs to {self.engine.name}", remedy="make one for each agent"
            )
        self.engine = engine
        self.start()

    def start(self) -> None:
        """Start or restart the sensor; with a period, poll it now and in each period."""
        if not self.running:
            self.running = True
            self._ring()

    def suspend(self) -> None:
        """Suspend the sensor until `resume`: no polling, and pushed percepts are discarded."""
        if self.running:
            self.running = False
            self._ring()

    def resume(self) -> None:
        self.start()

    def stop(self) -> None:
        """Stop the sensor; `start` restarts it."""
        self.suspend()

    def push(self, percept: Any, *, cause: str = "", since: int | None = None) -> None:
        """Pass a percept to the engine. Raises RuleError for a sensor without an engine."""
        if self.engine is None:
            raise RuleError(f"the sensor {type(self).__name__} has no engine", remedy="call engine.add_sensor(sensor)")
        self.engine.perceive(self, percept, cause=cause, since=since)

    def _ring(self) -> None:
        """Reset the timer in the engine's thread."""
        if self.engine is not None and self.period_s is not None and not self._rung:
            self._rung = True
            self.engine.call(self._reset)

    def _reset(self) -> None:
        assert self.engine is not None
        self._rung = False
        self.engine.timers.remove(lambda callback: callback is self._ticking)
        if self.running:
            self._tick()

    def _tick(self) -> None:
        """Poll the sensor and set the next timer."""
        assert self.engine is not None
        assert self.period_s is not None
        self._ticking = None
        take_percept(self.engine.interpreter, self, None, "", None)
        if self.running and self._ticking is None:
            self._ticking = self._tick
            self.engine.timers.after(self.period_s, self._ticking)


class ThreadSensor(Sensor):
    """Sensor with a blocking `read` in a thread of its own; override `read`, and `sense` for its results.

    `start` starts the thread. After `suspend` or `stop` it ends when `read` returns; a long `read` can check
    ``ending``.
    """

    retry_s: float = 1.0
    """Delay before the next `read` after an exception."""

    ending: threading.Event

    def read(self) -> Any:
        """Block until a percept and return it, or None for no percept; raise EOFError after the last one."""
        raise EOFError(f"sensor {type(self).__name__} has no read()")

    def start(self) -> None:
        """Start the thread, if none is running."""
        if not self.running:
            super().start()
            self.ending = threading.Event()
            threading.Thread(target=self._watch, args=(self.ending,), name=type(self).__name__, daemon=True).start()

    def suspend(self) -> None:
        """Request the thread to end."""
        if self.running:
            self.ending.set()
        super().suspend()

    def _watch(self, ending: threading.Event) -> None:
        engine, name = self.engine, type(self).__name__
        assert engine is not None, "add the sensor to an engine first"
        while not ending.is_set():
            try:
                percept = self.read()
            except EOFError:
                return
            except Exception as problem:  # noqa: BLE001 - user code
                engine.call(functools.partial(engine.trace.record_failure, name, "", problem))
                ending.wait(self.retry_s)
                continue
            if percept is not None and not ending.is_set():
                self.push(percept)


def changes(sensed: Sensed) -> list[Event]:
    """Convert the result of a sensor to changes of beliefs. Raises RuleError for other values."""
    if sensed is None:
        return []
    if inspect.iscoroutine(sensed):
        sensed.close()
        raise RuleError("sense() of a sensor is a coroutine", remedy="write def instead of async def")
    items: list[Any] = [sensed] if isinstance(sensed, (Belief, Event, str, type)) else _listed(sensed)
    for item in items:
        if isinstance(item, type) and issubclass(item, Belief):
            remedy = f"return {item.__name__}(), with its arguments"
            raise RuleError(f"a sensor returned the class {item.__name__}", remedy=remedy)
        change = item.change if isinstance(item, Event) else Change.ADDED
        if not isinstance(item, (Belief, Event)) or change not in (Change.ADDED, Change.REMOVED):
            raise RuleError(f"a sensor returned {item!r}", remedy="return beliefs, +belief, -belief or None")
    return [+item if isinstance(item, Belief) else item for item in items]


def _listed(sensed: Any) -> list[Any]:
    try:
        items = iter(sensed)
    except TypeError:
        return [sensed]
    return list(items)


def take_percept(interpreter: Interpreter, sensor: Sensor, percept: Any, cause: str, since: int | None) -> None:
    """Update the beliefs of an agent from a percept of a sensor."""
    if sensor.engine is interpreter.engine and not sensor.running:
        return
    try:
        sensed = changes(sensor.sense(percept))
        reasons: dict[str, str] = {}
        for event in sensed:
            if event.change is Change.ADDED:
                relation, args, *_ = interpreter.admit(event.literal)
                why = _percept(interpreter, event, cause, reasons, news=args not in relation.facts)
                interpreter.beliefs.add(relation, args, distinct(event.literal.annotations + PERCEPT), why, since)
            else:
                interpreter.forget(event.literal, _percept(interpreter, event, cause, reasons, news=True))
    except Exception as problem:  # noqa: BLE001 - sensors are user code
        interpreter.trace.record_failure(type(sensor).__name__, cause, problem)
        sensor._failures += 1
        if sensor._failures == BROKEN:
            broken = interpreter.broken_sensors
            interpreter.broken_sensors = {**broken, type(sensor).__name__: str(problem)}
        return
    if sensor._failures:
        sensor._failures = 0
        broken = dict(interpreter.broken_sensors)
        broken.pop(type(sensor).__name__, None)
        interpreter.broken_sensors = broken
    if sensor.once and sensed:
        sensor.stop()


def _percept(interpreter: Interpreter, event: Event, cause: str, reasons: dict[str, str], *, news: bool) -> str:
    """Record a reason that a sensor gave for changes once; return the cause of the change."""
    reason = event.reason
    if not reason or not news or interpreter.trace.sink is None:
        return cause
    if reason not in reasons:
        reasons[reason] = interpreter.trace.record("percept", reason, cause)
    return reasons[reason]
