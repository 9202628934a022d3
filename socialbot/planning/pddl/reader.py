"""Reader of PDDL 2.1 domains and problems.

Files are read as planners read them: requirements may be incomplete or unknown, sections and declarations may be
repeated, and ``:vars`` are further parameters. Supported are type hierarchies and ``either``, constants, functions,
durative actions, negative, disjunctive and quantified conditions, equality, conditional effects, duration inequalities,
derived predicates, and timed initial literals and fluents. Preferences, constraints and continuous effects are errors.
The function ``(total-cost)`` is 0 at the start unless the problem says otherwise.
"""

from __future__ import annotations

import graphlib
from dataclasses import replace

from socialbot.planning.pddl._formula_reader import NO_PREFERENCES, FormulaReader
from socialbot.planning.pddl._parser import (
    NUMBER,
    TOKEN,
    Scope,
    SexpGroup,
    Sexpression,
    SexpWord,
    Vocabulary,
    is_number,
    read_sexpression,
    spaced,
)
from socialbot.planning.pddl.domain import (
    OBJECT,
    TOTAL_TIME,
    Metric,
    PddlAction,
    PddlDomain,
    PddlProblem,
    Signature,
    TimedInitialEffect,
)
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    Delete,
    Equality,
    Fluent,
    Formula,
    Number,
    NumericEffect,
    Or,
    Predicate,
    Quantified,
    TypedName,
    number_text,
)
from socialbot.planning.pddl.semantics import instance_count, substitute
from socialbot.planning.pddl.state import Derivation, PddlState

REQUIREMENTS = frozenset({
    ":strips", ":typing", ":negative-preconditions", ":disjunctive-preconditions", ":equality",
    ":existential-preconditions", ":universal-preconditions", ":quantified-preconditions", ":conditional-effects",
    ":fluents", ":numeric-fluents", ":object-fluents", ":adl", ":durative-actions", ":duration-inequalities",
    ":continuous-effects", ":derived-predicates", ":timed-initial-literals", ":timed-initial-fluents",
    ":preferences", ":constraints", ":action-costs", ":time", ":timed-effects", ":domain-axioms", ":goal-utilities",
})  # fmt: skip
_OF_DOMAINS = (
    ":requirements", ":types", ":constants", ":predicates", ":functions", ":action", ":durative-action", ":derived",
)  # fmt: skip
_OF_PROBLEMS = (":domain", ":requirements", ":objects", ":init", ":goal", ":metric", ":length")
_ONCE = (":domain", ":goal", ":metric", ":length")
_IN_PROBLEM = "write the facts into :init of the problem"
_UNSUPPORTED = {
    ":constraints": ("preferences and constraints (:constraints)", NO_PREFERENCES),
    ":constraint": ("constraints of PDDL+ (:constraint)", "write it as a precondition of the actions"),
    ":process": ("continuous change (:process)", "write the whole change as an effect of a durative action"),
    ":event": ("events of the world (:event)", "write (at TIME ...) into :init, or plan again after the event"),
    ":axiom": ("axioms of PDDL 1.2 (:axiom)", "write it as (:derived (NAME ...) CONDITION)"),
    ":extends": ("domains that extend others (:extends)", "copy what the other domain declares into this one"),
    ":safety": ("safety constraints of PDDL 1.2 (:safety)", "write it as a precondition of the actions"),
    ":situation": ("situations of PDDL 1.2 (:situation)", _IN_PROBLEM),
    ":timeless": ("facts of PDDL 1.2 in domains (:timeless)", _IN_PROBLEM),
}

MAX_INSTANCES, MAX_CHANGES = 10_000_000, 1_000_000
"""Largest number of ground parts of a condition, and of an effect: some seconds, and some hundred MB."""

_TOTAL_COST = Fluent("total-cost")


def read_domain(text: str, *, where: str = "domain") -> PddlDomain:
    """Read a domain. Raises PlanningError with ``where`` and the line."""
    return _DomainReader(text, where).read()


def read_problem(text: str, domain: PddlDomain, *, where: str = "problem") -> PddlProblem:
    """Read a problem; without ``:goal`` its goal is None. Raises PlanningError with ``where`` and the line."""
    return _ProblemReader(text, domain, where).read(text, where)


