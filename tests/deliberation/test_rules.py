"""Rules from beliefs to beliefs and desires."""

from __future__ import annotations

import contextlib
import itertools
import statistics
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Engine, Trace
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.deliberation._matching import matches
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import Desire, Dnf, FactCondition, FactConjunction
from socialbot.deliberation.rules import ReactiveRule, RuleBook, RuleEffect
from tests.deliberation.domains import YARD, dnf, domain, i, n, p
from tests.deliberation.test_matching import CLAUSES, FACTS


@pytest.fixture
def facts():
    base = FactBase(Engine("gripper_a", ManualClock(), sink=Trace()), YARD)
    for name, kind in [("base_a", "base"), ("base_b", "base"), ("carrier_a", "carrier"), ("box_a", "box")]:
        base.add(i(name, kind))
    return base


@pytest.fixture
def book(facts):
    return RuleBook(facts)


def add(fact):
    return RuleEffect(operation="ADD", fact=fact)


def delete(fact):
    return RuleEffect(operation="DEL", fact=fact)


def rule(condition, *effects, name="rule"):
    return ReactiveRule(name, condition, effects)


def fired(book):
    return [str(reaction) for reaction in book.react()]


BOTH = dnf([("T", p("in", "{x}", "base_a")), ("T", p("clear", "{x}"))])


def test_a_rule_fires_once_for_each_match(facts, book):
    book.add(rule(BOTH, add(p("next_to", "{x}", "base_a")), delete(p("in", "{x}", "*"))))
    facts.add(p("in", "box_a", "base_a"))
    assert fired(book) == []
    facts.add(p("clear", "box_a"))
    assert fired(book) == ["ADD belief (next_to box_a base_a)", "DEL belief (in box_a *)"]
    assert fired(book) == []
    facts.add(p("clear", "base_a"))
    assert fired(book) == []
    facts.add(p("in", "base_a", "base_a"))
    assert fired(book) == ["ADD belief (next_to base_a base_a)", "DEL belief (in base_a *)"]


def test_a_match_that_is_gone_and_comes_again_is_new(facts, book):
    book.add(rule(BOTH, add(p("loaded"))))
    for fact in [p("in", "box_a", "base_a"), p("clear", "box_a")]:
        facts.add(fact)
    assert fired(book) == ["ADD belief (loaded)"]
    facts.remove(p("clear", "box_a"))
    assert fired(book) == []
    facts.add(p("clear", "box_a"))
    assert fired(book) == ["ADD belief (loaded)"]


def test_a_fact_restored_before_the_next_reaction_is_not_new(facts, book):
    facts.add(p("loaded"))
    book.add(rule(dnf([("T", p("loaded"))]), add(p("clear", "base_a"))))
    assert len(fired(book)) == 1
    facts.remove(p("loaded"))
    facts.add(p("loaded"))
    assert fired(book) == []


def test_another_value_of_a_fluent_that_is_compared_is_a_new_match(facts, book):
    book.add(rule(dnf([("GREQ", n("stacked", "{b}", value=2))]), delete(p("clear", "{b}"))))
    for value, count in [(1, 0), (2, 1), (2, 0), (3, 1), (1, 0), (3, 1)]:
        facts.add(n("stacked", "base_a", value=value))
        assert len(fired(book)) == count, value


def test_a_rule_about_other_facts_does_not_fire_for_a_value(facts, book):
    book.add(rule(dnf([("T", p("loaded"))]), add(p("clear", "base_a"))))
    facts.add(p("loaded"))
    facts.add(n("stacked", "base_a", value=1))
    assert len(fired(book)) == 1
    facts.add(n("stacked", "base_a", value=2))
    assert fired(book) == []


