"""Robot profiles: what they hold, and how mistakes in them are reported."""

from __future__ import annotations

import math
import re
import textwrap
from pathlib import Path

import pytest

from socialbot.core import registry
from socialbot.core.errors import GraphError
from socialbot.core.yaml import read_page
from socialbot.graph.files import load_graph
from socialbot.robots.binding import with_robot
from socialbot.robots.profile import load_profile, parse_profile, read_profile, robot_names

GOOD = """\
name: robby
title: Robby
tested: none
camera: {image: /cam/image_raw, info: /cam/camera_info, on_head: true}
head:
  type: ros2_control
  trajectory: /neck/joint_trajectory
  pan: {joint: neck_pan, lower_rad: -1.0, upper_rad: 1.2, speed_rad_s: 0.8}
  tilt: {joint: neck_tilt, lower_rad: -0.4, upper_rad: 0.3, speed_rad_s: 0.5, sign: -1}
speech: {type: tts, action: /tts_engine/tts, locale: en_GB}
"""


def test_a_profile_holds_what_its_file_says():
    robby = parse_profile(GOOD, "robby.yaml")
    assert (robby.name, robby.title, robby.tested) == ("robby", "Robby", "none")
    assert robby.camera is not None
    assert (robby.camera.image, robby.camera.on_head, robby.camera.device) == ("/cam/image_raw", True, "")
    assert robby.head is not None
    assert robby.head.names == {"trajectory": "/neck/joint_trajectory"}
    assert (robby.head.pan.reach_rad, robby.head.tilt.reach_rad, robby.head.tilt.sign) == (1.0, 0.3, -1)
    assert robby.speech is not None
    assert robby.speech.settings == {"locale": "en_GB", "tts_voice": ""}
    assert (robby.base, robby.people) == (None, None)


@pytest.mark.parametrize(
    ("old", "new", "line", "what", "remedy"),
    [
        ("title: Robby", "tilte: Robby", 2, "unknown key 'tilte'", "'title'"),
        ("tested: none", "tested: perhaps", 3, "'tested' must be one of hardware, none, simulation, got 'perhaps'", ""),
        ("on_head: true", "on_had: true", 4, "unknown key 'on_had'", "'on_head'"),
        ("on_head: true", "on_head: maybe", 4, "'on_head' must be true or false", ""),
        (
            "image: /cam/image_raw",
            "image: cam",
            4,
            "'image' must be a full name of a topic or action, got 'cam'",
            "begin with /",
        ),
        ("image: /cam/image_raw,", "", 4, "the camera has no images", "'image'"),
        (", info: /cam/camera_info", "", 4, "the camera has no intrinsics", "'info', the topic of its CameraInfo"),
        ("on_head: true", 'device: "0"', 4, "topics or a device", "'device'"),
        ("type: ros2_control", "type: ros_control", 6, "unknown type of head: 'ros_control'", "'ros2_control'"),
        ("  type: ros2_control\n", "", 6, "head has no type", "ros2_control, naoqi, reachy_mini"),
        ("  trajectory: /neck/joint_trajectory\n", "", 6, "needs 'trajectory' or 'action'", "its controller"),
        ("trajectory:", "trajectroy:", 7, "unknown key 'trajectroy'", "'trajectory'"),
        ("speed_rad_s: 0.8", "speed_rad_s: 0", 8, "'speed_rad_s' must be a number from 0.01 to 10", ""),
        ("speed_rad_s: 0.8", "speed_rad_s: .inf", 8, "'speed_rad_s' must be a number", ""),
        ("lower_rad: -1.0", "lower_rad: .nan", 8, "'lower_rad' must be a number", ""),
        ("lower_rad: -1.0", "lower_rad: 0.5", 8, "0 is not between lower_rad and upper_rad", ""),
        (
            "lower_rad: -1.0",
            "lower_rad: 0.5, straight_rad: 1.3",
            8,
            "1.3 is not between",
            "straight_rad is its position",
        ),
        ("lower_rad: -1.0, ", "", 8, "'lower_rad' is missing", "a number from -6.3 to 6.3"),
        ("lower_rad: -1.0", "lower_rad: -57", 8, "'lower_rad' must be a number from -6.3 to 6.3", ""),
        ("joint: neck_tilt", "joint: neck_pan", 6, "pan and tilt are the same joint 'neck_pan'", "two joints"),
        (GOOD[GOOD.index("  pan:") : GOOD.index("speech")], "", 6, "the head has no joint", "'pan', 'tilt' or both"),
        ("sign: -1", "sign: 0", 9, "'sign' must be one of -1, 1, got 0", ""),
        ("action: /tts_engine/tts, ", "", 10, "'action' is missing", "driver"),
        ("locale: en_GB", "langauge: en", 10, "unknown key 'langauge'", ""),
        ("name: robby", "name: my robot", 1, "'my robot' is no name", "letters, digits and _"),
    ],
)
def test_mistakes_are_named_with_their_line_and_a_remedy(old, new, line, what, remedy):
    assert old in GOOD
    with pytest.raises(GraphError) as caught:
        parse_profile(GOOD.replace(old, new), "robby.yaml")
    assert what in caught.value.what
    assert caught.value.where == f"robby.yaml:{line}"
    assert remedy in (caught.value.remedy or "")


