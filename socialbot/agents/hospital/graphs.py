"""The hospital as a graph: its ward, the coordinator, and an agent for each robot and nurse of the ward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from socialbot.agents.hospital.coordinator import HospitalCoordinator
from socialbot.agents.hospital.robot_node import HospitalAgent, Nurse, Spot, Uvd
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD, Ward, large_ward, paper_ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.graph.node import Graph, NodeConfig

WORLD = "world"
AGENTS: Mapping[str, type[HospitalAgent]] = {SPOT: Spot, UVD: Uvd, NURSE: Nurse}
"""The node types of agents, by the kinds of members of a ward."""


def hospital(
    *,
    rate: float = 0.0,
    seed: int = 0,
    world: Mapping[str, Any] | None = None,
    coordinator: Mapping[str, Any] | None = None,
) -> Graph:
    """The paper's ward with its nurse and two robots, where ``rate`` per cent of the missions meet a problem.

    ``world`` and ``coordinator`` are further parameters of these nodes.
    """
    return _graph(paper_ward(), {"rate": rate, "seed": seed, **(world or {})}, coordinator or {})


def large_hospital(
    rooms: int = 50,
    spots: int = 4,
    uvds: int = 4,
    nurses: int = 0,
    *,
    rate: float = 0.0,
    seed: int = 0,
    world: Mapping[str, Any] | None = None,
    coordinator: Mapping[str, Any] | None = None,
) -> Graph:
    """A large ward; see `large_ward` and `hospital`."""
    size = {"ward": "large", "rooms": rooms, "spots": spots, "uvds": uvds, "nurses": nurses}
    ward = large_ward(rooms, spots, uvds, nurses)
    return _graph(ward, {**size, "rate": rate, "seed": seed, **(world or {})}, coordinator or {})


def _graph(ward: Ward, world: Mapping[str, Any], coordinator: Mapping[str, Any]) -> Graph:
    return Graph(
        "hospital",
        (
            NodeConfig(WORLD, HospitalWorld, dict(world)),
            NodeConfig("coordinator", HospitalCoordinator, dict(coordinator)),
            *(NodeConfig(member.name, AGENTS[member.kind]) for member in ward.members),
        ),
    )
