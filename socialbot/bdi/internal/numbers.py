"""Internal actions on numbers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

from socialbot.bdi.internal.arguments import each, integer_of, is_number, number_of
from socialbot.bdi.internals import internal
from socialbot.bdi.unification import Trail, Var, resolve

Args = tuple[Any, ...]


@internal(".range", 3, 4, many=True, binds=True)
def range_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.range(I, 1, 10)`` or ``.range(I, 0, 10, 5)``: I is one of the numbers, the last one included."""
    number, *limits = args
    first, last, step = [*(number_of(".range", limit) for limit in limits), 1][:3]
    if step == 0:
        return
    found = resolve(number)
    if is_number(found):
        inside = first <= found <= last if step > 0 else last <= found <= first
        if inside and (found - first) % step == 0:
            yield
        return
    numbers = itertools.takewhile(
        lambda number: number <= last if step > 0 else number >= last, itertools.count(first, step)
    )
    yield from each(number, numbers, trail)


@internal(".random", 1, 2, many=True)
def random(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.random(X)``: X is a number from 0 to 1; ``.random(X, N)``: N of them, one after the other (0: without end);
    ``.random(L, X)``: X is one of the items of L. The numbers are those of the agent's seed.
    """
    items, *rest = map(resolve, args)
    if items.__class__ is tuple:
        if items and rest:
            yield from each(rest[0], [engine.random.choice(items)], trail)
        return
    times = integer_of(".random", rest[0]) if rest else 1
    turns = itertools.count() if times == 0 else range(times)
    if items.__class__ is Var:
        yield from each(items, (engine.random.random() for _ in turns), trail)
