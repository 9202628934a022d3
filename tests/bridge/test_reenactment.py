from __future__ import annotations

from socialbot.agents.warehouse.messages import GripperStatus, MoveCommand
from socialbot.bags.reader import open_bag
from socialbot.bags.world_replay import commands
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph


def test_commands_are_what_agents_told_the_world(tmp_path):
    record = TraceRecord(stamp=SECOND, id="1", source="carrier_a", kind="step", what="go")
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/carrier_a/cmd_target", MoveCommand(stamp=SECOND, target="base"), SECOND)
        bag.write("/gripper_a/gripper_status", GripperStatus(stamp=SECOND, status="open"), SECOND)
        bag.write("/carrier_a/trace", record, SECOND)
    with open_bag(tmp_path / "bag") as opened:
        agents = load_graph("warehouse").without_sources()
        assert commands(opened, agents) == {"/carrier_a/cmd_target": MoveCommand}
