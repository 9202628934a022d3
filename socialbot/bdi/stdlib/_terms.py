"""Internal actions on lists, strings, numbers and term types."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from socialbot.bdi.agentspeak.parser import parse_term
from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Literal
from socialbot.bdi.stdlib.environment import parsed, said, spelled
from socialbot.bdi.stdlib.registry import Args, each, gives, integer_of, internal, is_number, items_of, number_of, wrong
from socialbot.bdi.terms import Atom, Cons, order
from socialbot.bdi.unification import Trail, Var, closed, resolve, undo, unify


def text_of(name: str, term: Any) -> str:
    """Format a value as `.print` does. Raises Failed for an unbound variable."""
    term = resolve(term)
    if term.__class__ is Var:
        raise wrong(name, term, "a value")
    return said(term)


def _sequence_of(name: str, term: Any) -> Any:
    term = resolve(term)
    return term if isinstance(term, str) else items_of(name, term)


def _sorted(items: Iterable[Any]) -> Args:
    return tuple(sorted(items, key=order))


def _sublists(items: Args) -> Iterator[Args]:
    for begin in range(len(items)):
        for end in range(len(items), begin, -1):
            yield items[begin:end]
    yield ()


_MISSING = object()

RESULTS: dict[str, tuple[Any, ...]] = {
    ".sort": (_sorted, items_of),
    ".reverse": (lambda items: items[::-1], _sequence_of),
    ".max": (functools.partial(max, key=order, default=_MISSING), items_of),
    ".min": (functools.partial(min, key=order, default=_MISSING), items_of),
    ".union": (lambda left, right: _sorted({*left, *right}), items_of, 2),
    ".intersection": (lambda left, right: _sorted({item for item in left if item in right}), items_of, 2),
    ".difference": (lambda left, right: _sorted({item for item in left if item not in right}), items_of, 2),
    ".lower_case": (str.lower, text_of),
    ".upper_case": (str.upper, text_of),
}
"""``.sort(L, R)``: R is the value of a function of 1 or 2 arguments, which are converted first."""

PARTS: dict[str, Callable[[Args], Iterable[Any]]] = {
    ".member": tuple,
    ".prefix": lambda items: (items[:end] for end in range(len(items), -1, -1)),
    ".suffix": lambda items: (items[begin:] for begin in range(len(items) + 1)),
    ".sublist": _sublists,
}
"""``.member(X, L)``: X is in turn each item (prefix, suffix, contiguous part) of the list L, the longest first."""

TESTS: dict[str, Callable[[Any], bool]] = {
    ".var": lambda term: term.__class__ is Var,
    ".ground": closed,
    ".number": is_number,
    ".string": lambda term: isinstance(term, str),
    ".atom": lambda term: term.__class__ is Atom,
    ".list": lambda term: term.__class__ in (tuple, Cons),
    ".literal": lambda term: isinstance(term, (Atom, Literal)),
    ".structure": lambda term: isinstance(term, (Atom, Literal, Cons, tuple)),
    ".empty": lambda term: term in ((), ""),
}
"""``.var(T)``: the term T is of this type; ``.empty(L)``: the list or string L is empty."""


def _register_result(
    name: str, function: Callable[..., Any], convert: Callable[[str, Any], Any], count: int = 1
) -> None:
    names = (name,) * count

    @internal(name, count + 1, binds=convert is text_of)
    def compute(engine: Any, args: Args, trail: Trail) -> bool:
        found = function(*map(convert, names, args))
        return found is not _MISSING and gives(args[-1], found, trail)


def _register_parts(name: str, parts: Callable[[Args], Iterable[Any]]) -> None:
    @internal(name, 2, many=True)
    def iterate(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
        return each(args[0], parts(items_of(name, args[1])), trail)


def _register_test(name: str, test: Callable[[Any], bool]) -> None:
    @internal(name, 1)
    def check(engine: Any, args: Args, trail: Trail) -> bool:
        return test(resolve(args[0]))


for _name, _result in RESULTS.items():
    _register_result(_name, *_result)
for _name, _parts in PARTS.items():
    _register_parts(_name, _parts)
for _name, _test in TESTS.items():
    _register_test(_name, _test)


@internal(".length", 2)
def length(engine: Any, args: Args, trail: Trail) -> bool:
    """``.length(L, N)``: the list or string L has N items; false for any other term."""
    items = resolve(args[0])
    return isinstance(items, (tuple, str)) and gives(args[1], len(items), trail)


@internal(".nth", 3, many=True)
def nth(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.nth(I, L, X)``: X is the item of L at I; an unbound I iterates over all positions."""
    items = items_of(".nth", args[1])
    if resolve(args[0]).__class__ is Var:
        return each((args[0], args[2]), enumerate(items), trail)
    return each(args[2], [items[_position(".nth", args[0], items)]], trail)


