"""``.wait`` for a time, or for an event that is told as a string; other waiting is compiled in place."""

from __future__ import annotations

from typing import Any

from socialbot.bdi.intentions import EventPause, Pause, Sleep
from socialbot.bdi.internal.arguments import is_number, number_of, wrong
from socialbot.bdi.internal.time import event_of
from socialbot.bdi.internals import internal
from socialbot.bdi.unification import Trail, resolve


@internal(".wait", 1, 2, pauses=True)
def wait(engine: Any, args: tuple[Any, ...], trail: Trail) -> Pause:
    """``.wait(500)`` rests for so many ms; ``.wait("+b(1)", 500)`` until the event comes, for 500 ms at most."""
    what = resolve(args[0])
    if is_number(what):
        return Sleep(max(0.0, what / 1000))
    if not isinstance(what, str):
        raise wrong(".wait", what, "ms, an event or a condition")
    event = event_of(".wait", what)
    limit_s = number_of(".wait", args[1]) / 1000 if len(args) > 1 else None
    return EventPause(event.key, event.literal.args, event.literal.annotations, limit_s)
