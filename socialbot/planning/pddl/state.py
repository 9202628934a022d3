"""Worlds in which formulas are evaluated: PDDL states, projections of other worlds, and derived predicates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.formulas import And, Fluent, Formula, Key, Not, Or, PddlWorld, Predicate, Quantified
from socialbot.planning.pddl.semantics import Changes, atoms, bindings, holds


class Derivation:
    """Evaluates the derived predicates of a domain.

    ``circle`` is a predicate that depends on its own negation; domains from the reader have none.
    """

    def __init__(self, domain: PddlDomain) -> None:
        self._rules = domain.derived
        self.circle: str | None = None
        self._levels = self._by_level()
        self._bases: dict[Predicate, frozenset[Key]] = {}

    def derived(self, world: PddlWorld) -> frozenset[Predicate]:
        """Return all derived predicates that hold in a world of basic predicates."""
        overlay = _Overlay(world, self._rules)
        for level in self._levels:
            before = -1
            while len(overlay.found) > before:
                before = len(overlay.found)
                for name in level:
                    parameters, formula = self._rules[name]
                    for binding in bindings(parameters, world):
                        predicate = Predicate(name, tuple(binding[typed.name] for typed in parameters))
                        if predicate not in overlay.found and holds(formula, overlay, binding):
                            overlay.found.add(predicate)
        return frozenset(overlay.found)

    def bases(self, predicate: Predicate, world: PddlWorld) -> frozenset[Key]:
        """Return all basic predicates and fluents that a derived predicate may depend on."""
        if predicate not in self._bases:
            seen: dict[Key, None] = {predicate: None}
            waiting = [predicate]
            while waiting:
                derived = waiting.pop()
                parameters, formula = self._rules[derived.name]
                binding = {typed.name: name for typed, name in zip(parameters, derived.terms, strict=True)}
                new = [one for one in dict.fromkeys(atoms(formula, world, binding)) if one not in seen]
                seen.update(dict.fromkeys(new))
                waiting += [one for one in new if isinstance(one, Predicate) and one.name in self._rules]
            self._bases[predicate] = frozenset(
                one for one in seen if isinstance(one, Fluent) or one.name not in self._rules
            )
        return self._bases[predicate]

    def _by_level(self) -> list[list[str]]:
        """Stratify the derived predicates by negation."""
        levels = dict.fromkeys(self._rules, 0)
        changed = True
        while changed:
            changed = False
            for name, (_, formula) in self._rules.items():
                for read, positive in _read(formula, True):
                    least = levels.get(read, -1) + (0 if positive else 1)
                    if levels[name] < least:
                        levels[name], changed = least, True
                if levels[name] > len(levels):
                    self.circle = name
                    return []
        return [[name for name in levels if levels[name] == level] for level in sorted(set(levels.values()))]


class _Overlay:
    """A world with the predicates derived so far."""

    def __init__(self, world: PddlWorld, rules: Iterable[str]) -> None:
        self._world = world
        self._rules = rules
        self.found: set[Predicate] = set()
        self.value = world.value
        self.objects = world.objects

    def holds(self, predicate: Predicate) -> bool:
        return predicate in self.found if predicate.name in self._rules else self._world.holds(predicate)


def _read(formula: Formula, positive: bool) -> Iterator[tuple[str, bool]]:
    """Yield the predicates in a formula by name, and whether they occur positively."""
    match formula:
        case Predicate(name):
            yield name, positive
        case Not(part):
            yield from _read(part, not positive)
        case And(parts) | Or(parts):
            for part in parts:
                yield from _read(part, positive)
        case Quantified(_, _, part):
            yield from _read(part, positive)


class PddlState:
    """Mutable facts and fluent values; a `PddlWorld`."""

    def __init__(
        self,
        domain: PddlDomain,
        objects: Mapping[str, tuple[str, ...]],
        facts: Iterable[Predicate] = (),
        values: Mapping[Fluent, float] | None = None,
    ) -> None:
        self.domain = domain
        self.types: Mapping[str, tuple[str, ...]] = {**domain.constants, **objects}
        self.facts = set(facts)
        self.values = dict(values or {})
        self.derivation = Derivation(domain)
        self._derived: frozenset[Predicate] | None = None
        self._of_types: dict[tuple[str, ...], tuple[str, ...]] = {}

    @classmethod
    def of(cls, problem: PddlProblem, domain: PddlDomain) -> PddlState:
        """Return the initial state of a problem."""
        return cls(domain, problem.objects, problem.facts, problem.values)

    def copy(self) -> PddlState:
        return PddlState(self.domain, self.types, self.facts, self.values)

    def problem(self, goal: Formula | None, *, name: str = "now") -> PddlProblem:
        """Return the problem of reaching a goal from this state."""
        return PddlProblem(name, self.domain.name, self.types, frozenset(self.facts), dict(self.values), goal)

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
            found = tuple(name for name, kinds in self.types.items() if self.domain.belongs(kinds, types))
            self._of_types[types] = found
        return found

    def apply(self, changes: Changes) -> None:
        self._derived = None
        for key, new in changes.items():
            if isinstance(key, Fluent):
                self.values[key] = new
            elif new:
                self.facts.add(key)
            else:
                self.facts.discard(key)


class Projection:
    """View of a world after some changes, including its derived predicates; the world itself is not changed."""

    def __init__(self, world: PddlWorld, domain: PddlDomain, changes: Changes | None = None) -> None:
        self._world = world
        self._domain = domain
        self._changes = changes or {}
        self._derived: frozenset[Predicate] | None = None
        self.objects = world.objects

    def holds(self, predicate: Predicate) -> bool:
        if predicate.name in self._domain.derived:
            if self._derived is None:
                self._derived = Derivation(self._domain).derived(self)
            return predicate in self._derived
        known = self._changes.get(predicate)
        return self._world.holds(predicate) if known is None else bool(known)

    def value(self, fluent: Fluent) -> float | None:
        known = self._changes.get(fluent)
        return self._world.value(fluent) if known is None else known
