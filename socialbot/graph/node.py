"""Nodes with typed inputs, outputs and parameters, and graphs that connect them by topics.

A node is a plain class without ROS::

    class Echo(Node):
        \"\"\"Publish the recognized speech as an utterance.\"\"\"

        heard = Input(Utterance, "/speech/heard")
        say = Output(Utterance, "/speech/say")
        volume = Parameter(0.5, "loudness", minimum=0.0, maximum=1.0)

        @heard
        def on_heard(self, message: Utterance) -> None:
            self.say.publish(message)

The runners (`socialbot.graph.inline`, ``socialbot.bridge._host``) provide clock, timers and connections. They call a
node from one thread at a time.
"""

from __future__ import annotations

import logging
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeVar

from socialbot.core.clock import Clock, nanoseconds
from socialbot.core.errors import (
    PACKAGE,
    GraphError,
    NodeError,
    ParameterError,
    RuleError,
    SocialbotError,
    described,
    place_of,
    suggestion,
)
from socialbot.core.lazy import RenamedAttribute
from socialbot.core.messages import Message, RosMessage, State
from socialbot.graph.calls import Channel
from socialbot.graph.ports import NODE_NAME, TOPIC_NAME, Delivery, Input, Output, Parameter
from socialbot.graph.services import ClientPort, ServerPort, check_services, recorded_topic
from socialbot.graph.wizard import WizardKey

if TYPE_CHECKING:
    from socialbot.graph.health import HealthMonitor

M = TypeVar("M", bound=Message)
V = TypeVar("V", bool, int, float, str)
H = TypeVar("H", bound=Callable[..., None])
R = TypeVar("R")

_LINE = re.compile(r":\d+\b")
"""Part of a location with a line."""

WireForm = Literal["json", "typed"]
"""Encoding of structured messages over ROS: JSON in std_msgs/String, or socialbot_msgs."""


class Timer:
    """A pending call; the runner makes it unless its ``callback`` is None."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        """Cancel the call; no effect after it was made."""
        self.callback = None


class Context(Protocol):
    """Interface of a runner to one node."""

    @property
    def clock(self) -> Clock:
        """The clock of the node."""
        ...

    @property
    def health_monitor(self) -> HealthMonitor:
        """The health monitor of the node."""
        ...

    def publish(self, port: Output[Any], message: Message) -> None:
        """Publish ``message`` on ``port``."""
        ...

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        """Call ``callback`` once in the thread of the node, at ``time`` (ns)."""
        ...

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` in the thread of the node as soon as possible; thread-safe."""
        ...

    @property
    def channel(self) -> Callable[[ClientPort], Channel]:
        """Function that returns the connection to the servers of a client."""
        ...

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        """Run ``work`` in a thread of its own, then call ``then`` with its result or exception.

        ``work`` must not access the node. In simulated time it takes no time.
        """
        ...


