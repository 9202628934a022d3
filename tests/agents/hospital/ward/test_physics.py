"""The ward with physics: bodies drive along ways, doors turn, litter is in the way."""

from __future__ import annotations

import math
import sys

import pytest

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.demo import hospital, large_hospital
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import CORRIDOR
from socialbot.agents.hospital.ward.physics import DOOR_M, LITTER, PhysicalWard
from socialbot.agents.hospital.ward.ward import CLINIC, NURSE, ROOM_M, Position, paper_ward
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.graph.inline import InlineRunner
from tests.agents.hospital.listings import LISTING_3, LISTING_4, ROOM, SPOT, UVD
from tests.agents.hospital.watched import Watched

NURSE_1 = f"{NURSE}1"


def test_missing_package_is_named_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InstallationError) as caught:
        PhysicalWard(paper_ward())
    assert extra_command("sim") in str(caught.value)


def test_pace_without_ways_is_refused():
    with pytest.raises(ParameterError, match="robots cannot move at the pace 'instant'"):
        InlineRunner(hospital(world={"simulation": "physics", "pace": "instant"}))


class House:
    """The ward of the paper with physics, at the pace of a clinic."""

    def __init__(self, *faults: WorldFault, **more) -> None:
        pytest.importorskip("mujoco")
        self.world = PhysicalWard(paper_ward(), faults=faults, durations=CLINIC, **more)
        self.number = 0

    def tell(self, robot: str, action: str, *args: str) -> None:
        self.number += 1
        self.world.command(f"{self.number}", robot, action, (robot, *args))

    def do(self, robot: str, action: str, *args: str, limit_s: float = 60.0) -> tuple[str, float]:
        """Execute an action; returns why it failed, and its duration (s)."""
        begin = self.world.now
        self.tell(robot, action, *args)
        while not (results := self.world.take_results()):
            self.wait(0.1)
            assert self.world.now - begin < nanoseconds(limit_s)
        return results[0].reason, results[0].duration_s

    def wait(self, seconds: float) -> None:
        self.world.advance(self.world.now + nanoseconds(seconds))

    def at(self, name: str) -> Position:
        """Position of a body, with its lane."""
        return Position(*self.world.physics.position(name)[:2])

    def angle(self, room: str) -> float:
        return float(self.world.physics.data.joint(f"{room} door").qpos[0])

    def is_inside(self, body: str, room: str) -> bool:
        return self.world.ward.room_by_name[room].contains(self.at(body))


def test_robot_arrives_with_its_body_about_when_the_kinematic_one_does():
    house, kinematic = House(), WardWorld(paper_ward(), durations=CLINIC)
    reason, took_s = house.do(UVD, "a_navigate_to", "room2")
    kinematic.command("1", UVD, "a_navigate_to", (UVD, "room2"))
    kinematic.advance(nanoseconds(60.0))
    [plain] = kinematic.take_results()
    assert reason == plain.reason == ""
    assert plain.duration_s <= took_s < plain.duration_s + 0.5
    shown, expected = house.world.state().agent(UVD), kinematic.state().agent(UVD)
    assert shown is not None
    assert expected is not None
    assert math.dist((shown.x, shown.y), (expected.x, expected.y)) < 0.1
    assert house.is_inside(UVD, "room2")


def test_door_counts_as_open_when_its_leaf_has_turned():
    house = House()
    house.do(SPOT, "a_navigate_to", ROOM)
    assert house.angle(ROOM) == pytest.approx(0.0, abs=0.05)
    house.tell(SPOT, "a_open_door", ROOM)
    seen = set()
    while not house.world.take_results():
        house.wait(0.02)
        seen.add((house.angle(ROOM) > 1.1, house.world.rooms[ROOM].door_open))
    assert house.world.rooms[ROOM].door_open
    assert {(False, False), (True, True)} == seen


