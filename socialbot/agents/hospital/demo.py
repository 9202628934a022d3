"""Graphs of the hospital, with an agent for each robot and nurse of its ward, and its demo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import typer

from socialbot.agents.base.mujoco import Simulation
from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.hospital.robot_node import HospitalAgent, Nurse, Spot, Uvd
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD, Ward, large_ward, paper_ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.graph.node import Graph, NodeConfig

WORLD = "world"
AGENTS: Mapping[str, type[HospitalAgent]] = {SPOT: Spot, UVD: Uvd, NURSE: Nurse}
"""Node types of agents, by kind."""


def hospital(
    *,
    rate: float = 0.0,
    seed: int = 0,
    world: Mapping[str, Any] | None = None,
    coordinator: Mapping[str, Any] | None = None,
) -> Graph:
    """The graph of the paper's ward with its nurse and two robots.

    Args:
        rate: Percentage of missions with a problem.
        seed: Seed of the world.
        world: Further parameters of the world.
        coordinator: Parameters of the coordinator.
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
    """The graph of a large ward; see `large_ward` and `hospital` for the arguments."""
    size = {"ward": "large", "rooms": rooms, "spots": spots, "uvds": uvds, "nurses": nurses}
    ward = large_ward(rooms, spots, uvds, nurses)
    return _graph(ward, {**size, "rate": rate, "seed": seed, **(world or {})}, coordinator or {})


def _graph(ward: Ward, world: Mapping[str, Any], coordinator: Mapping[str, Any]) -> Graph:
    coordinator = {"pace": world.get("pace", "paper"), **coordinator}
    return Graph(
        "hospital",
        (
            NodeConfig(WORLD, HospitalWorld, dict(world)),
            NodeConfig("coordinator", HospitalCoordinator, dict(coordinator)),
            *(NodeConfig(member.name, AGENTS[member.kind]) for member in ward.members),
        ),
    )


def demo(
    problems: Annotated[
        float, typer.Option(min=0.0, max=100.0, metavar="%", help="Percentage of missions with a problem.")
    ] = 50.0,
    seed: Annotated[
        int, typer.Option(help="Seed of the problems. With 0, the mission of the paper has a problem at 50 %.")
    ] = 0,
    ward: Annotated[
        Literal["paper", "large"],
        typer.Option(help="paper: four rooms, a nurse, two robots, dirty rooms; large: five kinds of problems."),
    ] = "paper",
    rooms: Annotated[int, typer.Option(min=1, max=10_000, help="Rooms of the large ward.")] = 50,
    robots: Annotated[int, typer.Option(min=1, max=100, help="Robots of each kind in the large ward.")] = 4,
    policy: Annotated[
        Literal["auto", "replan", "repair", "none"],
        typer.Option(help="After a problem: a new plan, a repaired one, a choice of the two (auto), or no plan."),
    ] = "auto",
    foresight: Annotated[
        bool, typer.Option("--foresight", help="The coordinator observes the ward and acts before a problem.")
    ] = False,
    faults: Annotated[
        str,
        typer.Option(metavar="TEXT", help="Faults to add: '2 dirty room1; 3 drains uvdrobot1; 4 enters room1 9'."),
    ] = "",
    world: Annotated[Simulation, typer.Option(help="physics: MuJoCo, of the extra 'sim'.")] = "kinematic",
) -> tuple[str, Graph]:
    """Robots disinfect rooms of a hospital: tasks, teams, failures and new plans.

    Exit codes beside the usual ones: 10 not all missions were done.
    """
    simulated = {"faults": faults} | ({} if world == "kinematic" else {"simulation": world})
    coordinator = {"policy": policy, "proactive": foresight}
    if ward == "paper":
        graph = hospital(rate=problems, seed=seed, world=simulated, coordinator=coordinator)
    else:
        graph = large_hospital(
            rooms, robots, robots, rate=problems, seed=seed, world=simulated, coordinator=coordinator
        )
    return f"The hospital, {problems:g} % problems" + ("" if ward == "paper" else f", {rooms} rooms"), graph
