"""One machine of a deployment: its nodes, its services and its network."""

from __future__ import annotations

import ipaddress
import logging
import math
import os
import socket
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import psutil

from socialbot.bridge import environment
from socialbot.bridge.diagnostics import MACHINE_VARIABLE
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.core import paths
from socialbot.graph.node import Graph
from socialbot.runtime._discovery_server import DiscoveryServer
from socialbot.runtime.deployment import Deployment, is_own
from socialbot.runtime.launch import node_arguments, write_graph
from socialbot.runtime.live_source import LiveSource, RunServices, with_state_files


def enter(deployment: Deployment, machine: str) -> None:
    """Configure this process for ``machine``: ROS domain, discovery, key and name.

    Call it before rclpy starts. Raises GraphError for an unknown machine.
    """
    deployment.address(machine)
    environment.prepare(domain=deployment.domain, across=deployment.across(machine))
    os.environ[MACHINE_VARIABLE] = machine
    if deployment.keys is not None:
        os.environ[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"


POLL_S = 0.5

UNCERTAIN_S = 5.0
"""Startup time in which a process may still miss a network."""

log = logging.getLogger("socialbot.network")


class Network:
    """Monitor of the network of ``address``, in a thread, since name look-ups may block.

    Use it as a context manager. It logs an address that is down at the start.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._wanted: frozenset[str] = frozenset()
        self._missed: tuple[float, float] | None = None
        self._lock = threading.Lock()
        self._down = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="network", daemon=True)

    def __enter__(self) -> Network:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()

    def missed(self) -> tuple[float, float] | None:
        """Start times (monotonic s) of processes that missed the network, returned once after it came up."""
        with self._lock:
            missed, self._missed = self._missed, None
        return missed

    def _watch(self) -> None:
        seen = -math.inf
        self._down = not self._is_up()
        if self._down:
            log.warning("%s is down on this machine: other machines are unreachable", self._address)
        while not self._closed.wait(POLL_S):
            is_up, now = self._is_up(), time.monotonic()
            if is_up and self._down:
                log.warning("%s is up now", self._address)
                with self._lock:  # join with an interval that nobody has asked for yet
                    self._missed = (self._missed[0] if self._missed else seen - UNCERTAIN_S, now)
            if is_up:
                seen = now
            self._down = not is_up

    def _is_up(self) -> bool:
        """Whether this machine has the address and its network is up."""
        try:
            own = own_addresses()
        except OSError as error:  # such as too many open files
            log.debug("cannot read the addresses of this machine: %s", error)
            return not self._down
        if self._wanted.isdisjoint(own):  # the name may resolve to other addresses now
            self._wanted = addresses_of(self._address) or self._wanted
        if self._wanted and not beyond(self._wanted):  # its own host name: any network that other machines reach counts
            return bool(own & self._wanted or beyond(own))
        return not self._wanted.isdisjoint(own)


def addresses_of(name: str) -> frozenset[str]:
    """Return the IPv4 addresses of ``name``, if any."""
    try:
        found = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError:
        return frozenset()
    return frozenset(str(address[0]) for *_, address in found)


def own_addresses() -> frozenset[str]:
    """Return the IPv4 addresses of this machine on active networks."""
    states = psutil.net_if_stats()
    return frozenset(
        each.address
        for name, addresses in psutil.net_if_addrs().items()
        for each in addresses
        if each.family == socket.AF_INET and _is_running(states.get(name.partition(":")[0]))  # eth0:1 is one of eth0
    )


def beyond(addresses: frozenset[str]) -> frozenset[str]:
    """Return the addresses except loopback; a host name often resolves to 127.0.1.1."""
    return frozenset(address for address in addresses if not ipaddress.IPv4Address(address).is_loopback)


def _is_running(states: Any) -> bool:
    return states is not None and "running" in states.flags.split(",")


@dataclass(frozen=True)
class NodeProcess:
    """Process of one node: name, arguments of ``socialbot node`` and additional environment variables."""

    name: str
    arguments: tuple[str, ...]
    variables: Mapping[str, str]


@dataclass(frozen=True)
class MachineServices(RunServices):
    """Services of ``machine``: its network monitor, and the discovery server if assigned to it."""

    deployment: Deployment
    machine: str
    logs: Path
    network: Network

    def running(self) -> AbstractContextManager[object]:
        return discovery(self.deployment, self.machine, self.logs)

    def missed(self) -> tuple[float, float] | None:
        return self.network.missed()


@contextmanager
def machine_source(
    deployment: Deployment, machine: str, logs: Path, state_folder: Path | None = None
) -> Iterator[LiveSource]:
    """Configure this process for ``machine``; return the source of its nodes, and monitor its network meanwhile.

    Machines may start in any order. ``state_folder`` overrides that of the deployment. Raises GraphError for an unknown
    machine.
    """
    enter(deployment, machine)

    def variables(nodes: Collection[str]) -> Mapping[str, str]:
        prepared: dict[str, str] = {}
        raw = any(map(deployment.raw_pictures, nodes))
        environment.prepare(prepared, across=deployment.across(machine), raw_pictures=raw)
        return {environment.DATAGRAM_VARIABLE: prepared[environment.DATAGRAM_VARIABLE]}

    with Network(deployment.address(machine)) as network:
        yield LiveSource(
            nodes=[config.name for config in deployment.half(machine)],
            state_folder=state_folder or deployment.minds,
            policy=deployment.restart,
            variables=variables,
            services=MachineServices(deployment, machine, logs, network),
        )


def discovery(deployment: Deployment, machine: str, logs: Path) -> AbstractContextManager[object]:
    """Run the discovery server of the deployment within the block, if assigned to ``machine``."""
    server = deployment.server
    if server is None or server.machine != machine or not is_own(address := deployment.address(machine)):
        return nullcontext()
    return DiscoveryServer(address, server.port, logs / "discovery_server.log", deployment.restart)


def graph_processes(
    graph: Graph, folder: Path, *, state_folder: Path | None = None, sim_time: bool = False
) -> list[NodeProcess]:
    """Return a process for each node of ``graph``, for ``ros2 launch``; they end with the caller.

    ``folder`` receives the graph file and, without a ``state_folder``, the saved state of agents.
    """
    file = write_graph(with_state_files(graph, state_folder or folder / "minds"), folder.resolve())
    prepared = dict(os.environ)
    environment.prepare(prepared)
    paths.allow(folder, prepared)
    parent = ("--parent", str(os.getpid()))
    return [
        NodeProcess(
            name=config.name,
            arguments=(*node_arguments(file, [config.name], sim_time=sim_time)[1:], *parent),
            variables=_changed(prepared),
        )
        for config in graph.placements
    ]


def machine_processes(
    deployment: Deployment, machine: str, folder: Path, graph: Graph | None = None
) -> list[NodeProcess]:
    """Return a process for each node of one machine; ``graph`` overrides that of the deployment.

    Raises GraphError for an unknown machine.
    """
    names = {config.name for config in deployment.half(machine)}
    found = []
    for process in graph_processes(graph or deployment.graph, folder, state_folder=deployment.minds):
        if process.name in names:
            prepared = dict(os.environ)
            environment.prepare(
                prepared,
                domain=deployment.domain,
                across=deployment.across(machine),
                raw_pictures=deployment.raw_pictures(process.name),
            )
            if deployment.keys is not None:
                prepared[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"
            found.append(replace(process, variables={**process.variables, **_changed(prepared)}))
    return found


def _changed(prepared: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in prepared.items() if os.environ.get(name) != value}
