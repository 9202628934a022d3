"""The warehouse as a graph: the demonstrative runs, and larger ones."""

from __future__ import annotations

from typing import Literal

from socialbot.agents.warehouse.carrier import Carrier
from socialbot.agents.warehouse.gripper import Gripper, Gripper12, Gripper24
from socialbot.agents.warehouse.scenario import GRIPPER, HASTY_CARRIER_RULES, Scenario
from socialbot.agents.warehouse.world_node import World, World12, World24
from socialbot.graph.node import Graph, NodeConfig

KINDS = {6: (World, Gripper), 12: (World12, Gripper12), 24: (World24, Gripper24)}
"""Node types of the world and the gripper, by the number of boxes."""


def scenario_with(boxes: int) -> Scenario:
    """The scenario with so many boxes, one of `KINDS`."""
    return KINDS[boxes][1].scenario


def warehouse(boxes: int = 6, *, run: Literal[1, 2] = 1, seed: int = 0, faults: str = "") -> Graph:
    """The graph for so many ``boxes``, one of `KINDS`; see the world's parameters for ``seed`` and ``faults``.

    In the second ``run`` one carrier leaves as soon as it has one box.
    """
    world, gripper = KINDS[boxes]
    carriers = gripper.scenario.carriers
    hasty = {carriers[-1]: {"init_reactive_rules_set": HASTY_CARRIER_RULES.name}} if run == 2 else {}
    files = {"init_bset": "gripper_beliefs.yaml", "init_dset": "gripper_desires.yaml"} if boxes == 6 else {}
    return Graph(
        "warehouse",
        (
            NodeConfig("world", world, {"seed": seed, "faults": faults}),
            *(NodeConfig(carrier, Carrier, hasty.get(carrier, {})) for carrier in carriers),
            NodeConfig(GRIPPER, gripper, files),
        ),
    )
