"""Beliefs as facts of a planning domain."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Atom, Engine, Trace
from socialbot.bdi.literals import literal
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import Desire, FactCondition
from socialbot.planning.pddl.formulas import And, Fluent, Not, Number, NumericComparison, Or, Predicate
from socialbot.planning.pddl.reader import read_domain
from tests.deliberation.domains import YARD, dnf, domain, i, n, p


@pytest.fixture
def engine():
    return Engine("gripper_a", ManualClock(), sink=Trace())


@pytest.fixture
def facts(engine):
    return FactBase(engine, YARD)


@pytest.fixture
def told(facts):
    changes = []
    facts.watch(lambda fact, held, cause: changes.append((str(fact), held)))
    return changes


def beliefs(engine):
    return [str(held.belief) for held in engine.beliefs]


def failures(engine):
    return [record.detail["message"] for record in engine.trace.sink.find("failure")]


def say(engine, text):
    engine.add_text(text)
    engine.run_until_idle()


# The three kinds of facts


def test_a_predicate_is_a_belief_with_atoms(engine, facts):
    assert facts.add(p("in", "box_a", "base_1"))
    assert engine.beliefs.relation("in/2").facts.keys() == {(Atom("box_a"), Atom("base_1"))}
    assert facts.holds(Predicate("in", ("box_a", "base_1")))
    assert not facts.holds(Predicate("in", ("base_1", "box_a")))


def test_a_fluent_is_a_belief_with_its_value_last(engine, facts):
    facts.add(n("stacked", "base_1", value=2.0))
    facts.add(n("load", value=0.5))
    assert {"stacked(base_1, 2)", "load(0.5)"} <= set(beliefs(engine))
    assert facts.value(Fluent("stacked", ("base_1",))) == 2.0
    assert facts.value(Fluent("load")) == 0.5
    assert facts.value(Fluent("stacked", ("base_2",))) is None


def test_an_instance_is_a_belief_with_its_type(engine, facts):
    facts.add(i("box_a", "box"))
    assert beliefs(engine) == ["instance(box_a, box)"]
    assert facts.objects(("box",)) == facts.objects(("thing", "carrier"))[:1] == ("box_a",)
    assert facts.objects(("carrier",)) == ()


def test_constants_are_objects_but_no_beliefs(engine, facts):
    assert facts.objects(("base",)) == ("start",)
    assert facts.facts() == ()
    assert facts.check(FactCondition(check="EX", condition_to_check=i("start", "thing")))
    facts.add(p("clear", "start"))
    assert facts.facts() == (p("clear", "start"),)
    assert facts.problem().objects == {}


def test_facts_come_in_order_whatever_the_order_they_came_in(facts):
    for fact in [n("load", value=1), p("clear", "b"), p("clear", "a"), i("z", "box")]:
        facts.add(fact)
    assert list(map(str, facts.facts())) == [
        "a - thing",
        "b - thing",
        "z - box",
        "(clear a)",
        "(clear b)",
        "(load) = 1",
    ]


# Changes


def test_a_known_fact_is_no_change(facts, told):
    assert facts.add(p("loaded"))
    assert not facts.add(p("loaded"), source="carrier_a")
    assert told == [("(loaded)", True)]


def test_a_new_value_of_a_fluent_is_one_change(engine, facts, told):
    facts.add(i("base_1", "base"))
    facts.add(n("stacked", "base_1", value=1))
    told.clear()
    assert facts.add(n("stacked", "base_1", value=2))
    assert told == [("(stacked base_1) = 2", True)]
    assert beliefs(engine) == ["instance(base_1, base)", "stacked(base_1, 2)"]
    assert not facts.add(n("stacked", "base_1", value=2.0))
    assert len(told) == 1


def test_engine_rules_get_both_events_of_a_new_value(engine, facts):
    engine.add_text("+stacked(B, N) <- +seen(N). -stacked(B, N) <- +gone(N).")
    facts.add(n("stacked", "start", value=1))
    facts.add(n("stacked", "start", value=2))
    engine.run_until_idle()
    assert beliefs(engine) == ["stacked(start, 2)", "seen(1)", "seen(2)", "gone(1)"]


def test_a_value_that_a_rule_adds_takes_the_place_of_the_old_one(engine, facts, told):
    facts.add(n("stacked", "start", value=1))
    say(engine, "+!grow <- +stacked(start, 2). !grow.")
    assert told == [("(stacked start) = 1", True), ("(stacked start) = 2", True)]
    assert beliefs(engine) == ["stacked(start, 2)"]


def test_a_value_that_a_rule_takes_away_is_gone(engine, facts, told):
    facts.add(n("stacked", "start", value=1))
    say(engine, "+!empty <- -stacked(start, _). !empty.")
    assert told[1:] == [("(stacked start) = 1", False)]
    assert facts.value(Fluent("stacked", ("start",))) is None


def test_removal_returns_the_removed_facts(facts, told):
    facts.add(p("clear", "start"))
    facts.add(n("load", value=3))
    assert facts.remove(p("clear", "base_9")) == ()
    assert facts.remove(p("clear", "start")) == (p("clear", "start"),)
    assert facts.remove(n("load", value=99)) == (n("load", value=3.0),)
    assert told[-2:] == [("(clear start)", False), ("(load) = 3", False)]


def test_only_facts_that_match_a_pattern_are_removed(facts):
    for fact in [p("in", "box_a1", "base_a"), p("in", "box_a2", "base_a"), p("in", "box_b1", "base_b")]:
        facts.add(fact)
    assert facts.remove(p("in", "box_a?", "*")) == (p("in", "box_a1", "base_a"), p("in", "box_a2", "base_a"))
    assert facts.holds(Predicate("in", ("box_b1", "base_b")))


def test_beliefs_from_before_are_taken_in(engine):
    base, box = Atom("base_1"), Atom("box_a")
    for name, *args in [
        ("in", box, base),
        ("stacked", base, 1),
        ("stacked", base, 2),
        ("instance", base, Atom("base")),
    ]:
        engine.believe(literal(name, tuple(args)))
    engine.run_until_idle()
    facts = FactBase(engine, YARD)
    assert list(map(str, facts.facts())) == [
        "base_1 - base",
        "box_a - thing",
        "(in box_a base_1)",
        "(stacked base_1) = 2",
    ]
    assert not failures(engine)


def test_causes_chain_from_a_change_to_its_consequences(engine, facts):
    causes = []
    facts.watch(lambda fact, held, cause: causes.append(cause))
    facts.add(p("clear", "box_a"), cause="frame-7")
    instance, clear = causes
    assert [record.what for record in engine.trace.explain(instance)] == ["instance(box_a, thing)", "clear(box_a)"]
    assert [record.cause for record in engine.trace.explain(clear)] == ["frame-7"]


def test_the_source_is_noted(engine, facts):
    facts.add(p("loaded"), source="carrier_a")
    facts.add(p("clear", "start"), source="percept")
    assert {str(held.belief): held.source for held in engine.beliefs} == {
        "loaded": "carrier_a", "clear(start)": "percept",
    }  # fmt: skip


# Instances


def test_missing_instances_get_the_type_that_the_domain_asks_for(facts, told):
    facts.add(p("on", "box_a", "box_b", "base_1"))
    assert told == [
        ("box_a - box", True), ("box_b - thing", True), ("base_1 - base", True), ("(on box_a box_b base_1)", True),
    ]  # fmt: skip


def test_an_instance_that_was_made_gets_a_narrower_type_when_one_is_asked_for(engine, facts, told):
    facts.add(p("clear", "box_a"))
    facts.add(p("on", "box_a", "start", "start"))
    assert told[2:] == [("box_a - box", True), ("(on box_a start start)", True)]
    assert "instance(box_a, thing)" not in beliefs(engine)
    facts.add(p("clear", "base_1"))
    facts.add(i("base_1", "base"))
    assert facts.kinds("base_1") == ("base",)
    assert facts.objects(("thing",)) == ("base_1", "box_a", "start")


def test_a_declared_type_stays(facts):
    facts.add(i("box_a", "thing"))
    assert facts.unfit(p("on", "box_a", "start", "start")) == "(on box_a start start): box_a is a thing, not a box"
    assert not facts.add(i("box_a", "object"))
    assert facts.kinds("box_a") == ("thing",)


def test_facts_about_a_removed_instance_are_removed(engine, facts, told):
    for fact in [p("in", "box_a", "start"), p("clear", "box_a"), p("clear", "start"), n("load", value=1)]:
        facts.add(fact)
    told.clear()
    assert facts.remove(i("box_a")) == (i("box_a", "thing"),)
    assert told == [("box_a - thing", False), ("(clear box_a)", False), ("(in box_a start)", False)]
    assert sorted(beliefs(engine)) == ["clear(start)", "load(1)"]


# What does not fit


@pytest.mark.parametrize(
    ("fact", "reason"),
    [
        (p("clar", "start"), "there is no predicate 'clar'; did you mean 'clear'?"),
        (n("stakked", "start"), "there is no function 'stakked'; did you mean 'stacked'?"),
        (p("stacked", "start"), "'stacked' is a function; its pddl_type is 3"),
        (n("clear", "start"), "'clear' is a predicate; its pddl_type is 2"),
        (p("clear"), "(clear): (clear ?t - thing) has 1 parameter"),
        (p("clear", "stat"), "(clear stat): there is no object 'stat'; did you mean 'start'?"),
        (p("carrier_in_base", "start", "start"), "(carrier_in_base start start): start is a base, not a carrier"),
        (p("clear", "*"), "(clear *): '*' is no name: it needs a small letter, then small letters, digits, _ and -"),
        (p("on", "x", "start", "x"), "(on x start x): x cannot be both a box and a base"),
        (n("load", value=float("nan")), "(load) = nan: no number"),
        (i("c", "carier"), "c: there is no type 'carier'; did you mean 'carrier'?"),
        (i("start", "box"), "start is a base, not a box"),
        (i("Box", "box"), "'Box' is no name: it needs a small letter, then small letters, digits, _ and -"),
    ],
)  # fmt: skip
def test_misfits_have_different_reasons(facts, fact, reason):
    assert facts.unknown(fact) == reason


def test_an_instance_that_is_known_needs_no_type(facts, told):
    assert facts.unfit(i("start")) is facts.unknown(i("start")) is None
    assert facts.unfit(i("box_a")) == "box_a: its type is missing"
    assert not facts.add(i("start"))
    assert told == []


def test_conditions_require_known_objects(facts):
    for check, fact, reason in [
        ("EX", i("stat"), "there is no object 'stat'; did you mean 'start'?"),
        ("T", p("clear", "stat"), "(clear stat): there is no object 'stat'; did you mean 'start'?"),
        ("T", n("load"), "T checks a predicate, not a function"),
        ("EX", i("start"), None),
        ("F", p("clear", "start"), None),
    ]:
        assert facts.unknown_condition(FactCondition(check=check, condition_to_check=fact)) == reason  # type: ignore[arg-type]


def test_facts_that_can_never_fit_are_refused_and_new_objects_are_not(facts, told):
    with pytest.raises(PlanningError, match="start is a base, not a carrier"):
        facts.add(p("carrier_in_base", "start", "start"))
    assert told == []
    assert facts.unfit(p("clear", "stat")) is None
    assert facts.unknown(p("clear", "start")) is facts.unknown(i("stat", "box")) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("carrier_in_base(start, start).", "start is a base, not a carrier"),
        ('clear("start").', "its objects have to be atoms"),
        ("stacked(start, much).", "the value of a fluent a number"),
        ("instance(start, vessel).", None),
        ("instance(ship, vessel).", "there is no type 'vessel'"),
    ],
)
def test_beliefs_of_the_engine_that_do_not_fit_are_on_the_trace_and_no_facts(engine, facts, told, text, message):
    say(engine, text)
    assert told == []
    assert facts.facts() == ()
    if message:
        assert [message in failure for failure in failures(engine)] == [True]


def test_a_domain_whose_names_would_be_the_same_belief_is_refused(engine):
    clash = domain({}, ["load ?x:object"], ["load"], {})
    with pytest.raises(PlanningError, match="same belief"):
        FactBase(engine, clash)
    with pytest.raises(PlanningError, match="instance"):
        FactBase(engine, domain({}, ["instance ?x:object ?y:object"], [], {}))


# Conditions and problems


def test_conditions_are_checked_against_beliefs(facts):
    facts.add(i("box_a", "box"))
    facts.add(p("in", "box_a", "start"))
    facts.add(n("stacked", "start", value=2))
    checks = [
        ("EX", i("box_a"), True), ("EX", i("box_a", "thing"), True), ("EX", i("box_a", "carrier"), False),
        ("EX", i("box_*"), True), ("EX", i("nobody"), False),
        ("T", p("in", "box_a", "start"), True), ("T", p("in", "start", "box_a"), False),
        ("T", p("in", "box_?", "*"), True),
        ("F", p("in", "box_a", "start"), False), ("F", p("in", "box_b*", "start"), True),
        ("EQ", n("stacked", "start", value=2), True), ("EQ", n("stacked", "start", value=1), False),
        ("GR", n("stacked", "start", value=2), False), ("GR", n("stacked", "start", value=1), True),
        ("GREQ", n("stacked", "start", value=2), True), ("LE", n("stacked", "start", value=2), False),
        ("LE", n("stacked", "start", value=3), True), ("LEQ", n("stacked", "start", value=2), True),
        ("EQ", n("load", value=0), False), ("T", n("load", value=0), False),
    ]  # fmt: skip
    for check, fact, holds in checks:
        condition = FactCondition(check=check, condition_to_check=fact)  # type: ignore[arg-type]
        assert facts.check(condition) == holds, (check, str(fact))


def test_a_dnf_needs_one_of_its_conjunctions_and_none_always_holds(facts):
    assert facts.satisfied(dnf())
    either = dnf([("T", p("loaded")), ("T", p("clear", "start"))], [("GR", n("load", value=5))])
    assert not facts.satisfied(either)
    facts.add(n("load", value=6))
    assert facts.satisfied(either)
    facts.add(n("load", value=5))
    facts.add(p("loaded"))
    assert not facts.satisfied(either)
    facts.add(p("clear", "start"))
    assert facts.satisfied(either)


def test_a_desire_is_fulfilled_when_all_holds_that_it_wants(facts):
    no_box = FactCondition(check="F", condition_to_check=p("in", "*", "start"))
    desire = Desire(name="tidy", value=(p("loaded"), n("load", value=1)), conditions=(no_box,))
    facts.add(p("loaded"))
    assert not facts.fulfilled(desire)
    facts.add(n("load", value=1))
    assert facts.fulfilled(desire)
    facts.add(p("in", "box_a", "start"))
    assert not facts.fulfilled(desire)


def test_a_goal_is_written_as_a_formula(facts):
    wanted = (
        FactCondition(check="T", condition_to_check=p("loaded")),
        FactCondition(check="F", condition_to_check=p("clear", "start")),
        FactCondition(check="LE", condition_to_check=n("load", value=3)),
        FactCondition(check="EX", condition_to_check=i("start", "base")),
        FactCondition(check="EX", condition_to_check=i("nobody")),
    )
    loaded, clear = Predicate("loaded"), Predicate("clear", ("start",))
    assert facts.goal(wanted) == And(
        (loaded, Not(clear), NumericComparison("<", Fluent("load"), Number(3)), And(), Or())
    )


def test_a_problem_contains_the_current_beliefs(facts):
    facts.add(p("in", "box_a", "start"))
    facts.add(n("stacked", "start", value=1))
    problem = facts.problem(Predicate("loaded"))
    facts.add(p("loaded"))
    assert problem.objects == {"box_a": ("thing",)}
    assert problem.facts == {Predicate("in", ("box_a", "start"))}
    assert problem.values == {Fluent("stacked", ("start",)): 1.0}
    assert (problem.domain, problem.goal) == ("yard", Predicate("loaded"))


# Watching


def test_watchers_that_change_facts_are_called_in_order(facts):
    first, second = [], []

    def react(fact, held, cause):
        first.append(str(fact))
        if fact.name == "loaded":
            facts.remove(fact, cause)

    facts.watch(react)
    facts.watch(lambda fact, held, cause: second.append((str(fact), held)))
    facts.add(p("loaded"))
    assert second == [("(loaded)", True), ("(loaded)", False)]
    assert first == ["(loaded)"] * 2


def test_an_exception_in_a_watcher_stops_no_other(engine, facts):
    def fail(fact, held, cause):
        raise ValueError("no idea")

    facts.watch(fail)
    changes = []
    facts.watch(lambda fact, held, cause: changes.append(fact))
    facts.add(p("loaded"))
    assert changes == [p("loaded")]
    assert failures(engine) == ["no idea"]


# Predicates that the domain derives

TOWER = read_domain("""
(define (domain tower)
  (:requirements :typing :derived-predicates :negative-preconditions)
  (:types block)
  (:predicates (on ?a - block ?b - block) (above ?a - block ?b - block) (bare ?a - block) (tidy))
  (:derived (above ?a - block ?b - block)
    (or (on ?a ?b) (exists (?c - block) (and (on ?a ?c) (above ?c ?b)))))
  (:derived (bare ?a - block) (not (exists (?b - block) (on ?b ?a))))
  (:derived (tidy) (not (exists (?a - block ?b - block) (on ?a ?b)))))
