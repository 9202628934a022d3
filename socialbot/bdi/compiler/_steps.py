"""Compile the steps of plan bodies: beliefs, goals, questions and control flow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialbot.bdi.compiler._actions import await_, constrain, do, enter, limited, rests
from socialbot.bdi.compiler._conditions import assign, query, unpack
from socialbot.bdi.compiler._source import CELL, VALUE, Function, Scope, Unit, tuple_of
from socialbot.bdi.compiler._terms import build, has_value, refresh, value, values
from socialbot.bdi.intentions import SUBGOAL, TAIL
from socialbot.bdi.literals import Goal, Literal, Structure
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import (
    Achieve,
    Ask,
    Await,
    Constrain,
    Do,
    Enter,
    For,
    Forget,
    Fork,
    If,
    Step,
    Update,
    While,
)  # fmt: skip
from socialbot.bdi.terms import Variable, names_in


def notes_of(f: Function, literal: Literal) -> str:
    """Return the expression of annotations with source ``self`` by default."""
    if not literal.annotations:
        return "SELF"
    notes = [build(f, note) for note in literal.annotations]
    named = any(isinstance(note, Literal) and note.functor == "source" for note in literal.annotations)
    return tuple_of(notes) if named else f"({', '.join(notes)}, *SELF)"


def update(f: Function, step: Update) -> None:
    """Emit a belief update; except for ``++``, its local r then holds a pause or None."""
    literal, sign = step.literal, step.sign
    if isinstance(literal, Variable):
        f.line(f"r = update_of(ag, {sign!r}, {value(f, literal)}, c)", step)
        return
    relation = f.relation(literal.key)
    if sign in ("-", "--"):
        before = set(f.scope)
        known = "_" not in names_in(literal.args) and has_value(f, literal.args)
        if known and _anyones(literal):
            f.line(f"r = ag.beliefs.remove_any({relation}, {values(f, literal.args)}, c, {sign == '-'})", step)
            return
        known = known and "_" not in names_in(literal.annotations) and has_value(f, literal.annotations)
        args = values(f, literal.args) if known else tuple_of([build(f, arg) for arg in literal.args])
        method = "remove_known" if known else "remove"
        f.line(f"r = ag.beliefs.{method}({relation}, {args}, {notes_of(f, literal)}, c, {sign == '-'})", step)
        refresh(f, names_in(literal), before)
        return
    args = values(f, literal.args)
    if type(literal) is not Structure:
        f.unit.library.declare(type(literal))
    if sign == "++":
        f.line(f"ag.beliefs.add({relation}, {args}, {notes_of(f, literal)}, c)", step)
    else:
        method = "add_here" if sign == "+" else "replace"
        f.line(f"r = ag.beliefs.{method}({relation}, {args}, {notes_of(f, literal)}, c)", step)


def forget(f: Function, step: Forget) -> None:
    """Emit the removal of all matching beliefs from any source."""
    literal = step.literal
    relation = f.relation(literal.key)
    if "_" not in names_in(literal) and has_value(f, literal) and not literal.annotations:
        args = values(f, literal.args)
        # Without observers no call is needed.
        f.line(f"if {relation}.quiet and ag.trace.sink is None:")
        f.line(f"    {relation}.facts.pop({args}, None)", step)
        f.line(f"else: ag.beliefs.forget_one({relation}, {args}, c)", step)
    else:
        args = tuple_of([build(f, arg) for arg in literal.args])
        notes = tuple_of([build(f, note) for note in literal.annotations])
        f.line(f"ag.beliefs.forget_all({relation}, {args}, {notes}, c)", step)


def _anyones(literal: Literal) -> bool:
    """Check for the annotation ``[source(_)]``."""
    notes = literal.annotations
    return len(notes) == 1 and isinstance(notes[0], Literal) and str(notes[0]) == "source(_)"


def request(f: Function, step: Achieve, kind: int) -> str:
    """Return the expression of a goal request."""
    goal = step.goal
    if isinstance(goal, Goal):
        f.unit.library.declare(type(goal))
    if isinstance(goal, Variable):
        return f"goal_of(ag, {value(f, goal)}, c)"
    settled = "_" not in names_in(goal) and has_value(f, goal)
    args = values(f, goal.args) if settled else tuple_of([build(f, arg) for arg in goal.args])
    notes = notes_of(f, goal)
    trigger = f"ag.triggers[{'+!' + goal.key!r}]"
    if settled:
        return f"({kind}, {trigger}, {args}, {notes}, c)"
    return f"open_goal(ag, {kind}, {trigger}, {args}, {notes}, c)"


def achieve(f: Function, step: Achieve, *, last: bool) -> None:
    """Emit a subgoal; ``last`` replaces the goal of the plan."""
    if step.apart:
        if isinstance(step.goal, Variable):
            f.line(f"adopt_later(ag, goal_of(ag, {value(f, step.goal)}, c))", step)
        elif step.limit_s is not None:
            f.line(f"ag.intentions.adopt_within({request(f, step, SUBGOAL)}, {value(f, step.limit_s)})", step)
        else:
            f.line(f"adopt_later(ag, {request(f, step, SUBGOAL)})", step)
        return
    goal = step.goal
    tail = last and step.limit_s is None and not isinstance(goal, Variable)
    before = set(f.scope)
    asked = request(f, step, TAIL if tail else SUBGOAL)
    if step.limit_s is not None:
        asked = f"TimedRequest({asked}, {value(f, step.limit_s)})"
    f.line(f"yield {asked}", step)
    refresh(f, names_in(goal), before)


def ask(f: Function, step: Ask) -> None:
    """Emit a test goal, which matching beliefs or else a plan can satisfy."""
    query_ = step.query
    if isinstance(query_, Variable):
        f.line(f"yield question_of(ag, {value(f, query_)}, c)", step)
        return
    name, arguments, fresh = query(f, query_)
    found = f.unit.name("s")
    f.line(f"{found} = next({name}({arguments}), None)", step)
    with f.block(f"if {found} is not None"):
        assign(f, fresh, found)
    with f.block("else"):
        if isinstance(query_, Literal) and "." not in query_.functor:
            scope = dict(f.scope)
            args = tuple_of([build(f, arg) for arg in query_.args])
            trigger = f"ag.triggers[{'+?' + query_.key!r}]"
            f.line(f"yield question(ag, {trigger}, {args}, {notes_of(f, query_)}, c)", step)
            for variable in sorted(names_in(query_) - {"_"}):
                if f.scope[variable] == CELL:
                    f.line(f"{f.local(variable)} = known({f.local(variable)})", step)
            f.scope = scope
        else:
            f.line(f"raise Failed('test_goal_failed', {f'nothing answers {query_}'!r})", step)
    f.scope.update(fresh)


Rest = Callable[[str], str]
"""Statement that passes the rest of an inline body to a generator, which first yields the named pause."""


class Body:
    """Emitter of the body of one plan: in place, or as a generator."""

    def __init__(self, unit: Unit, plan: Plan, scope: Scope) -> None:
        self.unit = unit
        self.plan = plan
        self.scope = scope

    def generator(self) -> str:
        """Emit the body as a generator of engine, cause and variables; return its name."""
        f = self.unit.function("body", ["ag", "c", *(f"v_{name}" for name in self.scope)], self.scope)
        self.write_all(f, self.plan.body)
        f.line("if False: yield")
        return f.name

    def resumable(self) -> str:
        """Emit a generator that resumes at any step, optionally after a pause; return its name."""
        names = sorted(set(self.scope) | _assigned(self.plan.body))
        f = self.unit.function("rest", ["ag", "c", "start", "pause", *(f"v_{n}=None" for n in names)], self.scope)
        with f.block("if pause is not None"):
            f.line("yield pause")
            # After a pause this plan continues; after a plan for an event other intentions run first.
            f.line(f"if start < {len(self.plan.body)} and pause.__class__ is tuple: yield")
        for i, step in enumerate(self.plan.body):
            with f.block(f"if start <= {i}"):
                last = i == len(self.plan.body) - 1
                if not self.write(f, step, last=last) and not last:
                    f.line("yield")
        return f.name

    def write_all(self, f: Function, body: tuple[Step, ...], *, nested: bool = False, begins: bool = False) -> None:
        """Emit steps in order. Before each of them, except an initial one with ``begins``, other intentions run."""
        rested = begins or not nested
        for i, step in enumerate(body):
            if not rested:
                f.line("yield")
            last = i == len(body) - 1
            rested = self.write(f, step, last=last and not nested, closes=last)

    def write_inline(self, f: Function, step: Step, *, last: bool, rest: Rest) -> None:
        """Emit a step of an inline body."""
        if isinstance(step, Achieve) and not step.apart:
            assert last
            f.line(f"return {request(f, step, TAIL)}", step)
        elif isinstance(step, Do):
            pause = do(f, step)
            if pause:
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = outcome(ag, {pause})", step)
                    f.line(f"if {pause} is not None: {rest(pause)}")
        elif isinstance(step, Update) and step.sign in ("+", "-", "-+"):
            update(f, step)
            f.line(f"if r is not None: {rest('r')}", step)
        else:
            self.write(f, step, last=last)

    def write(self, f: Function, step: Step, *, last: bool = False, closes: bool = False) -> bool:
        """Emit a step of a generator; return whether other intentions run before it ends.

        ``last`` marks the final step of the plan, ``closes`` that of a block; other intentions run after each block.
        """
        if isinstance(step, Achieve):
            achieve(f, step, last=last and not self.plan.atomic)
        elif isinstance(step, Do):
            pause = do(f, step)
            if pause:
                within = limited(f, pause, step.limit_s)
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = outcome(ag, {pause})", step)
                if within != pause:
                    f.line(f"if {pause} is not None: {pause} = {within}", step)
                f.line(f"if {pause} is not None: yield {pause}" if last or closes else f"yield {pause}")
                return True
            return rests(step)
        elif isinstance(step, Update):
            update(f, step)
            if step.sign in ("+", "-", "-+"):
                f.line("if r is not None: yield r", step)
        elif isinstance(step, (If, While, For, Fork)):
            BLOCKS[type(step)](self, f, step)
            return rests(step)
        else:
            WRITERS[type(step)](f, step)
            return rests(step)
        return False

    # Control

    def if_(self, f: Function, step: If) -> None:
        name, arguments, fresh = query(f, step.condition)
        found = f.unit.name("s")
        f.line(f"{found} = next({name}({arguments}), None)", step)
        start, scope = len(f.lines), dict(f.scope)
        with f.block(f"if {found} is not None"):
            unpack(f, fresh, found)
            self.write_all(f, step.then, nested=True)
            then = dict(f.scope)
        f.scope = dict(scope)
        if step.otherwise:
            with f.block("else"):
                self.write_all(f, step.otherwise, nested=True)
        other = dict(f.scope)
        # Variables of only one branch may be unbound after the other one.
        half = sorted(then.keys() ^ other.keys())
        f.lines[start:start] = [(f.depth, f"{f.local(n)} = Var({n!r})", None) for n in half]
        f.scope = {
            n: VALUE if then.get(n) == VALUE and other.get(n) == VALUE else CELL for n in then.keys() | other.keys()
        }

    def while_(self, f: Function, step: While) -> None:
        scope = dict(f.scope)
        found = f.unit.name("s")
        cells = self.cells(f, step)
        with f.block("while True"):
            _renew(f, cells)
            name, arguments, fresh = query(f, step.condition, also=cells)
            f.line(f"{found} = next({name}({arguments}), None)", step)
            f.line(f"if {found} is None: break")
            unpack(f, fresh, found)
            self.write_all(f, step.body, nested=True)
            f.line("yield")
        _restore(f, cells)
        f.scope = scope

    def for_(self, f: Function, step: For) -> None:
        scope = dict(f.scope)
        cells = self.cells(f, step)
        _renew(f, cells)
        name, arguments, fresh = query(f, step.condition, also=cells)
        found = f.unit.name("s")
        with f.block(f"for {found} in list({name}({arguments}))", step):
            _renew(f, cells)
            unpack(f, fresh, found)
            self.write_all(f, step.body, nested=True)
        _restore(f, cells)
        f.scope = scope

    def cells(self, f: Function, step: Step) -> dict[str, str]:
        """Save the unbound variables before a loop, since each iteration starts with new ones."""
        cells = {name: f.unit.name("x") for name in sorted(f.scope) if f.scope[name] == CELL}
        for name, cell in cells.items():
            f.line(f"{cell} = {f.local(name)}", step)
        return cells

    def fork(self, f: Function, step: Fork) -> None:
        out = f.unit.name("out")
        f.line(f"{out} = {{}}")
        calls = []
        names = sorted(f.scope)
        found: set[str] = set()
        for branch in step.branches:
            g = self.unit.function("branch", ["ag", "c", "out", *(f.local(n) for n in names)], f.scope)
            self.write_all(g, branch, nested=True, begins=True)
            for name in sorted(g.scope.keys() - f.scope.keys()):
                g.line(f"out[{name!r}] = {g.local(name)}")
                found.add(name)
            g.line("if False: yield")
            calls.append(f"{g.name}({', '.join(['ag', 'c', out, *(f.local(n) for n in names)])})")
        f.line(f"yield ForkPause({tuple_of(calls)}, c, every={step.every})", step)
        for name in sorted(found):
            f.line(f"{f.local(name)} = {out}.get({name!r}) or Var({name!r})")
            f.scope[name] = CELL


def _renew(f: Function, cells: dict[str, str]) -> None:
    for name, cell in cells.items():
        f.line(f"{f.local(name)} = renew({cell})")


def _restore(f: Function, cells: dict[str, str]) -> None:
    for name, cell in cells.items():
        f.line(f"{f.local(name)} = {cell}")


def _assigned(body: tuple[Step, ...]) -> set[str]:
    """Return the variables that a straight body may bind."""
    names: set[str] = set()
    for step in body:
        for part in (getattr(step, field, None) for field in ("goal", "action", "literal", "condition")):
            names |= names_in(part)
    return names - {"_"}


WRITERS: dict[type[Step], Callable[[Function, Any], None]] = {
    Ask: ask,
    Await: await_,
    Constrain: constrain,
    Enter: enter,
    Forget: forget,
}
BLOCKS: dict[type[Step], Callable[[Body, Function, Any], None]] = {
    If: Body.if_,
    While: Body.while_,
    For: Body.for_,
    Fork: Body.fork,
}
