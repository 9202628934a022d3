"""Graphs of the warehouse for three numbers of boxes, and its demo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from socialbot.agents.base.mujoco import Simulation
from socialbot.agents.warehouse.carrier import Carrier
from socialbot.agents.warehouse.gripper import Gripper, Gripper12, Gripper24, LayoutGripper
from socialbot.agents.warehouse.layout import load_layout
from socialbot.agents.warehouse.scenario import GRIPPER, HASTY_CARRIER_RULES, Scenario
from socialbot.agents.warehouse.world_node import LayoutWorld, World, World12, World24
from socialbot.core import paths
from socialbot.graph.node import Graph, NodeConfig

KINDS = {6: (World, Gripper), 12: (World12, Gripper12), 24: (World24, Gripper24)}
"""Node types of the world and the gripper, by the number of boxes."""


def scenario_with(boxes: int) -> Scenario:
    """The scenario with this number of boxes, a key of `KINDS`."""
    return KINDS[boxes][1].scenario


def warehouse(
    boxes: int = 6, *, run: Literal[1, 2] = 1, seed: int = 0, faults: str = "", world: Simulation = "kinematic"
) -> Graph:
    """The graph of a warehouse.

    Args:
        boxes: Number of boxes, a key of `KINDS`.
        run: In run 2 one carrier leaves as soon as it has one box.
        seed: Seed of the world.
        faults: Faults of the world; see its parameter.
        world: ``physics`` needs the extra ``sim``.
    """
    kind, gripper = KINDS[boxes]
    files = {"init_bset": "gripper_beliefs.yaml", "init_dset": "gripper_desires.yaml"} if boxes == 6 else {}
    return _graph(
        gripper.scenario.carriers,
        NodeConfig("world", kind, {"seed": seed, "faults": faults, **_simulated(world)}),
        [NodeConfig(GRIPPER, gripper, files)],
        run,
    )


def warehouse_of(
    layout: Path, *, run: Literal[1, 2] = 1, seed: int = 0, faults: str = "", world: Simulation = "kinematic"
) -> Graph:
    """The graph of a warehouse from a layout file, which its nodes may read.

    Args:
        layout: Layout file.
        run: In run 2 the last carrier leaves as soon as it has one box.
        seed: Seed of the world.
        faults: Faults of the world; see its parameter.
        world: ``physics`` needs the extra ``sim``.

    Raises:
        GraphError: The file cannot be read, or is no layout.
    """
    paths.allow(layout)
    file = {"layout": str(layout.resolve())}
    aisles = load_layout(layout)
    return _graph(
        [carrier for aisle in aisles for carrier in aisle.carriers],
        NodeConfig("world", LayoutWorld, {"seed": seed, "faults": faults, **_simulated(world), **file}),
        [NodeConfig(aisle.gripper, LayoutGripper, file) for aisle in aisles],
        run,
    )


def _simulated(world: Simulation) -> dict[str, str]:
    """Parameters of the world beside the default ones."""
    return {} if world == "kinematic" else {"simulation": world}


def _graph(carriers: Sequence[str], world: NodeConfig, grippers: Sequence[NodeConfig], run: Literal[1, 2]) -> Graph:
    hasty = {carriers[-1]: {"init_reactive_rules_set": HASTY_CARRIER_RULES.name}} if run == 2 else {}
    return Graph(
        "warehouse", (world, *(NodeConfig(carrier, Carrier, hasty.get(carrier, {})) for carrier in carriers), *grippers)
    )


def demo(
    run: Annotated[int, typer.Option(min=1, max=2, help="2: a carrier leaves too early, and plans change.")] = 1,
    boxes: Annotated[Literal["6", "12", "24"], typer.Option(help="6 and 12 with three carriers, 24 with six.")] = "6",
    seed: Annotated[int, typer.Option(help="Seed of speeds and stalls.")] = 0,
    faults: Annotated[
        str, typer.Option(metavar="TEXT", help="Faults: '30 leaves carrier_c; 40 slips; 50 silent carrier_a 10'.")
    ] = "",
    layout: Annotated[Path | None, typer.Option(metavar="FILE", help="Layout file (YAML) instead of --boxes.")] = None,
    world: Annotated[Simulation, typer.Option(help="physics: MuJoCo, of the extra 'sim'.")] = "kinematic",
) -> tuple[str, Graph]:
    """A gripper sorts boxes onto carriers, which take them away.

    Exit codes beside the usual ones: 10 not all goals were reached.
    """
    if layout is not None:
        graph = warehouse_of(layout, run=2 if run == 2 else 1, seed=seed, faults=faults, world=world)
        return f"The warehouse of {layout.name}, run {run}", graph
    graph = warehouse(int(boxes), run=2 if run == 2 else 1, seed=seed, faults=faults, world=world)
    return f"The warehouse, run {run}" + ("" if boxes == "6" else f", {boxes} boxes"), graph
