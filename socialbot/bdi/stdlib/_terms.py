"""Internal actions on lists, numbers, and the types and annotations of terms."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Event, Literal, is_source, literal, source
from socialbot.bdi.plans import Inference, Plan
from socialbot.bdi.stdlib._strings import replaced, text_of
from socialbot.bdi.stdlib.registry import (
    Args,
    Collection,
    detached,
    each,
    gives,
    integer_of,
    internal,
    is_number,
    items_of,
    wrong,
)
from socialbot.bdi.terms import Atom, Cons, order
from socialbot.bdi.unification import Trail, Var, closed, resolve, undo


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
    ".literal": lambda term: isinstance(term, (Atom, Literal, Event, Plan)),
    ".structure": lambda term: isinstance(term, (Literal, Cons, tuple)),
    ".empty": lambda term: isinstance(term, (tuple, str, Collection)) and not len(term),
}
"""``.var(T)``: the term T is of this type; ``.empty(L)``: the list or string L is empty."""


DESCRIBED = {
    ".sort": "``.sort(L, R)``: R has the items of the list L in the order of terms.",
    ".reverse": "``.reverse(L, R)``: R is the list or string L from back to front.",
    ".max": "``.max(L, M)``: M is the item of L that comes last in the order of terms; false for an empty list.",
    ".min": "``.min(L, M)``: M is the item of L that comes first in the order of terms; false for an empty list.",
    ".union": "``.union(A, B, R)``: R has the items of both lists, sorted, each once.",
    ".intersection": "``.intersection(A, B, R)``: R has the items that are in both lists, sorted, each once.",
    ".difference": "``.difference(A, B, R)``: R has the items of A that are not in B, sorted, each once.",
    ".member": "``.member(X, L)``: X is in turn each item of the list, set or queue L.",
    ".prefix": "``.prefix(P, L)``: the list L begins with the list P, the longest first.",
    ".suffix": "``.suffix(S, L)``: the list L ends with the list S, the longest first.",
    ".sublist": "``.sublist(S, L)``: the items of S follow each other in L, the longest and foremost first.",
    ".var": "``.var(T)``: the term T is a variable without a value.",
    ".ground": "``.ground(T)``: no variable in T is without a value.",
    ".number": "``.number(T)``: T is a number.",
    ".string": "``.string(T)``: T is a string.",
    ".atom": "``.atom(T)``: T is an atom.",
    ".list": "``.list(T)``: T is a list.",
    ".literal": "``.literal(T)``: T is an atom, a structure, an event or a plan.",
    ".structure": "``.structure(T)``: T is a structure, a literal with annotations or a list; a name alone is none.",
    ".empty": "``.empty(L)``: the list, string, set, map or queue L has no items.",
}


def _register_result(
    name: str, function: Callable[..., Any], convert: Callable[[str, Any], Any], count: int = 1
) -> None:
    names = (name,) * count

    @internal(name, count + 1)
    def compute(engine: Any, args: Args, trail: Trail) -> bool:
        found = function(*map(convert, names, args))
        return found is not _MISSING and gives(args[-1], found, trail)

    compute.__doc__ = DESCRIBED[name]


def _register_parts(name: str, parts: Callable[[Args], Iterable[Any]]) -> None:
    @internal(name, 2, many=True)
    def iterate(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
        return each(args[0], parts(items_of(name, args[1])), trail)

    iterate.__doc__ = DESCRIBED[name]


def _register_test(name: str, test: Callable[[Any], bool]) -> None:
    @internal(name, 1)
    def check(engine: Any, args: Args, trail: Trail) -> bool:
        return test(resolve(args[0]))

    check.__doc__ = DESCRIBED[name]


for _name, _result in RESULTS.items():
    _register_result(_name, *_result)
for _name, _parts in PARTS.items():
    _register_parts(_name, _parts)
for _name, _test in TESTS.items():
    _register_test(_name, _test)


@internal(".length", 2)
def length(engine: Any, args: Args, trail: Trail) -> bool:
    """``.length(L, N)``: the list, string, set, map or queue L has N items; false for any other term."""
    items = resolve(args[0])
    return isinstance(items, (tuple, str, Collection)) and gives(args[1], len(items), trail)


@internal(".nth", 3, many=True)
def nth(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.nth(I, L, X)``: X is the item of the list or string L at I; an unbound I iterates over all positions."""
    items = _sequence_of(".nth", args[1])
    if resolve(args[0]).__class__ is Var:
        return each((args[0], args[2]), enumerate(items), trail)
    position = integer_of(".nth", args[0])
    if not 0 <= position < len(items):
        raise Failed("wrong_arguments", f".nth: there is no item {position} among {len(items)}")
    return each(args[2], [items[position]], trail)


@internal(".delete", 3, 4)
def delete(engine: Any, args: Args, trail: Trail) -> bool:
    """``.delete(X, L, R)``: R is L without the items that match X.

    ``.delete(1, L, R)`` deletes the item at 1, ``.delete(1, 3, L, R)`` those from 1 to before 3. In a string, X is a
    regular expression. A variable in X gets its value from the first match.
    """
    what, *rest = map(resolve, args)
    if is_number(what):
        begin = integer_of(".delete", what)
        between = len(rest) == 3 and is_number(rest[0])
        end = integer_of(".delete", rest.pop(0)) if between else begin + 1
        if len(rest) == 2 and rest[0].__class__ in (str, tuple):
            return gives(rest[1], _without(rest[0], begin, end), trail)
    if len(rest) != 2:
        raise wrong(".delete", rest[0], "a list or a string, after one or two numbers, or after a term")
    if isinstance(what, str) and rest[0].__class__ is not tuple:
        return gives(rest[1], replaced(".delete", what, "", text_of(".delete", rest[0])), trail)
    matches: Trail = []
    left = tuple(item for item in items_of(".delete", rest[0]) if not gives(what, item, matches))
    undo(matches, 0)
    return gives(rest[1], left, trail)


