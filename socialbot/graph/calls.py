"""Calls of services and goals of actions: their types, progress, outcome and deadlines, for every runner."""

from __future__ import annotations

import functools
import importlib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, Protocol

from socialbot.core.clock import nanoseconds
from socialbot.core.errors import GraphError, InstallationError, MessageError, suggestion
from socialbot.core.installation import interfaces_command

if TYPE_CHECKING:
    from socialbot.graph.node import Node, Timer
    from socialbot.graph.services import ClientPort

Outcome = Literal["succeeded", "aborted", "cancelled", "rejected", "timeout", "absent", "lost"]
"""Outcome of a call: "absent" without a server, "lost" if the server went away during the call."""

SERVER_WAIT_S = 5.0  # time for a server to appear
CANCEL_WAIT_S = 5.0  # time for a server to confirm the cancellation of a goal

Then = Callable[["CallResult"], None]
Fields = Mapping[str, Any]


class OpenMessage(SimpleNamespace):
    """Message of a type that is not installed: it takes any field. A field without a value cannot be read."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise AttributeError(f"field {name!r} has no value, and its ROS type, which has a default, is not installed")


@dataclass(frozen=True)
class Interface:
    """Type of a service or action, such as ``std_srvs/srv/SetBool``, and its parts, such as Request and Response."""

    name: str
    parts: tuple[str, ...]

    @property
    def is_action(self) -> bool:
        return self.parts == ACTION_PARTS

    def ros_class(self) -> Any:
        """The class of rclpy; None if its package is not installed."""
        return installed_class(self.name)

    def make(self, part: str, content: Any = None) -> Any:
        """Make a part from a mapping of its fields, nested ones too, or check a message of that part.

        Without the ROS package of the type, an `OpenMessage` stands for it. Raises MessageError.
        """
        owner = self.ros_class()
        if content is not None and not isinstance(content, Mapping):
            if owner is not None and not isinstance(content, getattr(owner, part)):
                raise MessageError(f"not a {part} of {self.name}: {type(content).__name__}")
            return content
        message = OpenMessage() if owner is None else getattr(owner, part)()
        fill_message(message, content or {}, f"{part} of {self.name}")
        return message


@functools.cache
def installed_class(name: str) -> Any:
    """Return the class of rclpy of a type such as ``std_msgs/msg/String``; None if its package is not installed."""
    module, _, attribute = name.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError):
        return None


def fill_message(message: Any, fields: Fields, what: str) -> None:
    """Set the fields of a ROS message from a mapping, nested ones too.

    Raises:
        MessageError: A field is unknown, or a value does not fit its type.
    """
    known = message.get_fields_and_field_types() if hasattr(message, "get_fields_and_field_types") else None
    if known is not None:
        message._check_fields = True  # else rclpy takes any value and sends the wrong bytes
    for name, value in fields.items():
        if known is not None and name not in known:
            raise MessageError(f"no field {name!r}", where=what, remedy=suggestion(name, known))
        part: Any = value
        if isinstance(value, Mapping):
            part = OpenMessage() if known is None else getattr(message, name)
            fill_message(part, value, f"{name} of {what}")
        elif isinstance(value, (list, tuple)) and any(isinstance(item, Mapping) for item in value):
            kind = None if known is None else _item_type(known[name])
            part = [_filled_item(kind, item, f"{name} of {what}") for item in value]
        try:
            if known is not None and isinstance(getattr(message, name), float):
                part = float(part)  # rclpy reads the bytes of an int as those of a float
            setattr(message, name, part)
        except (AssertionError, OverflowError, TypeError, ValueError) as error:
            raise MessageError(f"{name!r} does not fit: {error}", where=what) from error


def _item_type(field_type: str) -> str:
    """Return the type of the items of a field such as ``sequence<std_msgs/Header>``; empty for numbers and texts."""
    found = re.fullmatch(r"(?:sequence<)?(\w+)/(\w+)(?:, \d+)?(?:>|\[\d+\])", field_type)
    return f"{found[1]}/msg/{found[2]}" if found else ""


def _filled_item(kind: str | None, item: Any, what: str) -> Any:
    if not isinstance(item, Mapping):
        return item
    owner = installed_class(kind) if kind else None
    message = OpenMessage() if kind is None or owner is None else owner()
    fill_message(message, item, what)
    return message


def make_message(kind: str, fields: Fields) -> Any:
    """Make a message of a ROS type such as ``std_msgs/msg/String`` from a mapping of its fields, nested ones too.

    Raises:
        InstallationError: The package of the type is not installed.
        MessageError: A field is unknown, or a value does not fit its type.
    """
    owner = installed_class(kind)
    if owner is None:
        package = kind.partition("/")[0]
        remedy = f"source a ROS installation that has {package}, or {interfaces_command('robot_interfaces')}"
        raise InstallationError(f"the ROS package {package} is not installed", where=kind, remedy=remedy)
    message = owner()
    fill_message(message, fields, kind)
    return message


def interface(kind: type | str, folder: Literal["srv", "action"]) -> Interface:
    """Return the type of a service or action by its class of rclpy or its name. Raises GraphError."""
    parts = SERVICE_PARTS if folder == "srv" else ACTION_PARTS
    what = {"srv": "service", "action": "action"}[folder]
    remedy = f"give its class, or its name as in {'std_srvs/srv/SetBool' if folder == 'srv' else EXAMPLE_ACTION}"
    if isinstance(kind, type):
        if not all(hasattr(kind, part) for part in parts):
            raise GraphError(f"{kind.__name__} is no type of a ROS {what}", remedy=remedy)
        return Interface(f"{kind.__module__.partition('.')[0]}/{folder}/{kind.__name__}", parts)
    if not re.fullmatch(rf"[a-z]\w*(/{folder})?/[A-Z]\w*", kind):
        raise GraphError(f"{kind!r} is no type of a ROS {what}", remedy=remedy)
    package, *_, name = kind.split("/")
    return Interface(f"{package}/{folder}/{name}", parts)


EXAMPLE_ACTION = "nav2_msgs/action/NavigateToPose"
SERVICE_PARTS, ACTION_PARTS = ("Request", "Response"), ("Goal", "Result", "Feedback")


@dataclass(frozen=True)
class CallResult:
    """Result of a call.

    Attributes:
        outcome: How the call ended.
        message: Response of a service, or result of an action; None if there is none.
        reason: What went wrong and what to do about it; empty after success.
    """

    outcome: Outcome
    message: Any = None
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether a service answered, or an action succeeded."""
        return self.outcome == "succeeded"


