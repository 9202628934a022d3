"""Problems without actions that touch unavailable parts of the state."""

from __future__ import annotations

import pytest

from evaluation.warehouse_planning import first_question
from socialbot.planning.pddl.domain import PddlPlan, PddlProblem, PlanStep, parse_plan
from socialbot.planning.pddl.formulas import Fluent, Key, Predicate
from socialbot.planning.pddl.reachability import losing_step, unreachable_goals
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.pddl.restriction import restricted, touches
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
