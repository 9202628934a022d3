"""Index of facts by name and object, name patterns, and facts as text."""

from __future__ import annotations

import difflib
import functools
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from socialbot.core.errors import PlanningError
from socialbot.deliberation.messages import FLUENT, INSTANCE, PREDICATE, Fact
from socialbot.planning.pddl.domain import OBJECT, PddlDomain, Signature
from socialbot.planning.pddl.formulas import Fluent, Predicate

_VARIABLE = re.compile(r"\{(\w+)\}")


def has_wildcards(name: str) -> bool:
    return "*" in name or "?" in name


@functools.lru_cache(4096)
def like(pattern: str) -> Callable[[str], object]:
    """Return a matcher for a pattern with wildcards."""
    parts = (".*" if letter == "*" else "." if letter == "?" else re.escape(letter) for letter in pattern)
    return re.compile("".join(parts)).fullmatch


def variable_of(name: str) -> str | None:
    found = _VARIABLE.fullmatch(name)
    return found[1] if found else None


def variables_in(text: str) -> list[str]:
    return _VARIABLE.findall(text)


def filled(text: str, binding: Mapping[str, str]) -> str:
    return _VARIABLE.sub(lambda found: binding[found[1]], text)


Params = tuple[str, ...]

KINDS = {INSTANCE: "an instance", PREDICATE: "a predicate", FLUENT: "a function"}

_NAME = re.compile(r"[a-z][a-z0-9_-]*\Z")


class FactTable:
    """Facts of one name by their parameters; for instances, the parameter is their name."""

    __slots__ = ("_by", "facts")

    def __init__(self) -> None:
        self.facts: dict[Params, Fact] = {}
        self._by: dict[tuple[int, str], dict[Params, None]] = {}

    def put(self, params: Params, fact: Fact) -> None:
        if params not in self.facts:
            for place in enumerate(params):
                self._by.setdefault(place, {})[params] = None
        self.facts[params] = fact

    def take(self, params: Params) -> Fact | None:
        fact = self.facts.pop(params, None)
        if fact is not None:
            for place in enumerate(params):
                del self._by[place][params]
                if not self._by[place]:
                    del self._by[place]
        return fact

    def among(self, known: Iterable[tuple[int, str]]) -> Mapping[Params, object]:
        """Return a superset of the parameters of facts with ``known`` objects at some positions."""
        best: Mapping[Params, object] = self.facts
        for place in known:
            found = self._by.get(place)
            if found is None:
                return {}
            if len(found) < len(best):
                best = found
        return best


_EMPTY = FactTable()