def _position(name: str, index: Any, items: Args | str) -> int:
    position = integer_of(name, index)
    if not 0 <= position < len(items):
        raise Failed("wrong_arguments", f"{name}: there is no item {position} among {len(items)}")
    return position


@internal(".concat", 2, 100)
def concat(engine: Any, args: Args, trail: Trail) -> bool:
    """``.concat(a1, ..., an, R)``: R is the concatenation of all lists, or one string of all arguments."""
    parts = [resolve(arg) for arg in args[:-1]]
    for part in parts:
        if part.__class__ is Var:
            raise wrong(".concat", part, "values")
    if parts[0].__class__ is tuple:
        return gives(args[-1], tuple(item for part in parts for item in items_of(".concat", part)), trail)
    return gives(args[-1], "".join(map(said, parts)), trail)


@internal(".delete", 3)
def delete(engine: Any, args: Args, trail: Trail) -> bool:
    """``.delete(X, L, R)``: R is L without the items that match X, or without the item at index X."""
    what, items = resolve(args[0]), _sequence_of(".delete", args[1])
    if isinstance(items, str) and isinstance(what, str):
        return gives(args[2], items.replace(what, ""), trail)
    if is_number(what):
        at = _position(".delete", what, items)
        return gives(args[2], items[:at] + items[at + 1 :], trail)
    return gives(args[2], tuple(item for item in items if not _fits(what, item)), trail)


def _fits(pattern: Any, item: Any) -> bool:
    trail: Trail = []
    fits = unify(pattern, item, trail)
    undo(trail, 0)
    return fits


@internal(".shuffle", 2)
def shuffle(engine: Any, args: Args, trail: Trail) -> bool:
    """``.shuffle(L, R)``: R has the items of L in random order."""
    items = list(items_of(".shuffle", args[0]))
    engine.random.shuffle(items)
    return gives(args[1], tuple(items), trail)


@internal(".substring", 2, 4, many=True, binds=True)
def substring(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.substring(Part, Whole, Begin, End)``: Part is Whole[Begin:End]; iterates over all positions."""
    part, whole = text_of(".substring", args[0]), text_of(".substring", args[1])
    spans = ((at, at + len(part)) for at in range(len(whole) - len(part) + 1) if whole.startswith(part, at))
    if len(args) == 2:
        return each((), [()] if part in whole else [], trail)
    return each(args[2:], (span[: len(args) - 2] for span in spans), trail)


@internal(".term2string", 2)
def term2string(engine: Any, args: Args, trail: Trail) -> bool:
    """``.term2string(T, S)``: S is the text of the term T; binds T or S."""
    term, text = resolve(args[0]), resolve(args[1])
    if term.__class__ is not Var:
        return gives(text, spelled(term), trail)
    if not isinstance(text, str):
        raise wrong(".term2string", text, "a term or a string")
    return gives(term, parsed(".term2string", text, parse_term, "a term"), trail)


@internal(".range", 3, 4, many=True, binds=True)
def range_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.range(I, 1, 10)`` or ``.range(I, 0, 10, 5)``: I iterates over numbers up to and including the end."""
    number, *limits = args
    first, last, step = [*(number_of(".range", limit) for limit in limits), 1][:3]
    found = resolve(number)
    low, high = (first, last) if step > 0 else (last, first)
    if step == 0:
        return each((), [], trail)
    if is_number(found):
        return each((), [()] if low <= found <= high and (found - first) % step == 0 else [], trail)
    numbers = itertools.count(first, step)
    return each(number, itertools.takewhile(lambda number: low <= number <= high, numbers), trail)


@internal(".random", 1, 2, many=True)
def random(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.random(X)``: X is a number from 0 to 1; ``.random(X, N)``: N numbers in turn (0: unlimited).

    ``.random(L, X)``: X is a random item of L. All use the seed of the agent.
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
