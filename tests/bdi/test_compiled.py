"""Faults that only compiled plans can have."""
# ruff: noqa: N801, N803 - literals, and the variables that functions look at, are written as agents write them

from __future__ import annotations

import itertools
import traceback

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import (
    Atom,
    Belief,
    Engine,
    Library,
    Variable,
    _explain,
    action,
    ask,
    atomic,
    enter,
    for_each,
    labelled,
    priority,
    stage,
    variables,
    wait_for,
    when,
)
from socialbot.bdi import test as check
from socialbot.bdi.library import Trigger
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Cons, Disjunction, Negation, conjunction
from socialbot.core.clock import ManualClock
from tests.bdi.lab import Lab, X, Y, Z, _, crash, do, go, p, ping, q, sub


def tell(lab, *items):
    """Send the agent a sequence of events."""
    for item in items:
        lab.tell(item)


# Conditions


def test_joins_may_be_deeper_than_python_nests_blocks():
    names = variables(" ".join(f"V{number}" for number in range(26)))
    lab = Lab(go() / conjunction(*itertools.starmap(p, itertools.pairwise(names))) >> [do(names[0], names[25])])
    lab.tell(*(+p(number, number + 1) for number in range(25)), +p(3, 99), go())
    assert lab.done == [(0, 25)]


def test_any_number_of_comparisons_can_be_joined():
    lab = Lab(+p(X) / conjunction(*(X > number for number in range(200))) >> [do(X)])  # noqa: SIM300
    lab.tell(+p(199), +p(200))
    assert lab.done == [200]


@pytest.mark.parametrize("depth", [19, 20])
def test_negations_may_be_nested_deeply(depth):
    condition = q(X)
    for number in range(depth):
        condition = Negation(conjunction(p(number), condition))
    lab = Lab(go() / condition >> [do("holds")])
    lab.tell(*(+p(number) for number in range(depth)), go())
    assert lab.done == (["holds"] if depth % 2 else [])


def test_negations_and_alternatives_may_be_nested():
    either = Disjunction((conjunction(p(X), ~(q(X) | q(X, X))), conjunction(q(X, Y), ~p(Y))))
    lab = Lab(go() / (either & (X > 0)) >> [do(X)], go() >> [do("none")])
    tell(lab, go(), +p(1), +q(1), go(), +q(2, 1), go(), +q(3, 9), go(), +p(4), go(), +q(4, 4), go())
    assert lab.done == ["none", "none", "none", 3, 4, 3]


def test_a_variable_of_one_alternative_has_a_value_when_that_one_holds():
    lab = Lab(go() / ((p(X) & q(Y)) | (p(X) & (X > 5))) >> [when(q(Y), [do(X, Y)], [do(X)])])
    tell(lab, +p(1), +p(9), go(), +q(3), go())
    assert lab.done == [9, (9, 3)]


@pytest.mark.parametrize("name", ["None", "True", "ag", "args", "class", "cause", "trail", "notes", "v_X", "mark", "c"])
def test_variables_may_have_any_name(name):
    some, other = Variable(name), Variable(f"{name}_")
    lab = Lab(
        go(some) / (p(some, other) & ~q(other) & (other > some)) >> [+q(some), ask(p(some, other)), do(some, other)],
        +q(some) >> [sub(Y), do(Y)],
        sub(some) / p(some, _) >> [],
    )
    lab.tell(+p(1, 2), go(1))
    assert sorted(lab.done, key=str) == [(1, 2), 1]
    assert lab.kinds("failure") == []


def test_names_of_literals_may_be_words_of_python_and_of_the_compiler():
    class yielded(Belief): ...

    lab = Lab(*atomic(go(1) >> [+yielded(1)]), go(1) >> [do("never")], go(2) / yielded(X) >> [do(X)])
    tell(lab, go(1), go(2))
    assert lab.done == [1]


EQUAL = "".join(["a ", "string"])


