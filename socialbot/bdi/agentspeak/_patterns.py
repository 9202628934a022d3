"""Goal patterns: directives such as ``{ begin dg(g) } ... { end }``, which add plans for a goal, as Jason does.

The names are those of Jason: dg (declarative goal), bdg (with backtracking), ebdg (exclusive), bc (blind commitment),
smc (single-minded), rc (relativised), omc (open-minded), mg (maintenance goal), sga (sequenced adoption).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import Change, Literal, Structure, literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.stdlib.registry import opened
from socialbot.bdi.steps import Ask, Step, Update
from socialbot.bdi.terms import Atom, Conjunction, Negation
from socialbot.bdi.unification import unify
from socialbot.core.errors import RuleError

Read = Callable[[str], Plan]
"""Reader of the text of a plan."""

PATTERNS = {
    "dg": (1, 1), "bdg": (1, 1), "ebdg": (1, 1), "bc": (1, 2), "smc": (2, 2), "rc": (2, 2), "omc": (3, 3), "mg": (1, 2),
    "sga": (3, 3),
}  # fmt: skip
"""Goal patterns with their smallest and largest number of arguments."""


@dataclass(frozen=True)
class _Directive:
    """Goal pattern with its arguments, the plans inside, and the reader of further plans."""

    name: str
    args: tuple[object, ...]
    plans: tuple[Plan, ...]
    read: Read

    @property
    def goal(self) -> Structure:
        found: Any = self.args[2] if self.name == "sga" else self.args[0]
        if isinstance(found, Atom):
            return literal(found.name)
        if not isinstance(found, Structure):
            raise RuleError(f"{self.name} expects a goal", remedy=f"write {self.name}(g), for example")
        return found

    def other(self, name: str, args: tuple[object, ...] | None = None) -> list[Plan]:
        """Plans of another pattern for the same goal."""
        return expanded(name, (self.goal,) if args is None else args, self.plans, self.read)

    def add(self, *texts: str) -> list[Plan]:
        return [self.read(text) for text in texts]


def expanded(name: str, args: tuple[object, ...], plans: tuple[Plan, ...], read: Read) -> list[Plan]:
    """Return the plans of a goal pattern.

    Args:
        name: One of `PATTERNS`.
        args: The arguments of the directive.
        plans: The plans inside.
        read: Reads the text of an added plan.

    Raises:
        RuleError: An argument is wrong.
    """
    return _EXPANSIONS[name](_Directive(name, args, plans, read))


def kept(name: str, args: tuple[object, ...]) -> tuple[Literal, ...]:
    """Initial beliefs of a goal pattern: the goal that ``mg`` maintains."""
    return (_Directive(name, args, (), lambda _: NotImplemented).goal,) if name == "mg" else ()


def _declarative(pattern: _Directive) -> list[Plan]:
    goal = agentspeak(pattern.goal)
    plans = [_asking(plan) if _is_for(plan, pattern.goal) else plan for plan in pattern.plans]
    before = pattern.add(f"+!{goal} : {goal}.", f"+!{goal} : .intend({goal}).")
    return [*before, *plans, *pattern.add(f"+{goal} <- .succeed_goal({goal}).")]


def _backtracking(pattern: _Directive) -> list[Plan]:
    goal = agentspeak(pattern.goal)
    return [*pattern.other("dg"), *pattern.add(f"-!{goal} <- !{goal}.")]


def _exclusive(pattern: _Directive) -> list[Plan]:
    goal, number, plans = agentspeak(pattern.goal), 0, []
    for plan in pattern.plans:
        if _is_for(plan, pattern.goal):
            number += 1
            tried = literal("p__f", (number, pattern.goal))
            condition = Conjunction((Negation(tried), *plan.condition.terms))
            plan = replace(plan, condition=condition)
            plan = _asking(plan, Update("+", tried))
        plans.append(plan)
    others = pattern.add(
        f"-!{goal} <- !{goal}.",
        f"+{goal} <- .abolish(p__f(_,{goal})); .succeed_goal({goal}).",
        f"-{goal} <- .abolish(p__f(_,{goal})).",
    )
    return [*pattern.add(f"+!{goal} : {goal}."), *plans, *others]


def _blind(pattern: _Directive) -> list[Plan]:
    goal = agentspeak(pattern.goal)
    return [*_inner(pattern, "bdg"), *pattern.add(f"+!{goal} <- !{goal}.")]


def _maintained(pattern: _Directive) -> list[Plan]:
    goal = agentspeak(pattern.goal)
    return [*_inner(pattern, "bc"), *pattern.add(f"-{goal} <- !{goal}.")]


def _single_minded(pattern: _Directive) -> list[Plan]:
    goal, failure = map(agentspeak, (pattern.goal, pattern.args[1]))
    return [*pattern.other("bc"), *pattern.add(f"+{failure} <- .fail_goal({goal}).")]


def _relativised(pattern: _Directive) -> list[Plan]:
    goal, motivation = map(agentspeak, (pattern.goal, pattern.args[1]))
    return [*pattern.other("bc"), *pattern.add(f"-{motivation} <- .succeed_goal({goal}).")]


def _open_minded(pattern: _Directive) -> list[Plan]:
    goal, failure, motivation = map(agentspeak, (pattern.goal, *pattern.args[1:]))
    added = pattern.add(f"+{failure} <- .drop_intention({goal}).", f"-{motivation} <- .succeed_goal({goal}).")
    return [*pattern.other("bc"), *added]


def _sequenced(pattern: _Directive) -> list[Plan]:
    trigger, context = pattern.args[:2]
    if not isinstance(trigger, str) or not isinstance(context, str):
        raise RuleError("sga expects a trigger and a context as strings", remedy='write sga("+b(X)", "c(X)", g(X))')
    goal = agentspeak(pattern.goal)
    return pattern.add(
        f"{trigger} : not f__l(_) & ({context}) <- !f__g({goal}).",
        f"{trigger} : f__l(_) & ({context}) <- +f__l({goal}).",
        f"+!f__g({goal}) <- +f__l({goal}); !{goal}; -f__l({goal}).",
        f"-!f__g({goal}) <- -f__l({goal}).",
        f"-f__l({goal}) : f__l({goal}) <- !f__g({goal}).",
    )


_EXPANSIONS: dict[str, Callable[[_Directive], list[Plan]]] = {
    "dg": _declarative, "bdg": _backtracking, "ebdg": _exclusive, "bc": _blind, "smc": _single_minded,
    "rc": _relativised, "omc": _open_minded, "mg": _maintained, "sga": _sequenced,
}  # fmt: skip


def _inner(pattern: _Directive, default: str) -> list[Plan]:
    """Plans of the pattern that is the second argument, such as ``bc(g, ebdg(g))``."""
    if len(pattern.args) == 1:
        return pattern.other(default)
    inner = pattern.args[1]
    if not isinstance(inner, Literal) or inner.functor not in PATTERNS:
        raise RuleError(f"{agentspeak(inner)} is not a goal pattern", remedy=f"write {pattern.name}(g, bdg(g))")
    least, most = PATTERNS[inner.functor]
    if not least <= len(inner.args) <= most:
        raise RuleError(
            f"the pattern {inner.functor} takes {least} to {most} arguments", remedy="see docs/semantics.md"
        )
    return pattern.other(inner.functor, inner.args)


def _is_for(plan: Plan, goal: Literal) -> bool:
    """Whether a plan is for a goal, or for a special case of it."""
    head = plan.event.literal
    if plan.event.change is not Change.WANTED or not isinstance(head, Literal) or head.key != goal.key:
        return False
    return unify(opened(head.args), opened(goal.args), [])


def _asking(plan: Plan, *before: Step) -> Plan:
    """Add the question for its goal at the end of a plan, and steps at the begin; its text says them, too."""
    goal: Any = plan.event.literal
    changed = replace(plan, body=(*before, *plan.body, Ask(goal)))
    return replace(changed, text=agentspeak(changed).removesuffix("."))
