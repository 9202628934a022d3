"""Which steps make a body rest, so that others have their turn."""

from __future__ import annotations

from socialbot.bdi.compiler.source import Function
from socialbot.bdi.compiler.terms import value
from socialbot.bdi.internals import find
from socialbot.bdi.literals import Literal
from socialbot.bdi.steps import Achieve, Await, Constrain, Do, Enter, Forget, Fork, Step, Update
from socialbot.bdi.terms import Variable


def straight(body: tuple[Step, ...]) -> bool:
    """Whether a body can run in place: changes, actions and comparisons, perhaps with a goal at the end."""
    for i, step in enumerate(body):
        if isinstance(step, Achieve):
            if not step.apart and (i < len(body) - 1 or step.limit_s is not None or isinstance(step.goal, Variable)):
                return False
        elif isinstance(step, Do):
            entry = find(step.action.functor)
            if step.limit_s is not None or pauses(step.action) or (entry is not None and entry.aware):
                return False
        elif not isinstance(step, (Update, Forget, Constrain, Enter)):
            return False
    return True


def rests(step: Step) -> bool:
    """Whether a step, other than an `Action`, rests: others have their turn before it ends."""
    if isinstance(step, Do):
        return pauses(step.action)
    return isinstance(step, (Await, Fork))


def pauses(action: Literal) -> bool:
    """Whether an internal action may have to wait. What is sent does not, unless an answer is waited for."""
    if action.functor == ".send":
        return len(action.args) > 3
    entry = find(action.functor)
    return entry is not None and entry.pauses


def limited(f: Function, pause: str, limit_s: object) -> str:
    """The expression of a pause that ends after ``limit_s`` at the latest, if that is not None."""
    return pause if limit_s is None else f"ag.limited({pause}, {value(f, limit_s)})"
