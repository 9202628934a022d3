"""Deployments: assign the nodes of a graph to machines, in YAML files."""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from socialbot.bridge.driver_domain import DriverDomain
from socialbot.bridge.environment import HIGHEST_DOMAIN, Across, DomainNumber
from socialbot.core import paths
from socialbot.core.errors import GraphError, ParameterError, suggestion
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.messages import Image, Structured
from socialbot.core.process_settings import ProcessSettings
from socialbot.core.reading import read_bytes
from socialbot.core.registry import graph_names
from socialbot.core.yaml import YamlSection, read_page
from socialbot.graph.files import load_graph
from socialbot.graph.node import NODE_NAME, Graph, NodeConfig, check_parameters
from socialbot.graph.ports import TOPIC_NAME
from socialbot.runtime._processes import RestartPolicy
from socialbot.vision.image_transport import ImageReceiver, ImageSender

Transport = Literal["jpeg", "raw"]


@dataclass(frozen=True)
class Pictures:
    """Transport of an image topic between machines: raw, or JPEG with parameters of `ImageSender`."""

    transport: Transport = "jpeg"
    parameters: Mapping[str, object] = field(default_factory=dict)


def with_crossings(
    graph: Graph, places: Mapping[str, str], pictures: Mapping[str, Pictures]
) -> tuple[Graph, dict[str, str]]:
    """Insert image senders and receivers between machines; return the new graph and the machine of each node.

    Images of ``/camera/image_raw`` arrive on the machine ``desk`` as ``/camera/image_raw/desk``. Raises GraphError if
    several machines publish a topic.
    """
    crossed = dict(places)
    for topic in picture_topics(graph):
        settings = pictures.get(topic, Pictures())
        home = _home(graph, topic, places)
        if not home or settings.transport == "raw":
            continue
        subscribers = [one for one in graph.nodes if any(topic == name for name, _ in one.subscriptions)]
        for machine in sorted({crossed[one.name] for one in subscribers} - {home}):
            arrived, stem = f"{topic}/{machine}", topic.strip("~/").replace("/", "_")
            link = {"link": f"{arrived}/link", "ack": f"{arrived}/link/ack"}
            sender = NodeConfig(f"{stem}_to_{machine}", ImageSender, settings.parameters, {"image": topic, **link})
            receiver = NodeConfig(f"{stem}_at_{machine}", ImageReceiver, {}, {"image": arrived, **link})
            nodes = [_remapped(one, topic, arrived) if crossed[one.name] == machine else one for one in graph.nodes]
            graph = replace(graph, nodes=(*nodes, sender, receiver))
            crossed |= {sender.name: home, receiver.name: machine}
    return graph, crossed


def picture_topics(graph: Graph) -> list[str]:
    """The topics of raw images, sorted."""
    return sorted(topic for topic, kind in graph.topics().items() if kind is Image)


def _home(graph: Graph, topic: str, places: Mapping[str, str]) -> str:
    publishers = [one for one in graph.nodes if any(topic == name for name, _ in one.publications)]
    homes = sorted({places[one.name] for one in publishers})
    if len(homes) > 1:
        raise GraphError(
            f"images of {topic} are published on several machines: {', '.join(homes)}",
            where=f"nodes.{publishers[-1].name}",
            remedy="move the nodes to one, or remap one of them to another topic",
        )
    return homes[0] if homes else ""


def _remapped(node: NodeConfig, topic: str, new_topic: str) -> NodeConfig:
    moved = {port.name: new_topic for name, port in node.subscriptions if name == topic}
    return replace(node, remap={**node.remap, **moved})


SERVER_PORT = 11811
SPARE_PARTICIPANTS = 8  # of `up`, pages and tools on a machine, and of other programs in the ROS domain
HOST_NAME = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*")


@dataclass(frozen=True)
class Server:
    """Machine and port of a discovery server."""

    machine: str
    port: int = SERVER_PORT


