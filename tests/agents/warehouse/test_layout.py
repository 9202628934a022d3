from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from socialbot.agents.warehouse.demo import demo, warehouse_of
from socialbot.agents.warehouse.drawing import world_view
from socialbot.agents.warehouse.layout import parse_layout
from socialbot.agents.warehouse.scenario import (
    BOX_WIDTH_M,
    CARRIER_NAMES,
    DEPOSIT_Y,
    SIX,
    FloorLayout,
    Speeds,
    aisles_of,
    gripper_beliefs,
    scenario_of,
)
from socialbot.agents.warehouse.world_node import WarehouseWorld
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import GraphError, ParameterError
from socialbot.core.messages import Message, TraceRecord
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


def delivered(graph: Graph, limit_s: float) -> tuple[InlineRunner, list[TraceRecord]]:
    """Run until each box is in its deposit; return the runner and the traces of the grippers."""
    runner = InlineRunner(graph)
    records: list[TraceRecord] = []

    def take(_: str, message: Message) -> None:
        if isinstance(message, TraceRecord):
            records.append(message)

    for config in graph.nodes:
        if config.name.startswith("gripper"):
            runner.tap(f"/{config.name}/trace", take)
    runner.start()
    node = runner.nodes["world"]
    assert isinstance(node, WarehouseWorld)
    worlds = node.worlds.values()
    wanted, found = {}, {}
    for world in worlds:
        for deposit, load in zip(world.scenario.deposits, world.scenario.loads, strict=True):
            wanted[deposit] = sorted(load)
    for second in range(0, int(limit_s), 5):
        runner.advance(nanoseconds(second))
        found = {deposit: sorted(world.load[deposit]) for world in worlds for deposit in world.scenario.deposits}
        if found == wanted:
            break
    assert found == wanted
    assert not [faults for faults in runner.faults.values() if faults.failures]
    return runner, records


def test_a_layout_has_stacks_deposits_distance_and_speeds():
    (scenario,) = parse_layout(TWO, where="two.yaml")
    assert scenario.stacks == (("box_1", "box_2", "box_3"), ())
    assert dict(zip(scenario.carriers, scenario.loads, strict=True)) == {
        "carrier_a": ("box_1", "box_3"),
        "carrier_b": ("box_2",),
    }
    assert scenario.deposit_y == pytest.approx(DEPOSIT_Y - 0.7)
    assert scenario.speeds == Speeds(0.5, 1.2)


def test_the_stacks_of_a_seed_are_reproducible():
    seeded = [parse_layout(f"carriers: 8\nboxes: 40\nseed: {seed}", where="x")[0] for seed in (3, 3, 4)]
    assert seeded[0] == seeded[1]
    assert seeded[0].stacks != seeded[2].stacks
    assert seeded[0].boxes == seeded[2].boxes
    assert parse_layout("carriers: 3\nboxes: 6", where="x") == (SIX,) == (scenario_of(6, 3),)
    assert scenario_of(6, 3, seed=1) != SIX
    assert gripper_beliefs(seeded[0])


