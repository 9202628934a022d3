"""Actions of AgentSpeak programs in Python, with results: the decorator `asl_action` and its registry.

The function receives the agent (its `Engine`) and as many arguments as it takes. Further arguments of the call are
unified with its result, so ``lookup(N, Id)`` binds ``Id`` to the result of ``def lookup(agent, n)``.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Coroutine, Iterator
from numbers import Integral, Real
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, overload

from socialbot.bdi.intentions import Failed
from socialbot.bdi.stdlib import internals
from socialbot.bdi.stdlib.registry import INTERNALS, Args, Internal
from socialbot.bdi.terms import Atom, show
from socialbot.bdi.unification import Trail, closed, resolve, undo, unify
from socialbot.core.errors import RuleError

ENTRY_POINTS = "socialbot.asl_actions"
"""Group of entry points that name a function, or a module whose import registers actions."""

MOST_ARGUMENTS = 100

REGISTERED: dict[str, Callable[..., Any]] = {}
"""Registered actions without a dot in their names; those with a dot are in ``INTERNALS``."""

F = TypeVar("F", bound=Callable[..., Any])


@overload
def asl_action(function: F) -> F: ...


@overload
def asl_action(function: str | None = None, *, results: int | None = None) -> Callable[[F], F]: ...


def asl_action(function: Any = None, *, results: int | None = None) -> Any:
    """Register a function as an action of all AgentSpeak programs; it decorates a function.

    The agent (`Engine`) is the first argument. A name with a dot, as in ``@asl_action("geo.near")`` or
    ``@asl_action(".near")``, makes an internal action, which can also be a condition: each value that the function
    yields is a solution. Other actions are steps of plans, and take the first value. An ``async def`` pauses the plan
    only.

    Args:
        function: The function, whose name the action has, or the name of the action.
        results: The number of arguments at the end of a call that are results; by default those that the function does
            not take. A single result is the value that the function returns, several are a tuple.

    Returns:
        The function itself.

    Raises:
        RuleError: The name is not one of AgentSpeak, or is taken by another function.
    """

    def register(found: F, name: str | None = None) -> F:
        _register(name or found.__name__, found, results)
        return found

    if callable(function):
        return register(function)
    return lambda found: register(found, function)


def registered(name: str) -> Callable[..., Any] | None:
    """Find the function of an action without a dot; the first unknown name imports the entry points."""
    if name not in REGISTERED:
        load_entry_points()
    return REGISTERED.get(name)


@functools.cache
def load_entry_points() -> None:
    """Import the actions of installed distributions. Raises RuleError for one that cannot be imported."""
    from importlib import metadata  # half of the cost of importing the engine

    for point in sorted(metadata.entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        try:
            found = point.load()
        except Exception as error:
            raise RuleError(
                f"the entry point '{point.name}' of {ENTRY_POINTS} cannot be loaded: {type(error).__name__}: {error}",
                remedy=f"fix {point.value}, or uninstall the distribution that declares it",
            ) from error
        if callable(found) and found not in (REGISTERED.get(point.name), _functions.get(point.name)):
            _register(point.name, found, None)


def import_module(reference: str, folder: Path | None = None) -> ModuleType:
    """Import a module of actions or of an environment.

    Args:
        reference: The name of a module, or the path of a Python file.
        folder: A folder with modules, searched first; by default the current one.

    Raises:
        RuleError: The module cannot be imported.
    """
    file = Path(reference)
    if file.suffix == ".py":
        folder, reference = (folder or Path()) / file.parent, file.stem
    path = str((folder or Path()).resolve())
    if path not in sys.path:
        sys.path.insert(0, path)
    try:
        return importlib.import_module(reference)
    except Exception as problem:
        raise RuleError(
            f"the module {reference} cannot be imported: {type(problem).__name__}: {problem}",
            remedy=f"check the module; it is searched in {path} and among the installed ones",
        ) from problem


_functions: dict[str, Callable[..., Any]] = {}


def _register(name: str, function: Callable[..., Any], results: int | None) -> None:
    plain = name.removeprefix(".")
    if not all(part.isidentifier() for part in plain.split(".")) or not plain[0].islower():
        raise RuleError(
            f"{name!r} cannot be the name of an action",
            remedy="begin with a small letter, or a dot before it; use letters, digits, _ and dots",
        )
    if name[0] == "." and name not in _functions and name in internals():
        raise RuleError(f"{name!r} cannot be the name of an action: AgentSpeak has it", remedy="choose another name")
    known = _functions.get(name)
    if known is not None and (known.__module__, known.__qualname__) != (function.__module__, function.__qualname__):
        raise RuleError(
            f"the action {name} is already registered by {known.__module__}.{known.__qualname__}",
            remedy="choose another name",
        )
    _functions[name] = function
    if results is not None:
        _results[function] = results
        _number_of_inputs.cache_clear()
        for functions in DIRECT.values():
            functions.clear()
    if "." in name:
        least, _ = parameters(function)
        pauses = inspect.iscoroutinefunction(function)
        solve = functools.partial(_step if pauses else _solutions, name, function)
        INTERNALS[name] = Internal(solve, (least, MOST_ARGUMENTS), many=not pauses, pauses=pauses)
    else:
        REGISTERED[name] = function


_results: dict[Callable[..., Any], int] = {}


@functools.lru_cache(1024)
def parameters(function: Callable[..., Any]) -> tuple[int, float]:
    """Smallest and largest number of arguments that a function takes after the agent."""
    least, most = 0, 0.0
    try:
        found = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # a function in C
        return 0, math.inf
    for parameter in found:
        if parameter.kind is parameter.VAR_POSITIONAL:
            most = math.inf
        elif parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD):
            least += parameter.default is parameter.empty
            most += 1
    return max(least - 1, 0), most - 1


DIRECT: defaultdict[int, dict[Any, Callable[..., Any]]] = defaultdict(dict)
"""Functions that take this number of values and give no results, so that `call` does no more than call them.

