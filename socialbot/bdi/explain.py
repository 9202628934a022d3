"""Explanations: why a plan was not chosen, and what led to an action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from socialbot.bdi.terms import Comparison
from socialbot.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.library import Ready, Trigger
    from socialbot.bdi.memory import Memory


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