def test_leaf_that_a_body_blocks_keeps_the_door_open():
    house = House(WorldFault(15.0, "closes", "room2"))
    house.do(SPOT, "a_navigate_to", "room2")
    # The robot stands in the doorway when the door closes.
    at, door = house.world.ward.room_by_name["room4"].centre, house.world.ward.room_by_name["room2"].door
    house.world.agents[SPOT].position = Position(door.x, door.y)
    house.wait(10.0)
    assert house.angle("room2") > 0.3
    assert abs(house.at(SPOT).y - door.y) < DOOR_M
    house.world.agents[SPOT].position = at
    house.wait(5.0)
    assert house.angle("room2") == pytest.approx(0.0, abs=0.05)
    assert not house.world.rooms["room2"].door_open


def test_litter_lies_in_an_untidy_room_and_is_pushed_aside():
    house = House(WorldFault(0.0, "dirty", "room2"))
    house.wait(2.0)
    pieces = [f"room2 litter{number}" for number in range(len(LITTER))]
    assert all(house.is_inside(piece, "room2") for piece in pieces)
    before = [house.at(piece) for piece in pieces]
    house.do(SPOT, "a_navigate_to", "room2")
    # On its way to the back of the room it meets a piece.
    centre = house.world.ward.room_by_name["room2"].centre
    house.world.agents[SPOT].position = Position(centre.x + 0.5, centre.y - ROOM_M[1] / 4)
    house.wait(5.0)
    moved = max(math.dist(a, house.at(piece)) for a, piece in zip(before, pieces, strict=True))
    assert moved > 0.1
    house.world.change_room("room2", cleaned=True)
    house.wait(0.1)
    assert not any(house.is_inside(piece, "room2") for piece in pieces)


def test_people_enter_and_nurses_leave_with_their_bodies():
    house = House(WorldFault(1.0, "enters", "room2", 5.0), WorldFault(1.0, "leaves", NURSE_1, 5.0))
    assert house.is_inside(NURSE_1, ROOM)
    house.wait(2.0)
    assert house.is_inside("person1", "room2")
    assert not house.is_inside(NURSE_1, ROOM)
    house.wait(6.0)
    assert not house.is_inside("person1", "room2")
    assert house.is_inside(NURSE_1, ROOM)


def test_robot_does_not_pass_a_wall():
    house = House()
    # Without a way, straight to the next room.
    house.world.agents[UVD].position = house.world.ward.room_by_name["room3"].centre
    house.wait(5.0)
    assert house.is_inside(UVD, "room4")
    house.world.agents[UVD].position = house.world.agents[UVD].at(house.world.now)
    reason, _ = house.do(UVD, "a_navigate_to", "room3")
    assert reason == ""
    assert house.is_inside(UVD, "room3")


def test_cancelled_robot_stops_where_its_body_is():
    house = House()
    house.tell(UVD, "a_navigate_to", "room1")
    house.wait(4.0)
    house.world.cancel("1")
    at = house.at(UVD)
    house.wait(2.0)
    assert math.dist(at, house.at(UVD)) < 0.3
    assert house.world.agents[UVD].place == CORRIDOR


@pytest.mark.parametrize(("rate", "listing"), [(0.0, LISTING_3), (100.0, LISTING_4)])
def test_agents_do_the_mission_of_the_paper_as_in_the_kinematic_world(rate: float, listing: list):
    pytest.importorskip("mujoco")
    reactive = {"proactive": False, "policy": "repair"}
    run = Watched(hospital(rate=rate, world={"simulation": "physics"}, coordinator=reactive)).until(10.0)
    assert run.views[1].status == "finished"
    assert run.history() == listing
    assert run.infected() == []


@pytest.mark.slow
def test_same_commands_give_the_same_world():
    first, second = House(seed=3), House(seed=3)
    for house in (first, second):
        house.do(SPOT, "a_navigate_to", ROOM)
        house.do(SPOT, "a_open_door", ROOM)
    assert first.world.state() == second.world.state()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_agents_disinfect_a_large_ward_with_all_kinds_of_problems(seed: int):
    pytest.importorskip("mujoco")
    graph = large_hospital(12, 2, 2, rate=100.0, seed=seed, world={"simulation": "physics", "every_s": 1.0})
    run = Watched(graph).until(120.0)
    assert len(run.views) == 12
    assert run.infected() == []
    problems = {fault.kind for fault in run.runner.nodes["world"].world.problems}  # type: ignore[attr-defined]
    assert len(problems) >= 3
