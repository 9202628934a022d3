"""Hierarchical task networks: methods in Python, task trees, and repair of plans."""

from socialbot.planning.htn.domain import Item, TaskDomain, TaskState
from socialbot.planning.htn.planner import TaskPlanner, progressed
from socialbot.planning.htn.tree import TaskAnswer, TaskFault, TaskLimits, TaskNode, TaskTree, TaskVerdict

__all__ = [
    "Item", "TaskAnswer", "TaskDomain", "TaskFault", "TaskLimits", "TaskNode", "TaskPlanner", "TaskState",
    "TaskTree", "TaskVerdict", "progressed",
]  # fmt: skip
