"""The ledger: what steps of a plan have changed among the beliefs, so that it can be taken back."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass

from socialbot.agent_messages import FLUENT, PREDICATE, Fact
from socialbot.deliberation.facts import FactBase
from socialbot.planning.formulas import Add, Delete, Fluent, Predicate
from socialbot.planning.semantics import GroundChange, SetValue

Key = Predicate | Fluent


@dataclass(slots=True)
class Entry:
    """What was believed before; a ``relative`` change of a number leaves what others add to it alone."""

    before: bool | float | None
    relative: bool


class Ledger:
    """Writes effects into the beliefs, each for an owner.

    What somebody else changes after that is not taken back: a sensor, a rule, a later step. Only numbers that are
    increased and decreased by several owners each are put back by as much as the owner changed them.
    """

    def __init__(self, facts: FactBase) -> None:
        self._facts = facts
        self._entries: dict[object, dict[Key, Entry]] = {}
        self._writing: Key | None = None
        facts.watch(self._hear)

    def apply(
        self, owner: object, changes: Iterable[GroundChange], cause: str, relative: Container[Fluent] = ()
    ) -> None:
        """Believes changes; those of the ``relative`` fluents came by increase or decrease.

        Raises PlanningError when one does not fit the domain any more.
        """
        for change in changes:
            match change:
                case Add(predicate):
                    if not self._facts.holds(predicate):
                        self._write(owner, predicate, True, cause)
                case Delete(predicate):
                    if self._facts.holds(predicate):
                        self._write(owner, predicate, False, cause)
                case SetValue(fluent, value):
                    self._write(owner, fluent, value, cause, relative=fluent in relative)

    def undo(self, owner: object, cause: str) -> None:
        """Takes back what an owner has changed, the last change first."""
        for key, entry in reversed(self._entries.pop(owner, {}).items()):
            # Objects that have gone meanwhile do not come back with it.
            if self._facts.unknown(fact_of(key)) is None:
                self._write(None, key, entry.before, cause, relative=entry.relative)

    def close(self, owner: object) -> None:
        """Lets the changes of an owner stand for good."""
        self._entries.pop(owner, None)

    def undone(self) -> dict[Key, bool | float | None]:
        """What would be believed instead, if all owners took back what they have changed."""
        found: dict[Key, bool | float | None] = {}
        for entries in self._entries.values():
            for key, entry in entries.items():
                if isinstance(key, Fluent) and entry.relative and entry.before is not None:
                    now = self._facts.value(key) or 0.0
                    found[key] = (found.get(key, now) or 0.0) + entry.before - now
                else:
                    found[key] = entry.before
        return found

    # Within

    def _write(self, owner: object, key: Key, new: bool | float | None, cause: str, *, relative: bool = False) -> None:
        before = self._facts.holds(key) if isinstance(key, Predicate) else self._facts.value(key)
        self._writing = key
        try:
            if new is None or new is False:
                self._facts.remove(fact_of(key, before), cause)
            else:
                self._facts.add(fact_of(key, new), cause=cause)
        finally:
            self._writing = None
        shift = (new or 0.0) - (before or 0.0) if relative else None
        for other, entries in self._entries.items():
            if other is not owner:
                _overtake(entries, key, shift)
        if owner is not None:
            self._entries.setdefault(owner, {}).setdefault(key, Entry(before, relative))

    def _hear(self, fact: Fact, held: bool, cause: str) -> None:
        key = key_of(fact)
        if key is not None and key != self._writing:
            for entries in self._entries.values():
                entries.pop(key, None)


def _overtake(entries: dict[Key, Entry], key: Key, shift: float | None) -> None:
    """Notes that somebody else has changed what is in an owner's entries."""
    entry = entries.get(key)
    if entry is None:
        return
    if shift is not None and entry.relative and entry.before is not None:
        entry.before += shift
    else:
        del entries[key]


def key_of(fact: Fact) -> Key | None:
    """What a fact is about; None for an instance."""
    if fact.pddl_type == PREDICATE:
        return Predicate(fact.name, fact.params)
    return Fluent(fact.name, fact.params) if fact.pddl_type == FLUENT else None


def fact_of(key: Key, value: bool | float | None = True) -> Fact:
    """A predicate, or a fluent with its value, as a fact."""
    if isinstance(key, Predicate):
        return Fact(name=key.name, params=key.terms)
    return Fact(name=key.function, pddl_type=FLUENT, params=key.terms, value=float(value or 0.0))
