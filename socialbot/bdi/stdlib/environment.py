"""Internal actions for output, time, waiting and messages between agents."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from random import Random
from typing import Any, TypeVar

from socialbot.bdi.agentspeak._spelling import said
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.parser import parse_event, parse_term
from socialbot.bdi.intentions import EventPause, Failed, Pause, Sleep, timed
from socialbot.bdi.literals import Change, Event, Literal, literal
from socialbot.bdi.stdlib.registry import Args, detached, gives, internal, is_number, name_of, number_of, opened, wrong
from socialbot.bdi.terms import Atom, Variable
from socialbot.bdi.unification import Trail, closed, resolve
from socialbot.core.clock import SECOND


@internal(".print", 0, 100)
def print_(engine: Any, args: Args, trail: Trail) -> None:
    """``.print(a1, ..., an)``: print the arguments without separators."""
    line = "".join(map(said, args))
    if engine.out is not None:
        engine.out(line)
    else:
        _show(f"[{engine.name}] {line}\n")


def _show(text: str) -> None:
    """Print a text without control characters: a belief may hold whatever a person or a message said."""
    from socialbot.core.terminal import without_controls  # it imports logging

    print(without_controls(text), end="", flush=True)


class RawOutput:
    """Output of an agent without its name and without ends of lines, except for `.println`."""

    def __call__(self, text: str) -> None:
        _show(text)


@internal(".println", 0, 100)
def println(engine: Any, args: Args, trail: Trail) -> None:
    """``.println(a1, ..., an)``: the same as `.print`; it ends the line if the project says ``verbose=0``."""
    print_(engine, (*args, "\n") if isinstance(engine.out, RawOutput) else args, trail)


@internal(".log", 1, 100)
def log(engine: Any, args: Args, trail: Trail) -> None:
    """``.log(info, a1, ..., an)``: print the arguments at the level severe, warning or info; others print nothing."""
    if resolve(args[0]).__class__ is not Atom:
        raise wrong(".log", args[0], "a level: severe, warning, info, fine, finer or finest")
    if resolve(args[0]).name not in ("fine", "finer", "finest"):
        print_(engine, args[1:], trail)


@internal(".printf", 1, 100)
def printf(engine: Any, args: Args, trail: Trail) -> None:
    """``.printf("%s is %.1f m away", X, D)``: print a format with its values."""
    form, values = resolve(args[0]), [resolve(arg) for arg in args[1:]]
    if not isinstance(form, str):
        raise wrong(".printf", form, "a format, a string")
    shown = tuple(value if is_number(value) else said(value) for value in values)
    try:
        line = form.replace("%n", "\n") % shown
    except (TypeError, ValueError) as problem:
        raise Failed("wrong_arguments", f".printf({form!r}): {problem}") from problem
    print_(engine, (line.removesuffix("\n"),), trail)


_HOLE = re.compile(r"#\{([A-Za-z0-9_]+)\}")


def interpolated(action: Literal) -> Literal:
    """Rewrite ``.puts("a #{X}")`` to `.print`, or to `.concat` if its last argument is a variable."""
    parts: list[object] = []
    for arg in action.args:
        if not isinstance(arg, str):
            continue
        texts = _HOLE.split(arg)  # texts and terms in turn
        for i, part in enumerate(texts):
            try:
                parts.append(parse_term(part, "<puts>") if i % 2 else part)
            except AgentSpeakError:
                parts.append(f"#{{{part}}}")
    if isinstance(action.args[-1], Variable):
        return literal(".concat", ("", *parts, action.args[-1]))
    return literal(".print", tuple(parts))


internal(".puts", 1, 100)(print_)


@internal(".verbose", 1)
def verbose(engine: Any, args: Args, trail: Trail) -> None:
    """``.verbose(N)``: the detail of Jason's own log; it has no effect."""


@internal(".version", 1)
def version(engine: Any, args: Args, trail: Trail) -> bool:
    """``.version(V)``: V is the version of socialbot, a string."""
    from importlib.metadata import version as installed

    return gives(args[0], installed("socialbot"), trail)


