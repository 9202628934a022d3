"""Runs on Foxglove's WebSocket, read by a client that speaks its protocol."""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
import sys
import threading
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.bags.types import RosbagsTypes
from socialbot.bridge.node_services import set_parameter
from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, ParameterError
from socialbot.core.messages import JointTrajectory, PersonDetection, PersonDetections, TraceRecord, Utterance
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Parameter
from socialbot.runs.folder import open_run
from socialbot.runs.run import Picture
from socialbot.runs.serving import Address

pytest.importorskip("foxglove")
websocket = pytest.importorskip("tornado.websocket")

from socialbot.runs import foxglove_live  # noqa: E402
from socialbot.runs.foxglove_live import PICTURES, LiveFeed, foxglove_server, play_to_foxglove  # noqa: E402
from socialbot.runtime.bag_source import replay  # noqa: E402
from tests.bridge.hosting import node_hosts  # noqa: E402
from tests.system.running import eventually  # noqa: E402
from tests.vision.metrics.scenes import drawn_bag  # noqa: E402

T = TypeVar("T")
WALDO = load_graph("waldo")
SUBPROTOCOL = "foxglove.sdk.v1"
PATIENCE_S = 60.0
MESSAGE = 1  # opcode of a message


class Viewer:
    """Client as Foxglove: it subscribes to every channel and keeps the messages by topic."""

    def __init__(self, socket: Any) -> None:
        self.info: dict[str, Any] = {}
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        self.answers: list[dict[str, Any]] = []
        self._socket = socket

    @classmethod
    async def connect(cls, url: str) -> Viewer:
        return cls(await websocket.websocket_connect(url, subprotocols=[SUBPROTOCOL], connect_timeout=PATIENCE_S))

    async def send(self, **content: Any) -> None:
        await self._socket.write_message(json.dumps(content))

    async def until(self, done: Callable[[Viewer], bool]) -> None:
        """Read until ``done``; raises TimeoutError."""
        while not done(self):
            data = await asyncio.wait_for(self._socket.read_message(), PATIENCE_S)
            assert data is not None, "the server closed the connection"
            if isinstance(data, bytes):
                self._take(data)
                continue
            answer = json.loads(data)
            if answer["op"] == "serverInfo":
                self.info = answer
            elif answer["op"] == "advertise":
                new = {each["id"]: each for each in answer["channels"]}
                self.channels |= new
                await self.send(op="subscribe", subscriptions=[{"id": id, "channelId": id} for id in new])
            else:
                self.answers.append(answer)

    def _take(self, data: bytes) -> None:
        if data[0] == MESSAGE:
            id, stamp = int.from_bytes(data[1:5], "little"), int.from_bytes(data[5:13], "little")
            self.messages.setdefault(self.channels[id]["topic"], []).append((stamp, data[13:]))

    def read(self, topic: str) -> list[Any]:
        types = RosbagsTypes()
        [kind] = {each["schemaName"] for each in self.channels.values() if each["topic"] == topic}
        return [types.deserialize(data, kind) for _, data in self.messages.get(topic, [])]

    def close(self) -> None:
        self._socket.close()


def viewing(url: str, work: Callable[[Viewer], Awaitable[T]]) -> T:
    async def view() -> T:
        viewer = await Viewer.connect(url)
        try:
            return await work(viewer)
        finally:
            viewer.close()

    return asyncio.run(view())


class OneImage:
    """Camera of a live run."""

    def at(self, stamp: int) -> Picture:
        return Picture(stamp, b"\xff\xd8a picture\xff\xd9")


def person() -> PersonDetection:
    return PersonDetection(x=10, y=20, w=30, h=80, score=0.9, track_id="t1", distance_m=2.5, bearing_rad=0.1)


