from __future__ import annotations

import logging
from collections import Counter

import pytest

from socialbot.agents.warehouse.messages import (
    BoxPositions,
    GripperPose,
    GripperStatus,
    MoveCommand,
    MoveStatus,
    UnloadCommand,
)
from socialbot.agents.warehouse.world_node import World, World24
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from tests.inline import InlineRun

COMMANDS = frozenset(port.topic for port in World24.inputs().values())


class Hall(InlineRun):
    """The world's node alone."""

    def __init__(self, kind=World, start: int = 1_700_000_000 * SECOND, **parameters) -> None:
        super().__init__(Graph("hall", (NodeConfig("world", kind, parameters),), inputs=COMMANDS), start=start)

    def tell(self, second: float, topic: str, command, **fields) -> None:
        self.send(topic, command(stamp=self.begin + round(second * SECOND), **fields))
        assert self.runner.faults["world"].failures == 0

    def status(self, robot: str) -> MoveStatus:
        return [message for message in self.of(MoveStatus) if message.robot == robot][-1]

    def holder(self, box: str) -> str:
        return next(found.holder for found in self.of(BoxPositions)[-1].boxes if found.name == box)


def test_world_reports_ten_times_a_second():
    hall = Hall()
    hall.until(1.0)
    assert Counter(topic for topic, _ in hall.said) == dict.fromkeys(
        ["/gripper_a/motors_move_status", "/gripper_a/gripper_status", "/carrier_a/move_status",
         "/carrier_b/move_status", "/carrier_c/move_status", "/warehouse/boxes"], 11
    )  # fmt: skip
    stamps = [message.stamp for message in hall.messages("/warehouse/boxes")]
    assert stamps[1] - stamps[0] == SECOND // 10


def test_world_executes_commands_of_crane_and_carriers():
    hall = Hall(noise=0.0)
    hall.tell(0.0, "/carrier_a/cmd_target", MoveCommand, target="base")
    hall.tell(0.0, "/gripper_a/cmd_motors_pose", MoveCommand, target="base_1")
    hall.tell(4.0, "/gripper_a/cmd_gripper_pose", GripperPose, pose="low")
    hall.tell(5.0, "/gripper_a/cmd_gripper_status", GripperStatus, status="close")
    hall.until(6.0)
    assert hall.holder("box_a2") == "gripper_a"
    assert [message.status for message in hall.of(GripperStatus)][-1] == "close"
    assert hall.status("carrier_a").current_name == "base"
    hall.tell(6.0, "/gripper_a/cmd_motors_pose", MoveCommand, target="base_a1")
    hall.until(7.5)
    status = hall.status("gripper_a")
    assert (status.robot, status.start_name, status.current_name) == ("gripper_a", "base_1", "moving")
    assert status.current_pos.z == 1.5
    hall.tell(11.0, "/gripper_a/cmd_gripper_pose", GripperPose, pose="low")
    hall.tell(12.0, "/gripper_a/cmd_gripper_status", GripperStatus, status="open")
    hall.tell(13.0, "/carrier_a/cmd_target", MoveCommand, target="deposit")
    hall.tell(19.0, "/carrier_a/cmd_unload", UnloadCommand)
    hall.until(21.0)
    assert hall.holder("box_a2") == "deposit_a"


def test_refused_command_is_logged_without_effect(caplog):
    hall = Hall()
    with caplog.at_level(logging.WARNING):
        hall.tell(1.0, "/carrier_b/cmd_target", MoveCommand, target="moon")
        hall.tell(1.0, "/gripper_a/cmd_motors_pose", MoveCommand, target="base_z")
    assert [record.getMessage() for record in caplog.records] == [
        "refused: 'moon' is neither base nor deposit",
        "refused: there is no place 'base_z'",
    ]
    hall.until(2.0)
    assert hall.status("carrier_b").current_name == "deposit"


def test_silent_sensor_publishes_nothing_and_others_continue():
    hall = Hall(faults="1 silent carrier_a 1; 1 silent boxes 1; 1 silent gripper_a 1")
    hall.until(3.0)
    for topic in ("/carrier_a/move_status", "/warehouse/boxes", "/gripper_a/motors_move_status"):
        assert len(hall.messages(topic)) == 21, topic
    assert len(hall.messages("/carrier_b/move_status")) == 31


def test_invalid_faults_are_rejected_at_construction():
    with pytest.raises(ParameterError, match="remedy: write faults as"):
        Hall(faults="30 explodes")


def test_same_seed_gives_same_messages_at_any_start_time():
    def tale(start: int, seed: int) -> list:
        hall = Hall(start=start, seed=seed)
        for carrier in "abc":
            hall.tell(0.5, f"/carrier_{carrier}/cmd_target", MoveCommand, target="base")
        hall.tell(0.5, "/gripper_a/cmd_motors_pose", MoveCommand, target="base_3")
        hall.until(6.0)
        return [(message.stamp - start, message.current_pos) for message in hall.of(MoveStatus)]

    assert tale(0, 1) == tale(1_700_000_000 * SECOND, 1) != tale(0, 2)


def test_the_large_world_has_six_carriers_and_24_boxes():
    hall = Hall(World24)
    hall.tell(0.5, "/carrier_f/cmd_target", MoveCommand, target="base")
    hall.until(8.0)
    assert hall.status("carrier_f").current_name == "base"
    assert len(hall.of(BoxPositions)[-1].boxes) == 24


def test_faults_count_from_the_start_of_the_node():
    config = NodeConfig("world", World, {"faults": "1 silent boxes 1"})
    runner = InlineRunner(Graph("hall", (config,), inputs=COMMANDS), start=0)  # the clock is not set yet
    stamps: list[int] = []
    runner.tap("/warehouse/boxes", lambda _, message: stamps.append(message.stamp))
    runner.clock.set(10 * SECOND)
    runner.start()
    runner.advance(12 * SECOND + SECOND // 2)
    assert [stamp / SECOND for stamp in stamps] == pytest.approx(
        [10, 10.1, 10.2, 10.3, 10.4, 10.5, 10.6, 10.7, 10.8, 10.9, 12, 12.1, 12.2, 12.3, 12.4, 12.5]
    )
