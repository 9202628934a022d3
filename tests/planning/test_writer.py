from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.planning.pddl.domain import PddlProblem, PlanStep, parse_plan, problem_text
from socialbot.planning.pddl.formulas import Fluent, Number, Predicate, TypedName, number_text, typed_text
from socialbot.planning.pddl.reader import read_domain, read_problem
from tests.planning.random_worlds import domain_text, formula
from tests.planning.random_worlds import problem_text as random_problem_text
from tests.planning.texts import crane

COPIED = ("name", "domain", "objects", "facts", "values", "goal", "metric", "timed")


def same(one: PddlProblem, other: PddlProblem) -> bool:
    return all(getattr(one, name) == getattr(other, name) for name in COPIED)


def test_a_problem_is_written_in_order():
    assert problem_text(crane()[1]) == (
        "(define (problem two-boxes)\n"
        "  (:domain crane)\n"
        "  (:objects\n"
        "    bay - base\n    stack - base\n    box_1 - box\n    box_2 - box\n"
        "    carrier_a - carrier\n    crane_a - crane)\n"
        "  (:init\n"
        "    (away carrier_a)\n    (clear bay)\n    (clear box_2)\n    (on box_1 stack stack)\n"
        "    (on box_2 box_1 stack)\n    (over crane_a bay)\n    (= (held crane_a) 0)\n    (= (load carrier_a) 0))\n"
        "  (:goal (and (loaded carrier_a box_1) (loaded carrier_a box_2))))\n"
    )


def test_equal_problems_are_written_alike():
    one = PddlProblem("p", "d", {"a": ("object",), "b": ("object",)}, values={Fluent("n"): 1, Fluent("m"): 2})
    other = PddlProblem("p", "d", {"b": ("object",), "a": ("object",)}, values={Fluent("m"): 2, Fluent("n"): 1})
    assert problem_text(one) == problem_text(other)


def test_constants_and_a_goal_that_is_missing_are_left_out():
    text = problem_text(PddlProblem("p", "d", {"a": ("t",), "b": ("t",)}), constants={"a"})
    assert text == "(define (problem p)\n  (:domain d)\n  (:objects\n    b - t)\n  (:init))\n"


def test_a_name_that_planners_refuse_is_made_one():
    assert problem_text(PddlProblem("07", "d")).startswith("(define (problem problem-07)\n")


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32), st.booleans())
def test_written_problems_are_read_unchanged(seed, with_metric):
    chance = random.Random(seed)
    domain = read_domain(domain_text(chance))
    goal = formula(chance, 4).replace("?x", "b")
    metric = " (:metric minimize (+ (total-time) (n a)))" if with_metric else ""
    text = random_problem_text(chance)[:-1].replace(
        "(:init", "(:objects d e - t) (:init (at 3 (p d)) (at 0.5 (not (p a))) (at 1e-7 (= (n a) 2))"
    )
    problem = read_problem(f"{text} (:goal {goal}){metric})", domain)
    assert same(read_problem(problem_text(problem), domain), problem)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_exact_and_have_no_exponent(value):
    text = number_text(value)
    assert float(text) == value
    assert "e" not in text
    assert str(Number(value)) == text


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        ([], ""),
        ([TypedName("?a"), TypedName("?b")], "?a ?b - object"),
        ([TypedName("?a", ("x",)), TypedName("?b", ("x", "y"))], "?a - x ?b - (either x y)"),
    ],
)
def test_lists_with_types(typed, text):
    assert typed_text(typed) == text


def test_actions_write_their_parts():
    domain = read_domain(domain_text(random.Random(7)))
    texts = [str(one.effect) for action in domain.actions.values() for one in action.effects]
    texts += [str(one.formula) for action in domain.actions.values() for one in action.conditions]
    assert texts
    for action in domain.actions.values():
        for one in action.conditions:
            again = f"{domain.text[:-1]}(:action again :parameters (?x - t) :precondition {one.formula}))"
            conjuncts = read_domain(again).actions["again"].conditions
            assert [part.formula for part in conjuncts] == [one.formula]
        for one in action.effects:
            again = f"{domain.text[:-1]}(:action again :parameters (?x - t) :effect {one.effect}))"
            assert [part.effect for part in read_domain(again).actions["again"].effects] == [one.effect]
    assert str(Predicate("on", ("a", "b"))) == "(on a b)"


@settings(max_examples=200)
@given(st.floats(0, 1e6), st.floats(0, 1e6))
def test_written_plans_keep_nanoseconds(start_s, duration_s):
    step = PlanStep(start_s, "go", ("a",), duration_s)
    (back,) = parse_plan(str(step)).steps
    assert back.start_s == pytest.approx(start_s, abs=6e-10)
    assert back.duration_s == pytest.approx(duration_s, abs=6e-10)


def test_times_have_at_least_three_decimals():
    assert str(PlanStep(0.0, "go", ("a", "b"), 10 / 3)) == "0.000: (go a b) [3.333333333]"