@pytest.mark.parametrize(
    ("change", "line", "what"),
    [
        (("carriers: 2", "carrier: 2"), 1, "unknown key 'carrier'"),
        (("carriers: 2\n", ""), 1, "'carriers' is missing"),
        (("carriers: 2", "carriers: 27"), 1, "whole number from 1 to 26"),
        (("carriers: 2", "carriers: 3"), 5, "2 deposits for 3 carriers"),
        (("carriers: 2", "carriers: 2\ngrippers: 2"), 2, "several grippers have random stacks only"),
        (("carriers: 2", "carriers: 2\nboxes: 9"), 3, "both 'boxes' and 'stacks'"),
        (("carriers: 2", "carriers: 2\nseed: 9"), 2, "'seed' without 'boxes'"),
        (("  - []", "  - [box_1]"), 4, "box_1 stands twice in 'stacks'"),
        (("  - []", "  - [box_9]"), 2, "box_9 is not in 'deposits'"),
        (("  - [box_2]", "  - [box_2, box_8]"), 5, "box_8 is not in 'stacks'"),
        (("  - []", "  - box_2"), 4, "each of 'stacks' must be a list of texts, got 'box_2'"),
        (("  - []", "  - [crate]"), 4, "each of 'stacks' must be a name of a box, got 'crate'"),
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
    _, records = delivered(again, 120.0)
    assert [record.detail["outcome"] for record in records if record.kind == "plan_end"] == ["succeeded"]
    view = world_view(graph)
    assert view is not None
    assert (view.scenario,) == parse_layout(TWO, where="two.yaml")


def test_a_carrier_of_a_layout_may_leave_too_early(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(TWO)
    graph = warehouse_of(file, run=2)
    assert graph.node("carrier_b").parameters == {"init_reactive_rules_set": "hasty_carrier_rules.yaml"}


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(GraphError, match="cannot be read") as raised:
        warehouse_of(tmp_path / "none.yaml")
    assert str(raised.value.where).endswith("none.yaml")


@pytest.mark.slow
def test_40_boxes_with_a_gripper_and_8_carriers_are_delivered(tmp_path):
    file = tmp_path / "many.yaml"
    file.write_text(MANY)
    delivered(warehouse_of(file, seed=4), 2400.0)


def test_3_grippers_share_the_boxes_and_carriers():
    aisles = parse_layout(f"grippers: 3\n{MANY}", where="x")
    assert [aisle.gripper for aisle in aisles] == ["gripper_a", "gripper_b", "gripper_c"]
    assert [len(aisle.carriers) for aisle in aisles] == [2, 3, 3]
    assert [carrier for aisle in aisles for carrier in aisle.carriers] == list(CARRIER_NAMES[:8])
    assert len({box for aisle in aisles for box in aisle.boxes}) == 40
    bases = [base for aisle in aisles for base in aisle.bases]
    assert len(set(bases)) == len(bases)
    places = [FloorLayout(aisle).places.values() for aisle in aisles]
    for left, right in pairwise(places):
        assert max(place.x for place in left) + BOX_WIDTH_M < min(place.x for place in right)


@pytest.mark.parametrize(("grippers", "carriers"), [(5, 8), (3, 2), (0, 3)])
def test_impossible_numbers_of_grippers_are_rejected(grippers, carriers):
    with pytest.raises(GraphError, match="whole number from 1 to"):
        parse_layout(f"grippers: {grippers}\ncarriers: {carriers}\nboxes: 40", where="x")
    with pytest.raises(ParameterError, match="no warehouse with"):
        aisles_of(40, carriers, grippers)


@pytest.mark.slow
def test_40_boxes_with_3_grippers_and_8_carriers_are_delivered(tmp_path):
    file = tmp_path / "many.yaml"
    file.write_text(f"grippers: 3\n{MANY}")
    graph = warehouse_of(
        file, seed=4, faults="5 silent gripper_b 3; 20 stalls gripper_c 2; 30 slips; 40 silent boxes 2"
    )
    assert world_view(graph) is None
    runner, records = delivered(graph, 900.0)
    runner.advance(runner.clock.now() + nanoseconds(30.0))
    fulfilled = [record.source for record in records if record.kind == "desire_fulfilled"]
    assert sorted(fulfilled) == ["gripper_a", "gripper_b", "gripper_c"]


def test_a_gripper_that_is_not_in_the_layout_is_named(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(TWO)
    graph = warehouse_of(file)
    nodes = (*graph.nodes, replace(graph.node("gripper_a"), name="gripper_b"))
    with pytest.raises(ParameterError, match="has no gripper 'gripper_b'"):
        InlineRunner(replace(graph, nodes=nodes))


@pytest.mark.parametrize("faults", ["3 stalls gripper_b 1", "3 leaves carrier_c"])
def test_faults_of_robots_that_are_not_in_the_layout_are_rejected(tmp_path, faults):
    file = tmp_path / "two.yaml"
    file.write_text(TWO)
    with pytest.raises(ParameterError):
        InlineRunner(warehouse_of(file, faults=faults))
