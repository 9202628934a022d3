"""Internal actions of AgentSpeak such as ``.print``; the first lookup imports their modules."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from socialbot.bdi.stdlib.registry import INTERNALS

if TYPE_CHECKING:
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
