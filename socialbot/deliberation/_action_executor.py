"""Start, monitor and end single plan steps, with a rollback log of the beliefs they changed."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from socialbot.bdi import Atom, Engine
from socialbot.bdi.intentions import Failure
from socialbot.bdi.literals import literal
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import PlanningError
from socialbot.deliberation._execution import PlanTask, have_happened
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
    Key,
    NumericEffect,
    PddlWorld,
    Predicate,
)
from socialbot.planning.pddl.semantics import Changes, triggered, unmet
from socialbot.planning.pddl.state import Projection

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

    def apply(self, owner: object, changes: Changes, cause: str, relative: Container[Key] = ()) -> None:
        """Believe changes. Raises PlanningError if one does not fit the domain any more.

        Args:
            relative: Fluents that are only increased or decreased.
        """
        for key, new in changes.items():
            if isinstance(key, Fluent) or self._facts.holds(key) != new:
                self._write(owner, key, new, cause, relative=key in relative)

    def undo(self, owner: object, cause: str) -> None:
        for key, entry in reversed(self._entries.pop(owner, {}).items()):
            if self._facts.unknown(fact_of(key)) is None:  # objects that have gone do not come back
                self._write(None, key, entry.before, cause, relative=entry.relative)

    def close(self, owner: object) -> None:
        self._entries.pop(owner, None)

    def undone(self, owner: object = None) -> dict[Key, bool | float | None]:
        """Return the values after `undo` of one owner, or of all."""
        found: dict[Key, bool | float | None] = {}
        for each, entries in self._entries.items():
            for key, entry in entries.items() if owner in (None, each) else ():
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
    if fact.pddl_type == PREDICATE:
        return Predicate(fact.name, fact.params)
    return Fluent(fact.name, fact.params) if fact.pddl_type == FLUENT else None


def fact_of(key: Key, value: bool | float | None = True) -> Fact:
    """Return a predicate, or a fluent with its value, as a fact."""
    if isinstance(key, Predicate):
        return Fact(name=key.name, params=key.terms)
    return Fact(name=key.name, pddl_type=FLUENT, params=key.terms, value=float(value or 0.0))


@dataclass(eq=False)
class ActionExecutor:
    """Executes tasks; call `check` whenever something has changed.

    Attributes:
        failed: Called with a failed task and the trace record of its end.
        stopping: Tasks that have ended while their actions still have to stop, with the deadline (ns) for that.
        sensors_timed_out: Whether missing sensor reports are excused.
        rollback_log: Changes of the tasks that have not ended.
    """

    engine: Engine
    facts: FactBase
    options: DeliberationOptions
    is_sensed: IsSensed
    loop: WakeupLoop
    failed: Callable[[PlanTask, str], object]
    stopping: dict[PlanTask, int] = field(init=False, default_factory=dict)
    sensors_timed_out: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.rollback_log = RollbackLog(self.facts)

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
        task.message = f"waits for {missing}"
        if self._overdue(task, [missing], self.options.patience_s) is not None:
            self._fail(task, f"condition does not hold: {missing}", cause=cause)

    def _missing_at_start(self, task: PlanTask) -> Formula | None:
        beliefs = self._beliefs(task.presumed)
        missing = unmet(task.action.conditions_at("start"), beliefs)
        if not missing:
            begun = self._beliefs({**task.presumed, **task.changes("start", beliefs)})
            missing = unmet(task.action.conditions_at("over all"), begun)
        return missing[0] if missing else None

    def _start(self, task: PlanTask, cause: str) -> None:
        step, now, beliefs = task.step, self.loop.now, self._beliefs(task.presumed)
        task.started_changes = at_start = task.changes("start", beliefs)
        begun = self._beliefs({**task.presumed, **at_start})
        task.starting_values = self._starting_values(task, begun)
        task.expected = self._sensed(at_start)
        conditions = (*task.action.conditions_at("start"), *task.action.conditions_at("over all"))
        task.record = self.engine.trace.record(
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
        task.intention = self.engine.attempt(goal, lambda failure: self._on_ended(task, failure), cause=task.record)

    def _starting_values(self, task: PlanTask, begun: PddlWorld) -> dict[Key, bool | float | None]:
        effects = list(triggered(task.effects("end"), begun))
        deleted = {each.predicate: False for each in effects if isinstance(each, Delete)}
        truths = {**deleted, **{each.predicate: True for each in effects if isinstance(each, Add)}}
        values: dict[Key, bool | float | None] = {
            **{each.fluent: begun.value(each.fluent) for each in effects if isinstance(each, NumericEffect)},
            **{predicate: not new for predicate, new in truths.items() if begun.holds(predicate) != new},
        }
        return {key: value for key, value in values.items() if self.is_sensed(key.name, key.terms)}

    def _on_ended(self, task: PlanTask, failure: Failure | None) -> None:
        task.outcome = (failure,)
        self.loop.wake()

    def check(self, task: PlanTask) -> None:
        task.note_seen(self.facts)
        try:
            if task.phase == "acting":
                self._check_action(task)
            if task.phase == "ending" and have_happened(task.before_end):
                self._check_end(task)
            if task.phase in ("acting", "ending"):
                self._check_duration(task)
            if task.phase == "settling":
                unseen = task.first_unseen(self.facts)
                if unseen is None:
                    self._succeed(task)
                elif self.loop.is_due(self._effects_due(task)):
                    self._fail(task, f"effect not seen: {unseen}")
        except PlanningError as problem:
            self._fail(task, problem.what)

    def _check_action(self, task: PlanTask) -> None:
        if task.outcome is not None:
            failure = task.outcome[0]
            if failure is None:
                task.enter("ending", self.loop.now)
            else:
                self._fail(task, failure.message, cause=str(failure.cause))
            return
        # Sensors may not have reported the start effects yet, and the condition may depend on them.
        not_before = 0 if task.first_unseen(self.facts) is None else self._effects_due(task)
        missing = unmet(task.action.conditions_at("over all"), self._beliefs())
        overdue = self._overdue(task, missing, self.options.tolerance_s, not_before)
        if overdue is not None:
            self._fail(task, f"condition holds no longer: {overdue}")

    def _check_end(self, task: PlanTask) -> None:
        conditions, facts = task.action.conditions_at("end"), self.facts
        missing = unmet(conditions, self._beliefs())
        if missing:  # sensors may have reported its effects before the action ended
            missing = unmet(conditions, self._beliefs(task.without_end_effects(facts, facts.domain)))
        overdue = self._overdue(task, missing, self.options.tolerance_s)
        if not missing:
            changed = task.end_changes(self.facts, self.facts.domain)
            unseen = {key: new for key, new in task.expected.items() if key not in changed}
            task.expected = {**unseen, **self._sensed(changed)}
            task.enter("settling", self.loop.now)
        elif overdue is not None:
            self._fail(task, f"condition does not hold at the end: {overdue}")

    def _overdue(
        self, task: PlanTask, missing: list[Formula], tolerance_s: float, not_before: int = 0
    ) -> Formula | None:
        """Return a condition that has not held for too long; None if there is none."""
        if not missing:
            task.unmet_since = None
            return None
        if task.unmet_since is None:
            task.unmet_since = self.loop.now
        due = max(task.unmet_since + nanoseconds(tolerance_s), not_before)
        return missing[0] if self.loop.is_due(due) else None

    def _check_duration(self, task: PlanTask) -> None:
        planned_s, options = task.step.duration_s, self.options
        limit_s = options.overrun_factor * planned_s + options.overrun_s
        assert task.started is not None
        if self.loop.is_due(task.started + nanoseconds(limit_s)):
            self._fail(task, f"takes longer than {limit_s:g} s; {planned_s:g} s were planned")

    def _effects_due(self, task: PlanTask) -> int:
        if self.sensors_timed_out:
            task.since = self.loop.now
        return task.since + nanoseconds(self.options.patience_s)

    def _succeed(self, task: PlanTask) -> None:
        now = self.loop.now
        self._apply(task, "end")
        self.rollback_log.close(task)
        self.engine.trace.record("step_end", task.step.call, task.record, outcome="successful")
        task.status, task.ended, task.expected = "SUCCESSFUL", now, {}
        task.enter("over", now)
        self.loop.wake()

    def give_up(self, task: PlanTask, status: ActionStatus, message: str, *, cause: str = "") -> str:
        """End a task early and undo its start effects; return the trace record of its end."""
        now = self.loop.now
        intention = task.intention if task.phase == "acting" and task.outcome is None else None
        task.progress(now)
        task.status, task.message = status, message
        task.ended = None if task.started is None else now
        task.enter("over", now)
        record = self.engine.trace.record(
            "step_end", task.step.call, cause or task.record, outcome=status.lower(), message=message
        )
        self.rollback_log.undo(task, record)
        if intention is not None:
            self.stopping[task] = now + nanoseconds(self.options.stop_s)
            self.engine.intentions.drop(intention, lambda: self._on_stopped(task))
        return record

    def _fail(self, task: PlanTask, message: str, *, cause: str = "") -> None:
        self.failed(task, self.give_up(task, "FAILED", message, cause=cause))

    def _on_stopped(self, task: PlanTask) -> None:
        if self.stopping.pop(task, None) is not None:
            self.loop.wake()

    def check_stopping(self) -> None:
        for task, due in list(self.stopping.items()):
            if self.loop.is_due(due):
                del self.stopping[task]
                message = f"has not stopped in {self.options.stop_s:g} s"
                self.engine.trace.record("failure", task.step.call, task.record, reason="no_answer", message=message)

    def _beliefs(self, changes: Changes | None = None) -> Projection:
        return Projection(self.facts, self.facts.domain, changes)

    def _sensed(self, changes: Changes, sensed: bool = True) -> Changes:
        return {key: new for key, new in changes.items() if self.is_sensed(key.name, key.terms) == sensed}

    def _apply(self, task: PlanTask, when: Literal["start", "end"]) -> None:
        beliefs = self._beliefs()
        numeric = list(_numeric(task.effects(when), beliefs))
        absolute = {fluent for operator, fluent in numeric if operator not in ("increase", "decrease")}
        relative = {fluent for _, fluent in numeric} - absolute
        self.rollback_log.apply(task, self._sensed(task.changes(when, beliefs), False), task.record, relative)


def _numeric(effects: Iterable[Effect], world: PddlWorld) -> Iterator[tuple[str, Fluent]]:
    """Yield the changed fluents with their operators: ``assign``, ``increase``, ..."""
    for effect in triggered(effects, world):
        if isinstance(effect, NumericEffect):
            yield effect.operator, effect.fluent
