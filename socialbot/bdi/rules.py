"""Rules: ``event / condition >> [steps]``. When the event comes and the condition holds, do the steps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from socialbot.bdi.actions import Action
from socialbot.bdi.literals import Belief, Change, Conjunction, Event, Goal, Held, Negation, Reactor
from socialbot.bdi.terms import Expression, Variable, names_in
from socialbot.errors import RuleError

Step = Action | Goal | Event


@dataclass(frozen=True)
class Head:
    """An event with a condition: half a rule, waiting for ``>> [steps]``."""

    event: Event
    condition: Conjunction

    def __rshift__(self, body: Iterable[object]) -> Rule:
        if not isinstance(body, Iterable) or isinstance(body, str):
            raise RuleError(f"{body} is no list of steps", remedy=f"write >> [{body}]")
        return Rule(self.event, self.condition, tuple(_step(item) for item in body))

    def __and__(self, other: object) -> None:
        raise RuleError(
            f"the condition of {self.event} falls apart", remedy="put it in parentheses: event / (a & b) >> [...]"
        )


@dataclass(frozen=True)
class Rule:
    """When ``event`` happens and ``condition`` holds, the agent intends to do ``body``, step by step."""

    event: Event
    condition: Conjunction
    body: tuple[Step, ...]

    def __post_init__(self) -> None:
        if isinstance(self.event.literal, Reactor) and self.event.change is not Change.ADDED:
            raise RuleError(
                f"{self.event} never happens: a Reactor is an event only",
                where=str(self),
                remedy="react to its coming, or make it a Belief",
            )
        if any(isinstance(arg, Expression) for arg in self.event.literal.args):
            raise RuleError(
                f"{self.event} computes in its arguments", where=str(self), remedy="compare in the condition instead"
            )
        bound = self._check_condition(self.event.literal.names() - {"_"})
        for step in self.body:
            literal = step.literal if isinstance(step, Event) else step
            free = {"_"} if isinstance(step, Event) and step.change is Change.REMOVED else set()
            self._check_bound(literal.names() - bound - free, str(step))

    def _check_condition(self, bound: set[str]) -> set[str]:
        """The variables that have a value when the condition, checked from left to right, has held."""
        for term in self.condition.terms:
            if isinstance(term, (Belief, Negation)):
                found = self._check_pattern(term if isinstance(term, Belief) else term.belief, bound, str(term))
                bound = found if isinstance(term, Belief) else bound
            else:
                self._check_bound(term.names() - bound, str(term))
        return bound

    def _check_pattern(self, pattern: Belief, bound: set[str], where: str) -> set[str]:
        """The variables that have a value when ``pattern``, compared from left to right, has matched."""
        for arg in pattern.args:
            if not isinstance(arg, Variable):
                self._check_bound(names_in((arg,)) - bound, where)
            elif arg.name != "_":
                bound = bound | {arg.name}
        return bound

    def _check_bound(self, unbound: set[str], where: str) -> None:
        if unbound:
            raise RuleError(
                f"{', '.join(sorted(unbound))} has no value in {where}",
                where=str(self),
                remedy="name the variable in the event, or in a belief of the condition before it",
            )

    def __str__(self) -> str:
        condition = f" / ({self.condition})" if self.condition.terms else ""
        return f"{self.event}{condition} >> [{', '.join(map(str, self.body))}]"


def _step(item: object) -> Step:
    if isinstance(item, (Action, Goal)):
        return item
    if isinstance(item, Event) and item.change in (Change.ADDED, Change.REMOVED):
        return item
    if isinstance(item, (Belief, Held)):
        raise RuleError(f"{item} is no step of a plan", remedy="write +belief or -belief to change what is believed")
    if isinstance(item, type) and issubclass(item, (Action, Goal)):
        raise RuleError(f"{item.__name__} is a class", remedy=f"write {item.__name__}()")
    raise RuleError(f"{item!r} is no step of a plan", remedy="use actions, goals, +belief and -belief")
