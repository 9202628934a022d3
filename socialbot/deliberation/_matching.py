"""Matching of conditions against facts, with wildcards and variables.

In names and parameters, ``*`` stands for any letters and ``?`` for one. A whole parameter, or the name of an instance,
may be a variable such as ``{x}``, with the same object in all of a conjunction. Positive conditions (T, EX,
comparisons) bind variables; a variable that only occurs in negative ones (F) stands for each instance of its type. F
with wildcards means that nothing matches. A condition whose check does not suit its fact never holds.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from socialbot.deliberation._fact_index import KINDS, FactIndex, Params, has_wildcards, like, variable_of, variables_in
from socialbot.deliberation.messages import FLUENT, INSTANCE, PREDICATE, Dnf, Fact, FactCondition, FactConjunction
from socialbot.planning.pddl.domain import OBJECT, PddlDomain

Binding = Mapping[str, str]
"""Objects by variables."""

CHECKED = {"EX": INSTANCE, "T": PREDICATE, "F": PREDICATE} | dict.fromkeys(("EQ", "GR", "GREQ", "LE", "LEQ"), FLUENT)
"""Type of fact for each check."""

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "EQ": operator.eq, "GR": operator.gt, "GREQ": operator.ge, "LE": operator.lt, "LEQ": operator.le,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class FactMatch:
    """Match of conditions: the binding of variables, and the compared fluents."""

    bindings: tuple[tuple[str, str], ...] = ()
    fluents: tuple[Fact, ...] = ()

    @property
    def binding(self) -> dict[str, str]:
        return dict(self.bindings)

    @property
    def order(self) -> tuple[object, ...]:
        return self.bindings, tuple((fact.identity, fact.value) for fact in self.fluents)

    def __str__(self) -> str:
        return ", ".join([*(f"{name}={value}" for name, value in self.bindings), *map(str, self.fluents)])


def matches(dnf: Dnf, facts: FactIndex) -> list[FactMatch]:
    """Return all matches of a DNF in order; an empty DNF has one empty match."""
    found = {match: None for clause in clauses_of(dnf, facts.domain) for match in clause.solve(facts)}
    return sorted(found, key=lambda match: match.order)


def fitting(pattern: Fact, facts: FactIndex) -> list[Fact]:
    """Return the facts with the type, name and parameters of a pattern, in order."""
    rows = _literal(FactCondition(condition_to_check=pattern)).rows({}, facts)
    return sorted((fact for fact, _ in rows), key=lambda fact: fact.identity)


def mismatch(condition: FactCondition) -> str | None:
    """Return why a check does not suit its fact; None if it does."""
    wanted, given = CHECKED[condition.check], condition.condition_to_check.pddl_type
    return None if wanted == given else f"{condition.check} checks {KINDS[wanted]}, not {KINDS[given]}"


def unfit_condition(condition: FactCondition, facts: FactIndex) -> str | None:
    """Return why a condition can never hold in a domain; None if it can."""
    fact = condition.condition_to_check
    for term in (fact.name, *fact.params):
        if variables_in(term) and variable_of(term) is None:
            return f"{fact}: a variable has to be the whole parameter, not a part of {term!r}"
    return mismatch(condition) or facts.unfit_pattern(fact)


@dataclass(eq=False)
class CompiledCondition:
    """Condition with its parameters split into objects, variables and wildcards."""

    check: str
    pddl_type: int
    name: str
    terms: Params
    value: float = 0.0
    kind: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        terms = self.terms
        self.arity = len(terms)
        named = [(position, variable_of(term) or "") for position, term in enumerate(terms)]
        self.variables = tuple((position, name) for position, name in named if name)
        rest = [(position, terms[position]) for position, name in named if not name]
        self.constants = tuple((position, term) for position, term in rest if not has_wildcards(term))
        wild = ((position, term) for position, term in rest if has_wildcards(term) and term != "*")
        self.patterns = tuple((position, like(term)) for position, term in wild)

    @property
    def is_plain(self) -> bool:
        return len(self.constants) == self.arity and not has_wildcards(self.name)

    def names(self) -> frozenset[str]:
        return frozenset(name for _, name in self.variables)

    def reads(self, pddl_type: int, name: str) -> bool:
        if pddl_type != self.pddl_type:
            return False
        return pddl_type == INSTANCE or self.name == name or (has_wildcards(self.name) and bool(like(self.name)(name)))

    def bind(self, params: Params, binding: Binding) -> dict[str, str] | None:
        """Return the extended binding for which it matches parameters, or None."""
        if len(params) != self.arity:
            return None
        if any(params[position] != term for position, term in self.constants):
            return None
        if not all(fits(params[position]) for position, fits in self.patterns):
            return None
        found = dict(binding)
        for position, name in self.variables:
            if found.setdefault(name, params[position]) != params[position]:
                return None
        return found

    def rows(self, binding: Binding, facts: FactIndex) -> Iterator[tuple[Fact, Binding]]:
        """Yield the matching facts with their bindings, before the check."""
        bound = ((position, binding[name]) for position, name in self.variables if name in binding)
        known = (*self.constants, *bound)
        names: Iterable[str] = (self.name,)
        if has_wildcards(self.name):
            names = [name for name in facts.names(self.pddl_type) if like(self.name)(name)]
        for name in names:
            table = facts.table(self.pddl_type, name)
            if len(known) == self.arity:
                fact = table.facts.get(tuple(term for _, term in sorted(known)))
                if fact is not None:
                    yield fact, binding
                continue
            for params in table.among(known):
                found = self.bind(params, binding)
                if found is not None:
                    yield table.facts[params], found

    def accepts(self, fact: Fact, facts: FactIndex) -> bool:
        if self.check in _COMPARE:
            return _COMPARE[self.check](fact.value, self.value)
        return not self.kind or facts.fits(fact.name, self.kind)


@dataclass(eq=False)
class CompiledClause:
    """Conjunction of compiled conditions, with its variables in order."""

    literals: tuple[CompiledCondition, ...]
    variables: tuple[str, ...] = ()
    _orders: dict[frozenset[str], tuple[int, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._plain = all(literal.is_plain for literal in self.literals)

    def holds(self, facts: FactIndex) -> bool:
        if not self._plain:
            return next(self.solve(facts), None) is not None
        for literal in self.literals:
            fact = facts.table(literal.pddl_type, literal.name).facts.get(literal.terms)
            if (fact is None or not literal.accepts(fact, facts)) != (literal.check == "F"):
                return False
        return True

    def solve(self, facts: FactIndex, binding: Binding | None = None) -> Iterator[FactMatch]:
        """Yield the matches that extend a binding, perhaps repeatedly."""
        start = binding or {}
        bound = frozenset(start)
        order = self._orders.get(bound)
        if order is None:
            order = self._orders[bound] = self._order(bound)
        return self._solve(order, 0, start, (), facts)

    def _solve(
        self,
        order: tuple[int, ...],
        depth: int,
        binding: Binding,
        read: tuple[tuple[int, Fact], ...],
        facts: FactIndex,
    ) -> Iterator[FactMatch]:
        if depth == len(order):
            fluents = tuple(fact for _, fact in sorted(read, key=lambda item: item[0]))
            yield FactMatch(tuple((name, binding[name]) for name in self.variables), fluents)
            return
        number = order[depth]
        literal = self.literals[number]
        if literal.check == "F":
            if next(literal.rows(binding, facts), None) is None:
                yield from self._solve(order, depth + 1, binding, read, facts)
            return
        for fact, found in literal.rows(binding, facts):
            if literal.accepts(fact, facts):
                seen = (*read, (number, fact)) if literal.pddl_type == FLUENT else read
                yield from self._solve(order, depth + 1, found, seen, facts)

    def _order(self, bound: frozenset[str]) -> tuple[int, ...]:
        """Order the literals: lookups first, those with most candidates last."""
        left, order = list(range(len(self.literals))), []

        def cost(number: int) -> tuple[object, ...]:
            literal = self.literals[number]
            free = len(literal.names() - bound)
            if literal.check == "F" and free:
                return 2, number
            known = len(literal.constants) + sum(name in bound for _, name in literal.variables)
            return bool(free), not known, literal.pddl_type == INSTANCE, -known, number

        while left:
            number = min(left, key=cost)
            left.remove(number)
            order.append(number)
            bound |= self.literals[number].names()
        return tuple(order)


def clauses_of(dnf: Dnf, domain: PddlDomain, also: Iterable[CompiledCondition] = ()) -> tuple[CompiledClause, ...]:
    """Compile the conjunctions of a DNF, except those that can never hold; ``also`` binds further variables."""
    conjunctions = dnf.clauses or (FactConjunction(),)
    return tuple(
        _clause(conjunction, domain, tuple(also))
        for conjunction in conjunctions
        if not any(map(mismatch, conjunction.literals))
    )


def each_of(name: str, kinds: tuple[str, ...]) -> CompiledCondition:
    """Return a condition that binds a variable to each instance of some types."""
    return CompiledCondition("EX", INSTANCE, "", (f"{{{name}}}",), kind=kinds if OBJECT not in kinds else ())


def _clause(conjunction: FactConjunction, domain: PddlDomain, also: tuple[CompiledCondition, ...]) -> CompiledClause:
    literals = [_literal(condition) for condition in conjunction.literals]
    bound = {name for literal in literals if literal.check != "F" for name in literal.names()}
    for literal in list(literals):
        signature = domain.predicates.get(literal.name)
        for position, name in literal.variables:
            if name not in bound:
                parameters = signature.parameters if signature else ()
                kinds = parameters[position].types if position < len(parameters) else (OBJECT,)
                literals.append(each_of(name, kinds))
    bound = {name for literal in literals for name in literal.names()}
    literals += [literal for literal in also if not literal.names() & bound]
    return CompiledClause(tuple(literals), tuple(sorted({name for literal in literals for name in literal.names()})))


def _literal(condition: FactCondition) -> CompiledCondition:
    fact, check = condition.condition_to_check, condition.check
    if fact.pddl_type == INSTANCE:
        return CompiledCondition(check, INSTANCE, "", (fact.name,), kind=(fact.type,) if fact.type else ())
    return CompiledCondition(check, fact.pddl_type, fact.name, fact.params, fact.value)
