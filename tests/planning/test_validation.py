from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import PddlPlan, PddlProblem, PlanStep, parse_plan
from socialbot.planning.pddl.formulas import Fluent, Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.semantics import ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import ReadWriteAnalysis, metric_value, state_after, validate_plan
from socialbot.planning.planners.planner import separated
from tests.planning import brute_force
from tests.planning.random_worlds import OBJECTS, random_pair, random_plan
from tests.planning.texts import CRANE_PLAN, cellar, crane


def messages(text: str, pair=crane) -> list[str]:
    domain, problem = pair()
    return [str(fault) for fault in validate_plan(domain, problem, parse_plan(text))]


def without(number: int) -> str:
    lines = CRANE_PLAN.strip().splitlines()
    return "\n".join(lines[:number] + lines[number + 1 :])


def test_a_valid_plan_has_no_faults():
    assert messages(CRANE_PLAN) == []


def test_a_missing_step_shows_where_it_is_missed():
    assert messages(without(2))[0] == (
        "13.003 s: (put crane_a box_2 carrier_a bay) cannot start: (holding crane_a box_2) does not hold"
    )


def test_invariants_are_checked_from_start_to_end():
    assert messages(without(0))[:1] == [
        "13.003 s: (put crane_a box_2 carrier_a bay) cannot go on: (here carrier_a bay) does not hold"
    ]
    early = CRANE_PLAN.replace("17.004: (move", "16.004: (move")
    assert messages(early)[0] == (
        "16.004 s: (put crane_a box_2 carrier_a bay) cannot go on: (over crane_a bay) does not hold"
    )


def test_invariants_may_begin_at_the_start_and_end_at_the_end():
    text = "0: (move crane_a bay stack) [5]\n5: (pick crane_a box_2 box_1 stack) [3]\n8: (move crane_a stack bay) [5]"
    assert [one for one in messages(text) if "goal" not in one] == []


def test_start_conditions_cannot_become_true_at_the_start():
    text = "0: (move crane_a bay stack) [5]\n5: (move crane_a stack bay) [5]"
    assert messages(text)[0] == (
        "5.000 s: (move crane_a bay stack) cannot end at the moment that (move crane_a stack bay) starts: "
        "both need (over crane_a stack)"
    )
    assert "(over crane_a stack) does not hold" in messages(text)[1]


def test_the_unmet_parts_of_the_goal_are_named():
    assert messages("") == [
        "0.000 s: the goal is not reached: (loaded carrier_a box_1) does not hold",
        "0.000 s: the goal is not reached: (loaded carrier_a box_2) does not hold",
    ]


def test_without_a_goal_any_end_will_do():
    domain, problem = crane()
    free = PddlProblem(problem.name, problem.domain, problem.objects, problem.facts, problem.values)
    assert validate_plan(domain, free, PddlPlan()) == ()


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ("0: (fly crane_a) [1]", "0.000 s: (fly crane_a): the domain has no action fly"),
        ("0: (come carrier_a) [6]", "0.000 s: (come carrier_a): come takes 2 objects, not 1"),
        ("0: (come carrier_x bay) [6]", "0.000 s: (come carrier_x bay): there is no object carrier_x"),
        ("1: (come crane_a bay) [6]", "1.000 s: (come crane_a bay): crane_a is a crane, no carrier"),
        ("-1: (come carrier_a bay) [6]", "-1.000 s: (come carrier_a bay) starts before the plan does"),
        ("0: (come carrier_a bay) [0]", "0.000 s: (come carrier_a bay) lasts 0 s, less than 6 s"),
        ("0: (come carrier_a bay) [1e999]", "0.000 s: (come carrier_a bay): its time is not finite"),
        ("0: (come carrier_a bay) [5.9]", "0.000 s: (come carrier_a bay) lasts 5.9 s, less than 6 s"),
        ("0: (come carrier_a bay) [6.1]", "0.000 s: (come carrier_a bay) lasts 6.1 s, more than 6 s"),
    ],
)
def test_a_step_that_makes_no_sense_is_named(step, message):
    assert messages(step)[0] == message


def test_durations_are_as_exact_as_plans_are_printed():
    assert not any("lasts" in one for one in messages("0: (come carrier_a bay) [6.0009]"))


def test_required_concurrency():
    text = "0: (strike m1) [8]\n0.001: (mend f1) [5]\n{}: (mend f2) [5]\n8.001: (strike m2) [8]"
    assert messages(text.format("8.002"), cellar) == []
    assert "cannot go on: (light)" in messages(text.format("5.002"), cellar)[0]


def test_two_repairs_need_two_hands():
    assert "(free) does not hold" in messages("0: (strike m1) [8]\n0.1: (mend f1) [5]\n0.2: (mend f2) [5]", cellar)[0]


