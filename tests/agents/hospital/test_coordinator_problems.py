"""Actions of the coordinator before and after a problem."""

from __future__ import annotations

import pytest

from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CLOSED_DOOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
)
from socialbot.agents.teams.messages import End, Finished, Plan, Problem, Report
from socialbot.core.clock import SECOND
from tests.agents.hospital.directed import Ward, started
from tests.agents.hospital.listings import LISTING_3, LISTING_4, NURSE, ROOM, SPOT, UVD

# After a problem


def test_repaired_plan_equals_listing_4():
    ward = started(policy="repair")
    ward.do(5)
    ward.agent(SPOT, place=ROOM)
    ward.look()
    ward.fail(DIRTY_ROOM)
    assert ward.history() == LISTING_4
    assert [each.status for each in next(ward.coordinator.manager.views()).actions] == (
        ["done"] * 5 + ["failed"] + ["planned"] * 8
    )
    ward.do(8)
    assert {each.status for each in next(ward.coordinator.manager.views()).actions[6:]} == {"done"}


def test_full_replan_starts_with_the_path_to_the_nurse():
    ward = started(policy="replan")
    ward.do(5)
    ward.room(door_open=True)
    ward.look()
    ward.fail(DIRTY_ROOM)
    assert ward.plan() == [
        LISTING_3[0],
        *LISTING_3[2:4],
        ("a_adapt_room", NURSE, ROOM),
        *LISTING_3[4:],
    ]


def test_auto_policy_repairs_plans_with_few_joint_actions():
    ward = started(policy="auto")
    ward.do(5)
    ward.fail(DIRTY_ROOM)
    assert ward.plan()[0] == ("a_adapt_room", NURSE, ROOM)


def test_without_recovery_mission_fails_and_team_is_free():
    ward = started(policy="none")
    ward.do(5)
    ward.fail(DIRTY_ROOM)
    assert ward.statuses() == {1: "failed"}
    assert next(ward.coordinator.manager.views()).actions[-1].status == "failed"
    assert ward.working() == {}
    assert {to for to, _, what, _ in ward.said if isinstance(what, End)} == {SPOT, UVD, NURSE}
    ward.look()
    assert ward.statuses() == {1: "failed"}, "it does not start again"


def test_finished_agent_is_reassigned_and_agent_without_actions_is_released():
    ward = started(policy="repair")
    ward.do(5)
    ward.send(NURSE, Finished(), mission="mission_1_1", performative="request")
    ward.fail(DIRTY_ROOM)
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}
    assert ward.contents(Plan, NURSE)[-1].label == "mission_1_2"


@pytest.mark.parametrize(
    ("done", "kind", "first"),
    [
        (0, LOW_BATTERY, [("a_charge", SPOT), ("a_navigate_to", SPOT, ROOM)]),
        (5, PERSON_IN_ROOM, [("a_adapt_room", NURSE, ROOM)]),
        (7, LOW_BATTERY, [("a_charge", UVD), ("a_navigate_to", UVD, ROOM)]),
    ],
)
def test_mission_recovers_from_each_kind_of_problem(done, kind, first):
    ward = started()
    ward.do(done)
    ward.fail(kind)
    assert ward.plan()[: len(first)] == first


def test_closed_door_before_uvd_is_opened_by_spot():
    ward = started(policy="repair")
    ward.do(7)
    ward.fail(CLOSED_DOOR)
    assert ward.plan()[:2] == LISTING_3[:2]


def test_repeated_failure_after_repair_leads_to_new_plan():
    ward = started(policy="repair")
    ward.do(5)
    ward.agent(SPOT, place=ROOM)
    ward.look()
    for _ in range(2):
        ward.do(4 if ward.label() == "mission_1_2" else 0)
        ward.fail(DIRTY_ROOM)
    assert ward.label() == "mission_1_3"
    assert ward.plan()[0] == LISTING_3[0]


def test_repair_does_not_build_on_actions_of_an_agent_that_has_worked_elsewhere_since():
    ward = Ward(rooms=2, uvds=2, policy="auto")
    ward.register()
    ward.infect()
    ward.do(8)
    ward.send(SPOT, Finished(), mission=ward.label(), performative="request")
    ward.infect("room2")
    assert ward.working()[SPOT] == 2
    ward.do(9, mission=2)
    ward.finish(2)
    ward.room("room2", disinfected=True)
    ward.fail(LOW_BATTERY)
    assert ("a_patrol_room", SPOT, ROOM) in ward.plan(), "it has been in room2 since its patrol"


def test_repair_builds_on_actions_of_an_agent_that_was_free_since():
    ward = started(policy="auto")
    ward.do(8)
    ward.send(SPOT, Finished(), mission=ward.label(), performative="request")
    ward.fail(LOW_BATTERY)
    assert ward.plan()[0] == ("a_authorize_disinfect", UVD, SPOT)


