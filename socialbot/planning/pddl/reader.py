"""Reader of PDDL 2.1 domains and problems.

Supported are type hierarchies and ``either``, constants, functions, durative actions, negative, disjunctive and
quantified conditions, equality, conditional effects, duration inequalities, and derived predicates. Timed initial
literals, preferences, constraints and continuous effects are errors. ``:requirements`` may be incomplete.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from socialbot.planning.pddl._formula_reader import ActionReader, FormulaReader, is_number
from socialbot.planning.pddl._parser import Scope, SexpGroup, Sexpression, SexpWord, Vocabulary, read_sexpression
from socialbot.planning.pddl.domain import OBJECT, Metric, PddlAction, PddlDomain, PddlProblem, Signature
from socialbot.planning.pddl.formulas import And, Equality, Fluent, Formula, Or, Predicate, Quantified, TypedName
from socialbot.planning.pddl.semantics import substitute
from socialbot.planning.pddl.state import Derivation

REQUIREMENTS = frozenset({
    ":strips", ":typing", ":negative-preconditions", ":disjunctive-preconditions", ":equality",
    ":existential-preconditions", ":universal-preconditions", ":quantified-preconditions", ":conditional-effects",
    ":fluents", ":numeric-fluents", ":object-fluents", ":adl", ":durative-actions", ":duration-inequalities",
    ":continuous-effects", ":derived-predicates", ":timed-initial-literals", ":timed-initial-fluents",
    ":preferences", ":constraints", ":action-costs", ":time", ":timed-effects", ":domain-axioms", ":goal-utilities",
})  # fmt: skip
_SINGLE = (":requirements", ":types", ":constants", ":predicates", ":functions")
_REPEATED = (":action", ":durative-action", ":derived")
_OF_PROBLEMS = (":domain", ":requirements", ":objects", ":init", ":goal", ":metric", ":length")
_UNSUPPORTED = {
    ":constraints": "preferences and constraints (:constraints)",
    ":process": "continuous change (:process)",
    ":event": "events of the world (:event)",
}


def read_domain(text: str, *, where: str = "domain") -> PddlDomain:
    """Read a domain. Raises PlanningError with ``where`` and the line."""
    return _DomainReader(text, where).read()


def read_problem(text: str, domain: PddlDomain, *, where: str = "problem") -> PddlProblem:
    """Read a problem; without ``:goal`` its goal is None. Raises PlanningError with ``where`` and the line."""
    return _ProblemReader(text, domain, where).read()


def _named(names: Vocabulary, whole: SexpGroup, kind: str) -> str:
    if whole.head != "define" or not whole.rest:
        raise names.error(f"expected (define ({kind} ...) ...), found ({whole.head} ...)", whole)
    group = names.group(whole.rest[0], f"{kind} and its name")
    word = names.word(group.items, 0, kind, group)
    if word.text != kind:
        raise names.error(f"this is no {kind} but a {word}: (define {group} ...)", group)
    return names.word(group.items, 1, f"the name of the {kind}", group).text


def _sections(
    names: Vocabulary, whole: SexpGroup, single: tuple[str, ...], repeated: tuple[str, ...]
) -> list[SexpGroup]:
    """Return the sections; unknown ones and duplicates of ``single`` ones are errors."""
    sections = [names.group(item, "a section") for item in whole.rest[1:]]
    seen: set[str] = set()
    for section in sections:
        word = names.word(section.items, 0, "the name of a section", section)
        if word.text in _UNSUPPORTED:
            raise names.unsupported(_UNSUPPORTED[word.text], word)
        if word.text not in (*single, *repeated):
            raise names.unknown("section", word.text, (*single, *repeated), word)
        if word.text in seen and word.text not in repeated:
            raise names.error(f"{word} is there twice", word)
        seen.add(word.text)
    return sections


def _requirements(names: Vocabulary, section: SexpGroup) -> frozenset[str]:
    for index in range(1, len(section.items)):
        word = names.word(section.items, index, "a requirement", section)
        if word.text not in REQUIREMENTS:
            raise names.unknown("requirement", word.text, REQUIREMENTS, word)
    return frozenset(str(item) for item in section.rest)


def _objects(names: Vocabulary, section: SexpGroup) -> dict[str, tuple[str, ...]]:
    """Return the declared objects; constants of the domain may be repeated with the same type."""
    found: dict[str, tuple[str, ...]] = {}
    for word, types in names.typed_list(section.rest):
        name = names.new_name(word, "an object")
        if name in found or names.objects.get(name, types) != types:
            raise names.error(f"the object {name} is declared twice", word)
        found[name] = names.known_types(types, word)
    return found


class _DomainReader:
    def __init__(self, text: str, where: str) -> None:
        self._whole = read_sexpression(text, where=where)
        self._names = Vocabulary(where, PddlDomain("", text=text, where=where))

    def _add(self, **what: object) -> None:
        self._names.domain = replace(self._names.domain, **what)  # pyright: ignore[reportArgumentType]

    def read(self) -> PddlDomain:
        names = self._names
        self._add(name=_named(names, self._whole, "domain"))
        sections = _sections(names, self._whole, _SINGLE, _REPEATED)
        parts = {section.head: section for section in sections if section.head in _SINGLE}
        empty = SexpGroup((), self._whole.line)
        if ":requirements" in parts:
            self._add(requirements=_requirements(names, parts[":requirements"]))
        self._add(types=self._types(parts.get(":types", empty)))
        self._add(constants=_objects(names, parts.get(":constants", empty)))
        names.objects.update(names.domain.constants)
        self._add(predicates=self._signatures(parts.get(":predicates", empty).rest, "predicate"))
        self._add(functions=self._signatures(self._untyped(parts.get(":functions", empty).rest), "function"))
        self._read_derived([section for section in sections if section.head == ":derived"])
        self._add(actions=self._actions(sections))
        return names.domain

    def _types(self, section: SexpGroup) -> dict[str, tuple[str, ...]]:
        names = self._names
        listed = names.typed_list(section.rest)
        found: dict[str, tuple[str, ...]] = {OBJECT: ()}
        for word, parents in listed:
            if word.text == OBJECT:
                if parents != (OBJECT,):
                    raise names.error("object is the type of everything and has no other type", word)
                continue
            name = names.new_name(word, "a type")
            # Domains in use declare a type in two lines, or only as the parent of another type.
            found[name] = tuple(dict.fromkeys((*found.get(name, ()), *parents)))
        for word, parents in listed:
            for parent in parents:
                found.setdefault(
                    names.new_name(SexpWord(parent, word.line), "a type") if parent != OBJECT else parent, (OBJECT,)
                )
        for word, _ in listed:
            if word.text in _ancestors(word.text, found):
                raise names.error(f"the type {word} is a sub-type of itself", word)
        return found

    def _untyped(self, items: tuple[Sexpression, ...]) -> tuple[Sexpression, ...]:
        """Remove ``- number`` from a list of functions."""
        found: list[Sexpression] = []
        rest = iter(items)
        for item in rest:
            if not isinstance(item, SexpWord) or item.text != "-":
                found.append(item)
                continue
            kind = next(rest, item)
            if str(kind) != "number":
                raise self._names.unsupported(f"functions whose values are no numbers (- {kind})", item)
        return tuple(found)

    def _signatures(self, items: tuple[Sexpression, ...], what: str) -> dict[str, Signature]:
        found: dict[str, Signature] = {}
        for item in items:
            signature = self._names.signature(item, f"a {what}")
            if signature.name in found:
                raise self._names.error(f"the {what} {signature.name} is declared twice", item)
            found[signature.name] = signature
        return found

    def _read_derived(self, sections: list[SexpGroup]) -> None:
        """Read derived predicates; several rules for one predicate become a disjunction."""
        names = self._names
        rules: dict[str, list[tuple[tuple[TypedName, ...], Formula]]] = {}
        for section in sections:
            if len(section.rest) != 2:
                raise names.error(f":derived takes a predicate and a condition, not {len(section.rest)} parts", section)
            signature = names.signature(section.rest[0], "a predicate")
            declared = names.domain.predicates.get(signature.name)
            if declared is None:
                raise names.unknown("predicate", signature.name, names.domain.predicates, section.rest[0])
            if len(declared.parameters) != len(signature.parameters):
                raise names.error(f"the predicate is declared as {declared}", section.rest[0])
            for own, wanted in zip(signature.parameters, declared.parameters, strict=True):
                if not names.domain.fits(own.types, wanted.types):
                    raise names.error(f"{own.name} does not fit the predicate: {declared}", section.rest[0])
            scope = Scope().within(signature.parameters)
            rule = signature.parameters, FormulaReader(names).formula(section.rest[1], scope)
            rules.setdefault(signature.name, []).append(rule)
        derived: dict[str, tuple[tuple[TypedName, ...], Formula]] = {}
        for name, alike in rules.items():
            if len(alike) == 1:
                derived[name] = alike[0]
                continue
            wanted = names.domain.predicates[name].parameters
            parameters = tuple(TypedName(f"?#{number}", typed.types) for number, typed in enumerate(wanted))
            derived[name] = parameters, Or(tuple(_renamed(rule, parameters) for rule in alike))
        self._add(derived=derived)
        circle = Derivation(names.domain).circle
        if circle:
            at = next(section for section in sections if str(section.rest[0])[1:-1].split()[0] == circle)
            raise names.error(f"{circle} is derived from its own opposite", at)

    def _actions(self, sections: list[SexpGroup]) -> dict[str, PddlAction]:
        reader = ActionReader(self._names)
        found: dict[str, PddlAction] = {}
        for section in sections:
            if section.head not in (":action", ":durative-action"):
                continue
            action = reader.instantaneous(section) if section.head == ":action" else reader.durative(section)
            if action.name in found:
                raise self._names.error(f"the action {action.name} is there twice", section)
            found[action.name] = action
        return found


def _renamed(rule: tuple[tuple[TypedName, ...], Formula], parameters: tuple[TypedName, ...]) -> Formula:
    """Return the condition of a rule with other parameters, whose types may be wider."""
    pairs = list(zip(rule[0], parameters, strict=True))
    narrow = [(own, parameter) for own, parameter in pairs if own.types != parameter.types]
    formula = substitute(
        rule[1], {own.name: parameter.name for own, parameter in pairs if own.types == parameter.types}
    )
    if not narrow:
        return formula
    same = (Equality(own.name, parameter.name) for own, parameter in narrow)
    return Quantified("exists", tuple(own for own, _ in narrow), And((*same, formula)))


def _ancestors(name: str, types: Mapping[str, tuple[str, ...]]) -> set[str]:
    found: set[str] = set()
    waiting = list(types[name])
    while waiting:
        parent = waiting.pop()
        if parent not in found:
            found.add(parent)
            waiting.extend(types[parent])
    return found


class _ProblemReader:
    def __init__(self, text: str, domain: PddlDomain, where: str) -> None:
        self._whole = read_sexpression(text, where=where)
        self._names = Vocabulary(where, domain, dict(domain.constants))
        self._formulas = FormulaReader(self._names)
        self._problem = PddlProblem("", domain.name, text=text, where=where)

    def read(self) -> PddlProblem:
        names = self._names
        name = _named(names, self._whole, "problem")
        parts = {section.head: section for section in _sections(names, self._whole, _OF_PROBLEMS, ())}
        empty = SexpGroup((), self._whole.line)
        self._check_domain(parts.get(":domain"))
        _requirements(names, parts.get(":requirements", empty))
        objects = _objects(names, parts.get(":objects", empty))
        names.objects.update(objects)
        facts, values = self._init(parts.get(":init", empty))
        goal, metric = parts.get(":goal"), parts.get(":metric")
        if goal is not None and len(goal.rest) != 1:
            raise names.error(f":goal takes one condition, not {len(goal.rest)}", goal, "join them: (and ...)")
        return replace(
            self._problem,
            name=name,
            objects=objects,
            facts=facts,
            values=values,
            goal=self._formulas.formula(goal.rest[0], Scope()) if goal is not None else None,
            metric=self._metric(metric) if metric is not None else None,
        )

    def _check_domain(self, section: SexpGroup | None) -> None:
        names = self._names
        if section is None:
            raise names.error("the problem does not say for which domain it is", self._whole, "add (:domain ...)")
        word = names.word(section.items, 1, "the name of the domain", section)
        if word.text != names.domain.name:
            raise names.error(f"the problem is for the domain {word}, not {names.domain.name}", word)

    def _init(self, section: SexpGroup) -> tuple[frozenset[Predicate], dict[Fluent, float]]:
        names = self._names
        facts: set[Predicate] = set()
        denied: dict[Predicate, Sexpression] = {}
        values: dict[Fluent, float] = {}
        for item in section.rest:
            group = names.group(item, "a fact")
            if group.head == "=":
                fluent, value = self._value(group)
                if values.setdefault(fluent, value) != value:
                    raise names.error(f"{fluent} has two values", group)
            elif group.head == "at" and len(group.items) == 3 and is_number(group.items[1]):
                raise names.unsupported(f"timed initial literals: {group}", group)
            elif group.head == "not" and len(group.rest) == 1:
                denied[self._fact(group.rest[0])] = group
            else:
                facts.add(self._fact(group))
        for predicate, item in denied.items():
            if predicate in facts:
                raise names.error(f"{predicate} is said to be true and not to be true", item)
        return frozenset(facts), values

    def _fact(self, item: Sexpression) -> Predicate:
        predicate = self._formulas.predicate(item, Scope())
        if predicate.name in self._names.domain.derived:
            raise self._names.error(f"{predicate.name} is derived: it cannot be given", item)
        return predicate

    def _value(self, group: SexpGroup) -> tuple[Fluent, float]:
        names = self._names
        left, right = self._formulas.pair(group)
        if not is_number(right):
            raise names.error(f"expected a number, found {right}", right)
        value = float(str(right))
        if not math.isfinite(value):
            raise names.error(f"{right} is too large a number", right)
        return self._formulas.fluent(left, Scope()), value

    def _metric(self, section: SexpGroup) -> Metric:
        names = self._names
        direction = names.word(section.items, 1, "minimize or maximize", section)
        if direction.text not in ("minimize", "maximize") or len(section.items) != 3:
            raise names.error(
                f"expected minimize or maximize and one expression: {section}",
                section,
                "(:metric minimize (total-time))",
            )
        names.domain = replace(
            names.domain, functions={"total-time": Signature("total-time"), **names.domain.functions}
        )
        return Metric(direction.text, self._formulas.expression(section.items[2], Scope()))  # pyright: ignore[reportArgumentType]
