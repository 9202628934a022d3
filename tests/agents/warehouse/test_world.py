from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.warehouse.messages import Point
from socialbot.agents.warehouse.scenario import (
    GRIPPER,
    SIX,
    is_carried,
    random_faults,
    scenario_of,
)
from socialbot.agents.warehouse.world import Warehouse
from socialbot.core.clock import SECOND


class Story:
    """A world with a sequence of commands."""

    def __init__(self, *faults: WorldFault, noise: float = 0.0, seed: int = 0) -> None:
        self.world = Warehouse(faults=faults, noise=noise, seed=seed)

    def wait(self, seconds: float) -> None:
        self.world.advance(self.world.now + round(seconds * SECOND))

    def go(self, place: str) -> None:
        assert self.world.move_crane(place) == ""
        self.wait(6.0)
        assert self.world.status(GRIPPER).current_name == place

    def send(self, carrier: str, target: str, seconds: float = 6.0) -> None:
        assert self.world.move_carrier(carrier, target) == ""
        self.wait(seconds)

    def fingers(self, *orders: str) -> None:
        for order in orders:
            tell = self.world.set_fingers if order in ("low", "high") else self.world.set_grip
            assert tell(order) == ""
            self.wait(1.0)

    def take(self, base: str) -> None:
        self.go(base)
        self.fingers("low", "close", "high")

    def put(self, place: str) -> None:
        self.go(place)
        self.fingers("low", "open", "high")

    def holder(self, box: str) -> str:
        return next(found.holder for found in self.world.boxes() if found.name == box)

    def position(self, box: str) -> Point:
        return next(found.position for found in self.world.boxes() if found.name == box)

    def carried(self, carrier: str) -> tuple[str, ...]:
        boxes = {box.name: box.position for box in self.world.boxes()}
        deck = self.world.status(carrier).current_pos
        return tuple(sorted(name for name, box in boxes.items() if is_carried(deck, box)))


def test_carrier_unloads_two_boxes_at_deposit():
    story = Story()
    story.send("carrier_a", "base")
    for box, slot in (("box_a2", "base_a1"), ("box_c2", "base_a2")):
        story.take("base_1")
        assert story.world.held == box
        story.put(slot)
        assert story.holder(box) == "carrier_a"
    assert story.carried("carrier_a") == ("box_a2", "box_c2")
    assert story.world.unload("carrier_a") == "carrier_a is not at its deposit"
    story.send("carrier_a", "deposit")
    assert story.carried("carrier_a") == ("box_a2", "box_c2")
    assert story.world.unload("carrier_a") == ""
    story.wait(1.0)
    assert story.world.unload("carrier_a") == "", "asking again does not begin anew"
    story.wait(0.6)
    assert story.carried("carrier_a") == ()
    assert story.world.load["deposit_a"] == ["box_a2", "box_c2"]


def test_longest_paths_take_planned_durations():
    story = Story()
    story.go("base_c2")
    story.world.move_crane("start")
    assert (story.world.crane.drive.arrival - story.world.now) / SECOND == pytest.approx(4.8)
    story.world.move_carrier("carrier_a", "base")
    assert (story.world.carriers["carrier_a"].drive.arrival - story.world.now) / SECOND == pytest.approx(5.44, abs=0.01)
    large = Warehouse(scenario_of(24, 6), noise=0.0)
    large.move_crane("base_f2")
    assert large.crane.drive.arrival / SECOND < 5.0


def test_status_has_start_target_and_progress():
    story = Story()
    story.world.move_crane("base_1")
    story.wait(1.2)
    status = story.world.status(GRIPPER)
    assert (status.start_name, status.current_name, status.target_name) == ("start", "moving", "base_1")
    assert 0.0 < status.progress < 1.0
    story.wait(2.0)
    status = story.world.status(GRIPPER)
    assert (status.current_name, status.progress, status.dist) == ("base_1", 1.0, 0.0)
    story.world.move_crane("base_1")
    assert story.world.status(GRIPPER) == status, "it is there already"


def test_box_released_without_carrier_blocks_the_bay():
    story = Story()
    story.take("base_1")
    story.put("base_a")
    assert story.holder("box_a2") == "base_a"
    story.send("carrier_a", "base", seconds=10.0)
    status = story.world.status("carrier_a")
    assert status.current_name == "moving"
    assert 0.6 < status.progress < 1.0
    story.fingers("low", "close", "high")
    assert story.world.held == "box_a2"
    story.wait(6.0)
    assert story.world.status("carrier_a").current_name == "base"