class _FileReader:
    """The name and sections of a file, and the declarations that domains and problems have in common."""

    def __init__(self, text: str, domain: PddlDomain, where: str) -> None:
        self._whole = read_sexpression(text, where=where)
        self._names = Vocabulary(where, domain, dict(domain.constants))
        self._formulas = FormulaReader(self._names)

    def _section(self, sections: list[SexpGroup], name: str) -> SexpGroup:
        """Return the section of a name: empty if there is none, joined if there are several."""
        first, *more = [section for section in sections if section.head == name] or [SexpGroup((), self._whole.line)]
        return SexpGroup(first.items + tuple(item for section in more for item in section.rest), first.line)

    def _name(self, kind: str) -> str:
        names, whole = self._names, self._whole
        if whole.head != "define" or not whole.rest:
            raise names.error(f"expected (define ({kind} ...) ...), found ({whole.head} ...)", whole)
        group = names.group(whole.rest[0], f"{kind} and its name")
        word = names.word(group.items, 0, kind, group)
        if word.text != kind:
            raise names.error(f"this is no {kind} but a {word}: (define {group} ...)", group)
        return names.word(group.items, 1, f"the name of the {kind}", group).text

    def _sections(self, known: tuple[str, ...]) -> list[SexpGroup]:
        """Return the sections; unknown ones and duplicates of those in `_ONCE` are errors."""
        names = self._names
        sections = [names.group(item, "a section") for item in self._whole.rest[1:]]
        seen: set[str] = set()
        for section in sections:
            word = names.word(section.items, 0, "the name of a section", section)
            if word.text in _UNSUPPORTED:
                what, remedy = _UNSUPPORTED[word.text]
                raise names.unsupported(what, word, remedy)
            if word.text not in known:
                raise names.unknown("section", word.text, known, word)
            if word.text in seen and word.text in _ONCE:
                raise names.error(f"{word} is there twice", word)
            seen.add(word.text)
        return sections

    def _requirements(self, section: SexpGroup) -> frozenset[str]:
        for index in range(1, len(section.items)):
            word = self._names.word(section.items, index, "a requirement", section)
            if not word.text.startswith(":"):
                raise self._names.unknown("requirement", word.text, REQUIREMENTS, word)
        return frozenset(map(str, section.rest))

    def _objects(self, section: SexpGroup) -> dict[str, tuple[str, ...]]:
        """Declare objects; one that is declared several times, perhaps as a constant, belongs to all its types."""
        names, found = self._names, {}
        for word, types in names.typed_list(section.rest):
            name = names.new_name(word, "an object")
            known = found.get(name, names.objects.get(name, ()))
            found[name] = tuple(dict.fromkeys((*known, *names.known_types(types, word))))
        names.objects.update(found)
        return found


