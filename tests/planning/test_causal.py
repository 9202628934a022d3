from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.causal_order import CausalOrder, causal_order, contributing
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep, parse_plan
from socialbot.planning.pddl.formulas import Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.semantics import changes, ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import validate_plan
from tests.planning import brute_force, texts
from tests.planning.random_worlds import OBJECTS, random_pair, random_plan
from tests.planning.texts import CRANE_PLAN, cellar, crane


def valid(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> bool:
    return brute_force.moments_apart(plan) and not validate_plan(domain, problem, plan)


def schedule(
    domain: PddlDomain, plan: PddlPlan, order: CausalOrder, chance: random.Random, running: tuple[int, ...] = ()
) -> PddlPlan | None:
    """Carries the plan out in a random order that ``order`` allows; None if an end had to wait for ever."""
    lasting = [domain.actions[step.action].duration is not None for step in plan.steps]
    times: dict[tuple[int, str], float] = {(index, "start"): -1.0 for index in running}
    todo = {(index, "end" if index in running else "start") for index in range(len(plan.steps))}
    now = 0.0
    while todo:
        free = sorted(
            (index, edge)
            for index, edge in todo
            if (order.before_start if edge == "start" else order.before_end)[index] <= times.keys()
        )
        if not free:
            return None
        index, edge = chance.choice(free)
        now += chance.choice((0.01, 0.5, 3.0))
        times[index, edge] = now
        todo.remove((index, edge))
        if edge == "start" and lasting[index]:
            todo.add((index, "end"))
    return PddlPlan(
        tuple(
            PlanStep(
                times[index, "start"],
                step.action,
                step.args,
                times.get((index, "end"), times[index, "start"]) - times[index, "start"],
            )
            for index, step in enumerate(plan.steps)
        )
    )


def test_the_crane_waits_for_the_carrier_only():
    domain, problem = crane()
    order = causal_order(domain, problem, parse_plan(CRANE_PLAN))
    assert [set(waits) for waits in order.before_start] == [
        set(),
        set(),
        {(1, "end")},
        {(2, "end")},
        {(0, "end"), (3, "end")},
        {(4, "end")},
        {(5, "end")},
        {(6, "end")},
        {(7, "end")},
    ]
    assert not any(order.before_end)


def test_required_concurrency_is_kept():
    domain, problem = cellar()
    plan = parse_plan("0: (strike m1) [8]\n0.1: (mend f1) [5]\n9: (strike m2) [8]\n9.1: (mend f2) [5]")
    assert validate_plan(domain, problem, plan) == ()
    order = causal_order(domain, problem, plan)
    assert order.before_start == ({*()}, {(0, "start")}, {(0, "end")}, {(1, "end"), (2, "start")})
    assert order.before_end == ({(1, "end")}, set(), {(3, "end")}, set())


def two_lamps() -> tuple[PddlDomain, PddlProblem]:
    domain = read_domain("""(define (domain lamps) (:predicates (on) (a) (b) (done)) (:functions (power) (cost))
      (:action switch :effect (on))
      (:action off :precondition (on) :effect (not (on)))
      (:action read :precondition (on) :effect (done))
      (:action use :precondition (>= (power) 1) :effect (and (decrease (power) 1) (increase (cost) 1)))
      (:action pay :effect (increase (cost) 5))
      (:action refuel :effect (assign (power) 2))
      (:action reset :effect (assign (cost) 0))
      (:action copy :effect (assign (cost) (power))))""")
    return domain, read_problem("(define (problem p) (:domain lamps) (:init (= (power) 1) (= (cost) 0)))", domain)


def waits(text: str) -> list[set[tuple[int, str]]]:
    domain, problem = two_lamps()
    plan = parse_plan(text)
    assert validate_plan(domain, problem, plan) == ()
    return [set(one) for one in causal_order(domain, problem, plan).before_start]


def test_only_the_first_that_makes_it_true_counts():
    assert waits("0: (switch)\n1: (switch)\n2: (read)\n3: (switch)\n4: (read)") == [
        set(),
        set(),
        {(0, "start")},
        set(),
        {(0, "start")},
    ]


def test_a_deletion_waits_for_all_readers():
    assert waits("0: (switch)\n1: (read)\n2: (read)\n3: (off)")[3] == {(1, "start"), (2, "start")}


def test_sums_commute_but_not_with_comparisons_and_assignments():
    assert waits("0: (pay)\n1: (use)\n2: (refuel)\n3: (use)\n4: (pay)") == [
        set(),
        set(),
        {(1, "start")},
        {(2, "start")},
        set(),
    ]


def test_increases_stay_on_one_side_of_an_assignment():
    assert waits("0: (pay)\n1: (pay)\n2: (reset)\n3: (pay)") == [
        set(),
        set(),
        {(0, "start"), (1, "start")},
        {(2, "start")},
    ]


def test_a_change_of_an_amount_waits_for_its_readers():
    assert waits("0: (copy)\n1: (refuel)\n2: (copy)") == [set(), {(0, "start")}, {(1, "start")}]


def test_independent_steps_are_not_ordered_even_one_after_the_other():
    domain, problem = crane()
    order = causal_order(domain, problem, parse_plan("0: (move crane_a bay stack) [5]\n100: (come carrier_a bay) [6]"))
    assert order == CausalOrder((frozenset(),) * 2, (frozenset(),) * 2)


def test_new_steps_wait_for_the_ends_of_running_ones_only_where_they_need_them():
    domain, problem = crane()
    state = PddlState.of(problem, domain)
    for name, *args in (("come", "carrier_a", "bay"), ("move", "crane_a", "bay", "stack")):
        state.apply(changes(ground(domain.actions[name], args).effects_at("start"), state))
    plan = parse_plan(CRANE_PLAN)
    order = causal_order(domain, state, plan, running=(0, 1))
    assert order.before_start[:3] == ({*()}, {*()}, {(1, "end")})
    assert order.before_start[4] == {(0, "end"), (3, "end")}
    assert validate_plan(domain, state.problem(problem.goal), plan, running=(0, 1)) == ()


def test_invariants_of_a_running_step_are_protected():
    domain, problem = cellar()
    state = PddlState.of(problem, domain)
    for action in (ground(domain.actions["strike"], ["m1"]), ground(domain.actions["mend"], ["f1"])):
        state.apply(changes(action.effects_at("start"), state))
    plan = parse_plan("-2: (mend f1) [1]\n-3: (strike m1) [3]\n0: (strike m2) [8]\n0.1: (mend f2) [5]")
    strike, mend = 0, 1
    assert [plan.steps[strike].action, plan.steps[mend].action] == ["strike", "mend"]
    order = causal_order(domain, state, plan, running=(strike, mend))
    assert order.before_end[strike] == {(mend, "end")}
    assert order.before_start[2] == {(strike, "end")}


def test_an_early_end_starts_no_step_too_early():
    domain = read_domain("""(define (domain d) (:predicates (p) (q) (r))
      (:durative-action first :duration (= ?duration 9) :effect (and (at end (not (p))) (at end (q))))
      (:durative-action second :duration (= ?duration 1) :condition (at start (p)) :effect (at start (r)))
      (:action third :precondition (and (q) (r)) :effect (not (r))))""")
    problem = read_problem("(define (problem x) (:domain d) (:init (p)))", domain)
    plan = parse_plan("0: (first) [9]\n1: (second) [1]\n10: (third)")
    order = causal_order(domain, problem, plan)
    assert order.before_end[0] == {(1, "start")}
    assert order.before_start[2] == {(0, "end"), (1, "start")}


def test_changes_during_a_step_keep_their_order_without_delaying_others():
    domain = read_domain("""(define (domain d) (:predicates (p) (q))
      (:durative-action hold :duration (= ?duration 9) :condition (over all (or (p) (q))))
      (:action give :effect (q))
      (:action take :effect (not (p))))""")
    problem = read_problem("(define (problem x) (:domain d) (:init (p)))", domain)
    order = causal_order(domain, problem, parse_plan("0: (hold) [9]\n1: (give)\n2: (take)"))
    assert order.before_start == (set(), set(), {(1, "start")})
    assert not any(order.before_end)


def test_derived_predicates_are_read_by_their_bases():
    domain = read_domain("""(define (domain d) (:types box) (:predicates (on ?x - box) (top ?x - box) (done))
      (:derived (top ?x - box) (not (on ?x)))
      (:action drop :parameters (?x - box) :effect (on ?x))
      (:action lift :parameters (?x - box) :effect (not (on ?x)))
      (:action use :parameters (?x - box) :precondition (top ?x) :effect (done)))""")
    problem = read_problem("(define (problem x) (:domain d) (:objects a b - box) (:init (on a)))", domain)
    plan = parse_plan("0: (lift a)\n1: (drop b)\n2: (use a)\n3: (drop a)")
    assert causal_order(domain, problem, plan).before_start == (set(), set(), {(0, "start")}, {(2, "start")})


def test_an_unknown_action_is_an_error():
    domain, problem = crane()
    with pytest.raises(PlanningError, match="no action fly"):
        causal_order(domain, problem, parse_plan("0: (fly) [1]"))


def test_steps_that_need_each_other_at_the_same_moment_do_not_wait_for_ever():
    domain = read_domain("""(define (domain d) (:predicates (p) (q))
      (:durative-action one :duration (= ?duration 2) :condition (over all (q)) :effect (at start (p)))
      (:durative-action two :duration (= ?duration 2) :condition (over all (p)) :effect (at start (q))))""")
    problem = read_problem("(define (problem x) (:domain d))", domain)
    plan = parse_plan("0: (one) [2]\n0: (two) [2]")
    assert validate_plan(domain, problem, plan) == ()
    assert causal_order(domain, problem, plan).before_start == ({*()}, {(0, "start")})


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(2, 7))
def test_any_schedule_that_keeps_the_order_is_valid(seed, size):
    domain, problem, chance = random_pair(seed)
    plan = random_plan(domain, problem, chance, valid, size)
    order = causal_order(domain, problem, plan)
    for _ in range(8):
        other = schedule(domain, plan, order, chance)
        assert other is not None, "the order has a circle"
        assert brute_force.is_valid(domain, problem, other), f"{plan}\n{order}\n{other}"


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 3), st.integers(1, 4))
def test_any_schedule_that_keeps_the_order_is_valid_when_some_steps_run_already(seed, several, size):
    domain, problem, chance = random_pair(seed)
    running: list[PlanStep] = []
    state = PddlState.of(problem, domain)
    for _ in range(10):
        name = chance.choice([name for name, action in domain.actions.items() if action.duration is not None])
        step = PlanStep(-1.0, name, (chance.choice(OBJECTS),), chance.choice((1.5, 2.5)))
        after = state.copy()
        after.apply(changes(ground(domain.actions[name], step.args).effects_at("start"), state, duration=1.0))
        plan = PddlPlan((*running, step))
        if len(running) < several and not validate_plan(domain, after.problem(None), plan, range(len(plan.steps))):
            state, running = after, [*running, step]
    indexes = tuple(range(len(running)))
    now = state.problem(None)
    assert not running or not validate_plan(domain, now, PddlPlan(tuple(running)), indexes)

    def fits(_domain: PddlDomain, _problem: PddlProblem, new: PddlPlan) -> bool:
        return brute_force.moments_apart(new) and not validate_plan(
            domain, now, PddlPlan((*running, *new.steps)), indexes
        )

    plan = PddlPlan((*running, *random_plan(domain, now, chance, fits, size).steps))
    order = causal_order(domain, state, plan, indexes)
    assert not any(order.before_start[index] for index in indexes)
    for _ in range(8):
        other = schedule(domain, plan, order, chance, indexes)
        assert other is not None, "the order has a circle"
        assert brute_force.is_valid(domain, now, other, indexes), f"{plan}\n{order}\n{other}"


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32), st.integers(2, 7))
def test_the_plan_keeps_its_order_without_redundant_triggers(seed, size):
    domain, problem, chance = random_pair(seed)
    plan = random_plan(domain, problem, chance, valid, size)
    order = causal_order(domain, problem, plan)
    times = {(index, "start"): step.start_s for index, step in enumerate(plan.steps)}
    times |= {(index, "end"): step.end_s for index, step in enumerate(plan.steps)}
    for index, step in enumerate(plan.steps):
        assert all(times[one] < step.start_s for one in order.before_start[index])
        assert all(times[one] < step.end_s and one != (index, "start") for one in order.before_end[index])
        for one in order.before_start[index]:
            if one.edge == "end":
                assert (one.step, "start") not in order.before_start[index]


