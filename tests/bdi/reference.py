"""Plain reference implementation of the engine.

Plans are looked at as they were written, never compiled. Beliefs are a list, intentions are generators, a failing
goal is an exception. In one turn the agent looks at one event, then makes one step of one intention; intentions
take turns. Annotations are sources only. Nothing here is quick, or knows of stages, limits of goals and the trace.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import Any

from socialbot.bdi import Inference, Plan, Reactor, SingletonBelief
from socialbot.bdi.literals import Event, Literal
from socialbot.bdi.steps import Achieve, Ask, Await, Constrain, Do, For, Forget, If, Step, Update, While
from socialbot.bdi.terms import (
    Atom,
    Comparison,
    Condition,
    Conjunction,
    Disjunction,
    Expression,
    Negation,
    Variable,
    names_in,
)

Args = tuple[Any, ...]
SELF = (Atom("self"),)
"""Who says what the agent itself adds."""

Happened = tuple[str, Args, Args]
"""An event: what it is, its arguments, and the sources that it is about."""


class Cell:
    """A variable: it has a value, or is the same as another one, or neither yet."""

    value: Any = None


Env = dict[str, Cell]


class Failed(Exception):  # noqa: N818 - what it says
    pass


class Wait:
    """Wait of an intention: an event or a condition with its variables, its start and its timeout."""

    def __init__(self, what: Event | Condition, env: Env, limit: int | None) -> None:
        self.what, self.env, self.limit = what, env, limit
        self.missed = False


Body = Generator["int | Wait", None, None]
"""Yields before each step: 0, the seconds to sleep first, or what to wait for."""


class Intention:
    def __init__(self, body: Body) -> None:
        self.body = body
        self.atomic = 0
        self.wait: Wait | None = None
        self.plan: Plan | None = None


def look(term: Any) -> Any:
    """Return the value of a term or cell as far as it is bound."""
    while isinstance(term, Cell) and term.value is not None:
        term = term.value
    return term


def value(term: Any, env: Env) -> Any:
    """The value of a term. Raises Failed if it has none."""
    if isinstance(term, Expression):
        assert term.symbol == "+"
        return value(term.left, env) + value(term.right, env)
    found = look(env.get(term.name) if isinstance(term, Variable) else term)
    if found is None or isinstance(found, Cell):
        raise Failed
    return found


def is_open(term: Any) -> bool:
    """Check whether a variable has no value."""
    found = look(term)
    return found is None or isinstance(found, Cell)


def opened(literal: Literal, env: Env) -> Args:
    """The arguments of a literal, with cells for variables."""
    return tuple(
        arg if not isinstance(arg, Variable) else Cell() if arg.name == "_" else env.setdefault(arg.name, Cell())
        for arg in literal.args
    )


def unify(left: Args, right: Args, bound: list[Cell]) -> bool:
    """Makes arguments equal; what it has bound for that is noted, also when it returns False."""
    for one, other in zip(left, right, strict=True):
        a, b = look(one), look(other)
        if a is b:
            continue
        if isinstance(a, Cell):
            a.value = b
            bound.append(a)
        elif isinstance(b, Cell):
            b.value = a
            bound.append(b)
        elif a != b:
            return False
    return True


def undo(bound: list[Cell], mark: int = 0) -> None:
    for cell in bound[mark:]:
        cell.value = None
    del bound[mark:]


def is_goal_only(plan: Plan | None) -> bool:
    """Check whether a goal is the only step of a plan for an event, which then starts the goal at once."""
    if plan is None or plan.atomic or len(plan.body) != 1:
        return False
    (step,) = plan.body
    return isinstance(step, Achieve) and not step.apart


class Reference:
    def __init__(self, plans: list[Plan], rules: tuple[Inference, ...] = ()) -> None:
        self.plans = sorted(plans, key=lambda plan: -plan.priority)
        self.rules = rules
        self.now = 0
        self.done: list[tuple[Any, ...]] = []
        self.sent: list[tuple[str, Args]] = []
        self.beliefs: list[tuple[str, Args]] = []
        self.sources: dict[tuple[str, Args], Args] = {}
        self.posted: list[tuple[str, Callable[[], None]]] = []
        self.events: list[Happened] = []
        self.reading = False
        self.heard = {plan.event.key for plan in plans}
        self.waiting: list[Intention] = []
        self.ready: list[Intention] = []
        self.asleep: list[tuple[int, Intention]] = []
        self.current: Intention | None = None
        self.atomic: Intention | None = None

    # What is posted

    def believe(self, literal: Literal) -> None:
        self.posted.append(("believe", lambda: self.announce(self.hold(literal, literal.args))))

    def forget(self, literal: Literal) -> None:
        self.posted.append(("forget", lambda: self.forget_all(literal, literal.args)))

    def achieve(self, goal: Literal) -> None:
        self.posted.append(("achieve", lambda: self.events.append((f"+!{goal.key}", goal.args, SELF))))

    def told(self, sender: str, performative: str, literal: Literal) -> None:
        """A message from another agent."""
        self.posted.append(("told", lambda: self.read(sender, performative, literal)))

    def read(self, sender: str, performative: str, literal: Literal) -> None:
        said_by = (Atom(sender),)
        if performative == "tell":
            self.announce(self.hold(literal, literal.args, said_by))
        elif performative == "untell":
            self.unsay(literal.key, self.matching(literal.key, literal.args, said_by)[:1], said_by)
        else:
            self.adopt(self.pursue(f"!{literal.key}", literal.args, said_by))

    def take_in(self) -> None:
        """Everything up to the first message; after a message a turn without one, if there is other work."""
        while self.posted:
            what, happens = self.posted[0]
            if what == "told":
                self.reading = not (self.reading and (self.events or self.ready))
                if not self.reading:
                    return
            self.posted.pop(0)
            happens()
            if what == "told":
                return

    # Turns

    def busy(self) -> bool:
        return bool(self.posted or self.ready or (self.events and self.atomic is None))

    def believed(self) -> dict[str, list[tuple[Args, tuple[str, ...]]]]:
        """The beliefs with their sources."""
        found: dict[str, list[tuple[Args, tuple[str, ...]]]] = {}
        for key, args in self.beliefs:
            found.setdefault(key, []).append((args, tuple(map(str, self.sources[key, args]))))
        return found

    def turn(self) -> None:
        self.take_in()
        while self.asleep and self.asleep[0][0] <= self.now:
            self.wake(self.asleep.pop(0)[1])
        if self.events and self.atomic is None:
            event, args, notes = self.events.pop(0)
            if event.startswith("+!"):
                self.adopt(self.pursue(event[1:], args, notes))
            else:
                alone = not self.ready
                self.adopt(self.react(event, args, notes, last=True))
                if alone and self.ready and is_goal_only(self.ready[0].plan):
                    self.proceed(self.ready.pop())
                self.notice(event, args, notes)
        if self.atomic is None and self.ready:
            self.proceed(self.ready.pop(0))
        elif self.atomic in self.ready:
            assert self.atomic is not None
            self.ready.remove(self.atomic)
            self.proceed(self.atomic)
        for intention in list(self.waiting):
            assert intention.wait is not None
            if isinstance(intention.wait.what, Condition) and self.holds(intention.wait):
                self.go_on(intention)

    # Waits

    def wake(self, intention: Intention) -> None:
        """The time of an intention has come."""
        if intention.wait is not None:
            intention.wait.missed = True
            self.waiting.remove(intention)
            intention.wait = None
            # A missed limit fails the goal at once; the plan for the failure begins in the next turn of the intention.
            self.proceed(intention)
        else:
            self.ready.append(intention)

    def go_on(self, intention: Intention) -> None:
        self.waiting.remove(intention)
        self.asleep = [sleeper for sleeper in self.asleep if sleeper[1] is not intention]
        intention.wait = None
        self.ready.append(intention)

    def notice(self, event: str, args: Args, notes: Args) -> None:
        """Wakes the intentions that wait for this event."""
        for intention in list(self.waiting):
            wait = intention.wait
            assert wait is not None
            if isinstance(wait.what, Event) and wait.what.key == event:
                bound: list[Cell] = []
                literal = wait.what.literal
                if unify(opened(literal, wait.env), args, bound) and self.annotated(literal, wait.env, notes, bound):
                    self.go_on(intention)
                else:
                    undo(bound)

    def holds(self, wait: Wait) -> bool:
        assert isinstance(wait.what, Condition)
        found = self.first(wait.what, wait.env)
        wait.env.update(found or {})
        return found is not None

    def adopt(self, body: Body) -> None:
        self.proceed(Intention(body))

    def proceed(self, intention: Intention) -> None:
        """Makes the step that an intention is ready for, and puts it in line for its next one."""
        self.current = intention
        try:
            pause = next(intention.body)
        except (StopIteration, Failed):
            return
        if isinstance(pause, Wait):
            intention.wait = pause
            self.waiting.append(intention)
            if isinstance(pause.what, Event):
                self.heard.add(pause.what.key)
            if pause.limit is not None:
                self.asleep.append((self.now + pause.limit, intention))
                self.asleep.sort(key=lambda sleeper: sleeper[0])
        elif pause:
            self.asleep.append((self.now + pause, intention))
            self.asleep.sort(key=lambda sleeper: sleeper[0])
        else:
            self.ready.append(intention)

    # Beliefs

    def hold(self, literal: Literal, args: Args, said_by: Args = SELF) -> Happened | None:
        """Believes something; returns the event that this is, if it is one."""
        belief = literal.key, args
        if belief in self.beliefs:
            new = tuple(name for name in said_by if name not in self.sources[belief])
            self.sources[belief] += new
            return (f"+{literal.key}", args, new) if new else None
        if literal.functor in KINDS["singleton"]:
            for key, held in [other for other in self.beliefs if other[0] == literal.key]:
                self.drop(key, held)
        if literal.functor not in KINDS["reactor"]:
            self.beliefs.append(belief)
            self.sources[belief] = said_by
        return f"+{literal.key}", args, said_by

    def drop(self, key: str, args: Args) -> None:
        self.beliefs.remove((key, args))
        self.announce((f"-{key}", args, self.sources.pop((key, args))))

    def unsay(self, key: str, found: list[Args], said_by: Args = SELF) -> None:
        """Takes a source from a belief, and announces that."""
        for args in found:
            self.announce(self.taken(key, args, said_by))

    def taken(self, key: str, args: Args, said_by: Args = SELF) -> Happened:
        """Takes a source from a belief, which ends with its last one; returns the event."""
        belief = key, args
        left = tuple(name for name in self.sources[belief] if name not in said_by)
        self.sources[belief] = left
        if not left:
            self.beliefs.remove(belief)
            del self.sources[belief]
        return f"-{key}", args, said_by

    def matching(self, key: str, args: Args, said_by: Args = ()) -> list[Args]:
        """The matching beliefs with these sources, newest first; binds nothing."""
        found = []
        for held_key, held in reversed(self.beliefs):
            bound: list[Cell] = []
            fits = held_key == key and unify(args, held, bound)
            if fits and set(said_by) <= set(self.sources[held_key, held]):
                found.append(held)
            undo(bound)
        return found

    def forget_all(self, literal: Literal, args: Args) -> None:
        for held in self.matching(literal.key, args):
            self.drop(literal.key, held)

    def announce(self, event: Happened | None) -> None:
        if event is not None and event[0] in self.heard:
            self.events.append(event)

    def annotated(self, literal: Literal, env: Env, notes: Args, bound: list[Cell]) -> bool:
        """Finds each annotation of an event among the sources, the first that fits."""
        return all(any(self.fits(note, env, name, bound) for name in notes) for note in literal.annotations)

    def fits(self, note: object, env: Env, name: object, bound: list[Cell]) -> bool:
        assert isinstance(note, Literal)
        mark = len(bound)
        if unify(opened(note, env), (name,), bound):
            return True
        undo(bound, mark)
        return False

    # Conditions

    def solutions(self, terms: tuple[Condition, ...], env: Env, bound: list[Cell]) -> Iterator[Env]:
        """The ways in which conditions hold. Each binds cells, until the next one is asked for."""
        if not terms:
            yield env
            return
        term, rest = terms[0], terms[1:]
        mark = len(bound)
        if isinstance(term, Conjunction):
            yield from self.solutions(term.terms + rest, env, bound)
        elif isinstance(term, Disjunction):
            for branch in term.terms:
                yield from self.solutions((branch, *rest), dict(env), bound)
        elif isinstance(term, Negation):
            if next(self.solutions((term.condition,), dict(env), bound), None) is None:
                yield from self.solutions(rest, env, bound)
            undo(bound, mark)
        elif isinstance(term, Comparison):
            env = dict(env)
            if self.compare(term, env, bound):
                yield from self.solutions(rest, env, bound)
            undo(bound, mark)
        else:
            assert isinstance(term, Literal)
            args = opened(term, env := dict(env))
            for held in self.matching(term.key, args):
                unify(args, held, bound)
                for _ in self.said(term.annotations, self.sources.get((term.key, held), ()), env, bound):
                    yield from self.solutions(rest, env, bound)
                undo(bound, mark)
            for rule in self.rules:
                own: Env = {}
                if rule.head.key == term.key and unify(opened(rule.head, own), args, bound):
                    for _ in self.solutions((rule.condition,), own, bound):
                        yield from self.solutions(rest, env, bound)
                undo(bound, mark)

    def said(self, notes: Args, names: Args, env: Env, bound: list[Cell]) -> Iterator[None]:
        """The ways in which annotations fit the sources of a belief."""
        if not notes:
            yield None
            return
        mark = len(bound)
        for name in names:
            if self.fits(notes[0], env, name, bound):
                yield from self.said(notes[1:], names, env, bound)
            undo(bound, mark)

    def compare(self, term: Comparison, env: Env, bound: list[Cell]) -> bool:
        if term.symbol == "=":
            left, right = (
                opened(Literal(side), env) if isinstance(side, Variable) else (value(side, env),)
                for side in (term.left, term.right)
            )
            return unify(left, right, bound)
        left, right = value(term.left, env), value(term.right, env)
        return {"<": left < right, "==": left == right, "!=": left != right}[term.symbol]

    def first(self, condition: Condition, env: Env) -> Env | None:
        """The first way in which a condition holds; what it binds stays bound."""
        return next(self.solutions((condition,), env, []), None)

    # Plans

    def choose(self, event: str, args: Args, notes: Args) -> tuple[Plan, Env] | None:
        for plan in self.plans:
            bound: list[Cell] = []
            env: Env = {}
            literal = plan.event.literal
            try:
                fits = plan.event.key == event and unify(opened(literal, env), args, bound)
                if fits and self.annotated(literal, env, notes, bound):
                    for solution in self.solutions((plan.condition,), env, bound):
                        return plan, solution
            except Failed:  # the condition asked for the value of a variable that has none
                pass
            undo(bound)
        return None

    def pursue(self, goal: str, args: Args, notes: Args = SELF) -> Body:
        self.notice(f"+{goal}", args, notes)
        free = [look(arg) for arg in args if is_open(arg)]
        given = args
        try:
            chosen = self.choose(f"+{goal}", args, notes)
            if chosen is None:
                raise Failed
            given = tuple(arg if is_open(arg) else look(arg) for arg in args)
            yield from self.perform(*chosen)
        except Failed:
            undo(free)
            chosen = self.choose(f"-{goal}", given, notes)
            if chosen is None:
                raise
            yield from self.perform(*chosen)

    def react(self, event: str, args: Args, notes: Args, *, last: bool = False) -> Body:
        """The plan for an event; with ``last``, who waits for the event notices it only afterwards."""
        if not last:
            self.notice(event, args, notes)
        chosen = self.choose(event, args, notes)
        if chosen is not None:
            yield from self.perform(*chosen)

    def perform(self, plan: Plan, env: Env) -> Body:
        intention = self.current
        assert intention is not None
        intention.plan = intention.plan or plan
        if plan.atomic:
            intention.atomic += 1
            self.atomic = intention
        try:
            yield from self.steps(plan.body, env)
        finally:
            if plan.atomic:
                intention.atomic -= 1
                self.atomic = intention if intention.atomic else None

    def steps(self, body: tuple[Step, ...], env: Env) -> Body:
        rested = False
        for step in body:
            if not rested:
                yield 0
            rested = isinstance(step, Await) or (
                isinstance(step, Do) and isinstance(step.action, Literal) and step.action.functor == "nap"
            )
            yield from self.step(step, env)

    def step(self, step: Step, env: Env) -> Body:
        """One step; ``env`` gets the variables that it gives values to."""
        if isinstance(step, Do):
            assert isinstance(step.action, Literal)
            sends = step.action.functor == "send"
            args = () if sends else tuple(value(arg, env) for arg in step.action.args)
            if step.action.functor == "nap":
                yield next(iter(args))
            elif step.action.functor == "crash":
                raise Failed
            elif step.action.functor == "send":
                told = step.action.args[1]
                assert isinstance(told, Literal)
                self.sent.append((told.key, tuple(value(arg, env) for arg in told.args)))
            else:
                self.done.append(args)
        elif isinstance(step, Achieve):
            assert isinstance(step.goal, Literal)
            if step.apart:
                args = tuple(
                    Cell() if isinstance(arg, Variable) and is_open(env.get(arg.name)) else value(arg, env)
                    for arg in step.goal.args
                )
                self.events.append((f"+!{step.goal.key}", args, SELF))
            else:
                yield from self.pursue(f"!{step.goal.key}", opened(step.goal, env))
        elif isinstance(step, Ask):
            yield from self.ask(step, env)
        elif isinstance(step, Await):
            assert step.limit_s is None or isinstance(step.limit_s, int)
            wait = Wait(step.what, env, step.limit_s)
            if isinstance(step.what, Condition) and self.holds(wait):
                yield 0
            else:
                yield wait
            if wait.missed:
                raise Failed
        elif isinstance(step, Constrain):
            found = self.first(step.condition, env)
            if found is None:
                raise Failed
            env.update(found)
        elif isinstance(step, Update):
            yield from self.update(step, env)
        elif isinstance(step, Forget):
            self.forget_all(step.literal, opened(step.literal, env))
        elif isinstance(step, If):
            found = self.first(step.condition, env)
            env.update(found or {})
            yield from self.steps(step.otherwise if found is None else step.then, env)
        elif isinstance(step, For):
            for solution in self.copies(step.condition, env):
                yield from self.steps(step.body, solution)
        else:
            assert isinstance(step, While)
            while (found := self.first(step.condition, copy(env))) is not None:
                yield from self.steps(step.body, found)
                yield 0

    def ask(self, step: Ask, env: Env) -> Body:
        found = self.first(step.query, env)  # type: ignore[arg-type]
        if found is not None:
            env.update(found)
            return
        query = step.query
        if not isinstance(query, Literal) or all(plan.event.key != f"+?{query.key}" for plan in self.plans):
            raise Failed
        yield from self.pursue(f"?{query.key}", opened(query, env))
        for name in names_in(query) - {"_"}:
            value(Variable(name), env)

    def update(self, step: Update, env: Env) -> Body:
        literal = step.literal
        assert isinstance(literal, Literal)
        if step.sign in ("-", "--"):
            args = opened(literal, env)
            found = self.matching(literal.key, args, SELF)
            if not found:
                return
            unify(args, found[0], [])
            event = self.taken(literal.key, found[0])
            if step.sign == "--":
                self.announce(event)
                return
            yield from self.react(*event)
            return
        args = tuple(value(arg, env) for arg in literal.args)
        if step.sign == "-+":
            self.unsay(literal.key, self.matching(literal.key, tuple(Cell() for _ in args), SELF)[:1])
        event = self.hold(literal, args)
        if step.sign == "++":
            self.announce(event)
        elif event is not None:
            yield from self.react(*event)

    def copies(self, condition: Condition, env: Env) -> list[Env]:
        """The variables as they are in each solution."""
        bound: list[Cell] = []
        found = [copy(solution) for solution in self.solutions((condition,), dict(env), bound)]
        undo(bound)
        return found


def copy(env: Env) -> Env:
    """The same values in cells of their own; what has none shares a new cell with what was the same before."""
    cells: dict[int, Cell] = {}
    for cell in env.values():
        known = look(cell)
        cells[id(cell)] = cells.setdefault(id(known), Cell()) if isinstance(known, Cell) else _with(known)
    return {name: cells[id(cell)] for name, cell in env.items()}


def _with(known: Any) -> Cell:
    cell = Cell()
    cell.value = known
    return cell


KINDS = {
    "singleton": {kind.functor for kind in SingletonBelief.__subclasses__()},
    "reactor": {kind.functor for kind in Reactor.__subclasses__()},
}
