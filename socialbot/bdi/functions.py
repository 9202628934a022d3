"""The functions that AgentSpeak's arithmetic may call, as ``math.max(X, 3)`` or ``.length(L)``.

Each takes the engine and the values of its arguments; those that take a condition are compiled in place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from socialbot.bdi.failures import Failed


def _length(engine: Any, items: Any) -> int:
    if not isinstance(items, (tuple, str)):
        raise Failed("wrong_arguments", f".length of {items}, which is no list and no string")
    return len(items)


def _random(engine: Any, most: float = 1) -> float:
    return engine.random.random() * most


def _time(engine: Any) -> int:
    """The time (ms) of the agent's clock."""
    return engine.clock.now() // 1_000_000


def _plain(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of numbers. What it cannot compute is a failure."""

    def compute(engine: Any, *args: Any) -> Any:
        try:
            return function(*args)
        except (TypeError, ValueError, ArithmeticError) as problem:
            shown = ", ".join(map(str, args))
            raise Failed("wrong_arguments", f"{name}({shown}): {problem}") from problem

    return compute


def _of_all(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of several numbers, which may also come in a list."""
    return _plain(name, lambda *args: function(args[0] if len(args) == 1 and isinstance(args[0], tuple) else args))


def _average(numbers: Any) -> float:
    return sum(numbers) / len(numbers)


def _deviation(numbers: Any) -> float:
    mean = _average(numbers)
    return math.sqrt(sum((number - mean) ** 2 for number in numbers) / (len(numbers) - 1))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    ".length": _length,
    "math.random": _random,
    "system.time": _time,
    **{
        name: _of_all(name, function)
        for name, function in {
            "math.max": max,
            "math.min": min,
            "math.sum": sum,
            "math.average": _average,
            "math.std_dev": _deviation,
        }.items()
    },
    **{
        name: _plain(name, function)
        for name, function in {
            "math.abs": abs,
            "math.round": lambda x: math.floor(x + 0.5),
            "math.floor": math.floor,
            "math.ceil": math.ceil,
            "math.sqrt": math.sqrt,
            "math.sin": math.sin,
            "math.cos": math.cos,
            "math.tan": math.tan,
            "math.asin": math.asin,
            "math.acos": math.acos,
            "math.atan": math.atan,
            "math.log": math.log,
            "math.exp": math.exp,
            "math.pi": lambda: math.pi,
            "math.e": lambda: math.e,
        }.items()
    },
}
"""By name."""
