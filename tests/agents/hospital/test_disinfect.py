from __future__ import annotations

import time

import pytest

from socialbot.agents.hospital.plans import DISINFECT, mission, ward
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskAnswer, TaskLimits, TaskNode, TaskTree, TaskVerdict
from tests.agents.hospital.listings import LISTING_3, LISTING_4, NURSE, ROOM, SPOT, UVD

MISSION = mission(SPOT, UVD, NURSE)
PLANNER = TaskPlanner(DISINFECT)


def infected(rooms: int = 1) -> TaskState:
    """A ward where the rooms of all nurses are to be disinfected."""
    state = ward(
        {f"nurse_disinfected{number}": f"room{number}" for number in range(1, rooms + 1)}, (SPOT, UVD), "waiting_room"
    )
    state.disinfected = dict.fromkeys(state.disinfected, False)
    return state


def items(answer: TaskAnswer) -> list[Item]:
    return [node.item for node in answer.plan]


def tree(answer: TaskAnswer) -> TaskTree:
    assert answer.tree is not None
    return answer.tree


def reach(answer: TaskAnswer, state: TaskState, item: Item) -> tuple[TaskNode, TaskState]:
    """The node of ``item``, and the state after all that comes before it."""
    position = items(answer).index(item)
    return answer.plan[position], DISINFECT.after(state, items(answer)[:position])


def test_plan_for_one_room_equals_listing_3():
    answer = PLANNER.plan(infected(), [MISSION])
    assert items(answer) == LISTING_3
    assert DISINFECT.after(infected(), items(answer)).disinfected == {ROOM: True}


def test_repair_after_failed_patrol_equals_listing_4():
    answer = PLANNER.plan(infected(), [MISSION])
    patrol, state = reach(answer, infected(), ("a_patrol_room", SPOT, ROOM))
    state.cleaned[ROOM] = False
    again = PLANNER.replan(state, tree(answer), patrol.id)
    assert items(again) == LISTING_4[6:]
    assert [node.item for node in tree(again).history] == LISTING_3[:6]
    assert [node.status for node in tree(again).history] == ["done"] * 5 + ["failed"]
    assert again.plan[-3:] == answer.plan[-3:], "the slice of the other robot stays as it was, with its ids"


def test_full_replan_after_failed_patrol_starts_with_path_to_nurse():
    _, state = reach(PLANNER.plan(infected(), [MISSION]), infected(), ("a_patrol_room", SPOT, ROOM))
    state.cleaned[ROOM] = False
    assert items(PLANNER.plan(state, [MISSION])) == [
        ("a_navigate_to", SPOT, ROOM),
        ("a_approach_nurse", SPOT, NURSE),
        ("a_authenticate_nurse", SPOT, NURSE),
        ("a_adapt_room", NURSE, ROOM),
        *LISTING_3[4:],
    ]


def test_revision_tidies_dirty_room_before_patrol():
    answer = PLANNER.plan(infected(), [MISSION])
    approach, state = reach(answer, infected(), ("a_approach_nurse", SPOT, NURSE))
    state.cleaned[ROOM] = False
    revised = PLANNER.revise(state, tree(answer), approach.id)
    assert items(revised) == [*LISTING_3[2:4], ("a_adapt_room", NURSE, ROOM), *LISTING_3[4:]]
    assert revised.redone is None


def test_person_after_patrol_leads_to_another_patrol():
    answer = PLANNER.plan(infected(), [MISSION])
    light, state = reach(answer, infected(), ("a_disinfect_room", UVD, ROOM))
    state.cleaned[ROOM] = False
    again = items(PLANNER.replan(state, tree(answer), light.id))
    assert again.index(("a_adapt_room", NURSE, ROOM)) < again.index(("a_patrol_room", SPOT, ROOM))
    assert again[-1] == ("a_disinfect_room", UVD, ROOM)


@pytest.mark.parametrize("robot", [SPOT, UVD])
def test_robot_with_low_battery_charges_first(robot):
    state = infected()
    state.low_battery[robot] = True
    expected: list[Item] = list(LISTING_3)
    expected.insert(expected.index(("a_navigate_to", robot, ROOM)), ("a_charge", robot))
    assert items(PLANNER.plan(state, [MISSION])) == expected


@pytest.mark.parametrize(
    ("failing", "low", "first"),
    [
        (("a_navigate_to", SPOT, ROOM), SPOT, [("a_charge", SPOT), ("a_navigate_to", SPOT, ROOM)]),
        (("a_navigate_to", UVD, ROOM), UVD, [("a_charge", UVD), ("a_navigate_to", UVD, ROOM)]),
        (
            ("a_patrol_room", SPOT, ROOM),
            SPOT,
            [("a_charge", SPOT), ("a_navigate_to", SPOT, ROOM), ("a_approach_nurse", SPOT, NURSE)],
        ),
        (("a_disinfect_room", UVD, ROOM), UVD, [("a_authorize_disinfect", UVD, SPOT), ("a_charge", UVD)]),
    ],
)
def test_battery_low_during_movement_is_charged(failing, low, first):
    answer = PLANNER.plan(infected(), [MISSION])
    failed, state = reach(answer, infected(), failing)
    state.low_battery[low] = True
    again = PLANNER.replan(state, tree(answer), failed.id)
    assert items(again)[: len(first)] == first
    assert DISINFECT.after(state, items(again)).disinfected == {ROOM: True}


def test_disinfected_room_needs_no_plan():
    state = infected()
    state.disinfected[ROOM] = True
    assert PLANNER.plan(state, [MISSION]).verdict is TaskVerdict.IMPOSSIBLE


def test_dirty_room_without_nurse_has_no_plan_with_reason():
    state = infected()
    state.cleaned[ROOM] = False
    answer = PLANNER.plan(state, [MISSION], blacklist=[("a_adapt_room", NURSE, ROOM)])
    assert answer.verdict is TaskVerdict.IMPOSSIBLE
    assert f"m_disinfect_room({UVD}, {SPOT}, {NURSE})" in answer.message


@pytest.mark.parametrize("rooms", [1, 10, 100, 1000])
def test_many_rooms_are_planned_and_repaired_quickly(rooms):
    state = infected(rooms)
    missions = [mission(SPOT, UVD, f"nurse_disinfected{number}") for number in range(1, rooms + 1)]
    begin = time.thread_time()
    answer = PLANNER.plan(state, missions, TaskLimits(timeout_s=60))
    assert time.thread_time() - begin < 2.0
    assert len(answer.plan) == 9 * rooms
    middle = (rooms + 1) // 2
    patrol, now = reach(answer, state, ("a_patrol_room", SPOT, f"room{middle}"))
    now.cleaned[f"room{middle}"] = False
    begin = time.thread_time()
    again = PLANNER.replan(now, tree(answer), patrol.id, TaskLimits(timeout_s=60))
    assert time.thread_time() - begin < 2.0
    assert len(again.plan) == 8 + 9 * (rooms - middle)
    assert again.plan[5:] == answer.plan[9 * middle - 3 :]
