"""Run the nodes of one machine of a deployment, and watch its network."""

from __future__ import annotations

import ipaddress
import logging
import math
import os
import socket
import threading
import time
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console

from socialbot.bridge import environment
from socialbot.bridge.diagnostics import MACHINE_VARIABLE
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.graph.node import Graph
from socialbot.runs.record import RunTrace
from socialbot.runtime.deployment import Deployment, is_own
from socialbot.runtime.discovery_server import DiscoveryServer
from socialbot.runtime.live import Surroundings, run_live


def enter(deployment: Deployment, machine: str) -> None:
    """Makes this process one of ``machine``: its ROS domain, the way to the others, its key and its name.

    Call it before rclpy starts. Raises GraphError for an unknown machine.
    """
    deployment.address(machine)
    environment.prepare(domain=deployment.domain, across=deployment.across(machine))
    os.environ[MACHINE_VARIABLE] = machine
    if deployment.keys is not None:
        os.environ[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"


LOOK_AGAIN_S = 0.5

UNCERTAIN_S = 5.0
"""Who starts looks for networks within this time."""

log = logging.getLogger("socialbot.network")


class Network:
    """Looks whether ``address`` is there, from a thread of its own, as to look a name up may take long.

    Use it as a context manager. It says so when the address is not there at first.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._wanted: frozenset[str] = frozenset()
        self._missed: tuple[float, float] | None = None
        self._one_at_a_time = threading.Lock()
        self._away = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="network", daemon=True)

    def __enter__(self) -> Network:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()

    def missed(self) -> tuple[float, float] | None:
        """When it has come since this was asked last: who started between these times (monotonic s) has missed it."""
        with self._one_at_a_time:
            missed, self._missed = self._missed, None
        return missed

    def _watch(self) -> None:
        seen = -math.inf
        self._away = not self._is_up()
        if self._away:
            log.warning("%s is not up on this machine: others cannot be reached without", self._address)
        while not self._closed.wait(LOOK_AGAIN_S):
            is_up, now = self._is_up(), time.monotonic()
            if is_up and self._away:
                log.warning("%s is up now", self._address)
                with self._one_at_a_time:  # who asks seldom is told of all times together
                    self._missed = (self._missed[0] if self._missed else seen - UNCERTAIN_S, now)
            if is_up:
                seen = now
            self._away = not is_up

    def _is_up(self) -> bool:
        """Whether the address is one of this machine's, and its network is up."""
        try:
            own = own_addresses()
        except OSError as error:  # such as too many open files
            log.debug("this machine's addresses are not known now: %s", error)
            return not self._away
        if self._wanted.isdisjoint(own):  # what a name stands for may not be known yet, or may have changed
            self._wanted = addresses_of(self._address) or self._wanted
        if self._wanted and not beyond(self._wanted):  # its own name: any network by which others may come counts
            return bool(own & self._wanted or beyond(own))
        return not self._wanted.isdisjoint(own)


def addresses_of(name: str) -> frozenset[str]:
    """The IPv4 addresses that ``name`` stands for, as far as that is known now."""
    try:
        found = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError:
        return frozenset()
    return frozenset(str(address[0]) for *_, address in found)


def own_addresses() -> frozenset[str]:
    """The IPv4 addresses of this machine whose networks are up: they run, as a cable is plugged in, or Wi-Fi joined."""
    states = psutil.net_if_stats()
    return frozenset(
        each.address
        for name, addresses in psutil.net_if_addrs().items()
        for each in addresses
        if each.family == socket.AF_INET and _is_running(states.get(name.partition(":")[0]))  # eth0:1 is one of eth0
    )


def beyond(addresses: frozenset[str]) -> frozenset[str]:
    """Those that do not just reach this machine, as that does which its own name often stands for (127.0.1.1)."""
    return frozenset(address for address in addresses if not ipaddress.IPv4Address(address).is_loopback)


def _is_running(states: Any) -> bool:
    return states is not None and "running" in states.flags.split(",")


def run_machine(
    deployment: Deployment,
    machine: str,
    record: RunTrace,
    console: Console,
    graph: Graph | None = None,
    minds: Path | None = None,
) -> None:
    """Runs the nodes of ``machine`` until SIGINT, SIGTERM or ``socialbot down``; what dies is started again.

    Others may start before or after. What its nodes say and hear is recorded and shown. ``graph`` is that of the
    deployment, with changes; ``minds`` is a folder for minds instead of the deployment's. The discovery server runs
    along where it belongs on this machine. Raises GraphError for an unknown machine, and what
    `socialbot.runtime.live.run_live` does.
    """
    names = [placement.name for placement in deployment.half(machine)]
    enter(deployment, machine)

    def variables(nodes: Collection[str]) -> Mapping[str, str]:
        prepared: dict[str, str] = {}
        raw = any(map(deployment.raw_pictures, nodes))
        environment.prepare(prepared, across=deployment.across(machine), raw_pictures=raw)
        return {environment.DATAGRAM_VARIABLE: prepared[environment.DATAGRAM_VARIABLE]}

    with Network(deployment.address(machine)) as network:
        run_live(
            graph or deployment.graph,
            record,
            console,
            policy=deployment.restart,
            nodes=names,
            variables=variables,
            minds=minds or deployment.minds,
            surroundings=OnNetwork(deployment, machine, record.folder / "log", network),
        )


@dataclass(frozen=True)
class OnNetwork(Surroundings):
    """The surroundings of ``machine`` in a deployment: its network, and the discovery server if that belongs there."""

    deployment: Deployment
    machine: str
    logs: Path
    network: Network

    def there(self) -> AbstractContextManager[object]:
        return discovery(self.deployment, self.machine, self.logs)

    def missed(self) -> tuple[float, float] | None:
        return self.network.missed()


def discovery(deployment: Deployment, machine: str, logs: Path) -> AbstractContextManager[object]:
    """The discovery server of the deployment for as long as the block lasts, if it belongs on this ``machine``."""
    server = deployment.server
    if server is None or server.machine != machine or not is_own(address := deployment.address(machine)):
        return nullcontext()
    return DiscoveryServer(address, server.port, logs / "discovery_server.log", deployment.restart)