class _DomainReader(_FileReader):
    def __init__(self, text: str, where: str) -> None:
        super().__init__(text, PddlDomain("", text=text, where=where), where)

    def _add(self, **what: object) -> None:
        self._names.domain = replace(self._names.domain, **what)  # pyright: ignore[reportArgumentType]

    def read(self) -> PddlDomain:
        self._add(name=self._name("domain"))
        sections = self._sections(_OF_DOMAINS)
        self._add(requirements=self._requirements(self._section(sections, ":requirements")))
        self._add(types=self._types(self._section(sections, ":types")))
        self._add(constants=self._objects(self._section(sections, ":constants")))
        self._add(predicates=self._signatures(self._section(sections, ":predicates").rest, "predicate"))
        functions = self._untyped(self._section(sections, ":functions").rest)
        self._add(functions=self._signatures(functions, "function"))
        self._read_derived([section for section in sections if section.head == ":derived"])
        self._add(actions=self._actions(sections))
        return self._names.domain

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
        try:
            graphlib.TopologicalSorter(found).prepare()
        except graphlib.CycleError as error:
            word = next(word for word, _ in listed if word.text in error.args[1])
            remedy = f"all types before a - get the type after it: write '{word} - object' before the others"
            raise names.error(f"the type {word} is a sub-type of itself", word, remedy) from error
        return found

    def _untyped(self, items: tuple[Sexpression, ...]) -> tuple[Sexpression, ...]:
        """Remove ``- number`` from a list of functions."""
        for dash, kind in zip(items, (*items[1:], None), strict=False):
            if str(dash) == "-" and str(kind) != "number":
                what = f"functions whose values are no numbers (- {kind or dash})"
                raise self._names.unsupported(what, dash, "write a predicate with the value as its last argument")
        pairs = zip((None, *items), items, strict=False)
        return tuple(item for before, item in pairs if "-" not in (str(before), str(item)))

    def _signatures(self, items: tuple[Sexpression, ...], what: str) -> dict[str, Signature]:
        found: dict[str, Signature] = {}
        for item in items:
            signature = self._names.signature(item, f"a {what}")
            if found.get(signature.name, signature) != signature:
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
            head, condition = section.rest
            signature = names.signature(head, "a predicate", distinct=True)
            declared = names.domain.predicates.get(signature.name)
            if declared is None:
                raise names.unknown("predicate", signature.name, names.domain.predicates, head)
            if len(declared.parameters) != len(signature.parameters):
                raise names.error(f"the predicate is declared as {declared}", head)
            parameters = []
            for own, wanted in zip(signature.parameters, declared.parameters, strict=True):
                types = wanted.types if own.types == (OBJECT,) else own.types  # domains in use leave the types out
                if not names.domain.fits(types, wanted.types):
                    raise names.error(f"{own.name} does not fit the predicate: {declared}", head)
                parameters.append(TypedName(own.name, types))
            formula = self._formulas.formula(condition, Scope().within(parameters))
            rules.setdefault(signature.name, []).append((tuple(parameters), formula))
        derived: dict[str, tuple[tuple[TypedName, ...], Formula]] = {}
        for name, alike in rules.items():
            derived[name] = alike[0]
            if len(alike) > 1:
                wanted = names.domain.predicates[name].parameters
                parameters = tuple(TypedName(f"?#{number}", typed.types) for number, typed in enumerate(wanted))
                derived[name] = parameters, Or(tuple(_renamed(rule, parameters) for rule in alike))
        self._add(derived=derived)
        circle = Derivation(names.domain).circle
        if circle:
            at = next(section for section in sections if str(section.rest[0])[1:-1].split()[0] == circle)
            raise names.error(f"{circle} is derived from its own opposite", at)

    def _actions(self, sections: list[SexpGroup]) -> dict[str, PddlAction]:
        found: dict[str, PddlAction] = {}
        for section in sections:
            if section.head not in (":action", ":durative-action"):
                continue
            action = self._formulas.action(section)
            if action.name in found:
                raise self._names.error(f"the action {action.name} is there twice", section)
            found[action.name] = action
        return found


def _renamed(rule: tuple[tuple[TypedName, ...], Formula], parameters: tuple[TypedName, ...]) -> Formula:
    """Return the condition of a rule with other parameters, whose types may be wider."""
    pairs = list(zip(rule[0], parameters, strict=True))
    narrow = [(own, parameter) for own, parameter in pairs if own.types != parameter.types]
    same_types = {own.name: parameter.name for own, parameter in pairs if own.types == parameter.types}
    formula = substitute(rule[1], same_types)
    if not narrow:
        return formula
    same = (Equality(own.name, parameter.name) for own, parameter in narrow)
    return Quantified("exists", tuple(own for own, _ in narrow), And((*same, formula)))


