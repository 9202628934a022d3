"""Conditions with wildcards and variables."""

from __future__ import annotations

import itertools
import operator
from fnmatch import fnmatchcase

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.deliberation._fact_index import FactIndex
from socialbot.deliberation._matching import FactMatch, fitting, matches, unfit_condition
from socialbot.deliberation.messages import FLUENT, INSTANCE, Dnf, Fact, FactCondition, FactConjunction
from tests.deliberation.domains import YARD, dnf, i, n, p

OBJECTS = {"box_a": "box", "box_b": "box", "base_1": "base", "base_2": "base", "carrier_a": "carrier"}


def index(*facts: Fact) -> FactIndex:
    return FactIndex(YARD, [*(i(name, kind) for name, kind in OBJECTS.items()), *facts])


def bindings(found: list[FactMatch]) -> list[str]:
    return [" ".join(value for _, value in match.bindings) for match in found]


def test_an_empty_condition_holds_once():
    assert matches(Dnf(), index()) == matches(dnf([]), index()) == [FactMatch()]


def test_a_variable_stands_for_each_object_that_fits():
    facts = index(p("in", "box_a", "base_1"), p("in", "box_b", "base_2"), p("in", "base_1", "base_1"))
    assert bindings(matches(dnf([("T", p("in", "{x}", "base_1"))]), facts)) == ["base_1", "box_a"]
    assert bindings(matches(dnf([("T", p("in", "{x}", "{x}"))]), facts)) == ["base_1"]
    assert bindings(matches(dnf([("T", p("in", "box_*", "{x}"))]), facts)) == ["base_1", "base_2"]


def test_variables_join_across_conditions():
    facts = index(p("in", "box_a", "base_1"), p("in", "box_b", "base_2"), p("carrier_in_base", "carrier_a", "base_2"))
    both = dnf([("T", p("in", "{box}", "{place}")), ("T", p("carrier_in_base", "{who}", "{place}"))])
    assert matches(both, facts) == [FactMatch((("box", "box_b"), ("place", "base_2"), ("who", "carrier_a")))]
    assert matches(both, facts)[0].binding == {"box": "box_b", "place": "base_2", "who": "carrier_a"}


def test_a_variable_only_in_negations_is_each_object_of_its_type():
    facts = index(p("in", "box_a", "base_1"), p("clear", "box_b"))
    free = dnf([("F", p("carrier_in_base", "carrier_a", "{bay}"))])
    assert bindings(matches(free, facts)) == ["base_1", "base_2", "start"]
    empty = dnf([("F", p("carrier_in_base", "*", "{bay}")), ("F", p("in", "box_*", "{bay}"))])
    assert bindings(matches(empty, facts)) == ["base_2", "start"]


def test_a_negation_with_wildcards_holds_without_matches():
    facts = index(p("in", "box_a", "base_1"))
    assert matches(dnf([("F", p("in", "box_?", "*"))]), facts) == []
    assert matches(dnf([("F", p("in", "carrier_*", "*"))]), facts) == [FactMatch()]
    assert matches(dnf([("F", p("*", "*"))]), facts) == [FactMatch()]
    assert matches(dnf([("F", p("i*", "*", "*"))]), facts) == []


def test_fluents_are_compared_and_join():
    facts = index(n("stacked", "base_1", value=2), n("stacked", "base_2", value=3), p("clear", "base_1"))
    found = matches(dnf([("T", p("clear", "{x}")), ("GREQ", n("stacked", "{x}", value=2))]), facts)
    assert found == [FactMatch((("x", "base_1"),), (n("stacked", "base_1", value=2),))]
    assert str(found[0]) == "x=base_1, (stacked base_1) = 2"
    assert matches(dnf([("LE", n("moving_boxes", "carrier_a", value=9))]), facts) == []


