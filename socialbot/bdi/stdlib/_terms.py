"""Internal actions on lists, strings, numbers and term types."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Literal
from socialbot.bdi.stdlib.environment import said, spelled
from socialbot.bdi.stdlib.registry import (
    each,
    gives,
    integer_of,
    internal,
    is_number,
    items_of,
    number_of,
    opened,
    wrong,
)
from socialbot.bdi.terms import Atom, Cons, order
from socialbot.bdi.unification import Trail, Var, closed, resolve, undo, unify

Args = tuple[Any, ...]


@internal(".member", 2, many=True)
def member(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.member(X, L)``: X is an item of L."""
    return each(args[0], items_of(".member", args[1]), trail)


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
        yield from each((args[0], args[2]), enumerate(items), trail)
        return
    position = integer_of(".nth", args[0])
    if not 0 <= position < len(items):
        raise Failed("wrong_arguments", f".nth: there is no item {position} in a list of {len(items)}")
    yield from each(args[2], [items[position]], trail)


@internal(".sort", 2)
def sort(engine: Any, args: Args, trail: Trail) -> bool:
    """``.sort(L, S)``: S is L in the order of terms."""
    return gives(args[1], tuple(sorted(items_of(".sort", args[0]), key=order)), trail)


@internal(".reverse", 2)
def reverse(engine: Any, args: Args, trail: Trail) -> bool:
    """``.reverse(L, R)``: R is the list or string L in reverse."""
    items = resolve(args[0])
    return gives(args[1], items[::-1] if isinstance(items, str) else items_of(".reverse", items)[::-1], trail)


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


@internal(".max", 2)
def largest(engine: Any, args: Args, trail: Trail) -> bool:
    """``.max(L, M)``: M is the maximum of L in the order of terms; false for an empty list."""
    items = items_of(".max", args[0])
    return bool(items) and gives(args[1], max(items, key=order), trail)


@internal(".min", 2)
def smallest(engine: Any, args: Args, trail: Trail) -> bool:
    """``.min(L, M)``: M is the minimum of L in the order of terms; false for an empty list."""
    items = items_of(".min", args[0])
    return bool(items) and gives(args[1], min(items, key=order), trail)


@internal(".delete", 3)
def delete(engine: Any, args: Args, trail: Trail) -> bool:
    """``.delete(X, L, R)``: R is L without the items that match X, or without the item at index X."""
    what, items = resolve(args[0]), resolve(args[1])
    if isinstance(items, str) and isinstance(what, str):
        return gives(args[2], items.replace(what, ""), trail)
    items: Any = items if isinstance(items, str) else items_of(".delete", items)
    if is_number(what):
        at = integer_of(".delete", what)
        if not 0 <= at < len(items):
            raise Failed("wrong_arguments", f".delete: there is no position {at} in {len(items)}")
        return gives(args[2], items[:at] + items[at + 1 :], trail)
    return gives(args[2], tuple(item for item in items if not _fits(what, item)), trail)


def _fits(pattern: Any, item: Any) -> bool:
    trail: Trail = []
    fits = unify(pattern, item, trail)
    undo(trail, 0)
    return fits


@internal(".union", 3)
def union(engine: Any, args: Args, trail: Trail) -> bool:
    """``.union(A, B, R)``: R is the sorted union of two lists."""
    left, right = (items_of(".union", arg) for arg in args[:2])
    return gives(args[2], _as_set(left + right), trail)


@internal(".intersection", 3)
def intersection(engine: Any, args: Args, trail: Trail) -> bool:
    """``.intersection(A, B, R)``: R is the sorted intersection of two lists."""
    left, right = (items_of(".intersection", arg) for arg in args[:2])
    return gives(args[2], _as_set(item for item in left if item in right), trail)


@internal(".difference", 3)
def difference(engine: Any, args: Args, trail: Trail) -> bool:
    """``.difference(A, B, R)``: R is the sorted list of items in A but not in B."""
    left, right = (items_of(".difference", arg) for arg in args[:2])
    return gives(args[2], _as_set(item for item in left if item not in right), trail)


def _as_set(items: Any) -> Args:
    return tuple(sorted(set(items), key=order))


