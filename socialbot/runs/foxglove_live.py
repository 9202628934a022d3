"""Serve a run to Foxglove and Lichtblick over a WebSocket: a live one, or a recorded one in its own time."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import importlib
import ipaddress
import logging
import secrets
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any
from urllib.parse import parse_qs, urlsplit

from socialbot.bags import codec
from socialbot.bags.reader import Bag
from socialbot.bags.types import RosbagsTypes, types_with
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import DeviceError, InstallationError, SocialbotError
from socialbot.core.installation import extra_command
from socialbot.core.messages import CompressedImage, JointTrajectory, Message, Mind, PersonDetections, TraceRecord
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs._streams import HeadTarget, mind_of, sentence_of
from socialbot.runs.folder import RecordedRun
from socialbot.runs.foxglove import (
    ANNOTATIONS,
    DETECTIONS,
    DIAGNOSTICS_EVERY,
    JOINTS,
    MARKERS,
    FoxgloveMessages,
    picture_frame,
    stream_of,
)
from socialbot.runs.narration import Narrator
from socialbot.runs.record import trace_record
from socialbot.runs.run import ImageSource, LiveRun
from socialbot.runs.serving import MAX_CONNECTIONS, Address
from socialbot.runs.standard_messages import HEAD_HZ, TF_MESSAGE, HeadCourse

log = logging.getLogger("socialbot.foxglove")

PICTURES = "/camera/image_raw/compressed"
SetParameter = Callable[[str, str, Any], Any]
"""Function that sets a parameter of a running node, by node and name, and returns its value; raises SocialbotError."""

_TICK_S = 0.05
_POSES = 32  # Target poses of the head that are kept: a turn takes a second or two.


class FoxgloveServer:
    """WebSocket server of the Foxglove SDK with one channel for each topic.

    Args:
        name: Name in Foxglove.
        graph: Graph whose parameters and connections are shown, if known.
        host: Address to listen at.
        port: Port on ``host``; 0: any free one.
        set_parameter: Function for clients that set a parameter; without one they cannot.
    """

    def __init__(
        self, name: str, graph: Graph | None, host: str, port: int, set_parameter: SetParameter | None = None
    ) -> None:
        """Start the server. Raises InstallationError or DeviceError."""
        try:
            foxglove = importlib.import_module("foxglove")
            capability = importlib.import_module("foxglove.websocket").Capability
        except ImportError as error:
            raise InstallationError(
                "the package 'foxglove-sdk' is not installed",
                where="foxglove",
                remedy=extra_command("foxglove"),
            ) from error
        self._foxglove = foxglove
        self._types = RosbagsTypes()
        self._context = foxglove.Context()
        self._channels: dict[tuple[str, str], Any] = {}
        listener: Any = _Parameters(graph, set_parameter)
        try:
            self._server = foxglove.start_server(
                name=name,
                host=host,
                port=port,
                capabilities=[capability.Time, capability.Parameters, capability.ConnectionGraph],
                server_listener=listener,
                supported_encodings=["cdr"],
                context=self._context,
            )
        except (RuntimeError, OSError) as error:
            remedy = "choose another port, or 0 for any free one"
            raise DeviceError(f"cannot serve: {error}", where=f"{host}:{port}", remedy=remedy) from error
        if graph is not None:
            self._server.publish_connection_graph(_connections(graph))

    @property
    def port(self) -> int:
        return self._server.port

    def publish(self, stamp: int, topic: str, message: Any) -> None:
        """Publish a message, or a ROS message of rosbags, as of ``stamp`` (ns)."""
        if isinstance(message, Message):
            kind = codec.ros_type(type(message), "typed")
            data = self._types.serialize(codec.encode(message, self._types, "typed"))
        else:
            kind = message.__msgtype__
            data = self._types.serialize(message)
        self._channel(topic, kind).log(bytes(data), log_time=stamp)

    def declare(self, topics: Mapping[str, str]) -> None:
        """Announce ``topics`` with their ROS types, so that viewers subscribe before the first message."""
        for topic, kind in topics.items():
            self._channel(topic, kind)

    def _channel(self, topic: str, kind: str) -> Any:
        channel = self._channels.get((topic, kind))
        if channel is None:
            text, _ = types_with(kind).generate_msgdef(kind, ros_version=2)
            schema = self._foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
            channel = self._channels[topic, kind] = self._foxglove.Channel(
                topic, schema=schema, message_encoding="cdr", context=self._context
            )
        return channel

    def set_time(self, stamp: int) -> None:
        self._server.broadcast_time(stamp)

    def restart(self) -> None:
        """Make viewers forget what they have, because time starts again."""
        self._server.clear_session()

    def close(self) -> None:
        self._server.stop()


def topics_of(graph: Graph | None) -> dict[str, str]:
    """Return the topics of a run of ``graph`` for viewers, with their ROS types."""
    agents = [config.name for config in graph.nodes if config.type.is_agent] if graph is not None else []
    minds = dict.fromkeys((f"/{name}/mind" for name in agents), codec.ros_type(Mind, "typed"))
    return {
        DETECTIONS: codec.ros_type(PersonDetections, "typed"),
        ANNOTATIONS: "foxglove_msgs/msg/ImageAnnotations",
        MARKERS: "visualization_msgs/msg/MarkerArray",
        "/tf": TF_MESSAGE,
        "/tf_static": TF_MESSAGE,
        JOINTS: "sensor_msgs/msg/JointState",
        "/trace": codec.ros_type(TraceRecord, "typed"),
        "/rosout": "rcl_interfaces/msg/Log",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        **minds,
    }


class _Parameters:
    """Answers requests for parameters with those of the graph, as ``node.name``, and sets them by ``change``."""

    def __init__(self, graph: Graph | None, change: SetParameter | None) -> None:
        self._change = change
        self._values: dict[str, Any] = {}
        for config in graph.nodes if graph is not None else ():
            values = check_parameters(config.type, config.parameters, where=config.name)
            self._values.update({f"{config.name}.{name}": value for name, value in values.items()})

    def on_get_parameters(self, client: Any, param_names: Sequence[str], request_id: str | None = None) -> list[Any]:
        parameter = importlib.import_module("foxglove").Parameter
        names = param_names or list(self._values)
        return [parameter(name, value=self._values[name]) for name in names if name in self._values]

    def on_set_parameters(self, client: Any, parameters: Sequence[Any], request_id: str | None = None) -> list[Any]:
        """Set known parameters of running nodes; the answer holds the values that are valid then."""
        for each in parameters:
            if each.name not in self._values:
                continue
            if self._change is None:
                log.warning("%s stays as it is: viewers may set parameters of a live run with a token", each.name)
                continue
            node, _, name = each.name.partition(".")
            try:
                self._values[each.name] = self._change(node, name, each.get_value())
            except SocialbotError as error:
                log.warning("a viewer could not set %s: %s", each.name, error)
            else:
                log.warning("a viewer set %s to %r", each.name, self._values[each.name])
        return self.on_get_parameters(client, [each.name for each in parameters], request_id)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("on_"):
            return lambda *_: None
        raise AttributeError(name)


def _connections(graph: Graph) -> Any:
    made = importlib.import_module("foxglove").ConnectionGraph()
    for announce, pairs in (
        (made.set_published_topic, [(topic, each.name) for each in graph.nodes for topic, _ in each.publications]),
        (made.set_subscribed_topic, [(topic, each.name) for each in graph.nodes for topic, _ in each.subscriptions]),
        (made.set_advertised_service, [(topic, each.name) for each in graph.nodes for topic, _ in each.servers]),
    ):
        for topic in dict(pairs):
            announce(topic, [name for named, name in pairs if named == topic])
    return made


@contextmanager
def foxglove_server(
    name: str, graph: Graph | None, address: Address, set_parameter: SetParameter | None = None
) -> Iterator[tuple[FoxgloveServer, str]]:
    """Serve at ``address``; yield the server and its URL. With a token, only clients that know it get through.

    ``set_parameter`` needs a token: any page in a browser of this computer can connect to an open port.

    Raises:
        InstallationError: The package is missing.
        DeviceError: The port is in use.
    """
    with ExitStack() as stack:
        inner = (_inner_host(), 0) if address.token else (address.host, address.port)
        server = FoxgloveServer(name, graph, *inner, set_parameter=set_parameter if address.token else None)
        stack.callback(server.close)
        port = server.port
        if address.token:
            port = stack.enter_context(gate(address, inner[0], server.port))
        yield server, address.url(port).replace("http://", "ws://", 1)


class LiveFeed:
    """Listener of a live run that publishes what it observes, from a thread of its own."""

    def __init__(self, server: FoxgloveServer, graph: Graph, images: ImageSource | None = None) -> None:
        self._server = server
        self._images = images
        self._run = LiveRun(graph)
        self._show = FoxgloveMessages(self._run)
        self._narrator = Narrator(self._run.wording)
        self._received: deque[tuple[str, Message]] = deque()
        self._poses: deque[HeadTarget] = deque(maxlen=_POSES)
        self._course = HeadCourse(())
        self._minds: dict[str, Any] = {}
        self._picture = self._head = self._checked = 0
        self._stopped = threading.Event()
        pictures = {} if images is None else {PICTURES: codec.ros_type(CompressedImage, "typed")}
        server.declare({**topics_of(graph), **pictures})
        self._thread = threading.Thread(target=self._work, name="foxglove", daemon=True)

    def __enter__(self) -> LiveFeed:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()

    def observe(self, topic: str, message: Message) -> None:
        """Receive a message of the run, from any thread."""
        self._run.observe(topic, message)
        self._received.append((topic, message))

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        """Receive a report of a node, from any thread."""
        self._run.note_node(stamp, name, values)

    def note_problem(self, text: str) -> None:
        self._run.note_problem(text)

    def _work(self) -> None:
        while not self._stopped.wait(_TICK_S):
            try:
                self.tick()
            except Exception:  # a viewer must not stop a robot
                log.exception("a message could not be shown")

    def tick(self) -> None:
        """Publish what was received since the last call."""
        while self._received:
            for item in self._items(*self._received.popleft()):
                self._server.publish(*item)
        now = self._run.end
        if not now:
            return
        self._server.set_time(now)
        for agent in self._run.states.at(now).agents:
            mind = mind_of(self._run, agent, now)
            content = (mind.beliefs, mind.desires, mind.intentions)
            if self._minds.get(agent.name) != content:
                self._minds[agent.name] = content
                self._server.publish(now, f"/{agent.name}/mind", mind)
        if now - self._head >= nanoseconds(1 / HEAD_HZ):
            self._head = now
            for item in self._show.head_at(now, self._course.at(now)):
                self._server.publish(*item)
        if now - self._checked >= DIAGNOSTICS_EVERY:
            self._checked = now
            for item in (self._show.camera_at(now), *self._show.diagnostics_at(now)):
                self._server.publish(*item)

    def _items(self, topic: str, message: Message) -> Iterator[tuple[int, str, Any]]:
        record = trace_record(topic, message)
        if isinstance(message, PersonDetections):
            yield from self._picture_of(message)
            yield from self._show.of_detections(message, self._course.at(message.stamp))
        elif isinstance(message, JointTrajectory) and len(message.positions) == 2:
            pan, tilt = message.positions
            self._poses.append(HeadTarget(message.stamp, pan, tilt, message.duration_s))
            self._course = HeadCourse(self._poses)
        if record is None:
            return
        yield record.stamp, "/trace", record
        if (sentence := sentence_of(self._narrator, record)) is not None:
            yield self._show.of_sentence(sentence)

    def _picture_of(self, found: PersonDetections) -> Iterator[tuple[int, str, Any]]:
        """Yield the image in which people were found, once; the viewer draws boxes on the image of their stamp."""
        import numpy as np

        picture = None if self._images is None else self._images.at(found.stamp)
        if picture is not None and picture.stamp != self._picture:
            self._picture = picture.stamp
            data = np.frombuffer(picture.jpeg, np.uint8)
            image = CompressedImage(stamp=picture.stamp, frame_id=found.frame_id, format="jpeg", data=data)
            yield picture.stamp, PICTURES, image


def play_to_foxglove(
    server: FoxgloveServer, run: RecordedRun, bag: Bag | None, rate: float, stopped: threading.Event, *, loop: bool
) -> int:
    """Play a recorded run at a multiple of its speed (0: as fast as possible), again and again if ``loop``.

    Returns:
        The number of messages.
    """
    show = FoxgloveMessages(run, "" if bag is None else picture_frame(bag))
    pictures = {} if bag is None else {topic.name: topic.type for topic in bag.image_topics}
    server.declare({**topics_of(run.graph), **pictures})
    count = 0
    while True:
        begun, start, shown, static = time.monotonic(), None, 0, None
        for stamp, topic, message in stream_of(show, bag):
            start = stamp if start is None else start
            due = (stamp - start) / SECOND / rate if rate else 0.0
            if stopped.wait(max(0.0, due - (time.monotonic() - begun))):
                return count
            server.publish(stamp, topic, message)
            server.set_time(stamp)
            count += 1
            static = message if topic == "/tf_static" else static
            if static is not None and stamp - shown >= SECOND:  # for later viewers
                shown = stamp
                server.publish(stamp, "/tf_static", static)
        if not loop or not count:
            return count
        server.restart()


_MAX_HEAD = 16_384  # bytes of a request
_HEAD_S = 5.0
_REFUSED = b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_BLOCK = 65_536


def _inner_host() -> str:
    """Return a loopback address that no page in a browser of this computer can guess: Linux has 16 million."""
    if sys.platform != "linux":
        return "127.0.0.1"
    network = ipaddress.ip_network("127.0.0.0/8")
    return str(network[2 + secrets.randbelow(network.num_addresses - 3)])  # neither the known address nor broadcast


@contextmanager
def gate(address: Address, inner_host: str, inner_port: int) -> Iterator[int]:
    """Accept connections at ``address`` and pass those with its token on to the inner server; yield the own port.

    A client gives the token in the URL: ``ws://host:port/?token=TOKEN``. Raises DeviceError if the port is in use.
    """
    loop = asyncio.new_event_loop()
    connections: set[asyncio.StreamWriter] = set()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(connections) >= MAX_CONNECTIONS:  # or else strangers take all file descriptors of the process
            writer.close()
            return
        connections.add(writer)
        try:
            await _accept(reader, writer, address.token, inner_host, inner_port)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError) as error:
            log.debug("a connection ended: %s", error)
        finally:
            connections.discard(writer)
            writer.close()

    try:
        server = loop.run_until_complete(asyncio.start_server(accept, address.host, address.port, limit=_MAX_HEAD))
    except OSError as error:
        loop.close()
        remedy = "choose another port, or 0 for any free one"
        where = f"{address.host}:{address.port}"
        raise DeviceError(f"cannot serve: {error.strerror}", where=where, remedy=remedy) from error
    thread = threading.Thread(target=loop.run_forever, name="foxglove gate", daemon=True)
    thread.start()
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        asyncio.run_coroutine_threadsafe(_close(server), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _close(server: asyncio.Server) -> None:
    server.close()
    own = asyncio.current_task()
    tasks = [task for task in asyncio.all_tasks() if task is not own]
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _accept(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, token: str, inner_host: str, inner_port: int
) -> None:
    head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
    target = head.split(b" ", 2)[1].decode("latin-1") if head.count(b" ") >= 2 else ""
    given = parse_qs(urlsplit(target).query).get("token", [""])[0]
    if not hmac.compare_digest(given.encode(), token.encode()):
        writer.write(_REFUSED)
        await writer.drain()
        return
    inner_reader, inner_writer = await asyncio.open_connection(inner_host, inner_port)
    try:
        # The server sees neither the token nor another path.
        inner_writer.write(head.replace(target.encode("latin-1"), b"/", 1))
        ways = [
            asyncio.ensure_future(_pass_on(reader, inner_writer)),
            asyncio.ensure_future(_pass_on(inner_reader, writer)),
        ]
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
    finally:
        inner_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(_BLOCK):
            writer.write(data)
            await writer.drain()
