"""The registry of internal actions, such as ``.print``; the modules of `socialbot.bdi.internal` fill it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Internal:
    """An internal action: ``function(engine, args, trail)``.

    It returns whether it succeeded (None counts as yes), or, with ``many``, iterates over its solutions; with
    ``pauses`` it may return a `Pause`. Variables in ``args`` are `Var`; ``binds`` promises that all have values then.
    With ``aware`` it looks at intentions: the plan that it is a step of has to be on one.
    """

    function: Callable[..., Any]
    arity: tuple[int, int]
    many: bool = False
    pauses: bool = False
    binds: bool = False
    aware: bool = False


INTERNALS: dict[str, Internal] = {}
"""By name, with the dot."""


def internal(
    name: str,
    least: int,
    most: int | None = None,
    *,
    many: bool = False,
    pauses: bool = False,
    binds: bool = False,
    aware: bool = False,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Registers a function as an internal action with ``least`` to ``most`` arguments."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        INTERNALS[name] = Internal(function, (least, least if most is None else most), many, pauses, binds, aware)
        return function

    return register


def find(name: str) -> Internal | None:
    """The internal action of a name; those of AgentSpeak are loaded when one is first asked for."""
    if name[:1] == "." and ".print" not in INTERNALS:
        import socialbot.bdi.internal  # noqa: F401 - fills the registry
    return INTERNALS.get(name)
