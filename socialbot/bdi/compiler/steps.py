"""Steps of bodies in generated code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialbot.bdi.compiler.actions import await_, constrain, do, enter
from socialbot.bdi.compiler.beliefs import forget, update
from socialbot.bdi.compiler.conditions import query, unpack
from socialbot.bdi.compiler.goals import achieve, ask, request
from socialbot.bdi.compiler.pauses import limited, rests
from socialbot.bdi.compiler.runtime import TAIL
from socialbot.bdi.compiler.source import CELL, VALUE, Function, Scope, Unit, tuple_of
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
from socialbot.bdi.terms import names_in

Rest = Callable[[str], str]
"""The statement that hands the rest of an inline body over to a generator, which first yields what is named."""


class Body:
    """Writes the body of one plan: in place, or as a generator."""

    def __init__(self, unit: Unit, plan: Plan, scope: Scope) -> None:
        self.unit = unit
        self.plan = plan
        self.scope = scope

    def generator(self) -> str:
        """Writes the generator; returns its name. Its parameters are the engine, the cause and the variables."""
        f = self.unit.function("body", ["ag", "c", *(f"v_{name}" for name in self.scope)], self.scope)
        self.write_all(f, self.plan.body)
        f.line("if False: yield")
        return f.name

    def resumable(self) -> str:
        """Writes the generator that goes on with any step, after a pause perhaps; returns its name."""
        names = sorted(set(self.scope) | _assigned(self.plan.body))
        f = self.unit.function("rest", ["ag", "c", "start", "pause", *(f"v_{n}=None" for n in names)], self.scope)
        with f.block("if pause is not None"):
            f.line("yield pause")
            # After a rest it is this plan's turn; after a plan for an event others have theirs first.
            f.line(f"if start < {len(self.plan.body)} and pause.__class__ is tuple: yield")
        for i, step in enumerate(self.plan.body):
            with f.block(f"if start <= {i}"):
                last = i == len(self.plan.body) - 1
                if not self.write(f, step, last=last) and not last:
                    f.line("yield")
        return f.name

    def write_all(self, f: Function, body: tuple[Step, ...], *, nested: bool = False, begins: bool = False) -> None:
        """Writes steps one after the other; before each of them (but one that begins it all) others have their turn."""
        rested = begins or not nested
        for i, step in enumerate(body):
            if not rested:
                f.line("yield")
            last = i == len(body) - 1
            rested = self.write(f, step, last=last and not nested, closes=last)

    def write_inline(self, f: Function, step: Step, *, last: bool, rest: Rest) -> None:
        """Writes a step of a body that runs in place."""
        if isinstance(step, Achieve) and not step.apart:
            assert last
            f.line(f"return {request(f, step, TAIL)}", step)
        elif isinstance(step, Do):
            pause = do(f, step)
            if pause:
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = ag.outcome({pause})", step)
                    f.line(f"if {pause} is not None: {rest(pause)}")
        elif isinstance(step, Update) and step.sign in ("+", "-", "-+"):
            update(f, step)
            f.line(f"if r is not None: {rest('r')}", step)
        else:
            self.write(f, step, last=last)

    def write(self, f: Function, step: Step, *, last: bool = False, closes: bool = False) -> bool:
        """Writes a step of a generator; returns whether others have had a turn when it has ended.

        ``last`` is the last step of the plan, ``closes`` that of a block: who comes after a block lets others go first.
        """
        if isinstance(step, Achieve):
            achieve(f, step, last=last and not self.plan.atomic)
        elif isinstance(step, Do):
            pause = do(f, step)
            if pause:
                within = limited(f, pause, step.limit_s)
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = ag.outcome({pause})", step)
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
        # What only one branch gives a value to is a variable after the other one.
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
        """Keeps the variables that may have no value before a loop, as each turn begins without one again."""
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
        f.line(f"yield ag.fork({step.every}, {tuple_of(calls)}, c)", step)
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
    """The variables that the steps of a straight body may give values to."""
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
