from __future__ import annotations

from socialbot.planning.pddl.formulas import Add, Delete, Fluent, Predicate
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.semantics import SetValue
from socialbot.planning.pddl.state import PddlState
from tests.planning.texts import crane

BOX_1 = Predicate("clear", ("box_1",))


def test_it_begins_as_the_problem_says():
    domain, problem = crane()
    state = PddlState.of(problem, domain)
    assert state.holds(Predicate("clear", ("box_2",)))
    assert not state.holds(BOX_1)
    assert state.value(Fluent("held", ("crane_a",))) == 0
    assert state.value(Fluent("held", ("box_1",))) is None


def test_objects_are_found_by_type_and_sub_type_constants_first():
    domain = read_domain("(define (domain d) (:types car bus - vehicle stop) (:constants z - bus))")
    problem = read_problem("(define (problem p) (:domain d) (:objects y - stop b - car a - bus))", domain)
    state = PddlState.of(problem, domain)
    assert state.objects(("vehicle",)) == ("z", "b", "a")
    assert state.objects(("car", "stop")) == ("y", "b")
    assert state.objects(("object",)) == ("z", "y", "b", "a")


def test_changes_are_carried_out_and_copies_have_their_own():
    domain, problem = crane()
    state = PddlState.of(problem, domain)
    other = state.copy()
    state.apply([Add(BOX_1), Delete(Predicate("clear", ("box_2",))), SetValue(Fluent("held", ("crane_a",)), 2.0)])
    assert state.holds(BOX_1)
    assert not state.holds(Predicate("clear", ("box_2",)))
    assert state.value(Fluent("held", ("crane_a",))) == 2
    assert other.problem(problem.goal, name=problem.name) == problem


def test_the_problem_of_a_state_begins_where_the_state_is():
    domain, problem = crane()
    state = PddlState.of(problem, domain)
    state.apply([Add(BOX_1)])
    now = state.problem(BOX_1)
    assert now.facts == problem.facts | {BOX_1}
    assert now.goal == BOX_1
    assert PddlState.of(now, domain).facts == state.facts