def test_each_fluent_that_a_wildcard_stands_for_is_a_way_of_its_own():
    facts = index(n("stacked", "base_1", value=2), n("stacked", "base_2", value=3))
    found = matches(dnf([("GR", n("stacked", "*", value=1))]), facts)
    assert [str(match) for match in found] == ["(stacked base_1) = 2", "(stacked base_2) = 3"]


def test_instances_are_asked_for_by_name_and_type():
    assert bindings(matches(dnf([("EX", i("{x}", "base"))]), index())) == ["base_1", "base_2", "start"]
    assert bindings(matches(dnf([("EX", i("{x}", "thing"))]), index()))[-1] == "start"
    assert matches(dnf([("EX", i("box_?"))]), index()) == [FactMatch()]
    assert matches(dnf([("EX", i("box_?", "carrier"))]), index()) == []


def test_a_check_that_does_not_go_with_its_fact_never_holds():
    facts = index(p("loaded"), n("load", value=1))
    assert matches(dnf([("EQ", p("loaded"))]), facts) == []
    assert matches(dnf([("T", n("load"))], [("T", p("loaded"))]), facts) == [FactMatch()]


@pytest.mark.parametrize(
    ("check", "fact", "reason"),
    [
        ("GR", p("loaded"), "GR checks a function, not a predicate"),
        ("T", i("box_a"), "T checks a predicate, not an instance"),
        ("T", p("clear", "base_{x}"), "a variable has to be the whole parameter"),
        ("T", p("clear", "base_*", "x"), "has 1 parameter"),
        ("T", p("inn", "*", "{x}"), "did you mean 'in'?"),
        ("F", p("box*", "x"), "no predicate is like (box* x)"),
        ("F", p("carrier*", "x"), "no predicate is like (carrier* x)"),
        ("T", p("carrier_in_base", "{c}", "carrier_a"), "carrier_a is a carrier, not a base"),
        ("EX", i("{x}", "boxx"), "there is no type 'boxx'; did you mean 'box'?"),
        ("T", p("clear", "Base"), "'Base' is no name"),
    ],
)  # fmt: skip
def test_conditions_that_can_never_hold_are_found(check, fact, reason):
    assert reason in str(unfit_condition(FactCondition(check=check, condition_to_check=fact), index()))


def test_conditions_that_may_hold_are_not_complained_of():
    for check, fact in [
        ("T", p("in", "new_box", "{x}")), ("F", p("*", "*", "*")), ("EQ", n("stack*", "*")), ("EX", i("{x}")),
    ]:  # fmt: skip
        assert unfit_condition(FactCondition(check=check, condition_to_check=fact), index()) is None  # type: ignore[arg-type]


def test_matching_facts_are_found_in_order():
    facts = index(p("in", "box_b", "base_1"), p("in", "box_a", "base_1"), p("in", "box_a", "base_2"))
    assert fitting(p("in", "*", "base_1"), facts) == [p("in", "box_a", "base_1"), p("in", "box_b", "base_1")]
    assert fitting(i("box_*"), facts) == [i("box_a", "box"), i("box_b", "box")]


# Against trying everything

TERMS = st.sampled_from(["box_a", "base_1", "carrier_a", "{x}", "{y}", "{z}", "*", "b*", "b?x_a"])
PREDICATES = st.one_of(
    st.builds(p, st.just("in"), TERMS, TERMS),
    st.builds(p, st.just("clear"), TERMS),
    st.builds(p, st.just("carrier_in_base"), TERMS, TERMS),
    st.builds(p, st.sampled_from(["*", "c*"]), TERMS, TERMS),
)
FLUENTS = st.builds(lambda term, value: n("stacked", term, value=value), TERMS, st.integers(0, 2))
CONDITIONS = st.one_of(
    st.builds(lambda check, fact: (check, fact), st.sampled_from(["T", "T", "F"]), PREDICATES),
    st.builds(lambda check, fact: (check, fact), st.sampled_from(["EQ", "GR", "GREQ", "LE", "LEQ"]), FLUENTS),
    st.builds(lambda term, kind: ("EX", i(term, kind)), TERMS, st.sampled_from(["", "thing", "base", "carrier"])),
)
CLAUSES = st.lists(CONDITIONS, max_size=4)
NAMES = st.sampled_from(sorted(OBJECTS))
FACTS = st.lists(
    st.one_of(
        st.builds(p, st.just("in"), NAMES, NAMES),
        st.builds(p, st.just("clear"), NAMES),
        st.builds(p, st.just("carrier_in_base"), st.just("carrier_a"), st.sampled_from(["base_1", "base_2"])),
        st.builds(
            lambda base, value: n("stacked", base, value=value), st.sampled_from(["base_1", "start"]), st.integers(0, 3)
        ),
    ),
    max_size=12,
)
COMPARE = {"EQ": operator.eq, "GR": operator.gt, "GREQ": operator.ge, "LE": operator.lt, "LEQ": operator.le}


