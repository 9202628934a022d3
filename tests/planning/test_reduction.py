"""Large problems are reduced; plans of the reduced problem are plans of the original."""

from __future__ import annotations

import resource
from dataclasses import replace

import pytest

from socialbot.agents.warehouse.scenario import GRIPPER_DOMAIN, gripper_beliefs, gripper_desires, scenario_of
from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.deliberation.facts import FactBase
from socialbot.planning.pddl import reduction
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.formulas import And, Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.reduction import with_fewer_options
from socialbot.planning.pddl.validation import validate_plan
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerLimits
from tests.planning.random_worlds import random_pair


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


def test_the_emptiest_stacks_of_a_large_warehouse_take_boxes():
    domain, problem, _ = warehouse(48, 12)
    smaller = with_fewer_options(domain, problem)
    assert smaller is not None
    removed = problem.facts - smaller.facts
    assert {fact.name for fact in removed} == {"takes_boxes"}
    assert Predicate("takes_boxes", ("base_17",)) in smaller.facts, "the only stack without a box"
    assert sum(fact.name == "takes_boxes" for fact in smaller.facts) == reduction.KEPT


def test_small_problems_are_left_as_they_are():
    domain, problem, _ = warehouse(6, 3)
    assert with_fewer_options(domain, problem) is None


@pytest.mark.parametrize(
    "change",
    ["(:action b :parameters (?x - thing) :effect (not (free ?x)))",
     "(:action b :parameters () :precondition (forall (?x - thing) (free ?x)) :effect (done))",
     "(:action b :parameters (?x - thing) :precondition (not (free ?x)) :effect (done))"],
)  # fmt: skip
def test_predicates_that_change_or_are_asked_otherwise_are_no_options(monkeypatch, change):
    monkeypatch.setattr(reduction, "LARGE", 1)
    base = """(define (domain d) (:requirements :adl) (:types thing) (:predicates (free ?x - thing) (done))
              (:action a :parameters (?x - thing) :precondition (free ?x) :effect (done)) {})"""
    problem = """(define (problem p) (:domain d) (:objects a b c - thing)
                 (:init (free a) (free b) (free c)) (:goal (done)))"""
    domain = read_domain(base.format(""))
    assert with_fewer_options(domain, read_problem(problem, domain)) is not None
    domain = read_domain(base.format(change))
    assert with_fewer_options(domain, read_problem(problem, domain)) is None


@pytest.mark.parametrize("seed", range(40))
def test_plans_of_reduced_problems_are_plans_of_the_original(monkeypatch, seed):
    monkeypatch.setattr(reduction, "LARGE", 1)
    monkeypatch.setattr(reduction, "KEPT", 1)
    domain, problem, _ = random_pair(seed)
    smaller = with_fewer_options(domain, problem)
    if smaller is None:
        return
    answer = make_planner().solve(domain, smaller, PlannerLimits(timeout_s=1.0))
    assert answer.plan is None or not validate_plan(domain, problem, answer.plan)


def test_a_problem_that_needs_the_dropped_options_is_solved_all_the_same(monkeypatch):
    monkeypatch.setattr(reduction, "LARGE", 1)
    monkeypatch.setattr(reduction, "KEPT", 1)
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


@pytest.mark.parametrize(("boxes", "carriers", "most_s"), [(48, 12, 1.5), (96, 24, 6.0)])
def test_planning_for_many_boxes_and_all_stacks_takes_little_processor_time(boxes, carriers, most_s):
    domain, problem, deadline = warehouse(boxes, carriers)
    begun = processor_s()
    answer = make_planner().solve(domain, problem, PlannerLimits(timeout_s=30.0, makespan_s=deadline))
    assert answer.plan is not None, answer.message
    assert processor_s() - begun <= most_s


def test_plans_are_shortened_whatever_the_deadline():
    domain, problem, deadline = warehouse(24, 12, all_stacks=False)
    for most_s in (deadline, 420.0, 100_000.0):
        answer = make_planner().solve(domain, problem, PlannerLimits(makespan_s=most_s))
        assert answer.plan is not None
        assert answer.plan.makespan_s <= 413.1
