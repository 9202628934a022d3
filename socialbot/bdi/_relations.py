"""Relations: the beliefs of one name and arity, their annotations, and indexes by the parts of their arguments."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Collection, Iterator
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, Protocol

from socialbot.bdi.literals import ATOMIC, Belief, KnownSource, Literal, is_source, literal_from_key
from socialbot.bdi.terms import Atom, Cons, Rest, by_order, order
from socialbot.bdi.unification import Trail, closed, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi._hold_timers import HoldTimer
    from socialbot.bdi.belief_base import BeliefBase
    from socialbot.bdi.library import CompiledPlan, Trigger

Args = tuple[Any, ...]
Annotations = tuple[Any, ...]

Fact = tuple[int, Any, Any]
"""Held belief: its begin (ns), its annotations (a tuple or a `AnnotationSet`), and the trace record of its begin."""

Watcher = Callable[[Args, bool, Any], object]
"""Callback with the arguments of a belief, whether it is held now, and the record of the change."""

Path = int | tuple[Any, ...]
"""Place of a term in the arguments of a belief: a position, or a position, a form, a position in it, and so on.

The form of a literal is its key; of a list, ``[`` and its length; of a list pattern with a tail, ``[|`` and the number
of items before the tail.
"""

MOST_INDEXES = 16
"""Number of indexes of a relation beyond which queries with other known parts search all its beliefs."""

MANY_ANNOTATIONS = 8
"""Number of annotations from which a belief has a `AnnotationSet` of them."""

_NONE: dict[Any, Any] = {}
"""Shared empty dictionary of relations without indexes or timers, and of sets without others; it saves memory."""

_ABSENT = object()
"""Key of a belief that does not have the parts of an index."""


def form_of(term: Literal | tuple[Any, ...] | Cons) -> str | tuple[str, int]:
    """Form of a compound term in a `Path`."""
    if isinstance(term, Literal):
        return term.key
    return ("[", len(term)) if isinstance(term, tuple) else ("[|", len(term.items))


@functools.lru_cache(maxsize=10_000)
def _key_function(paths: tuple[Path, ...]) -> Callable[[Args], Any]:
    """Function from the arguments of a belief to its key in an index: one part, or a tuple of several."""
    if all(isinstance(path, int) for path in paths):
        return itemgetter(*paths)
    parts = [itemgetter(path) if isinstance(path, int) else _part_function(*path) for path in paths]
    if len(parts) == 1:
        return parts[0]

    def key(args: Args) -> Any:
        found = []
        for part in parts:
            term = part(args)
            if term is _ABSENT:
                return _ABSENT
            found.append(term)
        return tuple(found)

    return key


def _part_function(position: int, *path: Any) -> Callable[[Args], Any]:
    """Function from the arguments of a belief to the term at a path below a position."""
    steps = list(zip(path[::2], path[1::2], strict=True))

    def part(args: Args) -> Any:
        term: Any = args[position]
        for form, index in steps:
            if form.__class__ is str:
                if not isinstance(term, Literal) or term.key != form:
                    return _ABSENT
                term = term.args[index]
            else:
                kind, number = form
                if term.__class__ is not tuple or (len(term) != number if kind == "[" else len(term) < number):
                    return _ABSENT
                term = term[index]
        return term

    return part


class RelationObserver(Protocol):
    """Index or other object that follows the beliefs of a relation: begins, ends, and changes of annotations."""

    def enter(self, args: Args) -> None: ...
    def leave(self, args: Args) -> None: ...
    def touch(self, args: Args) -> None: ...
    def clear(self) -> None: ...


class Index:
    """Beliefs of a relation by the terms at some paths, oldest first; ``table`` has a bucket for each key."""

    __slots__ = ("_key", "table")

    def __init__(self, paths: tuple[Path, ...], facts: dict[Args, Fact]) -> None:
        self._key = _key_function(paths)
        self.table: dict[Any, dict[Args, None]] = {}
        for args in facts:
            self.enter(args)

    def enter(self, args: Args) -> None:
        key = self._key(args)
        if key is not _ABSENT:
            bucket = self.table.get(key)
            if bucket is None:
                self.table[key] = {args: None}
            else:
                bucket[args] = None

    def leave(self, args: Args) -> None:
        key = self._key(args)
        if key is not _ABSENT:
            bucket = self.table[key]
            del bucket[args]
            if not bucket:
                del self.table[key]

    def touch(self, args: Args) -> None:
        """Do nothing: the arguments are the same."""

    def clear(self) -> None:
        self.table.clear()

    def first(self, args: Args) -> None:
        """Make a belief the oldest of its bucket."""
        bucket = self.table.get(self._key(args), {})
        others = [other for other in bucket if other != args]
        if len(others) < len(bucket):
            bucket.clear()
            bucket.update(dict.fromkeys((args, *others)))


class Relation:
    """Beliefs of one name and arity, indexed by the parts of arguments that plans query.

    Attributes:
        indexes: Indexes by their paths, and other observers by other keys.
    """

    __slots__ = (
        "added", "base", "care", "facts", "held", "hold_timers", "indexes", "key", "kind", "quiet", "removed",
        "special", "watchers",
    )  # fmt: skip

    def __init__(self, key: str, base: BeliefBase) -> None:
        self.key = key
        self.base = base
        self.facts: dict[Args, Fact] = {}
        self.indexes: dict[Any, RelationObserver] = _NONE
        self.hold_timers: dict[CompiledPlan, HoldTimer] = _NONE  # the newest timer of each plan for "held for" events
        self.added: Trigger | None = None
        self.removed: Trigger | None = None
        self.held: Trigger | None = None
        self.kind: type[Belief] | None = None
        self.special = False
        self.care = False
        self.quiet = True
        self.watchers: tuple[Watcher, ...] = ()

    def index(self, paths: tuple[Path, ...]) -> dict[Any, dict[Args, None]]:
        """Table of an index; a key is the term at the path, or the tuple of those at several paths."""
        index = self.indexes.get(paths)
        if index is None:
            index = Index(paths, self.facts)
            self.observe(paths, index)
        return index.table  # type: ignore[attr-defined]

    def observe(self, name: Any, observer: RelationObserver) -> None:
        """Let an index or another observer follow the beliefs from now on."""
        if self.indexes is _NONE:
            self.indexes = {}
        self.indexes[name] = observer
        self.quiet = False

    def keep_timer(self, plan: CompiledPlan, timer: HoldTimer) -> None:
        """Let further beliefs use the timer of a plan."""
        if self.hold_timers is _NONE:
            self.hold_timers = {}
        self.hold_timers[plan] = timer

    def enter(self, args: Args) -> None:
        for index in self.indexes.values():
            index.enter(args)

    def leave(self, args: Args) -> None:
        for index in self.indexes.values():
            index.leave(args)

    def merge(self, args: Args, notes: Annotations) -> Annotations:
        """Add annotations to a held belief; return those that it did not have yet."""
        held = self.facts[args][1]
        if held is notes:
            return ()
        if held.__class__ is not AnnotationSet:
            notes = self._merge_few(args, notes)
        elif len(notes) == 1 and notes[0].__class__ is KnownSource:
            name = notes[0].args[0]
            if name in held.marks:
                return ()
            held.marks[name] = notes[0]
        else:
            notes = held.add(notes)
        if notes and self.indexes:
            self.touch(args)
        return notes

    def _merge_few(self, args: Args, notes: Annotations) -> Annotations:
        """Variant of `merge` for a belief without a `AnnotationSet`, which gets one with many annotations."""
        since, held, begin = self.facts[args]
        if len(notes) > 1:
            notes = tuple(note for note in notes if note not in held)
        elif notes and notes[0] in held:
            return ()
        if notes:
            held += notes
            if len(held) >= MANY_ANNOTATIONS:
                with contextlib.suppress(TypeError):  # Some values cannot be hashed.
                    held = AnnotationSet(held)
            self.facts[args] = (since, held, begin)
        return notes

    def touch(self, args: Args) -> None:
        for index in self.indexes.values():
            index.touch(args)

    def clear(self) -> None:
        self.facts.clear()
        self.hold_timers = _NONE
        for index in self.indexes.values():
            index.clear()

    def make_first(self, args: Args) -> None:
        """Make a belief the oldest, in time linear in the size of the relation."""
        facts = dict(self.facts)
        self.facts.clear()
        self.facts[args] = facts.pop(args)
        self.facts.update(facts)
        for index in self.indexes.values():
            if isinstance(index, Index):
                index.first(args)

    def candidates(self, args: Args) -> list[Args]:
        """Snapshot of the beliefs that agree with the known parts of ``args``, newest first."""
        if closed(args):
            return [args] if args in self.facts else []
        paths, parts = known_parts(args)
        if not paths or (paths not in self.indexes and len(self.indexes) >= MOST_INDEXES):
            return list(reversed(self.facts))
        return list(reversed(self.index(paths).get(parts[0] if len(parts) == 1 else parts, ())))

    def match(self, args: Args, annotations: Annotations, trail: Trail) -> Iterator[Args]:
        """Yield the beliefs that unify with ``args`` and ``annotations``, newest first; undo bindings in between."""
        mark = len(trail)
        for found in self.candidates(resolve(args)):
            if found in self.facts and unify(args, found, trail):
                if not annotations:
                    yield found
                else:
                    for _ in choices(annotations, self.facts[found][1], trail):
                        yield found
            undo(trail, mark)

    def literal(self, args: Args, annotations: Annotations = ()) -> Literal:
        if self.kind is not None:
            made = self.kind(*args)
            return made.with_(annotations=annotations) if annotations else made
        return literal_from_key(self.key, args, annotations)

    def text(self, args: Args) -> str:
        """Text of a belief in the trace."""
        return str(self.literal(args)) if closed(args) else str(literal_from_key(self.key, args))


def known_parts(args: Args, path: tuple[Any, ...] = ()) -> tuple[tuple[Path, ...], Args]:
    """Paths and values of the largest parts without unbound variables, for an index."""
    paths: list[Path] = []
    parts: list[Any] = []
    for position, term in enumerate(args):
        here = (*path, position)
        if closed(term):
            paths.append(here if path else position)
            parts.append(term)
        elif term.__class__ in (tuple, Cons) or (isinstance(term, Literal) and not term.annotations):
            items = term.args if isinstance(term, Literal) else term.items if term.__class__ is Cons else term
            below = known_parts(items, (*here, form_of(term)))
            paths += below[0]
            parts += below[1]
    return tuple(paths), tuple(parts)


def choices(pattern: Annotations, held: Any, trail: Trail, used: Annotations = ()) -> Iterator[None]:
    """Bind the annotations of the pattern to those held; yield once for each solution.

    Those held are a tuple or a `AnnotationSet`. ``used`` are the ones that earlier annotations matched.
    """
    if not pattern:
        yield None
        return
    mark = len(trail)
    if pattern[0].__class__ is Rest:
        others = by_order([note for note in held if note not in used])
        if unify(pattern[0].tail, tuple(others), trail):
            yield None
        undo(trail, mark)
        return
    known = closed(pattern[0])
    if known and held.__class__ is AnnotationSet:
        found = held.candidates(pattern[0])
    else:
        found = held if known else by_order(held)
    for candidate in found:
        if unify(pattern[0], candidate, trail):
            yield from choices(pattern[1:], held, trail, (*used, candidate))
        undo(trail, mark)


# Annotations of held beliefs

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