@internal(".perceive", 0)
def perceive(engine: Any, args: Args, trail: Trail) -> None:
    """``.perceive``: percepts arrive by themselves; it has no effect."""


@internal(".list_files", 2, 3, binds=True)
def list_files(engine: Any, args: Args, trail: Trail) -> bool:
    """``.list_files(Folder, Pattern, L)``: L are the files in a folder and below whose names match an expression."""
    folder, *rest = map(resolve, args)
    pattern = rest[0] if len(rest) == 2 else ".*"
    if not isinstance(folder, str) or not isinstance(pattern, str):
        raise wrong(".list_files", pattern if isinstance(folder, str) else folder, "a string")
    found = sorted(path for path in Path(folder).rglob("*") if path.is_file() and re.fullmatch(pattern, path.name))
    start = "./" if folder.startswith("./") else ""
    return gives(args[-1], tuple(f"{start}{path}" for path in found), trail)


T = TypeVar("T")

_WORDS = {
    0.001: "|ms|msec|msecs|msecond|mseconds|milli|millis|millisecond|milliseconds",
    1.0: "s|sec|second|seconds",
    60.0: "m|min|minute|minutes",
    3600.0: "h|hour|hours",
    86400.0: "d|day|days",
}
UNITS = {word: seconds for seconds, words in _WORDS.items() for word in words.split("|")}
"""Seconds per unit."""

_WHEN = re.compile(r"now(?:\s*\+\s*(\d+(?:\.\d+)?)\s*([a-z]*))?")


