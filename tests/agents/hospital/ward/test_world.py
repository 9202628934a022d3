from __future__ import annotations

import pytest

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.ward._world import JOINT_ACTIONS, PATIENCE_S, WardWorld
from socialbot.agents.hospital.ward.messages import AWAY, CORRIDOR, AgentState
from socialbot.agents.hospital.ward.ward import (
    CLINIC,
    INSTANT,
    PAPER,
    ActionDurations,
    Ward,
    large_ward,
    paper_ward,
)
from socialbot.agents.teams.messages import ActionResult
from socialbot.core.clock import SECOND
from tests.agents.hospital.listings import LISTING_3, LISTING_4, NURSE, ROOM, SPOT, UVD


class Story:
    """A world with a sequence of commands."""

    def __init__(
        self,
        *faults: WorldFault,
        ward: Ward | None = None,
        rate: float = 0.0,
        durations: ActionDurations = PAPER,
        **more,
    ) -> None:
        self.world = WardWorld(ward or paper_ward(), rate=rate, durations=durations, faults=faults, **more)
        self.results: dict[str, ActionResult] = {}
        self.count = 0
        self.until(1.0)

    def until(self, second: float) -> None:
        self.world.advance(max(self.world.now, round(second * SECOND)))
        self.take()

    def take(self) -> None:
        for result in self.world.take_results():
            assert result.id not in self.results, "a command has one result"
            self.results[result.id] = result

    def begin(self, action: str, *args: str, robot: str = "") -> str:
        self.count += 1
        self.world.command(f"c{self.count}", robot or args[0], action, args)
        self.take()
        return f"c{self.count}"

    def do(self, action: str, *args: str) -> str:
        """Does an action, with its partner if it is a joint one, to its end; why it failed, if it did."""
        ids = [self.begin(action, *args, robot=who) for who in (args if action in JOINT_ACTIONS else args[:1])]
        while not all(id in self.results for id in ids):
            due = self.world.next_event
            assert due is not None
            self.until(due / SECOND)
        [reason] = {self.results[id].reason for id in ids}
        return reason

    def bring_in(self) -> None:
        for action in LISTING_3[:3]:
            assert self.do(*action) == ""

    def agent(self, name: str) -> AgentState:
        return self.world.agents[name].state(self.world.now)

    @property
    def seconds(self) -> float:
        return self.world.now / SECOND


def test_paper_mission_takes_published_time_and_disinfects_the_room():
    story = Story()
    assert not story.world.rooms[ROOM].disinfected
    assert [story.do(*action) for action in LISTING_3] == [""] * 9
    assert story.world.rooms[ROOM].disinfected
    assert story.seconds == pytest.approx(4.22, abs=0.005)


def test_dirty_room_fails_the_patrol_and_adds_little_time():
    story = Story(rate=100.0)
    reasons = [story.do(*action) for action in LISTING_4]
    assert reasons == [*[""] * 5, "dirty room", *[""] * 8]
    assert story.world.rooms[ROOM].disinfected
    assert story.seconds == pytest.approx(4.50, abs=0.005)


@pytest.mark.parametrize(("durations", "seconds"), [(INSTANT, 1.0), (CLINIC, 359.0)])
def test_other_durations_give_same_results_at_other_times(durations, seconds):
    story = Story(durations=durations)
    assert [story.do(*action) for action in LISTING_3] == [""] * 9
    assert story.seconds == pytest.approx(seconds)


def test_robot_waits_before_closed_door_and_enters_open_one():
    story = Story()
    story.do("a_navigate_to", SPOT, ROOM)
    spot = story.agent(SPOT)
    assert (spot.place, spot.inside) == (ROOM, False)
    assert story.do("a_approach_nurse", SPOT, NURSE) == "closed door"
    assert story.do("a_patrol_room", SPOT, ROOM) == "closed door"
    assert story.do("a_open_door", SPOT, ROOM) == ""
    assert story.do("a_approach_nurse", SPOT, NURSE) == ""
    assert story.agent(SPOT).inside


def test_the_state_follows_an_agent_on_its_way_and_after_it():
    story = Story()
    places = [story.world.state().agent(SPOT)]
    story.begin("a_navigate_to", SPOT, "room2")
    due = story.world.next_event
    assert due is not None
    way_s = (due - story.world.now) / SECOND
    for share in (0.25, 0.5, 1.0):
        story.until(1.0 + share * way_s)
        places.append(story.world.state().agent(SPOT))
    assert len({(place.x, place.y) for place in places if place is not None}) == len(places)
    assert places[-1] == story.agent(SPOT)


