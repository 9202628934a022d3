"""Search for a task decomposition, with a private instance of GTPyhop."""

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
from socialbot.planning.htn.domain import MOST_METHODS, Item, Operator, TaskDomain, TaskState, item_text
from socialbot.planning.htn.tree import TaskFault, TaskLimits


def _load() -> ModuleType:
    package = find_spec("gtpyhop")
    if package is None or package.origin is None:
        raise InstallationError(
            "gtpyhop-core is not installed", where="task networks", remedy="pip install 'gtpyhop-core>=2.0.2,<3'"
        )
    spec = spec_from_file_location("_gtpyhop_of_socialbot", Path(package.origin).with_name("main.py"))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_GTPYHOP: Any = _load()


class Trail:
    """What was decided, the last first: ``what`` was done, or refined by ``method``."""

    __slots__ = ("before", "method", "what")

    def __init__(self, before: Trail | None, what: Any, method: str | None) -> None:
        self.before = before
        self.what = what
        self.method = method


class SearchState(_GTPYHOP.State):
    """A state in the search, and how it came about: ``done`` actions long."""

    __name__ = "moment"

    def __init__(self, state: TaskState, trail: Trail | None = None, done: int = 0) -> None:
        self.state = state
        self.trail = trail
        self.done = done

    def copy(self, new_name: str | None = None) -> SearchState:
        # Who does an action copies what it changes.
        return self

    def __eq__(self, other: object) -> bool:
        # GTPyhop leaves out of its plan what changes nothing: all of it, as the trail knows more.
        return True

    def __ne__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


Todo = tuple[Any, ...]
"""An entry of a list to do. What its function raises ends the search, and is raised by `seek`."""


def step(function: Callable[[SearchState], SearchState | None]) -> Todo:
    """An entry that leads to another moment, or to None if that cannot be."""
    return ("_step", function)


def task(function: Callable[[SearchState, int], list[Todo] | None], methods: int) -> Todo:
    """An entry that leads to a list to do by each of so many methods, or to None if that one does not apply."""
    return (f"task {methods}", function)


def seek(start: SearchState, todo: Sequence[Todo]) -> SearchState | None:
    """The first moment at which all of ``todo`` is done, methods tried in order; None if there is none."""
    found: list[SearchState] = []

    def end(moment: SearchState) -> SearchState:
        found.append(moment)
        return moment

    _GTPYHOP.find_plan(start, [*todo, step(end)])
    return found[0] if found else None


def _step(moment: SearchState, function: Callable[[SearchState], SearchState | None]) -> SearchState | None:
    return function(moment)


def _method(index: int) -> Callable[[SearchState, Callable[[SearchState, int], list[Todo] | None]], list[Todo] | None]:
    def refine(moment: SearchState, function: Callable[[SearchState, int], list[Todo] | None]) -> list[Todo] | None:
        return function(moment, index)

    return refine


def _declare() -> None:
    _GTPYHOP.Domain("socialbot")  # becomes the current one
    _GTPYHOP.declare_actions(_step)
    methods = [_method(index) for index in range(MOST_METHODS)]
    for count in range(MOST_METHODS + 1):
        _GTPYHOP.declare_task_methods(f"task {count}", *methods[:count])
    _GTPYHOP.set_recursive_planning("iterative_dfs_backtracking")
    _GTPYHOP.verbose = 0


_declare()


class LimitReached(Exception):  # noqa: N818 - no error
    """The time or the attempts are used up."""


class Cancelled(Exception):  # noqa: N818 - no error
    """Nobody wants to know any more."""


class TaskDomainError(Exception):
    """The domain, or what was asked, is wrong."""

    def __init__(self, fault: TaskFault, what: str, *, where: str | None = None, remedy: str | None = None) -> None:
        super().__init__(str(PlanningError(what, where=where, remedy=remedy)))
        self.fault = fault


@dataclass(eq=False, slots=True)
class TaskPlace:
    """Where an item stands: below another one; at the top, at a node of a tree, or nowhere yet."""

    item: Item
    above: TaskPlace | None = None
    node: int | None = None


@dataclass(frozen=True, slots=True)
class Alternative:
    """Demands that ``place`` was done in another way than by ``actions``, from the one number ``failed`` or earlier."""

    place: TaskPlace
    actions: tuple[Item, ...]
    failed: int

    def holds(self, trail: Trail | None) -> bool:
        """Whether ``trail``, which ends with ``place``, goes another way."""
        new = [entry.what.item for entry in back(trail, self.place) if entry.method is None]
        again = len(self.actions) - self.failed <= len(new) <= len(self.actions)
        return not again or self.actions[len(self.actions) - len(new) :] != tuple(reversed(new))


def back(trail: Trail | None, start: TaskPlace | None = None) -> Iterator[Trail]:
    """The trail from its end back to where ``start`` was done or refined, or to its beginning."""
    while trail is not None:
        yield trail
        trail = None if trail.what is start else trail.before


