"""People as a robot's own ROS4HRI detectors see them, and the speech that it recognised."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.core import limits
from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, Transform, Transforms, ros_message
from socialbot.graph.files import load_graph
from socialbot.robots.binding import with_robot
from socialbot.robots.people import HEIGHT, WIDTH, RobotPeople
from socialbot.robots.profile import parse_profile
from socialbot.robots.speech import RobotEars
from socialbot.testing import GraphTester

IDS = ros_message("hri_msgs/msg/IdsList")
SPEECH = ros_message("hri_msgs/msg/LiveSpeech")


def look(graph: GraphTester, *ids: str) -> tuple[PersonDetection, ...]:
    """Publish a list of tracked bodies, and return the people."""
    graph.send("/humans/bodies/tracked", IDS(stamp=graph.clock.now(), ros=SimpleNamespace(ids=list(ids))))
    return graph.messages("/humans/bodies/detections")[-1].persons


def body(graph: GraphTester, name: str, x: float, y: float, yaw: float, parent: str = "base_link") -> None:
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    frame = Transform(
        stamp=graph.clock.now(), parent=parent, child=f"body_{name}", translation=(x, y, 0.9), rotation=turn
    )
    graph.send("/tf", Transforms(stamp=graph.clock.now(), transforms=(frame,)))


def test_a_body_has_the_distance_and_bearing_of_its_frame():
    with GraphTester(RobotPeople) as graph:
        body(graph, "a3x", 3.0, 4.0, 0.0)
        (person,) = look(graph, "a3x")
    assert person.track_id == "a3x"
    assert person.distance_m == pytest.approx(5.0)
    assert person.bearing_rad == pytest.approx(math.atan2(4.0, 3.0))


def test_of_a_long_list_the_first_count_and_a_time_that_stands_still_adds_nothing():
    with GraphTester(RobotPeople) as graph:
        assert len(look(graph, *map(str, range(limits.PERSONS + 5)), "0")) == limits.PERSONS
        for _ in range(300):
            body(graph, "a", 2.0, 0.0, 0.0)
            look(graph, "a")
        assert len(graph.node()._paths["a"]) <= 100


@pytest.mark.parametrize(("yaw", "facing"), [(math.pi, 0.0), (0.0, math.pi), (math.pi / 2, math.pi / 2)])
def test_the_x_axis_of_the_frame_is_where_the_person_faces(yaw, facing):
    with GraphTester(RobotPeople) as graph:
        body(graph, "a", 2.0, 0.0, yaw)
        assert look(graph, "a")[0].facing_rad == pytest.approx(facing, abs=1e-6)


def test_frames_of_the_head_count_as_well():
    with GraphTester(RobotPeople) as graph:
        camera = Transform(
            stamp=0, parent="base_link", child="camera", translation=(0.1, 0.0, 1.1),
            rotation=(-0.5, 0.5, -0.5, 0.5),  # optical axes, REP-103
        )  # fmt: skip
        graph.send("/tf_static", Transforms(stamp=0, transforms=(camera,)))
        frame = Transform(
            stamp=0, parent="camera", child="body_b", translation=(-1.0, 0.2, 3.0), rotation=(0.0, 0.0, 0.0, 1.0)
        )
        graph.send("/tf", Transforms(stamp=0, transforms=(frame,)))
        (person,) = look(graph, "b")
    assert person.distance_m == pytest.approx(math.hypot(3.1, 1.0))
    assert person.bearing_rad == pytest.approx(math.atan2(1.0, 3.1))


def test_who_walks_up_has_a_speed_and_a_box_in_the_virtual_image():
    with GraphTester(RobotPeople) as graph:
        for tenth in range(11):
            body(graph, "a", 5.0 - 0.1 * tenth, 0.0, math.pi)
            look(graph, "a")
            graph.run(0.1)
        (person,) = graph.messages("/humans/bodies/detections")[-1].persons
    assert person.approach_mps == pytest.approx(1.0, abs=0.05)
    assert 0 < person.x < person.x + person.w < WIDTH
    assert 0 < person.y < person.y + person.h < HEIGHT
    assert person.x + person.w / 2 == pytest.approx(WIDTH / 2)


def test_a_body_without_a_frame_or_with_an_old_one_has_no_place():
    with GraphTester(RobotPeople) as graph:
        (person,) = look(graph, "a")
        assert (person.track_id, person.distance_m, person.bearing_rad) == ("a", None, None)
        body(graph, "a", 2.0, 0.0, 0.0)
        assert look(graph, "a")[0].distance_m == pytest.approx(2.0)
        graph.run(2.0)
        assert look(graph, "a")[0].distance_m is None
        assert look(graph) == ()


def lack(graph: GraphTester) -> str:
    """What the node lacks, after people without a place for a while."""
    for _ in range(40):
        look(graph, "a")
        graph.run(0.1)
    return graph.node().context.health_monitor.health().reason


def test_why_nobody_has_a_place_is_told():
    with GraphTester(RobotPeople) as graph:
        look(graph, "a")
        assert not graph.node().context.health_monitor.health().reason  # the frame may come later
        assert lack(graph) == "people have no place: /tf has no frame body_a"
        body(graph, "a", 2.0, 0.0, 0.0)
        look(graph, "a")
        assert not graph.node().context.health_monitor.health().reason
        assert "s older than the list of people" in lack(graph)


def test_people_whose_frames_are_not_connected_with_the_robot_are_told():
    with GraphTester(RobotPeople, parameters={"oldest_s": 60.0}) as graph:
        body(graph, "a", 2.0, 0.0, 0.0, parent="robot1/base_link")
        assert "no transform connects body_a with base_link, set robot_frame" in lack(graph)


@pytest.mark.parametrize(("kind", "frame"), [("bodies", "body_"), ("faces", "face_"), ("persons", "person_")])
def test_lists_of_faces_and_persons_have_frames_of_their_own(kind, frame):
    text = f"name: seer\npeople: {{type: ros4hri, bodies: /robot/humans/{kind}/tracked}}\n"
    profile = parse_profile(text, "seer.yaml")
    assert with_robot(load_graph("waldo"), profile).node("person_detector").parameters["frame_prefix"] == frame
    with GraphTester(RobotPeople, parameters={"frame_prefix": frame}) as graph:
        turn = (0.0, 0.0, 0.0, 1.0)
        place = Transform(stamp=0, parent="base_link", child=f"{frame}a", translation=(2.0, 0.0, 1.5), rotation=turn)
        graph.send("/tf", Transforms(stamp=0, transforms=(place,)))
        assert look(graph, "a")[0].distance_m == pytest.approx(2.0)


def speech(final: str, incremental: str = "", confidence: float = 0.9, language: str = "en-GB") -> Any:
    return SimpleNamespace(final=final, incremental=incremental, confidence=confidence, language=language)


def test_a_sentence_is_published_with_its_begin_and_language():
    with GraphTester(RobotEars) as graph:
        for second, said in enumerate((speech("", "hello"), speech("", "hello there"), speech(" Hello there. "))):
            stamp = (second + 1) * SECOND
            graph.send("/humans/voices/anonymous_speaker/speech", SPEECH(stamp=stamp, ros=said))
        (heard,) = graph.messages("/humans/voices/speech")
    assert (heard.text, heard.language, heard.confidence) == ("Hello there.", "en", 0.9)
    assert (heard.start, heard.stamp, heard.voice) == (SECOND, 3 * SECOND, "anonymous_speaker")


def test_an_agent_that_listens_hears_what_the_robot_recognised():
    graph = load_graph("reception")
    topic = RobotEars.outputs()["heard"].topic
    assert topic in {topic for config in graph.nodes for topic, _ in config.subscriptions}


def test_sentences_of_low_confidence_are_ignored():
    with GraphTester(RobotEars, parameters={"least_confidence": 0.5}) as graph:
        for said in (speech("a", confidence=0.4), speech("b", confidence=math.nan), speech("c", confidence=7.0)):
            graph.send("/humans/voices/anonymous_speaker/speech", SPEECH(stamp=SECOND, ros=said))
        (heard,) = graph.messages("/humans/voices/speech")
    assert (heard.text, heard.confidence) == ("c", 1.0)