def test_closed_door_does_not_affect_agents_inside():
    story = Story()
    story.bring_in()
    story.world.change_room(ROOM, door_open=False)
    assert story.do("a_authenticate_nurse", SPOT, NURSE) == ""
    assert story.do("a_navigate_to", SPOT, "room2") == ""
    assert story.agent(SPOT).place == "room2"
    assert not story.world.rooms[ROOM].door_open


def test_door_that_closes_during_movement_stops_the_robot():
    story = Story(WorldFault(1.5, "closes", "room2"))
    assert story.do("a_navigate_to", SPOT, "room2") == ""
    assert story.agent(SPOT).inside
    story = Story(WorldFault(1.2, "closes", "room2"))
    assert story.do("a_navigate_to", SPOT, "room2") == ""
    assert not story.agent(SPOT).inside


def test_action_in_a_room_requires_presence():
    story = Story()
    assert story.do("a_patrol_room", SPOT, ROOM) == "spotrobot1 is not at room1"
    assert story.do("a_open_door", SPOT, ROOM) == "spotrobot1 is not at room1"
    assert story.do("a_approach_nurse", SPOT, NURSE) == "spotrobot1 is not at room1"
    assert story.do("a_authenticate_nurse", SPOT, NURSE) == "spotrobot1 is not at room1"
    assert story.do("a_disinfect_room", UVD, ROOM) == "uvdrobot1 is not at room1"
    assert story.do("a_adapt_room", NURSE, "room2") == "nurse_disinfected1 is not at room2"


def test_joint_action_starts_with_second_command_and_ends_for_both():
    story = Story()
    story.bring_in()
    first = story.begin("a_authenticate_nurse", SPOT, NURSE, robot=NURSE)
    story.until(story.seconds + 2.0)
    assert first not in story.results
    second = story.begin("a_authenticate_nurse", SPOT, NURSE, robot=SPOT)
    story.until(story.seconds + 1.0)
    waited, came = story.results[first], story.results[second]
    assert waited.outcome == came.outcome == "success"
    assert waited.stamp == came.stamp
    assert waited.duration_s == pytest.approx(2.04)
    assert came.duration_s == pytest.approx(0.04)


def test_wait_for_partner_times_out():
    story = Story()
    story.bring_in()
    only = story.begin("a_authorize_patrol", SPOT, NURSE)
    story.until(story.seconds + PATIENCE_S - 0.1)
    assert only not in story.results
    story.until(story.seconds + 0.2)
    assert story.results[only].reason == "partner absent"
    assert story.agent(SPOT).busy == ""


def test_different_joint_action_does_not_match_waiting_partner():
    story = Story()
    story.bring_in()
    story.begin("a_authenticate_nurse", SPOT, NURSE, robot=SPOT)
    story.begin("a_authorize_patrol", SPOT, NURSE, robot=NURSE)
    story.until(story.seconds + 20.0)
    assert [result.reason for result in story.results.values()][-2:] == ["partner absent", "partner absent"]


def test_busy_agent_refuses_commands():
    story = Story()
    story.begin("a_navigate_to", SPOT, ROOM)
    assert story.results[story.begin("a_charge", SPOT)].reason == (
        "spotrobot1 is busy with a_navigate_to(spotrobot1, room1)"
    )


@pytest.mark.parametrize(
    ("robot", "action", "args", "reason"),
    [
        ("robot9", "a_charge", ("robot9",), "there is no 'robot9'"),
        (SPOT, "a_fly", (SPOT,), "there is no action 'a_fly'"),
        (SPOT, "a_charge", (), "a_charge takes robot, not nothing"),
        (SPOT, "a_navigate_to", (SPOT, "moon"), "a_navigate_to takes agent, room, not spotrobot1, moon"),
        (UVD, "a_patrol_room", (UVD, ROOM), "a_patrol_room takes spotrobot, room, not uvdrobot1, room1"),
        (NURSE, "a_charge", (NURSE,), "a_charge takes robot, not nurse_disinfected1"),
        (UVD, "a_patrol_room", (SPOT, ROOM), "uvdrobot1 cannot execute an action of spotrobot1"),
        (UVD, "a_authenticate_nurse", (SPOT, NURSE), "uvdrobot1 cannot execute an action of spotrobot1"),
    ],
)
def test_invalid_command_fails_with_reason_and_no_effect(robot, action, args, reason):
    story = Story()
    before = story.world.state()
    story.world.command("c", robot, action, args)
    [result] = story.world.take_results()
    assert (result.id, result.outcome, result.reason, result.duration_s) == ("c", "failure", reason, 0.0)
    assert story.world.state() == before