def test_moving_carrier_stops_before_box_in_its_bay():
    story = Story()
    story.take("base_1")
    story.go("base_a")
    story.fingers("low")
    story.world.move_carrier("carrier_a", "base")
    story.wait(1.0)
    story.fingers("open")
    story.wait(10.0)
    assert story.world.status("carrier_a").current_name == "moving"
    assert story.holder("box_a2") == "base_a"


def test_carrier_that_leaves_early_misses_the_box():
    story = Story(WorldFault(30.0, "leaves", "carrier_a"))
    story.send("carrier_a", "base")
    story.take("base_1")
    story.go("base_a1")
    story.fingers("low")
    story.world.advance(36 * SECOND)
    assert story.world.status("carrier_a").current_name == "deposit"
    assert story.holder("box_a2") == GRIPPER
    story.fingers("open")
    assert story.carried("carrier_a") == ()
    assert story.holder("box_a2") == "base_a", "it stands in the bay now"


def test_box_stacked_on_carrier_is_not_counted():
    story = Story()
    story.send("carrier_a", "base")
    for _ in range(2):
        story.take("base_1")
        story.put("base_a")
    assert story.holder("box_c2") == story.holder("box_a2") == "carrier_a"
    assert story.position("box_c2").z == pytest.approx(story.position("box_a2").z + 0.22)
    assert story.carried("carrier_a") == ("box_a2",)


def test_slipped_box_stays_and_can_be_grasped_again():
    story = Story(WorldFault(0.0, "slips"))
    story.take("base_1")
    assert story.world.held == ""
    assert story.holder("box_a2") == "base_1"
    story.fingers("open", "low", "close", "high")
    assert story.world.held == "box_a2"


def test_lifted_or_moving_fingers_grasp_nothing():
    story = Story()
    story.go("base_1")
    story.fingers("close")
    assert story.world.held == ""
    story.fingers("open")
    story.world.move_crane("base_2")
    story.world.set_fingers("low")
    story.fingers("close")
    assert story.world.held == ""


def test_crane_moves_with_lifted_fingers():
    story = Story()
    story.go("base_1")
    story.fingers("low")
    low = story.world.finger_z
    assert low == pytest.approx(0.66)
    story.world.move_crane("base_3")
    story.wait(0.3)
    assert story.world.status(GRIPPER).progress == 0.0
    assert story.world.finger_z > low
    story.wait(0.8)
    assert story.world.status(GRIPPER).progress > 0.0
    assert story.world.finger_z == 1.5
    story.world.set_fingers("low")
    story.wait(0.1)
    assert story.world.finger_z == 1.5
    story.wait(6.0)
    assert story.world.finger_z == 0.0


def test_box_dropped_during_movement_lies_on_floor():
    story = Story()
    story.take("base_1")
    story.world.move_crane("base_c")
    story.wait(1.0)
    story.fingers("open")
    assert story.holder("box_a2") == "floor"
    assert story.position("box_a2").z == pytest.approx(0.11)


def test_stalled_robot_and_silent_sensor_resume():
    story = Story(WorldFault(2.0, "stalls", "carrier_a", 3.0), WorldFault(1.0, "silent", "carrier_a", 10.0))
    story.world.move_carrier("carrier_a", "base")
    story.wait(8.3)
    assert story.world.is_silent("carrier_a")
    assert not story.world.is_silent("carrier_b")
    assert story.world.status("carrier_a").current_name == "moving"
    story.wait(2.8)
    assert not story.world.is_silent("carrier_a")
    assert story.world.status("carrier_a").current_name == "base"


def test_carrier_sent_away_during_unloading_keeps_its_boxes():
    story = Story()
    story.send("carrier_a", "base")
    story.take("base_1")
    story.put("base_a")
    story.send("carrier_a", "deposit")
    story.world.unload("carrier_a")
    story.wait(1.0)
    story.send("carrier_a", "base", seconds=20.0)
    assert story.carried("carrier_a") == ("box_a2",)


