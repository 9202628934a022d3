"""Annotations of held beliefs: sources, and sets of many annotations."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from operator import attrgetter
from typing import Any

from socialbot.bdi.literals import ATOMIC, Literal, is_source
from socialbot.bdi.terms import Atom, order
from socialbot.bdi.unification import resolve

Annotations = tuple[Any, ...]

MANY_ANNOTATIONS = 8
"""Number of annotations from which a belief has a `AnnotationSet` of them."""

_NONE: dict[Any, Any] = {}
"""Shared empty dictionary of sets without other annotations; it saves memory."""

_name = attrgetter("name")


def is_source_of(note: Any, taken: Annotations) -> bool:
    """Whether an annotation is one of these sources with sources of its own, as ``source(a)[source(b)]``."""
    if note.__class__ in ATOMIC or not is_source(note) or not note.annotations:
        return False
    return any(is_source(other) and not other.annotations and other.args == note.args for other in taken)


def mark_of(note: Any) -> Any:
    """Key of an annotation among others: the atom of a source, whose hash costs less, or a tuple of the annotation."""
    if isinstance(note, Literal) and note.key == "source/1" and not note.annotations:
        name = note.args[0]
        if name.__class__ is Atom:
            return name
    return (note,)


class AnnotationSet:
    """Annotations of a belief that has many of them, in order.

    To add, find or remove a source takes the same time for any number of sources.

    Attributes:
        marks: The annotations by their marks.
        others: Those whose mark is a tuple, by their marks.
    """

    __slots__ = ("marks", "others")

    def __init__(self, notes: Annotations) -> None:
        self.marks: dict[Any, Any] = {}
        self.others: dict[Any, Any] = _NONE
        self.add(notes)

    def add(self, notes: Annotations) -> Annotations:
        """Add annotations; return the new ones. Raises TypeError for a value that cannot be hashed."""
        new: list[Any] = []
        for note in notes:
            mark = mark_of(note)
            if mark not in self.marks:
                self.marks[mark] = note
                new.append(note)
                if mark.__class__ is tuple:
                    if self.others is _NONE:
                        self.others = {}
                    self.others[mark] = note
        return notes if len(new) == len(notes) else tuple(new)

    def remove(self, notes: Annotations) -> bool:
        """Remove annotations, and these sources with sources of their own; return whether a source is left."""
        marks, others = self.marks, self.others
        for mark in map(mark_of, notes):
            marks.pop(mark, None)
            others.pop(mark, None)
        for mark in [mark for mark, note in others.items() if is_source_of(note, notes)]:
            del marks[mark], others[mark]
        return len(marks) > len(others) or any(map(is_source, others.values()))

    def candidates(self, pattern: Any) -> Collection[Any]:
        """Annotations that a pattern without unbound variables may match."""
        mark = mark_of(resolve(pattern))
        if mark.__class__ is not tuple:
            found = self.marks.get(mark)
            return tuple(self.others.values()) if found is None else (found, *self.others.values())
        return tuple((self.marks if is_source(mark[0]) else self.others).values())

    def in_order(self) -> list[Any]:
        """Annotations in the order of terms."""
        if self.others:
            return sorted(self, key=order)
        return [self.marks[name] for name in sorted(self.marks, key=_name)]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.marks.values())

    def __len__(self) -> int:
        return len(self.marks)