def test_low_battery_stops_powered_actions_until_charged():
    story = Story(WorldFault(1.4, "drains", SPOT))
    assert story.do("a_navigate_to", SPOT, ROOM) == "low battery"
    assert story.seconds == pytest.approx(1.4)
    spot = story.agent(SPOT)
    assert spot.place == CORRIDOR
    assert spot.low_battery
    assert story.do("a_navigate_to", SPOT, ROOM) == "low battery"
    assert story.do("a_charge", SPOT) == ""
    assert story.agent(SPOT).battery == 1.0
    assert story.agent(SPOT).place == "room4"
    assert story.do("a_navigate_to", SPOT, ROOM) == ""


def test_cancelled_charge_keeps_its_steps():
    story = Story(WorldFault(1.0, "drains", UVD))
    charging = story.begin("a_charge", UVD)
    story.until(1.0 + 3.0 * 0.45)
    story.world.cancel(charging)
    assert story.agent(UVD).battery == pytest.approx(0.5)
    assert story.do("a_charge", UVD) == ""
    assert story.seconds == pytest.approx(2.35 + 1.5)
    assert story.agent(UVD).battery == 1.0


def test_movement_and_work_discharge_the_battery():
    story = Story()
    story.do("a_navigate_to", SPOT, ROOM)
    assert story.agent(SPOT).battery == pytest.approx(1.0 - 0.0078)
    story.do("a_open_door", SPOT, ROOM)
    story.do("a_navigate_to", UVD, ROOM)
    patrols = 0
    while not (reason := story.do("a_disinfect_room", UVD, ROOM)):
        patrols += 1
    assert reason == "low battery"
    assert patrols == 20


def test_person_in_room_fails_patrol_and_stops_light():
    story = Story(WorldFault(2.0, "enters", ROOM, 3.0), WorldFault(20.2, "enters", ROOM, 3.0))
    story.bring_in()
    assert story.world.rooms[ROOM].people == ("person1",)
    assert story.do("a_patrol_room", SPOT, ROOM) == "person in the room"
    story.until(5.5)
    assert story.world.rooms[ROOM].people == ()
    assert story.do("a_patrol_room", SPOT, ROOM) == ""
    story.do("a_navigate_to", UVD, ROOM)
    story.until(20.0)
    assert story.do("a_disinfect_room", UVD, ROOM) == "person in the room"
    assert story.seconds == pytest.approx(20.2)
    assert story.do("a_adapt_room", NURSE, ROOM) == ""
    assert story.world.rooms[ROOM].ready
    assert story.do("a_disinfect_room", UVD, ROOM) == ""


def test_absent_nurse_fails_actions_until_her_return():
    story = Story(WorldFault(2.5, "leaves", NURSE, 4.0))
    story.bring_in()
    waits = story.begin("a_authenticate_nurse", SPOT, NURSE, robot=NURSE)
    story.until(2.5)
    assert story.results[waits].reason == "nurse absent"
    assert story.agent(NURSE).place == AWAY
    assert story.results[story.begin("a_authenticate_nurse", SPOT, NURSE, robot=SPOT)].reason == "nurse absent"
    assert story.do("a_approach_nurse", SPOT, NURSE) == "nurse absent"
    assert story.do("a_adapt_room", NURSE, ROOM) == "nurse absent"
    story.until(6.6)
    assert story.agent(NURSE).place == ROOM
    assert story.do("a_authenticate_nurse", SPOT, NURSE) == ""


def test_absent_nurse_comes_on_command():
    story = Story(WorldFault(1.0, "leaves", NURSE, 100.0))
    assert story.do("a_navigate_to", SPOT, ROOM) == ""
    assert story.do("a_open_door", SPOT, ROOM) == ""
    assert story.do("a_navigate_to", NURSE, ROOM) == ""
    nurse = story.agent(NURSE)
    assert (nurse.place, nurse.inside) == (ROOM, True)
    story.until(200.0)
    assert story.agent(NURSE) == nurse


def test_nurse_can_report_infection():
    story = Story()
    assert story.do("a_infected_room", NURSE, "room2") == ""
    assert story.world.rooms["room2"].infected
    assert story.seconds == 2.0


def test_cancelled_movement_stops_and_resumes_there():
    story = Story()
    way = story.begin("a_navigate_to", SPOT, ROOM)
    story.until(1.5)
    story.world.cancel(way)
    story.take()
    assert story.results[way].reason == "cancelled"
    spot = story.agent(SPOT)
    assert spot.place == CORRIDOR
    story.until(2.0)
    assert story.agent(SPOT) == spot
    story.world.cancel(way)
    story.world.cancel("nothing")
    assert story.do("a_navigate_to", SPOT, ROOM) == ""
    assert story.seconds == pytest.approx(2.28), "what was left of 0.78 s"


