"""A state of affairs that can be changed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from socialbot.planning.derived import Derivation
from socialbot.planning.domain import Domain, Problem
from socialbot.planning.formulas import Add, Delete, Fluent, Formula, Predicate
from socialbot.planning.semantics import GroundChange


class State:
    """The facts and values of a moment; a `World` that formulas can be asked about."""

    def __init__(
        self,
        domain: Domain,
        objects: Mapping[str, tuple[str, ...]],
        facts: Iterable[Predicate] = (),
        values: Mapping[Fluent, float] | None = None,
    ) -> None:
        self.domain = domain
        self.types: Mapping[str, tuple[str, ...]] = {**domain.constants, **objects}
        """The types of each object, constants of the domain first."""
        self.facts = set(facts)
        self.values = dict(values or {})
        self.derivation = Derivation(domain)
        self._derived: frozenset[Predicate] | None = None
        self._of_types: dict[tuple[str, ...], tuple[str, ...]] = {}

    @classmethod
    def of(cls, problem: Problem, domain: Domain) -> State:
        """The state that ``problem`` begins with."""
        return cls(domain, problem.objects, problem.facts, problem.values)

    def copy(self) -> State:
        """A state of its own with the same facts and values."""
        return State(self.domain, self.types, self.facts, self.values)

    def problem(self, goal: Formula | None, *, name: str = "now") -> Problem:
        """How to reach ``goal`` from here."""
        return Problem(name, self.domain.name, self.types, frozenset(self.facts), dict(self.values), goal)

    def holds(self, predicate: Predicate) -> bool:
        if predicate.name not in self.domain.derived:
            return predicate in self.facts
        if self._derived is None:
            self._derived = self.derivation.derived(self)
        return predicate in self._derived

    def value(self, fluent: Fluent) -> float | None:
        return self.values.get(fluent)

    def objects(self, types: tuple[str, ...]) -> tuple[str, ...]:
        found = self._of_types.get(types)
        if found is None:
            found = tuple(name for name, kinds in self.types.items() if self.domain.fits(kinds, types))
            self._of_types[types] = found
        return found

    def apply(self, changes: Iterable[GroundChange]) -> None:
        """Carries out changes in their order."""
        self._derived = None
        for change in changes:
            match change:
                case Add(predicate):
                    self.facts.add(predicate)
                case Delete(predicate):
                    self.facts.discard(predicate)
                case _:
                    self.values[change.fluent] = change.value
