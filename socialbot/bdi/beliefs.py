"""The belief base: what the agent holds true, who says so, and since when."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from socialbot.bdi.literals import Belief, Literal, literal
from socialbot.bdi.unification import Trail, closed, resolve, undo, unify

if TYPE_CHECKING:
    from socialbot.bdi.library import Trigger

Args = tuple[Any, ...]

Fact = tuple[int, tuple[Any, ...], Any]
"""What is known of a belief: since when (ns), its annotations (sources and others), and the record of its beginning."""


Watcher = Callable[[Args, bool, Any], object]
"""Is told of a belief's arguments, whether it is held now, and the record of the change."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A belief that is held: the id of the trace record of its beginning serves as its cause."""

    belief: Literal
    sources: tuple[str, ...]
    since: int
    record: str

    @property
    def source(self) -> str:
        """Who says so; several names are separated by commas."""
        return ",".join(self.sources)


_NONE: dict[Any, Any] = {}
"""Shared by the relations without indexes, or without timers: an agent shall be small. Nothing is ever put into it."""


class Relation:
    """The beliefs of one name and number of arguments, indexed on the positions that plans ask by."""

    __slots__ = (
        "added", "base", "care", "facts", "held", "indexes", "key", "kind", "lives", "quiet", "removed", "special",
        "watchers",
    )  # fmt: skip

    def __init__(self, key: str, base: Relations) -> None:
        self.key = key
        self.base = base
        self.facts: dict[Args, Fact] = {}
        self.indexes: dict[tuple[int, ...], dict[Any, dict[Args, None]]] = _NONE
        self.lives: dict[Args, Fact] = _NONE
        self.added: Trigger | None = None
        self.removed: Trigger | None = None
        self.held: Trigger | None = None
        self.kind: type[Belief] | None = None
        self.special = False
        self.care = False
        self.quiet = True
        self.watchers: tuple[Watcher, ...] = ()

    def index(self, positions: tuple[int, ...]) -> dict[Any, dict[Args, None]]:
        """The beliefs by the arguments at ``positions``: by a value when there is one position, else by a tuple."""
        index = self.indexes.get(positions)
        if index is None:
            if self.indexes is _NONE:
                self.indexes = {}
            index = self.indexes[positions] = {}
            self.quiet = False
            for args in self.facts:
                index.setdefault(_at(args, positions), {})[args] = None
        return index

    def live(self, args: Args, fact: Fact) -> None:
        """Notes what a belief was when this time of being held began."""
        if self.lives is _NONE:
            self.lives = {}
        self.lives[args] = fact

    def enter(self, args: Args) -> None:
        """Enters a belief into the indexes."""
        for positions, index in self.indexes.items():
            index.setdefault(_at(args, positions), {})[args] = None

    def leave(self, args: Args) -> None:
        """Takes a belief out of the indexes."""
        for positions, index in self.indexes.items():
            key = _at(args, positions)
            bucket = index[key]
            del bucket[args]
            if not bucket:
                del index[key]

    def candidates(self, args: Args) -> list[Args]:
        """The beliefs, newest first, that agree with ``args`` where these are known; as they are at this moment."""
        known = tuple(i for i, arg in enumerate(args) if closed(arg))
        if not known:
            return list(reversed(self.facts))
        if len(known) == len(args):
            return [args] if args in self.facts else []
        return list(reversed(self.index(known).get(_at(args, known), {})))

    def match(self, args: Args, annotations: tuple[Any, ...], trail: Trail) -> Iterator[Args]:
        """The beliefs that unify with ``args`` and ``annotations``, newest first; bindings hold until the next one."""
        mark = len(trail)
        for found in self.candidates(resolve(args)):
            if found in self.facts and unify(args, found, trail):
                if not annotations:
                    yield found
                else:
                    for _ in choices(annotations, self.facts[found][1], trail):
                        yield found
            undo(trail, mark)

    def literal(self, args: Args, annotations: tuple[Any, ...] = ()) -> Literal:
        """The belief of this name with these arguments."""
        if self.kind is not None:
            made = self.kind(*args)
            return made.with_(annotations=annotations) if annotations else made
        return literal_of(self.key, args, annotations)


class Relations:
    """The relations of an agent by key, such as ``at/2``; one that is asked for is made. ``made`` are those so far."""

    __slots__ = ("_equip", "known", "made")

    def __init__(self, equip: Any) -> None:
        self.made: dict[str, Relation] = {}
        self._equip = equip
        self.known: dict[tuple[type[Literal], int], Relation] = _NONE

    def know(self, kind: type[Literal], arity: int, relation: Relation) -> None:
        """Notes where beliefs of a class belong."""
        if self.known is _NONE:
            self.known = {}
        self.known[kind, arity] = relation

    def __getitem__(self, key: str) -> Relation:
        relation = self.made.get(key)
        if relation is None:
            relation = Relation(key, self)
            self._equip(relation)
            relation = self.made.setdefault(key, relation)
        return relation


class BeliefBase:
    """A view of the beliefs of one agent, for reading."""

    __slots__ = ("_relations",)

    def __init__(self, relations: Relations) -> None:
        self._relations = relations

    def __iter__(self) -> Iterator[Held]:
        for relation in list(self._relations.made.values()):
            for args in list(relation.facts):
                yield self._held(relation, args)

    def __len__(self) -> int:
        return sum(len(relation.facts) for relation in self._relations.made.values())

    def __contains__(self, belief: Literal) -> bool:
        return self.get(belief) is not None

    def get(self, belief: Literal) -> Held | None:
        """What is held of exactly this belief, whatever its annotations."""
        relation = self._relations.made.get(belief.key)
        return self._held(relation, belief.args) if relation and belief.args in relation.facts else None

    def _held(self, relation: Relation, args: Args) -> Held:
        since, annotations, cause = relation.facts[args]
        sources = tuple(str(note.args[0]) for note in annotations if is_source(note))
        others = tuple(note for note in annotations if not is_source(note))
        return Held(relation.literal(args, others), sources, since, str(cause))


def choices(pattern: tuple[Any, ...], held: tuple[Any, ...], trail: Trail) -> Iterator[None]:
    """All ways in which each annotation of the pattern is among those held."""
    if not pattern:
        yield None
        return
    mark = len(trail)
    for candidate in held:
        if unify(pattern[0], candidate, trail):
            yield from choices(pattern[1:], held, trail)
        undo(trail, mark)


def is_source(note: object) -> bool:
    """Whether an annotation tells a source."""
    return isinstance(note, Literal) and note.functor == "source" and len(note.args) == 1


def literal_of(key: str, args: Args, annotations: tuple[Any, ...] = ()) -> Literal:
    """The literal without a class that a key such as ``~at/2`` speaks of."""
    name = key.rpartition("/")[0]
    negated = name.startswith("~")
    return literal(name[1:] if negated else name, args, annotations, negated=negated)


def _at(args: Args, positions: tuple[int, ...]) -> Any:
    return args[positions[0]] if len(positions) == 1 else tuple(args[i] for i in positions)