def test_a_live_run_is_shown_with_pictures_boxes_minds_parameters_and_connections():
    start = 1_700_000_000 * SECOND
    with foxglove_server("waldo", WALDO, Address(port=0)) as (server, url), LiveFeed(server, WALDO, OneImage()) as feed:

        def happen(number: int) -> None:
            now = start + number * SECOND // 10
            found = PersonDetections(stamp=now, frame_id="camera", width=640, height=480, persons=(person(),))
            feed.observe("/humans/bodies/detections", found)
            belief = TraceRecord(
                stamp=now,
                id=f"b{number}",
                source="bdi_engine",
                kind="belief",
                what=f"people({number})",
                cause="",
                detail={},
            )
            feed.observe("/bdi_engine/trace", belief)
            feed.observe("/speech/say", Utterance(stamp=now, id=f"u{number}", text="Hello!", cause=f"b{number}"))
            joints = JointTrajectory(
                stamp=now, joint_names=("a", "b"), positions=(0.2, 0.1), velocities=(0.0, 0.0), duration_s=0.1
            )
            feed.observe("/head", joints)
            feed.note_node(now, "bdi_engine", {"state": "running"})

        async def go_on() -> None:
            for number in itertools.count():
                happen(number)
                await asyncio.sleep(0.02)

        async def look(viewer: Viewer) -> Viewer:
            wanted = {
                PICTURES, "/humans/bodies/detections", "/humans/bodies/image_annotations", "/humans/bodies/markers",
                "/tf", "/tf_static", "/joint_states", "/trace", "/rosout", "/bdi_engine/mind", "/diagnostics",
            }  # fmt: skip
            answers = {"parameterValues", "connectionGraphUpdate"}
            await viewer.until(lambda one: bool(one.info))
            await viewer.send(op="getParameters", parameterNames=[], id="all")
            await viewer.send(op="subscribeConnectionGraph")
            goes_on = asyncio.ensure_future(go_on())
            await viewer.until(
                lambda one: wanted <= one.messages.keys() and answers <= {each["op"] for each in one.answers}
            )
            await viewer.until(lambda one: len(one.messages["/joint_states"]) >= 30)
            goes_on.cancel()
            return viewer

        seen = viewing(url, look)
    assert url.startswith("ws://127.0.0.1:")
    assert seen.info["name"] == "waldo"
    assert {"parameters", "connectionGraph", "time"} <= set(seen.info["capabilities"])
    image, found = seen.read(PICTURES)[0], seen.read("/humans/bodies/detections")[0]
    assert bytes(image.data) == b"\xff\xd8a picture\xff\xd9"
    assert found.persons[0].track_id == "t1"
    stamps = {stamp for stamp, _ in seen.messages[PICTURES]}
    assert stamps & {stamp for stamp, _ in seen.messages["/humans/bodies/image_annotations"]}
    assert any("people" in str(mind.beliefs) for mind in seen.read("/bdi_engine/mind"))
    assert any("Hello!" in entry.msg for entry in seen.read("/rosout"))
    assert max(seen.read("/joint_states")[-1].position) == pytest.approx(0.2, abs=0.01)
    [values] = [each["parameters"] for each in seen.answers if each["op"] == "parameterValues"]
    assert {each["name"]: each.get("value") for each in values}["bdi_engine.greeting"] == "Hello! Nice to see you."
    [graph] = [each for each in seen.answers if each["op"] == "connectionGraphUpdate"]
    assert {"name": "/humans/bodies/detections", "publisherIds": ["person_detector"]} in graph["publishedTopics"]


def test_a_recorded_run_plays_through_the_same_server(tmp_path):
    bag = drawn_bag(tmp_path, frames=4)
    hog = WALDO.with_parameters({"person_detector": {"detector": "hog"}})
    replay(bag, hog, tmp_path / "run")
    run, stopped = open_run(tmp_path / "run"), threading.Event()
    with open_bag(bag) as opened, foxglove_server(run.title, run.graph, Address(port=0)) as (server, url):
        player = threading.Thread(
            target=lambda: play_to_foxglove(server, run, opened, 4.0, stopped, loop=True), daemon=True
        )
        player.start()

        async def look(viewer: Viewer) -> Viewer:
            await viewer.until(lambda one: len(one.messages.get("/camera/image_raw/compressed", ())) >= 4)
            await viewer.until(
                lambda one: "/trace" in one.messages and "/humans/bodies/image_annotations" in one.messages
            )
            return viewer

        seen = viewing(url, look)
        stopped.set()
        player.join(PATIENCE_S)
        assert not player.is_alive()
    pictures = seen.read("/camera/image_raw/compressed")
    assert all(np.asarray(each.data)[:2].tolist() == [0xFF, 0xD8] for each in pictures)