@internal(".time", 3, 4, binds=True)
def time(engine: Any, args: Args, trail: Trail) -> bool:
    """``.time(Hour, Minute, Second, Millisecond)``: the local time of day."""
    now = _now(engine)
    return gives(args, (*now.timetuple()[3:6], now.microsecond // 1000)[: len(args)], trail)


@internal(".date", 3, binds=True)
def date(engine: Any, args: Args, trail: Trail) -> bool:
    """``.date(Year, Month, Day)``: the local date."""
    return gives(args, _now(engine).timetuple()[:3], trail)


@internal(".nano_time", 1, binds=True)
def nano_time(engine: Any, args: Args, trail: Trail) -> bool:
    """``.nano_time(T)``: T is the time of the clock of the agent in ns."""
    return gives(args[0], engine.clock.now(), trail)


@internal(".set_random_seed", 1)
def set_random_seed(engine: Any, args: Args, trail: Trail) -> None:
    """``.set_random_seed(N)``: seed the random numbers of the agent, which then are those of Jason."""
    engine.interpreter.random = JavaRandom(int(number_of(".set_random_seed", args[0])))


JAVA = "java"
"""Mark of the state of `JavaRandom`."""


class JavaRandom(Random):
    """Random numbers of ``java.util.Random``."""

    _MASK = (1 << 48) - 1
    _state = 0

    def seed(self, a: Any = 0, version: int = 2) -> None:
        """Set the seed, an integer."""
        self._state = (int(a) ^ 0x5DEECE66D) & self._MASK

    def _bits(self, count: int) -> int:
        self._state = (self._state * 0x5DEECE66D + 0xB) & self._MASK
        return self._state >> (48 - count)

    def random(self) -> float:
        """Number of at least 0 and less than 1."""
        return ((self._bits(26) << 27) + self._bits(27)) * 2.0**-53

    def getrandbits(self, k: int, /) -> int:
        """Integer of ``k`` random bits."""
        value = 0
        for _ in range(0, k, 32):
            value = value << 32 | self._bits(32)
        return value >> (-k % 32)

    def _randbelow(self, n: int) -> int:
        while True:
            bits = self._bits(31)
            if n & (n - 1) == 0:
                return bits * n >> 31
            if bits - bits % n + n <= 1 << 31:
                return bits % n

    def getstate(self) -> Any:
        """Internal state, marked as that of this class."""
        return JAVA, (self._state,), None

    def setstate(self, state: Any) -> None:
        """Restore an internal state."""
        _, (self._state,), _ = state


def _now(engine: Any) -> datetime:
    return (datetime.fromtimestamp(0, timezone.utc) + timedelta(seconds=engine.clock.now() / SECOND)).astimezone()


@dataclass(eq=False)
class Appointment:
    """Event scheduled for a given time."""

    engine: Any
    event: Event
    cause: Any

    def __call__(self) -> None:
        self.engine.interpreter.raise_event(self.event, self.cause)


@internal(".at", 2)
def at(engine: Any, args: Args, trail: Trail) -> None:
    """``.at("now +3 s", {+!g})``: schedule an event; units are ms (default), s, m, h and d."""
    when, event = resolve(args[0]), event_of(".at", args[1])
    found = _WHEN.fullmatch(when.strip()) if isinstance(when, str) else None
    if found is None or (found[2] or "") not in UNITS:
        raise wrong(".at", when, 'a time, such as "now +3 s"; units are ms, s, m, h and d, or words such as minutes')
    unit = found[2] or ""
    if not closed(event.literal) and event.change is not Change.WANTED:
        raise Failed("no_value", f".at: {event} has a variable without a value")
    engine.timers.after(float(found[1] or 0) * UNITS[unit], Appointment(engine, event, engine.interpreter.cause))


def parsed(name: str, text: str, parse: Callable[[str, str], T], what: str) -> T:
    """Parse AgentSpeak text that is an argument. Raises Failed for a syntax error."""
    try:
        return opened(parse(text, f"<{name}>"))
    except AgentSpeakError as problem:
        raise Failed("wrong_arguments", f"{name}: {text!r} is not {what}: {problem}") from problem


def event_of(name: str, term: Any) -> Event:
    """Convert ``{+b(X)}`` or a string to an event. Raises Failed for any other term."""
    term = resolve(term)
    if isinstance(term, str):
        return parsed(name, term, parse_event, "an event")
    if not isinstance(term, Event):
        raise wrong(name, term, "an event, such as {+!g}")
    return detached(term)


@internal(".wait", 1, 3, pauses=True)
def wait(engine: Any, args: Args, trail: Trail) -> Pause | None:
    """``.wait(500)``: pause for 500 ms; ``.wait({+b(X)}, 500)``, ``.wait(c, 500)``: until an event or a condition.

    After the time limit it fails; with a third argument, which gets the waiting time in ms, it does not.
    """
    what = resolve(args[0])
    if is_number(what):
        return Sleep(max(0.0, what / 1000))
    if not isinstance(what, str):
        raise wrong(".wait", what, "ms, an event or a condition")
    event = event_of(".wait", what)
    limit_s = number_of(".wait", args[1]) / 1000 if len(args) > 1 else None
    pause = EventPause(event.key, event.literal.args, event.literal.annotations, limit_s)
    return pause if len(args) < 3 else timed(pause, args[2])


@internal(".send", 3, 5, pauses=True)
def send(engine: Any, args: Args, trail: Trail) -> Pause | None:
    """``.send(To, Performative, Content, Answer, Timeout)``: send a message to an agent or a list of agents.

    With an ``Answer``, the intention waits for it; after the timeout (ms) the answer is ``timeout``.
    """
    receiver, performative, content, *rest = args
    return engine.messaging.send(
        resolve(receiver),
        name_of(".send", performative),
        resolve(content),
        engine.interpreter.cause,
        answer=rest[0] if rest else None,
        limit_s=number_of(".send", rest[1]) / 1000 if len(rest) > 1 else None,
    )


@internal(".broadcast", 2)
def broadcast(engine: Any, args: Args, trail: Trail) -> None:
    """``.broadcast(Performative, Content)``: send a message to all other agents."""
    engine.messaging.broadcast(name_of(".broadcast", args[0]), resolve(args[1]), engine.interpreter.cause)
