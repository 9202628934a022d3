"""Independent check of an agent's trace against its PDDL domain.

The check shares no code with planning and execution. It parses and evaluates the PDDL subset of the warehouse domains,
and derives beliefs from the records alone. These are violations:

* a step begins although a condition at its start, or one over all, does not hold; a step that takes the place of
  another one of the same action may begin as if that one had not begun, if both have the same effects at start;
* a step begins during an equal or conflicting step, by its effects at start or its conditions over all;
* a step begins during a sensor timeout;
* a step succeeds although a condition over all was false for long, one at its end never held, or an effect is missing;
* a step changes a belief without such an effect, or twice; or it reverts a change of another one.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from socialbot.core.clock import SECOND

GAP_S = 3.0
"""Longest apparent gap (s) of a condition over all: sensors flicker, and report steps late."""
GIVE_UP_S = 28.0
"""Silence of a sensor, less its deadline, after which steps that do not need it may begin."""

Expression = str | list["Expression"]
Key = tuple[str, ...]
"""Predicate or function with its objects."""
Value = bool | float | None
"""Truth of a predicate, or value of a function (None if undefined)."""
Edit = tuple[Key, Value]


class Record(Protocol):
    """Interface of trace records."""

    @property
    def stamp(self) -> int: ...
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def what(self) -> str: ...
    @property
    def cause(self) -> str: ...
    @property
    def detail(self) -> Mapping[str, object]: ...


@dataclass(frozen=True)
class Violation:
    """Violation by a step, with its time (s)."""

    time_s: float
    step: str
    what: str

    def __str__(self) -> str:
        return f"{self.time_s:.2f} s: {self.step} {self.what}"


# Domain


@dataclass(frozen=True)
class Action:
    """Action of the domain, lifted or ground; times are start, all and end."""

    parameters: tuple[str, ...]
    duration: Expression
    conditions: tuple[tuple[str, Expression], ...]
    effects: tuple[tuple[str, Expression], ...]

    def of(self, objects: tuple[str, ...]) -> Action:
        """Return the ground action with these objects."""
        binding = dict(zip(self.parameters, objects, strict=True))
        binding["?duration"] = _text_of(_put(self.duration, binding))
        conditions = tuple((when, _put(what, binding)) for when, what in self.conditions)
        effects = tuple((when, _put(what, binding)) for when, what in self.effects)
        return Action((), binding["?duration"], conditions, effects)

    def needs(self, *times: str) -> Iterator[Expression]:
        """Yield the conditions at some times."""
        return (what for when, what in self.conditions if when in times)


def read_actions(text: str) -> dict[str, Action]:
    """Return the actions of a domain by name.

    Raises:
        ValueError: The domain needs unsupported PDDL.
    """
    tokens = iter(re.findall(r"[()]|[^\s()]+", re.sub(r";[^\n]*", "", text).lower()))
    if next(tokens, "") != "(":
        raise ValueError("no PDDL")
    actions = {}
    for part in _rest(tokens):
        if isinstance(part, list) and part and part[0] in (":durative-action", ":action"):
            name = _text_of(part[1])
            body = {_text_of(key): value for key, value in zip(part[2::2], part[3::2], strict=True)}
            names = tuple(word for word in map(_text_of, body[":parameters"]) if word.startswith("?"))
            if part[0] == ":action":
                conditions = tuple(("start", what) for what in _parts(body.get(":precondition", [])))
                actions[name] = Action(names, "0", conditions, tuple(("end", what) for what in _parts(body[":effect"])))
            else:
                conditions = tuple(map(_timed, _parts(body.get(":condition", []))))
                effects = tuple(map(_timed, _parts(body.get(":effect", []))))
                actions[name] = Action(names, body[":duration"][2], conditions, effects)
    return actions


def _rest(tokens: Iterator[str]) -> list[Expression]:
    found: list[Expression] = []
    for token in tokens:
        if token == ")":
            break
        found.append(_rest(tokens) if token == "(" else token)
    return found


def _parts(expression: Expression) -> list[Expression]:
    if isinstance(expression, str):
        raise ValueError(f"no condition or effect: {expression}")
    if expression and expression[0] == "and":
        return [part for member in expression[1:] for part in _parts(member)]
    return [expression] if expression else []


def _timed(expression: Expression) -> tuple[str, Expression]:
    if not isinstance(expression, list) or expression[0] not in ("at", "over"):
        raise ValueError(f"not at start, over all or at end: {expression}")
    return _text_of(expression[1]), expression[2]


def _put(expression: Expression, binding: Mapping[str, str]) -> Expression:
    if isinstance(expression, str):
        return binding.get(expression, expression)
    return [_put(part, binding) for part in expression]


def _text_of(expression: Expression) -> str:
    return expression if isinstance(expression, str) else f"({' '.join(map(_text_of, expression))})"


# World


class World(dict[Key, Value]):
    """Believed world: true predicates, and functions with their values."""

    def after(self, edits: Iterable[Edit]) -> World:
        return World({**self, **dict(edits)})

    def holds(self, condition: Expression) -> bool:
        """Return whether a ground condition holds.

        Raises:
            ValueError: The condition needs unsupported PDDL.
        """
        match condition:
            case ["and", *parts]:
                return all(map(self.holds, parts))
            case ["or", *parts]:
                return any(map(self.holds, parts))
            case ["not", part]:
                return not self.holds(part)
            case ["imply", first, second]:
                return not self.holds(first) or self.holds(second)
            case ["=", str(first), str(second)] if not _is_number(first):
                return first == second
            case [("<" | ">" | "<=" | ">=" | "=") as sign, first, second]:
                one, other = self.number(first), self.number(second)
                return one is not None and other is not None and _COMPARISONS[sign](one, other)
            case [("forall" | "exists") as word, *_]:
                raise ValueError(f"this check knows no {word}")
        return self.get(_key(condition)) is True

    def number(self, expression: Expression) -> float | None:
        """Return the value of an expression, if defined."""
        if isinstance(expression, str):
            return float(expression)
        if expression[0] in _ARITHMETIC:
            numbers = [self.number(part) for part in expression[1:]]
            known = [number for number in numbers if number is not None]
            return _ARITHMETIC[str(expression[0])](*known) if len(known) == len(numbers) else None
        value = self.get(_key(expression))
        return None if value is None else float(value)

    def change(self, effect: Expression) -> Edit:
        """Return the change by an effect."""
        match effect:
            case ["not", predicate]:
                return _key(predicate), False
            case [("increase" | "decrease" | "scale-up" | "scale-down" | "assign") as how, fluent, by]:
                before, amount = self.number(fluent), self.number(by)
                if how == "assign":
                    return _key(fluent), amount
                known = before is not None and amount is not None
                return _key(fluent), _CHANGES[how](before, amount) if known else None
            case ["when" | "forall", *_]:
                raise ValueError(f"this check knows no {effect[0]}")
        return _key(effect), True

    def changes(self, action: Action, time: str) -> list[Edit]:
        """Return the changes by an action at its start or end, deletions first."""
        edits = [self.change(what) for when, what in action.effects if when == time]
        return sorted(edits, key=lambda edit: edit[1] is not False)


_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
    "=": operator.eq,
}
_ARITHMETIC: dict[str, Callable[..., float]] = {
    "+": operator.add,
    "-": lambda first, *second: first - second[0] if second else -first,
    "*": operator.mul,
    "/": operator.truediv,
}
_CHANGES: dict[str, Callable[..., float]] = {
    "increase": operator.add,
    "decrease": operator.sub,
    "scale-up": operator.mul,
    "scale-down": operator.truediv,
}


def _key(expression: Expression) -> Key:
    return tuple(map(_text_of, expression))


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?\d+(\.\d*)?", text) is not None


# Steps and beliefs


@dataclass(eq=False)
class Step:
    """Running step: its expected effects, and the changes made so far."""

    call: str
    id: str
    action: Action
    promised: dict[Key, Value]
    expected: list[Edit]
    """Effects required at the end."""
    ranges: dict[Key, tuple[float, float]]
    """Ranges of the changed values since the start."""
    begun: list[Edit] = field(default_factory=list)
    """Effects of its start."""
    at_end: set[int] = field(default_factory=set)
    """Indices of the end conditions that have held so far."""
    changed: dict[Key, int] = field(default_factory=dict)
    """Number of changes by key."""
    unmet_since: dict[int, int] = field(default_factory=dict)

    def undone_by(self, changes: Iterable[Edit]) -> list[Edit]:
        """Return its effects at start that ``changes`` make again, undone."""
        again = [(key, value) for key, value in self.begun if isinstance(value, bool) and (key, value) in changes]
        return [(key, not value) for key, value in again]


class TraceCheck:
    """Check of one agent process; ``violations`` holds the results, ``steps`` the number of started steps.

    Raises:
        ValueError: The domain needs unsupported PDDL.
    """

    def __init__(self, domain: str) -> None:
        self.violations: list[Violation] = []
        self.steps = 0
        self._actions = read_actions(domain)
        self._world = World()
        self._replaced: dict[Key, Value] = {}
        """Last values of undefined numbers."""
        self._open: dict[str, Step] = {}
        self._failed: dict[str, Step] = {}
        self._silent: dict[str, int] = {}
        self._replaceable: dict[str, Step] = {}
        """Cancelled steps by the calls that take their places."""

    @property
    def running(self) -> tuple[str, ...]:
        return tuple(self._open)

    def take(self, record: Record) -> None:
        match record.kind:
            case "belief" | "unbelief":
                self._believe(record)
            case "step":
                self._begin(record)
            case "step_end":
                self._end(record)
            case "silent":
                self._silent.setdefault(record.what, record.stamp)
            case "heard":
                self._silent.pop(record.what, None)

    def _find(self, record: Record, step: str, what: str) -> None:
        self.violations.append(Violation(record.stamp / SECOND, step, what))

    # Beliefs

    def _believe(self, record: Record) -> None:
        key, value = _fact(record.what)
        before = self._world.get(key)
        if record.kind == "belief":
            self._world[key] = value
        elif before == value:
            self._replaced[key] = self._world.pop(key, None)
        else:
            return  # the old value is removed after the new one
        after = self._world.get(key)
        self._attribute(record, key, before, after)
        for step in self._open.values():
            if key in step.promised and _same(step.promised[key], after):
                del step.promised[key]
            if key in step.ranges and isinstance(after, float):
                least, greatest = step.ranges[key]
                step.ranges[key] = min(least, after), max(greatest, after)
            self._watch(step, record.stamp)

    def _attribute(self, record: Record, key: Key, before: Value, after: Value) -> None:
        """Check that a step's change is one of its own effects, made once, or a reverted earlier one."""
        if _same(before, after) or (isinstance(before, float) and after is None):
            return  # unchanged, or the removed old value
        step = next((step for step in self._open.values() if step.id == record.cause), None)
        if step is not None:
            times = step.changed.get(key, 0)
            if not self._has_effect(step, key, self._replaced.get(key) if before is None else before, after, times):
                self._find(record, step.call, f"changes {_shown(key)} to {after}, which is no effect of it, or again")
            step.changed[key] = times + 1
        elif (step := self._failed.get(record.cause)) is not None and not step.changed.pop(key, 0):
            self._find(record, step.call, f"takes back {_shown(key)}, which it has not changed")

    def _has_effect(self, step: Step, key: Key, before: Value, after: Value, made: int) -> bool:
        """Return whether the change is that of an effect; ``made`` counts earlier ones."""
        own = [what for _, what in step.action.effects if self._world.change(what)[0] == key]
        if made >= len(own):
            return False
        if isinstance(after, float):
            return before is None or any(_same(World({key: before}).change(what)[1], after) for what in own)
        return any((self._world.change(what)[1] is True) == (after is True) for what in own)

    def _watch(self, step: Step, now: int) -> None:
        for number, condition in enumerate(step.action.needs("end")):
            if self._world.holds(condition):
                step.at_end.add(number)
        for number, condition in enumerate(step.action.needs("all")):
            if self._world.holds(condition):
                step.unmet_since.pop(number, None)
            else:
                step.unmet_since.setdefault(number, now)

    # Steps

    def _begin(self, record: Record) -> None:
        self.steps += 1
        former = self._replaceable.pop(record.what, None)
        name, *objects = record.what.strip("()").split()
        known = self._actions.get(name)
        if known is None or len(known.parameters) != len(objects):
            self._find(record, record.what, "is no action of the domain")
            return
        action = known.of(tuple(objects))
        promised = self._world.changes(action, "start")
        begun = self._world.after(promised)
        for sensor, since in self._silent.items():
            known_s = (record.stamp - since) / SECOND
            if 0 < known_s < GIVE_UP_S or (known_s >= GIVE_UP_S and sensor.split()[-1] in objects):
                self._find(record, record.what, f"begins while sensor {sensor} is silent")
        if record.what in self._open:
            self._find(record, record.what, "begins while it runs")
        undone = [] if former is None else former.undone_by(promised)
        for world, condition in self._conditions(action, begun):
            if not world.holds(condition) and not (world is self._world and world.after(undone).holds(condition)):
                self._find(record, record.what, f"begins though {_text_of(condition)} does not hold")
        for other in self._open.values():
            self._exclude(record, action, other, begun)
        at_end = begun.changes(action, "end")
        step = Step(record.what, record.id, action, dict(promised), at_end, {}, list(promised))
        step.ranges = {key: (value, value) for key, _ in at_end if isinstance(value := begun.get(key), float)}
        step.promised = {key: value for key, value in promised if not _same(self._world.get(key), value)}
        self._open[record.what] = step
        self._watch(step, record.stamp)

    def _conditions(self, action: Action, begun: World) -> Iterator[tuple[World, Expression]]:
        """Yield the start conditions, each with its world."""
        yield from ((self._world, condition) for condition in action.needs("start"))
        yield from ((begun, condition) for condition in action.needs("all"))

    def _exclude(self, record: Record, action: Action, other: Step, begun: World) -> None:
        """Check that a step may begin while another one runs."""
        promise = other.promised.items()
        for world, condition in self._conditions(action, begun):
            if world.holds(condition) and not world.after(promise).holds(condition):
                what = f"begins though {other.call} has begun, after which {_text_of(condition)} does not hold"
                self._find(record, record.what, what)
        for condition in other.action.needs("all"):
            if self._world.holds(condition) and not begun.holds(condition):
                self._find(record, record.what, f"begins and ends {_text_of(condition)}, which {other.call} needs")

    def _end(self, record: Record) -> None:
        step = self._open.pop(record.what, None)
        if record.detail.get("outcome") != "successful":
            if step is not None:
                self._failed[record.id] = step
                successor, takes_place, _ = str(record.detail.get("message", "")).partition(" takes its place")
                if takes_place and successor.split()[0] == step.call.split()[0]:
                    self._replaceable[successor] = step
            return
        if step is None:
            self._find(record, record.what, "ends well, and has not begun")
            return
        for number, condition in enumerate(step.action.needs("all")):
            since = step.unmet_since.get(number, record.stamp)
            if record.stamp - since > GAP_S * SECOND and not self._silent:
                self._find(record, step.call, f"ends well though {_text_of(condition)} had not held for {GAP_S:g} s")
        for number, condition in enumerate(step.action.needs("end")):
            if number not in step.at_end:
                self._find(record, step.call, f"ends well though {_text_of(condition)} did not hold")
        for key, value in step.expected:
            if not self._is_there(step, key, value):
                self._find(record, step.call, f"ends well though {_shown(key)} is not {value}")
        for other in self._open.values():
            for key, _ in step.expected:
                other.promised.pop(key, None)

    def _is_there(self, step: Step, key: Key, value: Value) -> bool:
        """Return whether an effect is present; numbers may have changed since."""
        if isinstance(value, bool):
            added = (key, True) in step.expected
            return (self._world.get(key) is True) == (value or added)
        if value is None or key not in step.ranges:
            return _same(self._world.get(key), value)
        least, greatest = step.ranges[key]
        return least - 1e-6 <= value <= greatest + 1e-6


def check(domain: str, records: Iterable[Record]) -> TraceCheck:
    """Check a whole trace."""
    found = TraceCheck(domain)
    for record in records:
        found.take(record)
    return found


def _fact(text: str) -> Edit:
    """Parse a belief of the trace: ``upon(gripper_a, base_1)``, ``stacked(base_1, 3)``."""
    name, _, rest = text.rstrip(")").partition("(")
    words = [word.strip() for word in rest.split(",")] if rest else []
    if words and _is_number(words[-1]):
        return (name, *words[:-1]), float(words[-1])
    return (name, *words), True


def _shown(key: Key) -> str:
    return f"({' '.join(key)})"


def _same(first: Value, second: Value) -> bool:
    """Return whether two values are equal; None equals false."""
    if isinstance(first, float) or isinstance(second, float):
        return isinstance(first, float) and isinstance(second, float) and abs(first - second) <= 1e-6
    return (first or None) == (second or None)