NUMBERS = """(define (domain numbers) (:requirements :fluents :durative-actions)
  (:predicates (done)) (:functions (battery) (speed) (unset))
  (:durative-action drive :duration (= ?duration (/ 10 (speed)))
    :condition (over all (> (battery) 0)) :effect (at end (decrease (battery) (* 2 ?duration))))
  (:durative-action wait :duration (and (>= ?duration 1) (<= ?duration 3)))
  (:durative-action charge :duration (= ?duration 1) :effect (at end (assign (battery) 100)))
  (:durative-action guess :duration (<= ?duration (unset)))
  (:action spoil :effect (increase (unset) 1)) (:action finish :precondition (< (battery) 6) :effect (done)))"""


def numbers() -> tuple:
    domain = read_domain(NUMBERS)
    text = "(define (problem p) (:domain numbers) (:init (= (battery) 10) (= (speed) 4)) (:goal (done)))"
    return domain, read_problem(text, domain)


def test_durations_and_effects_are_calculated():
    assert messages("0: (drive) [2.5]\n3: (finish)", numbers) == []
    assert messages("0: (drive) [2]\n3: (finish)", numbers)[0] == "0.000 s: (drive) lasts 2 s, less than 2.5 s"
    assert messages("0: (wait) [2]\n2.001: (drive) [2.5]\n5: (finish)", numbers) == []
    assert "lasts 4 s, more than 3 s" in messages("0: (wait) [4]", numbers)[0]


def test_the_state_after_a_plan_has_its_effects_whether_its_conditions_hold_or_not():
    domain, problem = numbers()
    state = PddlState.of(problem, domain)
    state.values[Fluent("battery")] = 0.0
    after = state_after(state, parse_plan("0: (drive) [5]"))
    assert after.values[Fluent("battery")] == -10.0


def test_an_undefined_value_is_a_fault():
    assert messages("0: (guess) [2]", numbers)[0] == "0.000 s: (guess): its duration has no value"
    assert "(unset): it has no value yet" in messages("0: (spoil)", numbers)[0]


def test_numbers_that_change_together():
    assert (
        messages("0: (drive) [2.5]\n0.1: (drive) [2.5]\n3: (finish)", numbers)[:1]
        == [
            # 10 - 5 - 5 at 2.6 s, when neither drives any more
        ]
    )
    text = "0: (drive) [2.5]\n0: (drive) [2.5]\n3: (finish)"
    assert messages(text, numbers) == []  # sums commute, so they may end at once
    clash = messages("0: (drive) [2.5]\n1.5: (charge) [1]\n3: (finish)", numbers)
    assert "both need (battery)" in clash[0]


def test_running_steps_end_first_and_are_watched():
    domain, problem = crane()
    facts = (problem.facts | {Predicate("over", ("crane_a", "stack"))}) - {Predicate("over", ("crane_a", "bay"))}
    values = {**problem.values, Fluent("held", ("crane_a",)): 1.0}
    now = PddlProblem("now", "crane", problem.objects, facts, values)
    pick, move = (
        PlanStep(-1, "pick", ("crane_a", "box_2", "box_1", "stack"), 3),
        PlanStep(0, "move", ("crane_a", "stack", "bay"), 5),
    )
    assert validate_plan(domain, now, PddlPlan((pick, move)), running=(0,)) == ()
    assert "(over crane_a stack)" in str(validate_plan(domain, problem, PddlPlan((pick,)), running=(0,))[0])


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_it_agrees_with_a_simulator_that_was_written_apart(seed, size):
    domain, problem, chance = random_pair(seed)

    def usable(_domain, _problem, plan) -> bool:
        return brute_force.moments_apart(plan) and (chance.random() < 0.3 or not validate_plan(_domain, _problem, plan))

    plan = random_plan(domain, problem, chance, usable, size)
    assert (not validate_plan(domain, problem, plan)) == brute_force.is_valid(domain, problem, plan), str(plan)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.lists(st.tuples(st.floats(), st.text(max_size=6), st.floats()), max_size=4))
def test_no_plan_makes_it_raise(seed, steps):
    domain, problem, chance = random_pair(seed)
    names = [*domain.actions, "nothing"]
    plan = PddlPlan(
        tuple(
            PlanStep(
                start, chance.choice(names), (chance.choice((*OBJECTS, word)),) * chance.choice((1, 1, 1, 2)), duration
            )
            for start, word, duration in steps
        )
    )
    validate_plan(domain, problem, plan)


