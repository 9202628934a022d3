"""What a deployment is: a graph, machines, and the machine on which each node runs."""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from socialbot.bridge.environment import HIGHEST_DOMAIN, Across
from socialbot.bridge.restarting import RestartPolicy
from socialbot.deployment.crossing import Pictures, picture_topics, publishes_pictures, with_crossings
from socialbot.errors import GraphError
from socialbot.graph import NODE_NAME, Graph, Placement, check_parameters, suggestion
from socialbot.vision.picture_sender import PictureSender

SERVER_PORT = 11811
HOST_NAME = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*")


@dataclass(frozen=True)
class Server:
    """A discovery server: the machine that it runs on, and its port."""

    machine: str
    port: int = SERVER_PORT


@dataclass(frozen=True)
class Deployment:
    """A graph on several machines.

    ``written`` is the graph without what is put in for its crossings, ``machines`` their addresses by name and
    ``places`` the machine of each node of it. Machines find each other by their addresses, or by a ``server``.
    ``pictures`` says how topics cross, ``keys`` is the folder of keys, ``minds`` that in which agents keep what they go
    on with after a restart. Errors are GraphErrors and ParameterErrors; they name their place as a path of keys, such
    as ``nodes.camera``.
    """

    written: Graph
    machines: Mapping[str, str]
    places: Mapping[str, str]
    domain: int = 0
    server: Server | None = None
    pictures: Mapping[str, Pictures] = field(default_factory=dict)
    restart: RestartPolicy = field(default_factory=RestartPolicy)
    keys: Path | None = None
    minds: Path | None = None

    def __post_init__(self) -> None:
        self._check_machines()
        self._check_places()
        self._check_pictures()
        _ = self.graph

    @property
    def graph(self) -> Graph:
        """The whole graph, with the nodes that carry pictures from machine to machine."""
        return self._crossed[0]

    def half(self, machine: str) -> tuple[Placement, ...]:
        """The nodes of one machine. Raises GraphError when there is no such machine."""
        self.address(machine)
        graph, places = self._crossed
        return tuple(placement for placement in graph.placements if places[placement.name] == machine)

    def address(self, machine: str) -> str:
        """Its address. Raises GraphError when there is no such machine."""
        if machine not in self.machines:
            raise GraphError(f"no machine {machine!r}", where="machines", remedy=suggestion(machine, self.machines))
        return self.machines[machine]

    def across(self, machine: str) -> Across | None:
        """How nodes on ``machine`` find those of the others; None where there are no others."""
        others = tuple(address for name, address in self.machines.items() if name != machine)
        if not others:
            return None
        if self.server is None:
            return Across(peers=others)
        return Across(server=f"{self.address(self.server.machine)}:{self.server.port}")

    def raw_pictures(self, node: str) -> bool:
        """Whether the node of this name publishes raw pictures, so that its messages must not be cut small."""
        return publishes_pictures(self.graph.placement(node))

    def this_machine(self) -> str:
        """The machine that has an address of the one this runs on. Raises GraphError unless that is just one."""
        found = [name for name, address in self.machines.items() if is_own(address)]
        if len(found) == 1:
            return found[0]
        listed = ", ".join(f"{name} ({address})" for name, address in self.machines.items())
        what = f"this could be {' or '.join(found)}" if found else "this machine has none of the addresses"
        raise GraphError(f"{what}: {listed}", where="machines", remedy="say which it is: --machine NAME")

    @cached_property
    def _crossed(self) -> tuple[Graph, dict[str, str]]:
        return with_crossings(self.written, self.places, self.pictures)

    def _check_machines(self) -> None:
        if not self.machines:
            raise GraphError("there is no machine", where="machines", remedy="name one: laptop: {address: 127.0.0.1}")
        for name, address in self.machines.items():
            where = f"machines.{name}"
            if not NODE_NAME.fullmatch(name):
                raise GraphError(f"no name for a machine: {name!r}", where=where, remedy="use letters, digits and _")
            if not is_address(address):
                raise GraphError(
                    f"no address: {address!r}", where=where, remedy="give an IPv4 address, or the name of a host"
                )
            if list(self.machines.values()).count(address) > 1:
                raise GraphError(f"two machines have the address {address}", where=where, remedy="correct one of them")
        if not 0 <= self.domain <= HIGHEST_DOMAIN:
            raise GraphError(
                f"no ROS domain: {self.domain}", where="domain", remedy=f"give a number from 0 to {HIGHEST_DOMAIN}"
            )
        if self.server is not None and self.server.machine not in self.machines:
            raise GraphError(
                f"no machine {self.server.machine!r}",
                where="discovery.server",
                remedy=suggestion(self.server.machine, self.machines),
            )

    def _check_places(self) -> None:
        nodes = [placement.name for placement in self.written.placements]
        for node, machine in self.places.items():
            where = f"nodes.{node}"
            if node not in nodes:
                raise GraphError(
                    f"{self.written.name} has no node {node!r}", where=where, remedy=suggestion(node, nodes)
                )
            if machine not in self.machines:
                raise GraphError(f"no machine {machine!r}", where=where, remedy=suggestion(machine, self.machines))
        if missing := [node for node in nodes if node not in self.places]:
            raise GraphError(
                f"nothing says where these run: {', '.join(missing)}",
                where="nodes",
                remedy=f"add {missing[0]}: {next(iter(self.machines))}",
            )

    def _check_pictures(self) -> None:
        topics = picture_topics(self.written)
        for topic, pictures in self.pictures.items():
            where = f"pictures.{topic}"
            if topic not in topics:
                raise GraphError(f"no topic of pictures: {topic!r}", where=where, remedy=suggestion(topic, topics))
            check_parameters(PictureSender, pictures.parameters, where=where)


def is_address(text: str) -> bool:
    """Whether ``text`` is an IPv4 address or may be the name of a host."""
    if re.fullmatch(r"[0-9.]+", text):
        try:
            ipaddress.IPv4Address(text)
        except ValueError:
            return False
        return True
    return len(text) <= 253 and HOST_NAME.fullmatch(text) is not None


def is_own(address: str) -> bool:
    """Whether ``address`` belongs to the machine that this runs on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        try:
            own.bind((address, 0))
        except OSError:
            return False
    return True
