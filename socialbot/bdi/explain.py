"""Explanations: where an intention is, why a plan was not chosen, what led to an action."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from socialbot.bdi.intentions import Intention, goal_of
from socialbot.bdi.library import Ready
from socialbot.bdi.literals import Event, Goal, Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.steps import Step
from socialbot.bdi.terms import Comparison
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.belief_base import Memory
    from socialbot.bdi.library import Ready, Trigger


@dataclass(frozen=True, slots=True)
class Level:
    """One plan of an intention. ``step`` is the one it is at: waiting for its end, or about to begin it.

    ``plan`` is None for a branch, and where only a goal is kept; ``goal`` is None for a plan about an event.
    """

    plan: Plan | None
    goal: Literal | None
    step: Step | None

    def __str__(self) -> str:
        if self.plan is None:
            return str(self.goal or "a branch")
        head = self.plan.label or written(self.plan.event, self.plan)
        goal = f" for {self.goal}" if self.goal is not None else ""
        return f"{head}{goal}{f', at {written(self.step, self.plan)}' if self.step is not None else ''}"


def written(item: Event | Step, plan: Plan) -> str:
    """An event or step in the notation of its plan."""
    if plan.text is None:
        return str(item)
    from socialbot.bdi.agentspeak.printer import agentspeak

    return agentspeak(item)


def stack_of(intention: Intention, kinds: Mapping[str, type[Goal]]) -> tuple[Level, ...]:
    """The plans of an intention, the outermost first; ``kinds`` are the classes of goals by name."""
    levels = []
    for body, request, ready in intention.frames:
        known = ready if isinstance(getattr(ready, "plan", None), Plan) else None
        goal = None if request is None else goal_of(request, kinds)
        if known is None and goal is None and body is not None and (later := later_request(body)) is not None:
            goal = goal_of(later, kinds)
        passed = body is intention.frames[-1][0] and intention.pause is None
        step = step_of(body, known, passed=passed) if body is not None and known is not None else None
        levels.append(Level(known.plan if known is not None else None, goal, step))
    return tuple(levels)


def step_of(body: Any, ready: Ready, *, passed: bool) -> Step | None:
    """The step that a body is at; with ``passed``, as it has only stopped to let others have their turn, the next."""
    frame = body.gi_frame
    if frame is None:
        return None
    lines, local = ready.lines, frame.f_locals
    if inspect.getgeneratorstate(body) == inspect.GEN_CREATED:
        if "start" in local:
            steps = ready.plan.body
            # A body that began in place and rests at a step goes on with the one behind it.
            at = local["start"] - (local.get("pause") is not None)
            return steps[at] if at < len(steps) else None
        return ready.plan.body[0] if ready.plan.body else None
    text = _line(frame)
    if text == "yield pause":
        steps, at = ready.plan.body, local["start"] - (not passed)
        return steps[at] if at < len(steps) else None
    if passed or text == "yield":
        later = [line for line in lines if line > frame.f_lineno]
        return lines[min(later)] if later else None
    before = [line for line in lines if line <= frame.f_lineno]
    return lines[max(before)] if before else None


def later_request(body: Any) -> Any:
    """The request of a body that only asks for a goal (see `socialbot.bdi.reasoner`); None for other bodies."""
    if body.gi_frame is None or body.gi_code.co_name != "_later":
        return None
    local = body.gi_frame.f_locals
    return local.get("request")


def _line(frame: Any) -> str:
    """The source of the line at which a generated function rests."""
    source = frame.f_globals["__loader__"].get_source("").split("\n")
    return source[frame.f_lineno - 1].strip()


def reason_against(memory: Memory, ready: Ready, args: tuple[Any, ...], notes: tuple[Any, ...]) -> str | None:
    """Why a plan does not apply to an event as things stand; None when it does."""
    plan = ready.plan
    if plan.stage is not None and plan.stage != memory.stage:
        return f"the stage is {memory.stage or 'none'}, not {plan.stage}"
    terms = plan.condition.terms
    for count in range(len(terms) + 1):
        try:
            holds = ready.fits(memory, args, notes, count)
        except Exception as problem:  # noqa: BLE001 - a condition is user code
            return f"{terms[count - 1]} raises {type(problem).__name__}: {problem}"
        if not holds:
            return f"{_shown(terms[count - 1])} does not hold" if count else "the event does not match"
    return None


def reasons_against(
    memory: Memory, trigger: Trigger, args: tuple[Any, ...], notes: tuple[Any, ...], before: Ready | None = None
) -> list[dict[str, str]]:
    """For each plan that may fit an event (those before ``before`` only), why it does not apply."""
    found = []
    for ready in trigger.candidates(args):
        if ready is before:
            break
        reason = reason_against(memory, ready, args, notes)
        found.append({"plan": ready.plan.label or ready.shown()[0], "because": reason or "another plan came first"})
    return found


def why_not(memory: Memory, label: str, args: tuple[Any, ...] | None = None) -> str:
    """Why the plan with this label would not be chosen now, for an event with these arguments."""
    for trigger in list(memory.triggers.values()):
        for ready in trigger.plans:
            if label not in (ready.plan.label, str(ready.plan)):
                continue
            if args is None:
                args = _example(ready)
            own = reason_against(memory, ready, args, ())
            earlier = [other for other in reasons_against(memory, trigger, args, (), ready)
                       if other["because"] == "another plan came first"]  # fmt: skip
            if own is not None:
                return own
            return f"{earlier[0]['plan']} comes first" if earlier else "it applies"
    raise RuleError(f"there is no plan {label}", remedy="give the label of a plan, or its text")


def _example(ready: Ready) -> tuple[Any, ...]:
    """The arguments of the plan's event, if they are constants."""
    args = ready.plan.event.literal.args
    if ready.plan.event.literal.names():
        raise RuleError(
            f"{ready.plan.event} can happen in many ways", remedy="give the arguments of the event you think of"
        )
    return args


def _shown(term: object) -> str:
    return f"({term})" if isinstance(term, Comparison) else str(term)
