from __future__ import annotations

import sys
import textwrap
import threading
import time
from collections.abc import Callable

import pytest

from socialbot.bridge._node_thread import Stopwatch
from socialbot.planning.htn.domain import Item, TaskDomain, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskFault, TaskLimits, TaskVerdict

HERE = TaskState(loc="home", told=())


def household() -> TaskDomain:
    domain = TaskDomain("household")

    @domain.action
    def a_say(state, text):
        return state

    @domain.action
    def a_go(state, room):
        state.loc = room
        return state

    @domain.action
    def a_lift(state, thing):
        return state if state.loc == "kitchen" else None

    @domain.method("m_greet")
    def politely(state, name):
        return [("a_say", "hello"), ("a_say", "hello"), ("a_say", name)]

    @domain.method("m_fetch")
    def here(state, thing):
        return [("a_lift", thing)]

    @domain.method("m_fetch")
    def elsewhere(state, thing):
        return [("a_go", "cellar"), ("a_lift", thing)]

    @domain.method("m_fetch")
    def in_the_kitchen(state, thing):
        return [("a_go", "kitchen"), ("a_lift", thing), ("m_greet", "you")]

    @domain.method("m_rest")
    def nothing(state):
        return []

    return domain


def with_method(method: Callable) -> TaskPlanner:
    """A planner for a household with one more method, for the task ``m_odd``."""
    domain = household()
    domain.declare_task_methods("m_odd", method)
    return TaskPlanner(domain)


def test_actions_that_change_nothing_stay_in_the_plan_each_time():
    answer = TaskPlanner(household()).plan(HERE, [("m_greet", "ann")])
    assert [node.item for node in answer.plan] == [("a_say", "hello"), ("a_say", "hello"), ("a_say", "ann")]


def test_methods_are_tried_in_order_until_one_leads_to_the_end():
    answer = TaskPlanner(household()).plan(HERE, [("m_fetch", "cup")])
    assert [str(node) for node in answer.plan] == [
        "a_go(kitchen)",
        "a_lift(cup)",
        "a_say(hello)",
        "a_say(hello)",
        "a_say(you)",
    ]
    assert answer.tree is not None
    assert answer.tree.nodes[1].method == "in_the_kitchen"


def test_the_tree_can_be_drawn():
    tree = TaskPlanner(household()).plan(HERE, [("m_rest",), ("m_fetch", "cup")]).tree
    assert tree is not None
    assert str(tree) == textwrap.dedent("""\
        m_rest() by nothing  #1
        m_fetch(cup) by in_the_kitchen  #2
          a_go(kitchen)  #3
          a_lift(cup)  #4
          m_greet(you) by politely  #5
            a_say(hello)  #6
            a_say(hello)  #7
            a_say(you)  #8
        """)


def test_an_empty_plan_differs_from_no_plan():
    planner = TaskPlanner(household())
    for tasks in ([], [("m_rest",)]):
        answer = planner.plan(HERE, tasks)
        assert (answer.verdict, answer.plan) == (TaskVerdict.PLAN, ())
    answer = planner.plan(HERE, [("a_say", "now"), ("a_lift", "cup")])
    assert (answer.verdict, answer.tree) == (TaskVerdict.IMPOSSIBLE, None)
    assert answer.message == "no plan: after 1 action a_lift(cup) cannot be done"


def test_a_blacklisted_action_is_not_planned():
    planner = TaskPlanner(household())
    answer = planner.plan(HERE, [("m_fetch", "cup")], blacklist=[("a_go", "kitchen")])
    assert answer.verdict is TaskVerdict.IMPOSSIBLE
    answer = planner.plan(HERE, [("m_fetch", "cup")], blacklist=[("a_go", "attic")])
    assert answer.verdict is TaskVerdict.PLAN
    answer = planner.plan(HERE, [("a_go", "kitchen")], blacklist=[("a_go", "kitchen")])
    assert answer.message == "no plan: after 0 actions a_go(kitchen) is blacklisted"


