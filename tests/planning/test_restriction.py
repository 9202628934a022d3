"""Problems without actions that touch unavailable parts of the state."""

from __future__ import annotations

import resource
from dataclasses import replace

import pytest

from evaluation.warehouse_planning import first_question
from socialbot.agents.warehouse.scenario import GRIPPER_DOMAIN, gripper_beliefs, gripper_desires, scenario_of
from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.deliberation.facts import FactBase
from socialbot.planning.pddl import restriction
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep, parse_plan
from socialbot.planning.pddl.formulas import And, Fluent, Key, Predicate
from socialbot.planning.pddl.reachability import losing_step, unreachable_goals
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.restriction import restricted, touches, with_fewer_options
from socialbot.planning.pddl.semantics import ground
from socialbot.planning.pddl.validation import validate_plan
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict
from tests.planning.random_worlds import random_pair

STATUS = (Predicate("carrier_in_base", ("carrier_a", "*")), Predicate("carrier_in_deposit", ("carrier_a", "*")))


def test_the_boxes_of_a_carrier_without_status_are_unreachable_and_no_others():
    question = first_question(6)
    domain, problem = restricted(question.domain, question.problem, STATUS)
    assert [str(goal.goal) for goal in unreachable_goals(domain, problem)] == [
        "(carrier_moving carrier_a box_a1)",
        "(carrier_moving carrier_a box_a2)",
    ]


def test_steps_to_avoid_are_left_out_for_their_objects_only():
    question = first_question(6)
    come = PlanStep(0.0, "req_carrier_to_come", ("carrier_a", "deposit_a", "base_a"))
    put = PlanStep(0.0, "gripper_put_on_carrier", ("gripper_a", "box_b1", "carrier_b", "base_b"))
    domain, problem = restricted(question.domain, question.problem, (), (come, put))
    assert [str(goal.goal) for goal in unreachable_goals(domain, problem)] == [
        "(carrier_moving carrier_a box_a1)",
        "(carrier_moving carrier_a box_a2)",
        "(carrier_moving carrier_b box_b1)",
    ]


def test_the_step_is_found_after_which_a_goal_is_out_of_reach():
    question = first_question(6)
    plan = parse_plan(
        """
        0.0: (req_carrier_to_come carrier_c deposit_c base_c) [6]
        0.0: (gripper_move gripper_a start base_1) [5]
        5.0: (gripper_pickup gripper_a box_a2 box_c2 base_1) [3]
        8.0: (gripper_move gripper_a base_1 base_c) [5]
        13.0: (gripper_put_on_carrier gripper_a box_a2 carrier_c base_c) [4]
        17.0: (gripper_move gripper_a base_c start) [5]
        """
    )
    goals = [Predicate("carrier_moving", ("carrier_a", box)) for box in ("box_a1", "box_a2")]
    lost = losing_step(question.domain, question.problem, plan, goals)
    assert lost is not None
    assert lost.call == "(gripper_put_on_carrier gripper_a box_a2 carrier_c base_c)"
    assert losing_step(question.domain, question.problem, plan, goals[:1]) is None
    assert losing_step(question.domain, question.problem, PddlPlan(plan.steps[:4]), goals) is None


@pytest.mark.parametrize("unavailable", [Predicate("upon", ("*", "*")), Fluent("holding_boxes", ("*",))])
def test_actions_that_always_touch_it_are_left_out(unavailable: Key):
    question = first_question(6)
    domain, _ = restricted(question.domain, question.problem, (unavailable,))
    assert not {"gripper_pickup", "gripper_putdown"} & set(domain.actions)
    assert "req_carrier_to_come" in domain.actions


def test_quantified_and_derived_parts_leave_the_action_out_for_all_objects():
    domain = read_domain(
        """
        (define (domain d) (:requirements :adl :derived-predicates) (:types thing)
          (:predicates (p ?t - thing) (q) (r) (some))
          (:derived (some) (exists (?t - thing) (p ?t)))
          (:action all :parameters () :precondition (forall (?t - thing) (p ?t)) :effect (q))
          (:action any :parameters () :precondition (some) :effect (q))
          (:action free :effect (r)))
        """
    )
    problem = PddlProblem("p", "d", {"a": ("thing",)})
    assert set(restricted(domain, problem, (Predicate("p", ("a",)),))[0].actions) == {"free"}


@pytest.mark.parametrize("seed", range(40))
def test_plans_of_restricted_problems_avoid_unavailable_objects(seed):
    domain, problem, chance = random_pair(seed)
    names = sorted({**domain.predicates})
    name = chance.choice(names)
    arity = len(domain.predicates[name].parameters)
    objects = [*problem.objects, *domain.constants]
    unavailable = (Predicate(name, tuple(chance.choice(objects) for _ in range(arity))),)
    narrow, problem_there = restricted(domain, problem, unavailable)
    answer = make_planner().solve(narrow, problem_there, PlannerLimits(timeout_s=1.0))
    if answer.verdict is PlannerVerdict.SOLVED:
        assert answer.plan is not None
        assert not validate_plan(domain, problem, answer.plan)
        for step in answer.plan.steps:
            assert not touches(ground(domain.actions[step.action], step.args), unavailable)


