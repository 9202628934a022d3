"""Checks of the literals in rules: what never happens, numbers of arguments, values, and messages.

Each check raises RuleError with a remedy; the caller adds the rule.
"""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import Belief, Change, Computed, Event, Goal, Literal, Reactor, Structure, check_seconds
from socialbot.bdi.stdlib.actions import registered
from socialbot.bdi.steps import Achieve, Action, AslCall, Do, Update, send, wait
from socialbot.bdi.terms import (
    Aggregate,
    Atom,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Negation,
    Pattern,
    Term,
    names_in,
    show,
)
from socialbot.bdi.trace import log
from socialbot.core.clock import Clock, ManualClock
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.library import Library
    from socialbot.bdi.plans import Inference, Plan


def check_event(event: Event) -> None:
    """Check that an event can happen."""
    literal, change = event.literal, event.change
    if isinstance(literal, Reactor) and change is not Change.ADDED:
        raise RuleError(
            f"{event} never happens: a Reactor is an event only", remedy="react to +event, or make it a Belief"
        )
    if isinstance(literal, Computed):
        raise RuleError(
            f"{event} never happens: a Computed belief is evaluated when it is queried",
            remedy="query it in the condition of another event",
        )
    if getattr(literal, "limit_s", None) is not None:
        raise RuleError(
            f"the time limit of {literal} has no meaning in the head of a plan",
            remedy=f"write {literal}.within(...) in the steps that achieve it",
        )


def check_condition(literal: Literal) -> None:
    """Check a belief in a condition."""
    if any(isinstance(term, Aggregate) for term in literal.args):
        raise RuleError(
            f"{literal} computes over beliefs in its arguments", remedy="write count(condition, N) & belief(N)"
        )
    if isinstance(literal, AslCall):
        if "." not in literal.functor:
            raise RuleError(f"{literal} is an action, not a condition", remedy="make it a step of the body")
        return
    if isinstance(literal, Reactor):
        raise RuleError(
            f"{literal} is never held: a Reactor is an event only",
            remedy=f"react to +{literal}, wait with wait_for(+{literal}), or make it a Belief",
        )
    if isinstance(literal, Computed):
        _check_call(literal, type(literal).solutions)
    check_values(literal)


def check_change(literal: Literal) -> None:
    """Check a belief that a step adds or removes."""
    if isinstance(literal, Computed):
        raise RuleError(f"{literal} is computed, and cannot be added or removed", remedy="make it a Belief")
    check_values(literal)


def check_values(literal: Literal) -> None:
    """Check the arguments of a belief or goal."""
    _check_made(literal)
    for term in literal.args:
        if not isinstance(literal, Structure):  # in AgentSpeak, conditions are terms
            _check_no_condition(term, literal)
        if isinstance(term, type) and issubclass(term, Literal):
            raise RuleError(f"{term.__name__} in {literal} is a class", remedy=f"write {term.__name__}()")
        if isinstance(term, (list, set, dict, bytearray)):
            raise RuleError(f"{term} in {literal} is mutable", remedy="use a tuple; lists of AgentSpeak are tuples")


def _check_made(literal: Literal) -> None:
    if "args" not in vars(literal):
        kind = type(literal)
        raise RuleError(
            f"{kind.__name__}.__init__ does not initialise its base class",
            where=kind.__module__,  # without arguments, its rule has no text
            remedy="leave it out, or begin it with: super().__init__(...), with all arguments",
        )


def mismatch(belief: Literal, patterns: Iterable[Literal]) -> str:
    """Return the reason why none of ``patterns``, the beliefs of a name in rules, matches a belief of this name.

    The reason is the number of arguments, or a string in place of an atom; it is empty if some pattern may match.
    """
    numbers = {len(pattern.args) for pattern in patterns}
    if numbers and len(belief.args) not in numbers:
        wanted = " or ".join(map(str, sorted(numbers)))
        return f"the rules have {belief.functor} with {wanted} argument{'' if numbers == {1} else 's'} only"
    return confused_names(belief, patterns)


def confused_names(belief: Literal, patterns: Iterable[Literal]) -> str:
    """Return an argument that is a string where all ``patterns`` have the atom of this name, or the reverse."""
    found = ""
    for pattern in patterns:
        if len(pattern.args) == len(belief.args):
            pairs = zip(belief.args, pattern.args, strict=True)
            differ = [(a, b) for a, b in pairs if {type(a), type(b)} == {str, Atom} and str(a) == str(b)]
            if not differ:
                return ""
            one, other = map(show, differ[0])
            found = found or f"{one} does not match {other} in the rules: one is a string, one an atom"
    return found


def report_confused_names(plan: Plan, library: Library) -> None:
    """Log beliefs of a plan in AgentSpeak that confuse strings and atoms with those of plans in Python."""
    from socialbot.bdi.plans import beliefs_in  # it imports this module

    for belief in beliefs_in(plan):
        if {str, Atom} & set(map(type, belief.args)):
            others = [other for other in library.patterns(belief.functor) if type(other) is not Structure]
            if why := confused_names(belief, others):
                log().warning("%s: %s: %s", plan.place, belief, why)