@dataclass(frozen=True)
class Deployment:
    """Graph on several machines. Raises GraphError or ParameterError if it is invalid.

    Attributes:
        written: The graph without image senders and receivers.
        machines: Addresses by machine name.
        places: Machine of each node in ``written``.
        server: Discovery server; without it machines use their addresses.
        pictures: Transport by image topic.
        keys: Folder of the keys.
        open_topics: Topics of standard types that need no seal.
        minds: Folder where agents save their state for a restart.
        drivers: Domain of drivers, for commands in standard types that one node publishes.
        processes: Scheduling and memory of the processes of some nodes.
    """

    written: Graph
    machines: Mapping[str, str]
    places: Mapping[str, str]
    domain: int = 0
    server: Server | None = None
    pictures: Mapping[str, Pictures] = field(default_factory=dict)
    restart: RestartPolicy = field(default_factory=RestartPolicy)
    keys: Path | None = None
    open_topics: tuple[str, ...] = ()
    minds: Path | None = None
    drivers: DriverDomain | None = None
    processes: Mapping[str, ProcessSettings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_machines()
        self._check_places()
        self._check_pictures()
        self._check_drivers()
        for node, settings in self.processes.items():
            where = f"processes.{node}"
            _check_known(f"no node {node!r}", node, [config.name for config in self.graph.nodes], where)
            settings.check(where)
        _ = self.graph

    @property
    def graph(self) -> Graph:
        """The whole graph, with image senders and receivers."""
        return self._crossed[0]

    def half(self, machine: str) -> tuple[NodeConfig, ...]:
        """The nodes of one machine. Raises GraphError if it is unknown."""
        self.address(machine)
        graph, places = self._crossed
        return tuple(config for config in graph.nodes if places[config.name] == machine)

    def address(self, machine: str) -> str:
        """The address of a machine. Raises GraphError if it is unknown."""
        self._check_machine(machine, "machines")
        return self.machines[machine]

    def across(self, machine: str) -> Across | None:
        """The discovery settings of ``machine``; None for a single machine."""
        others = tuple(address for name, address in self.machines.items() if name != machine)
        if not others:
            return None
        if self.server is None:
            most = max(len(self.half(name)) for name in self.machines)
            return Across(peers=others, participants=most + SPARE_PARTICIPANTS)
        return Across(server=f"{self.address(self.server.machine)}:{self.server.port}")

    def raw_pictures(self, node: str) -> bool:
        """Whether the node publishes raw images, whose messages need large datagrams."""
        return any(port.message_type is Image for _, port in self.graph.node(node).publications)

    def this_machine(self) -> str:
        """The name of this machine, by its address. Raises GraphError unless exactly one matches."""
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
            raise GraphError("no machines", where="machines", remedy="name one: laptop: {address: 127.0.0.1}")
        for name, address in self.machines.items():
            where = f"machines.{name}"
            if not NODE_NAME.fullmatch(name):
                raise GraphError(
                    f"{name!r} is not a valid machine name", where=where, remedy="use letters, digits and _"
                )
            if not is_address(address):
                remedy = "give an IPv4 address, or a host name"
                what = "an IPv6 address, which ROS 2 does not resolve" if ":" in address else "not a valid address"
                raise GraphError(f"{address!r} is {what}", where=where, remedy=remedy)
            if list(self.machines.values()).count(address) > 1:
                raise GraphError(f"two machines have the address {address}", where=where, remedy="correct one of them")
        if not 0 <= self.domain <= HIGHEST_DOMAIN:
            remedy = f"give a number from 0 to {HIGHEST_DOMAIN}"
            raise GraphError(f"{self.domain} is not a ROS domain", where="domain", remedy=remedy)
        if self.server is not None:
            self._check_machine(self.server.machine, "discovery.server")

    def _check_machine(self, machine: str, where: str) -> None:
        _check_known(f"no machine {machine!r}", machine, self.machines, where)

    def _check_places(self) -> None:
        nodes = [config.name for config in self.written.nodes]
        for node, machine in self.places.items():
            _check_known(f"{self.written.name} has no node {node!r}", node, nodes, f"nodes.{node}")
            self._check_machine(machine, f"nodes.{node}")
        if missing := [node for node in nodes if node not in self.places]:
            remedy = f"add {missing[0]}: {next(iter(self.machines))}"
            raise GraphError(f"nodes without a machine: {', '.join(missing)}", where="nodes", remedy=remedy)

    def _check_pictures(self) -> None:
        for topic, pictures in self.pictures.items():
            where = f"pictures.{topic}"
            _check_known(f"{topic!r} is not an image topic", topic, picture_topics(self.written), where)
            check_parameters(ImageSender, pictures.parameters, where=where)

    def _check_drivers(self) -> None:
        if self.drivers is None:
            return
        where = "security.drivers"
        if self.drivers.domain == self.domain:
            remedy = f"give another number from 0 to {HIGHEST_DOMAIN}"
            raise GraphError(f"{self.domain} is the domain of the graph", where=where, remedy=remedy)
        if not self.drivers.topics:
            raise GraphError("no topics", where=where, remedy="write {domain: 43, topics: [/head/trajectory]}")
        standard = {name for name, kind in self.written.topics().items() if not issubclass(kind, Structured)}
        called = {name for one in self.written.nodes for name, _ in one.clients}
        for topic in sorted(self.drivers.topics):
            what = f"{topic!r} is not a topic of a standard type, and no service or action that a node calls"
            _check_known(what, topic, sorted(standard | called), where)
            senders = [one.name for one in self.written.nodes if topic in dict((*one.publications, *one.clients))]
            if len(senders) != 1:
                verb = "called" if topic in called else "published"
                raise GraphError(
                    f"{topic} is {verb} by {' and '.join(senders) or 'no node of the graph'}",
                    where=where,
                    remedy="let one node send the commands of a driver",
                )


def _check_known(what: str, name: str, known: Iterable[str], where: str) -> None:
    """Raise GraphError with ``what`` and a suggestion, unless ``name`` is ``known``."""
    if name not in known:
        raise GraphError(what, where=where, remedy=suggestion(name, known))


def is_address(text: str) -> bool:
    """Whether ``text`` is an IPv4 address or a valid host name."""
    if re.fullmatch(r"[0-9.]+", text):
        try:
            ipaddress.IPv4Address(text)
        except ValueError:
            return False
        return True
    return len(text) <= 253 and HOST_NAME.fullmatch(text) is not None


def is_own(address: str) -> bool:
    """Whether ``address`` belongs to this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        try:
            own.bind((address, 0))
        except OSError:
            return False
    return True


_Topic = Annotated[
    str, msgspec.Meta(pattern=TOPIC_NAME.pattern, description="a full topic name; write it as in /camera/image_raw")
]


class _Machine(msgspec.Struct):
    address: str


class _Server(msgspec.Struct):
    server: str


_Discovery = Annotated[Literal["peers"] | _Server, msgspec.Meta(description="peers, or {server: MACHINE}")]


class _Pictures(msgspec.Struct):
    transport: Transport = "jpeg"
    quality: Any = msgspec.UNSET
    least_quality: Any = msgspec.UNSET
    rate_hz: Any = msgspec.UNSET

    def pictures(self) -> Pictures:
        given = {name: value for name, value in msgspec.structs.asdict(self).items() if value is not msgspec.UNSET}
        return Pictures(given.pop("transport"), given)


class _Security(msgspec.Struct):
    keys: str
    open: tuple[_Topic, ...] = ()
    drivers: DriverDomain | None = None


class _Page(msgspec.Struct):
    graph: str
    machines: dict[str, _Machine]
    nodes: dict[str, str]
    domain: DomainNumber = 0
    discovery: _Discovery = "peers"
    pictures: dict[str, _Pictures] = {}
    restart: RestartPolicy = RestartPolicy()
    processes: dict[str, ProcessSettings] = {}
    security: _Security | None = None
    minds: str | None = None
    parameters: dict[str, dict[str, Any]] = {}
    robot: str = ""


def is_deployment(name: str) -> bool:
    """Whether ``name`` is a deployment file instead of a graph."""
    if name in graph_names():
        return False
    try:
        text = paths.decoded(read_bytes(name, TEXT_BYTES))
    except (OSError, UnicodeDecodeError):
        return False
    return any(line.startswith(("machines:", "machines :", '"machines"', "'machines'")) for line in text.splitlines())


def load_deployment(path: Path, *, robot: str = "") -> Deployment:
    """Load a deployment file, whose folder nodes may read and write; ``robot`` replaces the profile that it names.

    Raises GraphError or ParameterError.
    """
    text = paths.read_text(path, GraphError)
    folder = path.resolve().parent
    paths.allow(folder)
    return parse_deployment(text, where=str(path), folder=folder, robot=robot)


def parse_deployment(text: str, *, where: str, folder: Path, robot: str = "") -> Deployment:
    """Parse a deployment from YAML. Errors name the source ``where``; relative paths start at ``folder``."""
    root = read_page(text, where=where)
    page = root.read(_Page)
    graph = _graph(root, page, folder, robot)
    try:
        return Deployment(
            written=graph,
            machines={name: machine.address for name, machine in page.machines.items()},
            places=page.nodes,
            domain=page.domain,
            server=_server(root, page.discovery),
            pictures={topic: one.pictures() for topic, one in page.pictures.items()},
            restart=page.restart,
            open_topics=page.security.open if page.security else (),
            keys=folder / page.security.keys if page.security else None,
            processes=page.processes,
            drivers=page.security.drivers if page.security else None,
            minds=None if page.minds is None else folder / page.minds,
        )
    except (GraphError, ParameterError) as error:
        first, _, rest = (error.where or "").partition(".")
        if first not in root.page:
            raise
        name, _, setting = rest.rpartition(".")
        place = root.line(first, name, setting) if name else root.line(first, rest)
        raise type(error)(error.what, where=place, remedy=error.remedy) from error


def _graph(root: YamlSection, page: _Page, folder: Path, robot: str) -> Graph:
    name = page.graph
    beside = page.robot and os.path.isfile(folder / page.robot)
    robot = robot or (str(folder / page.robot) if beside else page.robot)
    try:
        graph = load_graph(name if name in graph_names() else str(folder / name), robot=robot)
    except GraphError as error:
        if name in graph_names() or os.path.isfile(folder / name):
            raise
        raise GraphError(
            f"no graph {name!r}", where=root.line("graph"), remedy=suggestion(name, graph_names())
        ) from error
    for node, values in page.parameters.items():
        names = [config.name for config in graph.nodes]
        _check_known(f"no node {node!r}", node, names, root.line("parameters", node))
        for name, value in values.items():
            check_parameters(graph.node(node).type, {name: value}, where=root.line("parameters", node, name))
    return graph.with_parameters(page.parameters)


def _server(root: YamlSection, discovery: str | _Server) -> Server | None:
    if isinstance(discovery, str):
        return None
    machine, colon, port = discovery.server.partition(":")
    if colon and not (re.fullmatch("[0-9]{1,5}", port) and 0 < int(port) < 65536):
        remedy = f"write MACHINE or MACHINE:{SERVER_PORT}"
        raise GraphError(f"{port!r} is not a port", where=root.line("discovery", "server"), remedy=remedy)
    return Server(machine, int(port) if colon else SERVER_PORT)