def test_movement_cancelled_inside_room_ends_in_room():
    story = Story()
    way = story.begin("a_navigate_to", SPOT, ROOM)
    story.until(1.1)
    story.world.cancel(way)
    spot = story.agent(SPOT)
    assert (spot.place, spot.inside) == ("room4", True)
    assert story.do("a_navigate_to", SPOT, "room4") == ""


def test_cancel_of_one_partner_ends_started_joint_action_for_both():
    story = Story()
    story.bring_in()
    first = story.begin("a_authenticate_nurse", SPOT, NURSE, robot=NURSE)
    story.world.cancel(first)
    assert story.do("a_authenticate_nurse", SPOT, NURSE) == ""
    ids = [story.begin("a_authorize_patrol", SPOT, NURSE, robot=who) for who in (SPOT, NURSE)]
    story.world.cancel(ids[0])
    story.take()
    assert {story.results[id].reason for id in ids} == {"cancelled"}


def test_stalled_robot_continues_with_delay():
    story = Story(WorldFault(1.3, "stalls", SPOT, 5.0))
    story.begin("a_navigate_to", SPOT, ROOM)
    story.until(1.3)
    at = story.agent(SPOT)
    story.until(6.2)
    assert story.agent(SPOT) == at
    story.until(6.77)
    assert story.agent(SPOT).busy
    story.until(6.79)
    spot = story.agent(SPOT)
    assert (spot.busy, spot.place) == ("", ROOM)
    assert spot.battery == pytest.approx(1.0 - 0.0078, abs=1e-4)


def test_noise_stays_within_its_bound():
    times = set()
    for seed in range(100):
        story = Story(noise=0.1, seed=seed)
        for action in LISTING_3:
            story.do(*action)
        assert 1.0 + 3.22 * 0.9 <= story.seconds <= 1.0 + 3.22 * 1.1
        times.add(story.world.now)
    assert len(times) > 90


def overcome(story: Story, spot: str, uvd: str, nurse: str) -> int:
    """Disinfect the room of a nurse despite problems; returns the number of problems."""
    room = story.world.ward.member_by_name[nurse].home
    mission = [
        tuple({SPOT: spot, UVD: uvd, NURSE: nurse, ROOM: room}.get(word, word) for word in step) for step in LISTING_3
    ]
    for tries in range(30):
        for action in mission:
            match story.do(*action):
                case "":
                    continue
                case "low battery":
                    story.do("a_charge", action[1])
                case "dirty room" | "person in the room":
                    story.do("a_adapt_room", nurse, room)
                case "nurse absent":
                    story.do("a_navigate_to", nurse, room)
                case "closed door":
                    story.do("a_open_door", uvd, room)
            break
        else:
            return tries
    return 30


def test_every_problem_can_be_solved():
    ward, met = large_ward(12, 2, 2), 0
    for seed in range(20):
        story = Story(ward=ward, rate=100.0, seed=seed, noise=0.1)
        for time_s, room in ward.infections:
            story.until(time_s)
            nurse = next(member.name for member in ward.members if (member.home, member.kind[:5]) == (room, "nurse"))
            team = "12"[int(time_s) % 2]
            tries = overcome(story, f"spotrobot{team}", f"uvdrobot{team}", nurse)
            assert tries < 10
            met += tries > 0
        assert all(room.disinfected for room in story.world.rooms.values())
    assert met > 60, "of 240 missions; many a problem passes by unnoticed"


def test_time_starts_at_start_and_never_decreases():
    start = 1_700_000_000 * SECOND
    world = WardWorld(paper_ward(), start=start)
    world.advance(0)
    assert world.now == start
    assert not world.rooms[ROOM].infected
    world.advance(start + SECOND)
    assert world.rooms[ROOM].infected


def test_robot_charges_in_the_nearest_dock():
    story = Story(ward=large_ward(1001, 1, 1))
    assert story.world.ward.docks == ("dock", "dock2")
    assert story.agent(SPOT).place == "dock"
    assert story.do("a_charge", SPOT) == ""
    assert story.agent(SPOT).place == "dock"
    assert story.do("a_navigate_to", SPOT, "room1001") == ""
    assert story.do("a_charge", SPOT) == ""
    assert (story.agent(SPOT).place, story.agent(SPOT).inside, story.agent(SPOT).battery) == ("dock2", True, 1.0)