class Channel(Protocol):
    """Connection of a runner to the servers of one client."""

    topic: str

    def send(self, call: PendingCall) -> None:
        """Send a call once there is a server, and report to it in the thread of its node, but not before returning."""
        ...

    def cancel(self, call: PendingCall) -> None:
        """Ask the server to cancel a goal; ignore the answer to a call that has ended."""
        ...


class PendingCall:
    """Call of a service or goal of an action, in progress until it has a ``result``.

    Attributes:
        message: The request or goal.
        accepted: Whether a server has accepted the goal.
        result: The result; None before the end.
    """

    def __init__(
        self,
        node: Node,
        port: ClientPort,
        message: Any,
        then: Then | None,
        feedback: Callable[[Any], None] | None,
        deadline_s: float,
    ) -> None:
        self.message = message
        self.accepted = False
        self.result: CallResult | None = None
        self._context = node.context
        self._port = port
        self._then = then
        self._feedback = feedback
        self._deadline_s = deadline_s
        self._sent = False
        self._cancelling = False
        self._channel = node.context.channel(port)
        self._timers: list[Timer] = []
        self._call_after(min(SERVER_WAIT_S, deadline_s or math.inf), self._check_server)
        if deadline_s:
            self._call_after(deadline_s, self._on_deadline)
        self._channel.send(self)

    @property
    def topic(self) -> str:
        """Full name of the service or action."""
        return self._channel.topic

    def cancel(self) -> None:
        """Cancel the call. A server that has the goal decides whether it ends; a service is no longer waited for."""
        if self.result is not None or self._cancelling:
            return
        self._cancelling = True
        if not self._sent or not self._port.interface.is_action:
            self._channel.cancel(self)
            self.end("cancelled")
            return
        self._call_after(CANCEL_WAIT_S, self._on_unconfirmed)
        self._channel.cancel(self)

    # Reports of the runner, in the thread of the node

    def on_sent(self) -> None:
        """The call was sent to a server."""
        self._sent = True

    def on_accepted(self) -> None:
        """The server accepted the goal."""
        self.accepted = True

    def on_feedback(self, message: Any) -> None:
        """The server sent feedback."""
        if self.result is None and self._feedback is not None:
            self._feedback(message)

    def on_cancel_refused(self) -> None:
        """The server continues with the goal."""
        self._cancelling = False

    def end(self, outcome: Outcome, message: Any = None, reason: str = "") -> None:
        """End the call; only the first call counts."""
        if self.result is not None:
            return
        for timer in self._timers:
            timer.cancel()
        self.result = CallResult(outcome, message, reason or self._reason(outcome))
        if self._then is not None:
            self._context.call_soon(functools.partial(self._then, self.result))

    def _call_after(self, seconds: float, callback: Callable[[], None]) -> None:
        self._timers.append(self._context.call_at(self._context.clock.now() + nanoseconds(seconds), callback))

    def _check_server(self) -> None:
        if self.result is None and not self._sent:
            self._channel.cancel(self)
            self.end("absent")

    def _on_deadline(self) -> None:
        if self.result is None:
            self._channel.cancel(self)
            self.end("timeout")

    def _on_unconfirmed(self) -> None:
        if self._cancelling:
            self.end("cancelled", reason=f"{self.topic} did not confirm the end of the goal: check its node")

    def _reason(self, outcome: Outcome) -> str:
        name, kind = self.topic, self._port.interface.name
        waited_s = min(SERVER_WAIT_S, self._deadline_s or math.inf)
        return {
            "succeeded": "",
            "cancelled": "",
            "aborted": f"{name} aborted the goal: see the log of its node",
            "rejected": f"{name} rejected the goal: check its fields, and whether its node is active",
            "timeout": f"{name} gave no result within {self._deadline_s:g} s: see the log of its node, "
            f"or raise deadline_s",
            "absent": f"{name} ({kind}) had no server within {waited_s:g} s: start its node, or remap the client",
            "lost": f"the server of {name} went away during the call: call again once it is back",
        }[outcome]


