from __future__ import annotations

import logging
from collections.abc import Mapping

import msgspec
import pytest

from socialbot.agents.hospital.coordinator import Coordinator
from socialbot.agents.hospital.messages import (
    COORDINATOR,
    EVERYBODY,
    AclMessage,
    Belief,
    End,
    Finished,
    InitialTrigger,
    Performative,
    Plan,
    Problem,
    Ready,
    Refusal,
    Register,
    Report,
    Start,
    Stop,
)
from socialbot.agents.hospital.missions import Conduct, Memory, by_number
from socialbot.agents.hospital.ward_messages import (
    AWAY,
    CLOSED_DOOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    AgentState,
    RoomState,
    WardState,
)
from socialbot.clock import SECOND

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)

CAPABLE = {
    "spotrobot": ("a_navigate_to", "a_open_door", "a_patrol_room", "a_charge"),
    "uvdrobot": ("a_navigate_to", "a_disinfect_room", "a_charge"),
    "nurse_disinfected": ("a_authenticate_nurse", "a_authorize_patrol", "a_adapt_room"),
}
SPOT, UVD, NURSE, ROOM = "spotrobot1", "uvdrobot1", "nurse_disinfected1", "room1"
LISTING_3 = [
    ("a_navigate_to", SPOT, ROOM),
    ("a_open_door", SPOT, ROOM),
    ("a_approach_nurse", SPOT, NURSE),
    ("a_authenticate_nurse", SPOT, NURSE),
    ("a_authorize_patrol", SPOT, NURSE),
    ("a_patrol_room", SPOT, ROOM),
    ("a_authorize_disinfect", UVD, SPOT),
    ("a_navigate_to", UVD, ROOM),
    ("a_disinfect_room", UVD, ROOM),
]
LISTING_4 = [
    *LISTING_3[:6],
    ("a_adapt_room", NURSE, ROOM),
    ("a_approach_nurse", SPOT, NURSE),
    ("a_authenticate_nurse", SPOT, NURSE),
    ("a_authorize_patrol", SPOT, NURSE),
    ("a_patrol_room", SPOT, ROOM),
    *LISTING_3[6:],
]


class Ward:
    """A coordinator, a ward that the test changes, and what was said."""

    def __init__(self, rooms: int = 1, spots: int = 1, uvds: int = 1, memory: Memory | None = None, **conduct) -> None:
        self.now = 0
        self.numbers = {"spotrobot": spots, "uvdrobot": uvds, "nurse_disinfected": rooms}
        self.rooms = {
            f"room{n}": RoomState(name=f"room{n}", door_open=False, cleaned=True, disinfected=True)
            for n in range(1, rooms + 1)
        }
        self.agents = {
            f"{kind}{n}": AgentState(
                name=f"{kind}{n}", kind=kind, home=f"room{n}" if "nurse" in kind else "room0",
                place=f"room{n}" if "nurse" in kind else "room0", inside=True, x=0.0, y=0.0,
            )
            for kind, count in self.numbers.items()
            for n in range(1, count + 1)
        }  # fmt: skip
        self.said: list[tuple[str, str, object, str]] = []
        self.coordinator = self.directing(memory, **conduct)

    def directing(self, memory: Memory | None = None, **conduct) -> Coordinator:
        def say(receiver, performative, content, mission, in_reply_to):
            self.said.append((receiver, performative, content, mission))

        return Coordinator(say, Conduct(**{"proactive": False, **conduct}), memory)

    def say(
        self, sender: str, content, *, mission: str = "", performative: Performative = "inform", receiver=COORDINATOR
    ) -> None:
        message = AclMessage(
            stamp=self.now, id="x", sender=sender, receiver=receiver, performative=performative, content=content,
            mission=mission,
        )  # fmt: skip
        self.coordinator.hear(message, self.now)

    def register(self, *names: str) -> None:
        for name in names or self.agents:
            kind = by_number(name)[0]
            self.say(name, Register(kind, CAPABLE[kind]), performative="request")

    def look(self, after_s: float = 0.2) -> None:
        self.now += round(after_s * SECOND)
        state = WardState(stamp=self.now, rooms=tuple(self.rooms.values()), agents=tuple(self.agents.values()))
        self.coordinator.observe(state, self.now)

    def room(self, name: str = ROOM, **changes) -> None:
        self.rooms[name] = msgspec.structs.replace(self.rooms[name], **changes)

    def agent(self, name: str, **changes) -> None:
        self.agents[name] = msgspec.structs.replace(self.agents[name], **changes)

    def infect(self, *names: str) -> None:
        for name in names or (ROOM,):
            self.room(name, disinfected=False)
        self.look()

    def plan(self, mission: int = 1) -> list[tuple[str, ...]]:
        """What is left of the plan of a mission."""
        course = self.coordinator.courses[mission]
        return [node.item for node in course.agenda[course.position :]]

    def label(self, mission: int = 1) -> str:
        return self.coordinator.memory.missions[mission].label

    def do(self, count: int, mission: int = 1) -> None:
        """Has the next actions reported as done."""
        for action, *args in self.plan(mission)[:count]:
            self.say(args[0], Report("success", action, tuple(args)), mission=self.label(mission))

    def fail(self, kind: str, mission: int = 1) -> None:
        action, *args = self.plan(mission)[0]
        self.say(args[0], Problem(kind, tuple(args), action), mission=self.label(mission))

    def finish(self, mission: int = 1) -> None:
        for name in list(self.coordinator.memory.missions[mission].active):
            self.say(name, Finished(), mission=self.label(mission), performative="request")

    def contents(self, kind: type, receiver: str | None = None) -> list:
        return [what for to, _, what, _ in self.said if isinstance(what, kind) and receiver in (None, to)]

    def statuses(self) -> dict[int, str]:
        return {mission.id: mission.status for mission in self.coordinator.views()}

    def history(self) -> list[tuple[str, ...]]:
        return [(each.action, *each.args) for each in next(self.coordinator.views()).actions]

    def working(self) -> Mapping[str, int]:
        return {name: member.mission for name, member in self.coordinator.memory.members.items() if member.mission}


