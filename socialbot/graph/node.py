"""What a graph is: nodes with typed inputs, outputs and parameters, placed and connected by topics.

A node is a plain class that knows no ROS::

    class Echo(Node):
        \"\"\"Says again what it hears.\"\"\"

        heard = Input(Utterance, "/speech/heard")
        say = Output(Utterance, "/speech/say")
        volume = Parameter(0.5, "loudness", minimum=0.0, maximum=1.0)

        @heard
        def on_heard(self, message: Utterance) -> None:
            self.say.publish(message)

The runners (`socialbot.graph.inline`, ``socialbot.bridge.host``) give such a node its clock, timers and
connections, and call it from one thread at a time.
"""

from __future__ import annotations

import enum
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Protocol, TypeVar, get_args, overload

from socialbot.core.clock import Clock, nanoseconds
from socialbot.core.errors import GraphError, ParameterError, suggestion
from socialbot.core.messages import Message, State

if TYPE_CHECKING:
    from socialbot.graph.health import HealthMonitor

M = TypeVar("M", bound=Message)
V = TypeVar("V", bool, int, float, str)
H = TypeVar("H", bound=Callable[..., None])
R = TypeVar("R")

WireForm = Literal["json", "typed"]
"""How structured messages travel over ROS: as JSON in std_msgs/String, or as socialbot_msgs."""

NODE_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
TOPIC_NAME = re.compile(r"(~?/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
"""``~/`` stands for the node's own namespace: ``~/state`` of the node ``arm`` is ``/arm/state``."""


class Delivery(enum.Enum):
    """What a connection promises when the receiver is slow or comes late."""

    EVERY = "every"
    """Commands and events: each message, in order."""
    NEWEST = "newest"
    """Streams: a receiver that cannot keep up gets the newest message and never works through a backlog."""
    LATCHED = "latched"
    """State: a receiver that joins late gets the last message."""


class Input(Generic[M]):
    """A typed input; used as a decorator it names the method that takes the messages.

    One that is ``optional`` may stay unconnected: it is for people and programs outside of the graph.

    One with a ``deadline_s`` is silent when nothing has come for so long (see `socialbot.graph.health`); the node is
    told by `Node.on_silence` and `Node.on_return`. Messages on an input that is ``alternative_to`` it count too.
    """

    def __init__(
        self,
        message_type: type[M],
        topic: str,
        delivery: Delivery = Delivery.EVERY,
        *,
        optional: bool = False,
        deadline_s: float = 0.0,
        alternative_to: Input[Any] | None = None,
    ) -> None:
        self.message_type = message_type
        self.topic = topic
        self.delivery = delivery
        self.optional = optional
        self.deadline_s = deadline_s
        self.alternative_to = alternative_to
        self.name = ""
        self._handler = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __call__(self, handler: H) -> H:
        self._handler = handler.__name__
        return handler

    def deliver(self, node: Node, message: M) -> None:
        """Hands ``message`` to the method of ``node`` that takes this input."""
        getattr(node, self._handler)(message)


class Output(Generic[M]):
    """A typed output; on a node it is a `Publisher`."""

    def __init__(self, message_type: type[M], topic: str, delivery: Delivery = Delivery.EVERY) -> None:
        self.message_type = message_type
        self.topic = topic
        self.delivery = delivery
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, node: None, owner: type) -> Output[M]: ...
    @overload
    def __get__(self, node: Node, owner: type) -> Publisher[M]: ...
    def __get__(self, node: Node | None, owner: type) -> Output[M] | Publisher[M]:
        if node is None:
            return self
        # Kept in the node's attributes, where it is found before this descriptor.
        publisher = vars(node)[self.name] = Publisher(node, self)
        return publisher


class Publisher(Generic[M]):
    """An output of one node."""

    __slots__ = ("_node", "_port")

    def __init__(self, node: Node, port: Output[M]) -> None:
        self._node = node
        self._port = port

    def publish(self, message: M) -> None:
        """Sends ``message`` to everybody who listens."""
        self._node.context.publish(self._port, message)


