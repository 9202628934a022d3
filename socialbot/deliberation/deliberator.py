"""The deliberator of an agent: it applies rules, ends fulfilled desires, and chooses the desire to plan for.

Changes of beliefs and desires, finished plans and planner answers schedule one pass, `Deliberator.think`, in the
thread of the engine. Decisions go to the trace:

| kind | meaning |
|---|---|
| `desire` | a desire was adopted or revised; detail: priority, deadline |
| `desire_refused` | a desire was rejected; detail: reason |
| `desire_fulfilled`, `desire_dropped` | a desire has ended; detail: reason |
| `rule` | a rule has fired; detail: effect |
| `planning` | the planner has answered; detail: verdict, message, steps, makespan_s |
| `silent`, `heard` | a sensor has timed out, or has recovered |

The cause of a desire is a rule, file or request; that of a planning is the desire or the end of the plan before.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from socialbot.bdi import Engine
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._action_executor import IsSensed
from socialbot.deliberation._fact_index import like
from socialbot.deliberation._plan_executor import PlanExecutor
from socialbot.deliberation._pursuit import DesirePursuit, RunInBackground
from socialbot.deliberation._wakeup import WakeupLoop
from socialbot.deliberation.desires import (
    UNACHIEVABLE,
    DesireBase,
    DesireState,
    End,
    Listener,
    lifted,
    missing_preparations,
    next_desire,
    prepares,
    relatives_to_drop,
)
from socialbot.deliberation.facts import FactBase, out_of_range
from socialbot.deliberation.messages import Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import DeliberationOptions
from socialbot.deliberation.rules import Reaction, ReactiveRule, RuleBook, unfit_parts
from socialbot.deliberation.sensing import SensorTimeouts, silence_of
from socialbot.planning.pddl.domain import PddlDomain
from socialbot.planning.planners.planner import Planner

NEARLY_DONE = 0.75
"""Mean progress from which the plan of a fulfilled desire is completed rather than stopped."""

MAX_RULE_ROUNDS = 100


class Observer(Protocol):
    """Receiver of changes that an agent publishes."""

    def beliefs_changed(self) -> None: ...
    def desires_changed(self) -> None: ...
    def plan_changed(self, info: PlanExecutionInfo) -> None: ...
    def status_changed(self, status: str, reason: str) -> None: ...


class Deliberator:
    """Desires, rules and plans of one agent. Call all methods in the thread of the engine.

    Args:
        run_in_background: Runs the planner beside the agent and calls back in the thread of the agent.
        is_sensed: Whether sensors report a fact; the executor waits for such effects instead of believing them.
    """

    def __init__(
        self,
        engine: Engine,
        domain: PddlDomain,
        planner: Planner,
        run_in_background: RunInBackground,
        *,
        options: DeliberationOptions | None = None,
        is_sensed: IsSensed = lambda name, objects: False,
        observer: Observer | None = None,
    ) -> None:
        self.engine = engine
        self.domain = domain
        self.options = options or DeliberationOptions()
        self.facts = FactBase(engine, domain)
        self.desires = DesireBase()
        self.rules = RuleBook(self.facts)
        self.plan_executor = PlanExecutor(
            engine,
            self.facts,
            self.options,
            is_sensed=is_sensed,
            ended=lambda outcome: self.pursuit.on_plan_ended(outcome),
            doubted=lambda reason: self.pursuit.revise_plan(reason),
            changed=self._plan_changed,
        )
        self._loop = WakeupLoop(engine, self.think, "deliberator")
        self.wake = self._loop.wake
        self.sensor_timeouts = SensorTimeouts(engine, self.wake)
        self.pursuit = DesirePursuit(
            engine,
            self.facts,
            self.plan_executor,
            planner,
            run_in_background,
            self.options,
            end=self._end,
            wake=self.wake,
        )
        self._observer = observer
        self._changed: dict[tuple[int, str, tuple[str, ...]], Fact] = {}
        self._unchecked: list[DesireState] = []
        self._pursued: DesireState | None = None
        self._awaited: tuple[str, ...] = ()
        self._rules_changed = True
        self._desires_published = True
        self._status = ("", "")
        self._waits_for = ""
        self.facts.watch(self._on_fact)
        self.wake()

    def desire(self, desire: Desire, *, cause: str = "", listener: Listener | None = None) -> str:
        """Adopt a desire. A desire with the same name and goal only gets the new priority and deadline.

        Args:
            listener: Called with the end of the desire and its reason.

        Returns:
            The reason for a refusal, or an empty text.
        """
        state = self.desires.get(desire.name)
        if state is None:
            reason = self.objection(desire)
        elif state.desire.wanted != desire.wanted:
            reason = f"another desire has the name {desire.name}"
        else:
            reason = out_of_range(desire) or ""
        if reason:
            self.engine.trace.record("desire_refused", desire.name, cause, reason=reason)
            return reason
        if state is None:
            state = self._adopt(desire, cause)
        elif state.rank[:2] != (-desire.priority, desire.deadline):
            self._revise(state, desire.priority, desire.deadline, cause)
        if listener is not None:
            state.listeners.append(listener)
        return ""

    def objection(self, desire: Desire) -> str:
        """Return why a desire can never be adopted in this domain, or an empty text. Unknown objects are allowed."""
        if not desire.wanted:
            return "it wants nothing"
        reasons = (reason for _, reason in unfit_parts(desire, self.facts, self.facts.unfit))
        return next(filter(None, reasons), "")

    def drop(self, name: str, reason: str = "deleted", *, cause: str = "") -> bool:
        """Drop a desire and stop its plan; return False if there is none of that name."""
        state = self.desires.get(name)
        if state is None:
            return False
        self._end(state, "dropped", reason, cause)
        return True

    def add_rule(self, rule: ReactiveRule) -> None:
        """Add a rule, which also fires for current facts. Raises PlanningError as `RuleBook.add` does."""
        self.rules.add(rule)
        self._rules_changed = True
        self.wake()

    def remove_rule(self, name: str) -> bool:
        """Remove a rule but keep its effects; return False if there is none of that name."""
        return self.rules.remove(name)

    @property
    def waits_for(self) -> str:
        """Event that the agent waits for without a desire, as the reason of its status; a run goes on meanwhile."""
        return self._waits_for

    @waits_for.setter
    def waits_for(self, what: str) -> None:
        if what != self._waits_for:
            self._waits_for = what
            self.wake()

    @property
    def is_at_work(self) -> bool:
        """Whether it has a desire, stops a plan, misses a sensor that it has not given up, or waits for something."""
        return bool(self.desires or self._awaited or self._waits_for) or not self.plan_executor.idle

    def stop(self) -> None:
        """Cancel the planner."""
        self.pursuit.cancel_request()

    def think(self) -> None:
        """Process all changes since the last pass."""
        try:
            changed = self._apply_rules()
        finally:
            self._loop.rearm()
        if self._pursued is not None and self._pursued is not self.pursuit.current:
            self._unchecked.append(self._pursued)  # its precondition was not checked during the pursuit
        self._check_desires(changed)
        if changed and self._observer is not None:
            self._loop.guarded(self._observer.beliefs_changed)
        self._check_sensor_timeouts()
        self._schedule()
        self._pursued = self.pursuit.current
        self._publish()

    def _on_fact(self, fact: Fact, held: bool, cause: str) -> None:
        self._changed[fact.identity] = fact
        self.wake()

    def _apply_rules(self) -> list[Fact]:
        """Apply rules until nothing changes; return the changed facts."""
        seen: dict[tuple[int, str, tuple[str, ...]], Fact] = {}
        for _ in range(MAX_RULE_ROUNDS):
            if not (self._changed or self._rules_changed):
                return list(seen.values())
            seen.update(self._changed)
            self._changed.clear()
            self._rules_changed = False
            for reaction in self.rules.react():
                self._apply(reaction)
        message = f"rules triggered each other {MAX_RULE_ROUNDS} times; they are paused until another fact changes"
        self.engine.trace.record("failure", "rules", "", reason="circle", message=message)
        seen.update(self._changed)
        self._changed.clear()
        self.rules.react()
        return list(seen.values())

    def _apply(self, reaction: Reaction) -> None:
        effect, adds = reaction.effect, reaction.effect.operation == "ADD"
        cause = self.engine.trace.record("rule", reaction.rule, reaction.cause, effect=str(effect))
        try:
            if effect.desire is not None and adds:
                self.desire(effect.desire, cause=cause)
            elif effect.desire is not None:
                fits = like(effect.desire.name)
                for name in [state.name for state in self.desires if fits(state.name)]:
                    self.drop(name, f"the rule {reaction.rule}", cause=cause)
            elif effect.fact is not None and adds:
                self.facts.add(effect.fact, cause=cause)
            elif effect.fact is not None:
                self.facts.remove(effect.fact, cause)
        except PlanningError as problem:  # an earlier effect may have removed an object of this one
            self.engine.trace.record_failure(f"rule {reaction.rule}", cause, problem)

    def _check_desires(self, changed: Iterable[Fact]) -> None:
        """End fulfilled desires, and update which desires are blocked."""
        states: dict[DesireState, bool] = {}  # with whether they may be fulfilled
        for fact in changed:
            for state, fulfils in self.desires.about(fact):
                if fulfils or state not in states:
                    states[state] = fulfils
        for state in states:
            state.never_preempts.clear()
        while states or self._unchecked:
            states.update(dict.fromkeys(self._unchecked, True))
            self._unchecked.clear()
            for state, fulfils in states.items():
                if self.desires.get(state.name) is state:
                    self._check_desire(state, fulfils)
            states.clear()  # preparing desires may have been adopted

    def _check_desire(self, state: DesireState, may_be_fulfilled: bool) -> None:
        if may_be_fulfilled and state.is_fulfilled() and not self._is_plan_nearly_done(state):
            self._end(state, "fulfilled", "")
            return
        state.blocked = not (state.precondition_holds() and state.context_holds())
        if state.blocked and state is not self.pursuit.current and not self.desires.children(state.name):
            name, desires = missing_preparations(state, self.options)
            for desire in desires:
                if desire.name not in self.desires:
                    self.desire(desire, cause=state.record)
            if name and not desires and name not in state.reported:
                state.reported.append(name)
                self.engine.trace.record("desire_refused", name, state.record, reason=UNACHIEVABLE)

    def _is_plan_nearly_done(self, state: DesireState) -> bool:
        if self.pursuit.current is not state or self.pursuit.problem:
            return False
        steps = self.plan_executor.info.actions_exec_info
        return bool(steps) and sum(step.progress for step in steps) / len(steps) >= NEARLY_DONE

    def _check_sensor_timeouts(self) -> None:
        """Hold new steps for silent sensors; after ``give_up_silent_s``, go on without what needs them."""
        timeouts, pursuit, patience = self.sensor_timeouts, self.pursuit, nanoseconds(self.options.give_up_silent_s)
        lost = [sensor for sensor, since in timeouts.since.items() if self._loop.is_due(since + patience)]
        self._awaited = tuple(sensor for sensor in timeouts.since if sensor not in lost)
        if not self._awaited:
            self.plan_executor.release()
        elif pursuit.current is not None or pursuit.planning_for is not None:
            self.plan_executor.hold(silence_of(self._awaited))
        if pursuit.change_unavailable(lost, timeouts.facts_of(lost)):
            for state in self.desires:  # what was impossible may be possible now
                state.unsolvable_version, state.not_before, state.failed_planning = -1, 0, 0
        if pursuit.current is not None and self.plan_executor.needs(pursuit.unavailable):
            pursuit.abort(f"{silence_of(lost)} for {self.options.give_up_silent_s:g} s")

    def _schedule(self) -> None:
        """Request a plan for the next desire."""
        if self._awaited or self.plan_executor.aborting:
            return
        pursued = self.pursuit.current
        state = next_desire(self.desires.ranked, pursued, self.options.reschedule_policy, self._is_ready)
        if state is None and pursued is not None and self.pursuit.problem and self._loop.is_due(pursued.not_before):
            state = pursued  # repair its failed plan
        if state is not None:
            self.pursuit.request_plan(state)

    def _is_ready(self, state: DesireState) -> bool:
        unsolvable = state.unsolvable_version == self.facts.version and not self._loop.is_due(state.unsolvable_until)
        return not unsolvable and self._loop.is_due(state.not_before)

    def _adopt(self, desire: Desire, cause: str) -> DesireState:
        state = self.desires.add(desire)
        assert state is not None
        state.is_fulfilled = self.facts.achieved(desire)
        state.precondition_holds = self.facts.test(desire.precondition)
        state.context_holds = self.facts.test(desire.context)
        state.blocked = True  # until it is checked
        state.record = self.engine.trace.record(
            "desire", desire.name, cause, priority=desire.priority, deadline=desire.deadline
        )
        self._unchecked.append(state)
        self._desires_published = False
        self.wake()
        return state

    def _revise(self, state: DesireState, priority: float, deadline: float, cause: str) -> None:
        self.desires.revise(state, priority, deadline)
        record = self.engine.trace.record("desire", state.name, cause, priority=priority, deadline=deadline)
        self.pursuit.revise(state)
        for child in self.desires.children(state.name):
            if prepares(child.desire, state.desire):
                self._revise(child, lifted(priority), deadline, record)
        self._desires_published = False
        self.wake()

    def _end(self, state: DesireState, how: End, reason: str, cause: str = "") -> None:
        if self.desires.get(state.name) is not state:
            return  # it has ended while its plan was being stopped
        record = self._remove(state, how, reason, cause)
        for relative, why in relatives_to_drop(state, how, reason, self.desires):
            self._remove(relative, "dropped", why, record)

    def _remove(self, state: DesireState, how: End, reason: str, cause: str) -> str:
        self.desires.remove(state)
        self._desires_published = False
        record = self.engine.trace.record(f"desire_{how}", state.name, cause or state.record, reason=reason)
        self.pursuit.forget(state, how, reason or f"{state.name} is {how}")
        for listener in state.listeners:
            self._loop.guarded(lambda listener=listener: listener(how, reason))
        self.wake()
        return record

    def _plan_changed(self) -> None:
        if self._observer is not None:
            self._observer.plan_changed(self.plan_executor.info)

    def _publish(self) -> None:
        observer = self._observer
        if observer is None:
            return
        if not self._desires_published:
            self._desires_published = True
            self._loop.guarded(observer.desires_changed)
        if self._current_status() != self._status:
            self._status = status, reason = self._current_status()
            self._loop.guarded(lambda: observer.status_changed(status, reason))

    def _current_status(self) -> tuple[str, str]:
        if self._awaited:
            return "BOOTING" if self.sensor_timeouts.is_first else "PAUSED", silence_of(self._awaited)
        if self.plan_executor.aborting:
            return "ABORTING", ""
        if self.pursuit.current is not None and not self.pursuit.problem:
            return "EXECUTING", self.pursuit.current.name
        if self.pursuit.planning_for is not None:
            return "PLANNING", self.pursuit.planning_for.name
        return "SCHEDULING", self._waits_for
