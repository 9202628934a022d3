"""Compile queries of stored beliefs to lookups in indexes of their known parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from socialbot.bdi._relations import form_of
from socialbot.bdi.compiler._dynamic import is_embedded, variables_of
from socialbot.bdi.compiler._source import CELL, Function, tuple_of
from socialbot.bdi.compiler._terms import has_cell, match, match_literal, settled, value
from socialbot.bdi.literals import Literal, Symbolic
from socialbot.bdi.terms import Cons, LiteralVariable, Rest, Variable

Path = tuple[Any, ...]


class Lookup:
    """Lookup of the stored beliefs that agree with the known parts of a pattern, in generated code.

    A literal with known variables is not built: its arguments are part of the key of an index.

    Attributes:
        relation: Local with the relation.
        exact: The pattern matches each belief that the lookup finds.
        complete: There are no unknown parts, so that nothing is bound.
    """

    def __init__(self, f: Function, pattern: Literal) -> None:
        self._f = f
        self._args = pattern.args
        self._known: dict[Path, object] = {}
        self._names: set[str] = set()
        self._nested = False
        self.relation = f.relation(pattern.key)
        self.complete = self.exact = True
        self._collect(pattern.args, ())
        if self.complete and not self._nested:
            self._key, self._table = value(f, pattern.args), f"{self.relation}.facts"
        elif self._known:
            keys = [value(f, part) for part in self._known.values()]
            self._key = keys[0] if len(keys) == 1 else tuple_of(keys)
            paths = tuple(path[0] if len(path) == 1 else path for path in self._known)
            self._table = f"{self.relation}.index({f.unit.constant(paths)})"
        else:
            self._key, self._table = "", f"{self.relation}.facts"

    def test(self, *, negated: bool = False) -> str:
        """Return the test whether any belief is found."""
        if not self._key:
            return f"not {self._table}" if negated else self._table
        return f"{self._key} {'not in' if negated else 'in'} {self._table}"

    def newest_first(self) -> str:
        """Return the iterable of the beliefs that are found."""
        if not self._key:
            return f"reversed({self._table})"
        if self.complete and not self._nested:
            return f"({self._key},) if {self.test()} else ()"
        return f"reversed({self._table}.get({self._key}, ()))"

    def count(self) -> str:
        """Return the number of beliefs that are found."""
        if not self._key:
            return f"len({self._table})"
        if self.complete and not self._nested:
            return f"({self.test()}) * 1"
        return f"len({self._table}.get({self._key}, ()))"

    def position(self, variable: str) -> int | None:
        """Return the position of a new variable among the arguments."""
        for position, term in enumerate(self._args):
            if isinstance(term, Variable) and term.name == variable and (position,) not in self._known:
                return position
        return None

    def match_rest(self, found: str) -> None:
        """Emit the match of the unknown parts with a belief; it continues the loop over the beliefs if they differ."""
        self._match(self._args, found, ())

    def _collect(self, terms: Iterable[object], path: Path) -> None:
        """Find the known parts of terms."""
        for position, term in enumerate(terms):
            here, parts = (*path, position), _parts_of(term)
            known = settled(self._f, term)
            if known and not (parts and isinstance(term, Literal)):
                self._known[here] = term
                continue
            number = len(self._known)
            if parts:
                self._collect(parts, (*here, form_of(term)))  # type: ignore[arg-type]
            if len(self._known) > number:
                self._nested = True
                if isinstance(term, Cons):
                    self._leave_open(term.tail)
            else:
                self._leave_open(term)

    def _leave_open(self, term: object) -> None:
        self.complete = False
        if isinstance(term, Variable) and term.name not in self._names and term.name not in self._f.scope:
            self._names |= {term.name} - {"_"}
        else:
            self.exact = False

    def _match(self, terms: Iterable[object], subject: str, path: Path) -> None:
        for position, term in enumerate(terms):
            here = (*path, position)
            if here in self._known:
                continue
            if not any(known[: len(here)] == here for known in self._known):
                match(self._f, term, f"{subject}[{position}]", "continue")
                continue
            # The index has only terms of this form.
            parts = _parts_of(term)
            item = f"{subject}[{position}]{'.args' if isinstance(term, Literal) else ''}"
            self._match(parts, item, (*here, form_of(term)))  # type: ignore[arg-type]
            if isinstance(term, Cons):
                match(self._f, term.tail, f"{item}[{len(parts)}:]", "continue")


def needs_unification(pattern: Literal) -> bool:
    """Check for parts that generated code does not match: literals of variables, and annotations of other parts."""
    parts = (*pattern.args, *pattern.annotations)
    return any(isinstance(note, Rest) for note in pattern.annotations) or any(map(_is_special, parts))


def _is_special(term: object) -> bool:
    if isinstance(term, Literal):
        return bool(term.annotations) or any(map(_is_special, term.args))
    return isinstance(term, LiteralVariable) or (is_embedded(term) and bool(variables_of(term)))


def _parts_of(term: object) -> tuple[object, ...]:
    """Arguments or items of a term; empty for other terms, and for literals with annotations."""
    if isinstance(term, Literal):
        return () if term.annotations else term.args
    if isinstance(term, Cons):
        return term.items
    return term if isinstance(term, tuple) else ()


@contextmanager
def loop(f: Function, items: str, *, binds: bool = True) -> Iterator[str]:
    """Emit ``for x in items:`` around the block.

    Each iteration undoes the bindings of the previous one; generators with own bindings undo these themselves.
    """
    found = f.unit.name("f")
    mark = f.unit.name("m") if not binds and CELL in f.scope.values() else None
    if mark:
        f.line(f"{mark} = len(trail)")
    with f.block(f"for {found} in {items}"):
        f.loops += 1
        if mark:
            f.line(f"undo(trail, {mark})")
        yield found


def stored(f: Function, pattern: Literal, rest: Callable[[], None]) -> None:
    """Emit ``rest`` for each stored belief that matches a pattern without cells."""
    lookup = Lookup(f, pattern)
    if lookup.complete and not pattern.annotations:
        with f.block(f"if {lookup.test()}"):
            rest()
        return
    with loop(f, lookup.newest_first(), binds=False) as found:
        lookup.match_rest(found)
        _annotated(f, pattern.annotations, f"{lookup.relation}.facts[{found}][1]", rest)


def match_annotations(f: Function, patterns: tuple[object, ...], fail: str) -> None:
    """Emit the match of each pattern with the first annotation of an event that fits; else it executes ``fail``."""
    for pattern in patterns:
        found = f.unit.name("n")
        name = _any_source(f, pattern)
        if name is not None:
            with f.block(f"if len(notes) != 1 or ({found} := notes[0]).__class__ is not KnownSource"):
                f.line(f"{found} = first_source(notes)")
                f.line(f"if {found} is None: {fail}")
            part = f"{found}.args[0]"
            match(f, name, f"plain({part})" if isinstance(pattern, Symbolic) else part, fail)
            continue
        with f.block(f"for {found} in {_in_order(f, pattern, 'notes')}"):
            _match_annotation(f, pattern, found)
            f.line("break")
        f.line(f"else: {fail}")


def _any_source(f: Function, pattern: object) -> Variable | None:
    """Return the variable of ``source(S)`` if it is new, so that the first source matches."""
    if not isinstance(pattern, Literal) or pattern.key != "source/1" or pattern.annotations:
        return None
    name = pattern.args[0]
    return name if isinstance(name, Variable) and name.name not in f.scope else None


def _in_order(f: Function, pattern: object, held: str) -> str:
    """Return the expression of the annotations in the order in which a pattern is matched with them."""
    return held if settled(f, pattern) else f"({held} if len({held}) == 1 else by_order({held}))"


def _match_annotation(f: Function, pattern: object, found: str) -> None:
    if isinstance(pattern, Literal) and not pattern.annotations and not has_cell(f, pattern):
        match_literal(f, pattern, found, "continue")
    else:
        match(f, pattern, found, "continue")


def _annotated(f: Function, patterns: tuple[object, ...], held: str, rest: Callable[[], None]) -> None:
    """Emit loops over the annotations of a belief that match the patterns."""
    if not patterns:
        rest()
        return
    if not held.isidentifier():
        known = f.unit.name("n")
        f.line(f"{known} = {held}")
        held = known
    if settled(f, patterns[0]):
        items = f"{held} if {held}.__class__ is tuple else {held}.candidates({value(f, patterns[0])})"
    else:
        items = _in_order(f, patterns[0], held)
    with loop(f, items, binds=False) as found:
        _match_annotation(f, patterns[0], found)
        _annotated(f, patterns[1:], held, rest)
