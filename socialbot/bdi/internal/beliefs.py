"""Internal actions on beliefs, and `.enter`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from socialbot.bdi.beliefs import Relation, is_source
from socialbot.bdi.failures import Failed
from socialbot.bdi.internal.arguments import literal_of, name_of
from socialbot.bdi.internals import internal
from socialbot.bdi.literals import SELF
from socialbot.bdi.unification import Trail, closed

Args = tuple[Any, ...]


@internal(".abolish", 1)
def abolish(engine: Any, args: Args, trail: Trail) -> None:
    """``.abolish(b(_))``: removes every belief that matches, whoever said it."""
    what = literal_of(".abolish", args[0])
    engine.forget_all(engine.relations[what.key], what.args, what.annotations, engine.cause)


@internal(".belief", 1, many=True)
def belief(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.belief(b(X))``: it is held, and does not only follow from others."""
    what = literal_of(".belief", args[0])
    for _ in engine.relations[what.key].match(what.args, what.annotations, trail):
        yield


@internal(".asserta", 1)
def asserta(engine: Any, args: Args, trail: Trail) -> None:
    """``.asserta(b(1))``: believes it; questions find it first. The event is handled in an intention of its own."""
    _assert(engine, args[0], ".asserta")


@internal(".assertz", 1)
def assertz(engine: Any, args: Args, trail: Trail) -> None:
    """``.assertz(b(1))``: believes it; questions find it last. The event is handled in an intention of its own."""
    relation, added = _assert(engine, args[0], ".assertz")
    if added is not None:
        _put_last(relation, added)


def _assert(engine: Any, term: Any, name: str) -> tuple[Relation, Args | None]:
    """Holds a belief; returns its arguments if it was not held before."""
    what = literal_of(name, term)
    if not closed(what):
        raise Failed("no_value", f"{name}: {what} has a variable without a value")
    relation = engine.relations[what.key]
    new = what.args not in relation.facts
    notes = what.annotations if any(map(is_source, what.annotations)) else what.annotations + SELF
    engine.add(relation, what.args, notes, engine.cause)
    return relation, what.args if new and what.args in relation.facts else None


def _put_last(relation: Relation, args: Args) -> None:
    """Puts a belief where the oldest one is. Takes as long as there are beliefs of the name."""
    facts = dict(relation.facts)
    relation.facts.clear()
    relation.facts[args] = facts.pop(args)
    relation.facts.update(facts)
    for index in relation.indexes.values():
        for bucket in index.values():
            if args in bucket:
                others = [other for other in bucket if other != args]
                bucket.clear()
                bucket.update(dict.fromkeys((args, *others)))


@internal(".enter", 1)
def enter(engine: Any, args: Args, trail: Trail) -> None:
    """``.enter(night)``: enters a stage: plans of other stages are no longer chosen."""
    engine.enter(name_of(".enter", args[0]), cause=engine.cause)
