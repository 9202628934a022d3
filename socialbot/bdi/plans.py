"""Plans: ``event / condition >> [steps]``, with the steps for an event under a condition.

Both the operators of this package and AgentSpeak text create plans.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from socialbot.bdi.literals import Belief, Change, Event, Goal, Literal, Reactor, Structure
from socialbot.bdi.steps import Achieve, Ask, Await, Constrain, Do, Enter, For, Forget, Fork, If, Step, Update, While
from socialbot.bdi.terms import (
    Call,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    Negation,
    Pattern,
    Variable,
    names_in,
)
from socialbot.core.errors import RuleError


@dataclass(frozen=True)
class Origin:
    """Source location of a plan: the name of the text and the line, from 1."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(eq=False, repr=False)
class Plan:
    """Plan for ``event``: its steps are ``body``, executed if ``condition`` holds.

    Among the applicable plans the engine selects the first one with the highest ``priority``. A plan with a ``stage``
    only applies in that stage. An ``atomic`` plan excludes other intentions until its end. ``annotations`` are those of
    the label without a meaning to the engine; ``text`` is its AgentSpeak source, if any.
    """

    event: Event
    condition: Conjunction
    body: tuple[Step, ...]
    label: str | None = None
    atomic: bool = False
    priority: int = 0
    stage: str | None = None
    annotations: tuple[object, ...] = ()
    origin: Origin | None = None
    text: str | None = None

    def check(self) -> Plan:
        """Return the plan. Raises RuleError for a plan that can never run."""
        if isinstance(self.event.literal, Reactor) and self.event.change is not Change.ADDED:
            raise RuleError(
                f"{self.event} never happens: a Reactor is an event only",
                where=str(self),
                remedy="react to +event, or make it a Belief",
            )
        if any(isinstance(arg, (Expression, Call)) for arg in self.event.literal.args):
            raise RuleError(
                f"{self.event} computes in its arguments", where=str(self), remedy="compare in the condition instead"
            )
        _Checker(self)
        return self

    def classes(self) -> Iterator[type[Literal]]:
        """Classes of the beliefs and goals in the event, the condition and the body."""
        for part in (self.event.literal, self.condition, self.body):
            yield from _classes(part)

    def __str__(self) -> str:
        if self.text is not None:
            return self.text
        condition = f" / ({self.condition})" if self.condition.terms else ""
        return f"{self.event}{condition} >> [{', '.join(map(str, self.body))}]"


@dataclass(eq=False, repr=False)
class Inference:
    """Inference of ``head`` from ``condition`` (AgentSpeak: ``head :- condition``)."""

    head: Literal
    condition: Conjunction
    origin: Origin | None = None
    text: str | None = None

    def classes(self) -> Iterator[type[Literal]]:
        """Classes of the beliefs in the head and the condition."""
        yield from _classes(self.head)
        yield from _classes(self.condition)

    def __str__(self) -> str:
        return self.text or f"{self.head} << ({self.condition})"


def atomic(*plans: Plan | list[Plan]) -> list[Plan]:
    """Make plans atomic: they exclude other intentions until their end."""
    return [replace(plan, atomic=True) for plan in flat(plans)]


def priority(rank: int, *plans: Plan | list[Plan]) -> list[Plan]:
    """Set the priority of plans; higher values are tried first."""
    return [replace(plan, priority=rank) for plan in flat(plans)]


def stage(name: str, *plans: Plan | list[Plan]) -> list[Plan]:
    """Limit plans to a stage; the step `enter` or `Engine.enter` begins it."""
    return [replace(plan, stage=name) for plan in flat(plans)]


def labelled(label: str, plan: Plan) -> Plan:
    """Set the label of a plan, its name for removal and explanations."""
    return replace(plan, label=label)


def flat(items: Iterable[object]) -> Iterator[Plan]:
    """Flatten nested lists of plans. Raises RuleError for other items."""
    for item in items:
        if isinstance(item, Plan):
            yield item
        elif isinstance(item, (list, tuple)):
            yield from flat(item)
        else:
            raise RuleError(f"{item!r} is not a plan", remedy="write event / condition >> [steps]")


