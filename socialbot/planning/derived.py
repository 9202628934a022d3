"""Derived predicates: what follows from formulas, and from nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from socialbot.planning.domain import Domain
from socialbot.planning.formulas import And, Fluent, Formula, Not, Or, Predicate, Quantified, World
from socialbot.planning.semantics import atoms, bindings, holds


class Derivation:
    """Finds what the derived predicates of a domain are in a world.

    ``circle`` names a predicate that depends on its own opposite; there is none in a domain that was read.
    """

    def __init__(self, domain: Domain) -> None:
        self._rules = domain.derived
        self.circle: str | None = None
        self._levels = self._by_level()
        self._bases: dict[Predicate, frozenset[Predicate | Fluent]] = {}

    def derived(self, world: World) -> frozenset[Predicate]:
        """All that is derived in ``world``, which is asked for other predicates only."""
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

    def bases(self, predicate: Predicate, world: World) -> frozenset[Predicate | Fluent]:
        """All that the derived ``predicate`` may follow from in the end, with the objects of ``world``."""
        if predicate not in self._bases:
            seen = {predicate}
            waiting = [predicate]
            found: set[Predicate | Fluent] = set()
            while waiting:
                parameters, formula = self._rules[waiting[-1].name]
                binding = {typed.name: name for typed, name in zip(parameters, waiting.pop().terms, strict=True)}
                for one in atoms(formula, world, binding):
                    if isinstance(one, Fluent) or one.name not in self._rules:
                        found.add(one)
                    elif one not in seen:
                        seen.add(one)
                        waiting.append(one)
            self._bases[predicate] = frozenset(found)
        return self._bases[predicate]

    def _by_level(self) -> list[list[str]]:
        """The derived predicates, each after all that it needs the opposite of."""
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
    """A world with what was derived so far."""

    def __init__(self, world: World, rules: Iterable[str]) -> None:
        self._world = world
        self._rules = rules
        self.found: set[Predicate] = set()

    def holds(self, predicate: Predicate) -> bool:
        return predicate in self.found if predicate.name in self._rules else self._world.holds(predicate)

    def value(self, fluent: Fluent) -> float | None:
        return self._world.value(fluent)

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        return self._world.objects(types)


def _read(formula: Formula, positive: bool) -> Iterator[tuple[str, bool]]:
    """The names of the predicates that ``formula`` reads, and whether it wants them to be true."""
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
        case _:
            return