The keys are the functions or the classes of actions under which agents know them.
"""


def call(engine: Any, name: str, function: Callable[..., Any], args: Args, plain: bool = False) -> Any:
    """Call the function of a step; return its result or pause, after binding the arguments that are results.

    With ``plain``, the arguments have no variables.

    Raises:
        Failed: An argument has no value, or the result does not match.
    """
    if plain and _number_of_inputs(name, function, len(args))[0] == len(args):
        inputs, outputs = args, ()
        if not inspect.isgeneratorfunction(function):
            DIRECT[len(args)][function] = function
    else:
        inputs, outputs = _split(name, function, args)
    found = function(engine, *inputs)
    if found is not None and inspect.isgenerator(found):
        found = next(found, None if outputs else False)
    if not outputs:
        return found
    if inspect.iscoroutine(found):
        return _awaited(name, found, engine.interpreter.action, outputs)
    _bind(name, outputs, found, [])
    return None


def _split(name: str, function: Callable[..., Any], args: Args) -> tuple[Args, Args]:
    """Split the arguments of a call into those for the function and those for its results."""
    split, bounded = _number_of_inputs(name, function, len(args))
    if split == len(args) and closed(args):
        return resolve(args), ()
    inputs, outputs = args[:split], args[split:]
    if bounded and not closed(inputs):
        shown = next(arg for arg in inputs if not closed(arg))
        raise Failed("no_value", f"{name}({', '.join(map(show, resolve(args)))}): {resolve(shown)} has no value")
    return resolve(inputs), outputs


@functools.lru_cache(1024)
def _number_of_inputs(name: str, function: Callable[..., Any], given: int) -> tuple[int, bool]:
    """Return how many of the given arguments are for the function, and whether it takes a limited number."""
    least, most = parameters(function)
    count = _results.get(function)
    split = min(given, most) if count is None else given - count
    if split < least or split > most:
        takes = str(least) if least == most else f"{least} or more" if most == math.inf else f"{least} to {most:.0f}"
        results = f", and {count} for results" if count else ""
        raise Failed("wrong_arguments", f"{name} takes {takes} arguments{results} (got {given})")
    return int(split), most < math.inf


def _awaited(name: str, coroutine: Coroutine[Any, Any, Any], cause: Any, outputs: Args) -> Any:
    from socialbot.bdi.durative_actions import CoroutineRun

    return CoroutineRun(coroutine, cause, lambda found: _bind(name, outputs, found, []))


def _step(name: str, function: Callable[..., Any], engine: Any, args: Args, trail: Trail) -> Any:
    """Call the function of an internal action that pauses."""
    inputs, outputs = _split(name, function, args)
    return _awaited(name, function(engine, *inputs), engine.interpreter.action, outputs)


def _solutions(name: str, function: Callable[..., Any], engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """Yield the solutions of an internal action."""
    inputs, outputs = _split(name, function, args)
    found = function(engine, *inputs)
    mark = len(trail)
    for value in found if inspect.isgenerator(found) else [found]:
        holds = value is not None if outputs else value is not False
        if holds and (not outputs or unify(outputs, _values(name, outputs, value), trail)):
            yield
        undo(trail, mark)


def _bind(name: str, outputs: Args, found: Any, trail: Trail) -> None:
    if not outputs:
        if found is False:
            raise Failed("action_failed", f"{name} returned False")
        return
    if found is None:
        raise Failed("action_failed", f"{name} has no result")
    values = _values(name, outputs, found)
    if not unify(outputs, values, trail):
        undo(trail, 0)
        raise Failed("action_failed", f"the result of {name} is {', '.join(map(show, values))}, not {_shown(outputs)}")


def _values(name: str, outputs: Args, found: Any) -> Args:
    values = found if len(outputs) > 1 and isinstance(found, (tuple, list)) else (found,)
    if len(values) != len(outputs):
        raise Failed("wrong_arguments", f"{name} has {len(values)} results, but {_shown(outputs)} takes {len(outputs)}")
    return tuple(term_of(value) for value in values)


def _shown(terms: Args) -> str:
    return ", ".join(map(show, resolve(terms)))


def term_of(value: Any) -> Any:
    """Convert a Python value to a term: lists and tuples to lists, truth values to atoms.

    Raises:
        Failed: The value is mutable.
    """
    if value is True or value is False:
        return Atom("true" if value else "false")
    if isinstance(value, (tuple, list)):
        return tuple(map(term_of, value))
    if isinstance(value, (str, int, float)):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    try:
        hash(value)
    except TypeError as problem:
        raise Failed("wrong_arguments", f"{value!r} cannot be a term: {problem}") from problem
    return value
