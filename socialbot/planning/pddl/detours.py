"""Detours: a step that only leads to another one of the same action, so that one step can stand for both.

Searches for a first plan let a robot drive from A to B and from B to C where it could drive from A to C.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.causal_order import causal_order
from socialbot.planning.pddl.domain import SEPARATION_S, PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Add, Delete, Predicate, conjuncts
from socialbot.planning.pddl.semantics import GroundAction, evaluate, ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import EPSILON_S, validate_plan

_ROUNDS = 8
"""Largest number of times that the detours of a plan are removed: a detour of n steps needs n - 1 times."""


def without_detours(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> PddlPlan:
    """Return a valid plan that is as long as a valid plan or shorter, and has no more steps."""
    for _ in range(_ROUNDS):
        detours = list(_detours(domain, PddlState.of(problem, domain), plan))
        shorter = _removed(domain, problem, plan, detours) if detours else None
        if shorter is None:
            break
        plan = shorter
    return plan


def successors(first: Sequence[str], last: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield objects for a step that may stand for two of its action, except those of the first."""
    choices = (dict.fromkeys(pair) for pair in zip(first, last, strict=True))
    yield from (args for args in itertools.product(*choices) if args != tuple(first))


def compacted(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> PddlPlan | None:
    """Return a plan with each step as early as the causal order allows; None if it is not valid."""
    try:
        order = causal_order(domain, problem, plan)
    except PlanningError:
        return None
    times: dict[tuple[int, str], float] = {}
    steps = list(plan.steps)
    for number in sorted(range(len(steps)), key=lambda number: steps[number].start_s):
        step = steps[number]
        if any(event not in times for event in order.before_start[number]):
            return None
        starts = [times[event] + SEPARATION_S for event in order.before_start[number]]
        ends = [times[event] + SEPARATION_S - step.duration_s for event in order.before_end[number] if event in times]
        steps[number] = step = replace(step, start_s=max((0.0, *starts, *ends)))
        times[number, "start"], times[number, "end"] = step.start_s, step.end_s
    early = PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))
    return None if validate_plan(domain, problem, early) else early


@dataclass(frozen=True)
class _Detour:
    """Two steps, and the one that can stand for them."""

    first: PlanStep
    last: PlanStep
    direct: PlanStep


@dataclass(frozen=True)
class _Sets:
    """Predicates that an action needs, adds and deletes."""

    needs: frozenset[Predicate]
    added: frozenset[Predicate]
    deleted: frozenset[Predicate]

    @classmethod
    def of(cls, action: GroundAction) -> _Sets:
        parts = (part for one in action.conditions for part in conjuncts(one.formula))
        effects = [one.effect for one in action.effects]
        return cls(
            frozenset(part for part in parts if isinstance(part, Predicate)),
            frozenset(effect.predicate for effect in effects if isinstance(effect, Add)),
            frozenset(effect.predicate for effect in effects if isinstance(effect, Delete)),
        )


def _detours(domain: PddlDomain, state: PddlState, plan: PddlPlan) -> Iterator[_Detour]:
    """Yield detours that share no steps. What a first step adds, its last step alone needs, and deletes."""
    steps = sorted(plan.steps, key=lambda step: step.start_s)
    sets = [_Sets.of(ground(domain.actions[step.action], step.args)) for step in steps]
    users: defaultdict[Predicate, list[int]] = defaultdict(list)
    for number, one in enumerate(sets):
        for predicate in one.needs:
            users[predicate].append(number)
    used: set[int] = set()
    for number, step in enumerate(steps):
        later = [
            next((user for user in users[predicate] if steps[user].start_s >= step.end_s - EPSILON_S), None)
            for predicate in sets[number].added
        ]
        last = min((user for user in later if user is not None), default=number)
        if last == number or steps[last].action != step.action or used & {number, last}:
            continue
        if not sets[number].added & sets[last].needs <= sets[last].deleted:
            continue
        for args in successors(step.args, steps[last].args):
            direct = _Sets.of(ground(domain.actions[step.action], args))
            new = direct.needs - sets[number].needs
            if (
                direct.deleted == sets[number].deleted
                and direct.added == sets[last].added
                and all(map(state.holds, new))
                and (one := _step(domain, state, step, args)) is not None
            ):
                used |= {number, last}
                yield _Detour(step, steps[last], one)
                break


def _step(domain: PddlDomain, state: PddlState, step: PlanStep, args: tuple[str, ...]) -> PlanStep | None:
    duration = ground(domain.actions[step.action], args).duration
    if duration is None:
        return replace(step, args=args)
    least_s = None if duration.least is None else evaluate(duration.least, state)
    return None if least_s is None else replace(step, args=args, duration_s=least_s)


def _removed(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan, detours: Sequence[_Detour]) -> PddlPlan | None:
    """Return the plan without some of the detours, all of them if possible; None if it is not shorter."""
    gone = {step for detour in detours for step in (detour.first, detour.last)}
    steps = [*(step for step in plan.steps if step not in gone), *(detour.direct for detour in detours)]
    fewer = PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))
    shorter = compacted(domain, problem, fewer)
    if shorter is not None and shorter.makespan_s <= plan.makespan_s + EPSILON_S:
        return shorter
    if len(detours) == 1:
        return None
    half = len(detours) // 2
    return _removed(domain, problem, plan, detours[:half]) or _removed(domain, problem, plan, detours[half:])