class FactIndex:
    """Indexed facts of a domain; a `PddlWorld`. Constants are instances, and ``version`` increases with each change."""

    def __init__(self, domain: PddlDomain, facts: Iterable[Fact] = ()) -> None:
        self.domain = domain
        self._tables: dict[int, dict[str, FactTable]] = {INSTANCE: {"": FactTable()}, PREDICATE: {}, FLUENT: {}}
        self._objects: dict[tuple[str, ...], tuple[str, ...]] = {}
        self._sorted: tuple[Fact, ...] | None = None
        self.version = 0
        for name, kinds in domain.constants.items():
            self._put(Fact(name=name, pddl_type=INSTANCE, type=kinds[0]))
        for fact in facts:
            self._put(fact)

    def holds(self, predicate: Predicate) -> bool:
        return predicate.terms in self.table(PREDICATE, predicate.name).facts

    def value(self, fluent: Fluent) -> float | None:
        fact = self.table(FLUENT, fluent.name).facts.get(fluent.terms)
        return None if fact is None else fact.value

    def objects(self, types: tuple[str, ...] = (OBJECT,)) -> tuple[str, ...]:
        """Return the objects of any of these types or of a sub-type, sorted by name."""
        found = self._objects.get(types)
        if found is None:
            names = (name for (name,) in self.table(INSTANCE).facts if self.fits(name, types))
            found = self._objects[types] = tuple(sorted(names))
        return found

    def kinds(self, name: str) -> tuple[str, ...]:
        """Return the declared types of an object; none if it is unknown."""
        constant = self.domain.constants.get(name)
        if constant is not None:
            return constant
        fact = self.table(INSTANCE).facts.get((name,))
        return () if fact is None else (fact.type,)

    def fits(self, name: str, types: tuple[str, ...]) -> bool:
        is_a = self.domain.is_a
        return any(is_a(kind, wanted) for kind in self.kinds(name) for wanted in types)

    def facts(self) -> tuple[Fact, ...]:
        """Return all facts, sorted, without constants and derived predicates."""
        if self._sorted is None:
            left_out = {INSTANCE: self.domain.constants, PREDICATE: self.domain.derived, FLUENT: {}}
            found = (
                fact
                for tables in self._tables.values()
                for table in tables.values()
                for fact in table.facts.values()
                if fact.name not in left_out[fact.pddl_type]
            )
            self._sorted = tuple(sorted(found, key=lambda fact: fact.identity))
        return self._sorted

    def table(self, pddl_type: int, name: str = "") -> FactTable:
        """Return the facts of a name; that of instances is empty."""
        return self._tables[pddl_type].get(name, _EMPTY)

    def names(self, pddl_type: int) -> Iterator[str]:
        """Return the names of present and past facts."""
        return iter(self._tables[pddl_type])

    def mentioning(self, name: str) -> list[Fact]:
        """Return the predicates and fluents about an object, sorted."""
        found: dict[Fact, None] = {}
        for pddl_type in (PREDICATE, FLUENT):
            for table in self._tables[pddl_type].values():
                arity = len(next(iter(table.facts), ()))
                for position in range(arity):
                    for params in table.among(((position, name),)):
                        if params[position] == name:
                            found[table.facts[params]] = None
        return sorted(found, key=lambda fact: fact.identity)

    def unknown(self, fact: Fact) -> str | None:
        """Return why a fact does not fit the domain and its known objects; None if it does."""
        reason = self.unfit(fact)
        if reason is not None or fact.pddl_type == INSTANCE:
            return reason
        for name in fact.params:
            if not self.kinds(name):
                return f"{fact}: there is no object {name!r}; {near(name, self.objects())}"
        return None

    def unfit(self, fact: Fact) -> str | None:
        """Return why a fact does not fit the domain; new objects are allowed."""
        if fact.pddl_type == INSTANCE:
            return self._unfit_instance(fact)
        signature, reason = signature_of(self.domain, fact)
        if signature is None:
            return reason
        is_a, asked = self.domain.is_a, {}
        for name, parameter in zip(fact.params, signature.parameters, strict=True):
            reason = self._misplaced(name, parameter.types)
            before = asked.setdefault(name, parameter.types)
            settled = reason or self.fits(name, parameter.types)
            pairs = itertools.product(before, parameter.types)
            if not settled and not any(is_a(one, two) or is_a(two, one) for one, two in pairs):
                reason = f"{name} cannot be both a {'|'.join(before)} and a {'|'.join(parameter.types)}"
            if reason is not None:
                return f"{fact}: {reason}"
        return _no_number(fact)

    def unfit_pattern(self, fact: Fact) -> str | None:
        """Return why a fact with wildcards or variables can never match; None if it can."""
        plain = [term for term in (fact.name, *fact.params) if not (has_wildcards(term) or variables_in(term))]
        if fact.pddl_type == INSTANCE:
            if fact.type and fact.type not in self.domain.types:
                return f"{fact.name}: there is no type {fact.type!r}; {near(fact.type, self.domain.types)}"
            return next(filter(None, map(misnamed, plain)), None)
        if fact.name not in plain:
            known = self.domain.functions if fact.pddl_type == FLUENT else self.domain.predicates
            arities = (len(signature.parameters) for name, signature in known.items() if like(fact.name)(name))
            if len(fact.params) not in arities:
                return f"no {KINDS[fact.pddl_type].split()[1]} is like {fact}; {near(fact.name, known)}"
            return next(filter(None, map(misnamed, plain)), None)
        signature, reason = signature_of(self.domain, fact)
        for name, parameter in zip(fact.params, signature.parameters if signature else (), strict=False):
            misplaced = self._misplaced(name, parameter.types) if name in plain else None
            reason = reason or (misplaced and f"{fact}: {misplaced}")
        return reason or _no_number(fact)

    def _misplaced(self, name: str, types: tuple[str, ...]) -> str | None:
        kinds = self.kinds(name)
        if not kinds:
            return misnamed(name)
        return None if self._may_be(name, types) else f"{name} is a {'|'.join(kinds)}, not a {'|'.join(types)}"

    def _unfit_instance(self, fact: Fact) -> str | None:
        is_a, kinds = self.domain.is_a, self.kinds(fact.name)
        if not fact.type:
            return None if kinds else f"{fact.name}: its type is missing"
        if fact.type not in self.domain.types:
            return f"{fact.name}: there is no type {fact.type!r}; {near(fact.type, self.domain.types)}"
        if not kinds:
            return misnamed(fact.name)
        if any(is_a(kind, fact.type) for kind in kinds) or self._may_be(fact.name, (fact.type,)):
            return None
        return f"{fact.name} is a {'|'.join(kinds)}, not a {fact.type}"

    def _may_be(self, name: str, types: tuple[str, ...]) -> bool:
        return self.fits(name, types)

    def current(self, fact: Fact) -> Fact | None:
        """Return the current fact of the same type, name and parameters, or None."""
        name, params = _place(fact)
        return self.table(fact.pddl_type, name).facts.get(params)

    def _put(self, fact: Fact) -> None:
        name, params = _place(fact)
        self._tables[fact.pddl_type].setdefault(name, FactTable()).put(params, fact)
        self._changed(fact)

    def _take(self, fact: Fact) -> Fact | None:
        name, params = _place(fact)
        self._changed(fact)
        return self.table(fact.pddl_type, name).take(params)

    def _changed(self, fact: Fact) -> None:
        if fact.pddl_type == INSTANCE:
            self._objects.clear()
        self._sorted = None
        self.version += 1