def warehouse(boxes: int, carriers: int, *, all_stacks: bool = True) -> tuple[PddlDomain, PddlProblem, float]:
    """The first problem of the gripper, with boxes that may be put down on all stacks, and its deadline."""
    domain = read_domain(GRIPPER_DOMAIN.read_text("utf-8"))
    scenario = scenario_of(boxes, carriers)
    facts = FactBase(Engine("gripper_a", ManualClock()), domain)
    for fact in gripper_beliefs(scenario):
        facts.add(fact)
    (desire,) = gripper_desires(scenario)
    problem = facts.problem(facts.goal(desire.wanted))
    free = {Predicate("takes_boxes", (base,)) for base in scenario.bases} if all_stacks else set()
    return domain, replace(problem, facts=problem.facts | free), desire.deadline


def processor_s() -> float:
    return sum(
        use.ru_utime + use.ru_stime for use in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


@pytest.mark.parametrize("kept", [1, 2])
def test_the_emptiest_stacks_of_a_large_warehouse_take_boxes(kept):
    domain, problem, _ = warehouse(48, 12)
    smaller = with_fewer_options(domain, problem, kept)
    assert smaller is not None
    removed = problem.facts - smaller.facts
    assert {fact.name for fact in removed} == {"takes_boxes"}
    assert Predicate("takes_boxes", ("base_17",)) in smaller.facts, "the only stack without a box"
    assert sum(fact.name == "takes_boxes" for fact in smaller.facts) == kept


def test_small_problems_are_left_as_they_are():
    domain, problem, _ = warehouse(6, 3)
    assert with_fewer_options(domain, problem, 1) is None


@pytest.mark.parametrize(
    "change",
    ["(:action b :parameters (?x - thing) :effect (not (free ?x)))",
     "(:action b :parameters () :precondition (forall (?x - thing) (free ?x)) :effect (done))",
     "(:action b :parameters (?x - thing) :precondition (not (free ?x)) :effect (done))"],
)  # fmt: skip
def test_predicates_that_change_or_are_asked_otherwise_are_no_options(monkeypatch, change):
    monkeypatch.setattr(restriction, "LARGE", 1)
    base = """(define (domain d) (:requirements :adl) (:types thing) (:predicates (free ?x - thing) (done))
              (:action a :parameters (?x - thing) :precondition (free ?x) :effect (done)) {})"""
    problem = """(define (problem p) (:domain d) (:objects a b c - thing)
                 (:init (free a) (free b) (free c)) (:goal (done)))"""
    domain = read_domain(base.format(""))
    assert with_fewer_options(domain, read_problem(problem, domain), 1) is not None
    domain = read_domain(base.format(change))
    assert with_fewer_options(domain, read_problem(problem, domain), 1) is None


@pytest.mark.parametrize("seed", range(40))
def test_plans_of_reduced_problems_are_plans_of_the_original(monkeypatch, seed):
    monkeypatch.setattr(restriction, "LARGE", 1)
    domain, problem, _ = random_pair(seed)
    smaller = with_fewer_options(domain, problem, 1)
    if smaller is None:
        return
    answer = make_planner().solve(domain, smaller, PlannerLimits(timeout_s=1.0))
    assert answer.plan is None or not validate_plan(domain, problem, answer.plan)


def test_a_problem_that_needs_the_dropped_options_is_solved_all_the_same(monkeypatch):
    monkeypatch.setattr(restriction, "LARGE", 1)
    domain = read_domain(
        """(define (domain d) (:requirements :typing) (:types thing) (:predicates (free ?x - thing) (on ?x - thing))
           (:action a :parameters (?x - thing) :precondition (free ?x) :effect (on ?x)))"""
    )
    objects = dict.fromkeys("abc", ("thing",))
    facts = frozenset(Predicate("free", (name,)) for name in "abc")
    goal = And(tuple(Predicate("on", (name,)) for name in "abc"))
    answer = make_planner().solve(domain, PddlProblem("p", "d", objects, facts, goal=goal), PlannerLimits())
    assert answer.plan is not None
    assert len(answer.plan.steps) == 3


@pytest.mark.parametrize(
    ("boxes", "carriers", "most_s"), [(48, 12, 1.5), pytest.param(96, 24, 6.0, marks=pytest.mark.slow)]
)
def test_planning_for_many_boxes_and_all_stacks_takes_little_processor_time(boxes, carriers, most_s):
    domain, problem, deadline = warehouse(boxes, carriers)
    spent: list[float] = []  # others on the same core make some of the turns longer
    while len(spent) < 3 and min(spent, default=most_s) >= most_s:
        begun = processor_s()
        answer = make_planner().solve(domain, problem, PlannerLimits(timeout_s=30.0, makespan_s=deadline))
        assert answer.plan is not None, answer.message
        spent.append(processor_s() - begun)
    assert min(spent) < most_s


@pytest.mark.parametrize("most_s", [None, 100_000.0, pytest.param(420.0, marks=pytest.mark.slow)])
def test_plans_are_shortened_whatever_the_deadline(most_s):
    domain, problem, deadline = warehouse(24, 12, all_stacks=False)
    answer = make_planner().solve(domain, problem, PlannerLimits(makespan_s=most_s or deadline))
    assert answer.plan is not None
    assert answer.plan.makespan_s <= 413.1