@internal(".prefix", 2, many=True)
def prefix(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.prefix(P, L)``: the list P is a prefix of L; the longest first."""
    items = items_of(".prefix", args[1])
    return each(args[0], (items[:end] for end in range(len(items), -1, -1)), trail)


@internal(".suffix", 2, many=True)
def suffix(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.suffix(S, L)``: the list S is a suffix of L; the longest first."""
    items = items_of(".suffix", args[1])
    return each(args[0], (items[begin:] for begin in range(len(items) + 1)), trail)


@internal(".sublist", 2, many=True)
def sublist(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.sublist(S, L)``: S is a contiguous part of L; the longest and leftmost first."""
    items = items_of(".sublist", args[1])
    parts = (items[begin:end] for begin in range(len(items)) for end in range(len(items), begin, -1))
    yield from each(args[0], parts, trail)
    yield from each(args[0], [()], trail)


@internal(".empty", 1)
def empty(engine: Any, args: Args, trail: Trail) -> bool:
    """``.empty(L)``: the list or string L is empty."""
    return resolve(args[0]) in ((), "")


@internal(".shuffle", 2)
def shuffle(engine: Any, args: Args, trail: Trail) -> bool:
    """``.shuffle(L, R)``: R has the items of L in random order."""
    items = list(items_of(".shuffle", args[0]))
    engine.random.shuffle(items)
    return gives(args[1], tuple(items), trail)


@internal(".substring", 2, 4, many=True, binds=True)
def substring(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.substring(Part, Whole, Begin, End)``: Part is Whole[Begin:End]; iterates over all positions."""
    part, whole = _text(".substring", args[0]), _text(".substring", args[1])
    places = (at for at in range(len(whole) - len(part) + 1) if whole.startswith(part, at))
    if len(args) == 2:
        yield from each(0, [0] if part in whole else [], trail)
    elif len(args) == 3:
        yield from each(args[2], places, trail)
    else:
        yield from each((args[2], args[3]), ((at, at + len(part)) for at in places), trail)


@internal(".lower_case", 2, binds=True)
def lower_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.lower_case(S, R)``: R is S in lower case."""
    return gives(args[1], _text(".lower_case", args[0]).lower(), trail)


@internal(".upper_case", 2, binds=True)
def upper_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.upper_case(S, R)``: R is S in upper case."""
    return gives(args[1], _text(".upper_case", args[0]).upper(), trail)


@internal(".term2string", 2)
def term2string(engine: Any, args: Args, trail: Trail) -> bool:
    """``.term2string(T, S)``: S is the text of the term T; binds T or S."""
    term, text = resolve(args[0]), resolve(args[1])
    if term.__class__ is not Var:
        return gives(text, spelled(term), trail)
    if not isinstance(text, str):
        raise wrong(".term2string", text, "a term or a string")
    from socialbot.bdi.agentspeak import AgentSpeakError, parse_term

    try:
        return gives(term, opened(parse_term(text, "<.term2string>")), trail)
    except AgentSpeakError as problem:
        raise Failed("wrong_arguments", f'.term2string: "{text}" is no term') from problem


def _text(name: str, term: Any) -> str:
    term = resolve(term)
    if term.__class__ is Var:
        raise wrong(name, term, "a value")
    return said(term)


TESTS: dict[str, Callable[[Any], bool]] = {
    ".var": lambda term: term.__class__ is Var,
    ".ground": closed,
    ".number": is_number,
    ".string": lambda term: isinstance(term, str),
    ".atom": lambda term: term.__class__ is Atom,
    ".list": lambda term: term.__class__ in (tuple, Cons),
    ".literal": lambda term: isinstance(term, (Atom, Literal)),
    ".structure": lambda term: isinstance(term, (Atom, Literal, Cons, tuple)),
}


def _register(name: str, test: Callable[[Any], bool]) -> None:
    @internal(name, 1)
    def tell(engine: Any, args: tuple[Any, ...], trail: Trail) -> bool:
        return test(resolve(args[0]))


for _name, _test in TESTS.items():
    _register(_name, _test)


@internal(".range", 3, 4, many=True, binds=True)
def range_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.range(I, 1, 10)`` or ``.range(I, 0, 10, 5)``: I iterates over numbers up to and including the end."""
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
