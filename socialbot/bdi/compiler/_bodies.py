"""Compile plan bodies: sequences of steps, blocks, and the points at which other intentions run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from socialbot.bdi.compiler._conditions import joined_state, query, unpack
from socialbot.bdi.compiler._source import CELL, Function, Scope, Unit, tuple_of
from socialbot.bdi.compiler._steps import (
    achieve,
    ask,
    await_,
    condition_pause,
    constrain,
    do,
    first,
    forget,
    limited,
    pauses,
    request,
    update,
)
from socialbot.bdi.compiler._terms import build, refresh
from socialbot.bdi.intentions import TAIL
from socialbot.bdi.literals import Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.stdlib import find
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
    Scoped,
    Step,
    Update,
    While,
)  # fmt: skip
from socialbot.bdi.terms import Condition, names_in
from socialbot.core.errors import RuleError

WORK = "ag.ready or ag.events or ag.inbox or ag.heap"
"""Expression that tests for work beside the running intention."""

SWITCH = f"if {WORK}: yield"
"""Statement between two steps that lets other intentions run; without any work for them, it costs no switch."""


def straight(body: tuple[Step, ...]) -> bool:
    """Check whether a body runs in place: updates, actions and comparisons with an optional final goal."""
    for i, step in enumerate(body):
        if isinstance(step, Achieve):
            known = isinstance(step.goal, Literal)
            if not step.apart and (i < len(body) - 1 or step.limit_s is not None or not known):
                return False
        elif isinstance(step, Do):
            if not isinstance(step.action, Literal):
                return False
            entry = find(step.action.functor)
            if step.limit_s is not None or pauses(step.action) or (entry is not None and entry.aware):
                return False
        elif not isinstance(step, (Update, Forget, Constrain, Enter)):
            return False
    return True


def rests(step: Step) -> bool:
    """Check whether a step always yields to other intentions before it ends."""
    if isinstance(step, Do):
        return isinstance(step.action, Literal) and pauses(step.action)
    return isinstance(step, (Await, Fork, Scoped))


Rest = Callable[[str], str]
"""Statement that passes the rest of an inline body to a generator, which first yields the named pause."""


class Body:
    """Emitter of the body of one plan: in place, or as a generator.

    ``event`` are the arguments of its event, if the body gets their values.
    """

    def __init__(self, unit: Unit, plan: Plan, scope: Scope, event: tuple[object, ...] | None = None) -> None:
        self.unit = unit
        self.plan = plan
        self.scope = scope
        self.event = event
        self.given = ["ag", "c"] if event is None else ["ag", "c", "args"]
        self.switch = "yield" if plan.stepwise else SWITCH

    def generator(self) -> str:
        """Emit the body as a generator of engine, cause and variables; return its call."""
        names = [f"v_{name}" for name in self.scope]
        f = self.unit.function("body", [*self.given, *names], self.scope)
        f.event = self.event
        self.write_all(f, self.plan.body)
        f.line("if False: yield")
        return f"{f.name}({', '.join([*self.given, *names])})"

    def resumable(self) -> tuple[Function, list[str]]:
        """Begin a generator of the steps after the first; return it and the names of its variables."""
        names = sorted(set(self.scope) | _assigned(self.plan.body))
        f = self.unit.function("rest", [*self.given, "start", "pause", *(f"v_{n}" for n in names)], {})
        f.event = self.event
        return f, names

    def write_rest(self, f: Function, scope: Scope) -> None:
        """Emit the steps after the first, with the variables after it; `f` begins at any step, maybe after a pause."""
        f.scope = dict(scope)
        with f.block("if pause is not None"):
            f.line("yield pause")
            f.line(f"if start == {len(self.plan.body)}: return")
            # After a pause this plan continues; after a plan for an event other intentions run first.
            f.line("if pause.__class__ is tuple: yield")
        *others, last = enumerate(self.plan.body)
        for i, step in others[1:]:
            with f.block(f"if start <= {i}"):
                if not self.write(f, step):
                    f.line(SWITCH)
        if others:
            self.write(f, last[1], last=True)

    def write_all(
        self,
        f: Function,
        body: tuple[Step, ...],
        *,
        nested: bool = False,
        begins: bool = False,
        repeats: bool = False,
    ) -> None:
        """Emit steps in order. Before each of them, except an initial one with ``begins``, other intentions run.

        A body that ``repeats`` ends the turn before its first step in any case, so that turns have an end.
        """
        rested = begins or not nested
        for i, step in enumerate(body):
            if not rested:
                f.line("yield" if repeats and i == 0 else self.switch)
            last = i == len(body) - 1
            rested = self.write(f, step, last=last and not nested, closes=last)

    def write_inline(self, f: Function, step: Step, *, last: bool, rest: Rest) -> None:
        """Emit a step of an inline body."""
        with _placing_errors(step):
            self._write_inline(f, step, last=last, rest=rest)

    def _write_inline(self, f: Function, step: Step, *, last: bool, rest: Rest) -> None:
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
        with _placing_errors(step):
            return self._write(f, step, last=last, closes=closes)

    def _write(self, f: Function, step: Step, *, last: bool, closes: bool) -> bool:
        if isinstance(step, Achieve):
            kept = self.unit.library.keeps_goals and _key(step.goal) != _key(self.plan.event.literal)
            achieve(f, step, last=last and not self.plan.atomic and not kept)
        elif isinstance(step, Do) and not isinstance(step.action, (Literal, Condition)):
            f.line(f"yield run_value(ag, {build(f, step.action)}, c)", step)
            refresh(f, names_in(step.action))
        elif isinstance(step, Do):
            pause = do(f, step)
            if pause:
                within = limited(f, pause, step.limit_s)
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = outcome(ag, {pause})", step)
                    if within != pause:
                        f.line(f"if {pause} is not None: {pause} = {within}", step)
                    if last or closes:
                        f.line(f"if {pause} is not None: yield {pause}")
                if not (last or closes):
                    f.line(f"if {pause} is not None or {WORK}: yield {pause}")
                return True
        elif isinstance(step, Update):
            update(f, step)
            if step.sign in ("+", "-", "-+"):
                f.line("if r is not None: yield r", step)
        elif isinstance(step, Enter):
            f.line(f"ag.enter({step.stage!r}, cause=c)", step)
        elif type(step) in BLOCKS:
            BLOCKS[type(step)](self, f, step)
        else:
            WRITERS[type(step)](f, step)
        return rests(step)

    # Control

    def if_(self, f: Function, step: If) -> None:
        found, fresh = first(f, step.condition, step)
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
        f.scope = {name: joined_state(name, then, other) for name in then.keys() | other.keys()}

    def while_(self, f: Function, step: While) -> None:
        with _own_cells(f, step) as cells, f.block("while True"):
            _renew(f, cells)
            found, fresh = first(f, step.condition, step, also=cells)
            f.line(f"if {found} is None: break")
            unpack(f, fresh, found)
            self.write_all(f, step.body, nested=True)
            f.line("yield")

    def for_(self, f: Function, step: For) -> None:
        with _own_cells(f, step) as cells:
            _renew(f, cells)
            name, arguments, fresh = query(f, step.condition, also=cells)
            found = f.unit.name("s")
            with f.block(f"for {found} in list({name}({arguments}))", step):
                _renew(f, cells)
                unpack(f, fresh, found)
                self.write_all(f, step.body, nested=True, repeats=True)

    def fork(self, f: Function, step: Fork) -> None:
        with self.branches(f, step.branches) as calls:
            f.line(f"yield ForkPause({tuple_of(calls)}, c, every={step.every})", step)

    def scoped(self, f: Function, step: Scoped) -> None:
        with self.branches(f, (step.body,)) as (body,):
            watched = tuple_of(f"({key!r}, {build(f, args)})" for key, args in step.watched)
            rest = f"{body}, c, {build(f, step.mark)}, {watched}"
            if step.until is None:
                f.line(f"yield ScopePause({rest}, None)", step)
            else:
                pause = f.unit.name("p")
                f.line(f"{pause} = {condition_pause(f, step.until)[0]}", step)
                f.line(f"if {pause} is not None: yield ScopePause({rest}, {pause})", step)

    @contextmanager
    def branches(self, f: Function, branches: tuple[tuple[Step, ...], ...]) -> Iterator[list[str]]:
        """Emit bodies that run beside each other; yield the calls, and take over the values that they found."""
        out = f.unit.name("out")
        f.line(f"{out} = {{}}")
        calls = []
        names = sorted(f.scope)
        found: set[str] = set()
        for branch in branches:
            g = self.unit.function("branch", ["ag", "c", "out", *(f.local(n) for n in names)], f.scope)
            self.write_all(g, branch, nested=True, begins=True)
            for name in sorted(g.scope.keys() - f.scope.keys()):
                g.line(f"out[{name!r}] = {g.local(name)}")
                found.add(name)
            g.line("if False: yield")
            calls.append(f"{g.name}({', '.join(['ag', 'c', out, *(f.local(n) for n in names)])})")
        yield calls
        for name in sorted(found):
            f.line(f"{f.local(name)} = {out}[{name!r}] if {name!r} in {out} else Var({name!r})")
            f.scope[name] = CELL


@contextmanager
def _placing_errors(step: Step) -> Iterator[None]:
    try:
        yield
    except RuleError as problem:
        problem.line = problem.line or step.line
        raise


@contextmanager
def _own_cells(f: Function, step: Step) -> Iterator[dict[str, str]]:
    """Save the unbound variables around a loop, since each iteration starts with new ones."""
    scope = dict(f.scope)
    cells = f.save([name for name, state in scope.items() if state == CELL], step)
    yield cells
    for name, cell in cells.items():
        f.line(f"{f.local(name)} = {cell}")
    f.scope = scope


def _renew(f: Function, cells: dict[str, str]) -> None:
    for name, cell in cells.items():
        f.line(f"{f.local(name)} = renew({cell})")


def _key(literal: object) -> str:
    return literal.key if isinstance(literal, Literal) else ""


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
    Forget: forget,
}
BLOCKS: dict[type[Step], Callable[[Body, Function, Any], None]] = {
    If: Body.if_,
    While: Body.while_,
    For: Body.for_,
    Fork: Body.fork,
    Scoped: Body.scoped,
}