@pytest.mark.parametrize(
    ("written", "held"),
    [
        (EQUAL, "".join(["a", " string"])),
        (10**30, 10**29 * 10),
        (1, 1.0),
        (1, True),
        ((1, (2, "x")), (1, (2, "x"))),
        (Atom("a"), Atom("a")),
        (literal("f", (1, "b")), literal("f", (1, "b"))),
        ("say \"hi\"\n'there' \\", "say \"hi\"\n'there' \\"),
        ("", ""),
        (None, None),
    ],
    ids=str,
)
def test_constants_are_equal_though_not_identical(written, held):
    lab = Lab(
        +p(written) / (p(X) & (X == written) & ~q(written) & p(written)) >> [do("head"), +q(written)],  # noqa: SIM300
        +p(X) >> [do("never")],
        go(X) / (q(X) & q(written)) >> [sub(X)],
        sub(written) >> [do("goal")],
    )
    tell(lab, +p(held), go(held))
    assert lab.done == ["head", "goal"]


def test_atoms_and_strings_of_the_same_letters_are_different():
    lab = Lab(+p(Atom("yes")) >> [do("atom")], +p("yes") >> [do("string")])
    lab.tell(+p("yes"), +p(Atom("yes")))
    assert lab.done == ["string", "atom"]


def test_lists_and_literals_are_taken_apart_in_events_and_conditions():
    lab = Lab(
        +p((X, (Y, X))) >> [do("pair", X, Y)],
        +p(literal("f", (X, literal("g", (Y,))))) >> [do("f", X, Y)],
        +p(X) / q((X, Y)) >> [do("q", Y)],
        +p(X) >> [do("other")],
    )
    tell(
        lab, +q((7, 8)), +p((1, (2, 1))), +p((1, (2, 3))), +p((1, 2)), +p(literal("f", (1, literal("g", (2,))))),
        +p(literal("f", (1, 2))), +p(literal("f", (1, literal("h", (2,))))), +p(7),
    )  # fmt: skip
    assert lab.done == [("pair", 1, 2), "other", "other", ("f", 1, 2), "other", "other", ("q", 8)]


def test_a_list_is_its_first_and_its_rest():
    lab = Lab(
        sub((), X, X) >> [],
        sub(Cons((X,), Y), Z, Cons((X,), Variable("R"))) >> [sub(Y, Z, Variable("R"))],
        go() >> [sub((1, 2), (3,), X), do(X), check(~p(Cons((1, 2), _))), +p(X)],
        +p(Cons((X, 2), Y)) >> [do(X, Y)],
    )
    tell(lab, go(), +p((1,)), +p(5))
    assert lab.done == [(1, 2, 3), (1, (3,))]


def test_beliefs_are_found_by_any_of_their_arguments():
    lab = Lab(go(X) / p(Y, X) >> [do(Y)], sub(X) / p(X, Y) >> [do(Y)], +q(X) / p(_, X) >> [do("q")])
    tell(lab, +p(1, 2), +p(3, 4), go(4), sub(1), +q(2), +q(9), -p(3, 4), go(4), +p(5, 4), go(4))
    assert lab.done == [3, 2, "q", 5]
    assert set(lab.engine.beliefs.relation("p/2").indexes) == {(0,), (1,)}


# The choice of a plan


def test_of_a_thousand_plans_the_right_one_is_chosen():
    rules = [go(number, X) >> [do(number, X)] for number in range(1000)]
    lab = Lab(*rules[:500], go(X, 0) >> [do("zero", X)], *rules[500:])
    lab.tell(*(go(number, 1) for number in (0, 499, 500, 999)), go(499, 0), go(500, 0), go(1000, 0))
    assert lab.done == [(0, 1), (499, 1), (500, 1), (999, 1), (499, 0), ("zero", 500), ("zero", 1000)]
    assert len(lab.engine.library.triggers["+!go/2"].candidates((7, 7))) == 2


HEADS = st.tuples(
    *[st.sampled_from((0, 1, 2, "a", X, Y, _, (1, X), literal("f", (1,)), literal("f", (1,), (Atom("n"),))))] * 2
)
CALLS = st.tuples(
    *[st.sampled_from((0, 1, 2, 3, "a", (1, 2), literal("f", (1,)), literal("f", (1,), (Atom("n"), Atom("m")))))] * 2
)
CHANGES = st.lists(
    st.one_of(
        st.tuples(st.just("add"), HEADS, st.sampled_from((0, 0, 0, 1, -1)), st.booleans()),
        st.tuples(st.just("remove"), st.integers(0, 9)),
        st.tuples(st.just("call"), CALLS),
    ),
    max_size=25,
)


