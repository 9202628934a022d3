from __future__ import annotations

import contextlib
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import (
    DurationBounds,
    Metric,
    PddlDomain,
    PddlProblem,
    Signature,
    TimedCondition,
    TimedEffect,
)
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    ConditionalEffect,
    Delete,
    Equality,
    Fluent,
    Number,
    NumericEffect,
    Or,
    Predicate,
    Quantified,
    TypedName,
    UniversalEffect,
)
from socialbot.planning.pddl.reader import planner_text, read_domain, read_problem
from tests.planning.random_worlds import domain_text, problem_text
from tests.planning.texts import CELLAR, CRANE, CRANE_PROBLEM, crane, mutated

SMALL = """(define (domain small)
  (:types box - thing lid - thing)
  (:constants c1 - box)
  (:predicates (p ?x - thing) (q ?x ?y - box) (at ?x - thing))
  (:functions (n) (m ?x - box) - number)
{}
)"""


def small(section: str = "") -> PddlDomain:
    return read_domain(SMALL.format(section))


def act(condition: str = "()", effect: str = "()") -> PddlDomain:
    return small(f"(:action act :parameters (?x ?y - box) :precondition {condition} :effect {effect})")


def last(condition: str = "()", effect: str = "()", duration: str = "(= ?duration 2)") -> PddlDomain:
    return small(
        "(:durative-action last :parameters (?x ?y - box)\n"
        f":duration {duration}\n:condition {condition}\n:effect {effect})"
    )


def problem(rest: str, section: str = "") -> PddlProblem:
    return read_problem(f"(define (problem p) (:domain small)\n{rest})", small(section))


def test_a_domain_with_all_its_sections():
    domain, _ = crane()
    assert domain.name == "crane"
    assert domain.types == {
        "object": (),
        "box": ("place",),
        "base": ("place",),
        "place": ("object",),
        "crane": ("object",),
        "carrier": ("object",),
    }
    assert str(domain.predicates["on"]) == "(on ?b - box ?below - place ?s - base)"
    assert domain.functions["load"] == Signature("load", (TypedName("?c", ("carrier",)),))
    assert list(domain.actions) == ["pick", "put", "come", "move"]
    assert domain.actions["come"].line == 22
    assert domain.actions["come"] == domain.actions["come"].__class__(
        "come",
        (TypedName("?c", ("carrier",)), TypedName("?s", ("base",))),
        DurationBounds(Number(6), Number(6)),
        (
            TimedCondition("start", Predicate("away", ("?c",))),
            TimedCondition("over all", Predicate("clear", ("?s",))),
        ),
        (
            TimedEffect("start", Delete(Predicate("away", ("?c",)))),
            TimedEffect("end", Delete(Predicate("clear", ("?s",)))),
            TimedEffect("end", Add(Predicate("here", ("?c", "?s")))),
        ),
        line=22,
    )
    assert domain.requirements == {":typing", ":fluents", ":durative-actions", ":negative-preconditions"}
    assert domain.text == CRANE


def test_a_problem_with_all_its_sections():
    domain, two_boxes = crane()
    assert two_boxes.domain == "crane"
    assert two_boxes.objects["bay"] == ("base",)
    assert len(two_boxes.facts) == 6
    assert two_boxes.values == {Fluent("held", ("crane_a",)): 0, Fluent("load", ("carrier_a",)): 0}
    assert str(two_boxes.goal) == "(and (loaded carrier_a box_1) (loaded carrier_a box_2))"
    assert read_problem(CRANE_PROBLEM.upper(), domain) == two_boxes


def test_sections_may_come_in_any_order_and_be_empty():
    domain = read_domain("""(define (domain d)
      (:action a :effect (p k) :parameters () :precondition ())
      (:predicates (p ?x - sub)) (:functions ) (:constants k - sub) (:requirements) (:types sub - super))""")
    assert domain.actions["a"].effects == (TimedEffect("start", Add(Predicate("p", ("k",)))),)
    assert domain.types["super"] == ("object",)