def started(**kwargs) -> Ward:
    ward = Ward(**kwargs)
    ward.register()
    ward.infect()
    return ward


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
    ward.say("helper1", Register("uvdrobot", ("a_navigate_to",)), performative="request")
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
    ward.say(NURSE, Finished(), mission="mission_1_1", performative="request")
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


# After a problem


def test_a_repair_is_listing_4():
    ward = started(policy="repair")
    ward.do(5)
    ward.agent(SPOT, place=ROOM)
    ward.look()
    ward.fail(DIRTY_ROOM)
    assert ward.history() == LISTING_4
    assert [each.status for each in next(ward.coordinator.views()).actions] == (
        ["done"] * 5 + ["failed"] + ["planned"] * 8
    )
    ward.do(8)
    assert {each.status for each in next(ward.coordinator.views()).actions[6:]} == {"done"}


def test_a_full_replan_goes_to_the_nurse_again():
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


def test_by_itself_it_repairs_plans_of_which_few_actions_are_joint():
    ward = started(policy="auto")
    ward.do(5)
    ward.fail(DIRTY_ROOM)
    assert ward.plan()[0] == ("a_adapt_room", NURSE, ROOM)


def test_without_recovery_the_mission_has_failed_and_the_team_is_free():
    ward = started(policy="none")
    ward.do(5)
    ward.fail(DIRTY_ROOM)
    assert ward.statuses() == {1: "failed"}
    assert next(ward.coordinator.views()).actions[-1].status == "failed"
    assert ward.working() == {}
    assert {to for to, _, what, _ in ward.said if isinstance(what, End)} == {SPOT, UVD, NURSE}
    ward.look()
    assert ward.statuses() == {1: "failed"}, "it is not begun anew"


def test_who_has_finished_is_called_again_and_a_slice_that_is_empty_is_taken_back():
    ward = started(policy="repair")
    ward.do(5)
    ward.say(NURSE, Finished(), mission="mission_1_1", performative="request")
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
def test_each_kind_of_problem_has_a_way_out(done, kind, first):
    ward = started()
    ward.do(done)
    ward.fail(kind)
    assert ward.plan()[: len(first)] == first


def test_a_door_that_a_robot_without_an_arm_meets_is_opened_by_the_other():
    ward = started(policy="repair")
    ward.do(7)
    ward.fail(CLOSED_DOOR)
    assert ward.plan()[:2] == LISTING_3[:2]


def test_what_fails_once_more_after_a_repair_is_planned_anew():
    ward = started(policy="repair")
    ward.do(5)
    ward.agent(SPOT, place=ROOM)
    ward.look()
    for _ in range(2):
        ward.do(4 if ward.label() == "mission_1_2" else 0)
        ward.fail(DIRTY_ROOM)
    assert ward.label() == "mission_1_3"
    assert ward.plan()[0] == LISTING_3[0]


def test_a_mission_in_which_the_same_fails_again_and_again_rests_and_its_team_is_free():
    ward = started(rest_s=5.0)
    for _ in range(4):
        ward.fail("it is stuck")
    assert ward.statuses() == {1: "waiting"}
    assert ward.working() == {}
    ward.look(4.9)
    assert ward.statuses() == {1: "waiting"}
    ward.look(0.2)
    assert ward.statuses() == {1: "running"}


def test_while_the_nurse_is_away_the_robots_do_something_else():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.do(2)
    ward.agent(NURSE, place=AWAY)
    ward.look()
    ward.fail(NURSE_ABSENT)
    assert ward.statuses() == {1: "waiting", 2: "running"}


def test_without_news_it_plans_anew():
    ward = started(patience_s=10.0)
    ward.do(3)
    ward.look(9.9)
    assert ward.label() == "mission_1_1"
    ward.look(0.2)
    assert ward.label() == "mission_1_2"


def test_a_robot_that_begins_anew_gets_a_new_plan():
    ward = started()
    ward.do(3)
    ward.register(SPOT)
    assert ward.label() == "mission_1_2"


