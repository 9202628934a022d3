"""What an agent desires, in the order in which it is to be thought about, and how each desire fares."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from socialbot.agent_messages import INSTANCE, Desire, Fact
from socialbot.deliberation.patterns import has_wildcards, variables_in
from socialbot.deliberation.rules import conditions_in

End = Literal["fulfilled", "dropped"]

Listener = Callable[[End, str], object]
"""Is told how a desire ended, and why."""


def _always() -> bool:
    return True


def _never() -> bool:
    return False


@dataclass(eq=False)
class Wish:
    """A desire of an agent, and what became of it so far.

    ``record`` is its record in the trace. ``is_fulfilled``, ``is_prepared`` (its precondition) and ``is_in_context``
    ask what is believed. It is ``blocked`` while the last two are not so, and not thought about before ``not_before``
    (ns); nor before ``hopeless_until`` while `FactIndex.version` is that for which it was proved to have no plan
    (``hopeless_at``). It interrupts none of ``in_vain`` again. Plannings have failed so many times since a plan was
    carried out for it; executions in all. What cannot be desired to prepare it was ``told`` once.
    """

    desire: Desire
    number: int
    record: str = ""
    is_fulfilled: Callable[[], bool] = _never
    is_prepared: Callable[[], bool] = _always
    is_in_context: Callable[[], bool] = _always
    blocked: bool = False
    not_before: int = 0
    hopeless_at: int = -1
    hopeless_until: int = 0
    in_vain: list[Wish] = field(default_factory=list)
    failed_planning: int = 0
    failed_execution: int = 0
    listeners: list[Listener] = field(default_factory=list)
    told: list[str] = field(default_factory=list)

    @property
    def rank(self) -> tuple[float, float, int]:
        """What decides whose turn it is, the smallest first: priority, then deadline, then arrival."""
        return -self.desire.priority, self.desire.deadline, self.number

    @property
    def name(self) -> str:
        """The name of the desire."""
        return self.desire.name

    def outranks(self, other: Wish) -> bool:
        """Whether it may interrupt ``other``: by a higher priority, or the same and a strictly shorter deadline."""
        return self.rank[:2] < other.rank[:2]


class DesireSet:
    """The desires of an agent, one of a name, in the order of their rank."""

    def __init__(self) -> None:
        self._order: list[Wish] = []
        self._by_name: dict[str, Wish] = {}
        self._readers: dict[Hashable, dict[Wish, None]] = {}
        self._children: dict[str, dict[Wish, None]] = {}
        self._count = 0

    def __iter__(self) -> Iterator[Wish]:
        return iter(tuple(self._order))

    def __len__(self) -> int:
        return len(self._order)

    @property
    def ranked(self) -> Sequence[Wish]:
        """The desires in order, as they are now; not to be kept."""
        return self._order

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def get(self, name: str) -> Wish | None:
        """The desire of that name, if there is one."""
        return self._by_name.get(name)

    def add(self, desire: Desire) -> Wish | None:
        """Takes in a desire; None when there is one of its name already, which stays."""
        if desire.name in self._by_name:
            return None
        self._count += 1
        wish = Wish(desire, self._count)
        self._by_name[desire.name] = wish
        bisect.insort(self._order, wish, key=lambda wish: wish.rank)
        for key in _keys_in(desire):
            self._readers.setdefault(key, {})[wish] = None
        if desire.parent:
            self._children.setdefault(desire.parent, {})[wish] = None
        return wish

    def revise(self, wish: Wish, priority: float, deadline: float) -> None:
        """Gives a desire another priority and deadline, and with them another place in the order."""
        self._take_from_order(wish)
        wish.desire = msgspec.structs.replace(wish.desire, priority=priority, deadline=deadline)
        bisect.insort(self._order, wish, key=lambda wish: wish.rank)

    def remove(self, wish: Wish) -> bool:
        """Takes a desire out; False when it is not in."""
        if self._by_name.get(wish.name) is not wish:
            return False
        del self._by_name[wish.name]
        self._take_from_order(wish)
        for key in _keys_in(wish.desire):
            _discard(self._readers, key, wish)
        if wish.desire.parent:
            _discard(self._children, wish.desire.parent, wish)
        return True

    def _take_from_order(self, wish: Wish) -> None:
        del self._order[bisect.bisect_left(self._order, wish.rank, key=lambda wish: wish.rank)]

    def about(self, fact: Fact) -> Iterator[Wish]:
        """The desires that a change of a fact may fulfil, unblock or block; one may come more than once."""
        for key in (fact.identity, (fact.pddl_type, fact.name), (fact.pddl_type,)):
            yield from self._readers.get(key, ())

    def children(self, parent: str) -> tuple[Wish, ...]:
        """The desires that prepare the one of that name, as they came."""
        return tuple(self._children.get(parent, ()))


def _keys_in(desire: Desire) -> dict[Hashable, None]:
    """What a desire depends on: whether it is fulfilled, and whether it may be pursued."""
    conditions = (*desire.wanted, *conditions_in(desire.precondition), *conditions_in(desire.context))
    absent = (check.condition_to_check for check in desire.wanted if check.check == "F")
    objects = {(INSTANCE, name, ()): None for fact in absent for name in fact.params}
    return {key: None for condition in conditions for key in _keys_of(condition.condition_to_check)} | objects


def _keys_of(fact: Fact) -> Iterator[Hashable]:
    """Where `DesireSet.about` looks for those who depend on a fact, or on what fits it."""
    variable = any(map(variables_in, (fact.name, *fact.params)))
    if has_wildcards(fact.name) or (fact.pddl_type == INSTANCE and variable):
        yield (fact.pddl_type,)
    elif variable or any(map(has_wildcards, fact.params)):
        yield fact.pddl_type, fact.name
    else:
        yield fact.identity
    if variable:
        yield (INSTANCE,)  # it stands for any of the objects that there are


def _discard(shelves: dict[Any, dict[Wish, None]], key: Hashable, wish: Wish) -> None:
    del shelves[key][wish]
    if not shelves[key]:
        del shelves[key]