class GoalChannel(Protocol):
    """Connection of a runner to the client of one goal."""

    def feedback(self, message: Any) -> None: ...

    def end(self, outcome: Outcome, result: Any) -> None: ...


class GoalHandle:
    """Goal that an action server works on. It ends with `succeed`, `abort` or `cancelled`.

    Attributes:
        request: Fields of the goal.
        cancelling: Whether the client asked for its cancellation.
    """

    def __init__(self, interface: Interface, request: Any, channel: GoalChannel) -> None:
        self.request = request
        self.cancelling = False
        self.rejected = False
        self.active = True
        self._interface = interface
        self._channel = channel

    def reject(self) -> None:
        """Refuse the goal; only in the handler of new goals."""
        self.rejected = True
        self.active = False

    def feedback(self, feedback: Any = None) -> None:
        """Send feedback: a message, or a mapping of its fields."""
        if self.active:
            self._channel.feedback(self._interface.make("Feedback", feedback))

    def succeed(self, result: Any = None) -> None:
        """End the goal successfully with a result: a message, or a mapping of its fields."""
        self._end("succeeded", result)

    def abort(self, result: Any = None) -> None:
        """End the goal as failed."""
        self._end("aborted", result)

    def cancelled(self, result: Any = None) -> None:
        """End the goal as its client asked. Raises GraphError if it did not."""
        if self.active and not self.cancelling:
            raise GraphError("nobody asked to cancel the goal", remedy="call abort() to end it with a failure")
        self._end("cancelled", result)

    def _end(self, outcome: Outcome, result: Any) -> None:
        if self.active:
            message = self._interface.make("Result", result)
            self.active = False
            self._channel.end(outcome, message)