def test_steps_without_a_contribution_are_left_out():
    text = texts.CRANE_PROBLEM.replace("carrier_a - carrier", "carrier_a carrier_b - carrier")
    domain = crane()[0]
    problem = read_problem(text.replace("(away carrier_a)", "(away carrier_a) (away carrier_b)"), domain)
    whole = parse_plan(CRANE_PLAN)
    assert contributing(domain, problem, whole) == whole
    assert contributing(domain, problem, parse_plan(CRANE_PLAN + "0.000: (come carrier_b stack) [6.000]")) == whole
    one_box = replace(problem, goal=Predicate("holding", ("crane_a", "box_2")))
    short = contributing(domain, one_box, parse_plan("\n".join(CRANE_PLAN.split("\n")[:4])))
    assert [step.action for step in short.steps] == ["move", "pick"]
    assert contributing(domain, replace(problem, goal=None), whole).steps == ()


@given(st.integers(0, 10_000))
@settings(max_examples=100, deadline=None)
def test_contributing_steps_are_steps_of_the_plan_in_order(seed):
    domain, problem, chance = random_pair(seed)
    plan = random_plan(domain, problem, chance, lambda *_: True, 6)
    rest = iter(plan.steps)
    assert all(step in rest for step in contributing(domain, problem, plan).steps)