@pytest.mark.parametrize(
    "tell",
    [
        lambda world: world.move_crane("base_9"),
        lambda world: world.move_crane(""),
        lambda world: world.move_carrier("carrier_z", "base"),
        lambda world: world.move_carrier("carrier_a", "home"),
        lambda world: world.set_fingers("sideways"),
        lambda world: world.set_grip("shut"),
        lambda world: world.unload("carrier_z"),
    ],
)
def test_invalid_command_is_refused_with_reason_and_no_effect(tell):
    world, same = Warehouse(seed=3), Warehouse(seed=3)
    assert tell(world)
    for one in (world, same):
        one.move_crane("base_1")
        one.move_carrier("carrier_a", "base")
        one.advance(3 * SECOND)
    assert state(world) == state(same)


def state(world: Warehouse) -> list[Any]:
    robots = (GRIPPER, *world.scenario.carriers)
    return [world.now, world.boxes(), world.finger_z, *(world.status(robot) for robot in robots)]


PLACES = [*Warehouse().layout.places, "nowhere"]
commands = st.one_of(
    st.tuples(st.just("move_crane"), st.sampled_from(PLACES)),
    st.tuples(st.just("set_fingers"), st.sampled_from(["low", "high"])),
    st.tuples(st.just("set_grip"), st.sampled_from(["open", "close"])),
    st.tuples(st.just("move_carrier"), st.sampled_from(SIX.carriers), st.sampled_from(["base", "deposit"])),
    st.tuples(st.just("unload"), st.sampled_from(SIX.carriers)),
    # Handling that gets somewhere, which single commands seldom do.
    st.tuples(st.just("take"), st.sampled_from(PLACES[:-1])),
    st.tuples(st.just("put"), st.sampled_from(PLACES[:-1])),
)
scripts = st.lists(st.tuples(st.floats(0.0, 6.0), commands), max_size=30)


def steps_of(command: Sequence[str]) -> list[tuple[float, Sequence[str]]]:
    match command:
        case "take" | "put", place:
            grip = "close" if command[0] == "take" else "open"
            return [(0.0, ("move_crane", place)), (6.0, ("set_fingers", "low")), (1.2, ("set_grip", grip))]
        case _:
            return [(0.0, command)]


def run(script: Sequence[tuple[float, Sequence[str]]], seed: int, parts: int) -> list[list[Any]]:
    """The states after each command; time passes in so many ``parts``."""
    world = Warehouse(seed=seed, faults=random_faults(seed, SIX, until_s=60.0))
    found = []
    for wait, command in ((wait + more, step) for wait, one in script for more, step in steps_of(one)):
        begin = world.now
        for part in range(1, parts + 1):
            world.advance(begin + round(wait * SECOND) * part // parts)
        getattr(world, command[0])(*command[1:])
        found.append(state(world))
        check(world)
    return found


def check(world: Warehouse) -> None:
    """Each box is in one place, that place bears it, and what rides on a carrier is over its deck."""
    everything = [box for boxes in world.load.values() for box in boxes]
    assert sorted(everything) == list(SIX.boxes)
    assert len(world.load[GRIPPER]) <= 1
    spots = [box.position for box in world.boxes() if box.holder != GRIPPER]
    for one, a in enumerate(spots):
        assert a.z > 0
        for b in spots[one + 1 :]:
            assert max(abs(a.x - b.x), abs(a.y - b.y)) > 0.27 or abs(a.z - b.z) > 0.21
    for carrier in SIX.carriers:
        at = world.status(carrier).current_pos
        riding = [box for box in world.boxes() if box.holder == carrier]
        low = [box for box in riding if box.position.z < 0.4]
        assert all(is_carried(at, box.position) for box in low)


@settings(max_examples=150, deadline=None)
@given(script=scripts, seed=st.integers(0, 5))
def test_boxes_are_conserved_in_any_time_steps(script, seed):
    assert run(script, seed, 1) == run(script, seed, 7)


def test_seeds_give_different_runs():
    script = [(0.0, ("move_crane", "base_1")), (2.0, ("move_crane", "base_a")), (2.0, ("unload", "carrier_a"))]
    assert run(script, 1, 1) != run(script, 2, 1)


def test_noise_stays_within_its_bound():
    plain = Warehouse(noise=0.0)
    plain.move_carrier("carrier_a", "base")
    least = plain.carriers["carrier_a"].drive.arrival / SECOND
    for seed in range(100):
        world = Warehouse(seed=seed, noise=0.1)
        world.move_carrier("carrier_a", "base")
        assert least / 1.12 < world.carriers["carrier_a"].drive.arrival / SECOND < least * 1.12 + 0.5