def test_types_may_have_several_parents_and_be_named_again():
    domain = read_domain("(define (domain d) (:types a - (either b c) d - a d - c e -b object))")
    assert domain.types["a"] == ("b", "c")
    assert domain.types["d"] == ("a", "c")
    assert domain.is_a("d", "b")
    assert domain.types["e"] == ("b",)


def test_a_variable_of_either_type_is_refused_where_one_of_them_does_not_fit():
    section = "(:action act :parameters (?x - (either box lid)) :precondition ({} ?x))"
    assert small(section.format("p")).actions["act"].parameters == (TypedName("?x", ("box", "lid")),)
    with pytest.raises(PlanningError, match=r"\?x is a box or lid, but the predicate q takes a box"):
        small(section.replace("({} ?x)", "(q c1 ?x)"))


def test_formulas():
    domain = act(
        """(and (or (p ?x) (not (= ?x ?y))) (imply (p c1) (q ?x ?y))
        (forall (?z - lid) (exists (?w - (either box lid)) (and (p ?z) (p ?w)))) (>= (+ (n) (m ?x)) (- n)))"""
    )
    found = [one.formula for one in domain.actions["act"].conditions]
    assert isinstance(found[0], Or)
    assert isinstance(found[2], Quantified)
    assert [str(one) for one in found] == [
        "(or (p ?x) (not (= ?x ?y)))",
        "(or (not (p c1)) (q ?x ?y))",
        "(forall (?z - lid) (exists (?w - (either box lid)) (and (p ?z) (p ?w))))",
        "(>= (+ (n) (m ?x)) (- (n)))",
    ]
    assert act("(= ?x c1)").actions["act"].conditions == (TimedCondition("start", Equality("?x", "c1")),)


def test_effects():
    domain = act(effect="(and (not (p ?x)) (forall (?z - lid) (when (p ?z) (and (not (p ?z)) (assign (n) (m c1))))))")
    found = [one.effect for one in domain.actions["act"].effects]
    assert found[0] == Delete(Predicate("p", ("?x",)))
    assert found[1] == UniversalEffect(
        (TypedName("?z", ("lid",)),),
        (
            ConditionalEffect(
                Predicate("p", ("?z",)),
                (Delete(Predicate("p", ("?z",))), NumericEffect("assign", Fluent("n"), Fluent("m", ("c1",)))),
            ),
        ),
    )


def test_times_of_conditions_and_effects():
    domain = last(
        "(and (at start (at ?x)) (forall (?z - lid) (and (over all (p ?z)) (at end (at ?z)))))",
        """(and (at start (at ?y)) (forall (?z - lid) (and (at start (p ?z)) (at end (not (p ?z)))))
          (when (at end (p ?x)) (at end (increase (n) ?duration))))""",
    )
    action = domain.actions["last"]
    assert [(one.when, str(one.formula)) for one in action.conditions] == [
        ("start", "(at ?x)"),
        ("over all", "(forall (?z - lid) (p ?z))"),
        ("end", "(forall (?z - lid) (at ?z))"),
    ]
    assert [(one.when, str(one.effect)) for one in action.effects] == [
        ("start", "(at ?y)"),
        ("start", "(forall (?z - lid) (and (p ?z)))"),
        ("end", "(forall (?z - lid) (and (not (p ?z))))"),
        ("end", "(when (p ?x) (and (increase (n) ?duration)))"),
    ]


@pytest.mark.parametrize(
    ("duration", "bounds"),
    [
        ("(= ?duration 2)", ("2", "2")),
        ("(and (>= ?duration 1) (<= ?duration (m ?x)))", ("1", "(m ?x)")),
        ("(at start (<= ?duration (* 2 (n))))", ("None", "(* 2 (n))")),
        ("()", ("None", "None")),
    ],
)
def test_bounds_of_durations(duration, bounds):
    found = last(duration=duration).actions["last"].duration
    assert found is not None
    assert (str(found.least), str(found.most)) == bounds