def test_mission_with_repeated_failures_waits_and_releases_its_team():
    ward = started(rest_s=5.0)
    for _ in range(4):
        ward.fail("it is stuck")
    assert ward.statuses() == {1: "waiting"}
    assert ward.working() == {}
    ward.look(4.9)
    assert ward.statuses() == {1: "waiting"}
    ward.look(0.2)
    assert ward.statuses() == {1: "running"}


def test_robots_work_elsewhere_while_the_nurse_is_away():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.do(2)
    ward.agent(NURSE, place=AWAY)
    ward.look()
    ward.fail(NURSE_ABSENT)
    assert ward.statuses() == {1: "waiting", 2: "running"}


def test_team_without_news_is_asked_and_gets_new_plan_if_it_answers():
    ward = started(patience_s=10.0)
    ward.do(3)
    ward.look(9.9)
    assert ward.label() == "mission_1_1"
    before = len(ward.said)
    ward.look(0.2)
    assert [(to, act) for to, act, *_ in ward.said[before:]] == [(NURSE, "query"), (SPOT, "query"), (UVD, "query")]
    ward.answer()
    assert ward.label() == "mission_1_1"
    ward.look(5.0)
    assert ward.label() == "mission_1_2"
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}, "nobody could replace them"


def test_member_that_does_not_answer_is_replaced():
    ward = started(spots=2, patience_s=10.0, rest_s=1.0)
    ward.do(3)
    ward.look(10.1)
    ward.answer(UVD, NURSE)
    ward.look(5.0)
    assert ward.statuses() == {1: "waiting"}
    assert ward.view().problem == f"{SPOT} does not answer"
    ward.look(1.0)
    assert ward.working() == {"spotrobot2": 1, UVD: 1, NURSE: 1}


def test_mission_without_staff_names_the_missing_roles_until_an_agent_returns():
    ward = started(patience_s=10.0, rest_s=1.0)
    ward.look(10.1)
    ward.answer(UVD, NURSE)
    ward.look(5.0)
    ward.look(1.0)
    assert ward.view().problem == f"nobody for SpotRobot ({SPOT} does not answer)"
    ward.look(1000.0)
    assert ward.statuses() == {1: "waiting"}
    ward.register(SPOT)
    ward.look()
    assert ward.statuses() == {1: "running"}
    assert ward.view().problem == f"{SPOT} does not answer"


def test_mission_names_the_roles_that_nobody_registered_for():
    ward = Ward(uvds=0)
    ward.register(SPOT)
    ward.infect()
    assert ward.view().problem == (
        "nobody for NurseDisinfect (no such agent is registered), nobody for UvdRobot (no such agent is registered)"
    )


def test_member_that_is_stuck_in_an_action_is_replaced_and_taken_back():
    ward = started(spots=2, pace="paper", rest_s=1.0)
    ward.agent(SPOT, busy=f"a_navigate_to({SPOT}, {ROOM})")
    for _ in range(20):
        ward.look(1.0)
    assert ward.statuses() == {1: "running"}, "the limit is 3 times 6 s of a way, and 10 s"
    for _ in range(12):
        ward.look(1.0)
    assert ward.working() == {"spotrobot2": 1, UVD: 1, NURSE: 1}
    assert ward.view().problem == f"{SPOT} is stuck in a_navigate_to"
    ward.do(9)
    ward.finish()
    ward.room(disinfected=True)
    ward.agent(SPOT, busy="")
    ward.look(60.0)
    assert ward.statuses() == {1: "finished"}
    ward.infect()
    assert ward.working() == {SPOT: 2, UVD: 2, NURSE: 2}


def test_a_robot_on_a_long_way_is_not_stuck_until_it_stops():
    ward = started(spots=2, pace="paper", rest_s=1.0)
    ward.agent(SPOT, busy=f"a_navigate_to({SPOT}, {ROOM})")
    for second in range(300):
        ward.agent(SPOT, x=float(second))
        ward.look(1.0)
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}
    for _ in range(30):
        ward.look(1.0)
    assert ward.view().problem == f"{SPOT} is stuck in a_navigate_to"


def test_a_robot_that_waits_for_a_partner_on_a_long_way_is_not_stuck():
    ward = started(uvds=2, pace="paper", rest_s=1.0)
    ward.agent(SPOT, busy=f"a_authorize_disinfect({UVD}, {SPOT})")
    ward.agent(UVD, busy=f"a_navigate_to({UVD}, {ROOM})")
    for second in range(200):
        ward.agent(UVD, x=float(second))
        ward.look(1.0)
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}


def test_member_that_nobody_can_replace_tries_again():
    ward = started(pace="paper")
    ward.agent(SPOT, busy=f"a_navigate_to({SPOT}, {ROOM})")
    for _ in range(30):
        ward.look(1.0)
    assert ward.label() == "mission_1_2"
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}


