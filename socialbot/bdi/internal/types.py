"""Internal actions that tell what kind of thing a term is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialbot.bdi.internal.arguments import is_number
from socialbot.bdi.internals import internal
from socialbot.bdi.literals import Literal
from socialbot.bdi.terms import Atom, Cons
from socialbot.bdi.unification import Trail, Var, closed, resolve

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
"""By name."""


def _register(name: str, test: Callable[[Any], bool]) -> None:
    @internal(name, 1)
    def tell(engine: Any, args: tuple[Any, ...], trail: Trail) -> bool:
        return test(resolve(args[0]))


for _name, _test in TESTS.items():
    _register(_name, _test)
