"""A running graph in messages that other packages know."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.messages import JointTrajectory, PersonDetection, PersonDetections, Utterance
from socialbot.graph.files import load_graph
from socialbot.runs.standard_messages import Engagement, Mounting, engagement_of, mounting_of
from tests.system.running import eventually

pytestmark = pytest.mark.ros

WALDO = load_graph("waldo")


def people(*persons: PersonDetection) -> PersonDetections:
    return PersonDetections(stamp=SECOND, frame_id="camera", width=640, height=480, persons=persons)


ANN = PersonDetection(x=10.0, y=20.0, w=80.0, h=200.0, score=0.9, track_id="t1", distance_m=2.0, bearing_rad=0.1)


def turn(stamp: int, pan: float, tilt: float, duration_s: float) -> JointTrajectory:
    names = ("head_pan_joint", "head_tilt_joint")
    return JointTrajectory(
        stamp=stamp, joint_names=names, positions=(pan, tilt), velocities=(0.0, 0.0), duration_s=duration_s
    )


def test_translates_people_and_head_joints() -> None:
    from socialbot.bridge.translator import translated_topics

    assert set(translated_topics(WALDO)) == {
        "/humans/bodies/detections",
        "/head_controller/joint_trajectory",
        "/speech/say",
        "/humans/voices/speech",
        "/humans/voices/activity",
    }


def test_runs_publish_standard_types_if_the_graph_says_so() -> None:
    from std_msgs.msg import String

    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.translator import SPEECH, with_standard_types

    said, seen = Utterance(stamp=SECOND, id="1", text="Hello!"), []
    graph = replace(WALDO, standard=True)
    with with_standard_types(WALDO, print) as observe:
        assert observe is print, "nothing is added by default"

    with spinning_node("viewer") as viewer:
        heard: list[Any] = []
        viewer.create_subscription(String, SPEECH, heard.append, 10)

        def observed(nodes: list[str] | None, count: int) -> bool:
            with with_standard_types(graph, lambda *each: seen.append(each), nodes) as observe:
                assert eventually(lambda: viewer.count_publishers(SPEECH) == 1)

                def repeated() -> bool:
                    observe("/speech/say", said)
                    return eventually(lambda: len(heard) > count, 0.3)

                return eventually(repeated, 10.0 if nodes is None else 1.5)

        assert observed(None, 0)
        assert {each.data for each in heard} == {"Hello!"}
        assert seen[0] == ("/speech/say", said)
        assert not observed(["camera"], len(heard)), "another machine publishes the sentences"


def test_the_mounting_follows_detector_and_camera() -> None:
    assert mounting_of(WALDO) == Mounting(1.2, 0.0, on_head=False, optical="camera_color_optical_frame")
    changes = {
        "camera": {"frame_id": "eye"},
        "person_detector": {"mount_height_m": 0.9, "pitch_rad": -0.2},
        "head": {"camera_on_head": True},
    }
    assert mounting_of(WALDO.with_parameters(changes)) == Mounting(
        0.9, -0.2, on_head=True, optical="eye", source="given"
    )
    assert mounting_of(load_graph("warehouse")) == Mounting()


def test_publishes_markers_and_joints() -> None:
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import MarkerArray

    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.translator import JOINTS, MARKERS, Translator

    heard = SimpleNamespace(markers=[], joints=[])
    with spinning_node("viewer") as viewer, spinning_node("translator") as ros:
        viewer.create_subscription(MarkerArray, MARKERS, heard.markers.append, 10)
        viewer.create_subscription(JointState, JOINTS, heard.joints.append, 10)
        translator = Translator(ros, WALDO, head=True)

        def told(one: Any, message: Any) -> bool:
            translator.take("/x", message)
            return eventually(lambda: bool(one), 0.3)

        assert eventually(lambda: told(heard.markers, people(ANN)))
        translator.take("/x", turn(ros.get_clock().now().nanoseconds - 5 * SECOND, 0.4, -0.1, 0.5))
        assert eventually(lambda: heard.joints and heard.joints[-1].position[0] == pytest.approx(0.4))
    before, body, text = heard.markers[-1].markers
    assert before.action == before.DELETEALL
    assert (body.type, text.type) == (body.CYLINDER, text.TEXT_VIEW_FACING)
    assert (body.pose.position.x, body.pose.position.y) == pytest.approx((2 * math.cos(0.1), 2 * math.sin(0.1)))
    assert text.text == "t1 2.0 m"
    assert heard.joints[-1].name == ["head_pan_joint", "head_tilt_joint"]


def test_positions_follow_a_camera_on_the_head() -> None:
    from visualization_msgs.msg import MarkerArray

    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.translator import MARKERS, Translator

    heard: list[Any] = []
    graph = WALDO.with_parameters({"head": {"camera_on_head": True}})
    with spinning_node("viewer") as viewer, spinning_node("translator") as ros:
        viewer.create_subscription(MarkerArray, MARKERS, heard.append, 10)
        translator = Translator(ros, graph, head=False)
        translator.take("/x", turn(SECOND // 2, math.pi / 2, 0.0, 0.1))
        translator.take("/x", turn(2 * SECOND, 0.0, 0.0, 0.1))

        def told() -> bool:
            translator.take("/x", people(ANN))
            return eventually(lambda: bool(heard), 0.3)

        assert eventually(told)
    body = heard[-1].markers[1].pose.position
    assert (body.x, body.y) == pytest.approx((2 * math.cos(math.pi / 2 + 0.1), 2 * math.sin(math.pi / 2 + 0.1)))


def test_skips_stamps_outside_ros_time() -> None:
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.translator import Translator

    with spinning_node("translator") as ros:
        translator = Translator(ros, WALDO, head=False)
        for stamp in (10**30, -1):
            translator.take("/x", PersonDetections(stamp=stamp, frame_id="", width=1, height=1, persons=(ANN,)))


def test_refuses_a_graph_without_a_head() -> None:
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.translator import Translator

    with spinning_node("translator") as ros, pytest.raises(ParameterError, match="no node of warehouse turns a head"):
        Translator(ros, load_graph("warehouse"), head=True)


def test_skips_packages_that_are_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    from socialbot.bridge import translator
    from socialbot.bridge.environment import spinning_node

    real = translator.message_class

    def lacking(kind: str) -> Any:
        if kind.startswith(("vision_msgs", "hri_msgs", "tf2_msgs")):
            raise InstallationError("not there")
        return real(kind)

    monkeypatch.setattr(translator, "message_class", lacking)
    with spinning_node("translator") as ros:
        translating = translator.Translator(ros, WALDO, head=True)
        assert translating.missing == {"vision_msgs", "hri_msgs", "tf2_msgs"}
        assert [topic.partition(" ")[0] for topic in translating.topics] == [
            translator.MARKERS,
            translator.SPEECH,
            translator.JOINTS,
        ]
        translating.take("/x", people(ANN))


@pytest.mark.parametrize(
    ("changes", "level"),
    [
        ({}, Engagement.UNKNOWN),
        ({"facing_rad": 0.2}, Engagement.ENGAGED),
        ({"facing_rad": 0.2, "approach_mps": -0.5}, Engagement.ENGAGING),
        ({"facing_rad": 0.2, "distance_m": 5.0}, Engagement.ENGAGING),
        ({"facing_rad": 0.2, "distance_m": None}, Engagement.ENGAGING),
        ({"facing_rad": 0.8}, Engagement.DISENGAGING),
        ({"facing_rad": 0.8, "distance_m": 5.0}, Engagement.UNKNOWN),
        ({"facing_rad": 2.5}, Engagement.DISENGAGED),
    ],
)
def test_engagement_follows_facing_distance_and_approach(changes: dict[str, Any], level: Engagement) -> None:
    assert engagement_of(msgspec.structs.replace(ANN, **changes)) == level