@settings(deadline=None)
@given(CHANGES)
def test_adds_and_removes_plans_at_run_time(changes):
    lab = Lab()
    trigger, plans = lab.engine.library.triggers["+!go/2"], []
    for number, (what, *how) in enumerate(changes):
        if what == "add":
            head, rank, first = how
            (plan,) = priority(rank, go(*head) >> [do(number)])
            lab.engine.add_rules(plan, first=first)
            plans.insert(0, plan) if first else plans.append(plan)
            plans.sort(key=lambda plan: -plan.priority)
        elif what == "remove" and plans:
            assert lab.engine.remove_plan(plans.pop(how[0] % len(plans)))
        elif what == "call":
            chosen = [
                plan
                for plan in plans
                if Trigger("", (lab_plan(plan),)).plans[0].run(lab.engine.interpreter, how[0], (), "")
            ]
            before = len(lab.done)
            lab.tell(go(*how[0]))
            assert lab.done[before:] == [plan.body[0].action.args[0] for plan in chosen[:1]]
            lab.trace.clear()
    assert [ready.plan for ready in trigger.plans] == plans


def lab_plan(plan):
    """The plan alone in a library; whether it fits an event is seen without doing its steps."""
    library = Library()
    return library.add(go(*plan.event.literal.args) >> [wait_for(p(0))])


def test_a_plan_removed_by_its_label_is_chosen_no_longer():
    lab = Lab(labelled("one", go() >> [do(1)]), go() >> [do(2)])
    lab.tell(go())
    assert lab.engine.remove_plan("one")
    assert not lab.engine.remove_plan("one")
    lab.tell(go())
    assert lab.done == [1, 2]


def test_orders_plans_by_priority_then_by_addition():
    lab = Lab(
        go(X) >> [do("last")], priority(1, go(1) >> [do("one")], go(X) >> [do("any")]), priority(2, go(2) >> [do(2)])
    )
    lab.tell(go(1), go(2), go(3))
    assert lab.done == ["one", 2, "any"]


def test_plans_of_other_stages_are_not_chosen():
    lab = Lab(
        stage("day", go() >> [do("day"), enter("night")]),
        stage("night", go() >> [do("night")]),
        go() >> [do("any"), enter("day")],
    )
    lab.tell(go())
    lab.tell(go())
    lab.tell(go())
    assert lab.done == ["any", "day", "night"]
    assert lab.engine.interpreter.stage == "night"


def test_agents_that_share_a_library_go_their_own_ways_when_one_adds_a_plan():
    library = Library()
    for rule in (+p(X) / ~q(X) >> [do("p", X)], go(X) >> [do("go", X)]):
        library.add(rule)
    labs = [Lab(name=name) for name in ("one", "two")]
    for lab in labs:
        lab.engine = Engine(lab.engine.name, lab.clock, robot=lab, library=library)
        lab.tell(+p(1))
    labs[0].engine.add_rules(-p(X) >> [do("gone", X)], go(X) >> [do("never")])
    assert labs[0].engine.library is not labs[1].engine.library is library
    for lab in labs:
        lab.tell(-p(1), +q(2), +p(2), +p(3), go(1))
    assert labs[0].done == [("p", 1), ("gone", 1), ("p", 3), ("go", 1)]
    assert labs[1].done == [("p", 1), ("p", 3), ("go", 1)]


# Depth


@action
def note(engine, what):
    engine.robot.append(what)


def descend(depth, *rules):
    engine = Engine("deep", ManualClock(), robot=[])
    engine.add_rules(go(0) >> [note("bottom")], *rules)
    engine.achieve(go(depth))
    while engine.run_until_idle():
        pass
    assert engine.mind().intentions == ()
    return engine.robot


@pytest.mark.slow
def test_a_goal_as_last_step_may_go_a_million_deep():
    assert descend(1_000_000, go(X) >> [go(X - 1)]) == ["bottom"]


@pytest.mark.parametrize(
    "depth", [10_000, *(pytest.param(depth, marks=pytest.mark.slow) for depth in (100_000, 1_000_000))]
)
def test_a_goal_that_has_to_be_returned_to_may_go_as_deep_as_memory_allows(depth):
    assert descend(depth, go(X) >> [go(X - 1), note(X)]) == ["bottom", *range(1, depth + 1)]


