"""The director: carries out plans, step by step, against what is believed.

A step starts as soon as all that has to happen before it has happened and its conditions are believed; time stamps of
the plan only say in which order to look. It is carried out by the goal of the engine that has the name of its action.
What the director decides goes on the trace:

| kind | meaning |
|---|---|
| `plan_start` | a plan for a desire is carried out; detail: plan (its number), steps, makespan_s |
| `step` | a step of it has begun; detail: action, args, planned_start, conditions (those that were checked) |
| `step_end` | it is over, or could not even begin; detail: outcome (successful, failed, cancelled), message |
| `plan_end` | the plan is over; detail: plan, outcome (succeeded, failed, aborted), reason |
| `hold`, `release` | nothing new is started for a while; detail: reason |

Each has what it follows from as its cause: a desire, its plan, the step, its goal and actions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from socialbot.bdi import Engine
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation.action_executor import ActionExecutor, Watched, fact_of
from socialbot.deliberation.execution import PlanExecution, PlanTask, merged, projected
from socialbot.deliberation.fact_index import FactIndex
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.matching import fitting
from socialbot.deliberation.messages import Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import DirectorOptions
from socialbot.deliberation.wakeup import Alarm
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Formula

__all__ = ["PlanExecutor", "DirectorOptions", "PlanOutcome"]

How = Literal["succeeded", "failed", "aborted"]


@dataclass(frozen=True)
class PlanOutcome:
    """How a plan ended, and the step that ended it, if one did; ``record`` is that of its end in the trace.

    A plan that has ``failed`` may have steps that are still right, and go on: see `PlanExecutor.running`.
    """

    how: How
    plan: int
    reason: str = ""
    step: PlanStep | None = None
    record: str = ""


class PlanExecutor:
    """Carries out one plan at a time. All calls are for the engine's thread; callbacks come in it, one by one.

    Effects on what is ``watched`` are left to the sensors, and waited for; others are believed when
    the step begins and ends. When a step fails or is cancelled, what it changed at its start is taken back, and nothing
    new is started: whoever hears of it, by ``ended``, calls `execute` with a plan that starts from `projected`, or
    `abort`. A step that goes on may fail, too: that is told as well. The plan aborts by itself when the context of its
    desire no longer holds, or when its time is over. ``changed`` is called when `info` has changed.
    """

    def __init__(
        self,
        engine: Engine,
        facts: FactBase,
        domain: PddlDomain,
        options: DirectorOptions | None = None,
        *,
        watched: Watched = lambda name, objects: False,
        ended: Callable[[PlanOutcome], object] = lambda outcome: None,
        changed: Callable[[], object] = lambda: None,
    ) -> None:
        self.domain = domain
        self.options = options or DirectorOptions()
        self._engine = engine
        self._facts = facts
        self._ended = ended
        self._changed = changed
        self._alarm = Alarm(engine, self._wake)
        self._performer = ActionExecutor(
            engine, facts, self.options, watched, self._alarm, self._wake, self._step_failed
        )
        self._execution: PlanExecution | None = None
        self._plans = 0
        self._thens: list[Callable[[], object]] | None = None
        self._outcomes: list[PlanOutcome] = []
        self._quiet = False
        self._held = ""
        self._posted = False
        self._told = ""
        self._report_due = 0
        facts.watch(lambda fact, held, cause: None if self.idle else self._wake())

    # What there is to know

    @property
    def idle(self) -> bool:
        """Whether there is nothing to do: no plan, and no action that still has to stop."""
        return self._execution is None and not self._performer.stopping

    @property
    def aborting(self) -> bool:
        """Whether a plan is being stopped; no other can be executed before it has."""
        return self._thens is not None

    @property
    def running(self) -> tuple[PlanTask, ...]:
        """The steps that have begun and are not over; also after their plan has failed."""
        return () if self._execution is None else tuple(self._execution.active())

    @property
    def info(self) -> PlanExecutionInfo:
        """How the plan fares; without a target when there is none."""
        now = self._engine.clock.now()
        if self._execution is None:
            return PlanExecutionInfo(stamp=now, agent_id=self._engine.name, plan=self._plans)
        return self._execution.info(self._engine.name, now)

    def projected(self, goal: Formula | None = None) -> PddlProblem:
        """What will be believed when the steps that run now have ended as planned: where a new plan starts from."""
        return projected(self._facts, self.domain, self.running, goal)

    def beliefs_if_aborted(self) -> tuple[Fact, ...]:
        """What would be believed if the plan were given up now, in order."""
        held = {fact.identity: fact for fact in self._facts.facts()}
        for key, value in self._performer.ledger.undone().items():
            fact = fact_of(key, value)
            held.pop(fact.identity, None)
            if value is not None and value is not False:
                held[fact.identity] = fact
        if self._execution is not None and not self._quiet:
            desire = self._execution.desire
            index = FactIndex(self.domain, held.values())
            for pattern in desire.rollback_belief_del:
                for fact in fitting(pattern, index):
                    held.pop(fact.identity, None)
            held.update((fact.identity, fact) for fact in desire.rollback_belief_add)
        return tuple(sorted(held.values(), key=lambda fact: fact.identity))

    # What to do

    def execute(
        self, plan: PddlPlan, desire: Desire, cause: str, *, began: int | None = None, domain: PddlDomain | None = None
    ) -> None:
        """Carries out a plan; steps that run already go on, as part of it, and the plan before is over.

        ``cause`` is the record that it follows from, ``began`` (ns) when the pursuit of the desire began, ``domain``
        that for which the plan was made. A plan that does not fit what is believed now fails before anything begins.
        Raises PlanningError while another plan is being aborted.
        """
        if self.aborting:
            raise PlanningError("another plan is still being stopped", remedy="wait until abort() has called back")
        now, going_on = self._engine.clock.now(), self.running
        self._plans += 1
        if self._execution is not None and self._execution.status == "RUNNING":
            self._end_plan(self._execution, "aborted", f"plan {self._plans} takes its place")
            self._tell()
        tasks, problem = going_on, ""
        try:
            if domain is not None and domain != self.domain:
                raise PlanningError("the domain has changed since the plan was made")
            goal = self._facts.goal(desire.wanted)
            tasks = merged(self.domain, self._facts, plan, goal, going_on, now)
        except PlanningError as error:
            problem = error.what
        pursued_since = now if began is None else began
        execution = PlanExecution(self._plans, desire, tasks, plan.makespan_s, now, pursued_since)
        execution.record = self._engine.record(
            "plan_start",
            desire.name,
            cause,
            plan=execution.number,
            steps=[str(step) for step in plan.steps],
            makespan_s=round(plan.makespan_s, 3),
        )
        self._execution = execution
        if problem:
            self._fail_plan(execution, problem)
        self._wake()

    def abort(self, reason: str, then: Callable[[], object] = lambda: None) -> None:
        """Stops all; calls ``then`` when every action has stopped and the rollback of the desire is done."""
        self._stop_all(reason, then)

    def finish(self, reason: str, then: Callable[[], object] = lambda: None) -> None:
        """Stops all, as `abort` does, but without the rollback: what the plan was for has come true."""
        if self._thens is None:
            self._quiet = True
        self._stop_all(reason, then)

    def revise(self, desire: Desire) -> None:
        """The desire that is pursued has another deadline or priority from now on."""
        if self._execution is not None and self._execution.desire.name == desire.name:
            self._execution.desire = desire
            self._wake()

    def _stop_all(self, reason: str, then: Callable[[], object]) -> None:
        if self._thens is not None:
            self._thens.append(then)
            return
        self._thens = [then]
        if self._execution is not None:
            if self._execution.status == "RUNNING":
                self._end_plan(self._execution, "aborted", reason)
            for task in self.running:
                self._guarded(lambda task=task: self._performer.give_up(task, "CANCELLED", reason))
        self._wake()

    def hold(self, reason: str) -> None:
        """Starts nothing new from now on, as sensors are silent; what runs goes on, and has time to be seen."""
        if not self._held:
            self._held = reason
            self._note("hold", reason)

    def release(self) -> None:
        """Goes on after `hold`."""
        if self._held:
            reason, self._held = self._held, ""
            self._note("release", reason)

    def _note(self, kind: str, reason: str) -> None:
        execution = self._execution
        cause = "" if execution is None else execution.record
        self._performer.blind = bool(self._held)
        self._engine.record(kind, "plan" if execution is None else execution.desire.name, cause, reason=reason)
        self._wake()

    # Thinking: whatever happens only asks for it; then everything is looked at, in a fixed order

    def _wake(self) -> None:
        if not self._posted:
            self._posted = True
            self._engine.call(self._think)

    def _think(self) -> None:
        self._posted = False
        self._alarm.begin()
        try:
            self._look_at_all()
        except Exception as problem:  # noqa: BLE001 - whatever is wrong with a plan, the agent does not stay with it
            self._break_off(problem)
        self._finish_abort()
        self._hand_out()
        self._report_regularly()
        self._alarm.end()

    def _look_at_all(self) -> None:
        execution = self._execution
        if execution is not None and execution.status == "RUNNING":
            self._look_at_desire(execution)
        for task in self.running:
            self._performer.look_at(task)
        self._performer.look_at_stopping()
        if execution is not None and execution.status == "RUNNING":
            self._begin_steps(execution)
            if all(task.status == "SUCCESSFUL" for task in execution.tasks):
                self._end_plan(execution, "succeeded")
                self._outcomes.append(PlanOutcome("succeeded", execution.number, record=execution.end_record))
        self._tell()
        if execution is not None and execution.status == "SUCCESSFUL":
            self._execution = None
            self._tell()

    def _break_off(self, problem: Exception) -> None:
        execution = self._execution
        self._engine.record_failure("director", "" if execution is None else execution.record, problem)
        if execution is not None:
            self._abort_itself(execution, f"{type(problem).__name__}: {problem}")
            self._tell()

    def _look_at_desire(self, execution: PlanExecution) -> None:
        """Aborts the plan when it is of no use any more."""
        factor, desire = self.options.rtc_deadline, execution.desire
        limit_s = factor * desire.deadline
        if not self._facts.satisfied(desire.context):
            reason = "the context of the desire no longer holds"
        elif self._alarm.is_due(execution.pursued_since + nanoseconds(limit_s)):
            reason = f"not achieved in {limit_s:g} s, {factor:g} times the deadline"
        else:
            return
        self._abort_itself(execution, reason)

    def _abort_itself(self, execution: PlanExecution, reason: str) -> None:
        def aborted() -> None:
            self._outcomes.append(PlanOutcome("aborted", execution.number, reason, record=execution.end_record))

        self.abort(reason, aborted)

    def _begin_steps(self, execution: PlanExecution) -> None:
        if self._held or self._performer.stopping:
            for task in execution.released():
                task.unmet_since = None  # its patience begins anew
            return
        for task in list(execution.released()):
            # One that fails at once ends the plan.
            if execution.status == "RUNNING":
                self._performer.begin_if_possible(task, execution.record)

    def _finish_abort(self) -> None:
        """Ends an abort when everything has stopped."""
        if self._thens is None or self._performer.stopping:
            return
        thens, execution, quiet = self._thens, self._execution, self._quiet
        self._thens = self._execution = None
        self._quiet = False
        if execution is not None:
            if not quiet:
                self._roll_back(execution)
            self._tell()
        for then in thens:
            self._guarded(then)

    def _roll_back(self, execution: PlanExecution) -> None:
        """Forgets first, as an effect in PDDL does, so that one list may put right what a pattern of the other took."""
        for fact in execution.desire.rollback_belief_del:
            self._guarded(lambda fact=fact: self._facts.remove(fact, execution.end_record))
        for fact in execution.desire.rollback_belief_add:
            self._guarded(lambda fact=fact: self._facts.add(fact, cause=execution.end_record))

    # How a plan ends

    def _step_failed(self, task: PlanTask, record: str) -> None:
        if self._execution is not None:
            self._fail_plan(self._execution, f"{task.step.call}: {task.message}", task.step, record)

    def _fail_plan(self, execution: PlanExecution, reason: str, step: PlanStep | None = None, cause: str = "") -> None:
        if execution.status == "RUNNING":
            self._end_plan(execution, "failed", reason, cause)
        self._outcomes.append(PlanOutcome("failed", execution.number, reason, step, execution.end_record))

    def _end_plan(self, execution: PlanExecution, how: How, reason: str = "", cause: str = "") -> None:
        execution.status = "SUCCESSFUL" if how == "succeeded" else "ABORT"
        execution.reason = reason
        execution.end_record = self._engine.record(
            "plan_end",
            execution.desire.name,
            cause or execution.record,
            plan=execution.number,
            outcome=how,
            reason=reason,
        )

    # Telling

    def _hand_out(self) -> None:
        """Tells how plans have ended; who hears of it may call anything."""
        outcomes, self._outcomes = self._outcomes, []
        for outcome in outcomes:
            self._guarded(lambda outcome=outcome: self._ended(outcome))

    def _tell(self) -> None:
        """Tells that the status of something has changed, if it has."""
        execution = self._execution
        state = f"{self._plans} {self._held} " if execution is None else execution.state() + self._held
        if state != self._told:
            self._told = state
            self._report()

    def _report_regularly(self) -> None:
        if self._execution is None or self._execution.status != "RUNNING":
            return
        if self._alarm.is_due(self._report_due):
            self._report()
            self._alarm.is_due(self._report_due)

    def _report(self) -> None:
        self._report_due = self._engine.clock.now() + nanoseconds(self.options.report_s)
        self._guarded(self._changed)

    def _guarded(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except Exception as problem:  # noqa: BLE001 - what others do with it never stops the plan
            self._engine.record_failure("director", "" if self._execution is None else self._execution.record, problem)
