"""Pursuit of one desire at a time: request a plan, accept it, execute it, repair it or give it up."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from socialbot.bdi import Engine
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._plan_executor import PlanExecutor, PlanOutcome
from socialbot.deliberation.desires import DesireState, End, Setback
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import Desire, FactCondition
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep, in_time
from socialbot.planning.pddl.formulas import Key
from socialbot.planning.pddl.reachability import losing_step
from socialbot.planning.pddl.restriction import restricted
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerVerdict

GRACE_S = 5.0
"""Time after the planner's timeout until it is taken to have crashed."""

AVOIDED_AFTER = 2
"""Number of failures of a step after which plans avoid it as long as they achieve something else."""

MAX_AVOIDED = 30
"""Largest number of steps that a plan avoids because of conditions that it leaves out."""

UNSOLVABLE_FACTOR = 8
"""Multiple of ``retry_s`` until a plan proved impossible is requested again for unchanged facts."""

RunInBackground = Callable[[Callable[[], Any], Callable[[Any], None]], None]
"""Runs work outside the agent's thread; calls back in that thread with the result or exception."""


@dataclass(eq=False)
class PlanRequest:
    """A request for a plan of at most ``max_makespan_s`` (s).

    A desire that preempts another is planned for from the state after an abort, or ``after_steps``: after the end of
    the running steps. With a ``doubt`` about the running plan, another one replaces it. The plan leaves out the
    conditions ``without``, which nothing can make true, and the steps ``avoided``, which have failed.
    """

    state: DesireState
    domain: PddlDomain
    max_makespan_s: float
    cause: str
    after_steps: bool = False
    doubt: str = ""
    without: tuple[FactCondition, ...] = ()
    avoided: tuple[PlanStep, ...] = ()
    problem: PddlProblem | None = None
    cancelled: threading.Event = field(default_factory=threading.Event)

    @property
    def desire(self) -> Desire:
        """The desire, without the conditions that are left out."""
        desire = self.state.desire
        if not self.without:
            return desire
        rest = tuple(condition for condition in desire.wanted if condition not in self.without)
        return msgspec.structs.replace(desire, value=(), conditions=rest)