class Parameter(Generic[V]):
    """A parameter with its default, meaning and bounds.

    Read it as an attribute of the node; it may change while the node runs, unless it is ``fixed``.
    """

    def __init__(
        self,
        default: V,
        doc: str,
        *,
        minimum: float | None = None,
        maximum: float | None = None,
        choices: Sequence[str] = (),
        fixed: bool = False,
    ) -> None:
        self.default: V = default
        self.doc = doc
        self.minimum = minimum
        self.maximum = maximum
        self.choices = tuple(choices)
        self.fixed = fixed
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, node: None, owner: type) -> Parameter[V]: ...
    @overload
    def __get__(self, node: Node, owner: type) -> V: ...
    def __get__(self, node: Node | None, owner: type) -> Parameter[V] | V:
        return self if node is None else node.parameter_values[self.name]  # type: ignore[return-value]

    def check(self, value: object, where: str) -> V:
        """``value`` as this parameter's type. Raises ParameterError when it does not fit."""
        kind = type(self.default)
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind:
            raise ParameterError(f"{value!r} is not of type {kind.__name__}", where=where, remedy=self.doc)
        low, high = self.minimum, self.maximum
        if isinstance(value, (int, float)) and (
            (low is not None and not value >= low) or (high is not None and not value <= high)
        ):
            raise ParameterError(
                f"{value!r} is out of range",
                where=where,
                remedy=f"give a value from {'-inf' if low is None else low} to {'inf' if high is None else high}",
            )
        if self.choices and value not in self.choices:
            raise ParameterError(f"unknown choice {value!r}", where=where, remedy=f"one of {', '.join(self.choices)}")
        return value  # type: ignore[return-value]


class Timer(Protocol):
    """A call that is still to come."""

    def cancel(self) -> None:
        """Takes the call back; nothing happens if it was made already."""
        ...


class Context(Protocol):
    """What a runner gives to one node."""

    @property
    def clock(self) -> Clock:
        """The clock that the node asks for the time."""
        ...

    @property
    def vitals(self) -> HealthMonitor:
        """How the node is."""
        ...

    def publish(self, port: Output[Any], message: Message) -> None:
        """Sends ``message`` out of ``port``."""
        ...

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        """Calls back once, in the node's own thread, when the clock has reached ``time`` (ns)."""
        ...

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Calls back in the node's own thread as soon as it is free; safe from any thread."""
        ...

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        """Has ``work`` done without holding up the node, and calls back with what it returned or raised.

        It runs in a thread of its own and must not touch the node; where time is simulated, it takes none of it.
        """
        ...


