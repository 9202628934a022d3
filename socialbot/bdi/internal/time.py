"""Internal actions about the time, which is that of the agent's clock."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from typing import Any

from socialbot.bdi.events import Event
from socialbot.bdi.failures import Failed
from socialbot.bdi.internal.arguments import detached, gives, wrong
from socialbot.bdi.internals import internal
from socialbot.bdi.unification import Trail, closed, resolve
from socialbot.clock import SECOND

Args = tuple[Any, ...]

UNITS = {"": 0.001, "ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
"""In seconds."""

_WHEN = re.compile(r"now(?:\s*\+\s*(\d+(?:\.\d+)?)\s*([a-z]*))?")


@internal(".time", 3, 4, binds=True)
def time(engine: Any, args: Args, trail: Trail) -> bool:
    """``.time(Hour, Minute, Second, Millisecond)``: the time of day where the computer is."""
    now = _now(engine)
    return gives(args, (now.hour, now.minute, now.second, now.microsecond // 1000)[: len(args)], trail)


@internal(".date", 3, binds=True)
def date(engine: Any, args: Args, trail: Trail) -> bool:
    """``.date(Year, Month, Day)``: today."""
    now = _now(engine)
    return gives(args, (now.year, now.month, now.day), trail)


def _now(engine: Any) -> datetime:
    return (datetime.fromtimestamp(0, timezone.utc) + timedelta(seconds=engine.clock.now() / SECOND)).astimezone()


class Appointment:
    """An event that is to come at a time."""

    def __init__(self, engine: Any, event: Event) -> None:
        self.engine = engine
        self.event = event
        self.cause = engine.cause
        self.cancelled = False

    def __call__(self) -> None:
        if not self.cancelled:
            self.engine.raise_event(self.event, self.cause)


@internal(".at", 2)
def at(engine: Any, args: Args, trail: Trail) -> None:
    """``.at("now +3 s", {+!g})``: the event comes at that time; in ms if no unit (s, m, h, d) is given."""
    when, event = resolve(args[0]), event_of(".at", args[1])
    found = _WHEN.fullmatch(when.strip()) if isinstance(when, str) else None
    unit = "" if found is None else (found[2] or "")
    unit = unit if unit == "ms" else unit[:1]
    if found is None or unit not in UNITS:
        raise wrong(".at", when, 'a time, such as "now +3 s"')
    if not closed(event.literal):
        raise Failed("no_value", f".at: {event} has a variable without a value")
    engine.at_in(float(found[1] or 0) * UNITS[unit], Appointment(engine, event))


def event_of(name: str, term: Any) -> Event:
    """An event, given as ``{+b(X)}`` or as a string. Raises Failed for anything else."""
    term = resolve(term)
    if isinstance(term, str):
        from socialbot.bdi.agentspeak import AgentSpeakError, parse_event
        from socialbot.bdi.internal.arguments import opened

        try:
            return opened(parse_event(term, f"<{name}>"))
        except AgentSpeakError as problem:
            raise Failed("wrong_arguments", f"{name}: {term!r} is no event") from problem
    if not isinstance(term, Event):
        raise wrong(name, term, "an event, such as {+!g}")
    return detached(term)