def test_a_plan_of_200_steps_takes_less_than_50_ms():
    domain, problem = crane()
    times = "\n".join(
        f"{5.01 * n}: (move crane_a {'bay stack' if n % 2 == 0 else 'stack bay'}) [5]" for n in range(200)
    )
    plan = parse_plan(times)
    best = 1.0
    for _ in range(5):
        begin = time.process_time()
        found = [str(fault.condition) for fault in validate_plan(domain, problem, plan)]
        best = min(best, time.process_time() - begin)
        assert found == ["(loaded carrier_a box_1)", "(loaded carrier_a box_2)"]
    assert best < 0.05


def test_steps_without_times_happen_one_after_the_other() -> None:
    text = "; cost = 3\n(DROP a)\n\n  (lift a) ; again\n(drop a) [2]\n"
    assert str(parse_plan(text)) == "1.000: (drop a) [0.000]\n2.000: (lift a) [0.000]\n3.000: (drop a) [2.000]\n"
    mixed = parse_plan("(lift a)\n5: (wait) [1]\n(drop a)")
    assert [(step.start_s, step.action) for step in mixed.steps] == [(1.0, "lift"), (2.0, "drop"), (5.0, "wait")]


@pytest.mark.parametrize("line", ["0: (" + " " * 20_000, "0: (a" + " " * 20_000 + ")x", "0" * 20_000, "0 " * 10_000])
def test_a_long_line_that_is_no_step_of_a_plan_is_refused_soon(line: str) -> None:
    begun = time.process_time()
    with pytest.raises(PlanningError, match="no step of a plan"):
        parse_plan(line)
    assert time.process_time() - begun < 0.5


DOMAIN = """(define (domain d) (:types box) (:constants a b - box)
  (:predicates (p ?x - box) (q ?x - box) (next ?x ?y - box)) (:functions (n) (m))
  (:action none)
  (:action reads :parameters (?x - box) :precondition (and (p ?x) (not (q ?x))))
  (:action compares :precondition (< (n) (m)))
  (:action all :parameters (?x - box) :precondition (forall (?y - box) (imply (next ?x ?y) (p ?y))))
  (:action any :precondition (exists (?y - box) (and (p ?y) (q ?y))))
  (:action adds :parameters (?x - box) :effect (p ?x))
  (:action deletes :parameters (?x - box) :effect (not (p ?x)))
  (:action marks :parameters (?x - box) :effect (q ?x))
  (:action sums :effect (increase (n) 1))
  (:action assigns :effect (assign (n) 1))
  (:action copies :effect (assign (m) (n)))
  (:action perhaps :parameters (?x - box) :effect (when (q ?x) (p ?x)))
  (:action both :parameters (?x - box) :effect (and (p ?x) (not (p ?x)))))"""


def test_a_plan_without_times_is_validated_in_its_order() -> None:
    domain = read_domain(DOMAIN)
    problem = read_problem("(define (problem x) (:domain d) (:goal (p a)))", domain)
    assert not validate_plan(domain, problem, parse_plan("(adds a)\n(reads a)"))
    (fault,) = validate_plan(domain, problem, parse_plan("(reads a)\n(adds a)"))
    assert (str(fault.condition), fault.time_s) == ("(p a)", 1.0)


@pytest.mark.parametrize(
    ("one", "other", "clash"),
    [
        ("reads a", "adds a", "(p a)"),
        ("reads a", "adds b", None),
        ("reads a", "marks a", "(q a)"),
        ("reads a", "reads a", None),
        ("adds a", "adds a", None),
        ("adds a", "deletes a", "(p a)"),
        ("both a", "adds a", "(p a)"),
        ("compares", "sums", "(n)"),
        ("compares", "copies", "(m)"),
        ("sums", "sums", None),
        ("sums", "assigns", "(n)"),
        ("assigns", "assigns", "(n)"),
        ("copies", "sums", "(n)"),
        ("perhaps a", "marks a", "(q a)"),
        ("perhaps a", "deletes a", None),  # q a is false, so nothing is added
        ("all a", "adds b", "(p b)"),
        ("all a", "adds a", None),  # a is not next to itself, and nothing can change that
        ("any", "deletes b", "(p b)"),
        ("none", "deletes b", None),
    ],
)
def test_interfering_events_cannot_be_simultaneous(one, other, clash):
    domain = read_domain(DOMAIN)
    state = PddlState.of(read_problem("(define (problem x) (:domain d) (:init (next a b) (= (n) 1)))", domain), domain)
    footprints = ReadWriteAnalysis(domain)
    first, second = (
        footprints.of(ground(domain.actions[name], args), "start", state)
        for name, *args in (one.split(), other.split())
    )
    assert first.clash(second) == clash
    assert second.clash(first) == clash