class Node:
    """One unit of a graph. Subclasses declare ports and parameters as class attributes."""

    is_simulator: ClassVar[bool] = False
    """Whether it simulates the world; a replay leaves it out and takes its messages from the bag."""

    is_agent: ClassVar[bool] = False
    """Whether it runs an agent, which takes commands."""

    deliberates: ClassVar[bool] = False
    """Whether its trace records desires and plans."""

    display_name: ClassVar[str] = ""
    """Name of an agent for people; empty: its name in the graph."""

    phrases: ClassVar[Mapping[str, str]] = {}
    """Sentences for the actions of an agent, by action name, with arguments as {0}, {1}: ``"opens {1}"``."""

    _inputs: ClassVar[Mapping[str, Input[Any]]] = {}
    _outputs: ClassVar[Mapping[str, Output[Any]]] = {}
    _parameters: ClassVar[Mapping[str, Parameter[Any]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls._inputs = {**cls._inputs, **_own(cls, Input)}
        cls._outputs = {**cls._outputs, **_own(cls, Output)}
        cls._parameters = {**cls._parameters, **_own(cls, Parameter)}

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError when ``parameters`` holds an unknown name or a value that does not fit."""
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

    @property
    def clock(self) -> Clock:
        """The time of the runner this node lives in."""
        return self.context.clock

    def call_after(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Calls back once, ``seconds`` from now."""
        return self.context.call_at(self.clock.now() + nanoseconds(seconds), callback)

    def set_parameter(self, name: str, value: object) -> None:
        """Changes a parameter while running.

        Raises ParameterError when it is unknown, fixed or does not fit, and whatever the node objects.
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
        """Called once, when all connections stand."""

    def stop(self) -> None:
        """Called once, before the node goes away; gives back devices and files."""

    def on_parameter(self, name: str) -> None:
        """Called after a parameter has changed; an exception takes the change back."""

    def deadline_s(self, port: Input[Any]) -> float:
        """How long (s) nothing may come to ``port`` before it is silent; 0: as long as it likes."""
        return port.deadline_s

    def counts(self, port: Input[Any], message: Message) -> bool:
        """Whether ``message`` is what an input with a deadline waits for; asked in another thread than the node's."""
        return True

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        """Called when an input with a deadline is silent: ``since`` (ns) its last message, None if there was none."""

    def on_return(self, port: Input[Any]) -> None:
        """Called when an input that was silent is back, before its message is delivered."""

    def say_health(self, state: State, reason: str = "") -> None:
        """Says how the node is, until something else is said; of its silent inputs the runner knows."""
        self.context.vitals.say(state, reason)


def outcome(work: Callable[[], R]) -> R | Exception:
    """Run ``work`` and return its result or exception, as a runner reports it after `Context.run_in_background`."""
    try:
        return work()
    except Exception as error:  # noqa: BLE001 - whatever it is, the node decides what to do about it
        return error


def _own(cls: type, kind: type) -> dict[str, Any]:
    return {name: value for name, value in vars(cls).items() if isinstance(value, kind)}


def check_parameters(node_type: type[Node], given: Mapping[str, object], *, where: str) -> dict[str, Any]:
    """All parameters of ``node_type``: the defaults and, checked, the ``given`` ones."""
    declared = node_type.parameters()
    values = {name: parameter.default for name, parameter in declared.items()}
    for name, value in given.items():
        if name not in declared:
            raise ParameterError(f"no parameter {name!r}", where=where, remedy=suggestion(name, declared))
        values[name] = declared[name].check(value, where=f"{where}.{name}")
    return values


@dataclass(frozen=True)
class NodeConfig:
    """A node in a graph: its name, its type, its parameters, and ports that use another topic than their own."""

    name: str
    type: type[Node]
    parameters: Mapping[str, object] = field(default_factory=dict)
    remap: Mapping[str, str] = field(default_factory=dict)
    where: str = field(default="", compare=False)
    """Where it is written (file and line), for errors."""

    def place(self, graph: str) -> str:
        """The node's name after file and line where they are known, else after that of the ``graph``."""
        return f"{self.where or graph}: {self.name}"

    def check(self, graph: str) -> None:
        """Raises GraphError for an unknown port, ParameterError for a parameter that does not fit."""
        place = self.place(graph)
        if not NODE_NAME.fullmatch(self.name):
            raise GraphError("no valid name for a node", where=place, remedy="use letters, digits and _")
        for topic in self.remap.values():
            if not TOPIC_NAME.fullmatch(topic):
                raise GraphError(f"no valid topic: {topic!r}", where=place, remedy="use names of letters, digits and _")
        ports = {*self.type.inputs(), *self.type.outputs()}
        for port in self.remap:
            if port not in ports:
                raise GraphError(f"no input or output {port!r}", where=place, remedy=suggestion(port, ports))
        check_parameters(self.type, self.parameters, where=place)

    def topic(self, port: Input[Any] | Output[Any]) -> str:
        """The topic that ``port`` is connected to, in full."""
        topic = self.remap.get(port.name, port.topic)
        return f"/{self.name}{topic[1:]}" if topic.startswith("~") else topic

    @property
    def subscriptions(self) -> list[tuple[str, Input[Any]]]:
        """Topic and port of each input."""
        return [(self.topic(port), port) for port in self.type.inputs().values()]

    @property
    def publications(self) -> list[tuple[str, Output[Any]]]:
        """Topic and port of each output."""
        return [(self.topic(port), port) for port in self.type.outputs().values()]


@dataclass(frozen=True)
class Graph:
    """Nodes and the topics that connect them.

    ``inputs`` are topics that come from outside: a robot's own driver, or a bag. ``paced_by`` names
    the topic that answers each camera frame; a replay waits for it rather than losing frames. ``wire`` is the form
    of structured messages over ROS; nodes see no difference.
    """

    name: str
    placements: tuple[NodeConfig, ...]
    inputs: frozenset[str] = frozenset()
    paced_by: str = ""
    wire: WireForm = "json"

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """Raises GraphError or ParameterError when the graph does not fit together."""
        names = [placement.name for placement in self.placements]
        for name in names:
            if names.count(name) > 1:
                raise GraphError(f"two nodes are called {name!r}", where=self.name, remedy="give each its own name")
        for placement in self.placements:
            placement.check(self.name)
        if self.wire not in get_args(WireForm):
            remedy = suggestion(self.wire, get_args(WireForm))
            raise GraphError(f"no form of messages: {self.wire!r}", where=f"{self.name}.wire", remedy=remedy)
        self._check_topics()

    def _check_topics(self) -> None:
        types: dict[str, tuple[type[Message], str]] = {}
        published = {topic for placement in self.placements for topic, _ in placement.publications}
        for placement in self.placements:
            for topic, port in (*placement.publications, *placement.subscriptions):
                message_type, first = types.setdefault(topic, (port.message_type, placement.name))
                if message_type is not port.message_type:
                    raise GraphError(
                        f"{topic} is {message_type.__name__} for {first} but {port.message_type.__name__} for "
                        f"{placement.name}",
                        where=placement.place(self.name),
                        remedy="remap one of the two to another topic",
                    )
            for topic, port in placement.subscriptions:
                if topic not in published and topic not in self.inputs and not port.optional:
                    raise GraphError(
                        f"nobody publishes {topic}",
                        where=f"{placement.place(self.name)}.{port.name}",
                        remedy=f"name it under 'inputs' if it comes from outside, or {suggestion(topic, published)}",
                    )
        if self.paced_by and self.paced_by not in published:
            raise GraphError(
                f"paced_by names {self.paced_by}, which no node publishes",
                where=self.name,
                remedy=suggestion(self.paced_by, published),
            )

    def topics(self) -> dict[str, type[Message]]:
        """Every topic that a node publishes or listens to, with its type."""
        return {
            topic: port.message_type
            for placement in self.placements
            for topic, port in (*placement.publications, *placement.subscriptions)
        }

    def placement(self, name: str) -> NodeConfig:
        """The node called ``name``. Raises GraphError when there is none."""
        for placement in self.placements:
            if placement.name == name:
                return placement
        names = [placement.name for placement in self.placements]
        raise GraphError(f"no node {name!r}", where=self.name, remedy=suggestion(name, names))

    def without_sources(self) -> Graph:
        """This graph with its sources (nodes without inputs, such as cameras, or in place of the world) left out."""
        sources = [one for one in self.placements if not one.subscriptions or one.type.is_simulator]
        fed = {topic for placement in sources for topic, _ in placement.publications}
        kept = tuple(placement for placement in self.placements if placement not in sources)
        return replace(self, placements=kept, inputs=self.inputs | fed)

    def with_parameters(self, changes: Mapping[str, Mapping[str, object]]) -> Graph:
        """This graph with other parameters: ``changes`` maps node names to parameters."""
        for name in changes:
            self.placement(name)
        return replace(
            self,
            placements=tuple(
                replace(placement, parameters={**placement.parameters, **changes.get(placement.name, {})})
                for placement in self.placements
            ),
        )
