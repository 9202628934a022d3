"""Temporal planners in child processes with limits."""

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports

if TYPE_CHECKING:
    from socialbot.planning.planners.engines import make_planner
    from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerLimits, PlannerVerdict


__all__ = ["Planner", "PlannerAnswer", "PlannerLimits", "PlannerVerdict", "make_planner"]  # fmt: skip

__getattr__ = lazy_exports(
    __name__,
    {
        "socialbot.planning.planners.engines": "make_planner",
        "socialbot.planning.planners.planner": "Planner PlannerAnswer PlannerLimits PlannerVerdict",
    },
)
