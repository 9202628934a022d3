"""Search for a task decomposition with a private instance of GTPyhop."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from socialbot.core.errors import InstallationError, PlanningError
from socialbot.core.installation import pip_command
from socialbot.planning.htn.domain import MAX_METHODS, Item, Operator, TaskDomain, TaskState, item_text
from socialbot.planning.htn.tree import TaskFault, TaskLimits


def _load() -> ModuleType:
    package = find_spec("gtpyhop")
    if package is None or package.origin is None:
        raise InstallationError(
            "gtpyhop-core is not installed",
            where="task networks",
            remedy=pip_command("install", "gtpyhop-core>=2.0.2,<3"),
        )
    spec = spec_from_file_location("_gtpyhop_of_socialbot", Path(package.origin).with_name("main.py"))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_GTPYHOP: Any = _load()


@dataclass(frozen=True, slots=True, eq=False)
class Trail:
    """Linked list of decisions, newest first: ``what`` was executed, or refined by ``method``."""

    before: Trail | None
    what: Any
    method: str | None


class SearchState(_GTPYHOP.State):
    """State of the search with its decisions and the number of actions."""

    __name__ = "search state"

    def __init__(self, state: TaskState, trail: Trail | None = None, done: int = 0) -> None:
        self.state = state
        self.trail = trail
        self.done = done

    def copy(self, new_name: str | None = None) -> SearchState:
        # Actions copy the part that they change.
        return self

    def __eq__(self, other: object) -> bool:
        # GTPyhop omits steps without a change from its plan: here all of them, as the trail replaces it.
        return True

    def __ne__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


Todo = tuple[Any, ...]
"""Agenda entry. An exception of its function ends the search, and `seek` raises it."""


def step(function: Callable[[SearchState], SearchState | None]) -> Todo:
    """Return an entry whose function leads to another state, or None."""
    return ("_step", function)


def task(function: Callable[[SearchState, int], list[Todo] | None], methods: int) -> Todo:
    """Return an entry whose function refines it by the method of an index, or returns None."""
    return (f"task {methods}", function)


def seek(start: SearchState, todo: Sequence[Todo]) -> SearchState | None:
    """Return the first state after all entries, with methods tried in order; None if there is none."""
    found: list[SearchState] = []

    def end(current: SearchState) -> SearchState:
        found.append(current)
        return current

    _GTPYHOP.find_plan(start, [*todo, step(end)])
    return found[0] if found else None


def _step(current: SearchState, function: Callable[[SearchState], SearchState | None]) -> SearchState | None:
    return function(current)


def _method(index: int) -> Callable[[SearchState, Callable[[SearchState, int], list[Todo] | None]], list[Todo] | None]:
    def refine(current: SearchState, function: Callable[[SearchState, int], list[Todo] | None]) -> list[Todo] | None:
        return function(current, index)

    return refine


def _declare() -> None:
    _GTPYHOP.Domain("socialbot")  # becomes the current one
    _GTPYHOP.declare_actions(_step)
    methods = [_method(index) for index in range(MAX_METHODS)]
    for count in range(MAX_METHODS + 1):
        _GTPYHOP.declare_task_methods(f"task {count}", *methods[:count])
    _GTPYHOP.set_recursive_planning("iterative_dfs_backtracking")
    _GTPYHOP.verbose = 0


_declare()


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
        return seek(SearchState(state.copy()), [self._todo(what) for what in todo])

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

    def _todo(self, what: TaskPlace | Alternative) -> Todo:
        if isinstance(what, Alternative):
            return step(partial(self._compare, what))
        methods = self.domain.methods.get(what.item[0])
        return step(partial(self._act, what)) if methods is None else task(partial(self._refine, what), len(methods))

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

    def _refine(self, place: TaskPlace, current: SearchState, index: int) -> list[Todo] | None:
        # GTPyhop calls all methods of a task at once; an error counts only when the search reaches it.
        self._count()
        method = self.domain.methods[place.item[0]][index]
        try:
            items = self._items(method, self._call(method, current.state, place.item))
        except TaskDomainError as fault:
            return [step(partial(_raise, fault))]
        if items is None:
            return self._fail(current, f"no method does {item_text(place.item)}")
        return [step(partial(_choose, place, method.name)), *(self._todo(TaskPlace(item, place)) for item in items)]

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


def _choose(place: TaskPlace, method: str, current: SearchState) -> SearchState:
    return SearchState(current.state, Trail(current.trail, place, method), current.done)


def _raise(fault: TaskDomainError, current: SearchState) -> None:
    raise fault