def test_a_negation_fires_for_each_instance_and_new_ones(facts, book):
    free = dnf([("F", p("in", "box_*", "{b}")), ("F", p("carrier_in_base", "*", "{b}")), ("EX", i("{b}", "base"))])
    book.add(rule(free, add(p("clear", "{b}"))))
    assert fired(book) == [f"ADD belief (clear {name})" for name in ("base_a", "base_b", "start")]
    facts.add(p("carrier_in_base", "carrier_a", "base_a"))
    assert fired(book) == []
    facts.add(i("base_c", "base"))
    assert fired(book) == ["ADD belief (clear base_c)"]
    facts.remove(p("carrier_in_base", "*", "*"))
    assert fired(book) == ["ADD belief (clear base_a)"]


def test_a_condition_that_holds_another_way_has_not_begun_to_hold(facts, book):
    either = dnf([("T", p("loaded"))], [("T", p("clear", "start"))])
    book.add(rule(either, add(p("clear", "base_a"))))
    facts.add(p("loaded"))
    assert len(fired(book)) == 1
    facts.add(p("clear", "start"))
    assert fired(book) == []
    facts.remove(p("loaded"))
    assert fired(book) == []
    facts.remove(p("clear", "start"))
    facts.add(p("loaded"))
    assert fired(book) == []


def test_a_replacement_within_one_turn_is_no_change(facts, book):
    book.add(rule(dnf([("T", p("loaded"))], [("T", p("clear", "start"))]), add(p("clear", "base_a"))))
    facts.add(p("loaded"))
    assert len(fired(book)) == 1
    facts.remove(p("loaded"))
    facts.add(p("clear", "start"))
    assert fired(book) == []


def test_variables_stand_everywhere_in_a_desire(facts, book):
    desire = Desire(
        name="do_{b}_{c}",
        value=(p("carrier_in_base", "{c}", "{b}"),),
        conditions=(FactCondition(check="F", condition_to_check=p("in", "box_a", "{b}")),),
        precondition=dnf([("T", p("clear", "{b}"))]),
        rollback_belief_add=(p("clear", "{b}"),),
        priority=0.8,
        deadline=16.0,
        parent="visit_{c}",
    )
    book.add(rule(dnf([("T", p("carrier_in_base", "{c}", "{b}"))]), RuleEffect(operation="ADD", desire=desire)))
    facts.add(p("carrier_in_base", "carrier_a", "base_b"))
    (reaction,) = book.react()
    made = reaction.effect.desire
    assert (made.name, made.parent, made.priority) == ("do_base_b_carrier_a", "visit_carrier_a", 0.8)
    assert made.value == (p("carrier_in_base", "carrier_a", "base_b"),)
    assert made.conditions[0].condition_to_check == p("in", "box_a", "base_b")
    assert made.precondition == dnf([("T", p("clear", "base_b"))])
    assert made.rollback_belief_add == (p("clear", "base_b"),)
    assert (str(reaction), reaction.effect.set, reaction.rule) == ("ADD desire do_base_b_carrier_a", "desire", "rule")
    assert reaction.match.binding == {"b": "base_b", "c": "carrier_a"}


def test_a_variable_of_an_effect_alone_is_each_instance_of_its_type(facts, book):
    book.add(rule(dnf([("T", p("loaded"))]), add(p("carrier_in_base", "carrier_a", "{b}"))))
    facts.add(p("loaded"))
    assert [reaction.match.binding["b"] for reaction in book.react()] == ["base_a", "base_b", "start"]
    facts.add(i("base_c", "base"))
    assert fired(book) == ["ADD belief (carrier_in_base carrier_a base_c)"]


def test_a_new_rule_fires_for_current_facts(facts, book):
    facts.add(p("loaded"))
    assert fired(book) == []
    book.add(rule(dnf([("T", p("loaded"))]), add(p("clear", "base_a"))))
    assert fired(book) == ["ADD belief (clear base_a)"]


def test_rules_that_went_fire_no_more_and_can_come_again(facts, book):
    mine = rule(dnf([("T", p("load*"))]), add(p("clear", "base_a")))
    book.add(mine)
    assert mine.name in book
    assert [one.name for one in book] == ["rule"]
    assert book.remove("rule")
    assert not book.remove("rule")
    facts.add(p("loaded"))
    assert fired(book) == []
    book.add(mine)
    assert (len(book), fired(book)) == (1, ["ADD belief (clear base_a)"])


