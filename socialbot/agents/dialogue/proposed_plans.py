"""Check of proposed AgentSpeak plans: a whitelist of names and kinds of steps, and limits of size and depth."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from socialbot.bdi import Plan
from socialbot.bdi.agentspeak import parse
from socialbot.bdi.literals import Change, Event, Literal
from socialbot.bdi.plans import nodes_of
from socialbot.bdi.steps import Achieve, Ask, Constrain, Do, If, Step
from socialbot.bdi.terms import (
    Atom,
    Comparison,
    Conjunction,
    Disjunction,
    Expression,
    Negation,
    Pattern,
    Truth,
    Variable,
    show,
)
from socialbot.core.errors import RuleError, SocialbotError


@dataclass(frozen=True)
class Whitelist:
    """Names with their numbers of arguments that a proposed plan may use.

    Args:
        goals: Goals that it may be a plan for, and that it may adopt.
        actions: Actions that it may carry out.
        beliefs: Beliefs that it may test.
    """

    goals: Mapping[str, int] = field(default_factory=dict)
    actions: Mapping[str, int] = field(default_factory=dict)
    beliefs: Mapping[str, int] = field(default_factory=dict)

    def described(self) -> str:
        """Return the names for a prompt."""
        kinds = {"goals": self.goals, "actions": self.actions, "beliefs": self.beliefs}
        return "\n".join(
            f"{kind}: {', '.join(f'{name}/{count}' for name, count in sorted(names.items())) or 'none'}"
            for kind, names in kinds.items()
        )


@dataclass(frozen=True)
class PlanLimits:
    """Largest text (characters), plans, steps of a plan, nesting of brackets and of steps, digits of a number.

    ``all_steps`` counts the steps of a goal with those of the plans that it leads to.
    """

    characters: int = 4000
    plans: int = 5
    steps: int = 20
    brackets: int = 12
    depth: int = 3
    digits: int = 15
    all_steps: int = 100


class PlanRefused(RuleError):  # noqa: N818 - a result of a check
    """A proposed plan is not allowed."""


_TERMS = (Variable, Atom, Expression, Comparison, Conjunction, Disjunction, Negation, Truth, Event)
"""Kinds of parts that only compute and compare."""

_STEPS = (Achieve, Ask, Constrain, Do, If)


def checked_plans(text: str, whitelist: Whitelist, limits: PlanLimits | None = None) -> tuple[Plan, ...]:
    """Return the plans of a proposed text.

    Args:
        text: Plans in AgentSpeak.
        whitelist: The names that they may use.
        limits: Limits of their size; default: `PlanLimits`.

    Raises:
        PlanRefused: The text is no list of plans, or uses something that is not allowed.
    """
    limits = limits or PlanLimits()
    if len(text) > limits.characters:
        raise PlanRefused(f"the text has more than {limits.characters} characters")
    if _nesting(text) > limits.brackets:
        raise PlanRefused(f"brackets are nested more than {limits.brackets} deep")
    if any(not (letter.isprintable() or letter in "\n\t\r") for letter in text):
        raise PlanRefused("the text contains control characters")
    if re.search(rf"\d{{{limits.digits + 1}}}", text):
        raise PlanRefused(f"a number has more than {limits.digits} digits")
    try:
        program = parse(text, "proposal")
    except SocialbotError as error:
        raise PlanRefused(f"it is no AgentSpeak: {error.what}") from None
    except (RecursionError, ValueError, OverflowError):
        raise PlanRefused("it is no AgentSpeak") from None
    if program.beliefs or program.goals or program.inferences:
        raise PlanRefused("it contains more than plans: a belief, a goal or a rule")
    if not 0 < len(program.plans) <= limits.plans:
        raise PlanRefused(f"it must contain 1 to {limits.plans} plans (got {len(program.plans)})")
    for plan in program.plans:
        _check(plan, whitelist, limits)
    _check_goals(program.plans, limits)
    return program.plans


def _nesting(text: str) -> int:
    depth = deepest = 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        deepest = max(deepest, depth)
    return deepest


def _check(plan: Plan, whitelist: Whitelist, limits: PlanLimits) -> None:
    event = plan.event
    if event.change is not Change.WANTED or not isinstance(event.literal, Literal):
        raise PlanRefused("a plan is for another event than an added goal (+!goal)")
    _named(event.literal, whitelist.goals, "goal")
    _plain(event.literal)
    if plan.atomic or plan.priority or plan.stage or plan.annotations or plan.inner or plan.until or plan.stepwise:
        raise PlanRefused("a plan has annotations or plans inside it, which are not allowed")
    _conditions(plan.condition, whitelist)
    steps = list(_steps(plan.body, limits.depth))
    if len(steps) > limits.steps:
        raise PlanRefused(f"a plan has more than {limits.steps} steps")
    for step in steps:
        _check_step(step, whitelist)


def _steps(body: tuple[Step, ...], depth: int) -> Iterator[Step]:
    """Yield the steps with those inside them. Raises PlanRefused if they are nested too deep."""
    if depth == 0:
        raise PlanRefused("steps are nested too deep")
    for step in body:
        yield step
        if isinstance(step, If):
            yield from _steps(step.then, depth - 1)
            yield from _steps(step.otherwise, depth - 1)


def _check_step(step: Step, whitelist: Whitelist) -> None:
    match step:
        case Do(action=Literal() as action, limit_s=None):
            _named(action, whitelist.actions, "action")
            _plain(action)
        case Achieve(goal=Literal() as goal, apart=False, limit_s=None):
            _named(goal, whitelist.goals, "goal")
            _plain(goal)
            for value in goal.args:
                _bounded(value)
        case Ask(query=query, marks=()):
            _conditions(query, whitelist)
        case Constrain(condition=condition) | If(condition=condition):
            _conditions(condition, whitelist)
        case _:
            raise PlanRefused(f"the step {str(step)[:60]!r} is of a kind that is not allowed")


def _named(literal: Literal, known: Mapping[str, int], kind: str) -> None:
    name = literal.functor
    if name not in known:
        raise PlanRefused(f"the {kind} {name[:40]!r} is not allowed")
    if len(literal.args) != known[name]:
        raise PlanRefused(f"the {kind} {name} has {known[name]} arguments (got {len(literal.args)})")
    if literal.annotations:
        raise PlanRefused(f"the {kind} {name} has annotations, which are not allowed")


def _plain(literal: Literal) -> None:
    """Check that the arguments are values, variables and arithmetic, and no calls or literals."""
    for part in nodes_of(literal.args)[1:]:
        if not isinstance(part, (*_TERMS, tuple)) or _is_power(part):
            raise PlanRefused(f"the argument {str(part)[:40]!r} of {literal.functor} is not allowed")


def _is_power(part: object) -> bool:
    return isinstance(part, Expression) and part.symbol == "**"


def _bounded(value: object) -> None:
    """Check that a value that a variable may get is not longer than the values that it is made of.

    Otherwise twenty steps such as ``Y = X * X`` fill the memory.
    """
    match value:
        case Expression(symbol="+" | "*", left=left, right=right):
            grows = not isinstance(left, (int, float)) and not isinstance(right, (int, float))
        case Expression():
            grows = _is_power(value)
        case tuple():
            grows = any(isinstance(each, (tuple, Pattern)) and not isinstance(each, Atom) for each in value)
        case Pattern():
            grows = not isinstance(value, (Variable, Atom))
        case _:
            grows = False
    if grows:
        raise PlanRefused(f"{show(value)[:40]!r} may become too long: add or multiply by a number")
    if isinstance(value, Expression):
        _bounded(value.left)
        _bounded(value.right)


def _conditions(condition: object, whitelist: Whitelist) -> None:
    """Check that a condition consists of beliefs that may be tested, and of comparisons."""
    inside: set[int] = set()
    for part in nodes_of(condition):
        if isinstance(part, Literal):
            if id(part) in inside:
                raise PlanRefused(f"the argument {str(part)[:40]!r} of a condition is not allowed")
            _named(part, whitelist.beliefs, "belief")
            inside.update(id(each) for each in nodes_of(part.args)[1:])
        elif isinstance(part, Comparison):
            _bounded(part.left)
            _bounded(part.right)
        elif not isinstance(part, (*_TERMS, tuple)) or _is_power(part):
            raise PlanRefused(f"the condition {str(part)[:40]!r} is not allowed")


def _check_goals(plans: tuple[Plan, ...], limits: PlanLimits) -> None:
    """Check that no goal leads to itself again, and how many steps each takes with those of the goals it leads to."""
    bodies: dict[str, list[list[Step]]] = {}
    for plan in plans:
        bodies.setdefault(str(plan.event.literal.functor), []).append(list(_steps(plan.body, 100)))  # type: ignore[union-attr]
    counts: dict[str, int] = {}

    def count(goal: str, above: tuple[str, ...] = ()) -> int:
        if goal in above:
            raise PlanRefused(f"the plans for {goal} lead to {goal} again, without end")
        if goal not in counts:
            below = (*above, goal)
            counts[goal] = max((sum(1 + of(step, below) for step in body) for body in bodies.get(goal, ())), default=0)
        return counts[goal]

    def of(step: Step, above: tuple[str, ...]) -> int:
        if isinstance(step, Achieve) and isinstance(step.goal, Literal):
            return count(step.goal.functor, above)
        return 0

    # Goals without end first: a sum says less.
    steps = {goal: count(goal) for goal in bodies}
    for goal, number in steps.items():
        if number > limits.all_steps:
            raise PlanRefused(f"the plans for {goal} lead to more than {limits.all_steps} steps")


__all__ = ["PlanLimits", "PlanRefused", "Whitelist", "checked_plans"]
