"""Internal actions for output, time, waiting and messages between agents."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any, TypeVar

from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.parser import parse_event
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.intentions import EventPause, Failed, Pause, Sleep
from socialbot.bdi.literals import Event, Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.stdlib.registry import Args, detached, gives, internal, is_number, name_of, number_of, opened, wrong
from socialbot.bdi.terms import Atom, Cons
from socialbot.bdi.unification import Trail, Var, closed, resolve
from socialbot.core.clock import SECOND


@internal(".print", 0, 100)
def print_(engine: Any, args: Args, trail: Trail) -> None:
    """``.print(a1, ..., an)``: print the arguments without separators."""
    line = "".join(map(said, args))
    if engine.out is not None:
        engine.out(line)
    else:
        print(f"[{engine.name}] {line}", flush=True)


internal(".println", 0, 100)(print_)


def said(term: Any) -> str:
    """Format a term for printing: top-level strings and names appear without quotes."""
    term = resolve(term)
    if isinstance(term, str):
        return term
    if term.__class__ is Atom:
        return term.name
    if term.__class__ is Var:
        return f"{term}<no-value>"
    return spelled(term)


def spelled(term: Any) -> str:
    """Format a term in AgentSpeak as Jason does: no spaces, and no fraction for integers."""
    if term.__class__ is Atom:
        return _name(term.name)
    if isinstance(term, str):
        return f'"{term}"'
    if isinstance(term, bool) or term is None:
        return str(term).lower()
    if isinstance(term, float):
        return str(int(term)) if term.is_integer() and abs(term) < 1e16 else repr(term)
    if term.__class__ is tuple:
        return f"[{','.join(map(spelled, term))}]"
    if term.__class__ is Cons:
        return f"[{','.join(map(spelled, term.items))}|{spelled(term.tail)}]"
    if isinstance(term, Literal):
        args = f"({','.join(map(spelled, term.args))})" if term.args else ""
        notes = f"[{','.join(sorted(map(spelled, term.annotations)))}]" if term.annotations else ""
        return f"{'~' if term.negated else ''}{_name(term.functor)}{args}{notes}"
    if isinstance(term, Plan):
        return agentspeak(term)
    if isinstance(term, Event):
        return f"{{{term.change.value}{spelled(resolve(term.literal))}}}"
    return str(term)


def _name(name: str) -> str:
    return name if name.isidentifier() and name[0].islower() else agentspeak(Atom(name))


T = TypeVar("T")

UNITS = {"": 0.001, "ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
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
    unit = "" if found is None else (found[2] or "")
    unit = unit if unit == "ms" else unit[:1]
    if found is None or unit not in UNITS:
        raise wrong(".at", when, 'a time, such as "now +3 s"')
    if not closed(event.literal):
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


@internal(".wait", 1, 2, pauses=True)
def wait(engine: Any, args: Args, trail: Trail) -> Pause:
    """``.wait(500)``: pause for 500 ms; ``.wait("+b(1)", 500)``: until the event occurs, with a timeout."""
    what = resolve(args[0])
    if is_number(what):
        return Sleep(max(0.0, what / 1000))
    if not isinstance(what, str):
        raise wrong(".wait", what, "ms, an event or a condition")
    event = event_of(".wait", what)
    limit_s = number_of(".wait", args[1]) / 1000 if len(args) > 1 else None
    return EventPause(event.key, event.literal.args, event.literal.annotations, limit_s)


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


@internal(".my_name", 1, binds=True)
def my_name(engine: Any, args: Args, trail: Trail) -> bool:
    """``.my_name(N)``: the name of this agent, an atom."""
    return gives(args[0], Atom(engine.name), trail)


@internal(".all_names", 1, binds=True)
def all_names(engine: Any, args: Args, trail: Trail) -> bool:
    """``.all_names(L)``: the names of all agents, including this one."""
    society = engine.messaging.society
    names = [engine.name] if society is None else society.agents
    return gives(args[0], tuple(map(Atom, names)), trail)


@internal(".stopMAS", 0, 1)
def stop_all(engine: Any, args: Args, trail: Trail) -> None:
    """Stop all agents, optionally after a delay in ms."""
    society = engine.messaging.society or engine
    if args:
        engine.timers.after(number_of(".stopMAS", args[0]) / 1000, society.stop)
    else:
        society.stop()


internal(".stop", 0, 1)(stop_all)