def test_a_problem_has_its_initial_state():
    found = problem(
        """(:objects b1 - box l1 - lid c1 - box) (:requirements :strips)
        (:init (p b1) (p b1) (at l1) (not (p l1)) (= (n) -2.5) (= n -2.5) (= (m c1) 1e2))
        (:metric maximize (+ (n) (total-time)))"""
    )
    assert found.facts == {Predicate("p", ("b1",)), Predicate("at", ("l1",))}
    assert found.values == {Fluent("n"): -2.5, Fluent("m", ("c1",)): 100}
    assert found.goal is None
    assert found.metric is not None
    assert str(found.metric) == "maximize (+ (n) (total-time))"
    assert problem("(:goal ())").goal == And()
    assert problem("(:metric minimize total-time)").metric == Metric("minimize", Fluent("total-time"))


def test_a_byte_order_mark_and_closing_parentheses_after_the_end_are_ignored():
    assert read_domain("\ufeff(define (domain d) (:types a)))\n)") == read_domain("(define (domain d) (:types a))")


def test_unknown_requirements_and_repeated_sections_and_declarations_are_accepted():
    domain = read_domain("""(define (domain d) (:requirements :typing :of-a-planner) (:types a - object) (:types b - a)
      (:predicates (p ?x - a)) (:requirements :strips) (:functions (n) (n)) (:predicates (q)))""")
    assert domain.requirements == {":typing", ":of-a-planner", ":strips"}
    assert domain.is_a("b", "a")
    assert (set(domain.predicates), set(domain.functions)) == ({"p", "q"}, {"n"})


def test_vars_are_further_parameters():
    (action,) = small("(:action go :parameters (?x) :vars (?y - box) :precondition (p ?y) :effect ())").actions.values()
    assert action.parameters == (TypedName("?x"), TypedName("?y", ("box",)))
    with pytest.raises(PlanningError, match=r"domain:\d+: the variable \?x is declared twice"):
        small("(:action go :parameters (?x) :vars (?x - box))")


def test_an_object_that_is_declared_several_times_belongs_to_all_its_types():
    for objects in ("b - box b - lid", "b - (either box lid)", "c1 - lid"):
        name = objects.split()[0]
        found = problem(f"(:objects {objects})")
        assert found.objects[name] == ("box", "lid")


def test_a_type_without_names_is_ignored_and_names_of_objects_may_have_digits_dots_and_at_signs():
    assert set(problem("(:objects 2nd-floor hall.door a@b - box - lid)").objects) == {"2nd-floor", "hall.door", "a@b"}