class Node:
    """Unit of a graph. Subclasses declare ports and parameters as class attributes."""

    is_simulator: ClassVar[bool] = False
    """Whether the node simulates the world. A replay omits it and uses its recorded messages."""

    watches_outside: ClassVar[bool] = False
    """Whether the node watches a node outside the graph by its services. Replays use its recorded messages;
    simulations omit it, unless a stand-in offers one of its services."""

    is_agent: ClassVar[bool] = False
    """Whether the node runs an agent, which accepts commands."""

    deliberates: ClassVar[bool] = False
    """Whether its trace records desires and plans."""

    display_name: ClassVar[str] = ""
    """Name of an agent for people; empty: its name in the graph."""

    phrases: ClassVar[Mapping[str, str]] = {}
    """Sentences for the actions of an agent, by action name, with arguments as {0}, {1}: ``"opens {1}"``."""

    _inputs: ClassVar[Mapping[str, Input[Any]]] = {}
    _outputs: ClassVar[Mapping[str, Output[Any]]] = {}
    _parameters: ClassVar[Mapping[str, Parameter[Any]]] = {}
    _servers: ClassVar[Mapping[str, ServerPort]] = {}
    _clients: ClassVar[Mapping[str, ClientPort]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        _check_names(cls)
        cls._inputs, cls._outputs = _declared(cls, Input), _declared(cls, Output)
        cls._servers, cls._clients = _declared(cls, ServerPort), _declared(cls, ClientPort)
        cls._parameters = _declared(cls, Parameter)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Check and set ``parameters``. Raises ParameterError."""
        self.name = name
        self.context = context
        self.log = logging.getLogger(f"socialbot.{name}")
        self.parameter_values = check_parameters(type(self), parameters or {}, where=name)

    @classmethod
    def inputs(cls) -> Mapping[str, Input[Any]]:
        """The inputs by name."""
        return cls._inputs

    @classmethod
    def outputs(cls) -> Mapping[str, Output[Any]]:
        """The outputs by name."""
        return cls._outputs

    @classmethod
    def parameters(cls) -> Mapping[str, Parameter[Any]]:
        """The parameters by name."""
        return cls._parameters

    @classmethod
    def servers(cls) -> Mapping[str, ServerPort]:
        """The services and actions that the node offers, by attribute name."""
        return cls._servers

    @classmethod
    def clients(cls) -> Mapping[str, ClientPort]:
        """The services and actions that the node calls, by attribute name."""
        return cls._clients

    @classmethod
    def expect_available(cls, parameters: Mapping[str, object]) -> None:
        """Raise DeviceError if a node with these parameters could not start on this machine: a file is missing."""

    @classmethod
    def external_files(cls, parameters: Mapping[str, object]) -> Sequence[Path] | None:
        """Files that the outputs depend on, beside the input messages and ``parameters``.

        None if the outputs depend on anything else, such as a device, timers, services or random numbers. The outputs
        of other nodes may come from a cache in a replay, if the class itself defines this method. A subclass has to
        define it again.
        """
        return None

    @classmethod
    def longest_step_s(cls, parameters: Mapping[str, Any]) -> float:
        """Longest step of simulated time (s) of a simulator, by default its parameter ``period_s``.

        In a longer step it would publish several messages of a topic at once, or fewer than it should.
        """
        return float(parameters.get("period_s", math.inf))

    @property
    def clock(self) -> Clock:
        return self.context.clock

    def call_after(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Call ``callback`` once after ``seconds``."""
        return self.context.call_at(self.clock.now() + nanoseconds(seconds), checked_callback(callback))

    def set_parameter(self, name: str, value: object) -> None:
        """Change a parameter at run time.

        Raises ParameterError if it is unknown, fixed or invalid, and any error of `on_parameter`.
        """
        checked = check_parameters(type(self), {name: value}, where=self.name)
        if self._parameters[name].fixed:
            raise ParameterError("can only be set before the node starts", where=f"{self.name}.{name}")
        before = self.parameter_values[name]
        self.parameter_values[name] = checked[name]
        try:
            self.on_parameter(name)
        except Exception:
            self.parameter_values[name] = before
            raise

    def start(self) -> None:
        """Called once, after all connections are made."""

    def stop(self) -> None:
        """Called once at the end; releases devices and files."""

    def on_parameter(self, name: str) -> None:
        """Called after a parameter has changed; an exception reverts the change."""

    def deadline_s(self, port: Input[Any]) -> float:
        """The deadline (s) of ``port``; 0 for none."""
        return port.deadline_s

    def counts(self, port: Input[Any], message: Message) -> bool:
        """Whether ``message`` counts for the deadline of ``port``. Called from another thread."""
        return True

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        """Called when an input becomes silent; ``since`` is the time (ns) of its last message, or None."""

    def on_return(self, port: Input[Any]) -> None:
        """Called when a silent input is back, before its message is delivered."""

    def on_server(self, port: ClientPort, *, present: bool) -> None:
        """Called when a service or action that is not optional has no server, and when the server is back."""

    def report_health(self, state: State, reason: str = "") -> None:
        """Report the health of the node until the next call. The runner adds its silent inputs."""
        self.context.health_monitor.say(state, reason)

    say_health = RenamedAttribute("report_health")


def make_node(config: NodeConfig, context: Context, parameters: Mapping[str, object]) -> Node:
    """Return a new node. Raises GraphError if its class leaves out the initialisation of `Node`."""
    node = config.type(config.name, context, parameters)
    if "context" not in vars(node):
        what = f"{config.type.__name__}.__init__ does not initialise its base class"
        remedy = "begin it with: super().__init__(name, context, parameters)"
        raise GraphError(what, where=config.place(config.type.__module__), remedy=remedy)
    return node


def checked_callback(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``callback``. Raises TypeError if it is no function, but the result of one."""
    if not callable(callback):
        raise TypeError(f"the callback is {callback!r}, no function: pass the function itself, without parentheses")
    return callback


def outcome(work: Callable[[], R]) -> R | Exception:
    """Return the result or exception of ``work``, as runners pass it to the callback of `Context.run_in_background`."""
    try:
        return work()
    except Exception as error:  # noqa: BLE001 - whatever it is, the node decides what to do about it
        return error


def failure_text(error: Exception, *rooms: str) -> str:
    """Return type, message and place of an exception of a node; frames of this room and of ``rooms`` are no place."""
    return described(error, os.path.dirname(__file__), *rooms)


def start_failure(node: str, error: Exception, *rooms: str) -> SocialbotError:
    """Return the error of a node that cannot start; ``rooms`` as in `failure_text`.

    An error of socialbot without a line gets the line of the node's own code that led to it, such as a wrong rule.
    """
    if isinstance(error, SocialbotError):
        if error.where is None or (isinstance(error, RuleError) and not _LINE.search(error.where)):
            error.where = ": ".join(filter(None, (place_of(error, PACKAGE), node, error.where)))
        return error
    return NodeError(f"cannot start: {failure_text(error, *rooms)}", where=node)


_KINDS: Mapping[Any, str] = {
    Input: "input",
    Output: "output",
    Parameter: "parameter",
    ServerPort: "service or action",
    ClientPort: "client",
}
_INSTANCE_ATTRIBUTES = frozenset(("name", "context", "log", "parameter_values"))
_ROS_PARAMETERS = frozenset(("autostart", "use_sim_time"))
"""Parameters that every node has over ROS."""


def _kind(declared: object) -> str:
    return next((name for kind, name in _KINDS.items() if isinstance(declared, kind)), "")


def _check_names(cls: type) -> None:
    """Check that a port or parameter replaces only one of its kind. Raises GraphError."""
    for name, declared in vars(cls).items():
        kind = _kind(declared)
        what = f"the {kind} {name!r}" if kind else f"{name!r}"
        place = f"{cls.__module__}.{cls.__qualname__}"
        if kind == "parameter" and name in _ROS_PARAMETERS:
            raise GraphError(f"{what} replaces that of each ROS node", where=place, remedy="give it another name")
        owner = next((base for base in cls.__mro__[1:] if name in vars(base)), None)
        before = "" if owner is None else _kind(vars(owner)[name])
        if kind and name in _INSTANCE_ATTRIBUTES:
            owner = Node
        if owner is not None and kind != before:
            remedy = "give it another name"
            if before == "parameter" and not kind:
                remedy = f"write {name} = Parameter({declared!r}, ...), or give it another name"
            of = f"the {before or 'attribute'} of that name of {owner.__name__}"
            raise GraphError(f"{what} replaces {of}", where=place, remedy=remedy)


def _declared(cls: type, kind: Any) -> dict[str, Any]:
    """Return the ports or parameters of a class and its base classes, those of base classes first."""
    pairs = (pair for base in reversed(cls.__mro__) for pair in vars(base).items())
    return {name: value for name, value in pairs if isinstance(value, kind)}


def check_parameters(node_type: type[Node], given: Mapping[str, object], *, where: str) -> dict[str, Any]:
    """Return all parameters of ``node_type``: the defaults, and the ``given`` values after a check."""
    declared = node_type.parameters()
    values = {name: parameter.default for name, parameter in declared.items()}
    for name, value in given.items():
        if name not in declared:
            raise ParameterError(f"no parameter {name!r}", where=where, remedy=suggestion(name, declared))
        values[name] = declared[name].check(value, where=f"{where}.{name}")
    return values


def check_topic(topic: str, where: str) -> None:
    """Check the full name of a topic, service or action. Raises GraphError."""
    if not TOPIC_NAME.fullmatch(topic):
        remedy = "begin with /, and use names of letters, digits and _, at most 228 characters in all"
        raise GraphError(f"no valid topic: {topic!r}", where=where, remedy=remedy)


@dataclass(frozen=True)
class NodeConfig:
    """Configuration of a node: name, type, parameters and remapped topics."""

    name: str
    type: type[Node]
    parameters: Mapping[str, object] = field(default_factory=dict)
    remap: Mapping[str, str] = field(default_factory=dict)
    where: str = field(default="", compare=False)
    """File and line, for errors."""
    receivers: Mapping[str, tuple[str, ...]] = field(default_factory=dict, compare=False)
    """Known receivers of each output with one topic per receiver; a graph sets them."""

    def place(self, graph: str) -> str:
        """The location for errors: file and line if known, else ``graph``, then the name of the node."""
        return f"{self.where or graph}: {self.name}"

    def check(self, graph: str) -> None:
        """Check ports and parameters. Raises GraphError or ParameterError."""
        place = self.place(graph)
        if not NODE_NAME.fullmatch(self.name):
            remedy = "use letters, digits and _, at most 200 of them"
            raise GraphError("no valid name for a node", where=place, remedy=remedy)
        kind = self.type
        ports = {**kind.inputs(), **kind.outputs(), **kind.servers(), **kind.clients()}
        for port in self.remap:
            if port not in ports:
                raise GraphError(f"no input or output {port!r}", where=place, remedy=suggestion(port, ports))
        for name, port in ports.items():
            check_topic(self.topic(port, "receiver"), f"{place}.{name}")
        for port in kind.inputs().values():
            if not port.handler:
                remedy = f"decorate the method that handles its messages with @{port.name}"
                raise GraphError(f"the input {port.name!r} has no handler", where=place, remedy=remedy)
        check_parameters(kind, self.parameters, where=place)

    def topic(self, port: Input[Any] | Output[Any] | ServerPort | ClientPort, receiver: str = "") -> str:
        """The full topic of ``port``; with one topic per receiver, that of ``receiver``.

        The prefix ``~/`` is the namespace of the node: ``~/state`` of the node ``arm`` is ``/arm/state``.
        """
        topic = self.remap.get(port.name, port.topic)
        if receiver and isinstance(port, Output):
            topic = topic.replace(f"{{{port.addressed_by}}}", receiver)
        if topic.startswith("~/"):
            return f"/{self.name}{topic[1:]}"
        return topic if topic.startswith("/") else f"/{topic}"

    @property
    def subscriptions(self) -> list[tuple[str, Input[Any]]]:
        """Topic and port of each input."""
        return [(self.topic(port), port) for port in self.type.inputs().values()]

    @property
    def publications(self) -> list[tuple[str, Output[Any]]]:
        """Topic and port of each output; with one topic per receiver, those of the known receivers."""
        return [
            (self.topic(port, receiver), port)
            for port in self.type.outputs().values()
            for receiver in (self.receivers.get(port.name, ()) if port.addressed_by else ("",))
        ]

    @property
    def servers(self) -> list[tuple[str, ServerPort]]:
        """Name and port of each service and action that the node offers."""
        return [(self.topic(port), port) for port in self.type.servers().values()]

    @property
    def clients(self) -> list[tuple[str, ClientPort]]:
        """Name and port of each service and action that the node calls."""
        return [(self.topic(port), port) for port in self.type.clients().values()]


@dataclass(frozen=True)
class Graph:
    """Graph of nodes that are connected by topics.

    Attributes:
        inputs: External topics, of a robot's own driver or a bag.
        paced_by: Topic that answers each camera frame; a replay waits for it, so it drops no frames.
        wire: Encoding of structured messages over ROS; invisible to nodes.
        standard: Whether a run over ROS publishes detections and speech in standard ROS types, too.
        services: Services and actions of nodes outside the graph.
        stand_ins: Nodes that offer such services where there is no robot: in replays, simulations and tests.
        wizard: Keys of the run page for a person behind the scenes.
    """

    name: str
    nodes: tuple[NodeConfig, ...]
    inputs: frozenset[str] = frozenset()
    paced_by: str = ""
    wire: WireForm = "json"
    standard: bool = False
    services: frozenset[str] = frozenset()
    stand_ins: tuple[NodeConfig, ...] = ()
    wizard: tuple[WizardKey, ...] = ()

    placements = RenamedAttribute("nodes")
    placement = RenamedAttribute("node")

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", tuple(self._with_receivers()))
        object.__setattr__(self, "nodes", tuple(self._with_own_ids()))
        self.check()

    def _with_receivers(self) -> Iterator[NodeConfig]:
        """The nodes; those with outputs of one topic per receiver know the receivers in this graph."""
        listening: dict[str, set[str]] = {}
        for config in self.nodes:
            ports = [port for port in config.type.outputs().values() if port.addressed_by]
            if ports and not listening:
                listening = {each.name: {topic for topic, _ in each.subscriptions} for each in self.nodes}
            known = dict(config.receivers)
            for port in ports:
                found = (name for name, topics in listening.items() if config.topic(port, name) in topics)
                known[port.name] = tuple(dict.fromkeys((*known.get(port.name, ()), *found)))
            yield replace(config, receivers=known) if known != config.receivers else config

    def _with_own_ids(self) -> Iterator[NodeConfig]:
        """The nodes; a second detector without an ``id_prefix`` begins its ids with its name."""
        known: set[object] = set()
        for config in self.nodes:
            if (declared := config.type.parameters().get("id_prefix")) is None:
                yield config
                continue
            prefix = config.parameters.get("id_prefix", declared.default)
            if prefix in known and "id_prefix" not in config.parameters:
                prefix = f"{config.name}_"
                config = replace(config, parameters={**config.parameters, "id_prefix": prefix})
            known.add(prefix)
            yield config

    def check(self) -> None:
        """Check the graph. Raises GraphError or ParameterError."""
        configs = (*self.nodes, *self.stand_ins)
        names = [config.name for config in configs]
        for name, count in Counter(names).items():
            if count > 1:
                raise GraphError(f"two nodes are called {name!r}", where=self.name, remedy="give each its own name")
        for config in configs:
            config.check(self.name)
        for config in self.stand_ins:
            if not config.servers:
                what = f"the stand-in {config.name} offers no service and no action"
                raise GraphError(what, where=config.place(self.name), remedy="name it under 'nodes'")
        for topic in sorted(self.inputs | self.services):
            check_topic(topic, self.name)
        check_services(self.name, configs, self.services)
        for each in self.wizard:
            if each.agent and each.agent not in names:
                raise GraphError(
                    f"key {each.key!r}: no node {each.agent!r}", where=self.name, remedy=suggestion(each.agent, names)
                )
        self._check_topics()

    def _check_exclusive_topics(self) -> None:
        alone: dict[str, str] = {}
        prefixes: dict[object, str] = {}
        for config in self.nodes:
            for topic, port in config.publications:
                if not port.exclusive:
                    continue
                if (other := alone.setdefault(topic, config.name)) != config.name:
                    raise GraphError(
                        f"{other} and {config.name} both publish {topic}, so their messages cannot be told apart",
                        where=self.name,
                        remedy=f"give each its own topic: remap: {{{port.name}: /{config.name}/{port.name}}}",
                    )
                if (declared := config.type.parameters().get("id_prefix")) is None:
                    continue
                prefix = config.parameters.get("id_prefix", declared.default)
                if (other := prefixes.setdefault(prefix, config.name)) != config.name:
                    raise GraphError(
                        f"{other} and {config.name} give people the same ids",
                        where=self.name,
                        remedy=f"set {config.name}.id_prefix: {config.name}_",
                    )

    def check_alternatives(self, topic: str) -> None:
        """Raise GraphError if ``topic`` is an alternative input of two nodes whose other inputs are not the same.

        One of them would get the messages of both: the images of two cameras.
        """
        groups: dict[frozenset[str], str] = {}
        for config in self.nodes:
            for port in (port for each, port in config.subscriptions if each == topic):
                first = port.alternative_to or port
                group = frozenset(each for each, one in config.subscriptions if first in (one, one.alternative_to))
                if len(group) > 1:
                    groups.setdefault(group, config.name)
                if len(groups) > 1:
                    raise GraphError(
                        f"{' and '.join(groups.values())} share {topic}, but no other input of the same purpose",
                        where=f"{config.place(self.name)}.{port.name}",
                        remedy=f"give it a topic of its own, beside its other input: remap: {{{port.name}: ...}}",
                    )

    def _check_topics(self) -> None:
        types: dict[str, tuple[type[Message], str]] = {}
        published = {topic for config in self.nodes for topic, _ in config.publications}
        sources = published.union(self.inputs)
        unlatched = {
            topic: config.name
            for config in self.nodes
            for topic, port in config.publications
            if port.delivery is not Delivery.LATCHED
        }
        for config in self.nodes:
            for topic, port in (*config.publications, *config.subscriptions):
                message_type, first = types.setdefault(topic, (port.message_type, config.name))
                if message_type is not port.message_type:
                    one, other = (
                        kind.ros_type if issubclass(kind, RosMessage) else kind.__name__
                        for kind in (message_type, port.message_type)
                    )
                    if one == other:  # two classes of the same name
                        one, other = (f"{kind.__module__}.{one}" for kind in (message_type, port.message_type))
                    raise GraphError(
                        f"{topic} is {one} for {first} but {other} for {config.name}",
                        where=config.place(self.name),
                        remedy="remap one of the two to another topic",
                    )
            for topic, port in config.subscriptions:
                if port.delivery is Delivery.LATCHED and topic in unlatched:
                    raise GraphError(
                        f"{topic} is latched for {config.name} but not for {unlatched[topic]}, so it gets nothing",
                        where=f"{config.place(self.name)}.{port.name}",
                        remedy="give both ports Delivery.LATCHED, or neither",
                    )
            # One of an input and its alternatives is enough.
            fed = {(port.alternative_to or port).name for topic, port in config.subscriptions if topic in sources}
            for topic, port in config.subscriptions:
                if not port.optional and (port.alternative_to or port).name not in fed:
                    raise GraphError(
                        f"nobody publishes {topic}",
                        where=f"{config.place(self.name)}.{port.name}",
                        remedy=f"list it under 'inputs' if a node outside the graph publishes it; "
                        f"{suggestion(topic, sources)}",
                    )
        for topic in sorted(sources):
            self.check_alternatives(topic)
        self._check_exclusive_topics()
        if self.paced_by and self.paced_by not in published:
            raise GraphError(
                f"paced_by names {self.paced_by}, which no node publishes",
                where=self.name,
                remedy=suggestion(self.paced_by, published),
            )

    def topics(self) -> dict[str, type[Message]]:
        """All topics of the nodes with their types."""
        return {
            topic: port.message_type
            for config in self.nodes
            for topic, port in (*config.publications, *config.subscriptions)
        }

    def node(self, name: str) -> NodeConfig:
        """The configuration of the node or stand-in ``name``. Raises GraphError if it is unknown."""
        for config in (*self.nodes, *self.stand_ins):
            if config.name == name:
                return config
        names = [config.name for config in self.nodes]
        raise GraphError(f"no node {name!r}", where=self.name, remedy=suggestion(name, names))

    def without_sources(self) -> Graph:
        """Return this graph without its sources: simulators, watches, and nodes without inputs, such as cameras.

        A node that offers or calls a service is no source, unless it watches a node outside the graph.
        """
        return self._without(
            one
            for one in self.nodes
            if not (one.subscriptions or one.servers or one.clients)
            or one.type.is_simulator
            or one.type.watches_outside
        )

    def _without(self, sources: Iterable[NodeConfig]) -> Graph:
        """Return this graph with the topics of ``sources`` as inputs."""
        sources = tuple(sources)
        fed = {topic for config in sources for topic, _ in config.publications}
        kept = tuple(config for config in self.nodes if config not in sources)
        return replace(self, nodes=kept, inputs=self.inputs | fed)

    def with_stand_ins(self, answered: Collection[str] = ()) -> Graph:
        """Return this graph with the stand-ins for services outside it, except those ``answered`` in another way.

        Watches of nodes outside are left out, unless a stand-in offers a service that they call.
        """
        used = tuple(one for one in self.stand_ins if not all(topic in answered for topic, _ in one.servers))
        offered = {topic for config in used for topic, _ in config.servers}
        idle = [
            one
            for one in self.nodes
            if one.type.watches_outside and not any(topic in offered for topic, _ in one.clients)
        ]
        whole = self._without(idle)
        return replace(whole, nodes=(*whole.nodes, *used), stand_ins=())

    def expect_answers(self, answered: Collection[str] = ()) -> None:
        """Raise GraphError if a client has no server in this graph, and is not ``answered`` in another way."""
        known = {*answered, *(topic for config in self.nodes for topic, _ in config.servers)}
        for config in self.nodes:
            for topic, port in config.clients:
                if topic not in known and not port.optional:
                    raise GraphError(
                        f"nobody answers {topic} ({port.interface.name}) in this run",
                        where=f"{config.place(self.name)}.{port.name}",
                        remedy="declare a node that offers it under 'stand_ins', or replay a bag that holds "
                        f"{recorded_topic(port, topic)} with --runner inline",
                    )

    def with_parameters(self, changes: Mapping[str, Mapping[str, object]]) -> Graph:
        """Return this graph with changed parameters, by node name and parameter name."""
        for name in changes:
            self.node(name)

        def changed(configs: tuple[NodeConfig, ...]) -> tuple[NodeConfig, ...]:
            return tuple(replace(one, parameters={**one.parameters, **changes.get(one.name, {})}) for one in configs)

        return replace(self, nodes=changed(self.nodes), stand_ins=changed(self.stand_ins))
