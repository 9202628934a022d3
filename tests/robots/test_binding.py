"""Graphs on robots: which nodes and topics a profile changes."""

from __future__ import annotations

import pytest

from socialbot.core.errors import GraphError, ParameterError
from socialbot.graph.files import dump_graph, load_graph, parse_graph
from socialbot.robots.binding import with_robot
from socialbot.robots.profile import load_profile, parse_profile, robot_names
from socialbot.robots.requirements import requirements
from socialbot.runtime.deployment import parse_deployment
from tests.robots.test_profile import GOOD

INLINE = """\
name: two
inputs: [/camera/image_raw, /camera/image_raw/compressed, /camera/camera_info]
nodes:
  image_converter: {type: image_converter}
  person_detector: {type: person_detector}
  bdi_engine: {type: waldo}
  listener: {type: listener}
  speech: {type: speaker}
  head: {type: head}
"""


@pytest.fixture
def robby(tmp_path):
    path = tmp_path / "robby.yaml"
    path.write_text(GOOD)
    return str(path)


def test_the_robot_has_the_camera_and_the_head(robby):
    graph = load_graph("waldo", robot=robby)
    names = [config.name for config in graph.nodes]
    assert "camera" not in names
    assert names[-1] == "robot_head"
    converter, detector = graph.node("image_converter"), graph.node("person_detector")
    assert converter.topic(converter.type.inputs()["image_raw"]) == "/cam/image_raw"
    assert detector.topic(detector.type.inputs()["camera_info"]) == "/cam/camera_info"
    head, body = graph.node("head"), graph.node("robot_head")
    assert head.topic(head.type.outputs()["trajectory"]) == body.topic(body.type.inputs()["target"])
    assert body.topic(body.type.outputs()["trajectory"]) == "/neck/joint_trajectory"
    assert head.parameters["pan_joint"] == body.parameters["pan_joint"] == "neck_pan"
    assert (head.parameters["pan_limit_rad"], head.parameters["max_speed_rad_s"]) == (1.0, 0.5)
    assert body.parameters["tilt_sign"] == -1
    assert {"/cam/image_raw", "/cam/camera_info"} <= graph.inputs


def topics_of(graph, node):
    config = graph.node(node)
    return {port.name: topic for topic, port in (*config.subscriptions, *config.publications, *config.clients)}


def test_a_robot_in_a_namespace_has_all_of_its_topics_there(tmp_path, robby):
    first = tmp_path / "first.yaml"
    first.write_text("like: robby.yaml\nnamespace: /first\nbase: {type: nav2, action: /navigate_to_pose}\n")
    graph = load_graph("waldo", robot=str(first))
    detector, body = topics_of(graph, "person_detector"), topics_of(graph, "robot_head")
    assert topics_of(graph, "image_converter")["image_raw"] == "/first/cam/image_raw"
    assert {name: detector[name] for name in ("camera_info", "tf", "tf_static")} == {
        "camera_info": "/first/cam/camera_info", "tf": "/first/tf", "tf_static": "/first/tf_static",
    }  # fmt: skip
    assert (body["trajectory"], body["joint_states"]) == ("/first/neck/joint_trajectory", "/first/joint_states")
    assert topics_of(graph, "speech")["speak"] == "/first/tts_engine/tts"
    assert detector["detections"] == "/humans/bodies/detections"  # of socialbot
    named = {each.name for each in requirements(load_profile(str(first)))}
    assert all(name.startswith("/first/") for name in named)
    assert {"/first/joint_states", "/first/tf_static", "/first/tf"} <= named


def test_the_joint_states_of_a_head_may_have_another_name(tmp_path):
    path = tmp_path / "robby.yaml"
    path.write_text(GOOD.replace("  pan:", "  joint_states: /neck/joint_states\n  pan:", 1))
    assert topics_of(load_graph("waldo", robot=str(path)), "robot_head")["joint_states"] == "/neck/joint_states"
    assert "/neck/joint_states" in {each.name for each in requirements(load_profile(str(path)))}


@pytest.mark.parametrize("info", [", info: /cam/camera_info", ""])
def test_a_camera_without_intrinsics_has_a_field_of_view(info):
    text = GOOD.replace(", info: /cam/camera_info", f"{info}, hfov_rad: 1.3")
    detector = with_robot(load_graph("waldo"), parse_profile(text, "robby.yaml")).node("person_detector")
    assert detector.parameters["hfov_rad"] == 1.3


@pytest.mark.parametrize(("key", "agent"), [("pan", ("neck_pan", "no_tilt")), ("tilt", ("no_pan", "neck_tilt"))])
def test_a_head_may_have_one_joint(key, agent):
    lines = [
        line for line in GOOD.splitlines(keepends=True) if line.split(":")[0].strip() not in {"pan", "tilt"} - {key}
    ]
    profile = parse_profile("".join(lines), "robby.yaml")
    graph = with_robot(load_graph("waldo"), profile)
    head, body = graph.node("head").parameters, graph.node("robot_head").parameters
    assert (head["pan_joint"], head["tilt_joint"]) == agent
    assert body[f"{key}_joint"] == f"neck_{key}"
    assert [body["pan_joint"], body["tilt_joint"]].count("") == 1
    assert head["tilt_limit_rad" if key == "pan" else "pan_limit_rad"] == 0.0
    (states,) = [each for each in requirements(profile) if each.joints]
    assert states.joints == (f"neck_{key}",)


