"""`socialbot translate` beside a running graph: the standard messages that it publishes."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.messages import CompressedImage
from tests.ros.interfaces import install
from tests.system.running import PATIENCE_S, cut, eventually, running

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]
SEEING = """
name: seeing
inputs: [/camera/image_raw/compressed, /head/command]
nodes:
  camera: {type: camera, parameters: {source: PICTURES, loop: true}}
  image_converter: {type: image_converter}
  person_detector: {type: person_detector, parameters: {mount_height_m: 1.62, pitch_rad: 0.052}}
  head: {type: head}
"""
LIMIT_S = 120.0
"""So long something may take that comes in a second or two where no compiler is at work beside it."""
BODY = re.compile(r"t\d+")
HEAD = {"/tf_static": "tf2_msgs/msg/TFMessage", "/joint_states": "sensor_msgs/msg/JointState"}
PEOPLE = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/humans/bodies/markers": "visualization_msgs/msg/MarkerArray",
    "/humans/bodies/boxes": "vision_msgs/msg/Detection2DArray",
    "/humans/bodies/tracked": "hri_msgs/msg/IdsList",
    "/humans/bodies/<id>/roi": "hri_msgs/msg/NormalizedRegionOfInterest2D",
    "/humans/faces/tracked": "hri_msgs/msg/IdsList",
    "/humans/persons/tracked": "hri_msgs/msg/IdsList",
    "/humans/persons/<id>/engagement_status": "hri_msgs/msg/EngagementLevel",
}


TALK = '''
"""A voice that speaks again and again, as speech recognition publishes it."""

from socialbot import Node, Output
from socialbot.core.messages import HeardSpeech, VoiceActivity


class Talk(Node):
    speech = Output(HeardSpeech, "/humans/voices/speech")
    activity = Output(VoiceActivity, "/humans/voices/activity")

    def start(self):
        self.talk()

    def talk(self):
        self.call_after(0.5, self.talk)
        now, who = self.clock.now(), {"voice": "voice 1", "person": "t1"}
        self.activity.publish(VoiceActivity(stamp=now, active=True, **who))
        self.speech.publish(HeardSpeech(stamp=now, start=now, text="Where is room 204?", language="en", **who))
'''
VOICES = {
    "/humans/voices/tracked": "hri_msgs/msg/IdsList",
    "/humans/voices/<id>/speech": "hri_msgs/msg/LiveSpeech",
    "/humans/voices/<id>/is_speaking": "std_msgs/msg/Bool",
    "/humans/persons/t1/voice_id": "std_msgs/msg/String",
}


@pytest.fixture
def graph_file(corridor: Path, tmp_path: Path) -> Path:
    """A graph that sees again and again how somebody comes nearer, and goes back: nobody ever leaps."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    with open_bag(cut(corridor, tmp_path / "visit", 7.0, 11.0)) as bag:
        (topic,) = bag.image_topics
        nearer = [picture for _, picture in bag.messages({topic.name: topic.name})]
    for number, picture in enumerate([*nearer, *reversed(nearer)]):
        assert isinstance(picture, CompressedImage)
        (pictures / f"{number:02}.jpg").write_bytes(picture.data.tobytes())
    file = tmp_path / "seeing.yaml"
    file.write_text(SEEING.replace("PICTURES", str(pictures)))
    return file


@pytest.fixture
def graph(graph_file: Path, tmp_path: Path) -> Iterator[Path]:
    """The graph while it is up."""
    # Who translates is not told of the frame: as with the driver of another's camera.
    with running("up", graph_file, "--set", "camera.frame_id=eye", "--out", tmp_path / "run"):
        yield graph_file


@pytest.mark.slow
def test_publishes_people_until_a_signal(graph: Path) -> None:
    from visualization_msgs.msg import MarkerArray

    from socialbot.bridge.environment import spinning_node

    heard: list[Any] = []
    with spinning_node("viewer") as viewer, running("translate", graph) as translating:
        viewer.create_subscription(MarkerArray, "/humans/bodies/markers", heard.append, 10)
        assert eventually(lambda: any(len(array.markers) > 1 for array in heard), LIMIT_S)
        translating.send_signal(signal.SIGINT)
        translating.wait(timeout=PATIENCE_S)
        printed = translating.output()
    assert translating.returncode == 0, printed
    assert "/humans/bodies/markers  visualization_msgs/msg/MarkerArray" in printed
    cylinder, text = next(array.markers[1:3] for array in heard if len(array.markers) > 1)
    assert cylinder.header.frame_id == "base_link"
    assert 2.0 < cylinder.pose.position.x < 10.0
    assert text.text.endswith(" m")


@pytest.mark.slow
def test_a_graph_publishes_standard_types_by_itself(graph_file: Path, tmp_path: Path) -> None:
    from visualization_msgs.msg import MarkerArray

    from socialbot.bridge.environment import spinning_node

    graph_file.write_text(graph_file.read_text() + "messages: standard\n")
    heard: list[Any] = []
    with spinning_node("viewer") as viewer, running("up", graph_file, "--out", tmp_path / "run"):
        viewer.create_subscription(MarkerArray, "/humans/bodies/markers", heard.append, 10)
        assert eventually(lambda: any(len(array.markers) > 1 for array in heard), LIMIT_S)


