from __future__ import annotations

import pytest

from socialbot.agents.warehouse.demo import demo, warehouse_of
from socialbot.agents.warehouse.drawing import world_view
from socialbot.agents.warehouse.layout import parse_layout
from socialbot.agents.warehouse.scenario import DEPOSIT_Y, SIX, Speeds, gripper_beliefs, scenario_of
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import GraphError
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import dump_graph, parse_graph
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph

TWO = """\
carriers: 2
stacks:
  - [box_1, box_2, box_3]
  - []
deposits:
  - [box_1, box_3]
  - [box_2]
deposit_distance_m: 2.5
speeds: {crane: 0.5, carriers: 1.2}
"""
MANY = "carriers: 8\nboxes: 40\nseed: 3\n"


def delivered(graph: Graph, limit_s: float) -> list[TraceRecord]:
    """Run until each box is in its deposit; return the trace of the gripper."""
    runner, records = InlineRunner(graph), []
    runner.tap("/gripper_a/trace", lambda _, record: records.append(record))
    runner.start()
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    world, routes = node.world, node.world.scenario
    wanted = {deposit: sorted(load) for deposit, load in zip(routes.deposits, routes.loads, strict=True)}
    for second in range(0, int(limit_s), 5):
        runner.advance(nanoseconds(second))
        found = {deposit: sorted(world.load[deposit]) for deposit in wanted}
        if found == wanted:
            break
    assert found == wanted
    assert not [faults for faults in runner.faults.values() if faults.failures]
    return records


def test_a_layout_has_stacks_deposits_distance_and_speeds():
    scenario = parse_layout(TWO, where="two.yaml")
    assert scenario.stacks == (("box_1", "box_2", "box_3"), ())
    assert dict(zip(scenario.carriers, scenario.loads, strict=True)) == {
        "carrier_a": ("box_1", "box_3"),
        "carrier_b": ("box_2",),
    }
    assert scenario.deposit_y == pytest.approx(DEPOSIT_Y - 0.7)
    assert scenario.speeds == Speeds(0.5, 1.2)


def test_the_stacks_of_a_seed_are_reproducible():
    seeded = [parse_layout(f"carriers: 8\nboxes: 40\nseed: {seed}", where="x") for seed in (3, 3, 4)]
    assert seeded[0] == seeded[1]
    assert seeded[0].stacks != seeded[2].stacks
    assert seeded[0].boxes == seeded[2].boxes
    assert parse_layout("carriers: 3\nboxes: 6", where="x") == SIX == scenario_of(6, 3)
    assert scenario_of(6, 3, seed=1) != SIX
    assert gripper_beliefs(seeded[0])


@pytest.mark.parametrize(
    ("change", "line", "what"),
    [
        (("carriers: 2", "carrier: 2"), 1, "unknown key 'carrier'"),
        (("carriers: 2\n", ""), 1, "'carriers' is missing"),
        (("carriers: 2", "carriers: 27"), 1, "whole number from 1 to 26"),
        (("carriers: 2", "carriers: 3"), 5, "2 deposits for 3 carriers"),
        (("carriers: 2", "carriers: 2\ngrippers: 3"), 2, "unknown key 'grippers'"),
        (("carriers: 2", "carriers: 2\nboxes: 9"), 3, "both 'boxes' and 'stacks'"),
        (("carriers: 2", "carriers: 2\nseed: 9"), 2, "'seed' without 'boxes'"),
        (("  - []", "  - [box_1]"), 4, "box_1 stands twice in 'stacks'"),
        (("  - []", "  - [box_9]"), 2, "box_9 is not in 'deposits'"),
        (("  - [box_2]", "  - [box_2, box_8]"), 5, "box_8 is not in 'stacks'"),
        (("  - []", "  - box_2"), 4, "expected a list of boxes"),
        (("  - []", "  - [crate]"), 4, "no valid name of a box: 'crate'"),
        (("box_3]\n  - []", "box_3, box_4]\n  - []"), 3, "a stack of 4 boxes; the highest has 3"),
        (("stacks:\n", "stacks: many\nold:\n"), 3, "unknown key 'old'"),
        (("2.5", "50"), 8, "number from 2 to 5"),
        (("1.2", "0.1"), 9, "number from 0.5 to 3"),
        (("1.2", "0.5"), 9, "a carrier drives 7.4 s"),
        (("crane", "cranes"), 9, "unknown key 'cranes'"),
    ],
)
def test_mistakes_are_reported_with_their_line(change, line, what):
    with pytest.raises(GraphError, match=what) as raised:
        parse_layout(TWO.replace(*change), where="two.yaml")
    assert raised.value.where == f"two.yaml:{line}"


@pytest.mark.parametrize("text", ["carriers: 2\n", "carriers: 2\nstacks: 5\n", "[1, 2]", "a: ]"])
def test_other_pages_are_rejected(text):
    with pytest.raises(GraphError):
        parse_layout(text, where="two.yaml")


def test_the_boxes_of_a_layout_are_delivered(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(TWO)
    title, graph = demo(layout=file)
    assert title == "The warehouse of two.yaml, run 1"
    again = parse_graph(dump_graph(graph), where="as a process reads it")
    assert again == graph
    records = delivered(again, 120.0)
    assert [record.detail["outcome"] for record in records if record.kind == "plan_end"] == ["succeeded"]
    view = world_view(graph)
    assert view is not None
    assert view.scenario == parse_layout(TWO, where="two.yaml")


def test_a_carrier_of_a_layout_may_leave_too_early(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(TWO)
    graph = warehouse_of(file, run=2)
    assert graph.node("carrier_b").parameters == {"init_reactive_rules_set": "hasty_carrier_rules.yaml"}


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(GraphError, match="cannot be read") as raised:
        warehouse_of(tmp_path / "none.yaml")
    assert raised.value.where.endswith("none.yaml")


@pytest.mark.slow
def test_40_boxes_with_8_carriers_are_delivered(tmp_path):
    file = tmp_path / "many.yaml"
    file.write_text(MANY)
    delivered(warehouse_of(file, seed=4), 2400.0)