def test_the_speech_keeps_its_queue_and_its_engine(robby):
    speech = load_graph("waldo", robot=robby).node("speech")
    assert speech.type.__name__ == "TtsSpeaker"
    assert speech.parameters == {"engine": "bdi_engine", "locale": "en_GB", "tts_voice": ""}
    assert [name for name, _ in speech.clients] == ["/tts_engine/tts"]


def test_nothing_commands_the_robot_but_its_own_nodes(robby):
    graph = load_graph("waldo", robot=robby)
    commanding = [one.name for one in graph.nodes for topic, _ in one.publications if topic == "/neck/joint_trajectory"]
    assert commanding == ["robot_head"]


@pytest.mark.parametrize("robot", robot_names())
def test_waldo_fits_every_robot_and_his_graph_can_be_written_and_read(robot):
    graph = load_graph("waldo", robot=robot)
    assert parse_graph(dump_graph(graph), where="dumped") == graph


def test_a_graph_names_its_robot(tmp_path, robby):
    path = tmp_path / "graph.yaml"
    path.write_text(f"{INLINE}robot: robby.yaml\n")
    assert load_graph(str(path)) == parse_graph(f"{INLINE}robot: {robby}\n", where="x")
    assert load_graph(str(path)).node("robot_head")
    other = load_graph(str(path), robot="tiago")
    assert other.node("robot_head").parameters["pan_joint"] == "head_1_joint"


def test_a_graph_may_hold_the_profile():
    graph = parse_graph(f"{INLINE}robot:\n  like: tiago\n  head: {{pan: {{speed_rad_s: 0.2}}}}\n", where="mine.yaml")
    assert graph.node("robot_head").parameters["pan_speed_rad_s"] == 0.2
    assert graph.node("head").parameters["max_speed_rad_s"] == 0.2


def test_mistakes_of_the_profile_in_a_graph_have_the_line_of_the_graph():
    with pytest.raises(GraphError) as caught:
        parse_graph(f"{INLINE}robot: tiagoo\n", where="mine.yaml")
    assert (caught.value.where, caught.value.what) == ("mine.yaml:10", "no robot 'tiagoo'")
    with pytest.raises(GraphError) as caught:
        parse_graph(f"{INLINE}robot:\n  like: tiago\n  heads: 1\n", where="mine.yaml")
    assert (caught.value.where, caught.value.what) == ("mine.yaml:12", "unknown key 'heads'")


def test_wrong_parameters_and_node_types_of_a_profile_are_refused():
    with pytest.raises(ParameterError, match="no parameter 'rate'"):
        parse_graph(f"{INLINE}robot:\n  like: tiago\n  head: {{parameters: {{rate: 3}}}}\n", where="mine.yaml")
    with pytest.raises(GraphError, match="speaker does not fit this part"):
        parse_graph(
            f"{INLINE}robot:\n  name: odd\n  head:\n    type: speaker\n"
            "    pan: {joint: a, lower_rad: -1, upper_rad: 1, speed_rad_s: 1}\n"
            "    tilt: {joint: b, lower_rad: -1, upper_rad: 1, speed_rad_s: 1}\n",
            where="mine.yaml",
        )


def test_a_robot_with_its_own_detector_needs_no_camera():
    graph = parse_graph(f"{INLINE}robot:\n  name: seer\n  people: {{type: ros4hri}}\n", where="seer.yaml")
    names = [config.name for config in graph.nodes]
    assert "image_converter" not in names
    assert graph.node("person_detector").type.__name__ == "RobotPeople"
    assert "/humans/bodies/tracked" in graph.inputs
    waldo = graph.node("bdi_engine")
    assert waldo.topic(waldo.type.inputs()["detections"]) == "/humans/bodies/detections"


def test_a_deployment_names_its_robot(tmp_path, robby):
    text = (
        "graph: waldo\nrobot: robby.yaml\nmachines: {one: {address: 127.0.0.1}}\n"
        "nodes: {image_converter: one, person_detector: one, bdi_engine: one, listener: one, speech: one, head: one, "
        "robot_head: one}\n"
    )
    deployment = parse_deployment(text, where="deploy.yaml", folder=tmp_path)
    assert deployment.graph.node("robot_head").parameters["pan_joint"] == "neck_pan"
    with pytest.raises(GraphError, match="no robot 'robbie'"):
        parse_deployment(text.replace("robby.yaml", "robbie"), where="deploy.yaml", folder=tmp_path)