def test_timed_initial_literals_may_come_at_the_start():
    (timed,) = problem("(:init (at 0 (p c1)))").timed
    assert timed.time_s == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "domain: the file is empty"),
        ("; only a comment", "domain: the file is empty"),
        ("hello", "domain:1: expected a parenthesis, found 'hello'"),
        ("\n(define (domain d)", "domain:2: this parenthesis is never closed"),
        ("(define (domain d)\n(:types a))) (:types b)", "domain:2: unexpected text after the end: '('"),
        (
            '(in-package "PDDL")\n(define (domain d))',
            "domain:1: expected (define ...), found (in-package ...)\n  remedy: remove it",
        ),
        ("(define (domain d) (:timeless (p)))", "not supported by socialbot: facts of PDDL 1.2 in domains (:timeless)"),
        ("(define (domain d) (:axiom :vars (?x)))", "not supported by socialbot: axioms of PDDL 1.2 (:axiom)"),
        ("(define (domain d) (:extends e))", "not supported by socialbot: domains that extend others (:extends)"),
        ("(define (domain d) (:safety (p)))", "not supported by socialbot: safety constraints of PDDL 1.2 (:safety)"),
        (
            "(define (domain d) (:constraint c :condition (p)))",
            "not supported by socialbot: constraints of PDDL+ (:constraint)",
        ),
        ("(define (domain d) (:colours red))", "unknown section ':colours'\n  remedy: known: :requirements, :types"),
        (
            "(define (domain d) (:predicates (p)) (:action a :expansion (series (b))))",
            "not supported by socialbot: expansions of PDDL 1.2 (:expansion)",
        ),
        (
            "(define (domain d) (:predicates (p)) (:action a :until 3))",
            "part of :action ':until'\n  remedy: known: :par",
        ),
        ("(" * 200, "domain:1: more than 100 parentheses"),
        ("(domain d)", "domain:1: expected (define (domain ...) ...), found (domain ...)"),
        ("(define)", "domain:1: expected (define (domain ...) ...)"),
        ("(define (problem p))", "domain:1: this is no domain but a problem: (define (problem p) ...)"),
        ("(define (domain d) (:predicate (p)))", "unknown section ':predicate'\n  remedy: did you mean ':predicates'?"),
        ("(define (domain d) (:types a - b b - a))", "the type a is a sub-type of itself"),
        (
            "(define (domain d) (:types box room bolt - room))",
            "the type room is a sub-type of itself\n  remedy: all types before a - get the type after it: write",
        ),
        ("(define (domain d) (:types a - ))", "a type belongs after -"),
        ("(define (domain d) (:types object - a))", "object is the type of everything"),
        ("(define (domain d) (:types and))", "'and' cannot be the name of a type"),
        ("(define (domain d) (:constants a - bx) (:types box))", "unknown type 'bx'\n  remedy: did you mean 'box'?"),
        ("(define (domain d) (:predicates (p) (p ?x)))", "the predicate p is declared twice"),
        ("(define (domain d) (:predicates (p x)))", "expected a variable, found x"),
        ("(define (domain d) (:action a :parameters (?x ?x)))", "the variable ?x is declared twice"),
        ("(define (domain d) (:predicates p))", "expected a predicate in parentheses, found p"),
        ("(define (domain d) (:functions (f) - object))", "not supported by socialbot: functions whose values are no"),
        (
            "(define (domain d) (:requirements typing))",
            "unknown requirement 'typing'\n  remedy: did you mean ':typing'?",
        ),
        ("(define (domain d) (:constraints (and)))", "not supported by socialbot: preferences and constraints"),
        ("(define (domain d) (:process p))", "not supported by socialbot: continuous change (:process)"),
        (
            "(define (domain d) (:action a :observe (p)))",
            "domain:1: not supported by socialbot: observations (:observe)",
        ),
        ("(define (domain d) (:task t :parameters ()))", "not supported by socialbot: task networks of HDDL (:task)"),
        ("(define (domain d) (:action a :agent ?a))", "not supported by socialbot: agents of MA-PDDL (:agent)"),
        (
            "(define (domain d) (:predicates (p) (:private (q))))",
            "not supported by socialbot: private names of agents of MA-PDDL (:private)",
        ),
        (
            "(define (domain d) (:constants a (:private b)))",
            "not supported by socialbot: private names of agents of MA-PDDL (:private)",
        ),
        (
            "(define (domain d) (:predicates (p)) (:action a :effect (oneof (p) (not (p)))))",
            "not supported by socialbot: effects that depend on chance (oneof)",
        ),
        (
            "(define (domain d) (:predicates (p)) (:action a :effect (and (probabilistic 0.5 (p)))))",
            "not supported by socialbot: effects that depend on chance (probabilistic)",
        ),
        ("(define (domain d) (:action a) (:action a))", "the action a is there twice"),
        ("(define (domain d) (:action a :effects ()))", "remedy: did you mean ':effect'?"),
        ("(define (domain d) (:action a :effect))", "no value after :effect in the action a"),
        ("(define (domain d) (:action a :effect () :effect ()))", ":effect is there twice in the action a"),
        ("(define (domain d) (:action a effect))", "expected one of :parameters, :vars, :precondition, :effect in the"),
        ("(define (domain d) (:action))", "the name of the action is missing"),
        ("(define (domain d) (:durative-action a))", "the action a has no :duration"),
        ("(define (domain d) (:derived (p) ()))", "unknown predicate 'p'"),
    ],
)
def test_mistakes_in_domains(text, message):
    with pytest.raises(PlanningError) as caught:
        read_domain(text)
    assert message in str(caught.value)
    assert "not supported" not in str(caught.value) or "\n  remedy: " in str(caught.value)