""")


def test_derived_predicates_hold_and_are_reported_but_are_no_beliefs(engine):
    facts = FactBase(engine, TOWER)
    told = []
    facts.watch(lambda fact, held, cause: told.append((str(fact), held)))
    assert facts.holds(Predicate("tidy"))
    facts.add(p("on", "a", "b"))
    assert told[-4:] == [("(on a b)", True), ("(above a b)", True), ("(bare b)", False), ("(tidy)", False)]
    facts.add(p("on", "b", "c"))
    assert facts.check(FactCondition(check="T", condition_to_check=p("above", "a", "c")))
    assert facts.fulfilled(Desire(name="high", value=(p("above", "a", "c"), p("bare", "a"))))
    assert {fact.name for fact in facts.facts()} == {"a", "b", "c", "on"}
    assert facts.problem().facts == {Predicate("on", ("a", "b")), Predicate("on", ("b", "c"))}
    assert not any("above" in belief for belief in beliefs(engine))
    facts.remove(p("on", "b", "*"))
    assert not facts.holds(Predicate("above", ("a", "c")))


def test_derived_predicates_cannot_be_believed(engine):
    facts = FactBase(engine, TOWER)
    assert not facts.add(p("above", "a", "b"))
    say(engine, "above(a, b).")
    assert facts.remove(p("tidy")) == ()
    assert facts.holds(Predicate("tidy"))
    assert facts.facts() == ()
    assert failures(engine) == ["it is a derived predicate and cannot be believed by itself"] * 2


THINGS = st.sampled_from(["a", "b", "start"])
CHANGES = st.one_of(
    st.tuples(st.sampled_from(["add", "remove"]), st.builds(lambda x, y: p("in", x, y), THINGS, THINGS)),
    st.tuples(
        st.sampled_from(["add", "remove", "rule"]),
        st.builds(lambda x: n("stacked", "start", value=x), st.integers(0, 3)),
    ),
    st.tuples(st.sampled_from(["add", "remove"]), st.builds(i, st.sampled_from(["a", "b"]), st.just("box"))),
)


@given(st.lists(CHANGES, max_size=25))
@settings(max_examples=150, deadline=None)
def test_facts_watchers_and_beliefs_always_agree(changes):
    engine = Engine("any", ManualClock())
    facts = FactBase(engine, YARD)
    heard = {}

    def hear(fact, held, cause):
        if held:
            heard[fact.identity] = fact
        else:
            assert heard.pop(fact.identity) == fact

    facts.watch(hear)
    for how, fact in changes:
        if how == "add" and facts.unfit(fact) is None:
            facts.add(fact)
        elif how == "remove":
            facts.remove(fact)
        elif how == "rule":
            engine.believe(literal("stacked", (Atom("start"), int(fact.value))))
            engine.run_until_idle()
        assert sorted(heard) == [fact.identity for fact in facts.facts()]
        assert set(heard.values()) == set(facts.facts())
        assert len(list(engine.beliefs)) == len(heard)
        for fact in facts.facts():
            assert all(facts.kinds(name) for name in fact.params)