def test_other_addresses_need_a_token():
    with pytest.raises(ParameterError, match="--host"):
        Address("0.0.0.0", 0)
    with foxglove_server("waldo", WALDO, Address("0.0.0.0", 0, "secret-token")) as (_, url):
        assert url.endswith("/?token=secret-token")

        async def look(viewer: Viewer) -> str:
            await viewer.until(lambda one: bool(one.info))
            return viewer.info["name"]

        assert viewing(url, look) == "waldo"
        for wrong in (url.replace("secret", "guess"), url.partition("?")[0]):
            with pytest.raises(Exception, match="401"):
                viewing(wrong, look)


@pytest.mark.skipif(sys.platform != "linux", reason="has one loopback address")
def test_nobody_passes_by_the_gate_at_a_known_address():
    """Any page in a browser of this computer can try all ports of 127.0.0.1, and would need no token there."""
    with foxglove_server("waldo", WALDO, Address(port=0, token="secret-token")) as (server, url):
        assert f":{server.port}/" not in url
        with pytest.raises(ConnectionRefusedError):
            accepts(server.port)


def test_strangers_get_a_limited_number_of_connections(monkeypatch: pytest.MonkeyPatch):
    """Each takes a file descriptor of the process, which may be that of `up`."""
    monkeypatch.setattr(foxglove_live, "MAX_CONNECTIONS", 3)
    monkeypatch.setattr(foxglove_live, "_HEAD_S", 600.0)
    with foxglove_live.gate(Address(port=0, token="secret-token"), "127.0.0.1", 1) as port:

        def refused(connection: socket.socket) -> bytes:
            with connection:
                connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
                return connection.recv(12)

        idle = [socket.create_connection(("127.0.0.1", port), timeout=60.0) for _ in range(3)]
        with socket.create_connection(("127.0.0.1", port), timeout=60.0) as further:
            assert further.recv(1) == b""
        assert refused(idle.pop()) == b"HTTP/1.1 401"
        assert eventually(lambda: accepts(port))
        for each in idle:
            each.close()


def accepts(port: int) -> bool:
    """Whether a connection is not closed at once."""
    with socket.create_connection(("127.0.0.1", port), timeout=0.2) as made:
        try:
            return made.recv(1) != b""
        except TimeoutError:
            return True


class Guard(Node):
    """A node with parameters."""

    share = Parameter(0.5, "share that counts", minimum=0.0, maximum=1.0)
    device = Parameter(3, "number of the device", fixed=True)


@pytest.mark.slow
def test_viewers_with_a_token_set_parameters_of_running_nodes():
    graph = Graph("guard", (NodeConfig("guard", Guard),))

    async def setting(viewer: Viewer) -> dict[str, Any]:
        await viewer.until(lambda one: bool(one.info))
        wanted = {"guard.share": 1, "guard.device": 4, "guard.other": 1}
        given = [{"name": name, "value": value} for name, value in wanted.items()]
        await viewer.send(op="setParameters", parameters=given, id="set")
        await viewer.until(lambda one: bool(one.answers))
        return {each["name"]: each["value"] for each in viewer.answers[-1]["parameters"]}

    with node_hosts(graph) as host:
        hosted = host("guard")
        assert eventually(lambda: hosted.active_thread is not None)
        for token, share in ("", 0.5), ("secret-token", 1.0):
            with foxglove_server("guard", graph, Address(port=0, token=token), set_parameter) as (_, url):
                assert viewing(url, setting) == {"guard.share": share, "guard.device": 3}
            assert hosted.node.share == share


def test_a_port_in_use_is_told():
    with (
        foxglove_server("one", WALDO, Address(port=0)) as (server, _),
        pytest.raises(DeviceError, match="choose another port"),
        foxglove_server("two", WALDO, Address(port=server.port)),
    ):
        pass