def test_a_parenthesis_that_is_missing_is_looked_for_where_the_next_section_begins():
    text = CRANE.replace("(load ?c - carrier))", "(load ?c - carrier)")
    with pytest.raises(PlanningError, match="perhaps before the section in line 8"):
        read_domain(text)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("(pp ?x)", "unknown predicate 'pp'\n  remedy: did you mean 'p'?"),
        ("(q ?x)", "q takes 2 terms, not 1: (q ?x)\n  remedy: it is declared as (q ?x ?y - box)"),
        ("(p ?z)", "unknown variable '?z'"),
        ("(p c11)", "unknown object 'c11'\n  remedy: did you mean 'c1'?"),
        ("(exists (?z - lid) (q ?x ?z))", "?z is a lid, but the predicate q takes a box"),
        ("(not (p ?x) (p ?y))", "not takes one part, not 2"),
        ("(imply (p ?x))", "imply takes two parts, not 1"),
        ("(forall ?z (p ?z))", "expected variables in parentheses, found ?z"),
        ("((p ?x))", "expected the name of a predicate, found (p ?x)"),
        ("p", "expected a condition in parentheses, found p"),
        ("(= ?x 3)", "unknown function '?x'"),
        ("(< (n) (k))", "unknown function 'k'"),
        ("(< (n) (m))", "m takes 1 terms, not 0"),
        ("(< (n) (+ 1))", "+ takes two numbers"),
        ("(< (n) 1e999)", "1e999 is too large a number"),
        ("(< ?duration 1)", "?duration has no meaning here"),
        ("(= c1 c2)", "unknown object 'c2'"),
        ("(preference a (p ?x))", "not supported by socialbot: preferences and constraints (preference)"),
    ],
)
def test_mistakes_in_conditions(condition, message):
    for make in (act, lambda text: last(f"(at start {text})")):
        with pytest.raises(PlanningError) as caught:
            make(condition)
        assert message in str(caught.value)
        assert str(caught.value).startswith("domain:")
        assert "not supported" not in str(caught.value) or "\n  remedy: " in str(caught.value)