@pytest.mark.parametrize(
    ("pan", "tilt"),
    [
        ("lower_rad: -4.04, upper_rad: 1.73", "lower_rad: -1.53, upper_rad: 0.79"),
        ("lower_rad: -3.1416, upper_rad: 3.1416", "lower_rad: -1.5708, upper_rad: 1.5708"),
        ("lower_rad: -6.2832, upper_rad: 6.2832", "lower_rad: -3.1416, upper_rad: 3.1416"),
    ],
)
def test_limits_of_urdfs_beyond_half_a_turn(pan, tilt):
    text = GOOD.replace("lower_rad: -1.0, upper_rad: 1.2", pan).replace("lower_rad: -0.4, upper_rad: 0.3", tilt)
    robby = parse_profile(text, "robby.yaml")
    assert robby.head is not None
    nodes = {node.name: node for node in with_robot(load_graph("waldo"), robby).nodes}
    assert nodes["robot_head"].parameters["pan_lower_rad"] == robby.head.pan.lower_rad
    assert nodes["head"].parameters["pan_limit_rad"] == min(robby.head.pan.reach_rad, math.pi)
    assert nodes["head"].parameters["tilt_limit_rad"] == min(robby.head.tilt.reach_rad, math.pi / 2)


def test_the_straight_pose_of_a_joint_need_not_be_0():
    text = GOOD.replace("lower_rad: -1.0, upper_rad: 1.2", "lower_rad: 0.2, upper_rad: 3.0, straight_rad: 1.5")
    profile = parse_profile(text, "robby.yaml")
    assert profile.head is not None
    assert profile.head.pan.reach_rad == pytest.approx(1.3)
    graph = with_robot(load_graph("waldo"), profile)
    assert graph.node("robot_head").parameters["pan_straight_rad"] == 1.5
    assert graph.node("head").parameters["pan_limit_rad"] == pytest.approx(1.3)


def test_a_profile_can_change_another(tmp_path):
    section = read_page(
        "like: tiago\nhead: {pan: {speed_rad_s: 0.3}}\nbase: {robot_frame: base_link}\n", where="mine.yaml"
    )
    section.only("like", "head", "base")
    mine = read_profile(section, where="mine.yaml")
    usual = load_profile("tiago")
    assert mine.head is not None
    assert usual.head is not None
    assert mine.head.pan.speed_rad_s == 0.3
    assert mine.head.pan.joint == usual.head.pan.joint
    assert mine.head.tilt == usual.head.tilt
    assert mine.head.names == usual.head.names
    assert mine.base is not None
    assert mine.base.settings["robot_frame"] == "base_link"
    assert mine.camera == usual.camera


def test_a_changed_head_of_ones_own_keeps_its_topics(tmp_path: Path):
    joint = "lower_rad: -1, upper_rad: 1, speed_rad_s: 1"
    (tmp_path / "base.yaml").write_text(
        f"name: own\nhead: {{type: 'own:Head', remap: {{neck: /neck, arm: /arm}}, pan: {{joint: a, {joint}}}, "
        f"tilt: {{joint: b, {joint}}}}}\n",
        "utf-8",
    )
    mine = parse_profile("like: base.yaml\nhead: {remap: {arm: /b}}\n", "mine.yaml", folder=tmp_path)
    assert mine.head is not None
    assert mine.head.names == {"neck": "/neck", "arm": "/b"}


def test_a_profile_that_changes_itself_is_refused(tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text(f"like: {own}\n")
    with pytest.raises(GraphError, match="changes itself"):
        load_profile(str(own))


@pytest.mark.parametrize("name", ["tiagoo", "robots/unknown"])
def test_an_unknown_robot_is_named_with_a_suggestion(name):
    with pytest.raises(GraphError) as caught:
        load_profile(name)
    assert caught.value.what == f"no robot {name!r}"
    assert "my_robot.yaml" in (caught.value.remedy or "")


@pytest.mark.parametrize("name", ["robby.urdf", "robby.launch.py"])
def test_a_file_that_is_no_profile_is_told_from_an_unknown_robot(tmp_path, name):
    (tmp_path / name).write_text("damaged")
    with pytest.raises(GraphError, match="is no robot profile") as caught:
        load_profile(str(tmp_path / name))
    assert caught.value.where == str(tmp_path / name)
    assert "my_robot.yaml" in (caught.value.remedy or "")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(GraphError, match=re.escape("cannot be read: No such file")):
        load_profile(str(tmp_path / "robby.yaml"))


@pytest.mark.parametrize("name", robot_names())
def test_every_shipped_profile_is_valid_and_honest(name):
    profile = load_profile(name)
    assert profile.name == name
    assert profile.title
    assert profile.hint
    text = Path(registry.robot_files()[name]).read_text("utf-8")
    assert profile.tested != "none" or "Not tested on hardware" in text
    for joint in (profile.head.pan, profile.head.tilt) if profile.head else ():
        assert joint.reach_rad >= 0.2
        assert joint.speed_rad_s <= 2.0


def test_a_profile_is_like_the_file_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "lab").mkdir()
    (tmp_path / "robby.yaml").write_text(GOOD)
    (tmp_path / "lab" / "mine.yaml").write_text("like: ../robby.yaml\nname: mine\n")
    (tmp_path / "lab" / "graph.yaml").write_text(
        "name: eyes\nrobot: {like: mine.yaml}\nnodes: {camera: {type: camera}}\n"
    )
    monkeypatch.chdir("/")
    mine = load_profile(str(tmp_path / "lab" / "mine.yaml"))
    assert (mine.name, mine.title) == ("mine", "Robby")
    assert not load_graph(str(tmp_path / "lab" / "graph.yaml")).nodes  # the robot has a camera of its own


def test_the_profile_of_the_how_to_is_valid():
    page = Path(__file__).parents[2].joinpath("docs", "howto", "robots.md").read_text("utf-8")
    found = re.search(r"^    name: fetch\n(?:    .*\n)+", page, re.MULTILINE)
    assert found is not None
    fetch = parse_profile(textwrap.dedent(found[0]), "fetch.yaml")
    assert fetch.head is not None
    assert fetch.base is not None
    assert (fetch.head.tilt.reach_rad, fetch.head.tilt.sign) == (0.76, -1)
