"""Ports and parameters of nodes: typed inputs, outputs and values, declared as attributes of a node class."""

from __future__ import annotations

import enum
import inspect
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from socialbot.core.errors import GraphError, MessageError, ParameterError
from socialbot.core.messages import Message, RosMessage, Structured, check_fields, is_ros_message, ros_message

if TYPE_CHECKING:
    from socialbot.graph.node import Node

M = TypeVar("M", bound=Message)
V = TypeVar("V", bool, int, float, str)
H = TypeVar("H", bound=Callable[..., None])

NODE_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,199}")
"""Name of a node; those of its topics and services are longer, and its log is a file of that name."""

TOPIC_NAME = re.compile(r"(?!.{229})(/[A-Za-z_][A-Za-z0-9_]*)+")
"""Full name of a topic, service or action. Those of its seals and services have up to 247 characters, as in DDS."""


FRESH_S = 0.5
"""Time (s) after which `Delivery.FRESH` gives a message up, with the repairs of its lost packets."""


class Delivery(enum.Enum):
    """Quality of service for slow or late subscribers."""

    EVERY = "every"
    """Commands and events: every message, in order."""
    NEWEST = "newest"
    """Streams: a slow subscriber gets only the newest message."""
    FRESH = "fresh"
    """Streams over a slow link, for publishers: a message that is not delivered soon is given up."""
    LATCHED = "latched"
    """State: a late subscriber gets the last message."""


EVERYBODY = "all"
"""Receiver of a message for all nodes."""


def _message_type(kind: Any) -> Any:
    return kind if isinstance(kind, type) and issubclass(kind, Message) else ros_message(kind)


def check_handler(handler: Callable[..., Any], *arguments: str) -> str:
    """Return module and class of a method that handles ``arguments``.

    Raises:
        GraphError: It is a coroutine, or takes other arguments.
    """
    name, own = handler.__name__, handler.__qualname__.rpartition(".")[0]
    place = f"{handler.__module__}.{own}" if own else handler.__module__
    if inspect.iscoroutinefunction(handler):
        remedy = "write def instead of async def; run_in_background does what takes long"
        raise GraphError(f"the handler {name} is a coroutine", where=place, remedy=remedy)
    given = ("self", *arguments)
    try:
        inspect.signature(handler).bind(*given)
    except TypeError as error:
        remedy = f"write def {name}({', '.join(given)})"
        raise GraphError(f"the handler {name} takes other arguments: {error}", where=place, remedy=remedy) from None
    return place


class Input(Generic[M]):
    """Typed input; as a decorator it registers the method that handles its messages.

    ``message_type`` is a `Message`, or any ROS type: its class of rclpy, or its name as in ``std_msgs/msg/Float32``.
    The handler of a ROS type gets a `RosMessage`, which has the fields of the ROS message and a ``stamp``.

    An input that replaces one of a base class keeps its handler. An ``optional`` one may stay unconnected; it is meant
    for users and programs outside the graph.

    An input with a ``deadline_s`` is silent when no message arrives within it (see `socialbot.graph.health`). The
    runner then calls `Node.on_silence`, later `Node.on_return`. Messages on an input that is ``alternative_to`` it
    count too. Messages that arrive much later than the others, as after a lost link, are skipped.

    With ``addressed_by``, the handler gets only messages whose attribute of that name is its node, or `EVERYBODY`.
    """

    def __init__(
        self,
        message_type: type[M] | type | str,
        topic: str,
        delivery: Delivery = Delivery.EVERY,
        *,
        optional: bool = False,
        deadline_s: float = 0.0,
        alternative_to: Input[Any] | None = None,
        addressed_by: str = "",
    ) -> None:
        self.message_type: type[M] = _message_type(message_type)
        self.topic = topic
        self.delivery = delivery
        self.optional = optional
        self.deadline_s = deadline_s
        self.alternative_to = alternative_to
        self.addressed_by = addressed_by
        self.name = ""
        self._handler = self._owner = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name
        self._handler = self._handler or getattr(getattr(super(owner, owner), name, None), "_handler", "")

    def __call__(self, handler: H) -> H:
        name, place = handler.__name__, check_handler(handler, "message")
        if self._handler not in ("", name) and self._owner == place:
            what = f"the input on {self.topic} has two handlers: {self._handler} and {name}"
            raise GraphError(what, where=place, remedy="decorate one method")
        self._handler, self._owner = name, place
        return handler

    @property
    def handler(self) -> str:
        """Name of the method that handles the messages; empty if there is none."""
        return self._handler

    def deliver(self, node: Node, message: M) -> None:
        if not self.addressed_by or getattr(message, self.addressed_by) in (node.name, EVERYBODY):
            getattr(node, self._handler)(message)


