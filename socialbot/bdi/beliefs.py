"""The belief base: what the agent holds true, from which source and since when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from socialbot.bdi.literals import Belief, Conjunction, Negation
from socialbot.bdi.terms import Bindings, Variable, evaluate, unify


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A belief that is held: the id of the trace record of its beginning serves as its cause."""

    belief: Belief
    source: str
    since: int
    record: str


class BeliefBase:
    """The beliefs of one agent, by name and number of arguments."""

    def __init__(self) -> None:
        self._relations: dict[tuple[str, int], dict[tuple[object, ...], Held]] = {}

    def __iter__(self) -> Iterator[Held]:
        for relation in self._relations.values():
            yield from list(relation.values())

    def __contains__(self, belief: Belief) -> bool:
        return belief.args in self._relations.get(belief.key, ())

    def get(self, belief: Belief) -> Held | None:
        """What is held of exactly this belief."""
        return self._relations.get(belief.key, {}).get(belief.args)

    def add(self, held: Held) -> None:
        """Holds a belief from now on."""
        self._relations.setdefault(held.belief.key, {})[held.belief.args] = held

    def remove(self, belief: Belief) -> None:
        """Holds a belief no longer."""
        del self._relations[belief.key][belief.args]

    def others(self, belief: Belief) -> list[Held]:
        """The beliefs of the same name with other arguments (of any number)."""
        return [held for held in self if held.belief.functor == belief.functor and held.belief.args != belief.args]

    def match(self, pattern: Belief, bindings: Bindings) -> Iterator[tuple[Held, Bindings]]:
        """The beliefs that ``pattern`` matches, in order of their coming, as they are at this moment."""
        relation = self._relations.get(pattern.key)
        if not relation:
            return
        if not any(isinstance(arg, Variable) and arg.name not in bindings for arg in pattern.args):
            held = relation.get(tuple(evaluate(arg, bindings) for arg in pattern.args))
            if held is not None:
                yield held, bindings
            return
        for held in list(relation.values()):
            extended = unify(pattern.args, held.belief.args, bindings)
            if extended is not None:
                yield held, extended

    def solve(self, condition: Conjunction, bindings: Bindings, start: int = 0) -> Iterator[Bindings]:
        """All ways in which ``condition`` holds, from left to right."""
        if start == len(condition.terms):
            yield bindings
            return
        term = condition.terms[start]
        if isinstance(term, Belief):
            for _, extended in self.match(term, bindings):
                yield from self.solve(condition, extended, start + 1)
        elif isinstance(term, Negation):
            if next(self.match(term.belief, bindings), None) is None:
                yield from self.solve(condition, bindings, start + 1)
        elif term.holds(bindings):
            yield from self.solve(condition, bindings, start + 1)
