"""Temporal planners in child processes with limits."""

from socialbot.planning.planners.engines import Kairos, Popf, Unified, make_planner
from socialbot.planning.planners.planner import ChildPlanner, Planner, PlannerAnswer, PlannerLimits, PlannerVerdict

__all__ = [
    "ChildPlanner", "Kairos", "Planner", "PlannerAnswer", "PlannerLimits", "PlannerVerdict", "Popf", "Unified",
    "make_planner",
]  # fmt: skip
