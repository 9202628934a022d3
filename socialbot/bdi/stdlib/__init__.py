"""Internal actions of AgentSpeak such as ``.print``; the first lookup imports their modules."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from socialbot.bdi.intentions import Failed
from socialbot.bdi.stdlib.registry import INTERNALS, Internal
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.literals import Literal

TOPICS = ("environment", "goals", "_agents", "_collections", "_plans", "_strings", "_terms")


@cache
def internals() -> dict[str, Internal]:
    """Return the internal actions by dotted name."""
    for topic in TOPICS:
        import_module(f"{__name__}.{topic}")
    return INTERNALS


def find(name: str) -> Internal | None:
    """Find an internal action by name; the first unknown name with a dot imports the entry points."""
    if name not in (internals() if name[:1] == "." else INTERNALS) and "." in name:
        from socialbot.bdi.stdlib.actions import load_entry_points

        load_entry_points()
    return INTERNALS.get(name)


@cache
def _missing(name: str) -> Internal:
    """Return an internal action of the user that is looked up when it is called."""

    def call(engine: Any, args: tuple[Any, ...], trail: list[Any]) -> Iterator[None]:
        entry = find(name)
        if entry is None:
            raise Failed("action_failed", f"there is no internal action {name}/{len(args)}; register it in Python")
        if entry.many:
            yield from entry.function(engine, args, trail)
        elif entry.function(engine, args, trail) is not False:
            yield

    return Internal(call, (0, 100), many=True)


def called(action: Literal, *, condition: bool = False) -> Internal:
    """Find the internal action of a step or condition. Raises RuleError for a wrong call."""
    entry = find(action.functor)
    if entry is None and "." in action.functor[1:] and action.functor[0] != ".":
        return _missing(action.functor)
    if entry is None:
        near = difflib.get_close_matches(action.functor, internals(), 1)
        own = f'register one of your own in Python, with @asl_action("{action.functor}")'
        raise RuleError(
            f"there is no internal action {action.functor}",
            remedy=f"did you mean {near[0]}? Otherwise, {own}" if near else own,
        )
    if condition and entry.pauses:
        raise RuleError(f"{action.functor} cannot be a condition", remedy="make it a step of the body")
    least, most = entry.arity
    if not least <= len(action.args) <= most:
        count = str(least) if least == most else f"{least} to {most}"
        raise RuleError(f"{action.functor} takes {count} arguments", remedy=usage(entry) or "see docs/semantics.md")
    return entry


def usage(entry: Internal) -> str:
    """Return what an internal action does, by its docstring."""
    return " ".join((entry.function.__doc__ or "").split()).replace("``", "`")


def looks_at_goals(names: Iterable[str]) -> bool:
    """Check whether one of these internal actions inspects or ends goals."""
    entries = map(find, names)
    return any(entry is not None and entry.aware for entry in entries)
