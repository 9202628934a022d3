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
from socialbot.deliberation.execution import PlanTask, Projection, have_happened
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import FLUENT, PREDICATE, ActionStatus, Fact
from socialbot.deliberation.options import DirectorOptions
from socialbot.deliberation.wakeup import Alarm
from socialbot.planning.pddl.formulas import Add, Delete, Effect, Fluent, Formula, NumericEffect, PddlWorld, Predicate
from socialbot.planning.pddl.semantics import GroundChange, SetValue, bound, triggered, unmet

Key = Predicate | Fluent


@dataclass(slots=True)
class Entry:
    """What was believed before; a ``relative`` change of a number leaves what others add to it alone."""

    before: bool | float | None
    relative: bool


class RollbackLog:
    """Writes effects into the beliefs, each for an owner.

    What somebody else changes after that is not taken back: a sensor, a rule, a later step. Only numbers that are
    increased and decreased by several owners each are put back by as much as the owner changed them.
    """

    def __init__(self, facts: FactBase) -> None:
        self._facts = facts
        self._entries: dict[object, dict[Key, Entry]] = {}
        self._writing: Key | None = None
        facts.watch(self._hear)

    def apply(
        self, owner: object, changes: Iterable[GroundChange], cause: str, relative: Container[Fluent] = ()
    ) -> None:
        """Believes changes; those of the ``relative`` fluents came by increase or decrease.

        Raises PlanningError when one does not fit the domain any more.
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
        """Takes back what an owner has changed, the last change first."""
        for key, entry in reversed(self._entries.pop(owner, {}).items()):
            # Objects that have gone meanwhile do not come back with it.
            if self._facts.unknown(fact_of(key)) is None:
                self._write(None, key, entry.before, cause, relative=entry.relative)

    def close(self, owner: object) -> None:
        """Lets the changes of an owner stand for good."""
        self._entries.pop(owner, None)

    def undone(self) -> dict[Key, bool | float | None]:
        """What would be believed instead, if all owners took back what they have changed."""
        found: dict[Key, bool | float | None] = {}
        for entries in self._entries.values():
            for key, entry in entries.items():
                if isinstance(key, Fluent) and entry.relative and entry.before is not None:
                    now = self._facts.value(key) or 0.0
                    found[key] = (found.get(key, now) or 0.0) + entry.before - now
                else:
                    found[key] = entry.before
        return found

    # Within

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
        shift = (new or 0.0) - (before or 0.0) if relative else None
        for other, entries in self._entries.items():
            if other is not owner:
                _overtake(entries, key, shift)
        if owner is not None:
            self._entries.setdefault(owner, {}).setdefault(key, Entry(before, relative))

    def _hear(self, fact: Fact, held: bool, cause: str) -> None:
        key = key_of(fact)
        if key is not None and key != self._writing:
            for entries in self._entries.values():
                entries.pop(key, None)


def _overtake(entries: dict[Key, Entry], key: Key, shift: float | None) -> None:
    """Notes that somebody else has changed what is in an owner's entries."""
    entry = entries.get(key)
    if entry is None:
        return
    if shift is not None and entry.relative and entry.before is not None:
        entry.before += shift
    else:
        del entries[key]


def key_of(fact: Fact) -> Key | None:
    """What a fact is about; None for an instance."""
    if fact.pddl_type == PREDICATE:
        return Predicate(fact.name, fact.params)
    return Fluent(fact.name, fact.params) if fact.pddl_type == FLUENT else None


def fact_of(key: Key, value: bool | float | None = True) -> Fact:
    """A predicate, or a fluent with its value, as a fact."""
    if isinstance(key, Predicate):
        return Fact(name=key.name, params=key.terms)
    return Fact(name=key.function, pddl_type=FLUENT, params=key.terms, value=float(value or 0.0))


Watched = Callable[[str, tuple[str, ...]], bool]
"""Whether sensors tell of a predicate or function, by its name, for some objects."""