Doubt = tuple["Plan | Inference | Literal", str, str, Literal]
"""A rule or an initial goal that may never have an effect, the reason, the remedy, and the literal in question."""


def goals_without_plans(library: Library, initial: Iterable[Literal] = ()) -> Iterator[Doubt]:
    """Yield the goals of plans, and ``initial`` ones, that no plan is for; a plan may still come later."""
    from socialbot.bdi.plans import nodes_of  # it imports this module

    filled = [key for key, trigger in library.triggers.items() if trigger.plans]
    known = {key[2:] for key in filled if key[:2] in (Change.WANTED.value, Change.FAILED.value)}
    if any(not isinstance(plan.event.literal, Literal) for plan in library.general):
        return  # a plan is for every goal
    wanted = [(plan, node.goal) for plan in library for node in nodes_of(plan.body) if isinstance(node, Achieve)]
    for place, goal in (*wanted, *((goal, goal) for goal in initial)):
        if isinstance(goal, Literal) and goal.key not in known:
            alike = sorted(key for key in known if key.rpartition("/")[0] == goal.functor)
            alike = alike or difflib.get_close_matches(goal.key, sorted(known), n=1)
            remedy = f"there are plans for {', '.join(alike)}" if alike else "add one, unless it comes later"
            yield place, f"no plan for the goal {goal.key}", remedy, goal


def actions_not_given(library: Library, known: Collection[str]) -> Iterator[Doubt]:
    """Yield the actions of plans in AgentSpeak that nobody has registered; ``known`` are those of the engine."""
    from socialbot.bdi.plans import nodes_of  # it imports this module

    for plan in library:
        for node in nodes_of(plan.body):
            action = node.action if isinstance(node, Do) else None
            if isinstance(action, Literal) and not isinstance(action, Action) and "." not in action.functor:
                name = action.functor
                if name not in known and registered(name) is None:
                    near = difflib.get_close_matches(name, sorted(known), n=1)
                    remedy = f"did you mean {near[0]}?" if near else "register it with engine.add_action"
                    yield plan, f"there is no action {action.key}", remedy, action


def beliefs_not_given(library: Library, initial: Iterable[Literal]) -> Iterator[Doubt]:
    """Yield the beliefs of rules that the program gives with other numbers of arguments only.

    The environment, or another agent, may still give them.
    """
    from socialbot.bdi.plans import Plan, nodes_of  # it imports this module

    rules = (*library, *(compiled.inference for each in library.inferences.values() for compiled in each))
    added = [node.literal for rule in rules if isinstance(rule, Plan) for node in nodes_of(rule.body)
             if isinstance(node, Update) and "+" in node.sign]  # fmt: skip
    given = {literal.key for literal in (*initial, *added) if isinstance(literal, Literal)}
    for rule in rules:
        used = [*_queried(rule.condition)]
        if isinstance(rule, Plan) and rule.event.change in (Change.ADDED, Change.REMOVED, Change.HELD):
            used += [rule.event.literal] if isinstance(rule.event.literal, Literal) else []
        for belief in used:
            alike = sorted(key for key in given if key.rpartition("/")[0] == belief.functor)
            if alike and belief.key not in given and not library.derives(belief.key):
                yield rule, f"nothing in the program adds {belief.key}", f"it adds {', '.join(alike)}", belief


def _queried(condition: Condition) -> Iterator[Literal]:
    if isinstance(condition, Literal):
        yield condition
    elif isinstance(condition, Negation):
        yield from _queried(condition.condition)
    elif isinstance(condition, (Conjunction, Disjunction)):
        for term in condition.terms:
            yield from _queried(term)


def check_action(action: Action, known: set[str]) -> None:
    """Check the arguments of an action; ``known`` are the variables with a value before it."""
    _check_made(action)
    for term in action.args:
        _check_no_condition(term, action)
        if inspect.isfunction(term) and (names := set(inspect.signature(term).parameters)) and names <= known:
            raise RuleError(
                f"a function of {', '.join(sorted(names))} is an argument of {action.functor}",
                remedy="write compute(function) to pass its result",
            )
        if not isinstance(term, Pattern) and (names := _hidden(term)):
            raise RuleError(
                f"{', '.join(sorted(names))} is inside a mutable value of {action.functor}", remedy="use a tuple"
            )
    kind = type(action)
    _check_call(action, getattr(kind, kind.entry) if kind.function is None else kind.function)
    if isinstance(action, wait):
        _check_wait(action)
    elif isinstance(action, send):
        _check_message(*action.args)


def check_belief(item: object, call: str) -> None:
    """Check the argument of ``engine.believe`` or ``engine.forget``."""
    if isinstance(item, Belief) and not isinstance(item, Computed):
        return
    if isinstance(item, Computed):
        raise RuleError(f"{item} is computed, and cannot be added or removed", remedy="make it a Belief")
    raise RuleError(
        f"{_shown(item)} is not a belief", remedy=_instead(item, "achieve") or f"write engine.{call}(b()) with a Belief"
    )