def test_robots_that_get_stuck_again_and_again_are_set_aside_for_longer():
    ward = started(spots=2, pace="paper", rest_s=1.0)
    aside_s = []
    for robot in (SPOT, "spotrobot2", SPOT, "spotrobot2"):
        ward.agent(robot, busy=f"a_navigate_to({robot}, {ROOM})")
        while ward.working().get(robot):
            ward.look(1.0)
        ward.agent(robot, busy="")
        member = ward.coordinator.memory.members[robot]
        aside_s.append((member.aside_until - ward.now) / SECOND)
        ward.look(1.0)
        ward.look(aside_s[-1])
    assert aside_s == [60.0, 60.0, 120.0, 120.0]


def test_robot_that_fails_by_itself_again_and_again_is_replaced():
    ward = started(spots=2, rest_s=1.0)
    for _ in range(4):
        ward.fail("motor overheated")
    ward.look(1.0)
    assert ward.working() == {"spotrobot2": 1, UVD: 1, NURSE: 1}


def test_restarted_robot_gets_new_plan():
    ward = started()
    ward.do(3)
    ward.register(SPOT)
    assert ward.label() == "mission_1_2"


def test_reports_about_old_plans_are_ignored():
    ward = started()
    ward.fail(DIRTY_ROOM)
    before = ward.plan()
    ward.send(SPOT, Problem(DIRTY_ROOM, (SPOT, ROOM), "a_patrol_room"), mission="mission_1_1")
    ward.send(SPOT, Report("success", *LISTING_3[0][:1], LISTING_3[0][1:]), mission="mission_1_1")
    assert ward.plan() == before
    assert ward.label() == "mission_1_2"


# Before a problem


def test_proactive_coordinator_plans_for_the_present_room():
    ward = Ward(proactive=True)
    ward.register()
    ward.room(cleaned=False, door_open=True)
    ward.infect()
    assert ("a_adapt_room", NURSE, ROOM) in ward.plan()
    assert ("a_open_door", SPOT, ROOM) not in ward.plan()


@pytest.mark.parametrize(
    ("change", "needed"),
    [
        (lambda ward: ward.room(cleaned=False), ("a_adapt_room", NURSE, ROOM)),
        (lambda ward: ward.room(people=("person1",)), ("a_adapt_room", NURSE, ROOM)),
        (lambda ward: ward.agent(UVD, battery=0.1), ("a_charge", UVD)),
    ],
)
def test_proactive_coordinator_revises_plan_before_the_problem(change, needed):
    ward = started(proactive=True)
    ward.do(2)
    ward.room(door_open=True)
    ward.agent(SPOT, place=ROOM)
    ward.look()
    assert ward.label() == "mission_1_1", "nothing stands in the way"
    change(ward)
    ward.look()
    ward.look()
    assert ward.label() == "mission_1_2"
    assert needed in ward.plan()
    assert ward.history()[:2] == LISTING_3[:2]
    ward.look()
    assert ward.label() == "mission_1_2", "once is enough"
    assert [view.recoveries for view in ward.coordinator.manager.views()] == [0]
    assert [view.revisions for view in ward.coordinator.manager.views()] == [1]


def test_reports_of_both_partners_do_not_skip_actions_before_a_repetition():
    ward = started(proactive=True)
    ward.do(2)
    ward.room(door_open=True)
    ward.agent(SPOT, place=ROOM, battery=0.1)
    ward.look()
    ward.look()
    come_back = [("a_charge", SPOT), LISTING_3[0], *LISTING_3[2:]]
    assert ward.plan() == [*LISTING_3[2:4], *come_back], "it meets the nurse once more when it has charged"
    ward.do(2)
    ward.send(NURSE, Report("success", "a_authenticate_nurse", (SPOT, NURSE)), mission=ward.label())
    assert ward.plan() == come_back
    ward.do(4)
    ward.send(NURSE, Report("success", "a_authenticate_nurse", (SPOT, NURSE)), mission=ward.label())
    assert ward.plan() == LISTING_3[4:]


def test_effect_before_its_report_is_no_reason_for_revision():
    ward = started(proactive=True)
    ward.room(door_open=True)
    ward.agent(SPOT, place=ROOM, battery=0.1)
    ward.look()
    ward.do(2)
    ward.agent(SPOT, battery=1.0)
    ward.look()
    ward.look()
    assert ward.label() == "mission_1_1"


def test_reason_for_revision_must_last_a_tenth_of_a_second():
    ward = started(proactive=True)
    ward.agent(UVD, battery=0.1)
    for wait in (0.1, 0.04, 0.04):
        ward.look(wait)
        assert ward.label() == "mission_1_1"
    ward.look(0.04)
    assert ward.label() == "mission_1_2"


def test_plan_with_unnecessary_actions_is_kept():
    ward = started(proactive=True)
    ward.agent(UVD, battery=0.1)
    ward.look()
    ward.look()
    assert ("a_charge", UVD) in ward.plan()
    ward.agent(UVD, battery=0.3)
    ward.look()
    ward.look()
    assert ward.label() == "mission_1_2"


def test_reactive_coordinator_keeps_the_plan():
    ward = started()
    ward.room(cleaned=False)
    ward.look()
    assert ward.label() == "mission_1_1"