def _without(items: Any, begin: int, end: int) -> Any:
    """Return a list or string without a part; a string without this part stays, as in Jason."""
    if isinstance(items, str):
        return items[:begin] + items[end:] if 0 <= begin <= len(items) and 0 <= end <= len(items) else items
    return tuple(item for i, item in enumerate(items) if not begin <= i < end)


@internal(".shuffle", 2)
def shuffle(engine: Any, args: Args, trail: Trail) -> bool:
    """``.shuffle(L, R)``: R has the items of L in random order."""
    items = list(items_of(".shuffle", args[0]))
    engine.random.shuffle(items)
    return gives(args[1], tuple(items), trail)


@internal(".range", 3, 4, many=True, binds=True)
def range_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.range(I, 1, 10)`` or ``.range(I, 0, 10, 5)``: I iterates over integers up to and including the end."""
    number, *limits = args
    first, last, step = [*(integer_of(".range", limit) for limit in limits), 1][:3]
    found = resolve(number)
    if found.__class__ is not Var:
        return each((), [()] if first <= integer_of(".range", found) <= last else [], trail)
    if step == 0:
        raise wrong(".range", 0, "a step other than 0")
    return each(number, range(first, last + (1 if step > 0 else -1), step), trail)


@internal(".random", 1, 3, many=True)
def random(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.random(X)``: X is a number from 0 to 1; ``.random(X, N)``: N numbers in turn (0: unlimited).

    ``.random(L, X, N)``: X is one of N random items of L, by default of one. All use the seed of the agent.
    """
    items, *rest = map(resolve, args)
    if items.__class__ is tuple:
        if not items or not rest:
            return
        result, *count = rest
    else:
        result, count = items, rest
        if result.__class__ is not Var:
            raise wrong(".random", result, "a variable or a list")
    times = integer_of(".random", count[0]) if count else 1
    for _ in itertools.count() if times == 0 else range(times):
        value = engine.random.choice(items) if items.__class__ is tuple else engine.random.random()
        yield from each(result, [value], trail)


# Kinds and annotations of terms


@internal(".type", 2, many=True)
def type_(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.type(T, Type)``: Type is in turn each type of the term T."""
    return each(args[1], map(Atom, _types(resolve(args[0]))), trail)


def _types(term: Any) -> Iterator[str]:
    if is_number(term):
        yield "number"
    elif isinstance(term, str):
        yield "string"
    elif isinstance(term, Collection):
        yield term.kind
    elif term.__class__ is Var:
        yield "free"
        return
    elif term.__class__ is Atom:
        yield from ("atom", "literal")
    elif term.__class__ in (tuple, Cons):
        yield from ("list", "structure")
    elif isinstance(term, Inference):
        yield "rule"
    elif isinstance(term, (Literal, Event, Plan)):
        yield from ("literal", "structure")
    if closed(term):
        yield "ground"


def _literals(name: str, term: Any, change: Callable[[Literal], Any]) -> Any:
    """Change a literal, or each literal of a list; other terms stay."""
    term = resolve(term)
    if term.__class__ is tuple:
        return tuple(_literals(name, item, change) for item in term)
    if term.__class__ is Atom:
        term = literal(term.name)
    if not isinstance(term, Literal):
        return term
    found = change(term)
    return Atom(found.functor) if not (found.args or found.annotations or found.negated) else found


@internal(".add_annot", 3)
def add_annot(engine: Any, args: Args, trail: Trail) -> bool:
    """``.add_annot(b, A, R)``: R is the literal b, or each literal of a list, with the annotation A."""
    note = resolve(args[1])

    def add(found: Literal) -> Literal:
        return found if note in found.annotations else found.with_(annotations=(*found.annotations, note))

    return gives(_literals(".add_annot", args[0], add), args[2], trail)


@internal(".add_nested_source", 3)
def add_nested_source(engine: Any, args: Args, trail: Trail) -> bool:
    """``.add_nested_source(b, S, R)``: R is b with source(S), which has the sources of b as annotations."""

    def nest(found: Literal) -> Literal:
        sources = tuple(filter(is_source, found.annotations))
        others = tuple(note for note in found.annotations if not is_source(note))
        outer = source(resolve(args[1]))
        return found.with_(annotations=(*others, outer.with_(annotations=sources) if sources else outer))

    return gives(_literals(".add_nested_source", args[0], nest), args[2], trail)


@internal(".remove_source_annot", 2)
def remove_source_annot(engine: Any, args: Args, trail: Trail) -> bool:
    """``.remove_source_annot(b, R)``: R is b without its sources."""

    def strip(found: Literal) -> Literal:
        return found.with_(annotations=tuple(note for note in found.annotations if not is_source(note)))

    return gives(_literals(".remove_source_annot", args[0], strip), args[1], trail)


@internal(".copy_term", 2)
def copy_term(engine: Any, args: Args, trail: Trail) -> bool:
    """``.copy_term(T, C)``: C is T with other variables."""
    return gives(args[1], detached(args[0]), trail)


internal(".rename_apart", 2)(copy_term)