def check_goal(item: object) -> None:
    """Check the argument of ``engine.achieve``, which has no variables."""
    if isinstance(item, (Goal, Structure)):
        item.check()
        return
    raise RuleError(
        f"{_shown(item)} is not a goal", remedy=_instead(item, "believe") or "write engine.achieve(g()) with a Goal"
    )


def check_running(clock: Clock, who: str) -> None:
    """Check that a clock advances by itself, so that a timer on it is due some time."""
    if isinstance(clock, ManualClock):
        raise RuleError(
            "a ManualClock does not advance by itself, so run() would wait for ever",
            where=who,
            remedy="use a WallClock, or socialbot.testing.run_engine(engine, seconds)",
        )


def _instead(item: object, other: str) -> str:
    if isinstance(item, Event):
        call = {Change.ADDED: "believe", Change.REMOVED: "forget"}.get(item.change, "achieve")
        return f"write engine.{call}({item.literal})"
    if isinstance(item, type):
        return f"write {item.__name__}(), with its arguments"
    if isinstance(item, Action):
        return "write a plan with the action as a step, and achieve its goal"
    return f"write engine.{other}({item})" if isinstance(item, (Belief, Goal)) else ""


def _shown(item: object) -> str:
    return item.__name__ if isinstance(item, type) else repr(item)


def _check_no_condition(term: object, literal: Literal) -> None:
    if isinstance(term, (Comparison, Conjunction, Disjunction, Negation)):
        raise RuleError(f"{term} is not a value, in {literal}", remedy="put conditions before >>, or in when()")


def _check_call(literal: Literal, method: Callable[..., Any]) -> None:
    """Check the number of arguments of a literal against the parameters of its method, without the first one."""
    name = method.__name__
    least, most, text = _arity(method)
    if not least <= len(literal.args) <= most:
        count = len(literal.args)
        raise RuleError(
            f"{literal} has {count} argument{'' if count == 1 else 's'}, which {name}({text}) does not take",
            remedy=f"write {literal.functor}({text})",
        )


@functools.lru_cache(maxsize=1000)
def _arity(method: Callable[..., Any]) -> tuple[int, float, str]:
    """Least and most number of positional arguments after the first one, and these parameters as text."""
    try:
        parameters = list(inspect.signature(method).parameters.values())[1:]
    except (TypeError, ValueError):  # some functions written in C have no signature
        return 0, float("inf"), "..."
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    least = sum(p.default is p.empty for p in positional)
    most = float("inf") if any(p.kind is p.VAR_POSITIONAL for p in parameters) else len(positional)
    return least, most, ", ".join(str(p.replace(annotation=p.empty)) for p in parameters)


def _hidden(value: object) -> set[str]:
    """Variables inside lists, sets and dictionaries."""
    if isinstance(value, dict):
        return _hidden([*value, *value.values()])
    if isinstance(value, (list, set)):
        return set().union(*(names_in(item) | _hidden(item) for item in value))
    return set()


def _check_wait(action: wait) -> None:
    (seconds,) = action.args
    if isinstance(seconds, (Event, Belief)):
        raise RuleError(f"{action} does not wait for a time", remedy=f"write wait_for({seconds})")
    if not isinstance(seconds, Term):
        check_seconds(seconds, "wait")


def _check_message(receiver: object, content: object, performative: object = "tell") -> None:
    from socialbot.bdi._messaging import PERFORMATIVES  # it imports this module

    shown = f"{content!s}"
    for name in receiver if isinstance(receiver, tuple) else (receiver,):
        if not isinstance(name, (str, Atom, Term)):
            raise RuleError(f"{name} is not the name of an agent", remedy=f'write send("bob", {shown})')
    if isinstance(performative, Term):
        return
    act = str(performative)
    if act not in PERFORMATIVES:
        swapped = isinstance(performative, Literal) and isinstance(content, (str, Atom))
        raise RuleError(
            f"{act} is not a performative",
            remedy=f'the content comes first: send(receiver, {act}, "{content}")'
            if swapped
            else f"use one of {', '.join(PERFORMATIVES)}",
        )
    for each in content if isinstance(content, tuple) else (content,):
        _check_content(act, each)


def _check_content(act: str, content: object) -> None:
    if isinstance(content, Term) or act.endswith("How"):
        return
    if isinstance(content, Event):
        raise RuleError(f"{content} is an event, not the content of {act}", remedy=f"write {content.literal}")
    if isinstance(content, type):
        raise RuleError(f"{content.__name__} is a class", remedy=f"write {content.__name__}()")
    wanted = act in ("achieve", "unachieve")
    if wanted and isinstance(content, Belief) and not isinstance(content, Structure):
        raise RuleError(f"{content} is a belief; {act} needs a goal", remedy="make it a Goal, or use tell")
    if not wanted and isinstance(content, Goal):
        raise RuleError(
            f"{content} is a goal; {act} needs a belief", remedy=f'write send(receiver, {content}, "achieve")'
        )
    if not isinstance(content, (Belief, Goal, Atom)):
        raise RuleError(f"{content!r} is not the content of {act}", remedy="send a belief, or a goal with achieve")
