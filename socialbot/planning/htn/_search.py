"""Depth-first search for a task decomposition."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item, Operator, TaskDomain, TaskState, item_text
from socialbot.planning.htn.tree import TaskFault, TaskLimits


@dataclass(frozen=True, slots=True, eq=False)
class Trail:
    """Linked list of decisions, newest first: ``what`` was executed, or refined by ``method``."""

    before: Trail | None
    what: TaskPlace
    method: str | None


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """State of the search with its decisions and the number of actions."""

    state: TaskState
    trail: Trail | None = None
    done: int = 0


class LimitReached(Exception):  # noqa: N818 - no error
    """Time or attempts are used up."""


class Cancelled(Exception):  # noqa: N818 - no error
    """The caller has cancelled the call."""


class TaskDomainError(Exception):
    """The domain or the request is wrong."""

    def __init__(self, fault: TaskFault, what: str, *, where: str | None = None, remedy: str | None = None) -> None:
        super().__init__(str(PlanningError(what, where=where, remedy=remedy)))
        self.fault = fault


@dataclass(eq=False, slots=True)
class TaskPlace:
    """Position of an item: below another one, at a node of a tree, or new at the top."""

    item: Item
    above: TaskPlace | None = None
    node: int | None = None


@dataclass(frozen=True, slots=True)
class Alternative:
    """Constraint that a task leads to other ``actions`` from index ``failed`` on, or earlier."""

    place: TaskPlace
    actions: tuple[Item, ...]
    failed: int

    def holds(self, trail: Trail | None) -> bool:
        """Return whether a trail that ends with the task satisfies the constraint."""
        new = [entry.what.item for entry in back(trail, self.place) if entry.method is None]
        again = len(self.actions) - self.failed <= len(new) <= len(self.actions)
        return not again or self.actions[len(self.actions) - len(new) :] != tuple(reversed(new))


def back(trail: Trail | None, start: TaskPlace | None = None) -> Iterator[Trail]:
    """Yield decisions from the newest back to the one of ``start``, or to the first."""
    while trail is not None:
        yield trail
        trail = None if trail.what is start else trail.before


@dataclass(frozen=True, slots=True, eq=False)
class _Agenda:
    """Linked list of the tasks that are not done yet."""

    what: TaskPlace | Alternative
    later: _Agenda | None


def _before(todo: Sequence[TaskPlace | Alternative], later: _Agenda | None) -> _Agenda | None:
    """Return an agenda with ``todo`` in front."""
    for what in reversed(todo):
        later = _Agenda(what, later)
    return later


@dataclass(eq=False)
class TaskSearch:
    """Searches in one domain with shared limits; ``end`` is the deadline (``time.thread_time``)."""

    domain: TaskDomain
    limits: TaskLimits
    blacklist: Sequence[Item]
    cancelled: threading.Event | None
    end: float
    attempts: int = 0
    _furthest: tuple[int, str] = field(default=(-1, ""))

    def run(self, state: TaskState, todo: Sequence[TaskPlace | Alternative]) -> SearchState | None:
        """Return the state after all of ``todo``, or None.

        Raises LimitReached, Cancelled, TaskDomainError.
        """
        # Each choice is a state, the tasks that are not done in it, and the method for the first of them.
        choices: list[tuple[SearchState, _Agenda | None, int]] = [(SearchState(state.copy()), _before(todo, None), 0)]
        while choices:
            current, agenda, index = choices.pop()
            if agenda is None:
                return current
            what, later = agenda.what, agenda.later
            if isinstance(what, Alternative):
                after = self._compare(what, current)
            elif (methods := self.domain.methods.get(what.item[0])) is None:
                after = self._act(what, current)
            else:
                if index + 1 < len(methods):
                    choices.append((current, agenda, index + 1))
                after, items = None, self._refine(what, current, methods[index])
                if items is not None:
                    after = SearchState(current.state, Trail(current.trail, what, methods[index].name), current.done)
                    later = _before([TaskPlace(item, what) for item in items], later)
            if after is not None:
                choices.append((after, later, 0))
        return None

    @property
    def obstacle(self) -> str:
        """Reason for the failure after the longest sequence of actions."""
        done, what = self._furthest
        return f"after {done} action{'' if done == 1 else 's'} {what}"

    def check(self, item: Any, source: str, where: str | None = None) -> None:
        """Raises TaskDomainError if the domain has no such action or task."""
        fault, remedy = TaskFault.MALFORMED, None
        if not isinstance(item, (list, tuple)) or not item or not isinstance(item[0], str):
            what, remedy = f"{item!r:.80}, in {source}, is no task", 'write ("name", argument)'
        elif not (operators := self.domain.operators(item[0])):
            similar = self.domain.similar(item[0])
            fault, remedy = TaskFault.UNKNOWN, f"did you mean {similar!r}?" if similar else "declare it"
            what = f"{self.domain.name} has no action or task {item[0]!r}, which stands in {source}"
        else:
            wrong = next((operator for operator in operators if not operator.takes(len(item) - 1)), None)
            if wrong is None:
                return
            fault, where = TaskFault.ARITY, where or wrong.where
            what = f"{item_text(tuple(item))}, in {source}: {wrong.name} takes {wrong.arity} arguments"
        raise TaskDomainError(fault, what, where=where, remedy=remedy)

    def _act(self, place: TaskPlace, current: SearchState) -> SearchState | None:
        self._count()
        if place.item in self.blacklist:
            return self._fail(current, f"{item_text(place.item)} is blacklisted")
        action = self.domain.actions[place.item[0]]
        after = self._call(action, current.state.copy(), place.item)
        if after is None or after is False:
            return self._fail(current, f"{item_text(place.item)} cannot be done")
        if not isinstance(after, TaskState):
            what = f"{action.name} returned {after!r:.80}, which is no state"
            remedy = "return the state, or None if the action cannot be done"
            raise TaskDomainError(TaskFault.MALFORMED, what, where=action.where, remedy=remedy)
        return SearchState(after, Trail(current.trail, place, None), current.done + 1)

    def _refine(self, place: TaskPlace, current: SearchState, method: Operator) -> list[Item] | None:
        self._count()
        items = self._items(method, self._call(method, current.state, place.item))
        return self._fail(current, f"no method does {item_text(place.item)}") if items is None else items

    def _compare(self, otherwise: Alternative, current: SearchState) -> SearchState | None:
        if otherwise.holds(current.trail):
            return current
        return self._fail(current, f"{item_text(otherwise.place.item)} would fail again")

    def _count(self) -> None:
        self.attempts += 1
        if self.cancelled is not None and self.cancelled.is_set():
            raise Cancelled
        if self.attempts > self.limits.steps or time.thread_time() >= self.end:
            raise LimitReached

    def _fail(self, current: SearchState, what: str) -> None:
        if current.done >= self._furthest[0]:
            self._furthest = (current.done, what)

    def _call(self, operator: Operator, state: TaskState, item: Item) -> Any:
        try:
            return operator.function(state, *item[1:])
        except Exception as problem:
            file = operator.where.rpartition(":")[0]
            lines = [line.lineno for line in traceback.extract_tb(problem.__traceback__) if line.filename == file]
            what = f"{operator.name} for {item_text(item)}: {type(problem).__name__}: {problem}"
            where = f"{file}:{lines[-1]}" if lines else operator.where
            raise TaskDomainError(TaskFault.RAISED, what, where=where) from problem

    def _items(self, method: Operator, returned: Any) -> list[Item] | None:
        if returned is None or returned is False:
            return None
        if not isinstance(returned, (list, tuple)):
            what = f"{method.name} returned {returned!r:.80}, which is no list"
            remedy = "return a list of tasks and actions, or None if the method does not apply"
            raise TaskDomainError(TaskFault.MALFORMED, what, where=method.where, remedy=remedy)
        for item in returned:
            self.check(item, f"the result of {method.name}", method.where)
        return [tuple(item) for item in returned]
