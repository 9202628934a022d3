"""Compile actions, waits and tests of plan bodies, and find the steps that suspend."""

from __future__ import annotations

from typing import Any

from socialbot.bdi.actions import Action
from socialbot.bdi.compiler._conditions import COLLECTORS, arguments_of, query, unpack
from socialbot.bdi.compiler._source import CELL, VALUE, Function, tuple_of
from socialbot.bdi.compiler._terms import build, has_value, match, value, values
from socialbot.bdi.literals import Belief, Event, Literal, literal
from socialbot.bdi.stdlib import find
from socialbot.bdi.steps import Achieve, Await, Constrain, Do, Enter, Forget, Fork, Step, Update, send
from socialbot.bdi.terms import Atom, Comparison, Condition, Expression, Variable, names_in
from socialbot.core.errors import RuleError


def straight(body: tuple[Step, ...]) -> bool:
    """Check whether a body runs in place: updates, actions and comparisons with an optional final goal."""
    for i, step in enumerate(body):
        if isinstance(step, Achieve):
            if not step.apart and (i < len(body) - 1 or step.limit_s is not None or isinstance(step.goal, Variable)):
                return False
        elif isinstance(step, Do):
            entry = find(step.action.functor)
            if step.limit_s is not None or pauses(step.action) or (entry is not None and entry.aware):
                return False
        elif not isinstance(step, (Update, Forget, Constrain, Enter)):
            return False
    return True


def rests(step: Step) -> bool:
    """Check whether a step always yields to other intentions before it ends."""
    if isinstance(step, Do):
        return pauses(step.action)
    return isinstance(step, (Await, Fork))


def pauses(action: Literal) -> bool:
    """Check whether an internal action can pause; ``.send`` pauses only for an answer."""
    if action.functor == ".send":
        return len(action.args) > 3
    entry = find(action.functor)
    return entry is not None and entry.pauses


def limited(f: Function, pause: str, limit_s: object) -> str:
    """Return the expression of a pause with an optional time limit."""
    return pause if limit_s is None else f"limited({pause}, {value(f, limit_s)})"


def do(f: Function, step: Do) -> str | None:
    """Emit an action; return the local that holds its pause or None, if it can pause."""
    action = step.action
    if action.functor.startswith(".") or find(action.functor) is not None:
        return internal(f, step)
    args = [value(f, arg) for arg in action.args]
    if isinstance(action, send) and len(args) == 2 and isinstance(action.args[1], Belief):
        f.line(f"ag.messaging.tell({args[0]}, {content(f, action.args[1])}, c)", step)
        return None
    r = f.unit.name("r")
    record = f"if ag.trace.sink is not None: record_action(ag, {action.functor!r}, {tuple_of(args)}, c)"
    if not isinstance(action, Action):
        f.line(f"{r} = act(ag, {action.functor!r}, {tuple_of(args)}, c)", step)
    elif action.function is not None:
        f.line(record, step)
        f.line(f"{r} = {f.unit.constant(action.function)}({', '.join(['ag.engine', *args])})", step)
    else:
        f.line(f"{r} = perform(ag, {f.unit.constant(type(action))}, {tuple_of(args)}, c)", step)
    return r


def content(f: Function, belief: Literal) -> str:
    """Return the expressions of the content of a belief in a message."""
    return f"{belief.key!r}, {values(f, belief.args)}"


def internal(f: Function, step: Do) -> str | None:
    """Emit an internal action and its pause, if any."""
    action = step.action
    if action.functor == ".wait" and action.args and isinstance(action.args[0], (Event, Condition, Atom)):
        what: Any
        what, *limits = action.args
        if len(limits) > 1:
            raise RuleError(
                f"{action} is given too much", where=f.unit.title, remedy="handle the timeout in a plan for -!g"
            )
        limit = Expression("/", limits[0], 1000) if limits else None
        awaited: Any = literal(what.name) if isinstance(what, Atom) else what
        await_(f, Await(awaited, limit), step.limit_s)
        return None
    if action.functor in COLLECTORS:
        constrain(f, Constrain(action))  # type: ignore[arg-type]
        return None
    if (
        action.functor == ".send"
        and len(action.args) == 3
        and action.args[1] is Atom("tell")
        and isinstance(action.args[2], Literal)
        and "_" not in names_in(action)
        and has_value(f, action)
        and not action.args[2].annotations
    ):
        f.line(f"ag.messaging.tell({value(f, action.args[0])}, {content(f, action.args[2])}, c)", step)
        return None
    entry = find(action.functor)
    if entry is None:
        raise RuleError(
            f"there is no internal action {action.functor}", where=f.unit.title, remedy="see docs/semantics.md"
        )
    before = set(f.scope)
    r = f.unit.name("r")
    f.line(
        f"{r} = internal(ag, {f.unit.constant(entry)}, {action.functor!r}, {arguments_of(f, entry, action)}, c)",
        step,
    )
    if pauses(action):
        f.line(f"yield {limited(f, r, step.limit_s)}", step)
    for name in sorted(names_in(action) - {"_"}):
        if f.scope.get(name) == CELL:
            f.line(f"{f.local(name)} = resolve({f.local(name)})")
            if entry.binds and name not in before:
                f.scope[name] = VALUE
    return None


def await_(f: Function, step: Await, limit_s: object = None) -> None:
    """Emit a pause until an event occurs or a condition holds; it fails after ``limit_s``."""
    limit = "None" if step.limit_s is None else value(f, step.limit_s)
    found = f.unit.name("s")
    if isinstance(step.what, Event):
        literal = step.what.literal
        fresh = names_in(literal) - f.scope.keys() - {"_"}
        args = tuple_of([build(f, arg) for arg in literal.args])
        notes = tuple_of([build(f, note) for note in literal.annotations])
        pause = f"EventPause({step.what.key!r}, {args}, {notes}, {limit})"
        f.line(f"yield {limited(f, pause, limit_s)}", step)
        for name in sorted(fresh):
            f.line(f"{f.local(name)} = resolve({f.local(name)})")
    else:
        name, arguments, fresh_states = query(f, step.what)
        f.line(f"{found} = []")
        pause = f"await_condition(lambda: next({name}({arguments}), None), {found}, {limit})"
        f.line(f"yield {limited(f, pause, limit_s)}", step)
        unpack(f, fresh_states, f"{found}[0]")


def constrain(f: Function, step: Constrain) -> None:
    """Emit a test condition, which fails the body if it does not hold."""
    condition = step.condition
    terms = getattr(condition, "terms", None)
    if terms is not None and len(terms) == 1:
        condition = terms[0]
    fail = f"raise Failed('constraint_failed', {f'{condition} does not hold'!r})"
    if isinstance(condition, Comparison) and condition.symbol == "=":
        left, right = condition.left, condition.right
        if "_" not in names_in(right) and has_value(f, right):
            match(f, left, value(f, right), fail, step)
            return
    elif isinstance(condition, Comparison) and condition.symbol != "=..":
        f.line(f"if not {value(f, condition.left)} {condition.symbol} {value(f, condition.right)}: {fail}", step)
        return
    first(f, condition, fail, step)


def first(f: Function, condition: Condition, fail: str, step: Step) -> None:
    """Emit the bindings of the first solution of a condition."""
    name, arguments, fresh = query(f, condition)
    found = f.unit.name("s")
    f.line(f"{found} = next({name}({arguments}), None)", step)
    f.line(f"if {found} is None: {fail}", step)
    unpack(f, fresh, found)


def enter(f: Function, step: Enter) -> None:
    """Emit a change of stage."""
    f.line(f"ag.enter({step.stage!r}, cause=c)", step)
