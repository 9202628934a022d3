"""Graphs for ``ros2 launch``: their nodes as processes that somebody else starts and watches."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.bridge import environment
from socialbot.bridge.launch import node_arguments, write_graph
from socialbot.bridge.wire import KEYS_VARIABLE
from socialbot.deployment.deployment import Deployment
from socialbot.graph import Graph
from socialbot.live import keep_minds
from socialbot.security import paths


@dataclass(frozen=True)
class NodeProcess:
    """A node in a process of its own: its name, the arguments of ``socialbot node``, and variables for it."""

    name: str
    arguments: tuple[str, ...]
    variables: Mapping[str, str]


def graph_processes(
    graph: Graph, folder: Path, *, minds: Path | None = None, sim_time: bool = False
) -> list[NodeProcess]:
    """A process for each node of ``graph``; they end when the caller does.

    ``folder`` takes the graph, for them to read, and what agents have in mind, for them to find again,
    unless ``minds`` is another folder for that.
    """
    file = write_graph(keep_minds(graph, minds or folder / "minds"), folder.resolve())
    prepared = dict(os.environ)
    environment.prepare(prepared)
    paths.allow(folder, prepared)
    return [
        NodeProcess(
            name=placement.name,
            arguments=(
                *node_arguments(file, [placement.name], sim_time=sim_time)[1:],
                *("--parent", str(os.getpid())),
            ),
            variables=_added(prepared),
        )
        for placement in graph.placements
    ]


def machine_processes(
    deployment: Deployment, machine: str, folder: Path, graph: Graph | None = None
) -> list[NodeProcess]:
    """A process for each node of one machine. ``graph`` is that of the deployment, with changes.

    Raises GraphError when there is no such machine.
    """
    names = {placement.name for placement in deployment.half(machine)}
    return [
        replace(process, variables={**process.variables, **_crossing(deployment, machine, process.name)})
        for process in graph_processes(graph or deployment.graph, folder, minds=deployment.minds)
        if process.name in names
    ]


def _crossing(deployment: Deployment, machine: str, node: str) -> dict[str, str]:
    """What the environment of a node needs so that it talks to the other machines."""
    prepared = dict(os.environ)
    environment.prepare(
        prepared,
        domain=deployment.domain,
        across=deployment.across(machine),
        raw_pictures=deployment.raw_pictures(node),
    )
    if deployment.keys is not None:
        prepared[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"
    return _added(prepared)


def _added(prepared: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in prepared.items() if os.environ.get(name) != value}
