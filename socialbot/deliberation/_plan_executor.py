"""The plan executor: it runs the steps of a plan, and checks their conditions and effects against beliefs.

A step starts when its predecessors in the causal order have happened and its conditions hold; time stamps of the plan
only order the checks. An engine goal with the name of the action performs it. Decisions go to the trace:

| kind | meaning |
|---|---|
| `plan_start` | a plan for a desire starts; detail: plan (its number), steps, makespan_s |
| `step` | a step starts; detail: action, args, planned_start, conditions (those that were checked) |
| `step_end` | a step has ended, or could not start; detail: outcome (successful, failed, cancelled), message |
| `plan_end` | the plan has ended; detail: plan, outcome (succeeded, failed, aborted), reason |
| `hold`, `release` | no step starts for a while; detail: reason |

The cause of a plan is its planning; that of a step is its plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from socialbot.bdi import Engine
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._action_executor import ActionExecutor, IsSensed, fact_of
from socialbot.deliberation._execution import PlanExecution, PlanTask, merged, projected, with_expected
from socialbot.deliberation._fact_index import FactIndex
from socialbot.deliberation._matching import fitting
from socialbot.deliberation._outlook import Doubt, PlanOutlook
from socialbot.deliberation._redirection import Redirector
from socialbot.deliberation._wakeup import WakeupLoop
from socialbot.deliberation.facts import FactBase, problem_of
from socialbot.deliberation.messages import INSTANCE, Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Formula, Key
from socialbot.planning.pddl.restriction import touches
from socialbot.planning.pddl.state import PddlState, Projection
from socialbot.planning.pddl.validation import state_after

How = Literal["succeeded", "failed", "aborted"]

_TRACE_NAME = "director"


@dataclass(frozen=True)
class PlanOutcome:
    """End of a plan, and its ``record`` in the trace.

    A failed plan may have steps that continue, see `PlanExecutor.running`. ``failed`` is the step that has failed, and
    ``done`` are the steps that have succeeded.
    """

    how: How
    plan: int
    reason: str = ""
    record: str = ""
    failed: PlanStep | None = None
    done: tuple[PlanStep, ...] = ()


class PlanExecutor:
    """Executes one plan at a time. Call all methods in the thread of the engine.

    Sensed effects are waited for; others are believed when the step starts and ends. A failed or cancelled step rolls
    its start effects back, and no new step starts. The receiver of ``ended`` then calls `execute` with a plan that
    starts from `projected`, or `abort`. The plan aborts by itself when the context of its desire no longer holds, or
    when its time is over.

    Args:
        is_sensed: Whether sensors report a fact.
        ended: Called with the outcome of each plan, and of each further failed step.
        doubted: Called with a condition of a later step that does not hold and that no step makes true; once for each.
        changed: Called when `info` has changed.
    """

    def __init__(
        self,
        engine: Engine,
        facts: FactBase,
        options: DeliberationOptions | None = None,
        *,
        is_sensed: IsSensed = lambda name, objects: False,
        ended: Callable[[PlanOutcome], object] = lambda outcome: None,
        doubted: Callable[[str], object] = lambda reason: None,
        changed: Callable[[], object] = lambda: None,
    ) -> None:
        self.options = options or DeliberationOptions()
        self._engine = engine
        self._facts = facts
        self._ended = ended
        self._doubted = doubted
        self._changed = changed
        self._loop = WakeupLoop(engine, self._check, _TRACE_NAME)
        self._is_sensed = is_sensed
        self._actions = ActionExecutor(engine, facts, self.options, is_sensed, self._loop, self._on_step_failed)
        self._execution: PlanExecution | None = None
        self._plans = 0
        self._after_abort: list[Callable[[], object]] | None = None
        self._outcomes: list[PlanOutcome] = []
        self.finishing_steps = False
        """Whether running steps may end before the abort."""
        self.revising = False
        """Whether another plan is being made for the same desire; no step starts meanwhile."""
        self._keep_effects = False
        self._hold_reason = ""
        self._published = ""
        self._report_due = 0
        self._outlook: PlanOutlook | None = None
        facts.watch(self._on_fact)

    def _on_fact(self, fact: Fact, held: bool, cause: str) -> None:
        if self._outlook is not None:
            self._outlook.note(fact.name)
        if not self.idle:
            self._loop.wake()

    @property
    def idle(self) -> bool:
        """Whether there is neither a plan nor an action that still has to stop."""
        return self._execution is None and not self._actions.stopping

    @property
    def aborting(self) -> bool:
        """Whether a plan is being stopped; `execute` is not allowed until then."""
        return self._after_abort is not None

    @property
    def running(self) -> tuple[PlanTask, ...]:
        """Steps that have started and not ended; also after their plan has failed."""
        return () if self._execution is None else tuple(self._execution.active())

    @property
    def info(self) -> PlanExecutionInfo:
        """State of the plan; without a target if there is none."""
        now = self._loop.now
        if self._execution is None:
            return PlanExecutionInfo(stamp=now, agent_id=self._engine.name, plan=self._plans)
        return self._execution.info(self._engine.name, now)

    def projected(self, goal: Formula | None = None) -> PddlProblem:
        return projected(self._facts, self._facts.domain, self.running, goal)

    @property
    def remaining_s(self) -> float:
        """Estimated time (s) until the end of the plan."""
        execution = self._execution
        if execution is None:
            return 0.0
        now = self._loop.now
        return max(0.0, execution.estimated_end_s(now) - execution.seconds(now))

    def problem_after_plan(self) -> PddlProblem:
        """Return the predicted state after the end of the plan, without a goal."""
        domain, execution = self._facts.domain, self._execution
        waiting = [] if execution is None else [task.step for task in execution.tasks if task.phase == "waiting"]
        return state_after(PddlState.of(self.projected(), domain), PddlPlan(tuple(waiting))).problem(None)

    def beliefs_if_aborted(self) -> tuple[Fact, ...]:
        """Return the predicted facts after an abort, in order."""
        held = {fact.identity: fact for fact in self._facts.facts()}
        for key, value in self._actions.rollback_log.undone().items():
            fact = fact_of(key, value)
            held.pop(fact.identity, None)
            if value is not None and value is not False:
                held[fact.identity] = fact
        return self._rolled_back(held.values())

    def problem_if_aborted(self, goal: Formula | None) -> PddlProblem:
        """Return the predicted state after an abort. Sensed effects that no sensor has reported yet have happened."""
        return with_expected(problem_of(self.beliefs_if_aborted(), self._facts.domain, goal), self._facts, self.running)

    def problem_after_steps(self, goal: Formula | None) -> PddlProblem:
        """Return the predicted state after `finish_steps`."""
        domain, state = self._facts.domain, self.projected(goal)
        instances = (fact for fact in self._facts.facts() if fact.pddl_type == INSTANCE)
        keys = (*((fact, True) for fact in state.facts), *state.values.items())
        return problem_of(self._rolled_back((*instances, *(fact_of(*key) for key in keys))), domain, goal)

    def _rolled_back(self, facts: Iterable[Fact]) -> tuple[Fact, ...]:
        """Return facts after the rollback of the desire, in order."""
        held = {fact.identity: fact for fact in facts}
        if self._execution is not None and not self._keep_effects:
            desire = self._execution.desire
            index = FactIndex(self._facts.domain, held.values())
            for pattern in desire.rollback_belief_del:
                for fact in fitting(pattern, index):
                    held.pop(fact.identity, None)
            held.update((fact.identity, fact) for fact in desire.rollback_belief_add)
        return tuple(sorted(held.values(), key=lambda fact: fact.identity))

    def execute(
        self, plan: PddlPlan, desire: Desire, cause: str, *, began: int | None = None, domain: PddlDomain | None = None
    ) -> None:
        """Execute a plan; running steps continue as part of it. A plan that does not fit current beliefs fails.

        Args:
            cause: Trace record that the plan follows from.
            began: Start (ns) of the pursuit of the desire.
            domain: The domain that the plan was made for.

        Raises:
            PlanningError: Another plan is being aborted.
        """
        if self.aborting:
            raise PlanningError("another plan is still being stopped", remedy="wait until abort() has called back")
        now, running = self._loop.now, self.running
        self._plans += 1
        if self._execution is not None and self._execution.status == "RUNNING":
            self._end_plan(self._execution, "aborted", f"plan {self._plans} takes its place")
            self._publish()
        tasks, problem, pointless = running, "", dict[PlanTask, str]()
        try:
            if domain is not None and domain != self._facts.domain:
                raise PlanningError("the domain has changed since the plan was made")
            goal = self._facts.goal(desire.wanted)
            tasks = merged(self._facts.domain, self._facts, plan, goal, running, now)
            redirector = Redirector(self._facts, goal, now, self._is_sensed, self._actions.rollback_log.undone)
            if (redirection := redirector.redirect(plan, running)) is not None:
                plan, tasks, pointless = redirection.plan, redirection.tasks, redirection.ended
        except PlanningError as error:
            problem = error.what
        pursued_since = now if began is None else began
        execution = PlanExecution(self._plans, desire, tasks, plan.makespan_s, now, pursued_since)
        execution.record = self._engine.trace.record(
            "plan_start",
            desire.name,
            cause,
            plan=execution.number,
            steps=[str(step) for step in plan.steps],
            makespan_s=round(plan.makespan_s, 3),
        )
        self._execution = execution
        self._outlook = PlanOutlook(tasks, self._facts.domain)
        for task, message in pointless.items():
            self._actions.give_up(task, "CANCELLED", message, cause=execution.record)
        if problem:
            self._fail_plan(execution, problem)
        self._loop.wake()

    def abort(self, reason: str, then: Callable[[], object] = lambda: None) -> None:
        """Stop all steps; call ``then`` when every action has stopped and the desire's rollback is done."""
        if self._after_abort is not None:
            self._after_abort.append(then)
            if not self.finishing_steps:
                return
        else:
            self._after_abort = [then]
        self.finishing_steps = False
        if self._execution is not None:
            if self._execution.status == "RUNNING":
                self._end_plan(self._execution, "aborted", reason)
            for task in self.running:
                self._guarded(lambda task=task: self._actions.give_up(task, "CANCELLED", reason))
        self._loop.wake()

    def finish_steps(self, reason: str, then: Callable[[], object] = lambda: None) -> None:
        """Start no further step, and call ``then`` after the end of the running ones and the desire's rollback.

        `abort` stops them earlier.
        """
        if self.aborting:
            self.abort(reason, then)
            return
        self._after_abort, self.finishing_steps = [then], True
        if self._execution is not None and self._execution.status == "RUNNING":
            self._end_plan(self._execution, "aborted", reason)
        self._loop.wake()

    def finish(self, reason: str, then: Callable[[], object] = lambda: None) -> None:
        """Stop all steps without the desire's rollback, as the desire is fulfilled."""
        if self._after_abort is None or self.finishing_steps:
            self._keep_effects = True
        self.abort(reason, then)

    def revise(self, desire: Desire) -> None:
        """Apply a new deadline or priority of the pursued desire."""
        if self._execution is not None and self._execution.desire.name == desire.name:
            self._execution.desire = desire
            self._loop.wake()

    def hold(self, reason: str) -> None:
        """Start no new step, because of a sensor timeout; running steps continue and their effects may come late."""
        if not self._hold_reason:
            self._hold_reason = reason
            self._record_hold("hold", reason)

    def needs(self, unavailable: Sequence[Key]) -> bool:
        """Return whether a step that has not ended touches unavailable parts of the state."""
        execution = self._execution
        if execution is None or not unavailable:
            return False
        return any(touches(task.action, unavailable) for task in execution.tasks if task.phase != "over")

    def release(self) -> None:
        if self._hold_reason:
            reason, self._hold_reason = self._hold_reason, ""
            self._record_hold("release", reason)

    def _record_hold(self, kind: str, reason: str) -> None:
        execution = self._execution
        self._actions.sensors_timed_out = bool(self._hold_reason)
        what = "plan" if execution is None else execution.desire.name
        self._engine.trace.record(kind, what, self._plan_record, reason=reason)
        self._loop.wake()

    @property
    def _plan_record(self) -> str:
        return "" if self._execution is None else self._execution.record

    def _check(self) -> None:
        """Check desire, steps and stopping actions in a fixed order."""
        self._loop.rearm()
        try:
            self._check_plan()
        except Exception as problem:  # noqa: BLE001 - an error in a plan aborts it and not the agent
            execution = self._execution
            self._engine.trace.record_failure(_TRACE_NAME, self._plan_record, problem)
            if execution is not None:
                self._abort_from_inside(execution, f"{type(problem).__name__}: {problem}")
                self._publish()
        self._finish_abort()
        outcomes, self._outcomes = self._outcomes, []
        for outcome in outcomes:
            self._guarded(lambda outcome=outcome: self._ended(outcome))
        if self._execution is not None and self._execution.status == "RUNNING" and self._loop.is_due(self._report_due):
            self._report()
            self._loop.is_due(self._report_due)

    def _check_plan(self) -> None:
        execution = self._execution
        if execution is not None and execution.status == "RUNNING":
            self._check_desire(execution)
        for task in self.running:
            self._actions.check(task)
        self._actions.check_stopping()
        if execution is not None and execution.status == "RUNNING":
            self._look_ahead(execution)
            self._start_steps(execution)
            if all(task.status == "SUCCESSFUL" for task in execution.tasks):
                self._end_plan(execution, "succeeded")
                self._outcomes.append(PlanOutcome("succeeded", execution.number, "", execution.end_record))
        self._publish()
        if execution is not None and execution.status == "SUCCESSFUL":
            self._execution = None
            self._publish()

    def prove_doubts(self) -> None:
        """Note that there is no plan without the conditions in doubt. The plan fails when nothing else is left."""
        if self._outlook is not None:
            self._outlook.prove()
            self._loop.wake()

    def _look_ahead(self, execution: PlanExecution) -> None:
        """Report a condition of a later step that has not held for ``patience_s`` and that the plan does not change."""
        if self._outlook is None or self._hold_reason:
            return
        hopeless = self._outlook.hopeless(self._facts.goal(execution.desire.wanted), self._beliefs())
        if hopeless is not None:
            self._fail_plan(execution, _doubt_text(hopeless))
            return
        for doubt, since in list(self._outlook.unmet(self._beliefs(), self._loop.now)):
            if self._loop.is_due(since + nanoseconds(self.options.patience_s)):
                self._outlook.raise_doubt(doubt)
                self._guarded(lambda doubt=doubt: self._doubted(_doubt_text(doubt)))
                return

    def _beliefs(self) -> Projection:
        return Projection(self._facts, self._facts.domain)

    def _check_desire(self, execution: PlanExecution) -> None:
        factor, desire = self.options.rtc_deadline, execution.desire
        limit_s = factor * desire.deadline
        if not self._facts.satisfied(desire.context):
            self._abort_from_inside(execution, "the context of the desire no longer holds")
        elif self._loop.is_due(execution.pursued_since + nanoseconds(limit_s)):
            self._abort_from_inside(execution, f"not achieved in {limit_s:g} s, {factor:g} times the deadline")

    def _abort_from_inside(self, execution: PlanExecution, reason: str) -> None:
        def aborted() -> None:
            self._outcomes.append(PlanOutcome("aborted", execution.number, reason, execution.end_record))

        self.abort(reason, aborted)

    def _start_steps(self, execution: PlanExecution) -> None:
        if self._hold_reason or self.revising or self._actions.stopping:
            for task in execution.released():
                task.unmet_since = None
            return
        for task in list(execution.released()):
            if execution.status == "RUNNING":  # a step that fails at once ends the plan
                self._actions.start_if_possible(task, execution.record)

    def _finish_abort(self) -> None:
        if self._after_abort is None or self._actions.stopping or (self.finishing_steps and self.running):
            return
        self.finishing_steps = False
        callbacks, execution, keep_effects = self._after_abort, self._execution, self._keep_effects
        self._after_abort = self._execution = None
        self._keep_effects = False
        if execution is not None:
            if not keep_effects:
                self._roll_back(execution)
            self._publish()
        for callback in callbacks:
            self._guarded(callback)

    def _roll_back(self, execution: PlanExecution) -> None:
        # Deletions come first, as in PDDL, so that additions can restore facts that a pattern has deleted.
        for fact in execution.desire.rollback_belief_del:
            self._guarded(lambda fact=fact: self._facts.remove(fact, execution.end_record))
        for fact in execution.desire.rollback_belief_add:
            self._guarded(lambda fact=fact: self._facts.add(fact, cause=execution.end_record))

    def _on_step_failed(self, task: PlanTask, record: str) -> None:
        if self._execution is not None and not self.finishing_steps:
            self._fail_plan(self._execution, f"{task.step.call}: {task.message}", record, task.step)

    def _fail_plan(
        self, execution: PlanExecution, reason: str, cause: str = "", failed: PlanStep | None = None
    ) -> None:
        if execution.status == "RUNNING":
            self._end_plan(execution, "failed", reason, cause)
        done = tuple(task.step for task in execution.tasks if task.status == "SUCCESSFUL")
        self._outcomes.append(PlanOutcome("failed", execution.number, reason, execution.end_record, failed, done))

    def _end_plan(self, execution: PlanExecution, how: How, reason: str = "", cause: str = "") -> None:
        execution.status = "SUCCESSFUL" if how == "succeeded" else "ABORT"
        execution.reason = reason
        execution.end_record = self._engine.trace.record(
            "plan_end",
            execution.desire.name,
            cause or execution.record,
            plan=execution.number,
            outcome=how,
            reason=reason,
        )

    def _publish(self) -> None:
        execution, hold = self._execution, self._hold_reason
        state = f"{self._plans} {hold} " if execution is None else execution.state() + hold
        if state != self._published:
            self._published = state
            self._report()

    def _report(self) -> None:
        self._report_due = self._loop.now + nanoseconds(self.options.report_s)
        self._guarded(self._changed)

    def _guarded(self, callback: Callable[[], object]) -> None:
        self._loop.guarded(callback, self._plan_record)


def _doubt_text(doubt: Doubt) -> str:
    call, condition = doubt
    return f"{call} cannot start: {condition} does not hold"
