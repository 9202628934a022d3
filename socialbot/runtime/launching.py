"""Start a deployment from ``ros2 launch`` or systemd."""

from __future__ import annotations

import getpass
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.bridge import environment
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.core import paths
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Graph
from socialbot.runtime.deployment import Deployment
from socialbot.runtime.launch import node_arguments, write_graph
from socialbot.runtime.live import keep_minds


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


UNIT = """\
[Unit]
Description={description}
Wants=network-online.target time-sync.target
After=network-online.target time-sync.target

[Service]
Type=exec
User={user}
WorkingDirectory={folder}
ExecStart={command}
# What dies is started again by socialbot itself; this is for socialbot.
Restart=on-failure
RestartSec=5
# A command line or configuration that is wrong stays wrong.
RestartPreventExitStatus=2 4
KillSignal=SIGINT
KillMode=mixed
TimeoutStopSec=20
NoNewPrivileges=yes

[Install]
WantedBy=multi-user.target
"""


def unit_name(machine: str) -> str:
    """What the unit of ``machine`` is called."""
    return f"socialbot-{machine}.service"


def unit(file: Path, machine: str, *, user: str | None = None) -> str:
    """The unit that runs the nodes of ``machine`` as the deployment ``file`` says, as ``user``, by default this one.

    Runs are recorded beside the file. Raises ParameterError when the file has a name that no unit can hold.
    """
    file = file.resolve()
    if not str(file).isprintable():
        raise ParameterError("a name that no unit can hold", where=repr(str(file)), remedy="use letters and digits")
    command = [sys.executable, "-m", "socialbot", "up", str(file), "--machine", machine]
    return UNIT.format(
        description=f"socialbot: {machine} of {file.name}".replace("%", "%%"),
        user=user or getpass.getuser(),
        folder=str(file.parent).replace("%", "%%"),
        command=" ".join(map(quoted, command)),
    )


def quoted(argument: str) -> str:
    """``argument`` as systemd takes it in a command, whatever it holds."""
    escaped = argument.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return escaped if re.fullmatch(r"[A-Za-z0-9_./-]+", escaped) else f'"{escaped}"'
