"""GTPyhop's search, in an instance of the library that is ours alone.

The search with its backtracking (``find_plan`` by the strategy ``iterative_dfs_backtracking``) is GTPyhop's. The
library keeps its domain, strategy and verbosity in globals, prints when it is imported, and logs each attempt into a
list that is never emptied. Hence this module loads an instance of it for itself, which nobody else can set to something
else, and which has no log. It has one domain for all planners: its few actions and methods call what they are given. So
any number of threads can search at once, each for another planner, and no global ever changes.

GTPyhop's own plan would lack actions that change nothing. It is left empty; a `Moment` remembers how it came about.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from socialbot.errors import InstallationError
from socialbot.tasks.domain import MOST_METHODS
from socialbot.tasks.state import State


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


class Moment(_GTPYHOP.State):
    """A state in the search, and how it came about: ``done`` actions long."""

    __name__ = "moment"

    def __init__(self, state: State, trail: Trail | None = None, done: int = 0) -> None:
        self.state = state
        self.trail = trail
        self.done = done

    def copy(self, new_name: str | None = None) -> Moment:
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


def step(function: Callable[[Moment], Moment | None]) -> Todo:
    """An entry that leads to another moment, or to None if that cannot be."""
    return ("_step", function)


def task(function: Callable[[Moment, int], list[Todo] | None], methods: int) -> Todo:
    """An entry that leads to a list to do by each of so many methods, or to None if that one does not apply."""
    return (f"task {methods}", function)


def seek(start: Moment, todo: Sequence[Todo]) -> Moment | None:
    """The first moment at which all of ``todo`` is done, methods tried in order; None if there is none."""
    found: list[Moment] = []

    def end(moment: Moment) -> Moment:
        found.append(moment)
        return moment

    _GTPYHOP.find_plan(start, [*todo, step(end)])
    return found[0] if found else None


def _step(moment: Moment, function: Callable[[Moment], Moment | None]) -> Moment | None:
    return function(moment)


def _method(index: int) -> Callable[[Moment, Callable[[Moment, int], list[Todo] | None]], list[Todo] | None]:
    def refine(moment: Moment, function: Callable[[Moment, int], list[Todo] | None]) -> list[Todo] | None:
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