def test_news_of_plans_that_are_no_longer_so_are_of_no_account():
    ward = started()
    ward.fail(DIRTY_ROOM)
    before = ward.plan()
    ward.say(SPOT, Problem(DIRTY_ROOM, (SPOT, ROOM), "a_patrol_room"), mission="mission_1_1")
    ward.say(SPOT, Report("success", *LISTING_3[0][:1], LISTING_3[0][1:]), mission="mission_1_1")
    assert ward.plan() == before
    assert ward.label() == "mission_1_2"


# Before a problem


def test_a_proactive_one_plans_for_the_room_as_it_is():
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
def test_a_proactive_one_revises_the_plan_before_it_meets_the_problem(change, needed):
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
    assert [view.recoveries for view in ward.coordinator.views()] == [0]
    assert [view.revisions for view in ward.coordinator.views()] == [1]


def test_that_both_tell_of_a_joint_action_does_not_leave_out_what_comes_before_the_next_one_like_it():
    ward = started(proactive=True)
    ward.do(2)
    ward.room(door_open=True)
    ward.agent(SPOT, place=ROOM, battery=0.1)
    ward.look()
    ward.look()
    come_back = [("a_charge", SPOT), LISTING_3[0], *LISTING_3[2:]]
    assert ward.plan() == [*LISTING_3[2:4], *come_back], "it meets the nurse once more when it has charged"
    ward.do(2)
    ward.say(NURSE, Report("success", "a_authenticate_nurse", (SPOT, NURSE)), mission=ward.label())
    assert ward.plan() == come_back
    ward.do(4)
    ward.say(NURSE, Report("success", "a_authenticate_nurse", (SPOT, NURSE)), mission=ward.label())
    assert ward.plan() == LISTING_3[4:]


def test_what_shows_before_its_report_comes_is_no_reason_to_revise():
    ward = started(proactive=True)
    ward.room(door_open=True)
    ward.agent(SPOT, place=ROOM, battery=0.1)
    ward.look()
    ward.do(2)
    ward.agent(SPOT, battery=1.0)
    ward.look()
    ward.look()
    assert ward.label() == "mission_1_1"


def test_a_reason_to_revise_has_to_show_for_a_tenth_of_a_second():
    ward = started(proactive=True)
    ward.agent(UVD, battery=0.1)
    for wait in (0.1, 0.04, 0.04):
        ward.look(wait)
        assert ward.label() == "mission_1_1"
    ward.look(0.04)
    assert ward.label() == "mission_1_2"


def test_a_plan_that_does_more_than_it_has_to_may_stay():
    ward = started(proactive=True)
    ward.agent(UVD, battery=0.1)
    ward.look()
    ward.look()
    assert ("a_charge", UVD) in ward.plan()
    ward.agent(UVD, battery=0.3)
    ward.look()
    ward.look()
    assert ward.label() == "mission_1_2"


def test_one_that_is_not_leaves_the_plan_as_it_is():
    ward = started()
    ward.room(cleaned=False)
    ward.look()
    assert ward.label() == "mission_1_1"


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
    ward.say("desk", InitialTrigger("urgent", ("room2",)), performative="request")
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
    ward.say("desk", InitialTrigger("urgent", ("room3",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting", 3: "running"}


def test_nobody_yields_if_that_does_not_help():
    ward = Ward(rooms=2)
    ward.register(SPOT, UVD, NURSE)
    ward.infect("room1")
    ward.say("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "running", 2: "waiting"}


def test_a_mission_becomes_urgent_when_somebody_asks_for_that():
    ward = Ward(rooms=2)
    ward.register()
    ward.infect("room1", "room2")
    ward.say("desk", InitialTrigger("urgent", ("room2",)), performative="request")
    assert ward.statuses() == {1: "waiting", 2: "running"}


@pytest.mark.parametrize(
    "trigger",
    [InitialTrigger("tea", (ROOM,)), InitialTrigger("disinfect"), InitialTrigger("urgent", ("attic",))],
)
def test_missions_that_cannot_be_are_refused(trigger):
    ward = Ward()
    ward.look()
    ward.say("desk", trigger, performative="request")
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]


def test_a_message_to_somebody_who_is_not_known_is_refused_and_so_is_what_makes_no_sense():
    ward = Ward()
    ward.say(SPOT, Ready("a_authenticate_nurse"), receiver="nurse7", performative="query")
    ward.say(SPOT, Ready("a_authenticate_nurse"), performative="query")
    ward.say(SPOT, Refusal("no"), receiver="nurse7", performative="refuse")
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
    ward.say(SPOT, content, performative=performative, mission=ward.label())
    assert [type(what) for *_, what, _ in ward.said] == [Refusal]
    assert msgspec.json.encode(ward.coordinator.memory) == before


# After an end


def test_what_it_remembers_lets_another_one_go_on():
    ward = started()
    ward.do(4)
    kept = msgspec.json.decode(msgspec.json.encode(ward.coordinator.memory), type=Memory)
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
    kept = msgspec.json.decode(msgspec.json.encode(ward.coordinator.memory), type=Memory)
    ward.coordinator = ward.directing(kept)
    ward.room(disinfected=True)
    ward.look()
    assert ward.statuses() == {1: "finished"}
    assert ward.working() == {}
