from __future__ import annotations

import textwrap
from collections.abc import Callable

import pytest

from socialbot.planning.htn.domain import TaskDomain, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskAnswer, TaskFault, TaskTree, TaskVerdict

DAY = TaskState(raining=False, bus=True)


def action(name: str) -> Callable[..., TaskState]:
    def act(state: TaskState, *args: str) -> TaskState:
        return state

    act.__name__ = name
    return act


def travel() -> TaskDomain:
    domain = TaskDomain("travel")
    domain.declare_actions(map(action, ("a_walk", "a_ride", "a_pay", "a_drive", "a_eat", "a_wait")))

    @domain.method("m_day")
    def out(state):
        return [("a_wait",), ("m_travel", "park"), ("m_travel", "home"), ("a_eat",)]

    @domain.method("m_travel")
    def on_foot(state, place):
        return None if state.raining else [("a_walk", place)]

    @domain.method("m_travel")
    def by_bus(state, place):
        return [("a_pay", place), ("a_ride", place)] if state.bus else None

    @domain.method("m_travel")
    def by_taxi(state, place):
        return [("a_drive", place), ("a_pay", place)]

    return domain


PLANNER = TaskPlanner(travel())


def texts(answer: TaskAnswer) -> list[str]:
    return [str(node) for node in answer.plan]


def node(answer: TaskAnswer, text: str) -> int:
    return next(node.id for node in answer.plan if str(node) == text)


def tree(answer: TaskAnswer) -> TaskTree:
    assert answer.tree is not None
    return answer.tree


def day() -> TaskAnswer:
    answer = PLANNER.plan(DAY, [("m_day",)])
    assert texts(answer) == ["a_wait()", "a_walk(park)", "a_walk(home)", "a_eat()"]
    return answer


def test_a_failed_task_is_decomposed_differently_and_the_rest_is_kept():
    first = day()
    again = PLANNER.replan(DAY, tree(first), node(first, "a_walk(park)"))
    assert texts(again) == ["a_pay(park)", "a_ride(park)", "a_walk(home)", "a_eat()"]
    assert again.plan[2:] == first.plan[2:]
    assert str(tree(again).nodes[again.redone or 0]) == "m_travel(park)"
    assert str(again.tree) == textwrap.dedent("""\
        m_day() by out  #1
          + a_wait()  #2
          m_travel(park) by by_bus  #3
            (! a_walk(park))  #6
            a_pay(park)  #8
            a_ride(park)  #9
          m_travel(home) by on_foot  #4
            a_walk(home)  #7
          a_eat()  #5
        """)


def test_later_tasks_are_planned_for_the_current_state():
    first = day()
    again = PLANNER.replan(TaskState(raining=True, bus=False), tree(first), node(first, "a_walk(park)"))
    assert texts(again) == ["a_drive(park)", "a_pay(park)", "a_drive(home)", "a_pay(home)", "a_eat()"]


def test_the_way_that_failed_is_taken_again_only_if_there_is_no_other():
    domain = TaskDomain("stubborn")
    domain.declare_actions(action("a_push"))
    domain.declare_task_methods("m_push", lambda state: [("a_push",), ("a_push",)])
    planner = TaskPlanner(domain)
    first = planner.plan(DAY, [("m_push",)])
    again = planner.replan(DAY, tree(first), first.plan[1].id)
    assert texts(again) == ["a_push()", "a_push()"]
    assert [node.status for node in tree(again).history] == ["done", "failed"]
    never = planner.replan(DAY, tree(first), first.plan[1].id, blacklist=[("a_push",)])
    assert (never.verdict, never.tree) == (TaskVerdict.IMPOSSIBLE, None)
    assert never.message == "no plan: after 0 actions a_push() is blacklisted"


def test_blacklisted_actions_move_the_repair_up_the_tree():
    first = day()
    again = PLANNER.replan(
        DAY, tree(first), node(first, "a_walk(park)"), blacklist=[("a_walk", "park"), ("a_pay", "park")]
    )
    assert again.verdict is TaskVerdict.IMPOSSIBLE
    domain = travel()

    @domain.method("m_day")
    def at_home(state):
        return [("a_wait",), ("a_eat",)]

    planner = TaskPlanner(domain)
    first = planner.plan(DAY, [("m_day",)])
    again = planner.replan(
        DAY, tree(first), node(first, "a_walk(park)"), blacklist=[("a_walk", "park"), ("a_pay", "park")]
    )
    assert texts(again) == ["a_wait()", "a_eat()"]
    assert again.redone == tree(again).roots[0]
    assert [(str(node), node.status) for node in tree(again).history] == [
        ("a_wait()", "done"),
        ("a_walk(park)", "failed"),
    ]


def test_an_action_that_no_task_is_above_is_tried_once_more():
    first = PLANNER.plan(DAY, [("a_wait",), ("a_eat",)])
    again = PLANNER.replan(DAY, tree(first), first.plan[0].id)
    assert again.plan == (tree(again).nodes[first.plan[0].id], first.plan[1])
    assert [(str(node), node.status) for node in tree(again).history] == [("a_wait()", "failed")]


def test_one_failure_after_another_leaves_a_full_history():
    answer = day()
    for failing in ("a_walk(park)", "a_ride(park)", "a_walk(home)", "a_ride(home)"):
        answer = PLANNER.replan(DAY, tree(answer), node(answer, failing))
    assert [f"{node.status} {node}" for node in tree(answer).history] == [
        "done a_wait()",
        "failed a_walk(park)",
        "done a_pay(park)",
        "failed a_ride(park)",
        "done a_walk(park)",
        "failed a_walk(home)",
        "done a_pay(home)",
        "failed a_ride(home)",
    ]
    assert texts(answer) == ["a_walk(home)", "a_eat()"]


def test_a_world_that_changed_for_the_worse_changes_the_plan_before_it_fails():
    first = day()
    rain = TaskState(raining=True, bus=True)
    revised = PLANNER.revise(rain, tree(first), node(first, "a_wait()"))
    assert texts(revised) == ["a_wait()", "a_pay(park)", "a_ride(park)", "a_pay(home)", "a_ride(home)", "a_eat()"]
    assert revised.redone is None
    assert revised.plan[0] == first.plan[0]
    assert revised.plan[-1] == first.plan[-1]


def test_a_started_task_is_kept():
    rain = TaskState(raining=True, bus=True)
    first = PLANNER.plan(rain, [("m_day",)])
    revised = PLANNER.revise(DAY, tree(first), node(first, "a_ride(park)"))
    assert texts(revised) == ["a_ride(park)", "a_walk(home)", "a_eat()"]


@pytest.mark.parametrize("which", [0, 1, 99])
def test_only_actions_of_the_plan_can_fail(which):
    first = day()
    for answer in (PLANNER.replan(DAY, tree(first), which), PLANNER.revise(DAY, tree(first), which)):
        assert (answer.verdict, answer.fault) == (TaskVerdict.ERROR, TaskFault.UNKNOWN)
        assert f"no planned action at node {which}" in answer.message


def test_the_failed_tree_is_not_modified():
    first = day()
    before = str(first.tree)
    PLANNER.replan(DAY, tree(first), node(first, "a_walk(park)"))
    assert str(first.tree) == before