def _place(fact: Fact) -> tuple[str, Params]:
    """Return the name of the table of a fact, and its key there."""
    return ("", (fact.name,)) if fact.pddl_type == INSTANCE else (fact.name, fact.params)


def signature_of(domain: PddlDomain, fact: Fact) -> tuple[Signature | None, str | None]:
    """Return the signature of a predicate or fluent, or why the fact does not match it."""
    mine, other = domain.predicates, domain.functions
    if fact.pddl_type == FLUENT:
        mine, other = other, mine
    signature = mine.get(fact.name)
    if signature is None and fact.name in other:
        swapped = FLUENT if fact.pddl_type == PREDICATE else PREDICATE
        return None, f"{fact.name!r} is {KINDS[swapped]}; its pddl_type is {swapped}"
    if signature is None:
        word = KINDS[fact.pddl_type].split()[1]
        return None, f"there is no {word} {fact.name!r}; {near(fact.name, mine)}"
    if len(fact.params) != len(signature.parameters):
        number = len(signature.parameters)
        plural = "" if number == 1 else "s"
        return None, f"({' '.join((fact.name, *fact.params))}): {signature} has {number} parameter{plural}"
    return signature, None


def _no_number(fact: Fact) -> str | None:
    return None if math.isfinite(fact.value) else f"{fact}: no number"


def misnamed(name: str) -> str | None:
    """Return why a name is invalid in PDDL; None if it is valid."""
    if _NAME.match(name):
        return None
    return f"{name!r} is no name: it needs a small letter, then small letters, digits, _ and -"


def near(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown name."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    if not names:
        return "there are none"
    return f"there are {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"


_FACT_NAME = r"[a-z][\w-]*"
_OBJECT = r"[\w?*{}.-]+"
_FORM = re.compile(
    rf"\(\s*(?P<name>{_FACT_NAME})(?P<params>(?:\s+{_OBJECT})*)\s*\)(?:\s*=\s*(?P<value>\S+))?"
    rf"|(?P<object>{_OBJECT})\s+-\s+(?P<type>{_FACT_NAME})"
)


def parse_facts(text: str) -> tuple[Fact, ...]:
    """Parse one or more facts, written as ``str(fact)``. Raises PlanningError."""
    text = text.strip().lower()
    found: list[Fact] = []
    while text or not found:
        form = _FORM.match(text)
        if form is None:
            remedy = "write (at box1 table), (battery r1) = 80, or box1 - box"
            raise PlanningError(f"{text or 'nothing'!r} is no fact", remedy=remedy)
        found.append(_fact(form))
        text = text[form.end() :].lstrip()
    return tuple(found)


def parse_fact(text: str) -> Fact:
    """Parse one fact. Raises PlanningError."""
    fact, *more = parse_facts(text)
    if more:
        raise PlanningError(f"{text!r} is more than one fact", remedy="give one at a time")
    return fact


def _fact(form: re.Match[str]) -> Fact:
    if form["object"] is not None:
        return Fact(name=form["object"], pddl_type=INSTANCE, type=form["type"])
    params = tuple(form["params"].split())
    if form["value"] is None:
        return Fact(name=form["name"], pddl_type=PREDICATE, params=params)
    try:
        return Fact(name=form["name"], pddl_type=FLUENT, params=params, value=float(form["value"]))
    except ValueError as error:
        raise PlanningError(f"{form['value']!r} is no number") from error