def test_arguments_may_be_unhashable():
    answer = TaskPlanner(household()).plan(HERE, [("a_say", ["x"])], blacklist=[("a_say", ["y"])])
    assert answer.plan[0].item == ("a_say", ["x"])
    assert TaskPlanner(household()).plan(HERE, [("a_say", ["y"])], blacklist=[("a_say", ["y"])]).plan == ()


@pytest.mark.parametrize(
    ("tasks", "fault", "message"),
    [
        ([("m_fetchh", "cup")], TaskFault.UNKNOWN, "did you mean 'm_fetch'?"),
        ([("walk",)], TaskFault.UNKNOWN, "household has no action or task 'walk'"),
        ([("a_say",)], TaskFault.ARITY, "a_say(), in the request: a_say takes 1 arguments"),
        ([("m_fetch", "cup", "plate")], TaskFault.ARITY, "here takes 1 arguments"),
        (["m_rest"], TaskFault.MALFORMED, "'m_rest', in the request, is no task"),
        ([()], TaskFault.MALFORMED, "is no task"),
    ],
)
def test_an_invalid_request_is_an_error_and_no_empty_plan(tasks, fault, message):
    answer = TaskPlanner(household()).plan(HERE, tasks)
    assert (answer.verdict, answer.fault, answer.tree) == (TaskVerdict.ERROR, fault, None)
    assert message in answer.message


def test_a_mistyped_blacklist_is_an_error():
    answer = TaskPlanner(household()).plan(HERE, [("m_rest",)], blacklist=[("a_goo", "kitchen")])
    assert answer.fault is TaskFault.UNKNOWN
    assert "did you mean 'a_go'?" in answer.message


def mistyped(state):
    return [("m_rest",), ("m_gret", "ann")]


def raising(state):
    return [("a_go", state.loc["spot"])]


def asking(state):
    return [("a_go", state.lok)]


def no_list(state):
    return {("m_rest",)}


def no_state(state):
    return True


@pytest.mark.parametrize(
    ("method", "fault", "message"),
    [
        (mistyped, TaskFault.UNKNOWN, "did you mean 'm_greet'?"),
        (raising, TaskFault.RAISED, "raising for m_odd(): TypeError: string indices must be integers"),
        (asking, TaskFault.RAISED, "has no state variable 'lok'"),
        (no_list, TaskFault.MALFORMED, "no_list returned {('m_rest',)}, which is no list"),
    ],
)
def test_a_wrong_method_is_an_error_with_its_position(method, fault, message):
    answer = with_method(method).plan(HERE, [("a_say", "hello"), ("m_odd",)])
    assert (answer.verdict, answer.fault) == (TaskVerdict.ERROR, fault)
    assert message in answer.message
    line = method.__code__.co_firstlineno + (fault is TaskFault.RAISED)
    assert answer.message.startswith(f"{__file__}:{line}: ")


def test_a_wrong_action_is_an_error():
    domain = household()
    domain.declare_actions(no_state, raising)
    planner = TaskPlanner(domain)
    assert planner.plan(HERE, [("no_state",)]).fault is TaskFault.MALFORMED
    assert planner.plan(HERE, [("raising",)]).fault is TaskFault.RAISED


def test_a_wrong_method_does_no_harm_when_an_earlier_one_will_do():
    domain = household()
    domain.declare_task_methods("m_rest", raising)
    assert TaskPlanner(domain).plan(HERE, [("m_rest",)]).verdict is TaskVerdict.PLAN
    assert TaskPlanner(domain).plan(HERE, [("m_rest",), ("a_lift", "cup")]).fault is TaskFault.RAISED


def endless(state):
    return [("a_say", "on and on"), ("m_odd",)]


@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.3])
def test_a_timeout_of_any_length_works_in_any_thread(seconds):
    answers, times = [], []
    planner = with_method(endless)

    def ask():
        stopwatch = Stopwatch()
        answers.append(planner.plan(HERE, [("m_odd",)], TaskLimits(timeout_s=seconds)))
        times.append((*stopwatch.seconds(), time.thread_time()))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    whole, blocked, worked = times[0]
    assert answers[0].verdict is TaskVerdict.TIMEOUT
    assert seconds <= answers[0].seconds <= whole
    assert seconds <= worked < seconds + 0.5
    assert blocked < 0.5, "besides that it only waits for a processor"