class _ProblemReader(_FileReader):
    def read(self, text: str, where: str) -> PddlProblem:
        names, domain = self._names, self._names.domain
        name = self._name("problem")
        sections = self._sections(_OF_PROBLEMS)
        parts = {section.head: section for section in sections}
        self._check_domain(parts.get(":domain"))
        self._requirements(self._section(sections, ":requirements"))
        objects = self._objects(self._section(sections, ":objects"))
        facts, values, timed = self._init(self._section(sections, ":init"))
        if domain.functions.get(_TOTAL_COST.name) == Signature(_TOTAL_COST.name):
            values.setdefault(_TOTAL_COST, 0.0)
        goal, metric = parts.get(":goal"), parts.get(":metric")
        if goal is not None and len(goal.rest) != 1:
            raise names.error(f":goal takes one condition, not {len(goal.rest)}", goal, "join them: (and ...)")
        problem = PddlProblem(
            name,
            domain.name,
            objects,
            facts,
            values,
            goal=self._formulas.formula(goal.rest[0], Scope()) if goal is not None else None,
            metric=self._metric(metric) if metric is not None else None,
            timed=timed,
            text=text,
            where=where,
        )
        self._check_size(problem)
        return problem

    def _check_size(self, problem: PddlProblem) -> None:
        """Refuse quantifiers over so many combinations of objects that a look at all of them does not end."""
        domain = self._names.domain
        world = PddlState.of(problem, domain)
        parts: list[tuple[str, object, int]] = [("the goal", (problem.goal,), MAX_INSTANCES)]
        for action in domain.actions.values():
            parts.append((f"the condition of the action {action.name}", action.conditions, MAX_INSTANCES))
            parts.append((f"the effect of the action {action.name}", action.effects, MAX_CHANGES))
        for name, (parameters, formula) in domain.derived.items():
            rule = (Quantified("exists", parameters, formula),)
            parts.append((f"the condition of the derived predicate {name}", rule, MAX_INSTANCES))
        for what, part, most in parts:
            if (count := instance_count(part, world)) > most:
                raise self._names.error(
                    f"{what} has {count:.1e} combinations of objects, more than {most:.0e}",
                    self._whole,
                    "quantify over fewer variables, or over types with fewer objects",
                )

    def _check_domain(self, section: SexpGroup | None) -> None:
        names = self._names
        if section is None:
            raise names.error("the section :domain is missing", self._whole, "add (:domain ...)")
        word = names.word(section.items, 1, "the name of the domain", section)
        if word.text != names.domain.name:
            raise names.error(f"the problem is for the domain {word}, not {names.domain.name}", word)

    def _init(
        self, section: SexpGroup
    ) -> tuple[frozenset[Predicate], dict[Fluent, float], tuple[TimedInitialEffect, ...]]:
        names = self._names
        facts: set[Predicate] = set()
        denied: dict[Predicate, Sexpression] = {}
        values: dict[Fluent, float] = {}
        timed: list[TimedInitialEffect] = []
        for item in section.rest:
            group = names.group(item, "a fact")
            if group.head == "=":
                fluent, value = self._value(group)
                if values.setdefault(fluent, value) != value:
                    raise names.error(f"{fluent} has two values", group)
            elif group.head == "at" and len(group.items) == 3 and is_number(group.items[1]):
                timed.append(self._timed(group))
            elif group.head == "not" and len(group.rest) == 1:
                denied[self._fact(group.rest[0])] = group
            else:
                facts.add(self._fact(group))
        for predicate, item in denied.items():
            if predicate in facts:
                raise names.error(f"{predicate} is both true and false", item)
        return frozenset(facts), values, tuple(sorted(timed, key=lambda one: one.time_s))

    def _value(self, group: SexpGroup) -> tuple[Fluent, float]:
        left, right = self._names.parts(group, 2)
        value = self._formulas.number(right)
        return self._formulas.fluent(left, Scope()), value

    def _timed(self, group: SexpGroup) -> TimedInitialEffect:
        """Read ``(at 5 (p a))``, ``(at 5 (not (p a)))`` or ``(at 5 (= (f a) 3))``."""
        time_s = self._formulas.number(group.items[1])
        if time_s < 0:
            raise self._names.error(f"a timed initial literal cannot have a time < 0: {group}", group)
        what = self._names.group(group.items[2], "a fact")
        if what.head == "=":
            fluent, value = self._value(what)
            return TimedInitialEffect(time_s, NumericEffect("assign", fluent, Number(value)))
        if what.head == "not":
            return TimedInitialEffect(time_s, Delete(self._fact(*self._names.parts(what, 1))))
        return TimedInitialEffect(time_s, Add(self._fact(what)))

    def _fact(self, item: Sexpression) -> Predicate:
        predicate = self._formulas.predicate(item, Scope())
        if predicate.name in self._names.domain.derived:
            raise self._names.error(f"{predicate.name} is derived: it cannot be given", item)
        return predicate

    def _metric(self, section: SexpGroup) -> Metric:
        names = self._names
        direction = names.word(section.items, 1, "minimize or maximize", section)
        if direction.text not in ("minimize", "maximize") or len(section.items) != 3:
            what = f"expected minimize or maximize and one expression: {section}"
            raise names.error(what, section, "(:metric minimize (total-time))")
        names.domain = replace(names.domain, functions={TOTAL_TIME: Signature(TOTAL_TIME), **names.domain.functions})
        return Metric(direction.text, self._formulas.expression(section.items[2], Scope()))  # pyright: ignore[reportArgumentType]


def planner_text(text: str) -> str:
    """Return PDDL as the standard writes it: some planners refuse numbers such as ``.5``, and ``=?duration``."""
    return TOKEN.sub(lambda found: _standard_number(found[0]), spaced(text))


def _standard_number(token: str) -> str:
    word = token.lower()
    fraction = ("." in word or "e" in word) and NUMBER.fullmatch(word)
    return number_text(float(word)) if fraction else token
