"""The pursuit of one desire at a time: a plan is asked for, accepted, carried out, mended or given up."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from socialbot.bdi import Engine
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation.desires import DesireState, End
from socialbot.deliberation.facts import FactBase, problem_of
from socialbot.deliberation.options import Options
from socialbot.deliberation.plan_executor import PlanExecutor, PlanOutcome
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem, in_time
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerVerdict

GRACE_S = 5.0
"""A planner that has not answered so long after its time is over is given up."""

HOPELESS_FACTOR = 8
"""While nothing is believed anew, this many times longer passes before a plan proved impossible is asked for again."""

Aside = Callable[[Callable[[], Any], Callable[[Any], None]], None]
"""Has work done beside the agent, and calls back in the agent's thread with its result or exception."""


@dataclass(eq=False)
class PlanRequest:
    """What the planner is asked: a plan for a desire, in a domain, that lasts ``longest_s`` at most."""

    wish: DesireState
    domain: PddlDomain
    longest_s: float
    cause: str
    cancelled: threading.Event = field(default_factory=threading.Event)


class DesirePursuit:
    """Pursues desires, one at a time. All calls are for the engine's thread.

    ``wish`` is the desire that is pursued, and ``asked`` the one for which a plan is looked for, which may be the same
    (its plan has failed: ``problem`` says why), or one that comes first. ``end`` is called when a desire is fulfilled,
    or has failed too often; ``wake`` when there is something to think about.
    """

    def __init__(
        self,
        engine: Engine,
        facts: FactBase,
        director: PlanExecutor,
        planner: Planner,
        aside: Aside,
        options: Options,
        end: Callable[[DesireState, End, str], object],
        wake: Callable[[], object],
    ) -> None:
        self.wish: DesireState | None = None
        self.problem = ""
        self._engine = engine
        self._facts = facts
        self._director = director
        self._planner = planner
        self._aside = aside
        self._options = options
        self._end = end
        self._wake = wake
        self._began = 0
        self._plan_began = 0
        self._interrupted: tuple[DesireState, DesireState] | None = None
        self._question: PlanRequest | None = None
        self._failed_plan = 0
        self._failed_at = ""

    @property
    def asked(self) -> DesireState | None:
        """The desire for which a plan is looked for."""
        return None if self._question is None else self._question.wish

    # Asking

    def ask(self, wish: DesireState) -> None:
        """Has a plan made for a desire, unless one is being made for it, or for one that comes first."""
        if self._question is not None:
            if self._question.wish.rank <= wish.rank:
                return
            self.withdraw()
        if self.wish is wish and not wish.is_in_context():
            self.abort("the context of the desire no longer holds")
            return
        question = PlanRequest(wish, self._facts.domain, *self._longest(wish))
        try:
            snapshot = self._snapshot(wish)
        except PlanningError as error:
            self._take(question, PlannerAnswer(PlannerVerdict.REFUSED, message=error.what))
            return
        self._question = question
        limits = replace(self._options.limits, makespan_s=question.longest_s)
        work = functools.partial(self._planner.solve, question.domain, snapshot, limits, question.cancelled)
        self._engine.at_in(limits.timeout_s + GRACE_S, _Overdue(self, question))
        self._aside(work, lambda answer: self._engine.call(lambda: self._hear(question, answer)))

    def withdraw(self) -> None:
        """Wants no plan any more."""
        if self._question is not None:
            self._question.cancelled.set()
            self._question = None

    def _snapshot(self, wish: DesireState) -> PddlProblem:
        """What a plan starts from: for who interrupts, what there will be when the others have been stopped.

        Raises PlanningError for an object that is not known.
        """
        for condition in wish.desire.wanted:
            reason = self._facts.unknown_condition(condition)
            if reason:
                raise PlanningError(reason)
        goal = self._facts.goal(wish.desire.wanted)
        if self.wish is not None and self.wish is not wish:
            return problem_of(self._director.beliefs_if_aborted(), self._facts.domain, goal)
        return self._director.projected(goal) if self._director.running else self._facts.problem(goal)

    def _longest(self, wish: DesireState) -> tuple[float, str]:
        """How long a plan may last, s, and what it is asked for because of.

        It has the time until the deadline; to mend a plan, not more than is left until it would be aborted.
        """
        deadline = wish.desire.deadline
        if self.wish is not wish:
            return deadline, wish.record
        spent = (self._engine.clock.now() - self._began) / SECOND
        return min(deadline, max(0.0, deadline * self._options.rtc_deadline - spent)), self._failed_at

    def hear_nothing(self, question: PlanRequest) -> None:
        """Gives up a planner that should have answered long ago."""
        question.cancelled.set()
        self._hear(question, PlannerAnswer(PlannerVerdict.FAILED, message="the planner does not answer"))

    def is_open(self, question: PlanRequest) -> bool:
        """Whether the answer is still waited for."""
        return question is self._question

    # The answer

    def _hear(self, question: PlanRequest, answer: Any) -> None:
        if not self.is_open(question):
            return
        self._question = None
        if answer is None:
            answer = PlannerAnswer(PlannerVerdict.FAILED, message="the planner gives no answer")
        elif not isinstance(answer, PlannerAnswer):
            answer = PlannerAnswer(PlannerVerdict.FAILED, message=f"{type(answer).__name__}: {answer}")
        elif answer.verdict is PlannerVerdict.SOLVED and answer.plan is None:
            answer = PlannerAnswer(PlannerVerdict.FAILED, message="the planner gives no plan")
        self._take(question, answer)

    def _take(self, question: PlanRequest, answer: PlannerAnswer) -> None:
        wish, plan = question.wish, answer.plan if answer.verdict is PlannerVerdict.SOLVED else None
        message = answer.message
        if plan is None:
            message = message or answer.verdict.value
        elif not in_time(plan, question.longest_s):
            message = f"the plan lasts {plan.makespan_s:g} s, longer than the {question.longest_s:g} s there are"
        detail = {} if plan is None else {"steps": len(plan.steps), "makespan_s": round(plan.makespan_s, 3)}
        record = self._engine.record(
            "planning", wish.name, question.cause, verdict=answer.verdict.value, message=message, **detail
        )
        idle = () if plan is None else self.not_carried_out(step.action for step in plan.steps)
        if idle:
            self._end(wish, "dropped", f"nobody carries out {', '.join(idle)}")
        elif plan is None or message:
            self._planning_failed(wish, message, hopeless=answer.verdict is PlannerVerdict.IMPOSSIBLE)
        elif self.wish is not wish and wish.blocked:
            pass  # It was not when this plan was asked for.
        elif self.wish is not None and self.wish is not wish:
            # A plan is made anew then: what is left behind may not be quite what was foreseen.
            self._interrupted = wish, self.wish
            self.abort(f"{wish.name} comes first")
        else:
            self._execute(question, answer, record)
        self._wake()

    def not_carried_out(self, actions: Iterable[str]) -> tuple[str, ...]:
        """Those of some actions of the domain for which neither a `PlanAction` nor a plan of the engine is known."""
        triggers, known = self._engine.triggers, self._facts.domain.actions
        goals = {name: f"+!{name}/{len(known[name].parameters)}" for name in actions if name in known}
        return tuple(name for name, goal in goals.items() if goal not in triggers or not triggers[goal].plans)

    def _planning_failed(self, wish: DesireState, reason: str, *, hopeless: bool) -> None:
        wish.failed_planning += 1
        if self._interrupted is not None and self._interrupted[0] is wish and self._interrupted[1] is not self.wish:
            wish.in_vain.append(self._interrupted[1])
            self._interrupted = None
        if wish.failed_planning >= self._options.comp_plan_tries:
            self._end(wish, "dropped", f"no plan after {_times(wish.failed_planning, 'try', 'tries')}: {reason}")
            return
        now, pause = self._engine.clock.now(), nanoseconds(self._options.retry_s)
        wish.not_before = now + pause
        if hopeless:
            wish.hopeless_at, wish.hopeless_until = self._facts.version, now + HOPELESS_FACTOR * pause
        if self.wish is wish:
            self.abort(f"no new plan: {reason}")

    # Carrying out

    def _execute(self, question: PlanRequest, answer: PlannerAnswer, cause: str) -> None:
        wish, plan = question.wish, answer.plan
        assert plan is not None
        if self.wish is None:
            self.wish, self._began = wish, self._engine.clock.now()
        self._plan_began = self._engine.clock.now()
        self._interrupted = None
        self.problem = ""
        wish.failed_planning = 0
        self._director.execute(plan, wish.desire, cause, began=self._began, domain=question.domain)

    def abort(self, reason: str) -> None:
        """Stops the plan; its desire stays, and may have its turn again."""
        if not self._director.aborting:
            self.withdraw()
            self._director.abort(reason, self._stopped)

    def forget(self, wish: DesireState, how: End, reason: str) -> None:
        """A desire has ended: stops what is done for it."""
        if self._question is not None and self._question.wish is wish:
            self.withdraw()
        if self.wish is not wish:
            return
        if how == "dropped":
            self.abort(reason)
        elif not self._director.aborting:
            self.withdraw()
            self._director.finish(reason, self._stopped)

    def revise(self, wish: DesireState) -> None:
        """A desire has another deadline or priority from now on; a plan that is looked for is asked for anew."""
        if self._question is not None:
            self.withdraw()
        if self.wish is wish:
            self._director.revise(wish.desire)

    def hear(self, outcome: PlanOutcome) -> None:
        """How a plan has ended, or that a step of it has failed, as the director tells it."""
        wish = self.wish
        if wish is None:
            return
        if outcome.how == "aborted" or (outcome.how == "succeeded" and wish.is_fulfilled()):
            self.wish, self.problem = None, ""
        if wish.is_fulfilled():
            self._end(wish, "fulfilled", "")
        elif outcome.plan != self._failed_plan:
            # Of one plan several steps may fail.
            self._failed_plan, self._failed_at = outcome.plan, outcome.record
            self._execution_failed(wish, outcome.reason or "the plan is done, but not all that is wanted holds")
        self._wake()

    def _execution_failed(self, wish: DesireState, reason: str) -> None:
        wish.failed_execution += 1
        wish.not_before = max(wish.not_before, self._plan_began + nanoseconds(self._options.retry_s))
        if wish.failed_execution >= self._options.exec_plan_tries:
            self._end(wish, "dropped", f"aborted {_times(wish.failed_execution, 'time', 'times')}: {reason}")
        elif self.wish is not None:
            self.problem = reason

    def _stopped(self) -> None:
        self.wish, self.problem = None, ""
        self._wake()


class _Overdue:
    """A timer that is over when the planner has answered."""

    __slots__ = ("_pursuit", "_question")

    def __init__(self, pursuit: DesirePursuit, question: PlanRequest) -> None:
        self._pursuit = pursuit
        self._question = question

    def __call__(self) -> None:
        if self._pursuit.is_open(self._question):
            self._pursuit.hear_nothing(self._question)

    def over(self) -> bool:
        return not self._pursuit.is_open(self._question)


def _times(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