class ActionExecutor:
    """Performs tasks. `look_at` is called whenever something has changed, and when ``alarm`` says so.

    ``failed`` is called with a task that has failed and the record of its end, ``wake`` when there is something to
    look at. While sensors are ``blind`` nobody loses patience with what they do not see. ``stopping`` are the tasks
    that are over while their actions still have to stop, and until when (ns) they may take to. The ``ledger`` has what
    tasks have changed that are not over.
    """

    def __init__(
        self,
        engine: Engine,
        facts: FactBase,
        options: DirectorOptions,
        watched: Watched,
        alarm: Alarm,
        wake: Callable[[], object],
        failed: Callable[[PlanTask, str], object],
    ) -> None:
        self.stopping: dict[PlanTask, int] = {}
        self.blind = False
        self._engine = engine
        self._facts = facts
        self._options = options
        self._watched = watched
        self._alarm = alarm
        self._wake = wake
        self._failed = failed
        self.ledger = RollbackLog(facts)

    # Begin

    def begin_if_possible(self, task: PlanTask, cause: str) -> None:
        """Begins a task whose turn it is, if its conditions are believed now; they may keep it waiting for a while."""
        try:
            missing = self._missing_at_start(task)
            if missing is None:
                self._begin(task, cause)
                return
        except PlanningError as problem:
            self._fail(task, problem.what, cause=task.record or cause)
            return
        now = self._engine.clock.now()
        task.unmet_since = now if task.unmet_since is None else task.unmet_since
        task.message = f"waits for {missing}"
        if self._alarm.is_due(task.unmet_since + nanoseconds(self._options.patience_s)):
            self._fail(task, f"condition does not hold: {missing}", cause=cause)

    def _missing_at_start(self, task: PlanTask) -> Formula | None:
        beliefs = self._beliefs()
        missing = unmet(task.action.conditions_at("start"), beliefs)
        if not missing:
            begun = beliefs.after(task.changes("start", beliefs))
            missing = unmet(task.action.conditions_at("over all"), begun)
        return missing[0] if missing else None

    def _begin(self, task: PlanTask, cause: str) -> None:
        step, now, beliefs = task.step, self._engine.clock.now(), self._beliefs()
        at_start = task.changes("start", beliefs)
        begun = beliefs.after(at_start)
        task.starting_values = {
            fluent: begun.value(fluent)
            for _, fluent in _numeric(task.effects("end"), begun)
            if self._watched(fluent.function, fluent.terms)
        }
        task.expected = tuple(filter(self._is_watched, at_start))
        conditions = (*task.action.conditions_at("start"), *task.action.conditions_at("over all"))
        task.record = self._engine.record(
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
        self._write(task, "start")
        goal = literal(step.action, tuple(map(Atom, step.args)))
        task.intention = self._engine.attempt(goal, lambda failure: self._hear(task, failure), cause=task.record)

    def _hear(self, task: PlanTask, failure: Failure | None) -> None:
        task.outcome = (failure,)
        self._wake()

    # Meanwhile

    def look_at(self, task: PlanTask) -> None:
        """Looks after a task that has begun: what it needs still holds, it is in time, it has ended."""
        try:
            if task.phase == "acting":
                self._look_at_action(task)
            if task.phase == "ending" and have_happened(task.before_end):
                self._look_at_end(task)
            if task.phase in ("acting", "ending"):
                self._look_at_time(task)
            if task.phase == "settling":
                self._look_at_effects(task)
        except PlanningError as problem:
            self._fail(task, problem.what)

    def _look_at_action(self, task: PlanTask) -> None:
        if task.outcome is None:
            self._look_at_conditions(task)
        elif task.outcome[0] is None:
            task.enter("ending", self._engine.clock.now())
        else:
            self._fail(task, task.outcome[0].message, cause=str(task.outcome[0].cause))

    def _look_at_conditions(self, task: PlanTask) -> None:
        missing = unmet(task.action.conditions_at("over all"), self._beliefs())
        due = self._bearable_until(task, bool(missing))
        if task.first_unseen(self._facts) is not None:
            # Sensors have not seen yet that it has begun, and the condition may be a part of that.
            due = max(due, self._patient_until(task))
        if missing and self._alarm.is_due(due):
            self._fail(task, f"condition holds no longer: {missing[0]}")

    def _look_at_end(self, task: PlanTask) -> None:
        missing = unmet(task.action.conditions_at("end"), self._beliefs())
        due = self._bearable_until(task, bool(missing))
        if not missing:
            at_end = task.changes("end", task.as_when_begun(self._facts, self._facts.domain))
            task.expected = tuple(filter(self._is_watched, at_end))
            task.enter("settling", self._engine.clock.now())
        elif self._alarm.is_due(due):
            self._fail(task, f"condition does not hold at the end: {missing[0]}")

    def _bearable_until(self, task: PlanTask, missing: bool) -> int:
        """Until when (ns) conditions may be unmet."""
        now = self._engine.clock.now()
        if not missing:
            task.unmet_since = None
        elif task.unmet_since is None:
            task.unmet_since = now
        return (now if task.unmet_since is None else task.unmet_since) + nanoseconds(self._options.tolerance_s)

    def _look_at_time(self, task: PlanTask) -> None:
        planned_s, options = task.step.duration_s, self._options
        limit_s = options.overrun_factor * planned_s + options.overrun_s
        assert task.started is not None
        if self._alarm.is_due(task.started + nanoseconds(limit_s)):
            self._fail(task, f"takes longer than {limit_s:g} s; {planned_s:g} s were planned")

    def _look_at_effects(self, task: PlanTask) -> None:
        unseen = task.first_unseen(self._facts)
        if unseen is None:
            self._end_well(task)
        elif self._alarm.is_due(self._patient_until(task)):
            self._fail(task, f"effect not seen: {unseen}")

    def _patient_until(self, task: PlanTask) -> int:
        """Until when (ns) sensors may take to see the effects of a task."""
        if self.blind:
            task.since = self._engine.clock.now()
        return task.since + nanoseconds(self._options.patience_s)

    # End

    def _end_well(self, task: PlanTask) -> None:
        now = self._engine.clock.now()
        self._write(task, "end")
        self.ledger.close(task)
        self._engine.record("step_end", task.step.call, task.record, outcome="successful")
        task.status, task.ended, task.expected = "SUCCESSFUL", now, ()
        task.enter("over", now)
        self._wake()

    def give_up(self, task: PlanTask, status: ActionStatus, message: str, *, cause: str = "") -> str:
        """Ends a task before its time, and takes back what it changed as it began; returns the record of that."""
        now = self._engine.clock.now()
        goes_on = task.phase == "acting" and task.outcome is None and task.intention is not None
        task.progress(now)
        task.status, task.message = status, message
        task.ended = None if task.started is None else now
        task.enter("over", now)
        record = self._engine.record(
            "step_end", task.step.call, cause or task.record, outcome=status.lower(), message=message
        )
        self.ledger.undo(task, record)
        if goes_on:
            self._stop(task)
        return record

    def _fail(self, task: PlanTask, message: str, *, cause: str = "") -> None:
        self._failed(task, self.give_up(task, "FAILED", message, cause=cause))

    def _stop(self, task: PlanTask) -> None:
        assert task.intention is not None
        self.stopping[task] = self._engine.clock.now() + nanoseconds(self._options.stop_s)
        self._engine.drop(task.intention, lambda: self._has_stopped(task))

    def _has_stopped(self, task: PlanTask) -> None:
        if self.stopping.pop(task, None) is not None:
            self._wake()

    def look_at_stopping(self) -> None:
        """Waits no longer for actions that do not stop."""
        for task, due in list(self.stopping.items()):
            if self._alarm.is_due(due):
                del self.stopping[task]
                message = f"has not stopped in {self._options.stop_s:g} s"
                self._engine.record("failure", task.step.call, task.record, reason="no_answer", message=message)

    # Effects

    def _beliefs(self) -> Projection:
        return Projection(self._facts, self._facts.domain)

    def _is_watched(self, change: GroundChange) -> bool:
        if isinstance(change, SetValue):
            return self._watched(change.fluent.function, change.fluent.terms)
        return self._watched(change.predicate.name, change.predicate.terms)

    def _write(self, task: PlanTask, when: Literal["start", "end"]) -> None:
        """Believes what no sensor tells."""
        beliefs = self._beliefs()
        mine = [change for change in task.changes(when, beliefs) if not self._is_watched(change)]
        self.ledger.apply(task, mine, task.record, _relative(task.effects(when), beliefs))


def _numeric(effects: Iterable[Effect], world: PddlWorld) -> Iterator[tuple[str, Fluent]]:
    """The numbers that are changed, and how: ``assign``, ``increase``, ..."""
    for effect, binding in triggered(effects, world):
        if isinstance(effect, NumericEffect):
            yield effect.operator, bound(effect.fluent, binding)


def _relative(effects: Iterable[Effect], world: PddlWorld) -> frozenset[Fluent]:
    """The numbers that are only increased or decreased."""
    numeric = list(_numeric(effects, world))
    set_anew = {fluent for operator, fluent in numeric if operator not in ("increase", "decrease")}
    return frozenset(fluent for _, fluent in numeric if fluent not in set_anew)