def test_a_rule_may_read_whatever_has_a_name_like_that(facts, book):
    book.add(rule(dnf([("T", p("c*", "{x}", "base_?"))]), add(p("loaded"))))
    facts.add(p("in", "box_a", "base_a"))
    facts.add(p("clear", "box_a"))
    assert fired(book) == []
    facts.add(p("carrier_in_base", "carrier_a", "base_a"))
    assert [reaction.match.binding for reaction in book.react()] == [{"x": "carrier_a"}]


def test_instances_are_asked_for_and_deleted_by_a_variable(facts, book):
    book.add(rule(dnf([("EX", i("{x}", "box")), ("T", p("in", "{x}", "*"))]), delete(i("{x}", "thing"))))
    facts.add(p("in", "box_a", "base_a"))
    facts.add(p("in", "base_b", "base_a"))
    (reaction,) = book.react()
    assert facts.remove(reaction.effect.fact) == (i("box_a", "box"),)
    assert facts.facts()[-1] == p("in", "base_b", "base_a")


def test_reactions_come_in_the_order_of_rules_and_matches_whatever_changed_first(facts, book):
    book.add(rule(dnf([("T", p("clear", "{x}"))]), add(p("loaded")), name="second"))
    book.add(rule(dnf([("T", p("loaded"))]), add(p("loaded")), name="first"))
    for fact in [p("loaded"), p("clear", "box_a"), p("clear", "base_a")]:
        facts.add(fact)
    found = [(reaction.rule, str(reaction.match)) for reaction in book.react()]
    assert found == [("second", "x=base_a"), ("second", "x=box_a"), ("first", "")]


def test_the_cause_is_the_change_that_made_the_condition_hold(facts, book):
    book.add(rule(BOTH, add(p("loaded"))))
    facts.add(p("clear", "box_a"))
    facts.add(p("in", "box_a", "base_a"), cause="camera")
    (reaction,) = book.react()
    assert [record.what for record in facts.engine.trace.explain(reaction.cause)] == ["in(box_a, base_a)"]


def test_an_effect_that_does_not_fit_is_on_the_trace_and_the_others_go_on(facts, book):
    condition = dnf([("T", p("next_to", "{x}", "base_a"))])
    book.add(rule(condition, add(p("clear", "{x}")), add(p("loaded"))))
    facts.add(p("next_to", "carrier_a", "base_a"))
    assert fired(book) == ["ADD belief (loaded)"]
    (failure,) = facts.engine.trace.sink.find("failure")
    assert failure.what == "rule rule"
    assert "carrier_a is a carrier, not a thing" in failure.detail["message"]


@pytest.mark.parametrize(
    ("condition", "effect", "reason"),
    [
        (dnf([("T", p("clearr", "start"))]), add(p("loaded")), "did you mean 'clear'?"),
        (dnf([("T", n("load"))]), add(p("loaded")), "T checks a predicate, not a function"),
        (dnf([("T", p("loaded"))]), add(p("lowded")), "did you mean 'loaded'?"),
        (dnf([("T", p("clear", "{x}"))], []), RuleEffect(operation="DEL", desire=Desire(name="do_{x}")),
         "the variable {x} is not bound in DEL desire do_{x} (conjunction 2"),
        (Dnf(), RuleEffect(operation="ADD", desire=Desire(name="do", value=(p("clear", "carrier_a"),))), "not a thing"),
        (Dnf(), RuleEffect(operation="ADD", desire=Desire(name="do")), "the desire do wants nothing"),
        (Dnf(), RuleEffect(operation="ADD", desire=Desire(name="do", value=(p("in", "*", "{x}"),))), "names, not '*'"),
        (Dnf(), RuleEffect(operation="ADD", desire=Desire(name="d?", value=(p("loaded"),))), "needs names, not 'd?'"),
        (Dnf(), RuleEffect(operation="ADD", desire=Desire(name="d", value=(p("loaded"),), deadline=1e9)), "deadline"),
        (Dnf(), RuleEffect(operation="ADD", fact=p("clear", "box_*")), "needs names, not 'box_*'"),
    ],
)  # fmt: skip
def test_rules_that_make_no_sense_are_refused(book, condition, effect, reason):
    with pytest.raises(PlanningError) as caught:
        book.add(rule(condition, effect, name="odd"))
    assert reason in caught.value.what
    assert caught.value.where == "rule odd"
    assert len(book) == 0


