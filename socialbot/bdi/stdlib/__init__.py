"""Internal actions of AgentSpeak such as ``.print``; the first lookup imports their modules."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from socialbot.bdi.stdlib.registry import INTERNALS
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.literals import Literal
    from socialbot.bdi.stdlib.registry import Internal

TOPICS = ("environment", "goals", "_plans", "_terms")


@cache
def internals() -> dict[str, Internal]:
    """Return the internal actions by dotted name."""
    for topic in TOPICS:
        import_module(f"{__name__}.{topic}")
    return INTERNALS


def find(name: str) -> Internal | None:
    """Find an internal action by name."""
    return internals().get(name) if name[:1] == "." else INTERNALS.get(name)


def called(action: Literal, *, condition: bool = False) -> Internal:
    """Find the internal action of a step or condition. Raises RuleError for a wrong call."""
    entry = find(action.functor)
    if entry is None:
        raise RuleError(f"there is no internal action {action.functor}", remedy="see docs/semantics.md")
    if condition and entry.pauses:
        raise RuleError(f"{action.functor} cannot be a condition", remedy="make it a step of the body")
    least, most = entry.arity
    if not least <= len(action.args) <= most:
        count = str(least) if least == most else f"{least} to {most}"
        raise RuleError(f"{action.functor} takes {count} arguments", remedy="see docs/semantics.md")
    return entry
