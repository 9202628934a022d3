"""The warehouse with physics: boxes rest, hang, ride, fall and are pushed into their deposits."""

from __future__ import annotations

import sys

import pytest

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.warehouse.demo import warehouse, warehouse_of
from socialbot.agents.warehouse.messages import Point
from socialbot.agents.warehouse.physics import PhysicalWarehouse
from socialbot.agents.warehouse.scenario import BOX_M, DECK_M, SIX, scenario_of
from socialbot.agents.warehouse.world import FLOOR
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command
from socialbot.graph.inline import InlineRunner

MM = 0.001


def test_missing_package_is_named_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InstallationError) as caught:
        PhysicalWarehouse()
    assert extra_command("sim") in str(caught.value)


class Hall:
    """A warehouse with physics and without noise."""

    def __init__(self, *faults: WorldFault, **more) -> None:
        pytest.importorskip("mujoco")
        self.world = PhysicalWarehouse(noise=0.0, faults=faults, **more)

    def do(self, command: str, *args: str, seconds: float = 2.0) -> Hall:
        assert getattr(self.world, command)(*args) == ""
        return self.wait(seconds)

    def wait(self, seconds: float) -> Hall:
        self.world.advance(self.world.now + nanoseconds(seconds))
        return self

    def pick(self, place: str) -> Hall:
        self.do("move_crane", place, seconds=6.0).do("set_fingers", "low")
        return self.do("set_grip", "close", seconds=1.0).do("set_fingers", "high")

    def put(self, place: str) -> Hall:
        self.do("move_crane", place, seconds=6.0).do("set_fingers", "low")
        return self.do("set_grip", "open", seconds=1.0).do("set_fingers", "high")

    def holder(self, box: str) -> str:
        return next(each.holder for each in self.world.boxes() if each.name == box)

    def at(self, box: str) -> Point:
        return self.world.box_at(box)


@pytest.mark.parametrize("scenario", [SIX, pytest.param(scenario_of(24, 6), marks=pytest.mark.slow)])
def test_stacks_stand_still(scenario):
    hall = Hall(scenario=scenario)
    before = hall.world.boxes()
    hall.wait(10.0)
    for first, last in zip(before, hall.world.boxes(), strict=True):
        assert first.holder == last.holder
        moved = (abs(a - b) for a, b in zip(_xyz(first.position), _xyz(last.position), strict=True))
        assert max(moved) < 2 * MM


@pytest.mark.slow
def test_stacks_stand_still_while_the_crane_carries_boxes_of_another(tmp_path):
    pytest.importorskip("mujoco")
    layout = tmp_path / "aisles.yaml"
    layout.write_text("grippers: 2\ncarriers: 4\nboxes: 12\nseed: 5\n")
    runner = InlineRunner(warehouse_of(layout, world="physics"))
    runner.start()
    runner.advance(nanoseconds(10.0))
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    for world in node.worlds.values():
        assert world.held
        assert world.load[FLOOR] == []


def _xyz(point: Point) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def test_a_box_travels_from_its_stack_to_its_deposit():
    hall = Hall().pick("base_1")
    assert hall.holder("box_a2") == "gripper_a"
    assert hall.at("box_a2").z == pytest.approx(hall.world.tool_z - BOX_M / 2, abs=10 * MM)
    hall.do("move_carrier", "carrier_a", "base", seconds=8.0).put("base_a1")
    assert hall.holder("box_a2") == "carrier_a"
    assert hall.at("box_a2").z == pytest.approx(DECK_M + BOX_M / 2, abs=5 * MM)
    hall.do("move_carrier", "carrier_a", "deposit", seconds=8.0)
    assert hall.holder("box_a2") == "carrier_a"
    hall.do("unload", "carrier_a", seconds=3.0)
    assert hall.holder("box_a2") == "deposit_a"
    assert hall.world.load["carrier_a"] == []


@pytest.mark.slow
def test_two_loads_lie_on_the_shelf_one_behind_the_other():
    hall = Hall()
    for slot in ("base_c1", "base_c2"):
        hall.pick("base_2").do("move_carrier", "carrier_c", "base", seconds=8.0).put(slot)
        hall.do("move_carrier", "carrier_c", "deposit", seconds=8.0).do("unload", "carrier_c", seconds=3.0)
    assert sorted(hall.world.load["deposit_c"]) == ["box_b2", "box_c1"]
    assert hall.at("box_c1").y - hall.at("box_b2").y > BOX_M


def test_a_box_that_slips_stays_on_its_stack():
    hall = Hall(WorldFault(1.0, "slips")).pick("base_1")
    assert hall.holder("box_a2") == "base_1"
    assert hall.do("set_grip", "open", seconds=1.0).pick("base_1").holder("box_a2") == "gripper_a"


def test_a_box_released_in_the_air_falls_on_the_stack_below():
    hall = Hall().pick("base_1").do("move_crane", "base_2", seconds=6.0)
    assert hall.do("set_grip", "open").holder("box_a2") == "base_2"
    assert hall.at("box_a2").z == pytest.approx(3.5 * BOX_M, abs=10 * MM)


def test_a_box_released_while_the_crane_moves_ends_on_the_floor_or_a_stack():
    hall = Hall().pick("base_1").do("move_crane", "base_c", seconds=1.2).do("set_grip", "open")
    assert hall.holder("box_a2") == FLOOR
    assert hall.at("box_a2").z < 2 * BOX_M


@pytest.mark.slow
def test_a_carrier_that_leaves_takes_its_boxes_along():
    hall = Hall().pick("base_2").do("move_carrier", "carrier_c", "base", seconds=8.0).put("base_c1")
    before = hall.at("box_c1").y
    hall.do("move_carrier", "carrier_c", "deposit", seconds=3.0)
    assert hall.at("box_c1").y - before > 0.5
    assert hall.holder("box_c1") == "carrier_c"


def test_a_vanished_box_is_gone_and_the_one_above_falls():
    hall = Hall(WorldFault(1.0, "vanishes", "box_c2")).wait(3.0)
    assert "box_c2" not in {box.name for box in hall.world.boxes()}
    assert hall.at("box_a2").z == pytest.approx(1.5 * BOX_M, abs=5 * MM)
    assert hall.holder("box_a2") == "base_1"


@pytest.mark.slow
def test_the_same_commands_give_the_same_world():
    first, second = (Hall(seed=3).pick("base_1").put("base_3") for _ in range(2))
    assert first.world.boxes() == second.world.boxes()


@pytest.mark.slow
@pytest.mark.parametrize("faults", ["", "28 leaves carrier_c", "20 vanishes box_c1; 50 slips"])
def test_the_agents_deliver_all_boxes_as_in_the_kinematic_world(faults):
    pytest.importorskip("mujoco")
    runner = InlineRunner(warehouse(6, world="physics", faults=faults))
    runner.start()
    runner.advance(nanoseconds(300.0))
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    gone = {word for word in faults.replace(";", " ").split() if word.startswith("box_")}
    for load, deposit in zip(SIX.loads, SIX.deposits, strict=True):
        assert set(node.world.load[deposit]) == set(load) - gone
