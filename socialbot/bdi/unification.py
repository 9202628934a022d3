"""Run-time unification of terms with unbound variables."""

from __future__ import annotations

from collections.abc import Iterable
from operator import is_
from typing import Any

from socialbot.bdi.literals import Event, Literal, literal
from socialbot.bdi.terms import Atom, Cons, LiteralVariable, Rest, Term, by_order, order

Trail = list["Var"]
"""Variables bound since a choice point, for backtracking."""


class Var:
    """Run-time variable; while it is unbound, ``value`` is the variable itself."""

    __slots__ = ("name", "value")

    def __init__(self, name: str = "_") -> None:
        self.name = name
        self.value: Any = self

    def __str__(self) -> str:
        return self.name if self.value is self else str(self.value)

    __repr__ = __str__


SIMPLE = frozenset({int, str, float, bool, Atom})
"""Classes of values without parts."""


def resolve(term: Any) -> Any:
    """Substitute the values of the variables in a term."""
    kind = term.__class__
    while kind is Var:
        if term.value is term:
            return term
        term = term.value
        kind = term.__class__
    if kind in SIMPLE:
        return term
    if kind is tuple:
        for item in term:
            if item.__class__ not in SIMPLE and (item.__class__ in _COMPOUND or isinstance(item, Literal)):
                found = tuple(map(resolve, term))
                return term if all(map(is_, found, term)) else found
        return term
    if kind is Cons:
        return cons(tuple(map(resolve, term.items)), resolve(term.tail))
    if isinstance(term, Literal):
        args, annotations = resolve(term.args), resolve(term.annotations)
        if args is not term.args or annotations is not term.annotations:
            return term.with_(args=args, annotations=annotations)
    if isinstance(term, LiteralVariable):
        variable, notes, namespace = resolve(term.variable), resolve(term.annotations), resolve(term.namespace)
        return LiteralVariable(variable, notes, term.negated, namespace)
    if isinstance(term, Rest):
        return Rest(resolve(term.tail))
    return term


def closed(term: Any) -> bool:
    """Whether the term has no unbound variables."""
    kind = term.__class__
    if kind in SIMPLE:
        return True
    if kind is Var:
        return term.value is not term and closed(term.value)
    if kind is tuple:
        for item in term:  # noqa: SIM110 - a generator would be slower
            if item.__class__ not in SIMPLE and not closed(item):
                return False
        return True
    if kind is Cons or kind is LiteralVariable or kind is Rest:
        return False
    if isinstance(term, Literal):
        return closed(term.args) and closed(term.annotations)
    return "match" not in getattr(term, "__dict__", ())  # not a plan, steps or a condition with cells


def has_unbound(term: Any) -> bool:
    """Whether the term has an unbound variable; unlike in `closed`, patterns whose variables are bound have none."""
    kind = term.__class__
    if kind is Var:
        return term.value is term or has_unbound(term.value)
    if kind is tuple:
        return any(map(has_unbound, term))
    if kind is Cons:
        return has_unbound(term.items) or has_unbound(term.tail)
    if kind is Rest:
        return has_unbound(term.tail)
    if kind is LiteralVariable:
        return any(map(has_unbound, (term.variable, term.annotations, term.namespace)))
    return isinstance(term, Literal) and (has_unbound(term.args) or has_unbound(term.annotations))


def cons(items: tuple[Any, ...], tail: Any) -> Any:
    """Join ``items`` and ``tail`` to a list, a tuple if the tail is known. Raises TypeError for other tails."""
    if tail.__class__ is tuple:
        return items + tail
    if tail.__class__ is Cons:
        return Cons(items + tail.items, tail.tail)
    if tail.__class__ is not Var:
        raise TypeError(f"{tail} is not a list")
    return Cons(items, tail)


def unify(left: Any, right: Any, trail: Trail) -> bool:
    """Unify two terms; bindings are added to ``trail`` and remain after a failure."""
    while left.__class__ is Var and left.value is not left:
        left = left.value
    while right.__class__ is Var and right.value is not right:
        right = right.value
    if left is right:
        return True
    if left.__class__ is Var:
        left.value = right
        trail.append(left)
        return True
    if right.__class__ is Var:
        right.value = left
        trail.append(right)
        return True
    if left.__class__ is tuple and right.__class__ is tuple:
        return len(left) == len(right) and all(unify(a, b, trail) for a, b in zip(left, right))  # noqa: B905
    if left.__class__ is Cons or right.__class__ is Cons:
        return _unify_lists(left, right, trail)
    if isinstance(left, Literal) and isinstance(right, Literal):
        return (
            left.functor == right.functor
            and left.negated == right.negated
            and unify(left.args, right.args, trail)
            and annotations_match(left.annotations, right.annotations, trail)
        )
    if left.__class__ is LiteralVariable or right.__class__ is LiteralVariable:
        return _unify_literal_variable(left, right, trail)
    for one, two in ((left, right), (right, left)):
        match = getattr(one, "match", None)
        if match is not None:  # a plan or body with variables for parts
            return bool(match(one, two, trail))
    for one, two in ((left, right), (right, left)):
        structure = getattr(two, "as_structure", None)  # of a plan, or of steps
        if structure is not None and isinstance(one, Literal):
            return unify(one, structure(), trail)
    if isinstance(left, Event) and isinstance(right, Event):
        return left.change is right.change and unify(left.literal, right.literal, trail)
    return left == right or _same_text(left, right)