@pytest.mark.parametrize(
    ("condition", "effect", "duration", "message"),
    [
        ("(p ?x)", "()", "()", "domain:8: expected when: (p ?x)\n  remedy: write (at start ...), (over all ...)"),
        ("(at start (p ?x) (p ?y))", "()", "()", "domain:8: expected when: (at start (p ?x) (p ?y))"),
        ("(preference a (at start (p ?x)))", "()", "()", "domain:8: not supported by socialbot: preferences"),
        ("()", "(p ?x)", "()", "domain:9: expected when: (p ?x)"),
        ("()", "(over all (p ?x))", "()", "domain:9: not supported by socialbot: effects over all"),
        ("()", "(increase (n) (* #t 2))", "()", "domain:9: not supported by socialbot: continuous effects"),
        (
            "()",
            "(at end (increase (n) (* #t 2)))",
            "()",
            "domain:9: not supported by socialbot: continuous effects (#t)",
        ),
        (
            "()",
            "(when (at start (p ?x)) (at end (p ?y)))",
            "()",
            "domain:9: not supported by socialbot: an effect at an",
        ),
        ("()", "()", "(= ?duration 1 2)", "domain:7: = takes two parts, not 3"),
        ("()", "()", "(= 5 ?duration)", "domain:7: no bound of a duration"),
        ("()", "()", "(< ?duration 5)", "domain:7: no bound of a duration"),
        ("()", "()", "(and (= ?duration 1) (<= ?duration 2))", "domain:7: the duration is bounded twice"),
        ("()", "()", "(at end (= ?duration 1))", "domain:7: not supported by socialbot: bounds of a duration"),
        ("()", "()", "(= ?duration ?duration)", "domain:7: ?duration has no meaning here"),
    ],
)
def test_mistakes_in_durative_actions(condition, effect, duration, message):
    with pytest.raises(PlanningError) as caught:
        last(condition, effect, duration)
    assert str(caught.value).startswith(message)
    assert "not supported" not in str(caught.value) or "\n  remedy: " in str(caught.value)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("(:objects b - bok)", "problem:2: unknown type 'bok'\n  remedy: did you mean 'box'?"),
        ("(:goal (p c1)) (:goal (p c1))", "problem:2: :goal is there twice"),
        ("(:objects 7 - box)", "problem:2: '7' cannot be the name of an object"),
        ("(:init (p b))", "problem:2: unknown object 'b'"),
        ("(:init (p ?x))", "problem:2: unknown variable '?x'"),
        ("(:init\n(r c1))", "problem:3: unknown predicate 'r'"),
        ("(:init (= (n) 1) (= (n) 2))", "problem:2: (n) has two values"),
        ("(:init (= (n) (n)))", "problem:2: expected a number, found (n)"),
        ("(:init (= (n) 1e999))", "problem:2: 1e999 is too large a number"),
        ("(:init (= c1 c1))", "problem:2: expected a number, found c1"),
        ("(:init (at -1 (p c1)))", "problem:2: a timed initial literal cannot have a time < 0: (at -1 (p c1))"),
        ("(:init (at 5 (= c1 2)))", "problem:2: unknown function 'c1'"),
        ("(:init (at 5 (not (p b))))", "problem:2: unknown object 'b'"),
        ("(:init (p c1) (not (p c1)))", "problem:2: (p c1) is both true and false"),
        ("(:goal (p c1) (p c1))", "problem:2: :goal takes one condition, not 2"),
        ("(:goal (p b))", "problem:2: unknown object 'b'"),
        ("(:goal (sometime (p c1)))", "problem:2: not supported by socialbot: preferences and constraints (sometime)"),
        ("(:metric minimise (n))", "problem:2: expected minimize or maximize"),
        ("(:metric minimize (is-violated a))", "problem:2: unknown function 'is-violated'"),
        ("(:object b)", "problem:2: unknown section ':object'\n  remedy: did you mean ':objects'?"),
        ("(:situation s)", "problem:2: not supported by socialbot: situations of PDDL 1.2 (:situation)"),
        ("(:constraints (and))", "problem:2: not supported by socialbot: preferences and constraints"),
    ],
)
def test_mistakes_in_problems(rest, message):
    with pytest.raises(PlanningError) as caught:
        problem(rest)
    assert str(caught.value).startswith(message)
    assert "not supported" not in str(caught.value) or "\n  remedy: " in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(define (problem p))", "problem:1: the section :domain is missing"),
        ("(define (problem p) (:domain other))", "problem:1: the problem is for the domain other, not small"),
        ("(define (domain small))", "problem:1: this is no problem but a domain: (define (domain small) ...)"),
    ],
)
def test_problems_that_are_none(text, message):
    with pytest.raises(PlanningError) as caught:
        read_problem(text, small())
    assert str(caught.value).startswith(message)


def test_derived_predicates_can_neither_be_given_nor_changed():
    rule = "(:derived (p ?x - thing) (at ?x))"
    with pytest.raises(PlanningError, match="p is derived: it cannot be given"):
        problem("(:init (p c1))", rule)
    with pytest.raises(PlanningError, match="p is derived: no action can change it"):
        small(rule + "(:action a :effect (p c1))")


def test_the_head_of_a_derived_predicate_without_types_has_those_of_the_predicate():
    untyped, typed = (small(f"(:derived (q {head}) (and (p ?a) (= (m ?b) 1)))") for head in ("?a ?b", "?a ?b - box"))
    assert untyped.derived == typed.derived
    with pytest.raises(PlanningError, match=r"\?b does not fit the predicate: \(q \?x \?y - box\)"):
        small("(:derived (q ?a - box ?b - lid) (p ?a))")


GLUED = """(define (domain d) (:requirements :typing :durative-actions :fluents) (:types place robot)
  (:predicates (at ?r -robot ?p -place)) (:functions (n) (far ?a ?b -place))
  (:durative-action go :parameters (?r -robot ?a ?b -place)
    :duration (and (>=?duration 1) (<=?duration (far ?a ?b)))
    :condition (and (at start (at ?r ?a)) (at start (>(n)-5)))
    :effect (at end (decrease (n) (*?duration -2)))))"""


