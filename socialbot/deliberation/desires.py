"""Desires of an agent: their order, groups and state, and which one to plan for next."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from socialbot.deliberation.fact_index import has_wildcards, variables_in
from socialbot.deliberation.messages import INSTANCE, Desire, Dnf, Fact, FactCondition, FactConjunction
from socialbot.deliberation.options import Options, Policy
from socialbot.deliberation.rules import conditions_in

End = Literal["fulfilled", "dropped"]

Listener = Callable[[End, str], object]
"""Is told how a desire ended, and why."""


def _always() -> bool:
    return True


def _never() -> bool:
    return False


@dataclass(eq=False)
class DesireState:
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
    in_vain: list[DesireState] = field(default_factory=list)
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

    def outranks(self, other: DesireState) -> bool:
        """Whether it may interrupt ``other``: by a higher priority, or the same and a strictly shorter deadline."""
        return self.rank[:2] < other.rank[:2]


class DesireBase:
    """The desires of an agent, one of a name, in the order of their rank."""

    def __init__(self) -> None:
        self._order: list[DesireState] = []
        self._by_name: dict[str, DesireState] = {}
        self._readers: dict[Hashable, dict[DesireState, None]] = {}
        self._children: dict[str, dict[DesireState, None]] = {}
        self._count = 0

    def __iter__(self) -> Iterator[DesireState]:
        return iter(tuple(self._order))

    def __len__(self) -> int:
        return len(self._order)

    @property
    def ranked(self) -> Sequence[DesireState]:
        """The desires in order, as they are now; not to be kept."""
        return self._order

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def get(self, name: str) -> DesireState | None:
        """The desire of that name, if there is one."""
        return self._by_name.get(name)

    def add(self, desire: Desire) -> DesireState | None:
        """Takes in a desire; None when there is one of its name already, which stays."""
        if desire.name in self._by_name:
            return None
        self._count += 1
        wish = DesireState(desire, self._count)
        self._by_name[desire.name] = wish
        bisect.insort(self._order, wish, key=lambda wish: wish.rank)
        for key in _keys_in(desire):
            self._readers.setdefault(key, {})[wish] = None
        if desire.parent:
            self._children.setdefault(desire.parent, {})[wish] = None
        return wish

    def revise(self, wish: DesireState, priority: float, deadline: float) -> None:
        """Gives a desire another priority and deadline, and with them another place in the order."""
        self._take_from_order(wish)
        wish.desire = msgspec.structs.replace(wish.desire, priority=priority, deadline=deadline)
        bisect.insort(self._order, wish, key=lambda wish: wish.rank)

    def remove(self, wish: DesireState) -> bool:
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

    def _take_from_order(self, wish: DesireState) -> None:
        del self._order[bisect.bisect_left(self._order, wish.rank, key=lambda wish: wish.rank)]

    def about(self, fact: Fact) -> Iterator[DesireState]:
        """The desires that a change of a fact may fulfil, unblock or block; one may come more than once."""
        for key in (fact.identity, (fact.pddl_type, fact.name), (fact.pddl_type,)):
            yield from self._readers.get(key, ())

    def children(self, parent: str) -> tuple[DesireState, ...]:
        """The desires that prepare the one of that name, as they came."""
        return tuple(self._children.get(parent, ()))


def _keys_in(desire: Desire) -> dict[Hashable, None]:
    """What a desire depends on: whether it is fulfilled, and whether it may be pursued."""
    conditions = (*desire.wanted, *conditions_in(desire.precondition), *conditions_in(desire.context))
    absent = (check.condition_to_check for check in desire.wanted if check.check == "F")
    objects = {(INSTANCE, name, ()): None for fact in absent for name in fact.params}
    return {key: None for condition in conditions for key in _keys_of(condition.condition_to_check)} | objects


def _keys_of(fact: Fact) -> Iterator[Hashable]:
    """Where `DesireBase.about` looks for those who depend on a fact, or on what fits it."""
    variable = any(map(variables_in, (fact.name, *fact.params)))
    if has_wildcards(fact.name) or (fact.pddl_type == INSTANCE and variable):
        yield (fact.pddl_type,)
    elif variable or any(map(has_wildcards, fact.params)):
        yield fact.pddl_type, fact.name
    else:
        yield fact.identity
    if variable:
        yield (INSTANCE,)  # it stands for any of the objects that there are


def _discard(shelves: dict[Any, dict[DesireState, None]], key: Hashable, wish: DesireState) -> None:
    del shelves[key][wish]
    if not shelves[key]:
        del shelves[key]


LIFT = 0.01
"""How much higher the priority of a desire is that prepares another one."""


def lacking(wish: DesireState, options: Options) -> tuple[Desire, ...]:
    """What to desire first, as the precondition or the context of a desire does not hold."""
    if not wish.is_prepared():
        return preparations(wish.desire, wish.desire.precondition, "precondition") if options.autosub_prec else ()
    if not wish.is_in_context():
        return preparations(wish.desire, wish.desire.context, "context") if options.autosub_context else ()
    return ()


def preparations(desire: Desire, dnf: Dnf, what: str) -> tuple[Desire, ...]:
    """Desires that make a clause of ``dnf`` true each, for ``desire``: named ``<desire>_fulfill_<what><number>``."""
    return tuple(
        Desire(
            name=f"{desire.name}_fulfill_{what}{number}",
            conditions=clause.literals,
            priority=lifted(desire.priority),
            deadline=desire.deadline,
            parent=desire.name,
        )
        for number, clause in enumerate(dnf.clauses)
        if _can_be_wanted(clause)
    )


def ending_with(wish: DesireState, how: End, reason: str, desires: DesireBase) -> Iterator[tuple[DesireState, str]]:
    """Who is dropped, and why, now that a desire has ended; each is to be taken out of ``desires`` when it is told.

    These are the desires that prepared it; when it is fulfilled, those that prepared the same as it did; and when it
    is dropped, and none such is left, what it was to prepare.
    """
    yield from _descendants(wish, desires)
    parent = desires.get(wish.desire.parent)
    if parent is None:
        return
    siblings = desires.children(parent.name)
    if how == "fulfilled":
        for sibling in siblings:
            yield sibling, f"{wish.name} is fulfilled"
            yield from _descendants(sibling, desires)
    elif not siblings and not (parent.is_prepared() and parent.is_in_context()):
        reason = f"cannot be prepared: {reason}"
        yield parent, reason
        yield from ending_with(parent, "dropped", reason, desires)


def hindrances(wish: DesireState, options: Options) -> tuple[str, str] | None:
    """What of a desire does not hold, and is not desired though it should be, with the reason; None without that."""
    lacks_precondition = not wish.is_prepared()
    asked = options.autosub_prec if lacks_precondition else options.autosub_context and not wish.is_in_context()
    if not asked or lacking(wish, options):
        return None
    what = "precondition" if lacks_precondition else "context"
    return f"{wish.name}_fulfill_{what}", "no plan can bring it about: it asks for an object, or does not say for which"


def prepares(child: Desire, desire: Desire) -> bool:
    """Whether it was made to prepare another desire, rather than by somebody who has only called that its parent."""
    return child.parent == desire.name and child.name.startswith(f"{desire.name}_fulfill_")


def lifted(priority: float) -> float:
    """The priority of what prepares a desire with this one."""
    return min(1.0, priority + LIFT)


def _descendants(wish: DesireState, desires: DesireBase) -> Iterator[tuple[DesireState, str]]:
    for child in desires.children(wish.name):
        yield child, f"{wish.name} has ended"
        yield from _descendants(child, desires)


def _can_be_wanted(clause: FactConjunction) -> bool:
    """Whether a plan can bring it about: no plan makes an object, or knows which one is meant."""
    return bool(clause.literals) and all(_may_change(check) for check in clause.literals)


def _may_change(check: FactCondition) -> bool:
    fact = check.condition_to_check
    return check.check != "EX" and not any(has_wildcards(term) or variables_in(term) for term in fact.params)


def next_desire(
    ranked: Sequence[DesireState], pursued: DesireState | None, policy: Policy, is_ready: Callable[[DesireState], bool]
) -> DesireState | None:
    """The desire to plan for, if there is any, of those that are ``ranked``; ``pursued`` is the one that is pursued.

    ``is_ready`` tells whether one may be planned for by now. It is asked about all who would have had a turn.
    """
    if pursued is not None and policy == "NO_PREEMPT":
        return None
    for wish in ranked:
        if pursued is not None and not wish.outranks(pursued):
            return None
        if not wish.blocked and pursued not in wish.in_vain and is_ready(wish):
            return wish
    return None
