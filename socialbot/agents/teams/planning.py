"""Planners of missions: task networks (HTN) or PDDL, with the same answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from socialbot.agents.teams.missions import Mission
from socialbot.planning.htn.domain import Item, TaskDomain, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskAnswer, TaskFault, TaskNode, TaskTree, TaskVerdict
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
from socialbot.planning.planners import Kairos, Planner, PlannerAnswer, PlannerLimits, PlannerVerdict


class MissionPlanner(Protocol):
    """Planner of missions. It raises nothing: errors are in the answer."""

    def plan(self, mission: Mission, state: TaskState, tasks: Sequence[Item]) -> TaskAnswer:
        """Plan a mission from a state."""
        ...

    def repair(self, mission: Mission, state: TaskState, tree: TaskTree, failed: TaskNode) -> TaskAnswer | None:
        """Repair a plan after the failed action; None if the planner can only plan anew."""
        ...

    def revise(self, mission: Mission, state: TaskState, tree: TaskTree, upcoming: TaskNode) -> TaskAnswer:
        """Adapt a plan to a changed state before the action ``upcoming``."""
        ...


class HtnMissionPlanner:
    """Plans missions as task networks of a domain."""

    def __init__(self, domain: TaskDomain) -> None:
        self._planner = TaskPlanner(domain)

    def plan(self, mission: Mission, state: TaskState, tasks: Sequence[Item]) -> TaskAnswer:
        return self._planner.plan(state, tasks)

    def repair(self, mission: Mission, state: TaskState, tree: TaskTree, failed: TaskNode) -> TaskAnswer | None:
        return self._planner.replan(state, tree, failed.id)

    def revise(self, mission: Mission, state: TaskState, tree: TaskTree, upcoming: TaskNode) -> TaskAnswer:
        return self._planner.revise(state, tree, upcoming.id)


VERDICTS = {
    PlannerVerdict.SOLVED: TaskVerdict.PLAN,
    PlannerVerdict.IMPOSSIBLE: TaskVerdict.IMPOSSIBLE,
    PlannerVerdict.GAVE_UP: TaskVerdict.TIMEOUT,
    PlannerVerdict.CANCELLED: TaskVerdict.CANCELLED,
}


class PddlMissionPlanner:
    """Plans missions with a PDDL planner. The actions of a plan are executed one after the other, by start time.

    A plan is never repaired but made anew. A call blocks the coordinator for at most the time limit.

    Args:
        domain: Domain with the actions of the agents; each action has its agents among its arguments.
        problem: Returns the problem of a mission in a state.
        planner: The planner; by default `Kairos`.
        limits: Limits of a call.
    """

    def __init__(
        self,
        domain: PddlDomain,
        problem: Callable[[Mission, TaskState], PddlProblem],
        planner: Planner | None = None,
        limits: PlannerLimits = PlannerLimits(timeout_s=2.0),  # noqa: B008 - it is immutable
    ) -> None:
        self._domain = domain
        self._problem = problem
        self._planner = planner or Kairos()
        self._limits = limits

    def plan(self, mission: Mission, state: TaskState, tasks: Sequence[Item]) -> TaskAnswer:
        problem = self._problem(mission, state)
        return self._answer(mission, self._planner.solve(self._domain, problem, self._limits))

    def repair(self, mission: Mission, state: TaskState, tree: TaskTree, failed: TaskNode) -> TaskAnswer | None:
        return None

    def revise(self, mission: Mission, state: TaskState, tree: TaskTree, upcoming: TaskNode) -> TaskAnswer:
        return self.plan(mission, state, ())

    def _answer(self, mission: Mission, found: PlannerAnswer) -> TaskAnswer:
        verdict = VERDICTS.get(found.verdict, TaskVerdict.ERROR)
        if verdict is not TaskVerdict.PLAN or found.plan is None:
            fault = TaskFault.MALFORMED if verdict is TaskVerdict.ERROR else None
            return TaskAnswer(verdict, message=found.message, fault=fault, seconds=found.seconds)
        return TaskAnswer(verdict, plan_tree((mission.kind, mission.target), found.plan), seconds=found.seconds)


def plan_tree(task: Item, plan: PddlPlan) -> TaskTree:
    """A plan as a tree: ``task`` with the actions by start time."""
    steps = sorted(plan.steps, key=lambda step: step.start_s)
    items = [(step.action, *step.args) for step in steps]
    actions = {id: TaskNode(id, item, 1, status="planned") for id, item in enumerate(items, start=2)}
    root = TaskNode(1, task, method="pddl", children=tuple(actions))
    return TaskTree({1: root, **actions}, (1,), len(actions) + 2)