def test_the_time_in_which_others_have_the_processor_does_not_count():
    def a_wait(state):
        time.sleep(0.3)
        return state

    domain = household()
    domain.declare_actions(a_wait)
    asked = [("a_wait",), ("a_say", "at last")]
    assert TaskPlanner(domain).plan(HERE, asked, TaskLimits(timeout_s=0.2)).verdict is TaskVerdict.PLAN


def test_the_number_of_attempts_is_bounded_too():
    answer = with_method(endless).plan(HERE, [("m_odd",)], TaskLimits(timeout_s=60, steps=1000))
    assert answer.verdict is TaskVerdict.TIMEOUT
    assert answer.message == "no plan within 60 s and 1000 attempts"


def test_planning_is_cancelled_from_another_thread():
    begun, cancelled = threading.Event(), threading.Event()

    def slow(state):
        begun.set()
        return [("a_say", "on and on"), ("m_odd",)]

    answers = []
    planner = with_method(slow)
    thread = threading.Thread(
        target=lambda: answers.append(
            planner.plan(HERE, [("m_odd",)], TaskLimits(timeout_s=60, steps=10**9), cancelled=cancelled)
        )
    )
    thread.start()
    assert begun.wait(60)
    cancelled.set()
    thread.join(60)
    assert answers[0].verdict is TaskVerdict.CANCELLED


def test_tasks_may_be_nested_deeply():
    domain = household()

    @domain.method("m_count")
    def down(state, number):
        return [("a_say", number), ("m_count", number - 1)] if number else []

    depth = 20_000
    planner = TaskPlanner(domain)
    answer = planner.plan(HERE, [("m_count", depth)], TaskLimits(timeout_s=60))
    assert len(answer.plan) == depth
    assert answer.tree is not None
    again = planner.replan(HERE, answer.tree, answer.plan[-1].id, TaskLimits(timeout_s=60))
    assert [node.item for node in again.plan] == [("a_say", 1)]
    assert again.tree is not None
    assert len(again.tree.history) == depth
    del answer, again


def test_planners_of_different_domains_work_side_by_side_in_threads():
    def domain_of(number: int) -> TaskDomain:
        domain = TaskDomain(f"domain {number}")

        def act(state, step):
            return state

        def way(state, step):
            return [(f"act{number}", step), ("task", step + 1)] if step < 50 else []

        act.__name__ = f"act{number}"
        domain.declare_actions(act)
        domain.declare_task_methods("task", way)
        return domain

    planners = [TaskPlanner(domain_of(number % 4)) for number in range(8)]
    answers: list[list] = [[] for _ in planners]

    def work(number: int) -> None:
        for _ in range(15):
            answers[number].append(planners[number].plan(TaskState(), [("task", 0)]))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        threads = [threading.Thread(target=work, args=(number,)) for number in range(len(planners))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    for number, some in enumerate(answers):
        expected = [(f"act{number % 4}", step) for step in range(50)]
        assert [[node.item for node in answer.plan] for answer in some] == [expected] * 15


def test_the_same_question_gets_the_same_answer():
    planner = TaskPlanner(household())
    trees = [planner.plan(HERE, [("m_fetch", "cup")]).tree for _ in range(3)]
    assert trees[0] == trees[1] == trees[2]


def test_the_search_tries_a_method_only_if_those_before_it_fail():
    domain, called = TaskDomain("lazy"), []

    @domain.action
    def act(state: TaskState) -> TaskState:
        return state

    @domain.method("task")
    def first(state: TaskState) -> list[Item]:
        called.append("first")
        return [("act",)]

    @domain.method("task")
    def second(state: TaskState) -> list[Item]:
        called.append("second")
        return [("act",)]

    assert TaskPlanner(domain).plan(TaskState(), [("task",)]).plan
    assert called == ["first"]
