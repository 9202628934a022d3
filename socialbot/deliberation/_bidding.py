"""Bids for desires that other agents offer: the time until this agent would have achieved them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.messages import Desire
from socialbot.deliberation.sensing import silence_of
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem, in_time
from socialbot.planning.pddl.formulas import Formula
from socialbot.planning.pddl.restriction import restricted
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import state_after
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerLimits


@dataclass(frozen=True)
class Bid:
    """Time (s) until a desire would be achieved; None with the reason if the agent cannot achieve it."""

    seconds: float | None
    reason: str = ""


def make_bid(deliberator: Deliberator, desire: Desire, then: Callable[[Bid], object]) -> None:
    """Estimate the time for a desire in the background, and call ``then`` in the thread of the engine.

    The agent first completes its plan, and the desires that precede the offered one. Those without a plan count as 0 s.
    """
    facts, pursuit = deliberator.facts, deliberator.pursuit
    if facts.fulfilled(desire):
        then(Bid(0.0))
        return
    reason = _obstacle(deliberator, desire)
    if reason:
        then(Bid(None, reason))
        return
    earlier, busy_s, problem = _prediction(deliberator, desire)
    goals = [facts.goal(one.wanted) for one in (*earlier, desire) if not any(map(facts.unknown_condition, one.wanted))]
    domain = facts.domain
    if pursuit.unavailable:
        domain, problem = restricted(domain, problem, pursuit.unavailable, ())
    limits = pursuit.options.limits
    work = functools.partial(_estimate, pursuit.planner, domain, problem, goals, desire.deadline, limits)

    def on_estimate(found: Any) -> None:
        if not isinstance(found, tuple):
            then(Bid(None, f"{type(found).__name__}: {found}"))
            return
        spent_s, answer = found
        plan = answer.plan
        if plan is None:
            then(Bid(None, answer.message or answer.verdict.value))
        elif not in_time(plan, desire.deadline):
            then(Bid(None, f"the plan lasts {plan.makespan_s:g} s, longer than the {desire.deadline:g} s there are"))
        elif unhandled := pursuit.without_handler(step.action for step in plan.steps):
            then(Bid(None, f"no plan or action performs {', '.join(unhandled)}"))
        else:
            then(Bid(busy_s + spent_s + plan.makespan_s))

    pursuit.run_in_background(work, lambda found: deliberator.engine.call(lambda: on_estimate(found)))


def _obstacle(deliberator: Deliberator, desire: Desire) -> str:
    """Return why the agent cannot pursue a desire now, or an empty text."""
    facts, silent = deliberator.facts, tuple(deliberator.sensor_timeouts.since)
    unknown = (facts.unknown_condition(condition) for condition in desire.wanted)
    if reason := next(filter(None, unknown), ""):
        return reason
    if silent and not deliberator.pursuit.unavailable:
        return silence_of(silent)
    if not (facts.satisfied(desire.precondition) and facts.satisfied(desire.context)):
        return "its precondition or context does not hold"
    return ""


def _prediction(deliberator: Deliberator, desire: Desire) -> tuple[list[Desire], float, PddlProblem]:
    """Return the desires that precede an offered one, the rest (s) of the plan, and the predicted state after it."""
    executor, pursuit = deliberator.plan_executor, deliberator.pursuit
    rank = (-desire.priority, desire.deadline)
    policy, current = pursuit.options.reschedule_policy, pursuit.current
    completes = current is not None and not pursuit.problem
    if current is not None and policy == "PREEMPT" and rank < current.rank[:2]:
        completes = False
    earlier = [
        state.desire
        for state in deliberator.desires.ranked
        if state.rank[:2] <= rank and not state.blocked and not (completes and state is current)
    ]
    if completes:
        return earlier, executor.remaining_s, executor.problem_after_plan()
    return earlier, 0.0, executor.projected()


def _estimate(
    planner: Planner,
    domain: PddlDomain,
    problem: PddlProblem,
    goals: Sequence[Formula],
    deadline_s: float,
    limits: PlannerLimits,
) -> tuple[float, PlannerAnswer]:
    """Plan for goals one after the other; return the time (s) for all but the last, and the answer for that."""
    spent_s = 0.0
    for goal in goals[:-1]:
        plan = planner.solve(domain, replace(problem, goal=goal), limits).plan
        if plan is not None:
            spent_s += plan.makespan_s
            problem = state_after(PddlState.of(problem, domain), plan).problem(None)
    last = replace(problem, goal=goals[-1])
    return spent_s, planner.solve(domain, last, replace(limits, makespan_s=deadline_s))