@dataclass(eq=False)
class DesirePursuit:
    """Pursues one desire. Call all methods in the thread of the engine.

    Attributes:
        end: Called when a desire is fulfilled, or has failed too often.
        wake: Called when the deliberator should run another pass.
        current: The desire that is pursued.
        problem: Why its plan has failed, if it has.
        unavailable: Facts of silent sensors, which no step of a new plan may touch.
    """

    engine: Engine
    facts: FactBase
    plan_executor: PlanExecutor
    planner: Planner
    run_in_background: RunInBackground
    options: DeliberationOptions
    end: Callable[[DesireState, End, str], object]
    wake: Callable[[], object]
    current: DesireState | None = field(init=False, default=None)
    problem: str = field(init=False, default="")

    def __post_init__(self) -> None:
        self._began = 0
        self._plan_began = 0
        self._preempted: tuple[DesireState, DesireState] | None = None
        self._request: PlanRequest | None = None
        self._failed_plan = 0
        self._failed_at = ""
        self._is_partial = False
        self._silent: tuple[str, ...] = ()
        self.unavailable: tuple[Key, ...] = ()

    @property
    def planning_for(self) -> DesireState | None:
        """The desire that the planner works on: the current one (repair), or one that precedes it."""
        return None if self._request is None else self._request.state

    def request_plan(self, state: DesireState) -> None:
        """Request a plan for a desire, unless one is requested for it or for one of a higher rank."""
        if self._request is not None:
            if self._request.state.rank <= state.rank:
                return
            self.cancel_request()
        if self.current is state and not state.context_holds():
            self.abort("the context of the desire no longer holds")
            return
        makespan_s, cause = self._max_makespan(state)
        avoided = tuple(one.step for one in state.setbacks.values() if one.times >= AVOIDED_AFTER)
        self._send(PlanRequest(state, self.facts.domain, makespan_s, cause, avoided=avoided))

    def revise_plan(self, doubt: str) -> None:
        """Request another plan for the current desire, while the running one goes on; without one nothing changes."""
        state = self.current
        if state is None or self.problem or self._request is not None or self.plan_executor.aborting:
            return
        makespan_s, _ = self._max_makespan(state)
        record = self.engine.trace.record("doubt", state.name, state.record, reason=doubt)
        avoided = tuple(one.step for one in state.setbacks.values() if one.times >= AVOIDED_AFTER)
        self._send(PlanRequest(state, self.facts.domain, makespan_s, record, doubt=doubt, avoided=avoided))

    def _send(self, request: PlanRequest) -> None:
        try:
            problem = self._planning_problem(request)
        except PlanningError as error:
            self._take(request, PlannerAnswer(PlannerVerdict.REFUSED, message=error.what))
            return
        domain, request.problem = request.domain, problem
        self.plan_executor.revising = bool(request.doubt)
        if self.unavailable or request.avoided:
            domain, problem = restricted(domain, problem, self.unavailable, request.avoided)
        self._request = request
        limits = replace(self.options.limits, makespan_s=request.max_makespan_s)
        work = functools.partial(self.planner.solve, domain, problem, limits, request.cancelled)

        def time_out() -> None:
            request.cancelled.set()
            self.on_answer(request, PlannerAnswer(PlannerVerdict.FAILED, message="the planner does not answer"))

        self.engine.timers.after(limits.timeout_s + GRACE_S, time_out, lambda: request is not self._request)
        self.run_in_background(work, lambda answer: self.engine.call(lambda: self.on_answer(request, answer)))

    def change_unavailable(self, sensors: Iterable[str], facts: tuple[Key, ...]) -> bool:
        """Plan without steps that need silent sensors, given their facts; return whether that is new."""
        if facts == self.unavailable:
            return False
        self._silent, self.unavailable = tuple(f"sensor {sensor}" for sensor in sensors), facts
        self.cancel_request()
        return True

    def cancel_request(self) -> None:
        if self._request is not None:
            self._request.cancelled.set()
            self._request = None
            self.plan_executor.revising = False

    def _planning_problem(self, request: PlanRequest) -> PddlProblem:
        """Return the initial state and goal; that of a preempting desire is predicted.

        Raises PlanningError for an unknown object.
        """
        for condition in request.desire.wanted:
            reason = self.facts.unknown_condition(condition)
            if reason:
                raise PlanningError(reason)
        goal = self.facts.goal(request.desire.wanted)
        if self._preempts(request.state):
            executor = self.plan_executor
            return executor.problem_after_steps(goal) if request.after_steps else executor.problem_if_aborted(goal)
        return self.plan_executor.projected(goal) if self.plan_executor.running else self.facts.problem(goal)

    def _max_makespan(self, state: DesireState) -> tuple[float, str]:
        """Return the time (s) for a plan, less for a repair, and the cause of the request."""
        deadline = state.desire.deadline
        if self.current is not state:
            return deadline, state.record
        spent = (self.engine.clock.now() - self._began) / SECOND
        return min(deadline, max(0.0, deadline * self.options.rtc_deadline - spent)), self._failed_at

    def on_answer(self, request: PlanRequest, answer: Any) -> None:
        if request is not self._request:
            return
        self._request = None
        self.plan_executor.revising = False
        if not isinstance(answer, PlannerAnswer):
            message = "the planner returned no answer" if answer is None else f"{type(answer).__name__}: {answer}"
            answer = PlannerAnswer(PlannerVerdict.FAILED, message=message)
        elif answer.verdict is PlannerVerdict.SOLVED and answer.plan is None:
            answer = PlannerAnswer(PlannerVerdict.FAILED, message="the planner returned no plan")
        self._take(request, answer)

    def _take(self, request: PlanRequest, answer: PlannerAnswer) -> None:
        state, plan = request.state, answer.plan if answer.verdict is PlannerVerdict.SOLVED else None
        message = answer.message
        if plan is None:
            without = f"without {' and '.join(self._silent)}: " if self._silent else ""
            message = without + (message or answer.verdict.value)
        elif not in_time(plan, request.max_makespan_s):
            message = f"the plan lasts {plan.makespan_s:g} s, longer than the {request.max_makespan_s:g} s there are"
        detail = {} if plan is None else {"steps": len(plan.steps), "makespan_s": round(plan.makespan_s, 3)}
        record = self.engine.trace.record(
            "planning", state.name, request.cause, verdict=answer.verdict.value, message=message, **detail
        )
        unhandled = () if plan is None else self.without_handler(step.action for step in plan.steps)
        if unhandled:
            self.end(state, "dropped", f"no plan or action performs {', '.join(unhandled)}")
        elif (loses := self._losing_step(request, plan)) is not None and len(request.avoided) < MAX_AVOIDED:
            self._send(replace(request, avoided=(*request.avoided, loses)))
            return
        elif plan is None or message:
            rest = self._without_unreachable(request, answer)
            if rest is not None:
                self._send(rest)
                return
            if request.avoided:  # nothing else is left to do
                self._send(replace(request, without=(), avoided=()))
                return
            if request.doubt and not self.problem:
                if answer.verdict is PlannerVerdict.IMPOSSIBLE:
                    self.plan_executor.prove_doubts()
                self.wake()
                return
            if self._preempts(state) and not request.after_steps and self.plan_executor.running:
                self._send(replace(request, after_steps=True, without=()))
                return
            self._on_planning_failed(state, message, unsolvable=answer.verdict is PlannerVerdict.IMPOSSIBLE)
        elif self.current is not state and state.blocked:
            pass  # its precondition has stopped holding since the request
        elif self._preempts(state):
            # The plan is made anew after the abort: the facts may differ from the predicted ones.
            assert self.current is not None
            self._preempted = state, self.current
            self.abort(f"{state.name} comes first", finish_steps=request.after_steps)
        else:
            if self.current is None:
                self.current, self._began = state, self.engine.clock.now()
            self._plan_began = self.engine.clock.now()
            self._preempted = None
            self.problem = ""
            state.failed_planning = state.fruitless = 0
            self._is_partial = bool(request.without)
            self.plan_executor.execute(plan, request.desire, record, began=self._began, domain=request.domain)
        self.wake()

    def _without_unreachable(self, request: PlanRequest, answer: PlannerAnswer) -> PlanRequest | None:
        """Return a request without the conditions that nothing can make true, if others are left to achieve."""
        if not self.options.partial_desires or not answer.unreachable:
            return None
        wanted = request.desire.wanted
        impossible = [one for one in wanted if self.facts.goal((one,)).parts[0] in answer.unreachable]
        rest = [one for one in wanted if one not in impossible]
        if not impossible or all(map(self.facts.check, rest)):
            return None
        return replace(request, without=(*request.without, *impossible))

    def _losing_step(self, request: PlanRequest, plan: PddlPlan | None) -> PlanStep | None:
        """Return a step of a partial plan after which nothing could make the conditions true that it leaves out."""
        if plan is None or request.problem is None or not request.without:
            return None
        return losing_step(request.domain, request.problem, plan, self.facts.goal(request.without).parts)

    def _preempts(self, state: DesireState) -> bool:
        return self.current is not None and self.current is not state

    def without_handler(self, actions: Iterable[str]) -> tuple[str, ...]:
        """Return the actions that have neither a `PlanAction` nor a plan of the engine."""
        triggers, known = self.engine.library.triggers, self.facts.domain.actions
        goals = {name: f"+!{name}/{len(known[name].parameters)}" for name in actions if name in known}
        return tuple(name for name, goal in goals.items() if goal not in triggers or not triggers[goal].plans)

    def _on_planning_failed(self, state: DesireState, reason: str, *, unsolvable: bool) -> None:
        now = self.engine.clock.now()
        if self._preempts(state):  # a prediction failed, which says little about the state that will come
            state.fruitless += 1
            state.not_before = now + self._pause(state.fruitless)
            return
        self._note_progress(state)
        state.failed_planning += 1
        if self._preempted is not None and self._preempted[0] is state and self._preempted[1] is not self.current:
            state.never_preempts.append(self._preempted[1])
            self._preempted = None
        if state.failed_planning >= self.options.comp_plan_tries:
            reason = f"no plan after {_times(state.failed_planning, 'try', 'tries')}: {reason}"
            self.end(state, "dropped", self._reason(state, reason))
            return
        state.not_before = now + self._pause(state.failed_planning)
        if unsolvable:
            until = now + UNSOLVABLE_FACTOR * nanoseconds(self.options.retry_s)
            state.unsolvable_version, state.unsolvable_until = self.facts.version, until
        if self.current is state:
            self.abort(f"no new plan: {reason}")

    def _pause(self, failures: int) -> int:
        """Return the time (ns) until the next attempt, which doubles from the fourth failure on."""
        factor = min(2 ** max(failures - 3, 0), UNSOLVABLE_FACTOR)
        return factor * nanoseconds(self.options.retry_s)

    def abort(self, reason: str, *, finish_steps: bool = False) -> None:
        """Stop the plan, perhaps after the running steps; its desire remains and may be planned for again."""
        executor = self.plan_executor
        if not executor.aborting:
            self.cancel_request()
            stop = executor.finish_steps if finish_steps else executor.abort
            stop(reason, self._on_stopped)
        elif executor.finishing_steps and not finish_steps:
            executor.abort(reason)

    def forget(self, state: DesireState, how: End, reason: str) -> None:
        """Stop the request and plan of a desire that has ended."""
        if self.planning_for is state:
            self.cancel_request()
        if self.current is not state:
            return
        if how == "dropped":
            self.abort(reason)
        elif not self.plan_executor.aborting:
            self.cancel_request()
            self.plan_executor.finish(reason, self._on_stopped)
        elif self.plan_executor.finishing_steps:
            self.plan_executor.finish(reason)

    def revise(self, state: DesireState) -> None:
        """Apply a new deadline or priority; an open request is made again."""
        self.cancel_request()
        if self.current is state:
            self.plan_executor.revise(state.desire)

    def on_plan_ended(self, outcome: PlanOutcome) -> None:
        """Process the end of a plan, or the failure of one of its steps."""
        state = self.current
        if state is None:
            return
        self._note_setbacks(state, outcome)
        self._note_progress(state)
        partly = outcome.how == "succeeded" and self._is_partial
        if outcome.how == "aborted" or partly or (outcome.how == "succeeded" and state.is_fulfilled()):
            self.current, self.problem = None, ""
        if state.is_fulfilled():
            self.end(state, "fulfilled", "")
        elif not partly and outcome.plan != self._failed_plan:  # several steps of one plan may fail
            self._failed_plan, self._failed_at = outcome.plan, outcome.record
            self._on_execution_failed(state, outcome.reason or "the plan has ended, but its goal does not hold")
        self.wake()

    def _note_setbacks(self, state: DesireState, outcome: PlanOutcome) -> None:
        """Count the failures of a step until it or a whole plan succeeds."""
        for step in outcome.done:
            state.setbacks.pop(step.call, None)
        if outcome.failed is not None:
            setback = state.setbacks.setdefault(outcome.failed.call, Setback(outcome.failed))
            setback.times, setback.reason = setback.times + 1, outcome.reason
        elif outcome.how == "succeeded":
            for setback in state.setbacks.values():
                setback.times = 0

    def _note_progress(self, state: DesireState) -> None:
        """Forget failures before more conditions of a desire held than ever."""
        met = sum(map(self.facts.check, state.desire.wanted))
        if met > state.most_met:
            state.most_met, state.failed_planning, state.failed_execution = met, 0, 0

    def _reason(self, state: DesireState, reason: str) -> str:
        """Return the reason of a dropped desire, with its missing conditions and the steps that have failed."""
        wanted = state.desire.wanted
        left = [self._text(condition) for condition in wanted if not self.facts.check(condition)]
        unnamed = [text for text in left if text not in reason]
        if unnamed and self.options.partial_desires:
            reason += f"; missing: {', '.join(unnamed)}"
        for setback in state.setbacks.values():
            if setback.reason not in reason:
                reason += f"; before: {setback.reason}"
        return reason

    def _text(self, condition: FactCondition) -> str:
        try:
            return str(self.facts.goal((condition,)).parts[0])
        except PlanningError:  # of an object that has gone
            return str(condition.condition_to_check)

    def _on_execution_failed(self, state: DesireState, reason: str) -> None:
        state.failed_execution += 1
        state.not_before = max(state.not_before, self._plan_began + self._pause(state.failed_execution))
        if state.failed_execution >= self.options.exec_plan_tries:
            reason = f"aborted {_times(state.failed_execution, 'time', 'times')}: {reason}"
            self.end(state, "dropped", self._reason(state, reason))
        elif self.current is not None:
            self.problem = reason

    def _on_stopped(self) -> None:
        self.current, self.problem = None, ""
        self.wake()


def _times(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