def parts_of(item: object) -> tuple[object, ...]:
    """Direct parts of a plan, step, condition or term, or the items of a tuple."""
    if isinstance(item, tuple):
        return item
    if isinstance(item, Literal):
        return (*item.args, *item.annotations)
    return tuple(vars(item).values()) if isinstance(item, (Pattern, Step, Plan, Inference)) else ()


def _classes(part: object) -> Iterator[type[Literal]]:
    if isinstance(part, (Belief, Goal)) and type(part) is not Structure:
        yield type(part)
    for inner in parts_of(part):
        yield from _classes(inner)


class _Checker:
    """Check that each variable has a value at its use. The methods return the names with a value afterwards."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.body(plan.body, self.condition(plan.condition, plan.event.literal.names() - {"_"}))

    def condition(self, condition: Condition, bound: set[str]) -> set[str]:
        match condition:
            case Conjunction():
                for term in condition.terms:
                    bound = self.condition(term, bound)
            case Disjunction():
                return set.intersection(*(self.condition(term, bound) for term in condition.terms))
            case Negation():
                self.condition(condition.condition, bound)
            case Literal():
                return self.pattern((*condition.args, *condition.annotations), bound, condition)
            case Comparison(symbol="=" | "=.."):
                return self.pattern((condition.left, condition.right), bound, condition)
            case _:
                self.bound(condition.names() - bound, condition)
        return bound

    def pattern(self, terms: tuple[object, ...], bound: set[str], where: object) -> set[str]:
        for term in terms:
            match term:
                case Expression():
                    self.bound(names_in(term) - bound, where)
                case Variable():
                    bound = bound | ({term.name} - {"_"})
                case tuple():
                    bound = self.pattern(term, bound, where)
                case Cons():
                    bound = self.pattern((*term.items, term.tail), bound, where)
                case Literal():
                    bound = self.pattern((*term.args, *term.annotations), bound, where)
        return bound  # The variables in the query of an AgentSpeak function are its own.

    def body(self, body: tuple[Step, ...], bound: set[str]) -> set[str]:
        for step in body:
            self.values(step)
            bound = self.step(step, bound)
        return bound

    def step(self, step: Step, bound: set[str]) -> set[str]:
        match step:
            case Ask(query=Variable()) | Enter():
                return bound
            case Ask(query=Condition() as part) | Constrain(condition=part) | Await(what=Condition() as part):
                return self.condition(part, bound)
            case Await(what=Event(literal=literal)):
                return self.pattern(literal.args, bound, step)
            case Achieve(goal=Literal() as goal, apart=False):
                return self.pattern(goal.args, bound, step)
            case Update(sign="-" | "--", literal=Literal() as literal):
                return self.pattern(literal.args, bound, step)
            case Do(action=action) if action.functor.startswith("."):
                return bound | action.names()
            case Achieve(goal=part) | Update(literal=part) | Do(action=part):
                self.bound(part.names() - bound, step)
            case Forget():
                self.bound(step.literal.names() - bound - {"_"}, step)
            case If():
                then = self.body(step.then, self.condition(step.condition, bound))
                return then & self.body(step.otherwise, bound) | bound
            case While() | For():
                self.body(step.body, self.condition(step.condition, bound))
            case Fork():
                for branch in step.branches:
                    bound = bound | self.body(branch, bound)
        return bound

    def values(self, step: Step) -> None:
        for part in (getattr(step, name, None) for name in ("action", "goal", "literal")):
            if isinstance(part, Literal) and not part.functor.startswith("."):
                for term in part.args:
                    if isinstance(term, (Comparison, Conjunction, Disjunction, Negation)):
                        raise RuleError(
                            f"{term} is not a value, in {step}",
                            where=str(self.plan),
                            remedy="put conditions before >>, or in when()",
                        )

    def bound(self, unbound: set[str], where: object) -> None:
        if unbound:
            raise RuleError(
                f"{', '.join(sorted(unbound))} has no value in {where}",
                where=str(self.plan),
                remedy="name the variable in the event, or in a belief of the condition before it",
            )