@pytest.fixture
def standard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes find the packages that are not among the wheels."""
    prefix = install(("tf2_msgs", "vision_msgs", "hri_msgs"), tmp_path)
    (packages,) = prefix.glob("lib/python*/site-packages")
    for name, folder in {"PYTHONPATH": packages, "LD_LIBRARY_PATH": prefix / "lib"}.items():
        monkeypatch.setenv(name, f"{folder}:{os.environ.get(name, '')}")


def heard(types: dict[str, str]) -> dict[str, Any]:
    """Return the messages on each topic, decoded by their types."""
    command = [
        sys.executable,
        "-m",
        "tests.system.listening",
        str(LIMIT_S),
        *(f"{one}={kind}" for one, kind in types.items()),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.usefixtures("standard")
def test_publishes_people_as_tf_vision_msgs_and_ros4hri(graph: Path) -> None:
    with running("translate", graph):
        told = heard(PEOPLE)
    assert set(told) == set(PEOPLE)
    # On a busy machine, which sees few pictures, the same person may be another body a moment later.
    assert all(BODY.fullmatch(body) for body in told["/humans/bodies/tracked"]["ids"])
    (box,) = told["/humans/bodies/boxes"]["detections"]
    assert BODY.fullmatch(box["id"])
    assert box["results"][0]["hypothesis"]["class_id"] == "person"
    assert told["/humans/persons/tracked"]["ids"]
    assert 0 <= told["/humans/persons/<id>/engagement_status"]["level"] <= 4
    region = told["/humans/bodies/<id>/roi"]
    assert 0 <= region["xmin"] < region["xmax"] <= 1
    assert 0 <= region["ymin"] < region["ymax"] <= 1
    (frame,) = told["/tf"]["transforms"]
    assert frame["header"]["frame_id"] == "base_link"
    assert BODY.fullmatch(frame["child_frame_id"].removeprefix("body_"))
    assert 2.0 < frame["transform"]["translation"]["x"] < 10.0
    with running("translate", graph, "--head"):
        told = heard(HEAD)
        assert told["/joint_states"]["name"] == ["head_pan_joint", "head_tilt_joint"]
        # Until it has heard of a picture it goes by the graph.
        assert eventually(lambda: "eye" in frames(heard(HEAD)), LIMIT_S)
        camera = frames(heard(HEAD))
    assert {child: each["header"]["frame_id"] for child, each in camera.items()} == {
        "camera_link": "base_link",
        "eye": "camera_link",
    }
    placed = camera["camera_link"]["transform"]
    assert placed["translation"]["z"] == 1.62
    assert placed["rotation"]["y"] == pytest.approx(math.sin(0.026)), "it looks down as the detector takes it to"


@pytest.mark.slow
@pytest.mark.usefixtures("standard")
def test_the_camera_has_the_pose_that_people_show(graph_file: Path, tmp_path: Path) -> None:
    graph_file.write_text(graph_file.read_text().replace(", parameters: {mount_height_m: 1.62, pitch_rad: 0.052}", ""))
    with (
        running("up", graph_file, "--out", tmp_path / "run"),
        running("translate", graph_file, "--head") as translating,
    ):

        def height_m() -> float:
            return frames(heard(HEAD))["camera_link"]["transform"]["translation"]["z"]

        assert eventually(lambda: height_m() != 1.2, LIMIT_S)
        assert 1.3 < height_m() < 2.0
        translating.send_signal(signal.SIGINT)
        translating.wait(timeout=PATIENCE_S)
        printed = translating.output()
    assert "/tf_static: camera 1.20 m high, 0.000 rad down (assumed)" in printed
    assert "(estimated from people)" in printed


@pytest.mark.slow
@pytest.mark.usefixtures("standard")
def test_publishes_voices_as_ros4hri(tmp_path: Path) -> None:
    (tmp_path / "talk.py").write_text(TALK)
    graph = tmp_path / "talk.yaml"
    graph.write_text("name: talk\nnodes:\n  talk: {type: talk:Talk}\n")
    with running("up", graph, "--out", tmp_path / "run"), running("translate", graph):
        told = heard(VOICES)
    assert told["/humans/voices/tracked"]["ids"] == ["voice_1"]
    assert told["/humans/voices/<id>/speech"]["final"] == "Where is room 204?"
    assert told["/humans/voices/<id>/speech"]["language"] == "en"
    assert isinstance(told["/humans/voices/<id>/is_speaking"]["data"], bool)
    assert told["/humans/persons/t1/voice_id"]["data"] == "voice_1"


def frames(told: dict[str, Any]) -> dict[str, Any]:
    """The frames that stay, by their names."""
    return {each["child_frame_id"]: each for each in told.get("/tf_static", {}).get("transforms", [])}
