"""What would be believed if something happened."""

from __future__ import annotations

from collections.abc import Iterable

from socialbot.planning.derived import Derivation
from socialbot.planning.domain import Domain
from socialbot.planning.formulas import Add, Delete, Fluent, Predicate, World
from socialbot.planning.semantics import GroundChange, SetValue


class Projection:
    """A world after some changes, with what is derived then; the world itself stays as it is."""

    def __init__(self, world: World, domain: Domain, changes: Iterable[GroundChange] = ()) -> None:
        self._world = world
        self._domain = domain
        self._derived: frozenset[Predicate] | None = None
        self._predicates: dict[Predicate, bool] = {}
        self._values: dict[Fluent, float] = {}
        for change in changes:
            match change:
                case Add(predicate):
                    self._predicates[predicate] = True
                case Delete(predicate):
                    self._predicates[predicate] = False
                case SetValue(fluent, value):
                    self._values[fluent] = value

    def after(self, changes: Iterable[GroundChange]) -> Projection:
        """This world after some more changes."""
        return Projection(self, self._domain, changes)

    def holds(self, predicate: Predicate) -> bool:
        if predicate.name in self._domain.derived:
            if self._derived is None:
                self._derived = Derivation(self._domain).derived(self)
            return predicate in self._derived
        known = self._predicates.get(predicate)
        return self._world.holds(predicate) if known is None else known

    def value(self, fluent: Fluent) -> float | None:
        known = self._values.get(fluent)
        return self._world.value(fluent) if known is None else known

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        return self._world.objects(types)
