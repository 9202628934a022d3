from __future__ import annotations

import msgspec
import pytest

from socialbot.agents.hospital.messages import (
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
from socialbot.agents.hospital.missions import CoordinatorMemory, by_number
from socialbot.agents.hospital.ward.messages import AWAY, DIRTY_ROOM
from tests.agents.hospital.directed import Ward, started
from tests.agents.hospital.listings import LISTING_3, NURSE, ROOM, SPOT, UVD


def test_names_are_sorted_by_their_kind_and_number():
    assert sorted(["spotrobot10", "nurse2", "spotrobot9", "boss"], key=by_number) == [
        "boss", "nurse2", "spotrobot9", "spotrobot10",
    ]  # fmt: skip


def test_it_asks_everybody_to_register_and_agrees_with_who_does():
    ward = Ward()
    ward.coordinator.begin()
    ward.register()
    assert ward.said[0] == (EVERYBODY, "query", Register(), "")
    assert [(to, act) for to, act, *_ in ward.said[1:]] == [(SPOT, "agree"), (UVD, "agree"), (NURSE, "agree")]


def test_a_room_to_be_disinfected_gets_a_team_plans_beliefs_and_a_start():
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


def test_a_mission_waits_until_there_is_a_team_that_can_do_it():
    ward = Ward()
    ward.register(SPOT, NURSE)
    ward.infect()
    assert ward.statuses() == {1: "waiting"}
    ward.send("helper1", Register("uvdrobot", ("a_navigate_to",)), performative="request")
    assert ward.statuses() == {1: "waiting"}
    ward.register(UVD)
    assert ward.statuses() == {1: "running"}


def test_the_nurse_is_the_one_of_the_room_and_robots_with_full_batteries_come_first():
    ward = Ward(rooms=12, spots=12, uvds=2)
    ward.register()
    ward.agent("spotrobot1", battery=0.1)
    ward.infect("room11")
    assert ward.working() == {"nurse_disinfected11": 1, "spotrobot2": 1, "uvdrobot1": 1}


def test_a_robot_that_charges_is_left_to_it_as_long_as_there_is_another_one():
    ward = Ward(spots=2, uvds=3)
    ward.register()
    ward.agent(SPOT, battery=0.3, busy=f"a_charge({SPOT})")
    ward.agent(UVD, battery=0.1)
    ward.agent("uvdrobot2", battery=0.3, busy="a_charge(uvdrobot2)")
    ward.agent("uvdrobot3", place=AWAY)
    ward.infect()
    assert ward.working() == {NURSE: 1, "spotrobot2": 1, "uvdrobot2": 1}


def test_who_has_finished_is_free_and_the_mission_is_when_all_have_and_the_room_is():
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


def test_a_room_that_is_still_infected_when_all_have_finished_is_planned_anew():
    ward = started()
    ward.do(9)
    ward.finish()
    ward.look()
    assert ward.label() == "mission_1_2"
    assert ward.statuses() == {1: "running"}


# Missions among each other


def test_the_next_room_waits_for_the_robots_of_the_first():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    assert ward.statuses() == {1: "running", 2: "waiting"}
    ward.do(9)
    ward.finish()
    assert ward.statuses() == {1: "running", 2: "running"}, "its team is free"


def test_an_urgent_mission_takes_the_robots_of_another_one():
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


def test_of_several_the_last_one_yields_and_only_as_many_as_it_takes():
    ward = Ward(rooms=3, spots=2, uvds=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.send("desk", InitialTrigger("urgent", ("room3",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting", 3: "running"}


def test_nobody_yields_if_that_does_not_help():
    ward = Ward(rooms=2)
    ward.register(SPOT, UVD, NURSE)
    ward.infect("room1")
    ward.send("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting"}


def test_a_mission_becomes_urgent_when_somebody_asks_for_that():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.send("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "waiting", 2: "running"}


@pytest.mark.parametrize(
    "trigger",
    [InitialTrigger("tea", (ROOM,)), InitialTrigger("disinfect"), InitialTrigger("urgent", ("attic",))],
)
def test_missions_that_cannot_be_are_refused(trigger):
    ward = Ward()
    ward.look()
    ward.send("desk", trigger, performative="request")
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]


def test_a_message_to_somebody_who_is_not_known_is_refused_and_so_is_what_makes_no_sense():
    ward = Ward()
    ward.send(SPOT, Ready("a_authenticate_nurse"), receiver="nurse7", performative="query")
    ward.send(SPOT, Ready("a_authenticate_nurse"), performative="query")
    ward.send(SPOT, Refusal("no"), receiver="nurse7", performative="refuse")
    assert ward.said == [
        (SPOT, "refuse", Refusal("there is no nurse7"), ""),
        (SPOT, "refuse", Refusal("a coordinator does nothing about Ready"), ""),
    ]


@pytest.mark.parametrize(
    ("content", "performative"),
    [
        (Register("uvdrobot"), "query"),
        (Problem(DIRTY_ROOM, (SPOT, ROOM), "a_patrol_room"), "request"),
        (InitialTrigger("urgent", (ROOM,)), "query"),
    ],
)
def test_what_is_said_otherwise_than_it_has_to_be_is_refused_and_changes_nothing(content, performative):
    ward = started()
    before = msgspec.json.encode(ward.coordinator.memory)
    ward.said.clear()
    ward.send(SPOT, content, performative=performative, mission=ward.label())
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]
    assert msgspec.json.encode(ward.coordinator.memory) == before


# After an end


def test_what_it_remembers_lets_another_one_go_on():
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


def test_a_mission_that_was_done_meanwhile_is_finished():
    ward = started()
    kept = msgspec.json.decode(msgspec.json.encode(ward.coordinator.memory), type=CoordinatorMemory)
    ward.coordinator = ward.directing(kept)
    ward.room(disinfected=True)
    ward.look()
    assert ward.statuses() == {1: "finished"}
    assert ward.working() == {}
