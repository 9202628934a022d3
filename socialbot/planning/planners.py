"""Planners by name."""

from __future__ import annotations

from socialbot.errors import ParameterError
from socialbot.planning.kairos import Kairos
from socialbot.planning.planner import Planner
from socialbot.planning.popf import Popf
from socialbot.planning.unified import Unified

DEFAULT = "kairos"


def make_planner(name: str = DEFAULT) -> Planner:
    """The planner called ``kairos``, ``popf``, ``popf:/path/to/popf``, or ``up:ENGINE`` for one of unified-planning.

    Raises ParameterError for another name, InstallationError when it is not installed.
    """
    kind, _, detail = name.partition(":")
    if name == "kairos":
        return Kairos()
    if kind == "popf":
        return Popf(detail or "popf")
    if kind == "up" and detail:
        return Unified(detail)
    raise ParameterError(f"there is no planner {name!r}", remedy="there are kairos, popf, popf:PATH and up:ENGINE")
