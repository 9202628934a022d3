"""Meta-events: changes of the states of goals, as events for plans such as ``^!g(X)[state(achieved)]``.

Only an agent with a plan for a meta-event has `GoalStates`; all others do no work for them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.intentions import DONE, EVENT, KEPT, EventPause, Failure, Intention, Request, Sleep
from socialbot.bdi.literals import Literal, literal, literal_from_key
from socialbot.bdi.stdlib.registry import detached
from socialbot.bdi.terms import Atom
from socialbot.bdi.unification import resolve

if TYPE_CHECKING:
    from socialbot.bdi._interpreter import Interpreter
    from socialbot.bdi.library import Trigger

_REASONS = {
    "no_relevant": "no_relevant_plan",
    "no_applicable": "no_applicable_plan",
    "cancelled": "drop_by_fail_goal",
}
"""Jason's reasons of the state ``failed``; the others are those of the failure event."""


class GoalStates:
    """Reports the states of goals as meta-events, which are handled at the begin of the next turn, before all events.

    Args:
        interpreter: The interpreter of the agent.
    """

    __slots__ = ("_announced", "_interpreter", "_replaced")

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self._announced: dict[int, tuple[Any, ...]] = {}
        self._replaced: list[Request] = []

    def tell(self, goal: Request, state: str, reason: Any = "") -> None:
        """Post the meta-event that a goal is in a state, if a plan may handle it."""
        sign = "^?" if goal[1].key[1:2] == "?" and state != "pending" else "^!"
        trigger = self._interpreter.triggers[f"{sign}{goal[1].key[2:]}"]
        if goal[0] & EVENT or not trigger.plans:
            return
        note = literal("state", (Atom(state),), (literal("reason", (reason,)),))
        request = (EVENT, trigger, detached(goal[2]), (*goal[3], note), goal[4])
        self._interpreter.inbox.append(_MetaEvent(self._interpreter, request))

    def pending(self, goal: Request) -> None:
        """Report an adopted goal, unless it was `announced`."""
        if self._announced.pop(id(goal[3]), None) is None:
            self.tell(goal, "pending")

    def announced(self, goal: Request) -> Request:
        """Report a goal that is queued, and return it with annotations that `pending` recognizes."""
        self.tell(goal, "pending")
        kind, trigger, args, notes, cause = goal
        notes = (*notes, *())  # a new object
        self._announced[id(notes)] = notes
        return (kind, trigger, args, notes, cause)

    def executing(self, goal: Request) -> None:
        """Report a goal with a plan; only questions are not ``executing``, as in Jason."""
        if goal[1].key[1] == "!":
            self.tell(goal, "executing")
        self._finish_replaced()

    def finished(self, goal: Request | None, state: str) -> None:
        """Report the end of a goal: ``achieved``, ``dropped`` or, after an earlier report of its failure, ``""``."""
        if goal is not None:
            if state:
                self.tell(goal, state)
            self.tell(goal, "finished")

    def replaced(self, goal: Request) -> None:
        """Report a goal as achieved as soon as its last goal, which replaces it, has a plan."""
        self._replaced.append(goal)

    def _finish_replaced(self) -> None:
        for goal in self._replaced:
            self.finished(goal, "achieved")
        self._replaced.clear()

    def failed(
        self, intention: Intention, goal: Request | None, problem: Failure, failure_plans: Callable[[Request], Trigger]
    ) -> list[Request]:
        """Report a failed goal; return it and the goals below it, which may have failure plans."""
        goals = _goals(intention)
        if goal is None:
            return goals
        goals.insert(0, goal)
        self.tell(goal, "failed", Atom(_REASONS.get(problem.reason, problem.reason)))
        if problem.reason != "cancelled" and any(failure_plans(each).plans for each in goals):
            self.tell(goal, "executing", Atom("has_failure_plan"))
        return goals

    def lost(self, goals: list[Request]) -> None:
        """Report the goals of a failed intention, the innermost first, which failed before."""
        for place, goal in enumerate(goals):
            self.finished(goal, "failed" if place else "")

    # Intentions

    def waiting(self, intention: Intention) -> None:
        """Report the innermost goal of an intention that began to wait."""
        self._of_top(intention, "waiting", pause_term(intention))

    def resumed(self, intention: Intention) -> None:
        """Report the innermost goal of an intention after `.resume`, which may wait still."""
        self._of_top(intention, "resumed", Atom("resume_ia"))
        if intention.pause is not None:
            self.waiting(intention)
        else:
            self.continued(intention)

    def continued(self, intention: Intention, reason: Any = "") -> None:
        """Report the innermost goal of an intention that executes steps again."""
        self._of_top(intention, "executing", reason)

    def woken(self, intention: Intention) -> None:
        """Report the innermost goal of an intention whose wait has ended: a suspended one is suspended once more."""
        (self.suspended if intention.suspended else self.continued)(intention)

    def suspended(self, intention: Intention) -> None:
        """Report the innermost goal of an intention after `.suspend`, or after its wait."""
        self._of_top(intention, "suspended", Atom("suspend_ia"))

    def dropped(self, intention: Intention) -> None:
        """Report all goals of a dropped intention."""
        for goal in _goals(intention):
            self.finished(goal, "dropped")

    def _of_top(self, intention: Intention, state: str, reason: Any) -> None:
        _, goal, plan = intention.frames[-1] if intention.frames else (None, None, None)
        if goal is not None and plan is not KEPT:
            self.tell(goal, state, reason)


@dataclass(eq=False)
class _MetaEvent:
    """Posted meta-event. Its plan begins before other intentions continue, except for an atomic one."""

    mental: ClassVar[bool] = True
    """A restored mental state replaces pending objects of this class."""

    interpreter: Interpreter
    request: Request

    def __call__(self) -> None:
        interpreter, request = self.interpreter, self.request
        if interpreter.intentions.atomic is not None:
            interpreter.events.append(request[1:])
            return
        plan, result = interpreter.select_plan(*request[1:], True)
        if plan is not None and result is not DONE:
            interpreter.intentions.intend(request, plan, result, first=True)


def _goals(intention: Intention) -> list[Request]:
    """Return the goals of an intention, the innermost first."""
    return [goal for _, goal, plan in reversed(intention.frames) if goal is not None and plan is not KEPT]


class WatchedBody:
    """Body of a plan that reports the end of its goal."""

    __slots__ = ("_body", "_goal", "_states")

    def __init__(self, body: Any, states: GoalStates, goal: Request) -> None:
        self._body = body
        self._states = states
        self._goal = goal

    def __iter__(self) -> WatchedBody:
        return self

    def __next__(self) -> Any:
        try:
            return next(self._body)
        except StopIteration:
            self._states.finished(self._goal, "achieved")
            raise

    def __getattr__(self, name: str) -> Any:
        """Attribute of the generator, such as ``gi_frame``."""
        return getattr(self._body, name)


def pause_term(intention: Intention) -> Any:
    """Reason of a suspended or waiting intention: ``wait(N)[time(500)]``, ``wait(N)[b(1)]``, or ``suspend_ia``.

    Other pauses have a string.
    """
    match intention.pause:
        case Sleep(seconds):
            return _wait(intention, literal("time", (round(seconds * 1000),)))
        case EventPause(key, args, notes):
            return _wait(intention, literal_from_key(key.lstrip("+-!?"), resolve(args), notes))
        case None:
            return Atom("suspend_ia")
    return str(intention.pause)


def _wait(intention: Intention, what: Literal) -> Literal:
    return literal("wait", (intention.number,), (what,))
