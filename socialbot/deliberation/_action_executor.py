"""Start, monitor and end single plan steps, with a rollback log of the beliefs they changed."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from socialbot.bdi import Atom, Engine
from socialbot.bdi.intentions import Failure
from socialbot.bdi.literals import literal
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._execution import PlanTask, Projection, have_happened
from socialbot.deliberation._wakeup import WakeupLoop
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import FLUENT, PREDICATE, ActionStatus, Fact
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.formulas import (
    Add,
    Delete,
    Effect,
    Fluent,
    Formula,
    NumericEffect,
    PddlWorld,
    Predicate,
)
from socialbot.planning.pddl.semantics import GroundChange, SetValue, bound, triggered, unmet

Key = Predicate | Fluent

IsSensed = Callable[[str, tuple[str, ...]], bool]
"""Whether sensors report a predicate or function, given by name, for some objects."""


@dataclass(slots=True)
class _Entry:
    """Value before a change; a ``relative`` change of a number is undone by the same amount."""

    before: bool | float | None
    relative: bool


class RollbackLog:
    """Applies effects to the beliefs, and undoes those of one owner.

    A later change by a sensor, a rule or another step is not undone. Numbers that several owners increase or decrease
    are restored by the amount that the owner changed them.
    """

    def __init__(self, facts: FactBase) -> None:
        self._facts = facts
        self._entries: dict[object, dict[Key, _Entry]] = {}
        self._writing: Key | None = None
        facts.watch(self._on_fact)

    def apply(
        self, owner: object, changes: Iterable[GroundChange], cause: str, relative: Container[Fluent] = ()
    ) -> None:
        """Believe changes. Raises PlanningError if one does not fit the domain any more.

        Args:
            relative: Fluents that are only increased or decreased.
        """
        for change in changes:
            match change:
                case Add(predicate):
                    if not self._facts.holds(predicate):
                        self._write(owner, predicate, True, cause)
                case Delete(predicate):
                    if self._facts.holds(predicate):
                        self._write(owner, predicate, False, cause)
                case SetValue(fluent, value):
                    self._write(owner, fluent, value, cause, relative=fluent in relative)

    def undo(self, owner: object, cause: str) -> None:
        """Undo the changes of an owner, the last change first."""
        for key, entry in reversed(self._entries.pop(owner, {}).items()):
            if self._facts.unknown(fact_of(key)) is None:  # objects that have gone do not come back
                self._write(None, key, entry.before, cause, relative=entry.relative)

    def close(self, owner: object) -> None:
        """Make the changes of an owner permanent."""
        self._entries.pop(owner, None)

    def undone(self) -> dict[Key, bool | float | None]:
        """Return the values after `undo` of all owners."""
        found: dict[Key, bool | float | None] = {}
        for entries in self._entries.values():
            for key, entry in entries.items():
                if isinstance(key, Fluent) and entry.relative and entry.before is not None:
                    now = self._facts.value(key) or 0.0
                    found[key] = (found.get(key, now) or 0.0) + entry.before - now
                else:
                    found[key] = entry.before
        return found

    def _write(self, owner: object, key: Key, new: bool | float | None, cause: str, *, relative: bool = False) -> None:
        before = self._facts.holds(key) if isinstance(key, Predicate) else self._facts.value(key)
        self._writing = key
        try:
            if new is None or new is False:
                self._facts.remove(fact_of(key, before), cause)
            else:
                self._facts.add(fact_of(key, new), cause=cause)
        finally:
            self._writing = None
        for other, entries in self._entries.items():
            entry = entries.get(key) if other is not owner else None
            if entry is None:
                continue
            if relative and entry.relative and entry.before is not None:
                entry.before += (new or 0.0) - (before or 0.0)
            else:
                del entries[key]
        if owner is not None:
            self._entries.setdefault(owner, {}).setdefault(key, _Entry(before, relative))

    def _on_fact(self, fact: Fact, held: bool, cause: str) -> None:
        key = key_of(fact)
        if key is not None and key != self._writing:
            for entries in self._entries.values():
                entries.pop(key, None)


def key_of(fact: Fact) -> Key | None:
    """Return the predicate or fluent of a fact; None for an instance."""
    if fact.pddl_type == PREDICATE:
        return Predicate(fact.name, fact.params)
    return Fluent(fact.name, fact.params) if fact.pddl_type == FLUENT else None


def fact_of(key: Key, value: bool | float | None = True) -> Fact:
    """Return a predicate, or a fluent with its value, as a fact."""
    if isinstance(key, Predicate):
        return Fact(name=key.name, params=key.terms)
    return Fact(name=key.function, pddl_type=FLUENT, params=key.terms, value=float(value or 0.0))


class ActionExecutor:
    """Executes tasks; call `check` whenever something has changed.

    Attributes:
        stopping: Tasks that have ended while their actions still have to stop, with the deadline (ns) for that.
        sensors_timed_out: Whether missing sensor reports are excused.
        rollback_log: Changes of the tasks that have not ended.

    Args:
        failed: Called with a failed task and the trace record of its end.
    """

    def __init__(
        self,
        engine: Engine,
        facts: FactBase,
        options: DeliberationOptions,
        is_sensed: IsSensed,
        loop: WakeupLoop,
        failed: Callable[[PlanTask, str], object],
    ) -> None:
        self.stopping: dict[PlanTask, int] = {}
        self.sensors_timed_out = False
        self.rollback_log = RollbackLog(facts)
        self._engine = engine
        self._facts = facts
        self._options = options
        self._is_sensed = is_sensed
        self._loop = loop
        self._failed = failed

    def start_if_possible(self, task: PlanTask, cause: str) -> None:
        """Start a task if its conditions hold; fail it if they have not held for ``patience_s``."""
        try:
            missing = self._missing_at_start(task)
            if missing is None:
                self._start(task, cause)
                return
        except PlanningError as problem:
            self._fail(task, problem.what, cause=task.record or cause)
            return
        now = self._engine.clock.now()
        task.unmet_since = now if task.unmet_since is None else task.unmet_since
        task.message = f"waits for {missing}"
        if self._loop.is_due(task.unmet_since + nanoseconds(self._options.patience_s)):
            self._fail(task, f"condition does not hold: {missing}", cause=cause)

    def _missing_at_start(self, task: PlanTask) -> Formula | None:
        beliefs = self._beliefs()
        missing = unmet(task.action.conditions_at("start"), beliefs)
        if not missing:
            begun = beliefs.after(task.changes("start", beliefs))
            missing = unmet(task.action.conditions_at("over all"), begun)
        return missing[0] if missing else None

    def _start(self, task: PlanTask, cause: str) -> None:
        step, now, beliefs = task.step, self._engine.clock.now(), self._beliefs()
        at_start = task.changes("start", beliefs)
        begun = beliefs.after(at_start)
        task.starting_values = {
            fluent: begun.value(fluent)
            for _, fluent in _numeric(task.effects("end"), begun)
            if self._is_sensed(fluent.function, fluent.terms)
        }
        task.expected = tuple(filter(self._is_sensed_change, at_start))
        conditions = (*task.action.conditions_at("start"), *task.action.conditions_at("over all"))
        task.record = self._engine.trace.record(
            "step",
            step.call,
            cause,
            action=step.action,
            args=list(step.args),
            planned_start=step.start_s,
            conditions=[str(formula) for formula in conditions],
        )
        task.status, task.message, task.started = "RUNNING", "", now
        task.enter("acting", now)
        self._apply(task, "start")
        goal = literal(step.action, tuple(map(Atom, step.args)))
        task.intention = self._engine.attempt(goal, lambda failure: self._on_ended(task, failure), cause=task.record)

    def _on_ended(self, task: PlanTask, failure: Failure | None) -> None:
        task.outcome = (failure,)
        self._loop.wake()

    def check(self, task: PlanTask) -> None:
        """Check the conditions, duration, result and effects of a running task."""
        try:
            if task.phase == "acting":
                self._check_action(task)
            if task.phase == "ending" and have_happened(task.before_end):
                self._check_end(task)
            if task.phase in ("acting", "ending"):
                self._check_duration(task)
            if task.phase == "settling":
                unseen = task.first_unseen(self._facts)
                if unseen is None:
                    self._succeed(task)
                elif self._loop.is_due(self._effects_due(task)):
                    self._fail(task, f"effect not seen: {unseen}")
        except PlanningError as problem:
            self._fail(task, problem.what)

    def _check_action(self, task: PlanTask) -> None:
        if task.outcome is not None:
            failure = task.outcome[0]
            if failure is None:
                task.enter("ending", self._engine.clock.now())
            else:
                self._fail(task, failure.message, cause=str(failure.cause))
            return
        missing = unmet(task.action.conditions_at("over all"), self._beliefs())
        due = self._tolerated_until(task, bool(missing))
        if task.first_unseen(self._facts) is not None:
            # Sensors have not reported the start effects yet, and the condition may depend on them.
            due = max(due, self._effects_due(task))
        if missing and self._loop.is_due(due):
            self._fail(task, f"condition holds no longer: {missing[0]}")

    def _check_end(self, task: PlanTask) -> None:
        missing = unmet(task.action.conditions_at("end"), self._beliefs())
        due = self._tolerated_until(task, bool(missing))
        if not missing:
            at_end = task.changes("end", task.as_when_begun(self._facts, self._facts.domain))
            task.expected = tuple(filter(self._is_sensed_change, at_end))
            task.enter("settling", self._engine.clock.now())
        elif self._loop.is_due(due):
            self._fail(task, f"condition does not hold at the end: {missing[0]}")

    def _tolerated_until(self, task: PlanTask, missing: bool) -> int:
        now = self._engine.clock.now()
        if not missing:
            task.unmet_since = None
        elif task.unmet_since is None:
            task.unmet_since = now
        return (now if task.unmet_since is None else task.unmet_since) + nanoseconds(self._options.tolerance_s)

    def _check_duration(self, task: PlanTask) -> None:
        planned_s, options = task.step.duration_s, self._options
        limit_s = options.overrun_factor * planned_s + options.overrun_s
        assert task.started is not None
        if self._loop.is_due(task.started + nanoseconds(limit_s)):
            self._fail(task, f"takes longer than {limit_s:g} s; {planned_s:g} s were planned")

    def _effects_due(self, task: PlanTask) -> int:
        if self.sensors_timed_out:
            task.since = self._engine.clock.now()
        return task.since + nanoseconds(self._options.patience_s)

    def _succeed(self, task: PlanTask) -> None:
        now = self._engine.clock.now()
        self._apply(task, "end")
        self.rollback_log.close(task)
        self._engine.trace.record("step_end", task.step.call, task.record, outcome="successful")
        task.status, task.ended, task.expected = "SUCCESSFUL", now, ()
        task.enter("over", now)
        self._loop.wake()

    def give_up(self, task: PlanTask, status: ActionStatus, message: str, *, cause: str = "") -> str:
        """End a task early and undo its start effects; return the trace record of its end."""
        now = self._engine.clock.now()
        intention = task.intention if task.phase == "acting" and task.outcome is None else None
        task.progress(now)
        task.status, task.message = status, message
        task.ended = None if task.started is None else now
        task.enter("over", now)
        record = self._engine.trace.record(
            "step_end", task.step.call, cause or task.record, outcome=status.lower(), message=message
        )
        self.rollback_log.undo(task, record)
        if intention is not None:
            self.stopping[task] = now + nanoseconds(self._options.stop_s)
            self._engine.intentions.drop(intention, lambda: self._on_stopped(task))
        return record

    def _fail(self, task: PlanTask, message: str, *, cause: str = "") -> None:
        self._failed(task, self.give_up(task, "FAILED", message, cause=cause))

    def _on_stopped(self, task: PlanTask) -> None:
        if self.stopping.pop(task, None) is not None:
            self._loop.wake()

    def check_stopping(self) -> None:
        """Stop waiting for actions that have not stopped in time."""
        for task, due in list(self.stopping.items()):
            if self._loop.is_due(due):
                del self.stopping[task]
                message = f"has not stopped in {self._options.stop_s:g} s"
                self._engine.trace.record("failure", task.step.call, task.record, reason="no_answer", message=message)

    def _beliefs(self) -> Projection:
        return Projection(self._facts, self._facts.domain)

    def _is_sensed_change(self, change: GroundChange) -> bool:
        if isinstance(change, SetValue):
            return self._is_sensed(change.fluent.function, change.fluent.terms)
        return self._is_sensed(change.predicate.name, change.predicate.terms)

    def _apply(self, task: PlanTask, when: Literal["start", "end"]) -> None:
        """Believe the effects that no sensor reports."""
        beliefs = self._beliefs()
        changes = [change for change in task.changes(when, beliefs) if not self._is_sensed_change(change)]
        numeric = list(_numeric(task.effects(when), beliefs))
        absolute = {fluent for operator, fluent in numeric if operator not in ("increase", "decrease")}
        self.rollback_log.apply(task, changes, task.record, {fluent for _, fluent in numeric} - absolute)


def _numeric(effects: Iterable[Effect], world: PddlWorld) -> Iterator[tuple[str, Fluent]]:
    """Yield the changed fluents with their operators: ``assign``, ``increase``, ..."""
    for effect, binding in triggered(effects, world):
        if isinstance(effect, NumericEffect):
            yield effect.operator, bound(effect.fluent, binding)