def tried(clauses: Dnf, facts: FactIndex) -> set[FactMatch]:
    """All matches, found by trying every object for every variable and every fact for every condition."""
    found = set()
    for clause in clauses.clauses:
        names = sorted({term[1:-1] for literal in clause.literals for term in variables(literal)})
        for objects in itertools.product(facts.objects(), repeat=len(names)):
            binding = dict(zip(names, objects, strict=True))
            if ranged(clause, binding, facts):
                witnesses = [held(literal, binding, facts) for literal in clause.literals]
                for fluents in itertools.product(*witnesses):
                    read = tuple(fact for group in fluents for fact in group)
                    found.add(FactMatch(tuple(binding.items()), read))
    return found


def terms(fact: Fact) -> tuple[str, ...]:
    return (fact.name,) if fact.pddl_type == INSTANCE else fact.params


def ranged(clause: FactConjunction, binding: dict[str, str], facts: FactIndex) -> bool:
    """Whether the variables that stand only in what is not so have the types that are asked for there."""
    positive = {term for literal in clause.literals if literal.check != "F" for term in variables(literal)}
    return all(
        facts.fits(binding[term[1:-1]], YARD.predicates[fact.name].parameters[position].types)
        for fact in (literal.condition_to_check for literal in clause.literals)
        for position, term in enumerate(terms(fact))
        if term[0] == "{" and term not in positive and fact.name in YARD.predicates
    )


def variables(literal: FactCondition) -> set[str]:
    return {term for term in terms(literal.condition_to_check) if term[0] == "{"}


def held(literal: FactCondition, binding: dict[str, str], facts: FactIndex) -> list[tuple[Fact, ...]]:
    """The ways in which one condition holds: for comparisons the fluent that was compared, else nothing."""
    wanted = literal.condition_to_check
    asked = [binding[term[1:-1]] if term[0] == "{" else term for term in terms(wanted)]
    everything = [*facts.facts(), i("start", "base")]
    found = [
        fact
        for fact in everything
        if fact.pddl_type == wanted.pddl_type
        and (fact.pddl_type == INSTANCE or fnmatchcase(fact.name, wanted.name))
        and len(terms(fact)) == len(asked)
        and all(map(fnmatchcase, terms(fact), asked))
        and (fact.pddl_type != INSTANCE or not wanted.type or YARD.is_a(fact.type, wanted.type))
        and (fact.pddl_type != FLUENT or COMPARE[literal.check](fact.value, wanted.value))
    ]
    if literal.check == "F":
        return [] if found else [()]
    if wanted.pddl_type == FLUENT:
        return [(fact,) for fact in found]
    return [()] if found else []


@given(st.lists(CLAUSES, min_size=1, max_size=2), FACTS)
@settings(max_examples=250, deadline=None)
def test_matches_are_those_that_trying_everything_finds(clauses, held_facts):
    facts, condition = index(*held_facts), dnf(*clauses)
    found = matches(condition, facts)
    assert set(found) == tried(condition, facts)
    assert len(found) == len(set(found))
    assert found == sorted(found, key=lambda match: match.order)
