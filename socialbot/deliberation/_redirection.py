"""Redirection: running steps that a new plan makes pointless are stopped, or another step takes their place.

A new plan starts after the running steps. If it begins with a way out of the place that a robot is driving to, the
robot can drive to the next place at once. If it needs the end of a running step no more, the step can stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from socialbot.core.errors import PlanningError
from socialbot.deliberation._action_executor import IsSensed
from socialbot.deliberation._execution import PlanTask, merged
from socialbot.deliberation.facts import FactBase
from socialbot.planning.pddl.causal_order import successors
from socialbot.planning.pddl.domain import PddlPlan, PlanStep
from socialbot.planning.pddl.formulas import Formula, Key, Predicate
from socialbot.planning.pddl.semantics import TOLERANCE, Changes, evaluate, ground
from socialbot.planning.pddl.state import Projection

_MOST_STEPS = 4
"""Largest number of steps of a new plan that one step replaces."""

Undone = Callable[[PlanTask], dict[Key, bool | float | None]]
"""Values of the facts that the start of a task has changed, after the task is given up."""


@dataclass(frozen=True)
class Redirection:
    """A plan with its tasks, and the running tasks that it ends early, each with a message."""

    plan: PddlPlan
    tasks: tuple[PlanTask, ...]
    ended: dict[PlanTask, str]


@dataclass(frozen=True)
class Redirector:
    """Finds running tasks that a new plan makes pointless.

    Args:
        goal: Goal of the new plan.
        is_sensed: Whether sensors report a fact.
    """

    facts: FactBase
    goal: Formula
    now: int
    is_sensed: IsSensed
    undone: Undone

    def redirect(self, plan: PddlPlan, running: Sequence[PlanTask]) -> Redirection | None:
        """Return a plan that ends some of the running tasks early and is no longer; None if there is none.

        Args:
            plan: Plan for the facts after the running tasks.
        """
        found: Redirection | None = None
        assumed: dict[Key, bool | float | None] = {}
        kept, ended = list(running), dict[PlanTask, str]()
        presumed: dict[PlanStep, Changes] = {}
        for task in running:
            if not self._can_end_early(task):
                continue
            rest = tuple(other for other in kept if other is not task)
            for variant in self._variants(plan, task):
                undone = {**assumed, **self.undone(task), **variant.presumed}
                told = presumed if variant.step is None else {**presumed, variant.step: variant.presumed}
                tasks = self._tasks(variant.plan, rest, undone, told)
                if tasks is None:
                    continue
                plan, kept, assumed, presumed = variant.plan, list(rest), undone, told
                ended[task] = variant.message
                found = Redirection(plan, tasks, dict(ended))
                break
        return found

    def _can_end_early(self, task: PlanTask) -> bool:
        """Return whether an action goes on and sensors have not yet seen any of its effects."""
        if task.phase != "acting" or task.outcome is not None or task.action.duration is None:
            return False
        try:
            effects = task.end_changes(self.facts, self.facts.domain)
        except PlanningError:
            return False
        return not any(
            self.is_sensed(key.name, key.terms) and task.is_seen(key, new, self.facts) for key, new in effects.items()
        )

    def _tasks(
        self,
        plan: PddlPlan,
        running: tuple[PlanTask, ...],
        assumed: dict[Key, bool | float | None],
        presumed: dict[PlanStep, Changes],
    ) -> tuple[PlanTask, ...] | None:
        try:
            tasks = merged(self.facts.domain, self.facts, plan, self.goal, running, self.now, assumed)
        except PlanningError:
            return None
        for task in tasks:
            if task not in running:
                task.presumed = presumed.get(task.step, {})
        return tasks

    def _variants(self, plan: PddlPlan, task: PlanTask) -> Iterator[_Variant]:
        """Yield the plan without the task, and plans in which another step of its action takes its place."""
        left: Changes = {}
        has_left = False
        for key, new in task.started_changes.items():
            if isinstance(key, Predicate) and self.is_sensed(key.name, key.terms):
                left[key] = not new
                has_left |= self.facts.holds(key) == new
        if not has_left:
            yield _Variant(plan, None, {}, "the plan does not need it any more")
        remaining_s = max(0.0, task.length_s(self.now) - task.lasted_s(self.now))
        name, args = task.step.action, task.step.args
        former = sorted((step for step in plan.steps if step.action == name), key=lambda step: step.start_s)
        for first in former[:_MOST_STEPS]:
            same = [index for index, (one, other) in enumerate(zip(args, first.args, strict=True)) if one == other]
            chain = [step for step in former if all(step.args[index] == args[index] for index in same)]
            for count, last in enumerate(chain[:_MOST_STEPS], 1):
                for mixed in successors(args, last.args):
                    step = self._step(name, mixed, left)
                    if step is None or step.duration_s > remaining_s + last.end_s:
                        continue
                    delay = step.duration_s - last.end_s
                    others = (other for other in plan.steps if other not in chain[:count])
                    shifted = (
                        replace(other, start_s=max(0.0, other.start_s + delay))
                        if other.start_s >= last.end_s - TOLERANCE
                        else other
                        for other in others
                    )
                    yield _Variant(PddlPlan((step, *shifted)), step, left, f"{step.call} takes its place")

    def _step(self, action: str, args: tuple[str, ...], left: Changes) -> PlanStep | None:
        """Return a step that starts at once with the effects on ``left`` that the former step had."""
        step = PlanStep(0.0, action, args, 0.0)
        grounded = ground(self.facts.domain.actions[action], args)
        task = PlanTask(step, grounded)
        before = Projection(self.facts, self.facts.domain, left)
        least = None if grounded.duration is None else grounded.duration.least
        duration_s = None if least is None else evaluate(least, before)
        if duration_s is None:
            return None
        try:
            changed = task.changes("start", before)
        except PlanningError:
            return None
        if any(changed.get(key) != (not value) for key, value in left.items()):
            return None
        return replace(step, duration_s=duration_s)


@dataclass(frozen=True)
class _Variant:
    """A plan, the step that takes the place of a running one, and facts that are presumed at its start."""

    plan: PddlPlan
    step: PlanStep | None
    presumed: Changes
    message: str
