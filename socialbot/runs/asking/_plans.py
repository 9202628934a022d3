"""Answers about plans: their steps, the next one, why there was a new plan, and how plans ended."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking._facts import near
from socialbot.runs.asking._question import NEAR_S
from socialbot.runs.asking._scope import MOST_NAMED, Scope, Told
from socialbot.runs.asking._sentences import Claim, Clause, infinitive
from socialbot.runs.asking._words import stem, tokens
from socialbot.runs.narration import plan_of, step_in


def steps(scope: Scope) -> Told | None:
    """Return the step of a number of the plans in question, or the number of steps and the first ones."""
    _, stamp = scope.moment()
    started = [
        each
        for each in scope.facts.plan_starts
        if each.stamp <= stamp and scope.agent in ("", each.source) and _is_named(each, scope)
    ]
    newest = {(each.source, each.what): each for each in _named(scope, started)}
    longest = sorted(newest.values(), key=lambda each: -len(each.detail["steps"]))
    return scope.told([clause for plan in longest for clause in _steps_of(scope, plan)][:MOST_NAMED])


def _steps_of(scope: Scope, plan: TraceRecord) -> list[Clause]:
    lines, order = [step_in(each) for each in plan.detail["steps"]], scope.question.ordinal
    whose = _owner(scope, plan.source)
    if order is not None:
        place = order if order > 0 else len(lines) + 1 + order
        text = f"step {{}} of {len(lines)} of {whose} plan for {plan.what} was to {{}}"
        return [_step(scope, plan, place, text)] if 0 < place <= len(lines) else []
    claim = Claim("step_count", plan.source, (plan.what,), scope.history.seconds(plan.stamp), value=float(len(lines)))
    number = "1 step" if len(lines) == 1 else f"{len(lines)} steps"
    counted = Clause(f"{whose} plan for {plan.what} had {number}", (plan.id,), claim)
    shown = [_step(scope, plan, place, "step {} was to {}") for place in range(1, min(len(lines), MOST_NAMED) + 1)]
    return [counted, *shown]


def _step(scope: Scope, plan: TraceRecord, place: int, text: str) -> Clause:
    step = step_in(plan.detail["steps"][place - 1])
    action, *arguments = step.strip("()").split()
    claim = Claim("step", plan.source, (step, plan.what), scope.history.seconds(plan.stamp), value=float(place))
    return Clause(text.format(place, infinitive(scope.subjects.wording.call(action, arguments))), (plan.id,), claim)


def _owner(scope: Scope, agent: str) -> str:
    return "my" if scope.speech.is_single else f"{scope.subjects.wording.name(agent)}'s"


def replanned(scope: Scope) -> Told | None:
    """Return how the plans ended that a new plan for the same goal followed; without one, the failures in question."""
    last = {(each.source, each.what): each.stamp for each in scope.facts.plan_starts}
    found = [
        each
        for each in _ends(scope)
        if each.detail.get("outcome") != "succeeded" and last.get((each.source, each.what), -1) >= each.stamp
    ]
    if scope.question.ordinal is not None:
        found = scope.one_of(found)
    return scope.told([scope.speech.ended(each) for each in found[-MOST_NAMED:]])


def ended(scope: Scope) -> Told | None:
    """Return how the plans in question ended: those whose goal or desire the words name, or else the last one."""
    return scope.told([scope.speech.ended(each) for each in scope.one_of(_ends(scope))])


def _ends(scope: Scope) -> list[TraceRecord]:
    """Return the ends of plans of the agent, things, goal and time in question."""
    found = [each for each in scope.until_now(scope.facts.plan_ends) if scope.agent in ("", each.source)]
    found = _named(scope, [each for each in found if _is_named(each, scope)])
    if scope.question.at_s is not None:
        found = near(found, scope.history.stamp(scope.question.at_s), NEAR_S)
    return found


def _named(scope: Scope, plans: Sequence[TraceRecord]) -> list[TraceRecord]:
    """Return the records of plans whose goal or desire has words of the question; all of them if there are none."""
    asked = {stem(word) for word in scope.question.unknown}
    named = [each for each in plans if asked.intersection(map(stem, tokens(each.what)))]
    return named or list(plans)


def _is_named(end: TraceRecord, scope: Scope) -> bool:
    things = set(scope.question.things) - {end.source}
    return things <= {*re.findall(r"\w+", end.what)}


def steps_ahead(scope: Scope, stamp: int) -> list[Clause]:
    """Return the next step of each plan in execution."""
    found = []
    for mind in scope.run.states.at(stamp).agents:
        for plan in mind.plans if scope.agent in ("", mind.name) else ():
            record = scope.history.find(plan.id)
            if record is not None:
                found.append(_step_ahead(scope, record, mind.name, stamp))
    return [each for each in found if each is not None][:MOST_NAMED]


def _step_ahead(scope: Scope, plan: TraceRecord, agent: str, stamp: int) -> Clause | None:
    """Return the first step of a plan that had not begun at ``stamp``; None if all had."""
    between = scope.history.between(plan.stamp, stamp)
    begun = Counter(each.what for each in between if each.kind == "step" and plan_of(scope.history, each) is plan)
    for place, line in enumerate(plan.detail.get("steps", ()), 1):
        step = step_in(line)
        if begun[step]:
            begun[step] -= 1
            continue
        action, *arguments = step.strip("()").split()
        sentence = scope.subjects.wording.call(action, arguments)
        text = f"step {place} of {_owner(scope, agent)} plan for {plan.what} was next: {sentence}"
        claim = Claim("planned", agent, (step, plan.what), scope.history.seconds(stamp), value=float(place))
        return Clause(text, (plan.id,), claim)
    return None
