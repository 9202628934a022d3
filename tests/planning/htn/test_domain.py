from __future__ import annotations

import copy
import pickle

import pytest

from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import TaskDomain, TaskState


def a_say(state, text):
    return state


def a_move(state, robot, room, speed=1.0):
    if room == "nowhere":
        return None
    state.loc[robot] = room
    return state


def go(state, robot, *rooms):
    return [("a_move", robot, room) for room in rooms]


def test_actions_and_methods_are_declared_by_decorators_or_in_lists():
    one, other = TaskDomain("one"), TaskDomain("other")
    assert one.action(a_say) is a_say
    one.action(a_move)
    assert one.method("m_go")(go) is go
    other.declare_actions([a_say, a_move])
    other.declare_task_methods("m_go", [go])
    assert one.actions == other.actions
    assert one.methods == other.methods


def test_an_operator_knows_how_many_arguments_it_takes():
    domain = TaskDomain("d")
    domain.declare_actions(a_say, a_move)
    domain.declare_task_methods("m_go", go)
    say, move, (way,) = domain.actions["a_say"], domain.actions["a_move"], domain.methods["m_go"]
    assert (say.arity, move.arity, way.arity) == ("1", "2 to 3", "1 or more")
    assert [count for count in range(5) if move.takes(count)] == [2, 3]
    assert [count for count in range(5) if way.takes(count)] == [1, 2, 3, 4]


def test_a_repeated_declaration_has_no_effect():
    domain = TaskDomain("d")
    for _ in range(2):
        domain.declare_actions(a_say)
        domain.declare_task_methods("m_go", go)
    assert list(domain.actions) == ["a_say"]
    assert len(domain.methods["m_go"]) == 1


def test_a_name_means_one_thing():
    domain = TaskDomain("d")
    domain.declare_actions(a_say)
    domain.declare_task_methods("m_go", go)

    def other(state):
        return state

    with pytest.raises(PlanningError, match="has an action 'a_say' already"):
        domain.declare_task_methods("a_say", other)
    other.__name__ = "m_go"
    with pytest.raises(PlanningError, match="has a task 'm_go' already"):
        domain.declare_actions(other)
    other.__name__ = "a_say"
    with pytest.raises(PlanningError, match="has an action 'a_say' already"):
        domain.declare_actions(other)
    other.__name__ = "go"
    with pytest.raises(PlanningError, match="m_go has a method 'go' already"):
        domain.declare_task_methods("m_go", other)


def without_state():
    return None


def with_keyword(state, *, room):
    return state


@pytest.mark.parametrize("function", [without_state, with_keyword])
def test_a_function_that_no_planner_can_call_is_refused_where_it_stands(function):
    with pytest.raises(PlanningError, match="cannot be called with a state") as refused:
        TaskDomain("d").declare_actions(function)
    assert refused.value.where == f"{__file__}:{function.__code__.co_firstlineno}"


def test_the_state_after_actions_is_another_one():
    domain = TaskDomain("d")
    domain.declare_actions(a_say, a_move)
    state = TaskState(loc={"spot1": "room1"})
    after = domain.after(state, [("a_say", "hello"), ("a_move", "spot1", "room2")])
    assert (state.loc["spot1"], after.loc["spot1"]) == ("room1", "room2")
    with pytest.raises(PlanningError, match=r"a_move\(spot1, nowhere\) cannot be done"):
        domain.after(state, [("a_move", "spot1", "nowhere")])
    with pytest.raises(PlanningError, match="has no action 'a_jump'"):
        domain.after(state, [("a_jump",)])


def test_a_copy_of_a_state_can_be_changed_alone():
    state = TaskState("ward", loc={"spot1": "room1"}, rooms=["room1"], people={"ann"}, hour=8)
    other = state.copy()
    assert other == state
    other.loc["spot1"] = "room2"
    other.rooms.append("room2")
    other.people.add("bob")
    other.hour = 9
    assert state == TaskState(loc={"spot1": "room1"}, rooms=["room1"], people={"ann"}, hour=8)
    assert other != state


def test_a_state_names_a_missing_variable():
    with pytest.raises(AttributeError, match="ward has no state variable 'lok'"):
        _ = TaskState("ward", loc={}).lok


def test_a_state_can_be_pickled_and_copied_deeply():
    state = TaskState("ward", loc={"spot1": "room1"})
    for other in (pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
        assert repr(other) == repr(state) == "State('ward', loc={'spot1': 'room1'})"
        assert other == state
