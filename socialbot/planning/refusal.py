"""Why a problem cannot be asked: planners die of some mistakes, and plan for others as if nothing were wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from socialbot.planning.domain import Domain, Problem, Signature
from socialbot.planning.formulas import (
    And,
    Arithmetic,
    Comparison,
    Expression,
    Fluent,
    Formula,
    Not,
    Or,
    Predicate,
    Quantified,
    Same,
)

Types = tuple[str, ...]


def refusal(domain: Domain, problem: Problem) -> str | None:
    """The first thing that is wrong with ``problem``: no goal, or a name that does not fit the domain; else None."""
    return next(_Asked(domain, problem).mistakes(), None)


class _Asked:
    def __init__(self, domain: Domain, problem: Problem) -> None:
        self.domain = domain
        self.problem = problem
        self.objects: Mapping[str, Types] = {**domain.constants, **problem.objects}

    def mistakes(self) -> Iterator[str]:
        if not self.domain.text:
            yield f"the domain {self.domain.name} has no text to give to a planner"
        if self.problem.goal is None:
            yield "the problem has no goal"
            return
        if self.problem.domain != self.domain.name:
            yield f"the problem is for the domain {self.problem.domain!r}, not for {self.domain.name!r}"
        for name, types in self.problem.objects.items():
            yield from (f"{name} is of an unknown type {kind!r}" for kind in types if kind not in self.domain.types)
        for predicate in sorted(self.problem.facts, key=str):
            yield from self._atom("predicate", self.domain.predicates, predicate.name, predicate.terms, {})
        for fluent, value in self.problem.values.items():
            yield from self._atom("function", self.domain.functions, fluent.function, fluent.terms, {})
            if not math.isfinite(value):
                yield f"{_spelled(fluent.function, fluent.terms)} is {value}"
        yield from (f"in the goal: {mistake}" for mistake in self._formula(self.problem.goal, {}))

    def _formula(self, formula: Formula, variables: Mapping[str, Types]) -> Iterator[str]:
        match formula:
            case Predicate(name, terms):
                known = {**self.domain.predicates, **self._derived()}
                yield from self._atom("predicate", known, name, terms, variables)
            case Same(left, right):
                for term in (left, right):
                    if self._types(term, variables) is None:
                        yield f"unknown object {term!r}"
            case Comparison(_, left, right):
                for side in (left, right):
                    yield from self._expression(side, variables)
            case Not(part):
                yield from self._formula(part, variables)
            case And(parts) | Or(parts):
                for part in parts:
                    yield from self._formula(part, variables)
            case Quantified(_, bound, part):
                for typed in bound:
                    yield from (f"unknown type {kind!r}" for kind in typed.types if kind not in self.domain.types)
                yield from self._formula(part, {**variables, **{typed.name: typed.types for typed in bound}})

    def _expression(self, expression: Expression, variables: Mapping[str, Types]) -> Iterator[str]:
        match expression:
            case Fluent(function, terms):
                yield from self._atom("function", self.domain.functions, function, terms, variables)
            case Arithmetic(_, parts):
                for part in parts:
                    yield from self._expression(part, variables)

    def _derived(self) -> dict[str, Signature]:
        return {name: Signature(name, parameters) for name, (parameters, _) in self.domain.derived.items()}

    def _atom(
        self, kind: str, known: Mapping[str, Signature], name: str, terms: Types, variables: Mapping[str, Types]
    ) -> Iterator[str]:
        if name not in known:
            yield f"the domain {self.domain.name} has no {kind} {name!r}"
            return
        spelled = _spelled(name, terms)
        parameters = known[name].parameters
        if len(terms) != len(parameters):
            yield f"{spelled} has {len(terms)} arguments, not {len(parameters)}"
            return
        for term, parameter in zip(terms, parameters, strict=True):
            types = self._types(term, variables)
            if types is None:
                yield f"{spelled}: unknown object {term!r}"
            elif not self._fits(types, parameter.types):
                yield f"{spelled}: {term} is a {'|'.join(types)}, not a {'|'.join(parameter.types)}"

    def _types(self, term: str, variables: Mapping[str, Types]) -> Types | None:
        return variables.get(term) if term.startswith("?") else self.objects.get(term)

    def _fits(self, types: Types, wanted: Types) -> bool:
        return all(any(self.domain.is_a(kind, of) for of in wanted) for kind in types)


def _spelled(name: str, terms: Types) -> str:
    return f"({' '.join((name, *terms))})"
