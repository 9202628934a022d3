"""Desires of an agent: their order, groups and state, and which one to plan for next."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from socialbot.deliberation._fact_index import has_wildcards, variables_in
from socialbot.deliberation.messages import INSTANCE, Desire, Fact, FactConjunction
from socialbot.deliberation.options import DeliberationOptions, Policy
from socialbot.deliberation.rules import conditions_in
from socialbot.planning.pddl.domain import PlanStep

End = Literal["fulfilled", "dropped"]

Listener = Callable[[End, str], object]
"""Callback with the end of a desire and its reason."""


@dataclass
class Setback:
    """Failures of a step since the last complete plan, and the reason of the latest one."""

    step: PlanStep
    times: int = 0
    reason: str = ""


@dataclass(eq=False)
class DesireState:
    """State of a desire.

    Attributes:
        record: Its record in the trace.
        blocked: Whether its precondition or context does not hold.
        not_before: Time (ns) before which it is not planned for.
        unsolvable_version: `FactIndex.version` for which the planner has proved that there is no plan.
        unsolvable_until: Time (ns) until which that proof counts.
        never_preempts: Desires that it has interrupted without getting a plan.
        failed_planning: Failed plannings from known facts since its last plan or progress.
        fruitless: Failed plannings from predicted facts, to preempt another desire, since its last plan.
        failed_execution: Failed executions since its last progress.
        most_met: Largest number of its conditions that have held at the end of a plan. A larger one is progress.
        setbacks: Steps that have failed and not succeeded since, by call.
        reported: Refused preparations that are on the trace already.
    """

    desire: Desire
    number: int
    record: str = ""
    is_fulfilled: Callable[[], bool] = lambda: False
    precondition_holds: Callable[[], bool] = lambda: True
    context_holds: Callable[[], bool] = lambda: True
    blocked: bool = False
    not_before: int = 0
    unsolvable_version: int = -1
    unsolvable_until: int = 0
    never_preempts: list[DesireState] = field(default_factory=list)
    failed_planning: int = 0
    fruitless: int = 0
    failed_execution: int = 0
    most_met: int = 0
    setbacks: dict[str, Setback] = field(default_factory=dict)
    listeners: list[Listener] = field(default_factory=list)
    reported: list[str] = field(default_factory=list)

    @property
    def rank(self) -> tuple[float, float, int]:
        """Sort key, smallest first: priority, then deadline, then arrival."""
        return -self.desire.priority, self.desire.deadline, self.number

    @property
    def name(self) -> str:
        return self.desire.name

    def outranks(self, other: DesireState) -> bool:
        """Return whether it may preempt another: higher priority, or same priority and earlier deadline."""
        return self.rank[:2] < other.rank[:2]


class DesireBase:
    """Desires of an agent with unique names, in the order of their rank."""

    def __init__(self) -> None:
        self._order: list[DesireState] = []
        self._by_name: dict[str, DesireState] = {}
        self._readers: dict[Hashable, dict[DesireState, bool]] = {}
        self._children: dict[Hashable, dict[DesireState, None]] = {}
        self._count = 0

    def __iter__(self) -> Iterator[DesireState]:
        return iter(tuple(self._order))

    def __len__(self) -> int:
        return len(self._order)

    @property
    def ranked(self) -> Sequence[DesireState]:
        """The desires in order; a live view."""
        return self._order

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def get(self, name: str) -> DesireState | None:
        return self._by_name.get(name)

    def add(self, desire: Desire) -> DesireState | None:
        """Add a desire; return None if there is one of its name."""
        if desire.name in self._by_name:
            return None
        self._count += 1
        state = DesireState(desire, self._count)
        self._by_name[desire.name] = state
        bisect.insort(self._order, state, key=lambda state: state.rank)
        for key, fulfils in _keys_in(desire).items():
            self._readers.setdefault(key, {})[state] = fulfils
        if desire.parent:
            self._children.setdefault(desire.parent, {})[state] = None
        return state

    def revise(self, state: DesireState, priority: float, deadline: float) -> None:
        """Change the priority and deadline of a desire, and so its place in the order."""
        self._remove_from_order(state)
        state.desire = msgspec.structs.replace(state.desire, priority=priority, deadline=deadline)
        bisect.insort(self._order, state, key=lambda state: state.rank)

    def remove(self, state: DesireState) -> bool:
        """Remove a desire; return False if it is not a member."""
        if self._by_name.get(state.name) is not state:
            return False
        del self._by_name[state.name]
        self._remove_from_order(state)
        for key in _keys_in(state.desire):
            _discard(self._readers, key, state)
        if state.desire.parent:
            _discard(self._children, state.desire.parent, state)
        return True

    def _remove_from_order(self, state: DesireState) -> None:
        del self._order[bisect.bisect_left(self._order, state.rank, key=lambda state: state.rank)]

    def about(self, fact: Fact) -> Iterator[tuple[DesireState, bool]]:
        """Yield the desires that a change of a fact may fulfil, block or unblock, perhaps repeatedly.

        With each comes whether the change may fulfil it.
        """
        for key in (fact.identity, (fact.pddl_type, fact.name), (fact.pddl_type,)):
            yield from self._readers.get(key, {}).items()

    def children(self, parent: str) -> tuple[DesireState, ...]:
        """Return the desires that prepare the one of that name, in the order of arrival."""
        return tuple(self._children.get(parent, ()))


def _keys_in(desire: Desire) -> dict[Hashable, bool]:
    """Return the index keys of the facts that a desire depends on, and whether its fulfilment does."""
    needs = (*conditions_in(desire.precondition), *conditions_in(desire.context))
    keys = {key: False for condition in needs for key in _keys_of(condition.condition_to_check)}
    keys.update((key, True) for condition in desire.wanted for key in _keys_of(condition.condition_to_check))
    absent = (check.condition_to_check for check in desire.wanted if check.check == "F")
    keys.update(((INSTANCE, name, ()), True) for fact in absent for name in fact.params)
    return keys


def _keys_of(fact: Fact) -> Iterator[Hashable]:
    variable = any(map(variables_in, (fact.name, *fact.params)))
    if has_wildcards(fact.name) or (fact.pddl_type == INSTANCE and variable):
        yield (fact.pddl_type,)
    elif variable or any(map(has_wildcards, fact.params)):
        yield fact.pddl_type, fact.name
    else:
        yield fact.identity
    if variable:
        yield (INSTANCE,)  # it stands for any of the objects that there are


def _discard(index: dict[Hashable, dict[DesireState, Any]], key: Hashable, state: DesireState) -> None:
    del index[key][state]
    if not index[key]:
        del index[key]


UNACHIEVABLE = "no plan can bring it about: it asks for an object, or does not say for which"


def missing_preparations(state: DesireState, options: DeliberationOptions) -> tuple[str, tuple[Desire, ...]]:
    """Return desires for a precondition or context that does not hold, if options ask for that, and their common name.

    There is one desire per achievable clause, named ``<desire>_fulfill_<precondition or context><number>``.
    """
    desire, what, dnf, asked = state.desire, "precondition", state.desire.precondition, options.autosub_prec
    if state.precondition_holds():
        what, dnf, asked = "context", desire.context, options.autosub_context and not state.context_holds()
    if not asked:
        return "", ()
    name = f"{desire.name}_fulfill_{what}"
    return name, tuple(
        Desire(
            name=f"{name}{number}",
            conditions=clause.literals,
            priority=lifted(desire.priority),
            deadline=desire.deadline,
            parent=desire.name,
        )
        for number, clause in enumerate(dnf.clauses)
        if _is_achievable(clause)
    )


def _is_achievable(clause: FactConjunction) -> bool:
    """Return whether a plan could make a clause true: it cannot create objects, or choose them for variables."""
    return bool(clause.literals) and not any(
        check.check == "EX"
        or any(has_wildcards(term) or variables_in(term) for term in check.condition_to_check.params)
        for check in clause.literals
    )


def relatives_to_drop(
    state: DesireState, how: End, reason: str, desires: DesireBase
) -> Iterator[tuple[DesireState, str]]:
    """Yield the desires to drop after the end of a desire, with reasons. Remove each before the next one.

    These are its preparations; after its fulfilment, the alternatives to it; after the last dropped alternative, the
    desire that it prepared.
    """
    yield from _descendants(state, desires)
    parent = desires.get(state.desire.parent)
    if parent is None:
        return
    siblings = desires.children(parent.name)
    if how == "fulfilled":
        for sibling in siblings:
            yield sibling, f"{state.name} is fulfilled"
            yield from _descendants(sibling, desires)
    elif not siblings and not (parent.precondition_holds() and parent.context_holds()):
        reason = f"cannot be prepared: {reason}"
        yield parent, reason
        yield from relatives_to_drop(parent, "dropped", reason, desires)


def _descendants(state: DesireState, desires: DesireBase) -> Iterator[tuple[DesireState, str]]:
    for child in desires.children(state.name):
        yield child, f"{state.name} has ended"
        yield from _descendants(child, desires)


def prepares(child: Desire, desire: Desire) -> bool:
    """Return whether ``child`` was made by `missing_preparations`, not only given ``desire`` as its parent."""
    return child.parent == desire.name and child.name.startswith(f"{desire.name}_fulfill_")


def lifted(priority: float) -> float:
    """Return the priority of the preparations of a desire with this priority."""
    return min(1.0, priority + 0.01)


def next_desire(
    ranked: Sequence[DesireState], pursued: DesireState | None, policy: Policy, is_ready: Callable[[DesireState], bool]
) -> DesireState | None:
    """Return the desire to plan for, or None.

    Args:
        pursued: The desire that is being pursued.
        is_ready: Whether a desire may be planned for now; called for all candidates up to the result.
    """
    if pursued is not None and policy == "NO_PREEMPT":
        return None
    for state in ranked:
        if pursued is not None and not state.outranks(pursued):
            return None
        if not state.blocked and pursued not in state.never_preempts and is_ready(state):
            return state
    return None
