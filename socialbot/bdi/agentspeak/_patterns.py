"""Goal patterns: directives such as ``{ begin dg(g) } ... { end }``, which add plans for a goal, as Jason does.

The names are those of Jason: dg (declarative goal), bdg (with backtracking), ebdg (exclusive), bc (blind commitment),
smc (single-minded), rc (relativised), omc (open-minded), mg (maintenance goal), sga (sequenced adoption).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
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

_EXTENDED: dict[str, tuple[str, tuple[str, ...]]] = {
    "bdg": ("dg", ("-!{0} <- !{0}.",)),
    "bc": ("bdg", ("+!{0} <- !{0}.",)),
    "smc": ("bc", ("+{1} <- .fail_goal({0}).",)),
    "rc": ("bc", ("-{1} <- .succeed_goal({0}).",)),
    "omc": ("bc", ("+{1} <- .drop_intention({0}).", "-{2} <- .succeed_goal({0}).")),
    "mg": ("bc", ("-{0} <- !{0}.",)),
}
"""Patterns with the plans of another one and further plans, whose places are the goal and the other arguments.

An optional second argument names another pattern instead, as in ``bc(g, ebdg(g))``.
"""

_SEQUENCED = (
    "{0} : not f__l(_) & ({1}) <- !f__g({2}).",
    "{0} : f__l(_) & ({1}) <- +f__l({2}).",
    "+!f__g({2}) <- +f__l({2}); !{2}; -f__l({2}).",
    "-!f__g({2}) <- -f__l({2}).",
    "-f__l({2}) : f__l({2}) <- !f__g({2}).",
)
"""Plans of ``sga``; the places are the trigger, the context and the goal."""


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
    if name == "sga":
        trigger, context, _ = args
        if not isinstance(trigger, str) or not isinstance(context, str):
            raise RuleError("sga expects a trigger and a context as strings", remedy='write sga("+b(X)", "c(X)", g(X))')
        goal = agentspeak(_goal(name, args))
        return [read(text.format(trigger, context, goal)) for text in _SEQUENCED]
    wanted = _goal(name, args)
    goal = agentspeak(wanted)
    if name in _EXTENDED:
        base, added = _EXTENDED[name]
        least, most = PATTERNS[name]
        given: tuple[object, ...] = (wanted,)
        if least < len(args) <= most:
            base, given = _inner(name, args[1])
        words = (goal, *map(agentspeak, args[1:]))
        return [*expanded(base, given, plans, read), *(read(text.format(*words)) for text in added)]
    if name == "dg":
        before = [read(f"+!{goal} : {goal}."), read(f"+!{goal} : .intend({goal}).")]
        asking = [_asking(plan) if _is_for(plan, wanted) else plan for plan in plans]
        return [*before, *asking, read(f"+{goal} <- .succeed_goal({goal}).")]
    return _exclusive(wanted, plans, read)


def kept(name: str, args: tuple[object, ...]) -> tuple[Literal, ...]:
    """Initial beliefs of a goal pattern: the goal that ``mg`` maintains."""
    return (_goal(name, args),) if name == "mg" else ()


def _goal(name: str, args: tuple[object, ...]) -> Structure:
    found = args[2] if name == "sga" else args[0]
    if isinstance(found, Atom):
        return literal(found.name)
    if not isinstance(found, Structure):
        raise RuleError(f"{name} expects a goal", remedy=f"write {name}(g), for example")
    return found


def _exclusive(wanted: Structure, plans: tuple[Plan, ...], read: Read) -> list[Plan]:
    """Return the plans of ``ebdg``: each of the plans for the goal is tried once."""
    goal, number, tries = agentspeak(wanted), 0, []
    for plan in plans:
        if _is_for(plan, wanted):
            number += 1
            tried = literal("p__f", (number, wanted))
            plan = replace(plan, condition=Conjunction((Negation(tried), *plan.condition.terms)))
            plan = _asking(plan, Update("+", tried))
        tries.append(plan)
    after = (
        f"-!{goal} <- !{goal}.",
        f"+{goal} <- .abolish(p__f(_,{goal})); .succeed_goal({goal}).",
        f"-{goal} <- .abolish(p__f(_,{goal})).",
    )
    return [read(f"+!{goal} : {goal}."), *tries, *map(read, after)]


def _inner(name: str, pattern: object) -> tuple[str, tuple[object, ...]]:
    """Return the name and the arguments of the pattern that is the second argument of another one."""
    if not isinstance(pattern, Literal) or pattern.functor not in PATTERNS:
        raise RuleError(f"{agentspeak(pattern)} is not a goal pattern", remedy=f"write {name}(g, bdg(g))")
    least, most = PATTERNS[pattern.functor]
    if not least <= len(pattern.args) <= most:
        raise RuleError(
            f"the pattern {pattern.functor} takes {least} to {most} arguments", remedy="see docs/semantics.md"
        )
    return pattern.functor, pattern.args


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