def _same_text(left: Any, right: Any) -> bool:
    """Whether two plans, bodies, rules or conditions have the same text."""
    if left.__class__ is not right.__class__ or left.__class__ in SIMPLE:
        return False
    same_text = getattr(left, "same_text", None)
    return same_text is not None and same_text(right)


def _unify_literal_variable(left: Any, right: Any, trail: Trail) -> bool:
    """Unify ``X[a]`` or ``~X`` with a literal; X becomes the literal without these annotations or its negation."""
    if left.__class__ is not LiteralVariable:
        left, right = right, left
    if right.__class__ is LiteralVariable:
        return left.negated == right.negated and unify(left.variable, right.variable, trail)
    negated = isinstance(right, Literal) and right.negated
    if not isinstance(right, (Literal, Atom)) or (left.negated and not negated):
        return False
    if not annotations_match(left.annotations, () if isinstance(right, Atom) else right.annotations, trail):
        return False
    bare: Any = right
    if left.namespace is not None:
        prefix, _, name = (right.functor if isinstance(right, Literal) else right.name).rpartition("::")
        if not unify(left.namespace, Atom(prefix or "default"), trail):
            return False
        right = literal(name, *(() if isinstance(right, Atom) else (right.args, right.annotations)), negated=negated)
    if isinstance(right, Literal):
        bare = right if isinstance(left.variable, Literal) else right.with_(annotations=())
        if left.negated:
            bare.negated = False
            bare.__dict__.pop("key", None)
        if not bare.args and not bare.negated and not isinstance(left.variable, Literal):
            bare = Atom(bare.functor)
    return unify(left.variable, bare, trail)


def _unify_lists(left: Any, right: Any, trail: Trail) -> bool:
    if left.__class__ is not Cons:
        left, right = right, left
    items = right.items if right.__class__ is Cons else right
    if items.__class__ is not tuple or (items is right and len(items) < len(left.items)):
        return False
    common = min(len(left.items), len(items))
    if not all(unify(a, b, trail) for a, b in zip(left.items, items)):  # noqa: B905
        return False
    rest_left = cons(left.items[common:], left.tail) if common < len(left.items) else resolve(left.tail)
    if right.__class__ is Cons:
        rest_right = cons(items[common:], right.tail) if common < len(items) else resolve(right.tail)
    else:
        rest_right = items[common:]
    return unify(rest_left, rest_right, trail)


def annotations_match(pattern: Iterable[Any], held: tuple[Any, ...], trail: Trail) -> bool:
    """Whether each annotation of the pattern matches a held one; binds variables to the first match."""
    matched: list[Any] = []
    for note in pattern:
        if note.__class__ is Rest:
            others = (other for other in held if all(other is not one for one in matched))
            return unify(note.tail, tuple(sorted(others, key=order)), trail)
        for candidate in held if closed(note) else by_order(held):
            mark = len(trail)
            if unify(note, candidate, trail):
                matched.append(candidate)
                break
            undo(trail, mark)
        else:
            return False
    return True


def same(left: Any, right: Any) -> bool:
    """Whether two terms are equal; an unbound variable is equal to itself only."""
    left, right = resolve(left), resolve(right)
    if left.__class__ is tuple and right.__class__ is tuple:
        return len(left) == len(right) and all(map(same, left, right))
    if left.__class__ is Cons and right.__class__ is Cons:
        return same(left.items, right.items) and same(left.tail, right.tail)
    if isinstance(left, Literal) and isinstance(right, Literal):
        parts = ((item.functor, item.negated, item.args, item.annotations) for item in (left, right))
        return all(map(same, *parts))
    if isinstance(left, Term) or isinstance(right, Term):
        return left is right
    return left == right or _same_text(left, right)


def undo(trail: Trail, mark: int) -> None:
    """Undo the bindings since ``mark``."""
    while len(trail) > mark:
        var = trail.pop()
        var.value = var


def free(term: Any) -> None:
    """Undo all bindings in a term of initially unbound variables."""
    if term.__class__ is Var:
        term.value = term
    elif term.__class__ is tuple:
        for item in term:
            free(item)
    elif term.__class__ is Cons:
        free((*term.items, term.tail))
    elif isinstance(term, Literal):
        free((term.args, term.annotations))


_COMPOUND = frozenset({Var, tuple, Cons, LiteralVariable, Rest})