TIMED = """(define (domain d) (:predicates (open) (in) (lit) (done)) (:functions (level) (time-of))
  (:durative-action enter :parameters () :duration (= ?duration 2)
    :condition (over all (open)) :effect (at end (in)))
  (:durative-action flash :parameters () :duration (= ?duration (time-of))
    :condition (at end (lit)) :effect (and (at start (lit)) (at end (not (lit))) (at end (done))))
  (:action finish :parameters () :precondition (and (in) (>= (level) 2)) :effect (done)))"""


def timed_faults(plan: str, init: str, goal: str = "(in)") -> list[str]:
    domain = read_domain(TIMED)
    problem = read_problem(f"(define (problem p) (:domain d) (:init {init}) (:goal {goal}))", domain)
    return [str(fault) for fault in validate_plan(domain, problem, parse_plan(plan))]


WINDOW = "(at 5 (open)) (at 10 (not (open)))"


@pytest.mark.parametrize(
    ("start", "fault"),
    [
        ("4.9", "4.900 s: (enter) cannot go on: (open) does not hold"),
        ("5.001", None),
        ("7.9", None),
        ("8.1", "10.000 s: (enter) cannot go on: (open) does not hold"),
    ],
)
def test_timed_initial_literals_open_and_close_a_window(start, fault):
    found = timed_faults(f"{start}: (enter) [2]", WINDOW)
    assert found[:1] == ([] if fault is None else [fault])


def test_timed_initial_fluents_change_a_function():
    init = "(open) (= (level) 1) (at 5 (= (level) 2))"
    assert timed_faults("0: (enter) [2]\n6: (finish)", init, "(done)") == []
    assert "cannot start" in timed_faults("0: (enter) [2]\n4: (finish)", init, "(done)")[0]


def test_a_step_may_not_start_at_the_moment_of_a_timed_literal_that_it_needs():
    found = timed_faults("0: (enter) [2]\n5: (finish)", "(open) (= (level) 1) (at 5 (= (level) 2))", "(done)")
    assert "both need (level)" in found[0]


def test_a_step_of_0_s_ends_after_its_start():
    assert timed_faults("1: (flash) [0]", "(= (time-of) 0)", "(and (done) (not (lit)))") == []


def test_a_step_of_0_s_still_interferes_with_others_of_its_moment():
    found = timed_faults("1: (flash) [0]\n1: (flash) [0]", "(= (time-of) 0)", "(done)")
    assert "both need (lit)" in found[0]


GATED = """(define (domain d) (:predicates (nearer ?a ?b) (free ?a) (loaded ?a))
  (:durative-action unload :parameters (?a) :duration (= ?duration 1) :effect (at end (free ?a)))
  (:durative-action load :parameters (?a) :duration (= ?duration 1)
    :condition (at start (forall (?b) (imply (nearer ?b ?a) (free ?b)))) :effect (at end (loaded ?a))))"""


def test_interference_counts_all_atoms_of_a_condition():
    """VAL rejects this plan as well, though no object is nearer than ``a``."""
    domain = read_domain(GATED)
    text = "(define (problem p) (:domain d) (:objects a b) (:init (nearer a b)) (:goal (loaded a)))"
    problem = read_problem(text, domain)
    plan = parse_plan("0: (unload b) [1]\n1: (load a) [1]")
    (fault,) = validate_plan(domain, problem, plan)
    assert fault.interference
    assert "both need (free b)" in str(fault)
    assert separated(domain, problem, plan) == (parse_plan("0: (unload b) [1]\n1.001: (load a) [1]"), ())


def test_events_of_one_moment_happen_in_the_order_of_their_times():
    text = "0: (move crane_a bay stack) [5.0004]\n5: (pick crane_a box_2 box_1 stack) [3]"
    assert "(over crane_a stack) does not hold" in messages(text)[0]


@pytest.mark.parametrize(
    ("metric", "value"),
    [
        ("(:metric minimize (total-time))", 9.0),
        ("(:metric maximize (- (far) total-time))", -4.0),
        ("(:metric minimize (* 2 (far)))", 10.0),
        ("(:metric minimize (unset))", None),
        ("", None),
    ],
)
def test_the_metric_is_evaluated_at_the_end_of_a_plan(metric: str, value: float | None) -> None:
    domain = read_domain(
        """(define (domain d) (:requirements :durative-actions :fluents) (:functions (far) (unset))
        (:durative-action drive :parameters () :duration (= ?duration 4) :effect (at end (increase (far) 2))))"""
    )
    problem = read_problem(
        f"(define (problem p) (:domain d) (:init (= (far) 0) (at 6 (= (far) 3))) (:goal (and)) {metric})", domain
    )
    assert metric_value(domain, problem, parse_plan("0: (drive) [4]\n5: (drive) [4]")) == value
