"""Internal actions on sets, maps and queues, which are mutable values."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from socialbot.bdi.intentions import Failed
from socialbot.bdi.stdlib.registry import Args, Collection, each, gives, internal, items_of, wrong
from socialbot.bdi.terms import Atom, order
from socialbot.bdi.unification import Trail, Var, closed, resolve

C = TypeVar("C", bound=Collection)


class SetTerm(Collection):
    """Set in the order of terms."""

    kind = "set"

    def __init__(self, items: Args = ()) -> None:
        self._items: dict[Any, None] = dict.fromkeys(items)

    def items(self) -> Args:
        return tuple(sorted(self._items, key=order))

    def add(self, item: Any) -> None:
        self._items[item] = None

    def discard(self, item: Any) -> None:
        self._items.pop(item, None)

    def clear(self) -> None:
        self._items.clear()

    def keep(self, wanted: Callable[[Any], bool]) -> None:
        self._items = {item: None for item in self._items if wanted(item)}

    def __str__(self) -> str:
        from socialbot.bdi.agentspeak._spelling import spelled

        return f"{{{','.join(map(spelled, self.items()))}}}"


class MapTerm(Collection):
    """Map in the order of its keys."""

    kind = "map"

    def __init__(self, items: Args = ()) -> None:
        self.values: dict[Any, Any] = dict(items)

    def items(self) -> Args:
        return tuple((key, self.values[key]) for key in sorted(self.values, key=order))

    def clear(self) -> None:
        self.values.clear()

    def __str__(self) -> str:
        from socialbot.bdi.agentspeak._spelling import spelled

        return f"{{{','.join(f'{spelled(key)}->{spelled(value)}' for key, value in self.items())}}}"


class QueueTerm(Collection):
    """Queue, first in first out; ``ranked`` gives the smallest term first."""

    kind = "queue"

    def __init__(self, items: Args = (), *, ranked: bool = False) -> None:
        self._items = list(items)
        self.ranked = ranked

    def items(self) -> Args:
        return tuple(self._items)

    def add(self, item: Any) -> None:
        if self.ranked:
            bisect.insort(self._items, item, key=order)
        else:
            self._items.append(item)

    def take(self) -> Any:
        return self._items.pop(0)

    def clear(self) -> None:
        self._items.clear()

    def copy(self) -> QueueTerm:
        return QueueTerm(self.items(), ranked=self.ranked)

    def __str__(self) -> str:
        from socialbot.bdi.agentspeak._spelling import spelled

        return f"[{','.join(map(spelled, self._items))}]"


def _of(kind: type[C], name: str, term: Any, trail: Trail) -> C:
    """Return the collection of an argument; a variable without a value gets a new set or map."""
    found = resolve(term)
    if found.__class__ is Var and kind is not QueueTerm:
        gives(found, made := kind(), trail)
        return made
    if not isinstance(found, kind):
        raise wrong(name, found, f"a {kind.kind}, made by .{kind.kind}.create")
    return found


def _value(name: str, term: Any) -> Any:
    found = resolve(term)
    if not closed(found):
        raise wrong(name, found, "a value") if found.__class__ is Var else Failed("no_value", f"{name}: {found}")
    return found


def _action(kind: type[C], word: str, most: int, act: Callable[[C, Args], Any]) -> None:
    name = f".{kind.kind}.{word}"

    @internal(name, most)
    def run(engine: Any, args: Args, trail: Trail) -> Any:
        return act(_of(kind, name, args[0], trail), (*args[1:], trail))

    run.__doc__ = f"``{name}({('Q' if kind is QueueTerm else 'M' if kind is MapTerm else 'S')}{', X' * (most - 1)})``"


def _register(kind: type[Any]) -> None:
    name = f".{kind.kind}.create"

    @internal(name, 1, 2 if kind is QueueTerm else 1)
    def create(engine: Any, args: Args, trail: Trail) -> bool:
        if resolve(args[0]).__class__ is not Var:
            return False
        ranked = args[1:] and resolve(args[1]) is Atom("priority")
        return gives(args[0], QueueTerm(ranked=True) if ranked else kind(), trail)

    create.__doc__ = f"``{name}({'Q, priority' if kind is QueueTerm else 'S' if kind is SetTerm else 'M'})``"

    _action(kind, "clear", 1, lambda found, args: found.clear())
    _action(kind, "copy", 2, lambda found, args: gives(args[0], found.copy(), args[-1]))


for _kind in (SetTerm, MapTerm, QueueTerm):
    _register(_kind)


def _add_all(found: Any, args: Args) -> None:
    for item in items_of(".add_all", args[0]):
        found.add(_value(".add_all", item))


for _kind in (SetTerm, QueueTerm):
    _action(_kind, "add", 2, lambda found, args: found.add(_value(".add", args[0])))
    _action(_kind, "add_all", 2, _add_all)
    _action(_kind, "to_list", 2, lambda found, args: gives(args[0], found.items(), args[-1]))

_action(SetTerm, "remove", 2, lambda found, args: found.discard(resolve(args[0])))
_action(SetTerm, "union", 2, _add_all)
_action(SetTerm, "intersection", 2, lambda found, args: found.keep(items_of(".set.intersection", args[0]).__contains__))
_action(
    SetTerm,
    "difference",
    2,
    lambda found, args: found.keep(lambda item: item not in items_of(".set.difference", args[0])),
)


@internal(".map.put", 3)
def map_put(engine: Any, args: Args, trail: Trail) -> None:
    """``.map.put(M, Key, Value)``: set the value of a key."""
    found = _of(MapTerm, ".map.put", args[0], trail)
    found.values[_value(".map.put", args[1])] = _value(".map.put", args[2])


@internal(".map.get", 3, 4)
def map_get(engine: Any, args: Args, trail: Trail) -> bool:
    """``.map.get(M, Key, Value, Default)``: Value is that of the key; without one, Default or a failure."""
    values, key = _of(MapTerm, ".map.get", args[0], trail).values, _value(".map.get", args[1])
    return (key in values or len(args) == 4) and gives(args[2], values.get(key, args[-1]), trail)


@internal(".map.remove", 2, 3)
def map_remove(engine: Any, args: Args, trail: Trail) -> bool:
    """``.map.remove(M, Key, Value)``: remove a key; Value is its value."""
    values, key = _of(MapTerm, ".map.remove", args[0], trail).values, _value(".map.remove", args[1])
    return key in values and gives(args[2:], (values.pop(key),)[: len(args) - 2], trail)


@internal(".map.key", 2, many=True)
def map_key(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.map.key(M, Key)``: Key is in turn each key."""
    return each(args[1], [key for key, _ in _of(MapTerm, ".map.key", args[0], trail).items()], trail)


@internal(".map.value", 2, many=True)
def map_value(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.map.value(M, Value)``: Value is in turn each value, in the order of the keys."""
    return each(args[1], [value for _, value in _of(MapTerm, ".map.value", args[0], trail).items()], trail)


@internal(".queue.head", 2)
def queue_head(engine: Any, args: Args, trail: Trail) -> bool:
    """``.queue.head(Q, X)``: X is the first item, which stays."""
    items = _of(QueueTerm, ".queue.head", args[0], trail).items()
    return bool(items) and gives(args[1], items[0], trail)


@internal(".queue.remove", 2)
def queue_remove(engine: Any, args: Args, trail: Trail) -> bool:
    """``.queue.remove(Q, X)``: take the first item."""
    queue = _of(QueueTerm, ".queue.remove", args[0], trail)
    return bool(queue.items()) and gives(args[1], queue.take(), trail)