def test_two_rules_of_one_name_are_refused(book):
    book.add(rule(dnf(), add(p("loaded"))))
    with pytest.raises(PlanningError, match="there is a rule of this name"):
        book.add(rule(dnf(), add(p("loaded"))))


def test_an_effect_is_either_a_belief_or_a_desire():
    with pytest.raises(PlanningError, match="a belief or a desire"):
        RuleEffect(operation="ADD")


def test_a_change_among_many_facts_is_dealt_with_quickly():
    names, things = [f"p{k} ?a:thing ?b:thing" for k in range(10)], [f"o{k}" for k in range(100)]
    base = FactBase(Engine("any", ManualClock()), domain({"thing": "object"}, names, ["f ?a:thing"], {}))
    for thing, other in itertools.product(range(100), range(9)):
        base.add(p(f"p{other}", things[thing], things[(thing * 7 + other) % 100]))
    for thing in things:
        base.add(n("f", thing, value=1))
    book = RuleBook(base)
    for k in range(50):
        parts = [
            ("T", p(f"p{k % 9}", "{x}", "{y}")),
            ("T", p(f"p{k * 7 % 9}", "{y}", "{z}")),
            ("F", p("p9", "{z}", "*")),
        ]
        condition = dnf([*parts, ("GREQ", n("f", "{x}", value=k % 3))])
        book.add(rule(condition, add(p("p9", "{x}", "{z}")), name=str(k)))
    book.react()
    assert len(base.facts()) == 1100
    seconds, count = [], 0
    for k in range(200):
        fact = p(f"p{k % 9}", things[k * 13 % 100], things[k * 7 % 100])
        base.add(fact) if k % 3 else base.remove(fact)
        begin = time.thread_time()
        count += len(book.react())
        seconds.append(time.thread_time() - begin)
    assert count > 100
    assert statistics.median(seconds) < 0.001


CONDITIONS = st.lists(CLAUSES, min_size=1, max_size=2)


@given(st.lists(CONDITIONS, min_size=1, max_size=3), st.lists(st.tuples(FACTS, FACTS), max_size=6))
@settings(max_examples=120, deadline=None)
def test_only_new_matches_fire(conditions, turns):
    base = FactBase(Engine("any", ManualClock()), YARD)
    for name, kind in [("box_a", "box"), ("base_1", "base"), ("carrier_a", "carrier")]:
        base.add(i(name, kind))
    book = RuleBook(base)
    rules = [rule(dnf(*condition), add(p("loaded")), name=str(number)) for number, condition in enumerate(conditions)]
    for one in rules:
        with contextlib.suppress(PlanningError):
            book.add(one)
    before = {one.name: [] for one in book}
    for added, removed in turns:
        for fact in added:
            if base.unfit(fact) is None:
                base.add(fact)
        for fact in removed:
            base.remove(fact)
        now = {one.name: matches(one.condition, base) for one in book}
        expected = [(name, match) for name, found in now.items() for match in found if match not in before[name]]
        assert [(reaction.rule, reaction.match) for reaction in book.react()] == expected
        before = now


def test_conditions_without_clauses_hold_from_the_start(book):
    book.add(rule(Dnf(clauses=(FactConjunction(),)), add(p("loaded")), name="one"))
    book.add(rule(Dnf(), add(p("loaded")), name="two"))
    assert len(fired(book)) == 2
    assert fired(book) == []
