"""Steps of bodies in generated code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialbot.bdi.actions import Action
from socialbot.bdi.compiler.conditions import COLLECTORS, arguments_of, query, unpack
from socialbot.bdi.compiler.runtime import SUBGOAL, TAIL
from socialbot.bdi.compiler.source import CELL, VALUE, Function, Scope, Unit, tuple_of
from socialbot.bdi.compiler.terms import build, has_value, match, value, values
from socialbot.bdi.conditions import Condition
from socialbot.bdi.events import Event
from socialbot.bdi.internals import find
from socialbot.bdi.literals import Belief, Goal, Literal, Structure, literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.speech_acts import send
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
from socialbot.bdi.terms import Atom, Comparison, Expression, Variable, names_in
from socialbot.errors import RuleError

Rest = Callable[[str], str]
"""The statement that hands the rest of an inline body over to a generator, which first yields what is named."""


def straight(body: tuple[Step, ...]) -> bool:
    """Whether a body can run in place: changes, actions and comparisons, perhaps with a goal at the end."""
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
    """Whether a step, other than an `Action`, rests: others have their turn before it ends."""
    if isinstance(step, Do):
        return pauses(step.action)
    return isinstance(step, (Await, Fork))


def pauses(action: Literal) -> bool:
    """Whether an internal action may have to wait. What is sent does not, unless an answer is waited for."""
    if action.functor == ".send":
        return len(action.args) > 3
    entry = find(action.functor)
    return entry is not None and entry.pauses


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
            f.line(f"return {self.request(f, step, TAIL)}", step)
        elif isinstance(step, Do):
            pause = self.do(f, step)
            if pause:
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = ag.outcome({pause})", step)
                    f.line(f"if {pause} is not None: {rest(pause)}")
        elif isinstance(step, Update) and step.sign in ("+", "-", "-+"):
            self.update(f, step)
            f.line(f"if r is not None: {rest('r')}", step)
        else:
            self.write(f, step, last=last)

    def write(self, f: Function, step: Step, *, last: bool = False, closes: bool = False) -> bool:
        """Writes a step of a generator; returns whether others have had a turn when it has ended.

        ``last`` is the last step of the plan, ``closes`` that of a block: who comes after a block lets others go first.
        """
        if isinstance(step, Achieve):
            self.achieve(f, step, last=last)
        elif isinstance(step, Do):
            pause = self.do(f, step)
            if pause:
                limited = _limited(f, pause, step.limit_s)
                with f.block(f"if {pause} is not None"):
                    f.line(f"{pause} = ag.outcome({pause})", step)
                if limited != pause:
                    f.line(f"if {pause} is not None: {pause} = {limited}", step)
                f.line(f"if {pause} is not None: yield {pause}" if last or closes else f"yield {pause}")
                return True
            return rests(step)
        elif isinstance(step, Update):
            self.update(f, step)
            if step.sign in ("+", "-", "-+"):
                f.line("if r is not None: yield r", step)
        else:
            WRITERS[type(step)](self, f, step)
            return rests(step)
        return False

    # Goals

    def request(self, f: Function, step: Achieve, kind: int) -> str:
        """The expression that asks for a goal."""
        goal = step.goal
        if isinstance(goal, Goal):
            f.unit.library.declare(type(goal))
        if isinstance(goal, Variable):
            return f"ag.goal_of({value(f, goal)}, c)"
        settled = "_" not in names_in(goal) and has_value(f, goal)
        args = values(f, goal.args) if settled else tuple_of([build(f, arg) for arg in goal.args])
        notes = self.notes(f, goal)
        trigger = f"ag.triggers[{'+!' + goal.key!r}]"
        if settled:
            return f"({kind}, {trigger}, {args}, {notes}, c)"
        return f"ag.open_goal({kind}, {trigger}, {args}, {notes}, c)"

    def achieve(self, f: Function, step: Achieve, *, last: bool) -> None:
        if step.apart:
            if isinstance(step.goal, Variable):
                f.line(f"ag.adopt_term({value(f, step.goal)}, c)", step)
            elif step.limit_s is not None:
                f.line(f"ag.adopt_within({self.request(f, step, SUBGOAL)}, {value(f, step.limit_s)})", step)
            else:
                f.line(f"ag.adopt_later({self.request(f, step, SUBGOAL)})", step)
            return
        goal = step.goal
        tail = last and step.limit_s is None and not isinstance(goal, Variable) and not self.plan.atomic
        before = set(f.scope)
        request = self.request(f, step, TAIL if tail else SUBGOAL)
        if step.limit_s is not None:
            request = f"ag.timed({request}, {value(f, step.limit_s)})"
        f.line(f"yield {request}", step)
        self.settle(f, names_in(goal), before)

    def settle(self, f: Function, names: set[str], before: set[str]) -> None:
        """Writes that variables got values, perhaps, while the body rested."""
        for name in sorted(names - {"_"}):
            if f.scope.get(name) == CELL or name not in before:
                f.line(f"{f.local(name)} = resolve({f.local(name)})")

    def ask(self, f: Function, step: Ask) -> None:
        query_ = step.query
        if isinstance(query_, Variable):
            f.line(f"yield ag.question_of({value(f, query_)}, c)", step)
            return
        name, arguments, fresh = query(f, query_)
        found = f.unit.name("s")
        f.line(f"{found} = next({name}({arguments}), None)", step)
        with f.block(f"if {found} is not None"):
            _unpack(f, fresh, found)
        with f.block("else"):
            if isinstance(query_, Literal) and "." not in query_.functor:
                scope = dict(f.scope)
                args = tuple_of([build(f, arg) for arg in query_.args])
                trigger = f"ag.triggers[{'+?' + query_.key!r}]"
                f.line(f"yield ag.question({trigger}, {args}, {self.notes(f, query_)}, c)", step)
                for variable in sorted(names_in(query_) - {"_"}):
                    if f.scope[variable] == CELL:
                        f.line(f"{f.local(variable)} = known({f.local(variable)})", step)
                f.scope = scope
            else:
                f.line(f"raise Failed('test_goal_failed', {f'nothing answers {query_}'!r})", step)
        f.scope.update(fresh)

    # Beliefs

    def notes(self, f: Function, literal: Literal) -> str:
        """The expression of the annotations of what the agent itself says."""
        if not literal.annotations:
            return "SELF"
        notes = [build(f, note) for note in literal.annotations]
        named = any(isinstance(note, Literal) and note.functor == "source" for note in literal.annotations)
        return tuple_of(notes) if named else f"({', '.join(notes)}, *SELF)"

    def update(self, f: Function, step: Update) -> None:
        literal, sign = step.literal, step.sign
        if isinstance(literal, Variable):
            f.line(f"r = ag.update_of({sign!r}, {value(f, literal)}, c)", step)
            return
        relation = f.relation(literal.key)
        if sign in ("-", "--"):
            before = set(f.scope)
            known = "_" not in names_in(literal.args) and has_value(f, literal.args)
            if known and _anyones(literal):
                f.line(f"r = ag.remove_any({relation}, {values(f, literal.args)}, c, {sign == '-'})", step)
                return
            known = known and "_" not in names_in(literal.annotations) and has_value(f, literal.annotations)
            args = values(f, literal.args) if known else tuple_of([build(f, arg) for arg in literal.args])
            method = "remove_known" if known else "remove"
            f.line(f"r = ag.{method}({relation}, {args}, {self.notes(f, literal)}, c, {sign == '-'})", step)
            self.settle(f, names_in(literal), before)
            return
        args = values(f, literal.args)
        if type(literal) is not Structure:
            f.unit.library.declare(type(literal))
        if sign == "++":
            f.line(f"ag.add({relation}, {args}, {self.notes(f, literal)}, c)", step)
        else:
            method = "add_here" if sign == "+" else "replace"
            f.line(f"r = ag.{method}({relation}, {args}, {self.notes(f, literal)}, c)", step)

    def forget(self, f: Function, step: Forget) -> None:
        literal = step.literal
        relation = f.relation(literal.key)
        if "_" not in names_in(literal) and has_value(f, literal) and not literal.annotations:
            args = values(f, literal.args)
            # Nobody has to know: no call.
            f.line(f"if {relation}.quiet and ag.sink is None:")
            f.line(f"    {relation}.facts.pop({args}, None)", step)
            f.line(f"else: ag.forget_one({relation}, {args}, c)", step)
        else:
            args = tuple_of([build(f, arg) for arg in literal.args])
            notes = tuple_of([build(f, note) for note in literal.annotations])
            f.line(f"ag.forget_all({relation}, {args}, {notes}, c)", step)

    # Actions

    def do(self, f: Function, step: Do) -> str | None:
        """Writes an action; returns the local that then holds its pause or None, if it can have one."""
        action = step.action
        if action.functor.startswith(".") or find(action.functor) is not None:
            return self.internal(f, step)
        args = [value(f, arg) for arg in action.args]
        if isinstance(action, send) and len(args) == 2 and isinstance(action.args[1], Belief):
            f.line(f"ag.tell({args[0]}, {self.content(f, action.args[1])}, c)", step)
            return None
        r = f.unit.name("r")
        record = f"if ag.sink is not None: ag.acting({action.functor!r}, {tuple_of(args)}, c)"
        if not isinstance(action, Action):
            f.line(f"{r} = ag.act({action.functor!r}, {tuple_of(args)}, c)", step)
        elif action.function is not None:
            f.line(record, step)
            f.line(f"{r} = {f.unit.constant(action.function)}({', '.join(['ag', *args])})", step)
        else:
            f.line(f"{r} = ag.perform({f.unit.constant(type(action))}, {tuple_of(args)}, c)", step)
        return r

    def content(self, f: Function, belief: Literal) -> str:
        return f"{belief.key!r}, {values(f, belief.args)}"

    def internal(self, f: Function, step: Do) -> str | None:
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
            self.await_(f, Await(awaited, limit), step.limit_s)
            return None
        if action.functor in COLLECTORS:
            self.constrain(f, Constrain(action))  # type: ignore[arg-type]
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
            f.line(f"ag.tell({value(f, action.args[0])}, {self.content(f, action.args[2])}, c)", step)
            return None
        entry = find(action.functor)
        if entry is None:
            raise RuleError(
                f"there is no internal action {action.functor}", where=f.unit.title, remedy="see docs/semantics.md"
            )
        before = set(f.scope)
        r = f.unit.name("r")
        f.line(
            f"{r} = ag.internal({f.unit.constant(entry)}, {action.functor!r}, {arguments_of(f, entry, action)}, c)",
            step,
        )
        if pauses(action):
            f.line(f"yield {_limited(f, r, step.limit_s)}", step)
        for name in sorted(names_in(action) - {"_"}):
            if f.scope.get(name) == CELL:
                f.line(f"{f.local(name)} = resolve({f.local(name)})")
                if entry.binds and name not in before:
                    f.scope[name] = VALUE
        return None

    # Conditions

    def constrain(self, f: Function, step: Constrain) -> None:
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
        self.first(f, condition, fail, step)

    def first(self, f: Function, condition: Condition, fail: str, step: Step) -> None:
        """Writes that the first solution of a condition is taken."""
        name, arguments, fresh = query(f, condition)
        found = f.unit.name("s")
        f.line(f"{found} = next({name}({arguments}), None)", step)
        f.line(f"if {found} is None: {fail}", step)
        unpack(f, fresh, found)

    def enter(self, f: Function, step: Enter) -> None:
        f.line(f"ag.enter({step.stage!r}, cause=c)", step)

    # Control

    def if_(self, f: Function, step: If) -> None:
        name, arguments, fresh = query(f, step.condition)
        found = f.unit.name("s")
        f.line(f"{found} = next({name}({arguments}), None)", step)
        start, scope = len(f.lines), dict(f.scope)
        with f.block(f"if {found} is not None"):
            _unpack(f, fresh, found)
            f.scope.update(fresh)
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
            _unpack(f, fresh, found)
            f.scope.update(fresh)
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
            _unpack(f, fresh, found)
            f.scope.update(fresh)
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

    def await_(self, f: Function, step: Await, limit_s: object = None) -> None:
        limit = "None" if step.limit_s is None else value(f, step.limit_s)
        found = f.unit.name("s")
        if isinstance(step.what, Event):
            literal = step.what.literal
            fresh = names_in(literal) - f.scope.keys() - {"_"}
            args = tuple_of([build(f, arg) for arg in literal.args])
            notes = tuple_of([build(f, note) for note in literal.annotations])
            pause = f"ag.await_event({step.what.key!r}, {args}, {notes}, {limit})"
            f.line(f"yield {_limited(f, pause, limit_s)}", step)
            for name in sorted(fresh):
                f.line(f"{f.local(name)} = resolve({f.local(name)})")
        else:
            name, arguments, fresh_states = query(f, step.what)
            f.line(f"{found} = []")
            pause = f"ag.await_condition(lambda: next({name}({arguments}), None), {found}, {limit})"
            f.line(f"yield {_limited(f, pause, limit_s)}", step)
            unpack(f, fresh_states, f"{found}[0]")


def _limited(f: Function, pause: str, limit_s: object) -> str:
    return pause if limit_s is None else f"ag.limited({pause}, {value(f, limit_s)})"


def _anyones(literal: Literal) -> bool:
    """Whether a belief is told by ``[source(_)]``."""
    notes = literal.annotations
    return len(notes) == 1 and isinstance(notes[0], Literal) and str(notes[0]) == "source(_)"


def _unpack(f: Function, fresh: Scope, found: str) -> None:
    if fresh:
        f.line(f"{tuple_of(f.local(name) for name in fresh)} = {found}")


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


WRITERS: dict[type[Step], Callable[[Body, Function, Step], None]] = {
    Ask: Body.ask,
    Constrain: Body.constrain,
    Forget: Body.forget,
    Enter: Body.enter,
    If: Body.if_,
    While: Body.while_,
    For: Body.for_,
    Fork: Body.fork,
    Await: Body.await_,
}  # type: ignore[assignment]
