"""Task domains: states, actions and methods as Python functions."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar

from socialbot.core.errors import PlanningError


class TaskState:
    """State variables as attributes: ``State(loc={"spot1": "room4"})``, then ``state.loc["spot1"]``.

    A variable is a dictionary, list or set, or a plain value. Values inside of those are never changed in place, but
    replaced: copies share them.
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
        """The state variables by name."""
        return {name: value for name, value in vars(self).items() if name != "__name__"}

    def copy(self) -> TaskState:
        """Another state with the same variables; one can be changed without the other."""
        other = object.__new__(type(self))
        vars(other).update(
            (name, value.copy() if isinstance(value, (dict, list, set)) else value)
            for name, value in vars(self).items()
        )
        return other


Item = tuple[Any, ...]
"""A task or an action with its arguments: ``("a_navto", "spot1", "room1")``."""

MOST_METHODS = 64
"""A task can have this many methods."""

Function = TypeVar("Function", bound=Callable[..., Any])


def item_text(item: Item) -> str:
    """The item as it is called: ``a_navto(spot1, room1)``."""
    return f"{item[0]}({', '.join(map(str, item[1:]))})"


@dataclass(frozen=True, slots=True)
class Operator:
    """A function that is an action or a method, and how many arguments it takes beside the state."""

    name: str
    function: Callable[..., Any]
    least: int
    most: int | None
    where: str

    @property
    def arity(self) -> str:
        """How many arguments it takes, in words."""
        if self.most is None:
            return f"{self.least} or more"
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"

    def takes(self, count: int) -> bool:
        """Whether it can be called with ``count`` arguments beside the state."""
        return count >= self.least and (self.most is None or count <= self.most)


class TaskDomain:
    """What can be done, and how.

    An action takes a state and arguments, changes that state and returns it, or returns None if it cannot be done
    there. A method takes a state, which it leaves as it is, and the arguments of its task; it returns a list of tasks
    and actions, or None if it does not apply. The methods of a task are tried in the order of their declaration.
    Both have to do the same for the same state: a planner calls them many times.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.actions: dict[str, Operator] = {}
        self.methods: dict[str, tuple[Operator, ...]] = {}

    def action(self, function: Function) -> Function:
        """Declares an action, called as the function is; a decorator."""
        self.declare_actions(function)
        return function

    def method(self, task: str) -> Callable[[Function], Function]:
        """Declares a method for ``task``; a decorator."""

        def declare(function: Function) -> Function:
            self.declare_task_methods(task, function)
            return function

        return declare

    def declare_actions(self, *functions: Callable[..., Any] | Iterable[Callable[..., Any]]) -> None:
        """Declares actions. Raises PlanningError for a name that is taken."""
        for function in _flat(functions):
            new = _operator(function)
            if new.name in self.methods or self.actions.get(new.name, new) != new:
                raise PlanningError(
                    f"{self.name} has {'a task' if new.name in self.methods else 'an action'} {new.name!r} already",
                    where=new.where,
                    remedy="give each action and task a name of its own",
                )
            self.actions[new.name] = new

    def declare_task_methods(self, task: str, *functions: Callable[..., Any] | Iterable[Callable[..., Any]]) -> None:
        """Declares methods for ``task``, in addition to those there are. Raises PlanningError for a name that is taken.

        Declaring the same method again changes nothing.
        """
        for function in _flat(functions):
            new, old = _operator(function), self.methods.get(task, ())
            if new in old:
                continue
            if task in self.actions or any(new.name == other.name for other in old):
                raise PlanningError(
                    f"{self.name} has an action {task!r} already"
                    if task in self.actions
                    else f"{task} has a method {new.name!r} already",
                    where=new.where,
                    remedy="give each action and task a name of its own, and each method of a task",
                )
            if len(old) == MOST_METHODS:
                raise PlanningError(
                    f"{task} has {MOST_METHODS} methods already",
                    where=new.where,
                    remedy="group them as tasks of their own",
                )
            self.methods[task] = (*old, new)

    def operators(self, name: str) -> tuple[Operator, ...]:
        """The action called ``name``, or the methods of that task; none if there is no such thing."""
        return (self.actions[name],) if name in self.actions else self.methods.get(name, ())

    def after(self, state: TaskState, items: Iterable[Item]) -> TaskState:
        """The state after actions have been done one after the other; ``state`` is left as it is.

        Raises PlanningError for an action that cannot be done, or that there is not.
        """
        for item in items:
            if item[0] not in self.actions:
                raise PlanningError(f"{self.name} has no action {item[0]!r}")
            changed = self.actions[item[0]].function(state.copy(), *item[1:])
            if not isinstance(changed, TaskState):
                raise PlanningError(f"{item_text(item)} cannot be done", where=self.actions[item[0]].where)
            state = changed
        return state

    def similar(self, name: str) -> str | None:
        """The action or task that ``name`` may be a mistake for."""
        near = get_close_matches(name, (*self.actions, *self.methods), 1)
        return near[0] if near else None


def _flat(functions: Iterable[Callable[..., Any] | Iterable[Callable[..., Any]]]) -> Iterable[Callable[..., Any]]:
    for function in functions:
        if isinstance(function, Iterable):
            yield from function
        else:
            yield function


def _operator(function: Callable[..., Any]) -> Operator:
    code = getattr(function, "__code__", None)
    where = f"{code.co_filename}:{code.co_firstlineno}" if code else repr(function)
    name = getattr(function, "__name__", None)
    if name is None:
        raise PlanningError("an action or method without a name", where=where, remedy="write it as a function")
    kinds = [parameter.kind for parameter in inspect.signature(function).parameters.values()]
    required = [
        parameter
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty
    ]
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    least = sum(parameter.kind in positional for parameter in required)
    most = None if inspect.Parameter.VAR_POSITIONAL in kinds else sum(kind in positional for kind in kinds)
    if most == 0 or any(parameter.kind is parameter.KEYWORD_ONLY for parameter in required):
        raise PlanningError(
            f"{name} cannot be called with a state and arguments",
            where=where,
            remedy=f"write def {name}(state, agent, room)",
        )
    return Operator(name, function, max(least - 1, 0), None if most is None else most - 1, where)
