"""Internal actions of AgentSpeak, such as ``.print``; their modules are imported when one is first looked up."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from socialbot.bdi.stdlib.registry import INTERNALS

if TYPE_CHECKING:
    from socialbot.bdi.stdlib.registry import Internal

TOPICS = ("environment", "goals", "plans", "terms")


@cache
def internals() -> dict[str, Internal]:
    """The internal actions by name, with the dot."""
    for topic in TOPICS:
        import_module(f"{__name__}.{topic}")
    return INTERNALS


def find(name: str) -> Internal | None:
    """The internal action of a name."""
    return internals().get(name) if name[:1] == "." else INTERNALS.get(name)