class Output(Generic[M]):
    """Typed output; accessed on a node, it is a `Publisher`. ``message_type`` is that of `Input`.

    A topic such as ``/{receiver}/letters`` stands for one topic per receiver: a message travels on the topic that
    contains the value of its attribute ``receiver``, a name of a node. Only that node needs to subscribe to it, with an
    input on ``~/letters``.

    Args:
        exclusive: Whether messages of two such outputs on one topic could not be told apart: a graph refuses that.
    """

    def __init__(
        self,
        message_type: type[M] | type | str,
        topic: str,
        delivery: Delivery = Delivery.EVERY,
        *,
        exclusive: bool = False,
    ) -> None:
        self.message_type: type[M] = _message_type(message_type)
        self.topic = topic
        self.exclusive = exclusive
        self.addressed_by = topic.partition("{")[2].partition("}")[0]
        """Attribute of messages with their receiver, if the topic contains one."""
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
        # Cached in the attributes of the node, which take precedence over this descriptor.
        publisher = vars(node)[self.name] = Publisher(node, self)
        return publisher

    def receiver(self, message: M) -> str:
        """The receiver of a message on one topic per receiver. Raises MessageError if it is no name of a node."""
        receiver = getattr(message, self.addressed_by)
        if not isinstance(receiver, str) or not NODE_NAME.fullmatch(receiver):
            raise MessageError(f"{self.addressed_by} {receiver!r} is no name of a node", where=self.topic)
        return receiver


class Publisher(Generic[M]):
    """Publisher of one output of a node."""

    __slots__ = ("_is_checked", "_node", "_port")

    def __init__(self, node: Node, port: Output[M]) -> None:
        self._node = node
        self._port = port
        self._is_checked = False

    def publish(self, message: M | Any) -> None:
        """Publish a message. A message of rclpy or rosbags gets the time of the node if its header has no stamp.

        Raises MessageError for a message of another class. The types of the fields are checked in the first message
        only: over ROS receivers check each one, and in one process nobody does.
        """
        kind = self._port.message_type
        if not isinstance(message, kind):
            if not (issubclass(kind, RosMessage) and is_ros_message(message) and ros_message(type(message)) is kind):
                name = kind.ros_type if issubclass(kind, RosMessage) else kind.__name__
                article = "an" if name[0] in "AEIOU" else "a"
                raise MessageError(f"not {article} {name}: {type(message).__name__}", where=self._port.topic)
            message = kind.of(message, self._node.clock.now())
        if not self._is_checked:
            if isinstance(message, Structured):
                check_fields(message, where=self._port.topic)
            self._is_checked = True
        self._node.context.publish(self._port, message)


_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text, in quotes if need be"}


class Parameter(Generic[V]):
    """Node parameter with a default, a description and bounds.

    It is an attribute of the node, and may change at run time unless it is ``fixed``.
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
        self._check_default()

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, node: None, owner: type) -> Parameter[V]: ...
    @overload
    def __get__(self, node: Node, owner: type) -> V: ...
    def __get__(self, node: Node | None, owner: type) -> Parameter[V] | V:
        return self if node is None else node.parameter_values[self.name]  # type: ignore[return-value]

    def __set__(self, node: Node, value: V) -> None:
        """Refuse an assignment, which would hide the parameter. Raises ParameterError."""
        remedy = f"write self.set_parameter({self.name!r}, {value!r}), or give the attribute another name"
        raise ParameterError("is a parameter and cannot be assigned", where=f"{node.name}.{self.name}", remedy=remedy)

    def _check_default(self) -> None:
        default, where = self.default, f"parameter ({self.doc})"
        if type(default) not in (bool, int, float, str):
            remedy = "write several values as a text, such as '1 2 3'"
            raise ParameterError(f"the default {default!r} is no bool, int, float or str", where=where, remedy=remedy)
        if not self._is_in_range(default):
            raise ParameterError(f"the default {default!r} is out of range", where=where, remedy=self._range)
        if self.choices and default not in self.choices:
            listed = ", ".join(map(str, self.choices))
            raise ParameterError(f"the default {default!r} is none of {listed}", where=where, remedy="choose one")

    def _is_in_range(self, value: object) -> bool:
        low, high = self.minimum, self.maximum
        return not isinstance(value, (int, float)) or (
            (low is None or value >= low) and (high is None or value <= high)
        )

    @property
    def _range(self) -> str:
        low, high = self.minimum, self.maximum
        return f"give a value from {'-inf' if low is None else low} to {'inf' if high is None else high}"

    def check(self, value: object, where: str) -> V:
        """Convert ``value`` to the type of the parameter. Raises ParameterError if it is invalid."""
        kind = type(self.default)
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind:
            remedy = f"give {_KINDS[kind]}: {self.doc}"
            raise ParameterError(f"{value!r} is not of type {kind.__name__}", where=where, remedy=remedy)
        if not self._is_in_range(value):
            raise ParameterError(f"{value!r} is out of range", where=where, remedy=self._range)
        if self.choices and value not in self.choices:
            listed = ", ".join(map(str, self.choices))
            raise ParameterError(f"unknown choice {value!r}", where=where, remedy=f"one of {listed}")
        return value  # type: ignore[return-value]