def test_operators_need_no_blank_after_them():
    spaced = GLUED.replace("=?", "= ?").replace("*?", "* ?").replace(">(n)-5", "> (n) -5")
    for name in ("robot", "place"):
        spaced = spaced.replace(f"-{name}", f"- {name}")
    glued, wanted = read_domain(GLUED), read_domain(spaced)
    assert (glued.actions, glued.predicates, glued.functions) == (wanted.actions, wanted.predicates, wanted.functions)
    assert planner_text("(=?duration .5) ?r -robot -5 a-?b") == "(= ?duration 0.5) ?r - robot -5 a-?b"


def test_files_are_named_in_errors():
    with pytest.raises(PlanningError) as caught:
        read_domain("(define\n(domain d)\n(:action a :effect (p)))", where="shop.pddl")
    assert caught.value.where == "shop.pddl:3"


TEXTS = (CRANE, CELLAR, CRANE_PROBLEM, SMALL.format("(:derived (p ?x - thing) (at ?x))"))


def readable(text: str) -> None:
    for read in (read_domain, lambda words: read_problem(words, crane()[0])):
        with contextlib.suppress(PlanningError):
            read(text)


@settings(max_examples=200, deadline=None)
@given(st.one_of(st.text(), st.text(alphabet="()?:- abd=\n;#1.", max_size=200)))
def test_no_text_makes_it_raise_anything_else(text):
    readable(text)
    readable(f"(define (domain d) {text})")
    readable(f"(define (problem d) (:domain crane) {text})")


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(TEXTS), st.integers(0, 2**32))
def test_no_mutated_text_makes_it_raise_anything_else(text, seed):
    readable(mutated(text, seed, ("(", ")", "#t", "-", "either", "5", "?duration", "not", "", "object")))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32))
def test_random_domains_are_read(seed):
    chance = random.Random(seed)
    domain = read_domain(domain_text(chance))
    assert len(domain.actions) == 5
    assert read_problem(problem_text(chance), domain).values


@pytest.mark.parametrize(
    "text",
    [
        "(:predicates (in ?x ?x))",
        "(:types number) (:constants n - number)",
        "(:types t) (:constants a - t a - t)",
        "(:types t) (:predicates (p ?x - t)) (:action a :precondition (exists (?x) (p ?x)))",
        "(:types t) (:predicates (p ?x - t)) (:action a :effect (forall (?x) (when (p ?x) (not (p ?x)))))",
    ],
)
def test_domains_in_use_are_read(text):
    """Such domains are among those of the planning competitions."""
    assert read_domain(f"(define (domain d) {text})").name == "d"


def test_parameters_of_actions_must_fit_exactly():
    text = "(:types t) (:predicates (p ?x - t)) (:action a :parameters (?x) :precondition (p ?x))"
    with pytest.raises(PlanningError, match="\\?x is a object, but the predicate p takes a t"):
        read_domain(f"(define (domain d) {text})")


def test_timed_initial_literals_are_read_in_order():
    domain = read_domain("(define (domain d) (:predicates (open ?x)) (:functions (level)) (:constants a))")
    text = "(:init (at 9 (not (open a))) (at 2.5 (open a)) (at 4 (= (level) 3)))"
    problem = read_problem(f"(define (problem p) (:domain d) {text})", domain)
    assert [str(one) for one in problem.timed] == ["(at 2.5 (open a))", "(at 4 (= (level) 3))", "(at 9 (not (open a)))"]
    assert problem.facts == frozenset()


@pytest.mark.parametrize(("init", "cost"), [("", 0.0), ("(= (total-cost) 7)", 7.0)])
def test_total_cost_is_0_at_the_start_unless_given(init, cost):
    domain = read_domain("(define (domain d) (:functions (total-cost) - number))")
    problem = read_problem(f"(define (problem p) (:domain d) (:init {init}))", domain)
    assert list(problem.values.values()) == [cost]
