"""Domains of task networks: states, and actions and methods as Python functions."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar

from socialbot.core.errors import PlanningError


class TaskState:
    """State variables as attributes: ``State(loc={"spot1": "room4"})``, then ``state.loc["spot1"]``.

    A variable is a dictionary, list, set or plain value. Replace nested values rather than change them, as copies share
    them.
    """

    def __init__(self, name: str = "state", **variables: Any) -> None:
        self.__name__ = name
        vars(self).update(variables)

    if TYPE_CHECKING:

        def __setattr__(self, name: str, value: Any) -> None: ...

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{vars(self).get('__name__')} has no state variable {name!r}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TaskState) and self.variables() == other.variables()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"State({', '.join((repr(self.__name__), *(f'{name}={v!r}' for name, v in self.variables().items())))})"

    def variables(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "__name__"}

    def copy(self) -> TaskState:
        other = object.__new__(type(self))
        vars(other).update(
            (name, value.copy() if isinstance(value, (dict, list, set)) else value)
            for name, value in vars(self).items()
        )
        return other


Item = tuple[Any, ...]
"""Task or action with its arguments: ``("a_navto", "spot1", "room1")``."""

Function = TypeVar("Function", bound=Callable[..., Any])


def item_text(item: Item) -> str:
    """Return an item as a call: ``a_navto(spot1, room1)``."""
    return f"{item[0]}({', '.join(map(str, item[1:]))})"


@dataclass(frozen=True, slots=True)
class Operator:
    """Function of an action or method, with its numbers of arguments without the state."""

    name: str
    function: Callable[..., Any]
    least: int
    most: int | None
    where: str

    @property
    def arity(self) -> str:
        """Number of arguments as text."""
        if self.most is None:
            return f"{self.least} or more"
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"

    def takes(self, count: int) -> bool:
        return count >= self.least and (self.most is None or count <= self.most)


class TaskDomain:
    """Actions, tasks and methods.

    An action changes a state and returns it, or returns None if it is not applicable. A method returns a list of tasks
    and actions for its task, or None, and does not change the state. Methods are tried in the order of declaration.
    Both must be deterministic, as a planner calls them repeatedly.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.actions: dict[str, Operator] = {}
        self.methods: dict[str, tuple[Operator, ...]] = {}

    def action(self, function: Function) -> Function:
        """Declare an action with the name of the function (decorator)."""
        self.declare_actions(function)
        return function

    def method(self, task: str) -> Callable[[Function], Function]:
        """Declare a method of a task (decorator)."""

        def declare(function: Function) -> Function:
            self.declare_task_methods(task, function)
            return function

        return declare

    def declare_actions(self, *functions: Callable[..., Any] | Iterable[Callable[..., Any]]) -> None:
        """Declare actions. Raises PlanningError for a name that is taken."""
        for function in _flat(functions):
            new = _operator(function)
            if new.name in self.methods or self.actions.get(new.name, new) != new:
                kind = "a task" if new.name in self.methods else "an action"
                raise _taken(f"{self.name} has {kind} {new.name!r} already", new)
            self.actions[new.name] = new

    def declare_task_methods(self, task: str, *functions: Callable[..., Any] | Iterable[Callable[..., Any]]) -> None:
        """Declare more methods of a task; known ones have no effect. Raises PlanningError for a name that is taken."""
        for function in _flat(functions):
            new, old = _operator(function), self.methods.get(task, ())
            if new in old:
                continue
            if task in self.actions:
                raise _taken(f"{self.name} has an action {task!r} already", new)
            if any(new.name == other.name for other in old):
                raise _taken(f"{task} has a method {new.name!r} already", new)
            self.methods[task] = (*old, new)

    def operators(self, name: str) -> tuple[Operator, ...]:
        """Return the action of a name, or the methods of the task, if any."""
        return (self.actions[name],) if name in self.actions else self.methods.get(name, ())

    def after(self, state: TaskState, items: Iterable[Item]) -> TaskState:
        """Return the state after a sequence of actions. Raises PlanningError for one that cannot be done."""
        for item in items:
            if item[0] not in self.actions:
                raise PlanningError(f"{self.name} has no action {item[0]!r}")
            changed = self.actions[item[0]].function(state.copy(), *item[1:])
            if not isinstance(changed, TaskState):
                raise PlanningError(f"{item_text(item)} cannot be done", where=self.actions[item[0]].where)
            state = changed
        return state

    def similar(self, name: str) -> str | None:
        """Return the action or task with the most similar name."""
        near = get_close_matches(name, (*self.actions, *self.methods), 1)
        return near[0] if near else None


def _taken(what: str, new: Operator) -> PlanningError:
    remedy = "give each action and task a name of its own, and each method of a task"
    return PlanningError(what, where=new.where, remedy=remedy)


def _flat(functions: Iterable[Callable[..., Any] | Iterable[Callable[..., Any]]]) -> list[Callable[..., Any]]:
    return [one for given in functions for one in (given if isinstance(given, Iterable) else (given,))]


def _operator(function: Callable[..., Any]) -> Operator:
    code = getattr(function, "__code__", None)
    where = f"{code.co_filename}:{code.co_firstlineno}" if code else repr(function)
    name = getattr(function, "__name__", None)
    if name is None:
        raise PlanningError("an action or method without a name", where=where, remedy="write it as a function")
    parameters = inspect.signature(function).parameters.values()
    required = [parameter for parameter in parameters if parameter.default is parameter.empty]
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    least = sum(parameter.kind in positional for parameter in required)
    most = sum(parameter.kind in positional for parameter in parameters)
    if any(parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters):
        most = None
    if most == 0 or any(parameter.kind is parameter.KEYWORD_ONLY for parameter in required):
        what = f"{name} cannot be called with a state and arguments"
        raise PlanningError(what, where=where, remedy=f"write def {name}(state, agent, room)")
    return Operator(name, function, max(least - 1, 0), None if most is None else most - 1, where)
