from __future__ import annotations

import msgspec
import pytest

from socialbot.agents.hospital.ward.messages import AWAY, DIRTY_ROOM
from socialbot.agents.teams.messages import (
    EVERYBODY,
    Belief,
    Finished,
    InitialTrigger,
    Plan,
    Problem,
    Ready,
    Refusal,
    Register,
    Start,
    Stop,
)
from socialbot.agents.teams.missions import CoordinatorMemory, by_number
from tests.agents.hospital.directed import Ward, started
from tests.agents.hospital.listings import LISTING_3, NURSE, ROOM, SPOT, UVD


def test_names_sort_by_kind_and_number():
    assert sorted(["spotrobot10", "nurse2", "spotrobot9", "boss"], key=by_number) == [
        "boss", "nurse2", "spotrobot9", "spotrobot10",
    ]  # fmt: skip


def test_coordinator_requests_and_confirms_registrations():
    ward = Ward()
    ward.coordinator.begin()
    ward.register()
    assert ward.said[0] == (EVERYBODY, "query", Register(), "")
    assert [(to, act) for to, act, *_ in ward.said[1:]] == [(SPOT, "agree"), (UVD, "agree"), (NURSE, "agree")]


def test_infected_room_gets_team_plans_beliefs_and_start():
    ward = started()
    assert ward.plan() == LISTING_3
    sent = [(to, act, type(what)) for to, act, what, mission in ward.said if mission == "mission_1_1"]
    assert sent == [
        *((name, "inform", Plan) for name in (NURSE, SPOT, UVD)),
        *((name, "request", Start) for name in (NURSE, SPOT, UVD)),
        (SPOT, "inform", Belief),
    ]
    assert ward.contents(Start)[0].arguments == (NURSE, ROOM, SPOT, UVD)
    assert ward.contents(Belief) == [Belief(f"initial_trigger_a_navigate_to({SPOT}, {ROOM})")]
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}


def test_mission_waits_for_capable_team():
    ward = Ward()
    ward.register(SPOT, NURSE)
    ward.infect()
    assert ward.statuses() == {1: "waiting"}
    ward.send("helper1", Register("uvdrobot", ("a_navigate_to",)), performative="request")
    assert ward.statuses() == {1: "waiting"}
    ward.register(UVD)
    assert ward.statuses() == {1: "running"}


def test_team_has_nurse_of_room_and_charged_robots_first():
    ward = Ward(rooms=12, spots=12, uvds=2)
    ward.register()
    ward.agent("spotrobot1", battery=0.1)
    ward.infect("room11")
    assert ward.working() == {"nurse_disinfected11": 1, "spotrobot2": 1, "uvdrobot1": 1}


def test_charging_robot_is_assigned_last():
    ward = Ward(spots=2, uvds=3)
    ward.register()
    ward.agent(SPOT, battery=0.3, busy=f"a_charge({SPOT})")
    ward.agent(UVD, battery=0.1)
    ward.agent("uvdrobot2", battery=0.3, busy="a_charge(uvdrobot2)")
    ward.agent("uvdrobot3", place=AWAY)
    ward.infect()
    assert ward.working() == {NURSE: 1, "spotrobot2": 1, "uvdrobot2": 1}


def test_finished_agent_is_free_and_mission_ends_with_disinfected_room():
    ward = started()
    ward.do(9)
    ward.send(NURSE, Finished(), mission="mission_1_1", performative="request")
    assert ward.working() == {SPOT: 1, UVD: 1}
    ward.finish()
    assert ward.working() == {}
    assert ward.statuses() == {1: "running"}
    ward.room(disinfected=True)
    ward.look()
    assert ward.statuses() == {1: "finished"}
    assert ward.coordinator.memory.missions == {}


def test_room_infected_after_last_agent_gets_new_plan():
    ward = started()
    ward.do(9)
    ward.finish()
    ward.look()
    assert ward.label() == "mission_1_2"
    assert ward.statuses() == {1: "running"}


# Missions among each other


def test_second_room_waits_for_robots_of_first():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    assert ward.statuses() == {1: "running", 2: "waiting"}
    ward.do(9)
    ward.finish()
    assert ward.statuses() == {1: "running", 2: "running"}, "its team is free"


def test_urgent_mission_takes_robots_of_another():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1")
    ward.send("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "waiting", 2: "running"}
    assert {to for to, _, what, _ in ward.said if isinstance(what, Stop)} == {SPOT, UVD, NURSE}
    assert ward.working() == {"nurse_disinfected2": 2, SPOT: 2, UVD: 2}
    ward.room("room2", disinfected=False)
    ward.do(9, mission=2)
    ward.finish(2)
    assert ward.statuses()[1] == "running"


def test_latest_mission_yields_and_no_more_than_necessary():
    ward = Ward(rooms=3, spots=2, uvds=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.send("desk", InitialTrigger("urgent", ("room3",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting", 3: "running"}


def test_no_mission_yields_without_benefit():
    ward = Ward(rooms=2)
    ward.register(SPOT, UVD, NURSE)
    ward.infect("room1")
    ward.send("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting"}


def test_request_makes_mission_urgent():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.send("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "waiting", 2: "running"}


@pytest.mark.parametrize(
    "trigger",
    [InitialTrigger("tea", (ROOM,)), InitialTrigger("disinfect"), InitialTrigger("urgent", ("attic",))],
)
def test_impossible_missions_are_refused(trigger):
    ward = Ward()
    ward.look()
    ward.send("desk", trigger, performative="request")
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]


def test_unknown_receiver_and_invalid_content_are_refused():
    ward = Ward()
    ward.send(SPOT, Ready("a_authenticate_nurse"), receiver="nurse7", performative="query")
    ward.send(SPOT, Ready("a_authenticate_nurse"), performative="query")
    ward.send(SPOT, Refusal("no"), receiver="nurse7", performative="refuse")
    assert ward.said == [
        (SPOT, "refuse", Refusal("there is no nurse7"), ""),
        (SPOT, "refuse", Refusal("the coordinator does not handle Ready"), ""),
    ]


@pytest.mark.parametrize(
    ("content", "performative"),
    [
        (Register("uvdrobot"), "query"),
        (Problem(DIRTY_ROOM, (SPOT, ROOM), "a_patrol_room"), "request"),
        (InitialTrigger("urgent", (ROOM,)), "query"),
    ],
)
def test_wrong_performative_is_refused_without_effect(content, performative):
    ward = started()
    before = msgspec.json.encode(ward.coordinator.memory)
    ward.said.clear()
    ward.send(SPOT, content, performative=performative, mission=ward.label())
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]
    assert msgspec.json.encode(ward.coordinator.memory) == before


# After an end


def test_memory_lets_another_coordinator_continue():
    ward = started()
    ward.do(4)
    kept = msgspec.json.decode(msgspec.json.encode(ward.coordinator.memory), type=CoordinatorMemory)
    ward.coordinator = ward.directing(kept)
    ward.look()
    assert ward.label() == "mission_1_2"
    assert ward.working() == {SPOT: 1, UVD: 1, NURSE: 1}
    ward.do(9)
    ward.finish()
    ward.room(disinfected=True)
    ward.look()
    assert ward.statuses() == {1: "finished"}


def test_mission_done_during_restart_is_finished():
    ward = started()
    kept = msgspec.json.decode(msgspec.json.encode(ward.coordinator.memory), type=CoordinatorMemory)
    ward.coordinator = ward.directing(kept)
    ward.room(disinfected=True)
    ward.look()
    assert ward.statuses() == {1: "finished"}
    assert ward.working() == {}
