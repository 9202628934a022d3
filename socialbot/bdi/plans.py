"""Plans: ``event / condition >> [steps]``. When the event comes and the condition holds, do the steps.

Both front ends make them: the operators of this package, and AgentSpeak text.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from socialbot.bdi.literals import Change, Event, Literal, Reactor, Structure
from socialbot.bdi.steps import Achieve, Ask, Await, Constrain, Do, Enter, For, Forget, Fork, If, Step, Update, While
from socialbot.bdi.terms import (
    Call,
    Comparison,
    Condition,
    Conjunction,
    Cons,
    Disjunction,
    Expression,
    FunctionCondition,
    Negation,
    Truth,
    Variable,
    names_in,
)
from socialbot.core.errors import RuleError


@dataclass(frozen=True)
class Origin:
    """Where a plan was written: the text's name and the line, from 1."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(eq=False, repr=False)
class Plan:
    """When ``event`` happens and ``condition`` holds, the agent intends to do ``body``, step by step.

    Of the plans that fit, the one with the highest ``priority`` is chosen, among equals the first. A plan
    with a ``stage`` is considered in that stage only. While an ``atomic`` plan is carried out the agent does
    nothing else. ``annotations`` are those of the label that mean nothing to the engine; ``text`` is how it was
    written, if it was AgentSpeak.
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
        """The plan itself. Raises RuleError when it could never run."""
        if isinstance(self.event.literal, Reactor) and self.event.change is not Change.ADDED:
            raise RuleError(
                f"{self.event} never happens: a Reactor is an event only",
                where=str(self),
                remedy="react to its coming, or make it a Belief",
            )
        if any(isinstance(arg, (Expression, Call)) for arg in self.event.literal.args):
            raise RuleError(
                f"{self.event} computes in its arguments", where=str(self), remedy="compare in the condition instead"
            )
        _Checker(self).check(self)
        return self

    def classes(self) -> Iterator[type[Literal]]:
        """The classes of the beliefs and goals that the event and the condition speak of."""
        yield from _classes(self.event.literal)
        yield from _classes(self.condition)

    def __str__(self) -> str:
        if self.text is not None:
            return self.text
        condition = f" / ({self.condition})" if self.condition.terms else ""
        return f"{self.event}{condition} >> [{', '.join(map(str, self.body))}]"


@dataclass(eq=False, repr=False)
class Inference:
    """``head`` is believed whenever ``condition`` holds (AgentSpeak: ``head :- condition``)."""

    head: Literal
    condition: Conjunction
    origin: Origin | None = None
    text: str | None = None

    def __str__(self) -> str:
        return self.text or f"{self.head} << ({self.condition})"


def atomic(*plans: Plan | list[Plan]) -> list[Plan]:
    """Makes plans atomic: while one of them is carried out, the agent does nothing else."""
    return [replace(plan, atomic=True) for plan in flat(plans)]


def priority(rank: int, *plans: Plan | list[Plan]) -> list[Plan]:
    """Gives plans a priority; those with a higher one are considered first."""
    return [replace(plan, priority=rank) for plan in flat(plans)]


def stage(name: str, *plans: Plan | list[Plan]) -> list[Plan]:
    """Scopes plans to a stage, which the step `enter` or `Engine.enter` begins."""
    return [replace(plan, stage=name) for plan in flat(plans)]


def labelled(label: str, plan: Plan) -> Plan:
    """Gives a plan a label, by which it can be removed and asked about."""
    return replace(plan, label=label)


def flat(items: Iterable[object]) -> Iterator[Plan]:
    """The plans in a list of plans and lists of plans. Raises RuleError for anything else."""
    for item in items:
        if isinstance(item, Plan):
            yield item
        elif isinstance(item, (list, tuple)):
            yield from flat(item)
        else:
            raise RuleError(f"{item!r} is no rule", remedy="write event / condition >> [steps]")


def _classes(part: object) -> Iterator[type[Literal]]:
    if isinstance(part, Literal):
        if type(part) is not Structure:
            yield type(part)
    elif isinstance(part, (Conjunction, Disjunction)):
        for term in part.terms:
            yield from _classes(term)
    elif isinstance(part, Negation):
        yield from _classes(part.condition)


class _Checker:
    """Sees to it that no variable is used before it can have a value."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def check(self, plan: Plan) -> None:
        self.body(plan.body, self.condition(plan.condition, plan.event.literal.names() - {"_"}))

    def condition(self, condition: Condition, bound: set[str]) -> set[str]:
        """The variables that have a value when the condition, checked from left to right, has held."""
        if isinstance(condition, Conjunction):
            for term in condition.terms:
                bound = self.condition(term, bound)
        elif isinstance(condition, Disjunction):
            bound = set.intersection(*(self.condition(term, bound) for term in condition.terms))
        elif isinstance(condition, Negation):
            self.condition(condition.condition, bound)
        elif isinstance(condition, Literal):
            bound = self.pattern((*condition.args, *condition.annotations), bound, str(condition))
        elif isinstance(condition, FunctionCondition):
            self.bound(condition.names() - bound, str(condition))
        elif isinstance(condition, Comparison):
            if condition.symbol.startswith("=") and condition.symbol != "==":
                return self.pattern((condition.left, condition.right), bound, str(condition))
            self.bound(condition.names() - bound, str(condition))
        else:
            assert isinstance(condition, Truth), condition
        return bound

    def pattern(self, terms: tuple[object, ...], bound: set[str], where: str) -> set[str]:
        """The variables that have a value when terms, compared from left to right, have matched."""
        for term in terms:
            if isinstance(term, (Expression, Call)):
                # The functions of AgentSpeak take queries, whose variables are their own.
                if isinstance(term, Expression):
                    self.bound(names_in(term) - bound, where)
            elif isinstance(term, Variable):
                bound = bound | ({term.name} - {"_"})
            elif isinstance(term, tuple):
                bound = self.pattern(term, bound, where)
            elif isinstance(term, Cons):
                bound = self.pattern((*term.items, term.tail), bound, where)
            elif isinstance(term, Literal):
                bound = self.pattern((*term.args, *term.annotations), bound, where)
        return bound

    def body(self, body: tuple[Step, ...], bound: set[str]) -> set[str]:
        for step in body:
            bound = self.step(step, bound)
        return bound

    def step(self, step: Step, bound: set[str]) -> set[str]:
        for part in (getattr(step, name, None) for name in ("action", "goal", "literal")):
            if isinstance(part, Literal) and not part.functor.startswith("."):
                self.values(part.args, str(step))
        if isinstance(step, (Ask, Constrain)):
            query = step.query if isinstance(step, Ask) else step.condition
            return bound if isinstance(query, Variable) else self.condition(query, bound)
        if isinstance(step, Achieve):
            if isinstance(step.goal, Variable) or step.apart:
                self.bound(step.goal.names() - bound, str(step))
            else:
                return self.pattern(step.goal.args, bound, str(step))
            return bound
        if isinstance(step, Await):
            if isinstance(step.what, Event):
                return self.pattern(step.what.literal.args, bound, str(step))
            return self.condition(step.what, bound)
        if isinstance(step, Do):
            if step.action.functor.startswith("."):
                return bound | step.action.names()
            self.bound(step.action.names() - bound, str(step))
        elif isinstance(step, Update):
            if step.sign in ("-", "--") and isinstance(step.literal, Literal):
                return self.pattern(step.literal.args, bound, str(step))
            self.bound(step.literal.names() - bound, str(step))
        elif isinstance(step, Forget):
            self.bound(step.literal.names() - bound - {"_"}, str(step))
        elif isinstance(step, If):
            then = self.body(step.then, self.condition(step.condition, bound))
            return then & self.body(step.otherwise, bound) | bound
        elif isinstance(step, (While, For)):
            self.body(step.body, self.condition(step.condition, bound))
        elif isinstance(step, Fork):
            for branch in step.branches:
                bound = bound | self.body(branch, bound)
        else:
            assert isinstance(step, Enter), step
        return bound

    def values(self, terms: tuple[object, ...], where: str) -> None:
        """Refuses conditions among what has to be values."""
        for term in terms:
            if isinstance(term, (Comparison, Conjunction, Disjunction, Negation)):
                raise RuleError(
                    f"{term} is no value, in {where}",
                    where=str(self.plan),
                    remedy="put conditions before >>, or in when()",
                )

    def bound(self, unbound: set[str], where: str) -> None:
        if unbound:
            raise RuleError(
                f"{', '.join(sorted(unbound))} has no value in {where}",
                where=str(self.plan),
                remedy="name the variable in the event, or in a belief of the condition before it",
            )
