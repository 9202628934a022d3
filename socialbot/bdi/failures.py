"""Failures: why a goal could not be achieved, in a form that plans can react to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from socialbot.bdi.actions import PlanFailed
from socialbot.bdi.literals import Annotation, error, error_msg
from socialbot.bdi.terms import Atom

REASONS = {
    "action_failed": "an action said that it failed",
    "exception": "an action raised an exception",
    "no_relevant": "no plan fits the goal",
    "no_applicable": "plans fit the goal, but the condition of none holds",
    "test_goal_failed": "nothing believed answers a question",
    "constraint_failed": "a comparison or unification in a body does not hold",
    "ia_failed": "an internal action failed",
    "wrong_arguments": "an internal action was given the wrong number or kind of arguments",
    "no_value": "a variable has no value where one is needed",
    "timeout": "it took longer than allowed",
    "wait_timeout": "what was waited for did not come",
    "ask_failed": "the answer to a question does not fit",
    "cancelled": "it was given up from outside",
}
"""Why goals fail. ``-g[error(E), error_msg(M)]`` binds E to one of these, as an atom, and M to a sentence."""


class code(Annotation):  # noqa: N801 - written as AgentSpeak writes it
    """The step that failed."""


class Failed(PlanFailed):
    """A failure with a reason, one of `REASONS`, and the annotations that it adds to the event."""

    def __init__(self, reason: str, message: str = "", annotations: tuple[Any, ...] = ()) -> None:
        super().__init__(message or REASONS.get(reason, reason))
        self.reason = reason
        self.annotations = annotations


@dataclass(frozen=True)
class Failure:
    """Why a goal failed: the reason, a sentence, the step that failed, its record in the trace, the place in the text
    of its plan.
    """

    reason: str
    message: str
    step: str
    cause: Any
    more: tuple[Any, ...] = ()
    where: str = ""

    @property
    def annotations(self) -> tuple[Any, ...]:
        """The same as annotations of the failure event."""
        given = (error(Atom(self.reason)), error_msg(self.message), code(self.step))
        return (*self.more, *given) if self.more else given


def failure(problem: Exception, step: str, cause: Any) -> Failure:
    """The failure that an exception in a step amounts to."""
    if isinstance(problem, Failed):
        return Failure(problem.reason, str(problem), step, cause, problem.annotations)
    if isinstance(problem, PlanFailed):
        return Failure("action_failed", str(problem), step, cause)
    return Failure("exception", f"{type(problem).__name__}: {problem}", step, cause)