@dataclass(eq=False)
class TaskSearch:
    """Searches in one domain that share their limits; ``end`` is when to give up (``time.thread_time``)."""

    domain: TaskDomain
    limits: TaskLimits
    blacklist: Sequence[Item]
    cancelled: threading.Event | None
    end: float
    attempts: int = 0
    _furthest: tuple[int, str] = field(default=(-1, ""))

    def run(self, state: TaskState, todo: Sequence[TaskPlace | Alternative]) -> SearchState | None:
        """The moment at which all of ``todo`` is done, one after the other, or None if it cannot be.

        Raises LimitReached, Cancelled, DomainFault.
        """
        return seek(SearchState(state.copy()), [self._todo(what) for what in todo])

    @property
    def obstacle(self) -> str:
        """What stood in the way when the search had got furthest."""
        done, what = self._furthest
        return f"after {done} action{'' if done == 1 else 's'} {what}"

    def check(self, item: Any, whence: str, where: str | None = None) -> None:
        """Raises DomainFault if the domain has no such action or task."""
        if not isinstance(item, (list, tuple)) or not item or not isinstance(item[0], str):
            raise TaskDomainError(
                TaskFault.MALFORMED,
                f"{item!r:.80}, in {whence}, is no task",
                where=where,
                remedy='write ("name", argument)',
            )
        operators = self.domain.operators(item[0])
        if not operators:
            similar = self.domain.similar(item[0])
            raise TaskDomainError(
                TaskFault.UNKNOWN,
                f"{self.domain.name} has no action or task {item[0]!r}, which stands in {whence}",
                where=where,
                remedy=f"did you mean {similar!r}?" if similar else "declare it",
            )
        for operator in operators:
            if not operator.takes(len(item) - 1):
                raise TaskDomainError(
                    TaskFault.ARITY,
                    f"{item_text(tuple(item))}, in {whence}: {operator.name} takes {operator.arity} arguments",
                    where=where or operator.where,
                )

    def _todo(self, what: TaskPlace | Alternative) -> Todo:
        if isinstance(what, Alternative):
            return step(partial(self._compare, what))
        methods = self.domain.methods.get(what.item[0])
        return step(partial(self._act, what)) if methods is None else task(partial(self._refine, what), len(methods))

    def _act(self, place: TaskPlace, moment: SearchState) -> SearchState | None:
        self._count()
        if place.item in self.blacklist:
            return self._stuck(moment, f"{item_text(place.item)} is blacklisted")
        action = self.domain.actions[place.item[0]]
        after = self._call(action, moment.state.copy(), place.item)
        if after is None or after is False:
            return self._stuck(moment, f"{item_text(place.item)} cannot be done")
        if not isinstance(after, TaskState):
            raise TaskDomainError(
                TaskFault.MALFORMED,
                f"{action.name} returned {after!r:.80}, which is no state",
                where=action.where,
                remedy="return the state, or None if the action cannot be done",
            )
        return SearchState(after, Trail(moment.trail, place, None), moment.done + 1)

    def _refine(self, place: TaskPlace, moment: SearchState, index: int) -> list[Todo] | None:
        # GTPyhop asks all methods of a task at once; a fault counts only when the search comes to it.
        self._count()
        method = self.domain.methods[place.item[0]][index]
        try:
            items = self._items(method, self._call(method, moment.state, place.item))
        except TaskDomainError as fault:
            return [step(partial(_complain, fault))]
        if items is None:
            return self._stuck(moment, f"no method does {item_text(place.item)}")
        return [step(partial(_choose, place, method.name)), *(self._todo(TaskPlace(item, place)) for item in items)]

    def _compare(self, otherwise: Alternative, moment: SearchState) -> SearchState | None:
        if otherwise.holds(moment.trail):
            return moment
        return self._stuck(moment, f"{item_text(otherwise.place.item)} would fail as it did")

    def _count(self) -> None:
        self.attempts += 1
        if self.cancelled is not None and self.cancelled.is_set():
            raise Cancelled
        if self.attempts > self.limits.steps or time.thread_time() >= self.end:
            raise LimitReached

    def _stuck(self, moment: SearchState, what: str) -> None:
        if moment.done >= self._furthest[0]:
            self._furthest = (moment.done, what)

    def _call(self, operator: Operator, state: TaskState, item: Item) -> Any:
        try:
            return operator.function(state, *item[1:])
        except Exception as problem:
            file = operator.where.rpartition(":")[0]
            lines = [line.lineno for line in traceback.extract_tb(problem.__traceback__) if line.filename == file]
            raise TaskDomainError(
                TaskFault.RAISED,
                f"{operator.name} for {item_text(item)}: {type(problem).__name__}: {problem}",
                where=f"{file}:{lines[-1]}" if lines else operator.where,
            ) from problem

    def _items(self, method: Operator, returned: Any) -> list[Item] | None:
        if returned is None or returned is False:
            return None
        if not isinstance(returned, (list, tuple)):
            raise TaskDomainError(
                TaskFault.MALFORMED,
                f"{method.name} returned {returned!r:.80}, which is no list",
                where=method.where,
                remedy="return a list of tasks and actions, or None if the method does not apply",
            )
        for item in returned:
            self.check(item, f"what {method.name} returned", method.where)
        return [tuple(item) for item in returned]


def _choose(place: TaskPlace, method: str, moment: SearchState) -> SearchState:
    return SearchState(moment.state, Trail(moment.trail, place, method), moment.done)


def _complain(fault: TaskDomainError, moment: SearchState) -> None:
    raise fault
