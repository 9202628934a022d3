from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import GraphError
from socialbot.core.messages import Image
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, NodeConfig
from socialbot.runtime.deployment import Pictures, with_crossings
from socialbot.vision.camera_node import Camera
from socialbot.vision.image_transport import ImageReceiver, ImageSender
from tests.runtime.deployments import deployment

WALDO = load_graph("waldo")
NODES = [config.name for config in WALDO.nodes]
SENDER, RECEIVER = "camera_image_raw_to_workstation", "camera_image_raw_at_workstation"


def crossings(graph: Graph, places: dict[str, str]) -> list[tuple[str, str, str]]:
    """Topics of raw pictures that go from machine to machine."""
    return [
        (topic, places[sayer.name], places[taker.name])
        for sayer in graph.nodes
        for topic, port in sayer.publications
        if port.message_type is Image
        for taker in graph.nodes
        if any(topic == taken for taken, _ in taker.subscriptions) and places[sayer.name] != places[taker.name]
    ]


def test_inserts_a_sender_and_a_receiver():
    waldo = deployment()
    robot, desk = ({one.name for one in waldo.half(machine)} for machine in ("robot", "workstation"))
    assert robot == {"camera", "speech", "head", SENDER}
    assert desk == {"image_converter", "person_detector", "bdi_engine", "listener", RECEIVER}
    sender, receiver = waldo.graph.node(SENDER), waldo.graph.node(RECEIVER)
    assert sender.parameters == {"quality": 70, "rate_hz": 15}
    assert [topic for topic, _ in sender.subscriptions] == [
        "/camera/image_raw",
        "/camera/image_raw/workstation/link/ack",
    ]
    assert [topic for topic, _ in receiver.publications] == [
        "/camera/image_raw/workstation/link/ack",
        "/camera/image_raw/workstation",
    ]
    assert waldo.graph.node("image_converter").remap == {"image_raw": "/camera/image_raw/workstation"}


def test_only_publishers_of_raw_images_need_large_messages():
    waldo = deployment()
    raw = {one.name for one in waldo.graph.nodes if waldo.raw_pictures(one.name)}
    assert raw == {"camera", "image_converter", RECEIVER}


def test_moving_a_node_moves_the_link():
    moved = deployment(("image_converter: workstation", "image_converter: robot"))
    assert "camera_image_color_to_workstation" in {one.name for one in moved.half("robot")}
    with pytest.raises(GraphError, match="no node"):
        moved.graph.node(SENDER)


def test_raw_transport_inserts_nothing():
    waldo = deployment(("    transport: jpeg\n    quality: 70\n    rate_hz: 15\n", "    transport: raw\n"))
    assert waldo.graph == waldo.written


def test_a_topic_has_a_link_to_each_machine():
    graph = Graph(
        "eyes",
        (
            NodeConfig("camera", Camera),
            NodeConfig("a", ImageSender),
            NodeConfig("b", ImageSender, {}, {"ack": "/b"}),
        ),
        inputs=frozenset({"/camera/image_raw/link/ack", "/b"}),
    )
    crossed, places = with_crossings(graph, {"camera": "robot", "a": "x", "b": "y"}, {})
    assert crossings(crossed, places) == []
    assert [name for name, machine in places.items() if machine == "robot"] == [
        "camera",
        "camera_image_raw_to_x",
        "camera_image_raw_to_y",
    ]


def test_refuses_several_publishing_machines_of_a_topic():
    two = Graph("eyes", (NodeConfig("left", Camera), NodeConfig("right", Camera)))
    with pytest.raises(GraphError, match="several machines: a, b") as caught:
        with_crossings(two, {"left": "a", "right": "b"}, {})
    assert caught.value.where == "nodes.right"


@settings(max_examples=60)
@given(st.lists(st.sampled_from(("robot", "desk", "cellar")), min_size=len(NODES), max_size=len(NODES)))
def test_no_raw_image_leaves_a_machine(machines: list[str]):
    written = dict(zip(NODES, machines, strict=True))
    graph, places = with_crossings(WALDO, written, {})
    assert crossings(graph, places) == []
    assert {name: machine for name, machine in places.items() if name in NODES} == written
    assert {one.name for one in graph.nodes} == places.keys()
    added = [one for one in graph.nodes if one.name not in NODES]
    assert {one.type for one in added} <= {ImageSender, ImageReceiver}
    if len(set(machines)) == 1:
        assert graph == WALDO


def test_crossings_are_independent_of_the_settings_of_other_topics():
    places = dict.fromkeys(NODES, "robot") | {"image_converter": "desk"}
    plain, _ = with_crossings(WALDO, places, {})
    other, _ = with_crossings(WALDO, places, {"/camera/image_color": Pictures("raw")})
    assert {one.name for one in plain.nodes} - {one.name for one in other.nodes} == {
        "camera_image_color_to_robot",
        "camera_image_color_at_robot",
    }
