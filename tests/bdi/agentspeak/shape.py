"""Representations as plain tuples, to compare them: most of their classes are equal only to themselves."""

from __future__ import annotations

from socialbot.bdi.literals import Literal
from socialbot.bdi.terms import Atom


def shape(item: object) -> object:
    """Return the content of an item without its position, its spelling and the classes of literals."""
    if isinstance(item, Literal):
        return "Literal", item.functor, item.negated, shape(item.args), shape(item.annotations)
    if isinstance(item, (tuple, list)):
        return tuple(map(shape, item))
    if isinstance(item, (str, int, float, Atom)) or item is None:
        return type(item).__name__, repr(item)
    if type(item).__module__.startswith("socialbot.bdi"):
        parts = {name: shape(part) for name, part in vars(item).items() if name not in ("origin", "text", "line")}
        return type(item).__name__, tuple(sorted(parts.items()))
    return item
