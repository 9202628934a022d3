"""Facts of a planning domain, stored as beliefs of the engine.

Rules, plans and sensors of the engine may change them:

| fact | belief of the engine |
|---|---|
| instance ``box_a - box`` | ``instance(box_a, box)`` |
| predicate ``(on box_a base_1)`` | ``on(box_a, base_1)`` |
| fluent ``(stacked base_1) = 2`` | ``stacked(base_1, 2)`` |

Objects are of type `Atom`. An object has one type and a fluent one value: a new one replaces the old one.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from socialbot.bdi import Atom, Engine
from socialbot.bdi.literals import SELF, source_notes
from socialbot.core.errors import PlanningError
from socialbot.deliberation._fact_index import FactIndex, has_wildcards, near, signature_of
from socialbot.deliberation._matching import clauses_of, fitting, mismatch
from socialbot.deliberation.messages import (
    FLUENT,
    INSTANCE,
    LONGEST_S,
    PREDICATE,
    Desire,
    Dnf,
    Fact,
    FactCondition,
    FactConjunction,
)
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.formulas import (
    And,
    Comparator,
    Fluent,
    Formula,
    Not,
    Number,
    NumericComparison,
    Or,
    Predicate,
)
from socialbot.planning.pddl.state import Derivation

Watcher = Callable[[Fact, bool, str], object]
"""Callback with a fact, whether it holds now, and the trace record of the change."""

OnBelief = Callable[[tuple[Any, ...], bool, str], None]

COMPARATORS: dict[str, Comparator] = {"EQ": "=", "GR": ">", "GREQ": ">=", "LE": "<", "LEQ": "<="}


class FactBase(FactIndex):
    """Facts of an engine in its planning domain. Call all methods in the thread of the engine.

    An unknown object becomes an instance of the type in the signature, and of a sub-type if another fact requires it.
    Facts about a deleted object are deleted. Derived predicates hold and are reported to watchers, but are neither
    beliefs of the engine nor part of `facts`.
    """

    def __init__(self, engine: Engine, domain: PddlDomain) -> None:
        super().__init__(domain)
        self.engine = engine
        self._watchers: tuple[Watcher, ...] = ()
        self._assumed: set[str] = set()
        self._unreported: deque[tuple[Fact, bool, str]] = deque()
        self._reporting = False
        self._derivation = Derivation(domain) if domain.derived else None
        self.test = functools.lru_cache(512)(self._test)
        """Return a cached test whether a DNF holds; equal DNFs share their results until facts change."""
        handlers: dict[str, OnBelief] = {_KEY_OF_INSTANCES: self._on_instance}
        for values, signatures in ((0, domain.predicates), (1, domain.functions)):
            for name, signature in signatures.items():
                key = f"{name}/{len(signature.parameters) + values}"
                if key in handlers:
                    raise PlanningError(
                        f"{name!r} would be the same belief as another name of the domain",
                        where=domain.where or domain.name,
                        remedy="choose another name; instance(name, type) is taken",
                    )
                handlers[key] = functools.partial(self._on_named, name, bool(values))
        for key, handler in handlers.items():
            engine.beliefs.watch(key, handler)
            for args, (_, _, cause) in list(engine.beliefs.relation(key).facts.items()):
                handler(args, True, cause)
        self._derive("")
        self._unreported.clear()

    def add(self, fact: Fact, *, source: str = "self", cause: str = "") -> bool:
        """Add a fact; return True if it is new. Raises PlanningError if it does not fit the domain (`unfit`)."""
        reason = self.unfit(fact)
        if reason is not None:
            raise PlanningError(reason, where=self.domain.name)
        if self._derives(fact):
            self._record_invalid(str(fact), "it is a derived predicate and cannot be believed by itself", cause)
            return False
        before = self.current(fact)
        if fact.pddl_type == INSTANCE and not fact.type:
            return False
        self.engine.beliefs.add(self._relation(fact), _args(fact), source_notes(source), cause)
        if fact.pddl_type == INSTANCE:
            self._assumed.discard(fact.name)
        return self.current(fact) != before

    def remove(self, fact: Fact, cause: str = "") -> tuple[Fact, ...]:
        """Delete and return all facts with this name and parameters, which may have wildcards."""
        found = tuple(held for held in fitting(fact, self) if not self._derives(held))
        for held in found:
            self._forget(held, cause)
        return found

    def check(self, condition: FactCondition) -> bool:
        """Return whether a condition holds; it may have wildcards ``*`` and ``?``, and variables ``{x}``."""
        return self.satisfied(Dnf(clauses=(FactConjunction(literals=(condition,)),)))

    def satisfied(self, dnf: Dnf) -> bool:
        return self.test(dnf)()

    def _test(self, dnf: Dnf) -> Callable[[], bool]:
        clauses, version, result = clauses_of(dnf, self.domain), -1, False

        def holds() -> bool:
            nonlocal version, result
            if version != self.version:
                version, result = self.version, False
                for clause in clauses:  # no generator, for speed
                    if clause.holds(self):
                        result = True
                        break
            return result

        return holds

    def fulfilled(self, desire: Desire) -> bool:
        """Return whether all conditions of a desire hold, with known objects only."""
        return self.achieved(desire)()

    def achieved(self, desire: Desire) -> Callable[[], bool]:
        """Return a cached form of `fulfilled`."""
        test = self.test(Dnf(clauses=(FactConjunction(literals=desire.wanted),)))
        # A negated condition about an unknown object is not achieved: the name may be wrong.
        absent = tuple(
            check
            for check in desire.wanted
            if check.check == "F" and not any(map(has_wildcards, check.condition_to_check.params))
        )
        return lambda: test() and not any(map(self.unknown_condition, absent))

    def unknown_condition(self, condition: FactCondition) -> str | None:
        """Return why a ground condition does not fit the known objects; None if it does."""
        fact = condition.condition_to_check
        if fact.pddl_type == INSTANCE and not self.kinds(fact.name):
            return f"there is no object {fact.name!r}; {near(fact.name, self.objects())}"
        return mismatch(condition) or self.unknown(fact)

    def goal(self, wanted: Iterable[FactCondition]) -> And:
        """Return conditions as a formula; the existence of instances is evaluated now, as no plan changes it."""
        return And(tuple(self._formula(condition) for condition in wanted))

    def problem(self, goal: Formula | None = None) -> PddlProblem:
        """Return the current facts and objects as a planning problem."""
        return problem_of(self.facts(), self.domain, goal)

    def watch(self, watcher: Watcher) -> None:
        """Call a watcher for each change. Its own changes of facts are reported after the current one."""
        self._watchers = (*self._watchers, watcher)

    def _may_be(self, name: str, types: tuple[str, ...]) -> bool:
        if self.fits(name, types):
            return True
        return name in self._assumed and any(self.domain.is_a(kind, self.kinds(name)[0]) for kind in types)

    def _relation(self, fact: Fact) -> Any:
        if fact.pddl_type == INSTANCE:
            return self.engine.beliefs.relation(_KEY_OF_INSTANCES)
        return self.engine.beliefs.relation(f"{fact.name}/{len(fact.params) + (fact.pddl_type == FLUENT)}")

    def _formula(self, condition: FactCondition) -> Formula:
        fact, check = condition.condition_to_check, condition.check
        if check == "EX":
            return And() if self.check(condition) else Or()
        if check in COMPARATORS:
            return NumericComparison(COMPARATORS[check], Fluent(fact.name, fact.params), Number(fact.value))
        predicate = Predicate(fact.name, fact.params)
        return predicate if check == "T" else Not(predicate)

    def _on_instance(self, args: tuple[Any, ...], held: bool, cause: str) -> None:
        names = _names(args)
        if names is None or names[0] in self.domain.constants:
            return
        fact = Fact(name=names[0], pddl_type=INSTANCE, type=names[1])
        before = self.current(fact)
        if not held:
            if before == fact:
                self._take(fact)
                self._assumed.discard(fact.name)
                self._report(fact, False, cause)
                for other in self.mentioning(fact.name):
                    self._forget(other, cause)
            return
        if self._is_invalid(args, fact, cause) or before == fact:
            return
        if before is not None and (not fact.type or self.domain.is_a(before.type, fact.type)):
            self.engine.beliefs.forget_one(self._relation(fact), args, cause)
            return
        self._put(fact)
        self._assumed.discard(fact.name)
        if before is not None:
            self._forget(before, cause)
        self._report(fact, True, cause)

    def _on_named(self, name: str, is_fluent: bool, args: tuple[Any, ...], held: bool, cause: str) -> None:
        """Apply a change of a belief about a predicate or function."""
        params, fact = _names(args[:-1] if is_fluent else args), None
        if params is not None and not is_fluent:
            fact = Fact(name=name, params=params)
        elif params is not None and isinstance(args[-1], (int, float)) and not isinstance(args[-1], bool):
            fact = Fact(name=name, pddl_type=FLUENT, params=params, value=float(args[-1]))
        before = fact and self.current(fact)
        if not held:
            # Another value has taken its place, where this is not the one that is known.
            if fact is not None and before == fact:
                self._take(fact)
                self._report(fact, False, cause)
        elif not self._is_invalid(args, fact, cause, name):
            assert fact is not None
            self._assume(fact, cause)
            self._put(fact)
            if before is not None and before != fact:
                self._forget(before, cause)
            self._report(fact, True, cause)

    def _forget(self, fact: Fact, cause: str) -> None:
        self.engine.beliefs.forget_one(self._relation(fact), _args(fact), cause)

    def _is_invalid(self, args: tuple[Any, ...], fact: Fact | None, cause: str, name: str = "instance") -> bool:
        """Return whether a belief is no valid fact, and record that."""
        if fact is None:
            reason = "its objects have to be atoms, and the value of a fluent a number"
        elif self._derives(fact):
            reason = "it is a derived predicate and cannot be believed by itself"
        else:
            reason = self.unfit(fact)
        if reason is not None:
            self._record_invalid(f"{name}({', '.join(map(str, args))})", reason, cause)
        return reason is not None

    def _record_invalid(self, what: str, reason: str, cause: str) -> None:
        self.engine.trace.record("failure", what, cause, reason="no_fact", message=reason)

    def _derives(self, fact: Fact) -> bool:
        return fact.pddl_type == PREDICATE and fact.name in self.domain.derived

    def _derive(self, cause: str) -> None:
        if self._derivation is None:
            return
        now = {Fact(name=predicate.name, params=predicate.terms) for predicate in self._derivation.derived(self)}
        before = {fact for name in self.domain.derived for fact in self.table(PREDICATE, name).facts.values()}
        for fact in sorted(before ^ now, key=lambda fact: fact.identity):
            if fact in now:
                self._put(fact)
            else:
                self._take(fact)
            self._unreported.append((fact, fact in now, cause))

    def _assume(self, fact: Fact, cause: str) -> None:
        """Add instances for unknown objects, or with the narrower type of the signature."""
        signature, _ = signature_of(self.domain, fact)
        assert signature is not None
        for name, parameter in zip(fact.params, signature.parameters, strict=True):
            if not self.fits(name, parameter.types):
                known = self.kinds(name)
                kind = next(kind for kind in parameter.types if not known or self.domain.is_a(kind, known[0]))
                instance = Fact(name=name, pddl_type=INSTANCE, type=kind)
                self.engine.beliefs.add(self._relation(instance), _args(instance), SELF, cause)
                self._assumed.add(name)

    def _report(self, fact: Fact, held: bool, cause: str) -> None:
        self._unreported.append((fact, held, cause))
        self._derive(cause)
        if self._reporting:
            return
        self._reporting = True
        while self._unreported:
            change = self._unreported.popleft()
            for watcher in self._watchers:
                try:
                    watcher(*change)
                except Exception as problem:  # noqa: BLE001 - user code
                    self.engine.trace.record_failure(f"watching {change[0]}", change[2], problem)
        self._reporting = False


def problem_of(facts: Iterable[Fact], domain: PddlDomain, goal: Formula | None) -> PddlProblem:
    """Return facts, including instances, as a planning problem."""
    by_type: dict[int, list[Fact]] = {INSTANCE: [], PREDICATE: [], FLUENT: []}
    for fact in facts:
        by_type[fact.pddl_type].append(fact)
    return PddlProblem(
        name="beliefs",
        domain=domain.name,
        objects={fact.name: (fact.type,) for fact in by_type[INSTANCE]},
        facts=frozenset(Predicate(fact.name, fact.params) for fact in by_type[PREDICATE]),
        values={Fluent(fact.name, fact.params): fact.value for fact in by_type[FLUENT]},
        goal=goal,
    )


def out_of_range(desire: Desire) -> str | None:
    """Return why the priority or deadline of a desire is invalid; None if it is not."""
    if not 0.0 <= desire.priority <= 1.0:
        return f"the priority {desire.priority:g} is out of range; give a number from 0 to 1"
    if not 0.0 <= desire.deadline <= LONGEST_S:
        return f"the deadline {desire.deadline:g} is out of range; give seconds from 0 to {LONGEST_S:g}"
    return None


_KEY_OF_INSTANCES = "instance/2"


def _names(args: tuple[Any, ...]) -> tuple[str, ...] | None:
    names = tuple(arg.name for arg in args if isinstance(arg, Atom))
    return names if len(names) == len(args) else None


def _args(fact: Fact) -> tuple[Any, ...]:
    """Return the arguments of the belief for a fact."""
    if fact.pddl_type == INSTANCE:
        return Atom(fact.name), Atom(fact.type)
    objects = tuple(map(Atom, fact.params))
    if fact.pddl_type == PREDICATE:
        return objects
    whole = fact.value == int(fact.value)
    return (*objects, int(fact.value) if whole else fact.value)
