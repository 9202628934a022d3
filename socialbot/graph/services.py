"""ROS services and actions of nodes: ports that offer and call them, for every runner.

::

    class Lamp(Node):
        \"\"\"Switch a light, and ask another node to open the blinds.\"\"\"

        light = Service("std_srvs/srv/SetBool", "/light")
        blinds = Client("std_srvs/srv/Trigger", "/blinds/open", deadline_s=2.0)

        @light
        def on_light(self, request: Any, response: Any) -> None:
            response.success = True
            self.blinds.call(then=self.on_blinds)

        def on_blinds(self, result: CallResult) -> None:
            if not result.ok:
                self.log.warning("%s", result.reason)

Calls never wait: the result is a callback in the thread of the node. Deadlines follow the clock of the node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar, overload

from socialbot.core.errors import GraphError, suggestion
from socialbot.graph.calls import GoalHandle, Interface, PendingCall, Then, interface
from socialbot.graph.ports import check_handler

if TYPE_CHECKING:
    from socialbot.graph.node import Node, NodeConfig

H = TypeVar("H", bound=Callable[..., Any])

SERVICE_DEADLINE_S = 5.0


class _Server:
    """Port that offers a service or action."""

    interface: Interface
    _arguments: tuple[str, ...] = ()
    """Arguments of its handler."""

    def __init__(self, topic: str, *, open_to_all: bool) -> None:
        self.topic = topic
        self.open_to_all = open_to_all
        self.name = ""
        self._handler = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name
        inherited = getattr(super(owner, owner), name, None)
        self._handler = self._handler or getattr(inherited, "_handler", "")

    def __call__(self, handler: H) -> H:
        check_handler(handler, *self._arguments)
        self._handler = handler.__name__
        return handler


class Service(_Server):
    """Service that a node offers; as a decorator it registers the method that answers requests.

    The method gets the request and an empty response, and sets the fields of the response or returns them as a mapping.
    If it raises, the client gets no answer, as in ROS.

    Args:
        service_type: The class of rclpy, or a name such as ``std_srvs/srv/SetBool``.
        topic: Name of the service.
        open_to_all: Offer it in a graph with keys, too. ROS services carry no signature: anybody may call it.
    """

    _arguments = ("request", "response")

    def __init__(self, service_type: type | str, topic: str, *, open_to_all: bool = False) -> None:
        super().__init__(topic, open_to_all=open_to_all)
        self.interface = interface(service_type, "srv")

    def answer(self, node: Node, request: Any) -> Any:
        """Return the response of ``node`` to a request."""
        response = self.interface.make("Response")
        returned = getattr(node, self._handler)(request, response)
        return response if returned is None else self.interface.make("Response", returned)


class ActionServer(_Server):
    """Action that a node offers; as a decorator it registers the method that starts or rejects a `GoalHandle`.

    ``@port.on_cancel`` registers the method that stops a goal. Without one, a goal ends as soon as its client asks.
    The arguments are those of `Service`.
    """

    _arguments = ("goal",)

    def __init__(self, action_type: type | str, topic: str, *, open_to_all: bool = False) -> None:
        super().__init__(topic, open_to_all=open_to_all)
        self.interface = interface(action_type, "action")
        self._cancel_handler = ""

    def __set_name__(self, owner: type, name: str) -> None:
        super().__set_name__(owner, name)
        inherited = getattr(super(owner, owner), name, None)
        self._cancel_handler = self._cancel_handler or getattr(inherited, "_cancel_handler", "")

    def on_cancel(self, handler: H) -> H:
        """Register the method that stops a goal and calls `GoalHandle.cancelled`."""
        check_handler(handler, *self._arguments)
        self._cancel_handler = handler.__name__
        return handler

    def start(self, node: Node, goal: GoalHandle) -> None:
        """Pass a new goal to ``node``. An exception rejects it."""
        try:
            getattr(node, self._handler)(goal)
        except BaseException:
            goal.reject()
            raise

    def cancel(self, node: Node, goal: GoalHandle) -> None:
        """Pass on the request to cancel an active goal."""
        if goal.active:
            goal.cancelling = True
            if self._cancel_handler:
                getattr(node, self._cancel_handler)(goal)
            else:
                goal.cancelled()


class _ClientPort:
    interface: Interface

    def __init__(self, topic: str, *, deadline_s: float, optional: bool, open_to_all: bool) -> None:
        if deadline_s < 0:
            raise GraphError(f"deadline_s is {deadline_s:g}", where=topic, remedy="give seconds, or 0 for none")
        self.topic = topic
        self.deadline_s = deadline_s
        self.optional = optional
        self.open_to_all = open_to_all
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class Client(_ClientPort):
    """Client of a service; accessed on a node, it is a `ServiceCaller`.

    Args:
        service_type: As in `Service`.
        topic: Name of the service.
        deadline_s: Time (s) for an answer; 0 for no limit.
        optional: Whether a graph is complete without a server.
        open_to_all: Call it in a graph with keys, too. Answers carry no signature: anybody may give them.
    """

    def __init__(
        self,
        service_type: type | str,
        topic: str,
        *,
        deadline_s: float = SERVICE_DEADLINE_S,
        optional: bool = False,
        open_to_all: bool = False,
    ) -> None:
        super().__init__(topic, deadline_s=deadline_s, optional=optional, open_to_all=open_to_all)
        self.interface = interface(service_type, "srv")

    @overload
    def __get__(self, node: None, owner: type) -> Client: ...
    @overload
    def __get__(self, node: Node, owner: type) -> ServiceCaller: ...
    def __get__(self, node: Node | None, owner: type) -> Client | ServiceCaller:
        if node is None:
            return self
        caller = vars(node)[self.name] = ServiceCaller(node, self)
        return caller


class ActionClient(_ClientPort):
    """Client of an action; accessed on a node, it is an `ActionCaller`. The arguments are those of `Client`."""

    def __init__(
        self,
        action_type: type | str,
        topic: str,
        *,
        deadline_s: float = 0.0,
        optional: bool = False,
        open_to_all: bool = False,
    ) -> None:
        super().__init__(topic, deadline_s=deadline_s, optional=optional, open_to_all=open_to_all)
        self.interface = interface(action_type, "action")

    @overload
    def __get__(self, node: None, owner: type) -> ActionClient: ...
    @overload
    def __get__(self, node: Node, owner: type) -> ActionCaller: ...
    def __get__(self, node: Node | None, owner: type) -> ActionClient | ActionCaller:
        if node is None:
            return self
        caller = vars(node)[self.name] = ActionCaller(node, self)
        return caller


class ServiceCaller:
    """Client of one service of a node."""

    __slots__ = ("_node", "_port")

    def __init__(self, node: Node, port: Client) -> None:
        self._node = node
        self._port = port

    def call(self, request: Any = None, then: Then | None = None, *, deadline_s: float | None = None) -> PendingCall:
        """Send a request: a message, or a mapping of its fields. ``then`` gets the result. Raises MessageError."""
        message = self._port.interface.make("Request", request)
        limit_s = self._port.deadline_s if deadline_s is None else deadline_s
        return PendingCall(self._node, self._port, message, then, None, limit_s)


class ActionCaller:
    """Client of one action of a node."""

    __slots__ = ("_node", "_port")

    def __init__(self, node: Node, port: ActionClient) -> None:
        self._node = node
        self._port = port

    def send_goal(
        self,
        goal: Any = None,
        then: Then | None = None,
        *,
        feedback: Callable[[Any], None] | None = None,
        deadline_s: float | None = None,
    ) -> PendingCall:
        """Send a goal: a message, or a mapping of its fields. Raises MessageError.

        ``feedback`` gets the feedback, ``then`` the result. After the deadline the goal is cancelled.
        """
        message = self._port.interface.make("Goal", goal)
        limit_s = self._port.deadline_s if deadline_s is None else deadline_s
        return PendingCall(self._node, self._port, message, then, feedback, limit_s)


ServerPort = Service | ActionServer
ClientPort = Client | ActionClient


def check_services(graph: str, configs: Iterable[NodeConfig], outside: Iterable[str]) -> None:
    """Check that every service and action has one server and one type.

    Raises:
        GraphError: Two nodes offer the same service, the types differ, or nobody offers a service.
    """
    configs = tuple(configs)
    types: dict[str, tuple[str, str]] = {}
    offered: dict[str, str] = {}
    for config in configs:
        for topic, port in (*config.servers, *config.clients):
            place = config.place(graph)
            name, first = types.setdefault(topic, (port.interface.name, config.name))
            if name != port.interface.name:
                what = f"{topic} is {name} for {first} but {port.interface.name} for {config.name}"
                raise GraphError(what, where=place, remedy="remap one of the two to another name")
            if isinstance(port, ServerPort):
                if topic in offered:
                    what = f"{offered[topic]} and {config.name} both offer {topic}"
                    raise GraphError(what, where=place, remedy="remap one of the two to another name")
                offered[topic] = config.name
    known = {*offered, *outside}
    for config in configs:
        for topic, port in config.clients:
            if topic not in known and not port.optional:
                raise GraphError(
                    f"nobody offers {topic} ({port.interface.name})",
                    where=f"{config.place(graph)}.{port.name}",
                    remedy=f"list it under 'services' if a node outside the graph offers it; "
                    f"{suggestion(topic, known)}",
                )


def recorded_topic(port: ClientPort, topic: str) -> str:
    """Topic of a bag with the answers of a service (its events), or the end of goals of an action (their status)."""
    return f"{topic}/_service_event" if isinstance(port, Client) else f"{topic}/_action/status"
