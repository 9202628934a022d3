"""Sensors of deliberating agents: percepts in, facts out.

>>> class Position(FactSensor):
...     prototypes = (predicate("in", "*", "*"),)
...
...     def tell(self, percept):
...         yield predicate("in", "carrier_a", percept.place)
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.sensors import Sensor
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation.action_executor import Watched
from socialbot.deliberation.fact_index import signature_of
from socialbot.deliberation.matching import fitting
from socialbot.deliberation.messages import FLUENT, INSTANCE, PREDICATE, Fact
from socialbot.planning.pddl.domain import PddlDomain

if TYPE_CHECKING:
    from socialbot.deliberation.deliberator import Deliberator


def predicate(name: str, *params: str) -> Fact:
    """The fact that a predicate is true."""
    return Fact(name=name, pddl_type=PREDICATE, params=params)


def fluent(name: str, *params: str, value: float = 0.0) -> Fact:
    """The fact that a function has a value."""
    return Fact(name=name, pddl_type=FLUENT, params=params, value=value)


def instance(name: str, kind: str) -> Fact:
    """The fact that there is an object of a type."""
    return Fact(name=name, pddl_type=INSTANCE, type=kind)


class FactSensor(Sensor):
    """Tells which facts hold: override `tell`. It may have a period, or be shown percepts by `push`, as any `Sensor`.

    ``prototypes`` say what it may tell of; ``*`` stands for any object, or any name of an instance. What it does
    not tell of these does not hold: a percept says all. The effects of actions on them are left to it. With
    ``deadline_s`` it is taken to be silent before its first percept, and when none comes for so long; then the agent
    begins nothing new. A fact that does not fit the domain is left out; that goes on the trace.
    """

    prototypes: ClassVar[tuple[Fact, ...]] = ()
    deadline_s: ClassVar[float | None] = None

    deliberator: Deliberator
    _heard_at = 0
    _told: tuple[Fact, ...] | None = None
    _version = -1
    _complaints: tuple[str, ...] = ()

    def tell(self, percept: Any) -> Iterable[Fact] | None:
        """The facts that hold by this percept; None when it says nothing. ``percept`` is None when a period is up."""
        raise PlanningError(f"the sensor {self.name} tells nothing", remedy="override tell()")

    @property
    def name(self) -> str:
        """What the trace calls it."""
        return type(self).__name__

    def join(self, deliberator: Deliberator) -> None:
        """Becomes a sensor of an agent. Raises PlanningError for a prototype that does not fit the agent's domain."""
        self.deliberator = deliberator
        for prototype in self.prototypes:
            reason = _misfit(prototype, deliberator.domain)
            if reason:
                raise PlanningError(reason, where=f"sensor {self.name}", remedy="mend the prototype, or the domain")
        self._heard_at = deliberator.engine.clock.now()
        deliberator.engine.add_sensor(self)
        if self.deadline_s is not None:
            deliberator.expect_sensor(self.name)
            deliberator.engine.call(self._expect)

    def sense(self, percept: Any) -> None:
        """Believes what `tell` says of a percept, and no longer what it said before."""
        found = self.tell(percept)
        if found is None:
            return
        told, facts = tuple(found), self.deliberator.facts
        self._heard_at = self.deliberator.engine.clock.now()
        cause = getattr(percept, "id", "") or f"{self.name}-{getattr(percept, 'stamp', self._heard_at)}"
        if told != self._told or facts.version != self._version:
            self._believe({fact.identity: fact for fact in told}, cause)
            self._told, self._version = told, facts.version
        self.deliberator.sensor_is_back(self.name, cause)

    def _believe(self, told: dict[tuple[int, str, tuple[str, ...]], Fact], cause: str) -> None:
        """Believes what was told, and nothing else of its kind."""
        facts, complaints = self.deliberator.facts, []
        for prototype in self.prototypes:
            for held in list(fitting(prototype, facts)):
                if held.identity not in told:
                    facts.remove(held, cause)
        for fact in told.values():
            try:
                if not any(fits(fact, prototype) for prototype in self.prototypes):
                    raise PlanningError(f"it has no prototype for {fact}")
                facts.add(fact, source="percept", cause=cause)
            except PlanningError as problem:
                complaints.append(problem)
        texts = tuple(problem.what for problem in complaints)
        if texts != self._complaints:
            self._complaints = texts
            for problem in complaints:
                self.deliberator.engine.record_failure(f"sensor {self.name}", cause, problem)

    def _expect(self) -> None:
        """Looks, when the time is up, whether something was heard."""
        assert self.deadline_s is not None
        engine = self.deliberator.engine
        due = self._heard_at + nanoseconds(self.deadline_s)
        if engine.clock.now() >= due:
            self.deliberator.sensor_is_silent(self.name)
            due = engine.clock.now() + nanoseconds(self.deadline_s)
        engine.at(due, self._expect)


def watched_by(sensors: Sequence[FactSensor]) -> Watched:
    """What these sensors tell of."""
    prototypes = [fact for sensor in sensors for fact in sensor.prototypes if fact.pddl_type != INSTANCE]

    @functools.cache
    def watched(name: str, objects: tuple[str, ...]) -> bool:
        return any(
            prototype.name == name
            and len(prototype.params) == len(objects)
            and all(map(fnmatchcase, objects, prototype.params))
            for prototype in prototypes
        )

    return watched


def fits(fact: Fact, prototype: Fact) -> bool:
    """Whether a sensor with this prototype may tell of a fact."""
    if fact.pddl_type != prototype.pddl_type:
        return False
    if fact.pddl_type == INSTANCE:
        return fact.type == prototype.type and fnmatchcase(fact.name, prototype.name)
    same = fact.name == prototype.name and len(fact.params) == len(prototype.params)
    return same and all(map(fnmatchcase, fact.params, prototype.params))


def _misfit(prototype: Fact, domain: PddlDomain) -> str:
    """Why a domain has nothing like that, or an empty text."""
    if prototype.pddl_type == INSTANCE:
        return "" if prototype.type in domain.types else f"there is no type {prototype.type!r}"
    signature, reason = signature_of(domain, prototype)
    return "" if signature is not None else reason or "unknown"
