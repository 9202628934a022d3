"""Sensors of deliberating agents, which turn percepts into facts, and their timeouts.

>>> class Position(FactSensor):
...     prototypes = (predicate("in", "*", "*"),)
...
...     def tell(self, percept):
...         yield predicate("in", "carrier_a", percept.place)
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi import Engine
from socialbot.bdi.sensors import Sensor
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._action_executor import IsSensed, key_of
from socialbot.deliberation._fact_index import signature_of
from socialbot.deliberation.messages import FLUENT, INSTANCE, PREDICATE, Fact
from socialbot.planning.pddl.domain import PddlDomain
from socialbot.planning.pddl.formulas import Key

if TYPE_CHECKING:
    from socialbot.deliberation.deliberator import Deliberator

SECOND_CHECK_S = 0.05
"""Time from the deadline of a sensor to its second check.

Timers precede messages, so a percept that waits or is in transit when the deadline passes is handled in between. In
simulated time the second check is in a later step.
"""


def predicate(name: str, *params: str) -> Fact:
    """Return the fact that a predicate is true."""
    return Fact(name=name, pddl_type=PREDICATE, params=params)


def fluent(name: str, *params: str, value: float = 0.0) -> Fact:
    """Return the fact that a function has a value."""
    return Fact(name=name, pddl_type=FLUENT, params=params, value=value)


def instance(name: str, kind: str) -> Fact:
    """Return the fact that an object of a type exists."""
    return Fact(name=name, pddl_type=INSTANCE, type=kind)


class FactSensor(Sensor):
    """Sensor that reports facts: override `tell`. Like any `Sensor` it has a period, or gets percepts from `push`.

    A percept is complete: facts of the prototypes that it does not report stop holding. Effects of actions on these
    facts are left to the sensor. A fact that does not fit the domain is ignored, with a record in the trace.

    Attributes:
        prototypes: Facts that it may report; ``*`` stands for any object, or for any name of an instance.
        deadline_s: Longest time between percepts; after it, and before the first one, the agent starts nothing new.
            It is silent if a second check, `SECOND_CHECK_S` later, finds no percept either.
            After ``give_up_silent_s`` more it goes on without what needs the sensor.
    """

    prototypes: ClassVar[tuple[Fact, ...]] = ()
    deadline_s: ClassVar[float | None] = None

    deliberator: Deliberator
    _percept_at = 0
    _overdue = False
    """Whether the last check was the first one past the deadline."""
    _last_facts: tuple[Fact, ...] | None = None
    _version = -1
    _problems: tuple[str, ...] = ()

    def tell(self, percept: Any) -> Iterable[Fact] | None:
        """Return the facts of a percept, or None for no change. The percept is None when called by the period."""
        raise PlanningError(f"the sensor {self.name} has no tell()", remedy="override tell()")

    @property
    def name(self) -> str:
        return type(self).__name__

    def join(self, deliberator: Deliberator) -> None:
        """Add the sensor to an agent. Raises PlanningError for a prototype that does not fit the domain."""
        self.deliberator = deliberator
        for prototype in self.prototypes:
            reason = _misfit(prototype, deliberator.domain)
            if reason:
                raise PlanningError(reason, where=f"sensor {self.name}", remedy="correct the prototype or the domain")
        self._percept_at = deliberator.engine.clock.now()
        deliberator.engine.add_sensor(self)
        if self.deadline_s is not None:
            deliberator.sensor_timeouts.expect(self.name, self.prototypes)
            deliberator.engine.call(self._check_deadline)

    def sense(self, percept: Any) -> None:
        """Replace the believed facts of the prototypes by those of a percept."""
        found = self.tell(percept)
        if found is None:
            return
        facts_of_percept, facts = tuple(found), self.deliberator.facts
        self._percept_at = self.deliberator.engine.clock.now()
        cause = getattr(percept, "id", "") or f"{self.name}-{getattr(percept, 'stamp', self._percept_at)}"
        if facts_of_percept != self._last_facts or facts.version != self._version:
            self._believe({fact.identity: fact for fact in facts_of_percept}, cause)
            self._last_facts, self._version = facts_of_percept, facts.version
        self.deliberator.sensor_timeouts.end(self.name, cause)

    def _believe(self, facts_of_percept: dict[tuple[int, str, tuple[str, ...]], Fact], cause: str) -> None:
        facts, problems = self.deliberator.facts, []
        for prototype in self.prototypes:
            name = "" if prototype.pddl_type == INSTANCE else prototype.name
            table = facts.table(prototype.pddl_type, name).facts
            known = sorted((fact for fact in table.values() if fits(fact, prototype)), key=lambda fact: fact.identity)
            for held in known:
                if held.identity not in facts_of_percept:
                    facts.remove(held, cause)
        for fact in facts_of_percept.values():
            try:
                if not any(fits(fact, prototype) for prototype in self.prototypes):
                    raise PlanningError(f"it has no prototype for {fact}")
                facts.add(fact, source="percept", cause=cause)
            except PlanningError as problem:
                problems.append(problem)
        texts = tuple(problem.what for problem in problems)
        if texts != self._problems:
            self._problems = texts
            for problem in problems:
                self.deliberator.engine.trace.record_failure(f"sensor {self.name}", cause, problem)

    def _check_deadline(self) -> None:
        assert self.deadline_s is not None
        engine = self.deliberator.engine
        now, due = engine.clock.now(), self._percept_at + nanoseconds(self.deadline_s)
        is_second, self._overdue = self._overdue, now >= due and not self._overdue
        if self._overdue:
            due = now + nanoseconds(SECOND_CHECK_S)
        elif is_second and now >= due:
            self.deliberator.sensor_timeouts.begin(self.name)
            due = now + nanoseconds(self.deadline_s)
        engine.timers.at(due, self._check_deadline)


def sensed_by(sensors: Sequence[FactSensor]) -> IsSensed:
    """Return a function that tells whether these sensors report a predicate or function."""
    prototypes = [fact for sensor in sensors for fact in sensor.prototypes if fact.pddl_type != INSTANCE]

    @functools.cache
    def is_sensed(name: str, objects: tuple[str, ...]) -> bool:
        return any(prototype.name == name and _like(objects, prototype.params) for prototype in prototypes)

    return is_sensed


def fits(fact: Fact, prototype: Fact) -> bool:
    """Return whether a fact matches a prototype."""
    if fact.pddl_type != prototype.pddl_type:
        return False
    if fact.pddl_type == INSTANCE:
        return fact.type == prototype.type and fnmatchcase(fact.name, prototype.name)
    return fact.name == prototype.name and _like(fact.params, prototype.params)


def _like(names: tuple[str, ...], patterns: tuple[str, ...]) -> bool:
    return len(names) == len(patterns) and all(map(fnmatchcase, names, patterns))


def _misfit(prototype: Fact, domain: PddlDomain) -> str:
    if prototype.pddl_type == INSTANCE:
        return "" if prototype.type in domain.types else f"there is no type {prototype.type!r}"
    signature, reason = signature_of(domain, prototype)
    return "" if signature is not None else reason or "unknown"


@dataclass(slots=True)
class _Timeout:
    since: int
    first: bool
    overdue: bool = False


class SensorTimeouts:
    """Sensors without a recent percept, in the order of their timeouts. Each change calls ``wake``."""

    def __init__(self, engine: Engine, wake: Callable[[], object]) -> None:
        self._engine = engine
        self._wake = wake
        self._timeouts: dict[str, _Timeout] = {}
        self._prototypes: dict[str, tuple[Fact, ...]] = {}

    def __bool__(self) -> bool:
        return bool(self._timeouts)

    def expect(self, sensor: str, prototypes: tuple[Fact, ...] = ()) -> None:
        """Start no plan before the first percept of a sensor. Raises PlanningError if the name is taken."""
        if sensor in self._timeouts:
            raise PlanningError(
                "there is another sensor of this name", where=f"sensor {sensor}", remedy="override its name"
            )
        self._prototypes[sensor] = prototypes
        self._timeouts[sensor] = _Timeout(self._engine.clock.now(), True)
        self._wake()

    def begin(self, sensor: str) -> None:
        """Start nothing new while a sensor times out."""
        timeout = self._timeouts.setdefault(sensor, _Timeout(self._engine.clock.now(), False))
        if not timeout.overdue:
            timeout.overdue = True
            self._engine.trace.record("silent", sensor, "")
            self._wake()

    def end(self, sensor: str, cause: str) -> None:
        """Continue after a percept with the id ``cause``, if no other sensor times out."""
        timeout = self._timeouts.pop(sensor, None)
        if timeout is not None:
            if timeout.overdue:
                self._engine.trace.record("heard", sensor, cause)
            self._wake()

    @property
    def is_first(self) -> bool:
        """Whether a sensor has never had a percept."""
        return any(timeout.first for timeout in self._timeouts.values())

    @property
    def since(self) -> dict[str, int]:
        """Start (ns) of the timeout of each silent sensor."""
        return {sensor: timeout.since for sensor, timeout in self._timeouts.items()}

    def facts_of(self, sensors: Iterable[str]) -> tuple[Key, ...]:
        """Return the predicates and functions that some sensors report; ``*`` stands for any object."""
        prototypes = (prototype for sensor in sensors for prototype in self._prototypes.get(sensor, ()))
        keys = (key_of(prototype) for prototype in prototypes)
        return tuple(dict.fromkeys(key for key in keys if key is not None))

    def __str__(self) -> str:
        return silence_of(self._timeouts)


def silence_of(sensors: Iterable[str]) -> str:
    """Return a text that names silent sensors."""
    return ", ".join(f"sensor {sensor} is silent" for sensor in sensors)
