"""Compile the steps of plan bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from socialbot.bdi.compiler._conditions import (
    COLLECTORS,
    ORDERS,
    agree_as_plans,
    assign,
    dependencies,
    may_be_plans,
    order_test,
    query,
    test_of,
    unpack,
)
from socialbot.bdi.compiler._dynamic import embeds
from socialbot.bdi.compiler._source import CELL, VALUE, Function, Scope, tuple_of
from socialbot.bdi.compiler._terms import build, build_pattern, has_cell, has_value, match, refresh, settled, value
from socialbot.bdi.intentions import MODE, SUBGOAL, TAIL, mode_of
from socialbot.bdi.literals import META, Belief, Event, Goal, Literal, Structure, ground, is_source, literal, source
from socialbot.bdi.plans import Inference, parts_of
from socialbot.bdi.stdlib import called, find
from socialbot.bdi.stdlib.actions import DIRECT
from socialbot.bdi.steps import (
    Achieve,
    Action,
    Ask,
    Await,
    Constrain,
    Do,
    Forget,
    Step,
    Update,
    send,
)  # fmt: skip
from socialbot.bdi.terms import Atom, Comparison, Condition, Conjunction, Expression, Variable, names_in
from socialbot.core.errors import RuleError


def pauses(action: Literal) -> bool:
    """Check whether an internal action can pause; ``.send`` pauses only for an answer."""
    if action.functor == ".send":
        return len(action.args) > 3
    entry = find(action.functor)
    return entry is not None and entry.pauses


def limited(f: Function, pause: str, limit_s: object) -> str:
    return pause if limit_s is None else f"limited({pause}, {value(f, limit_s)})"


def do(f: Function, step: Do) -> str | None:
    """Emit an action; return the local that holds its pause or None, if it can pause."""
    action = step.action
    if not isinstance(action, Literal):
        message = f"{action!s} is a condition, which is no action; write ?({action!s})"
        f.line(f"raise Failed('action_failed', {message!r})", step)
        return None
    if "." in action.functor:
        internal(f, step)
        return None
    r = f.unit.name("r")
    if not isinstance(action, Action) and not settled(f, action):
        # Variables without values are for the results of the action.
        f.line(f"{r} = act(ag, {action.functor!r}, {build(f, action.args)}, c)", step)
        return r
    know(f, action.args, step)
    args = [value(f, arg) for arg in action.args]
    if isinstance(action, send) and len(args) == 2 and isinstance(action.args[1], Belief):
        f.line(f"ag.messaging.tell({args[0]}, {action.args[1].key!r}, {value(f, action.args[1].args)}, c)", step)
        return None
    record = f"if ag.trace.sink is not None: record_action(ag, {action.functor!r}, {tuple_of(args)}, c)"
    if not isinstance(action, Action):
        # The call of a simple function needs no detour.
        found, direct = f.unit.name("t"), f.unit.constant(DIRECT[len(args)])
        arguments = ", ".join(["ag.engine", *args])
        f.line(f"{found} = {direct}.get(ag.engine.actions.get({action.functor!r}))", step)
        f.line(f"if {found} is not None and ag.trace.sink is None: {r} = {found}({arguments})", step)
        f.line(f"else: {r} = act(ag, {action.functor!r}, {tuple_of(args)}, c, True)", step)
    elif action.function is not None:
        f.line(record, step)
        f.line(f"{r} = {f.unit.constant(action.function)}({', '.join(['ag.engine', *args])})", step)
    else:
        f.line(f"{r} = perform(ag, {f.unit.constant(type(action))}, {tuple_of(args)}, c)", step)
    return r


def internal(f: Function, step: Do) -> None:
    action: Any = step.action
    if action.functor == ".wait" and action.args and isinstance(action.args[0], (Event, Condition, Atom)):
        what: Any
        what, *limits = action.args
        if len(limits) > 2:
            raise RuleError(f"{action} takes at most 3 arguments", remedy="see docs/semantics.md")
        limit = Expression("/", limits[0], 1000) if limits else None
        elapsed = limits[1] if len(limits) > 1 else None
        await_(f, Await(literal(what.name) if isinstance(what, Atom) else what, limit), step.limit_s, elapsed)
        return
    if action.functor == ".puts":
        from socialbot.bdi.stdlib.environment import interpolated

        action = interpolated(action)
    if action.functor in COLLECTORS:
        constrain(f, Constrain(action))  # type: ignore[arg-type]
        return
    if (
        action.functor == ".send"
        and len(action.args) == 3
        and action.args[1] is Atom("tell")
        and isinstance(action.args[2], Literal)
        and settled(f, action)
        and not action.args[2].annotations
    ):
        belief: Any
        receiver, _, belief = action.args
        f.line(f"ag.messaging.tell({value(f, receiver)}, {belief.key!r}, {value(f, belief.args)}, c)", step)
        return
    entry = called(action)
    before = set(f.scope)
    r = f.unit.name("r")
    args = build(f, action.args)
    f.line(f"{r} = internal(ag, {f.unit.constant(entry)}, {action.functor!r}, {args}, c)", step)
    if pauses(action):
        f.line(f"yield {limited(f, r, step.limit_s)}", step)
    cells = {name for name in names_in(action) if f.scope.get(name) == CELL}
    f.resolve(cells & before)
    f.resolve(cells - before, VALUE if entry.binds else CELL)


def await_(f: Function, step: Await, limit_s: object = None, elapsed: object = None) -> None:
    """Emit a pause until an event occurs or a condition holds; it fails after ``limit_s``.

    With ``elapsed``, which gets the waiting time in ms, the end of its own limit is no failure.
    """
    if isinstance(step.what, Event) and step.what.change in META:
        raise RuleError(
            f"{step.what} is a meta-event, which cannot be awaited",
            remedy="let a plan for it add a belief, and wait for that",
        )
    timed = "{}" if elapsed is None else f"timed({{}}, {build(f, elapsed)})"
    limit = "None" if step.limit_s is None else value(f, step.limit_s)
    if isinstance(step.what, Event):
        literal = step.what.literal
        if isinstance(literal, Literal):
            args, notes = build(f, literal.args), build(f, literal.annotations)
            pause = f"EventPause({step.what.key!r}, {args}, {notes}, {limit})"
        else:
            change = f.unit.constant(step.what.change)
            pause = f"pause_until({change}, {build(f, literal)}, {limit})"
        f.line(f"yield {limited(f, timed.format(pause), limit_s)}", step)
        refresh(f, names_in(literal))
    else:
        pause, found, states = condition_pause(f, step.what, limit)
        f.line(f"yield {limited(f, timed.format(pause), limit_s)}", step)
        if elapsed is None:
            unpack(f, states, f"{found}[0]")
        else:
            unpack(f, dict.fromkeys(states, CELL), f"{found}[0] if {found} else {tuple_of(['Var()'] * len(states))}")


def condition_pause(f: Function, condition: Condition, limit: str = "None") -> tuple[str, str, Scope]:
    """Return the expression of a pause until a condition holds, the list of its solutions, and their variables."""
    found = f.unit.name("s")
    known = dict(f.scope)
    name, arguments, states = query(f, condition)
    f.line(f"{found} = []")
    cells = tuple_of(f.local(name) for name in sorted(names_in(condition)) if known.get(name) == CELL)
    beliefs = dependencies(f, condition, known)
    pause = f"await_condition(lambda: next({name}({arguments}), None), {found}, {limit}, {beliefs}, {cells})"
    return pause, found, states


def constrain(f: Function, step: Constrain) -> None:
    """Emit a test condition, which fails the body if it does not hold."""
    condition = step.condition
    if isinstance(condition, Conjunction) and len(condition.terms) == 1:
        condition = condition.terms[0]
    reason = "ia_failed" if isinstance(condition, Literal) and "." in condition.functor else "constraint_failed"
    fail = f"raise Failed({reason!r}, {f'{condition} does not hold'!r})"
    if isinstance(condition, Comparison) and condition.symbol == "=":
        left, right = condition.left, condition.right
        if not settled(f, right) and settled(f, left):
            left, right = right, left
        if isinstance(right, Expression):
            know(f, right, step)
        if settled(f, right) and may_be_plans(f, left, right):
            agree_as_plans(f, left, right, fail, step)
            return
        if settled(f, right) and not has_cell(f, left):
            match(f, left, value(f, right), fail, step)
            return
        if settled(f, right) and isinstance(left, Variable):
            assign_cell(f, left, right, fail, step)
            return
    elif isinstance(condition, Comparison) and condition.symbol != "=..":
        if f.unit.lenient and condition.symbol in ORDERS:
            order_test(f, condition, fail, step)
        else:
            if condition.symbol not in ("==", "!="):
                know(f, (condition.left, condition.right), step)
            f.line(f"if not ({test_of(f, condition)}): {fail}", step)
        return
    found, fresh = first(f, condition, step)
    f.line(f"if {found} is None: {fail}", step)
    unpack(f, fresh, found)


def know(f: Function, term: object, step: Step) -> None:
    """Emit the resolution of the variables in a term; an unbound one fails the step."""
    for name in sorted(names_in(term) - {"_"}):
        if f.scope.get(name) == CELL:
            f.line(f"{f.local(name)} = known({f.local(name)})", step)
            f.scope[name] = VALUE


def assign_cell(f: Function, variable: Variable, source: object, fail: str, step: Step) -> None:
    """Emit the unification of a variable with a value, without a call while the variable is unbound."""
    cell, item, mark = f.local(variable.name), f.unit.name("t"), f.unit.name("m")
    f.line(f"{item} = {value(f, source)}", step)
    pattern = build_pattern(f, source) if embeds(source) else item
    with f.block(f"if {cell}.__class__ is Var and {cell}.value is {cell}"):
        f.line(f"{cell}.value = {item}")
    with f.block("else"):
        f.line(f"{mark} = len(trail)")
        with f.block(f"if not unify({cell}, {pattern}, trail)", step):
            f.line(f"undo(trail, {mark})")
            f.line(fail, step)
    f.line(f"{cell} = {item if pattern == item else f'resolve({cell})'}")
    f.scope[variable.name] = VALUE


def first(f: Function, condition: Condition, step: Step, also: Iterable[str] = ()) -> tuple[str, Scope]:
    """Emit the search for the first solution; return its local and its variables."""
    found = f.unit.name("s")
    if isinstance(condition, Conjunction) and len(condition.terms) == 1:
        condition = condition.terms[0]
    if isinstance(condition, Literal) and not also:
        fresh = newest(f, condition, found, step)
        if fresh is not None:
            return found, fresh
    name, arguments, fresh = query(f, condition, also=also, once=True)
    f.line(f"{found} = {name}({arguments})", step)
    return found, fresh


def notes_of(f: Function, literal: Literal) -> str:
    """Return the expression of annotations with source ``self`` by default."""
    if not literal.annotations:
        return "SELF"
    if len(literal.annotations) == 1 and settled(f, literal.annotations):
        (note,) = literal.annotations
        if isinstance(note, Literal) and note.key == "source/1" and not note.annotations:
            make = "source_notes" if isinstance(note, source) else "told_by"
            return f"{make}({value(f, note.args[0])})"
    notes = [value(f, note) if has_value(f, note) else build(f, note) for note in literal.annotations]
    named = any(isinstance(note, Literal) and note.functor == "source" for note in literal.annotations)
    made = tuple_of(notes) if named else f"({', '.join(notes)}, *SELF)"
    return made if len(notes) == 1 or ground(literal.annotations) else f"distinct({made})"


def marked(f: Function, notes: str, marks: tuple[Literal, ...]) -> str:
    """Return the expression of the annotations of an event with the marks that select inner plans."""
    return f"(*{notes}, *{build(f, marks)})" if marks else notes


def update(f: Function, step: Update) -> None:
    """Emit a belief update; except for ``++``, its local r then holds the request for a plan or None."""
    change(f, step)
    if step.marks:
        f.line(f"if r is not None: r = (*r[:3], {marked(f, 'r[3]', step.marks)}, r[4])", step)


def change(f: Function, step: Update) -> None:
    literal, sign = step.literal, step.sign
    if isinstance(literal, Inference):
        f.line(f"r = change_rule(ag, {sign!r}, {build(f, literal)})", step)
        return
    if not isinstance(literal, Literal):
        f.line(f"r = update_of(ag, {sign!r}, {build(f, literal)}, c)", step)
        refresh(f, names_in(literal))
        return
    relation = f.relation(literal.key)
    if sign in ("-", "--"):
        anyones = list(map(str, literal.annotations)) == ["source(_)"]
        if f.unit.library.derives(literal.key):
            args, notes = build(f, literal.args), notes_of(f, literal)
            f.line(f"r = remove_belief(ag, {literal.key!r}, {args}, {notes}, c, {sign == '-'})", step)
            refresh(f, names_in(literal))
            return
        known = settled(f, literal.args) and (anyones or settled(f, literal.annotations))
        args = values(f, literal.args) if known else build(f, literal.args)
        if known and not anyones:
            remove_held(f, step, literal, relation, args)
            return
        notes = "None" if known else notes_of(f, literal)
        method = "remove_known" if known else "remove"
        f.line(f"r = ag.beliefs.{method}({relation}, {args}, {notes}, c, {sign == '-'})", step)
        refresh(f, names_in(literal))
        return
    replaces = sign == "-+" and f.unit.library.derives(literal.key)  # perhaps a belief with variables
    if f.unit.lenient and (replaces or not settled(f, literal.args)):
        args, notes = build(f, literal.args), notes_of(f, literal)
        f.line(f"r = add_belief(ag, {sign!r}, {literal.key!r}, {args}, {notes}, c)", step)
        refresh(f, names_in(literal))
        return
    know(f, literal.args, step)
    args = values(f, literal.args)
    if type(literal) is not Structure:
        f.unit.library.declare(type(literal))
    if sign == "++":
        f.line(f"ag.beliefs.add({relation}, {args}, {notes_of(f, literal)}, c)", step)
    else:
        method = "add_here" if sign == "+" else "replace"
        f.line(f"r = ag.beliefs.{method}({relation}, {args}, {notes_of(f, literal)}, c)", step)


def remove_held(f: Function, step: Update, literal: Literal, relation: str, args: str) -> None:
    """Emit the removal of a belief that is known; the most frequent case, a single source, needs no call."""
    found, known, notes = (f.unit.name("t") for _ in range(3))
    f.line(f"{known} = {args}", step)
    f.line(f"{notes} = {notes_of(f, literal)}", step)
    f.line(f"{found} = {relation}.facts.get({known})", step)
    alone = f"{found} is not None and {found}[1] is {notes}"
    with f.block(f"if {alone} and {relation}.quiet and ag.trace.sink is None"):
        f.line(f"del {relation}.facts[{known}]")
        f.line("r = None")
    f.line(f"else: r = ag.beliefs.remove_known({relation}, {known}, {notes}, c, {step.sign == '-'})", step)


def values(f: Function, args: tuple[object, ...]) -> str:
    """Return the expression of arguments with values; those of the event of the plan exist already."""
    return "args" if f.event is not None and are_same(f, args, f.event) else value(f, args)


def are_same(f: Function, args: tuple[object, ...], event: tuple[object, ...]) -> bool:
    """Check whether arguments are the variables of an event, in their order."""
    return len(args) == len(event) and all(
        isinstance(one, Variable) and isinstance(other, Variable) and one.name == other.name != "_"
        and one.name not in f.unit.symbols
        for one, other in zip(args, event, strict=True)
    )  # fmt: skip


def forget(f: Function, step: Forget) -> None:
    literal = step.literal
    relation = f.relation(literal.key)
    if settled(f, literal) and not literal.annotations:
        args = values(f, literal.args)
        # Without observers no call is needed.
        f.line(f"if {relation}.quiet and ag.trace.sink is None:")
        f.line(f"    {relation}.facts.pop({args}, None)", step)
        f.line(f"else: ag.beliefs.forget_one({relation}, {args}, c)", step)
    else:
        args, notes = build(f, literal.args), build(f, literal.annotations)
        method = "forget_sources" if any(map(is_source, literal.annotations)) else "forget_all"
        f.line(f"ag.beliefs.{method}({relation}, {args}, {notes}, c)", step)


def request(f: Function, step: Achieve, kind: int) -> str:
    goal = step.goal
    if isinstance(goal, Goal):
        f.unit.library.declare(type(goal))
    if not isinstance(goal, Literal):
        return f"goal_of(ag, {build(f, goal)}, c)"
    know(f, [part for arg in goal.args for part in expressions(arg)], step)
    free = unbound(f, goal)
    parts = ", ".join(goal_parts(f, goal))
    if free is not None:
        if any(free) and not f.unit.dry:
            f.unit.library.requested.add((f"+!{goal.key}", mode_of(free) >> MODE))
        return f"({kind | mode_of(free)}, {parts})"
    return f"open_goal(ag, {kind}, {parts})"


def goal_parts(f: Function, goal: Literal) -> tuple[str, str, str, str]:
    """Return the expressions of the trigger, the arguments, the annotations and the record of a goal."""
    return (f"ag.triggers[{f.key('+!' + goal.key)}]", build(f, goal.args), notes_of(f, goal), "c")


def expressions(term: object) -> Iterator[Expression]:
    """Yield the expressions in a term."""
    if isinstance(term, Expression):
        yield term
    for part in parts_of(term):
        yield from expressions(part)


def unbound(f: Function, goal: Literal) -> list[bool] | None:
    """Return which arguments of a goal are new variables, the others being values; None if that is not known."""
    new = [isinstance(arg, Variable) and arg.name not in f.scope for arg in goal.args]
    others = [arg for arg, free in zip(goal.args, new, strict=True) if not free]
    return new if settled(f, tuple(others)) and settled(f, goal.annotations) else None


def achieve(f: Function, step: Achieve, *, last: bool) -> None:
    """Emit a subgoal; ``last`` replaces the goal of the plan."""
    if step.apart:
        if step.limit_s is not None:
            f.line(f"ag.intentions.adopt_within({request(f, step, SUBGOAL)}, {value(f, step.limit_s)})", step)
        elif isinstance(step.goal, Literal) and settled(f, step.goal) and not f.unit.library.watches_goals:
            if isinstance(step.goal, Goal):
                f.unit.library.declare(type(step.goal))
            f.line(f"ag.events.append(({', '.join(goal_parts(f, step.goal))}))", step)
        else:
            f.line(f"adopt_later(ag, {request(f, step, SUBGOAL)})", step)
        return
    goal = step.goal
    tail = last and step.limit_s is None and isinstance(goal, Literal)
    asked = request(f, step, TAIL if tail else SUBGOAL)
    if step.limit_s is not None:
        asked = f"TimedRequest({asked}, {value(f, step.limit_s)})"
    f.line(f"yield {asked}", step)
    refresh(f, names_in(goal))


def ask(f: Function, step: Ask) -> None:
    """Emit a test goal, which matching beliefs or else a plan can satisfy."""
    query_ = step.query
    if not isinstance(query_, Condition):
        f.line(f"yield question_of(ag, {build(f, query_)}, c)", step)
        refresh(f, names_in(query_))
        return
    found, fresh = first(f, query_, step)
    with f.block(f"if {found} is not None"):
        assign(f, fresh, found)
    with f.block("else"):
        if isinstance(query_, Literal) and "." not in query_.functor:
            scope = dict(f.scope)
            args = build(f, query_.args)
            trigger = f"ag.triggers[{f.key('+?' + query_.key)}]"
            notes = marked(f, notes_of(f, query_), step.marks)
            f.line(f"yield question(ag, {trigger}, {args}, {notes}, c)", step)
            for variable in sorted(names_in(query_) - {"_"}):
                if f.scope.get(variable) == CELL:
                    f.line(f"{f.local(variable)} = known({f.local(variable)})", step)
            f.scope = scope
        else:
            f.line(f"raise Failed('test_goal_failed', {f'nothing answers {query_}'!r})", step)
    f.scope.update(fresh)


def newest(f: Function, pattern: Literal, found: str, step: Step) -> Scope | None:
    """Emit the search for a belief whose arguments are all new variables, or all values, in place.

    Returns its new variables; None for other patterns.
    """
    names = [arg.name for arg in pattern.args if isinstance(arg, Variable) and arg.name not in f.scope]
    known = settled(f, pattern)
    every = len(set(names)) == len(pattern.args) and "_" not in names
    annotated = any(isinstance(part, Literal) and part.annotations for part in (pattern, *pattern.args))
    if not (known or every) or annotated or "." in pattern.functor or f.unit.library.derives(pattern.key):
        return None
    relation = f.relation(pattern.key)
    if known:
        f.line(f"{found} = () if {value(f, pattern.args)} in {relation}.facts else None", step)
        return {}
    f.line(f"{found} = next(reversed({relation}.facts), None)", step)
    return dict.fromkeys(names, VALUE)
