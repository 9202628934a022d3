"""Nodes that record their outputs, and nodes that publish recorded outputs instead of computing them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, MutableMapping
from typing import Any, get_type_hints

import msgspec
import numpy as np

from socialbot.core.decoding import msgpack_decoder
from socialbot.core.errors import NodeError, ParameterError, SocialbotError
from socialbot.core.messages import Message
from socialbot.graph.node import Context, Node, failure_text
from socialbot.graph.ports import Output

BEGIN, START = -2, -1
"""Stamps of the steps in which a node is made and started."""

PUBLISHED, HEALTH, LOGGED = "p", "h", "l"

Event = tuple[str, str, bytes]
"""Kind and content: port and message, state and reason, or level and text."""


class Step(msgspec.Struct, array_like=True):
    """Actions of the node ``node`` on the message of ``stamp`` (ns), and the type and text of its error."""

    node: str
    stamp: int
    events: list[Event]
    error: tuple[str, str] | None = None


def encode(message: Message) -> bytes:
    """Encode a message without the content of its arrays."""
    return msgspec.msgpack.encode(message, enc_hook=_empty)


def decode(data: bytes, kind: type[Message]) -> Message:
    """Decode a message; its arrays are empty."""
    return msgpack_decoder(kind, _array).decode(data)


def has_arrays(kind: type[Message]) -> bool:
    """Whether messages of a type have arrays, such as pixels."""
    return np.ndarray in get_type_hints(kind).values()


def _empty(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return b""
    raise NotImplementedError(f"{type(value).__name__} in a message")


def _array(kind: type, value: Any) -> Any:
    if kind is np.ndarray:
        return np.zeros(0, np.uint8)
    raise NotImplementedError(kind.__name__)


class StepRecorder:
    """Recorder of the steps of nodes; ``write`` gets each step when it has ended.

    ``refused`` is the reason why the steps cannot stand for the nodes; empty if they can.
    """

    def __init__(self, write: Callable[[Step], None]) -> None:
        self.refused = ""
        self._write = write
        self._step: Step | None = None

    def run(self, node: str, stamp: int, work: Callable[[], None]) -> None:
        """Do ``work`` as one step."""
        if self._step is not None:  # a handler that calls another one
            work()
            return
        step = self._step = Step(node, stamp, [])
        try:
            work()
        except Exception as error:
            name, _, text = failure_text(error).partition(": ")
            step.error = name, text
            raise
        finally:
            self._step = None
            self._write(step)

    def note(self, kind: str, name: str, content: bytes) -> None:
        if self._step is None:
            self.refuse("a node acted without a message")
        else:
            self._step.events.append((kind, name, content))

    def refuse(self, why: str) -> None:
        self.refused = self.refused or why


class _RecordingContext:
    """Context that records the messages of its node."""

    def __init__(self, context: Context, recorder: StepRecorder) -> None:
        self._context = context
        self._recorder = recorder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def publish(self, port: Output[Any], message: Message) -> None:
        self._recorder.note(PUBLISHED, port.name, encode(message))
        self._context.publish(port, message)

    def call_at(self, time: int, callback: Callable[[], None]) -> Any:
        self._recorder.refuse("a node set a timer")
        return self._context.call_at(time, callback)

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._recorder.refuse("a node set a timer")
        self._context.call_soon(callback)

    def run_in_background(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        self._recorder.refuse("a node worked in the background")
        self._context.run_in_background(work, then)


class _RecordingLog(logging.LoggerAdapter):  # type: ignore[type-arg]
    def __init__(self, logger: logging.Logger, recorder: StepRecorder) -> None:
        super().__init__(logger, {})
        self._recorder = recorder

    def log(self, level: int, msg: object, *args: Any, **kwargs: Any) -> None:
        if level >= logging.INFO:
            self._recorder.note(LOGGED, str(level), (str(msg) % args if args else str(msg)).encode())
        super().log(level, msg, *args, **kwargs)

    def process(self, msg: Any, kwargs: MutableMapping[str, Any]) -> tuple[Any, MutableMapping[str, Any]]:
        return msg, kwargs


def recording_type(kind: type[Node], recorder: StepRecorder) -> type[Node]:
    """Return a subclass of ``kind`` whose nodes record each step."""

    def begin(self: Node, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        made: Any = _RecordingContext(context, recorder)
        recorder.run(name, BEGIN, lambda: kind.__init__(self, name, made, parameters))

    def report_health(self: Node, state: Any, reason: str = "") -> None:
        recorder.note(HEALTH, state, reason.encode())
        kind.report_health(self, state, reason)

    def set_parameter(self: Node, name: str, value: object) -> None:
        recorder.refuse("a parameter was changed during the run")
        kind.set_parameter(self, name, value)

    def set_log(self: Node, logger: logging.Logger) -> None:
        vars(self)["_log"] = _RecordingLog(logger, recorder)

    def handler(name: str) -> Callable[[Node, Message], None]:
        def handle(self: Node, message: Message) -> None:
            recorder.run(self.name, message.stamp, lambda: getattr(kind, name)(self, message))

        return handle

    return _subclass(
        kind,
        {
            **{port.handler: handler(port.handler) for port in kind.inputs().values() if port.handler},
            "__init__": begin,
            "start": lambda self: recorder.run(self.name, START, lambda: kind.start(self)),
            "report_health": report_health,
            "set_parameter": set_parameter,
            "log": property(lambda self: vars(self)["_log"], set_log),
        },
    )


class StepPlayer:
    """Player of recorded steps, in their order. ``differs`` tells how the messages differ from the recorded ones."""

    def __init__(self, steps: list[Step]) -> None:
        self.differs = ""
        self._steps = iter(steps)

    def play(self, node: Node, stamp: int) -> None:
        """Publish what a node published for the message of ``stamp``.

        Raises:
            NodeError: The message is not the recorded one.
            Exception: As recorded, with the name and text of the recorded one.
        """
        step = next(self._steps, None)
        if step is None or (step.node, step.stamp) != (node.name, stamp):
            self.differs = self.differs or f"{node.name} got a message at {stamp} ns that is not recorded"
            raise NodeError(self.differs, where=node.name)
        outputs = node.outputs()
        for event, name, content in step.events:
            if event == PUBLISHED:
                port = outputs[name]
                node.context.publish(port, decode(content, port.message_type))
            elif event == HEALTH:
                Node.report_health(node, name, content.decode())  # type: ignore[arg-type]
            else:
                node.log.log(int(name), "%s", content.decode())
        if step.error is not None:
            name, text = step.error
            raise type(name, (SocialbotError,), {})(text)  # an error for users: its text has the place already

    def finish(self) -> None:
        """Note steps that were not played."""
        if not self.differs and (step := next(self._steps, None)) is not None:
            self.differs = f"{step.node} got no message at {step.stamp} ns, as recorded"


def playing_type(kind: type[Node], player: StepPlayer) -> type[Node]:
    """Return a subclass of ``kind`` whose nodes publish recorded steps and compute nothing."""

    def begin(self: Node, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        Node.__init__(self, name, context, parameters)
        player.play(self, BEGIN)

    def set_parameter(self: Node, name: str, value: object) -> None:
        raise ParameterError(
            "its results come from the cache and cannot change", where=f"{self.name}.{name}", remedy="use --no-cache"
        )

    def handle(self: Node, message: Message) -> None:
        player.play(self, message.stamp)

    return _subclass(
        kind,
        {
            **{port.handler: handle for port in kind.inputs().values() if port.handler},
            "__init__": begin,
            "start": lambda self: player.play(self, START),
            "stop": lambda self: None,
            "set_parameter": set_parameter,
        },
    )


def _subclass(kind: type[Node], members: dict[str, Any]) -> type[Node]:
    return type(kind.__name__, (kind,), {**members, "__module__": kind.__module__, "__doc__": kind.__doc__})
