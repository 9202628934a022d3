"""Clocks that jump, frames that come twice or out of order, nodes of one name, messages whose fields are anything."""

from __future__ import annotations

from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.waldo.head import Head
from socialbot.agents.waldo.nodes import WaldoNode
from socialbot.bags import codec
from socialbot.bags.reader import Stamps
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, MessageError, ParameterError, SocialbotError
from socialbot.core.messages import (
    ActionRequest,
    BoxMarkers,
    CameraInfo,
    CompressedImage,
    Image,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    Structured,
)
from socialbot.core.registry import node_types
from socialbot.graph.files import node_type
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig, check_parameters
from socialbot.vision.images import ENCODINGS, bgr_from_image
from tests.fuzz import quick

DETECTIONS = "/humans/bodies/detections"
START = 1_700_000_000 * SECOND

ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=9),
    st.lists(st.integers() | st.floats() | st.text(max_size=3) | st.none(), max_size=9),
)


def seen(stamp: int, distance_m: float = 2.0) -> PersonDetections:
    person = PersonDetection(x=0, y=0, w=10, h=30, score=1.0, track_id="t1", distance_m=distance_m, bearing_rad=0.1)
    return PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=(person,))


def ros(**fields: Any) -> SimpleNamespace:
    """A ROS message of any type with what each of its fields may be."""
    stamp = SimpleNamespace(sec=1, nanosec=2)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="camera"), **fields)


FIELDS: dict[type[Message], tuple[str, ...]] = {
    Image: ("height", "width", "encoding", "step", "data", "is_bigendian"),
    CompressedImage: ("format", "data"),
    CameraInfo: ("k", "d", "width", "height", "distortion_model"),
    JointTrajectory: ("joint_names", "points"),
    BoxMarkers: ("type", "points"),
    Structured: ("data",),
}


@pytest.mark.parametrize("kind", FIELDS, ids=lambda kind: kind.__name__)
def test_fields_of_any_type_make_a_message_or_are_refused(kind: type[Message]) -> None:
    @settings(quick, max_examples=60)
    @given(st.fixed_dictionaries(dict.fromkeys(FIELDS[kind], ANYTHING)))
    def holds(fields: dict[str, Any]) -> None:
        with suppress(MessageError):
            assert isinstance(codec.decode(kind, ros(**fields), stamp=5), kind)

    holds()


@settings(quick, max_examples=200)
@given(
    st.sampled_from(ENCODINGS),
    st.integers(0, 40),
    st.integers(0, 40),
    st.integers(0, 2**32 - 1) | st.integers(0, 60),
    st.integers(0, 300),
)
def test_a_picture_never_shows_more_than_its_data(encoding: str, width: int, height: int, step: int, size: int) -> None:
    data = np.zeros(size, np.uint8)
    image = Image(stamp=1, frame_id="c", height=height, width=width, encoding=encoding, step=step, data=data)
    try:
        pixels = bgr_from_image(image)
    except SocialbotError:
        return
    assert pixels.shape == (height, width, 3)
    assert (height - 1) * step < size


def life(stamps: list[int], *, times: int = 1) -> InlineRunner:
    """Waldo and his head with ten detections/s whose ``stamps`` (ns) may be wrong."""
    configs = (NodeConfig("waldo", WaldoNode), NodeConfig("head", Head, remap={"command": "/head"}))
    runner = InlineRunner(Graph("test", configs, inputs=frozenset({DETECTIONS, "/head"})), start=START)
    runner.tap("/waldo/actions", lambda _, message: actions.append(message))
    actions: list[Message] = []
    runner.start()
    for number, stamp in enumerate(stamps):
        for _ in range(times):
            runner.feed(DETECTIONS, seen(stamp), time=START + number * SECOND // 10)
    assert {name: faults.first for name, faults in runner.faults.items()} == {"waldo": "", "head": ""}
    assert all(isinstance(action, ActionRequest) for action in actions)
    return runner


@settings(quick, max_examples=25)
@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(START, START + 2 * SECOND), max_size=12))
def test_stamps_may_jump_wherever_they_like(stamps: list[int]) -> None:
    life(stamps)


@settings(quick, max_examples=15)
@given(st.permutations(range(12)), st.integers(1, 3))
def test_frames_may_come_twice_and_out_of_order(order: list[int], times: int) -> None:
    life([START + number * SECOND // 10 for number in order], times=times)


@settings(quick, max_examples=100)
@given(
    st.lists(st.tuples(st.integers(-(2**31) * SECOND, 2**31 * SECOND), st.integers(0, 10 * SECOND)), max_size=20),
    st.booleans(),
)
def test_the_stamps_of_a_bag_never_go_backwards(clocks: list[tuple[int, int]], repeats: bool) -> None:
    stamps, time, last = Stamps("/image", repeats=repeats), START, None
    for header, passed in clocks:
        time += passed
        stamp = stamps.next(header, time)
        assert last is None or stamp >= last
        last = stamp


def test_two_nodes_of_one_name_make_no_graph() -> None:
    twins = (NodeConfig("waldo", WaldoNode), NodeConfig("waldo", Head))
    with pytest.raises(GraphError, match="waldo"):
        Graph("test", twins, inputs=frozenset({DETECTIONS, "/head/command"}))


@pytest.mark.parametrize("name", node_types())
def test_parameters_of_any_type_are_taken_or_refused(name: str) -> None:
    kind: type[Node] = node_type(name)

    @settings(quick, max_examples=20)
    @given(st.dictionaries(st.sampled_from([*kind.parameters(), "other"]), ANYTHING, max_size=4))
    def holds(given: dict[str, object]) -> None:
        try:
            values = check_parameters(kind, given, where=name)
        except ParameterError:
            return
        assert {key: type(value) for key, value in values.items()} == {
            key: type(parameter.default) for key, parameter in kind.parameters().items()
        }

    holds()