def test_plans_of_goals_with_variables_are_compiled_for_these_variables():
    """The general form of a plan, which any arguments fit, is several times slower."""
    lab = Lab(go(X) >> [sub(X, Y), do(Y)], sub(X, Y) / q(X, Y) >> [do("found"), do(X)])
    lab.engine.trace.sink = None
    lab.tell(+q(1, 2), +q(2, 3), go(1), go(2))
    assert lab.done.count("found") == 2
    (compiled,) = lab.engine.library.triggers["+!sub/2"].plans
    assert list(compiled.modes) == [0b10]


def test_failure_propagates_through_many_levels():
    assert descend(50_000, -go(50_000) >> [note("caught")], go(1) >> [crash()], go(X) >> [go(X - 1), note(X)]) == [
        "caught"
    ]


# Exceptions


def broken(X=0):
    raise KeyError("mine")


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (do(X / 0), "do(X / 0)"),
        (crash(), "crash()"),
        (+p(X / 0), "+p(X / 0)"),
        (-p(X / 0), "-p(X / 0)"),
        (sub(X / 0), "sub(X / 0)"),
        (check(X > "a"), 'test(X > "a")'),
        (check(conjunction(lambda X: broken(X))), "test(<lambda>(X))"),
        (ask(q(X / 0)), "ask(q(X / 0))"),
        (when(X > "a", []), 'when(X > "a", [])'),
        (for_each(p(Y) & (lambda Y: broken(Y)), []), "for_each(p(Y) & <lambda>(Y), [])"),
        (wait_for(p(Y) & (X > "a")), 'wait_for(p(Y) & (X > "a"))'),
        (when(X > 0, [do("in"), do(X / 0)]), "do(X / 0)"),
    ],
    ids=str,
)
@pytest.mark.parametrize("rule", [go, lambda X: +q(X)], ids=["goal", "event"])
@pytest.mark.parametrize("before", [[], [do("before")], [sub(X)]], ids=["first", "after an action", "after a goal"])
@pytest.mark.parametrize("alone", [True, False])
def test_an_exception_fails_the_goal_and_names_its_step(step, text, rule, before, alone):
    lab = Lab(
        rule(X) >> [*before, step, do("never")],
        *atomic(-go(X) >> [do("failed")]),
        sub(_) >> [],
        +ping(X) >> [do("other")] * 9,
    )
    lab.engine.believe(p(1))
    event = rule(1)
    lab.tell(*([] if alone else [+ping(1)]), event)
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    assert (failure.what, failure.detail["reason"]) == (text, "exception")
    assert failure.cause in {record.id for record in lab.trace if record.kind in ("plan", "action")}
    assert "never" not in lab.done
    assert ("failed" in lab.done) == (rule is go)
    assert lab.done.count("other") == (0 if alone else 9)
    assert lab.engine.mind().intentions == ()


@pytest.mark.parametrize(
    "condition",
    [
        conjunction(lambda: broken()),
        p(X) & (lambda: broken()),
        ~p(9) & (X > "a"),
        Negation(conjunction(p(Y), lambda Y: broken(Y))),
        (p(9) | conjunction(lambda X: broken(X))) & p(1),
        p(X / 0) & p(1),
    ],
    ids=str,
)
@pytest.mark.parametrize("head", [+q(X), go(X), -sub(X)], ids=str)
def test_an_exception_in_a_condition_leaves_the_plan_out(condition, head):
    lab = Lab(head / condition >> [do("never")], head >> [do("next")], sub(_) >> [crash()])
    tell(lab, +p(1), +q(1), sub(1), go(1))
    assert lab.done == ["next"]


def test_a_plan_left_out_by_an_exception_leaves_no_values_behind():
    lab = Lab(go() >> [sub(X), do(X)], sub(1) / conjunction(lambda: broken()) >> [], sub(2) >> [])
    lab.tell(go())
    assert lab.done == [2]


def test_a_traceback_shows_the_generated_line(monkeypatch):
    seen = []

    def failed(plan, problem):
        seen.append("".join(traceback.format_exception(problem)))
        return original(plan, problem)

    original = _explain.failed_step
    monkeypatch.setattr(_explain, "failed_step", failed)
    lab = Lab(go(X) >> [do(1), note(X / 0)])
    lab.tell(go(1))
    assert "(v_X / (0))" in seen[0]
    assert "ZeroDivisionError" in seen[0]
