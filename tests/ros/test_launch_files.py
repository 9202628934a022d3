from __future__ import annotations

import os
from pathlib import Path

import pytest

from socialbot.bridge.environment import DATAGRAM_VARIABLE, KEYS_VARIABLE, PACKET_BYTES, UNBOUNDED_BYTES, split_ros_args
from socialbot.core.errors import GraphError, ParameterError
from socialbot.core.paths import FOLDERS_VARIABLE
from socialbot.core.registry import graph_names
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from tests.ros.launching import Node, launched
from tests.runtime.deployments import PAGE

FILES = Path(__file__).parents[2] / "ros" / "launch"


@pytest.fixture
def launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(FOLDERS_VARIABLE, "")
    return lambda file, **arguments: launched(FILES / f"{file}.launch.py", tmp_path, monkeypatch, **arguments)


def graph_of(nodes: list[Node]) -> Graph:
    """The graph that they all read."""
    files = {node.arguments[node.arguments.index("--graph") + 1] for node in nodes}
    assert len(files) == 1
    return load_graph(files.pop())


def names(nodes: list[Node]) -> set[str]:
    return {node.name for node in nodes}


@pytest.mark.parametrize("name", graph_names())
def test_launches_all_nodes_with_their_parameters(name, launch):
    nodes = launch("graph", graph=name)
    graph, launched_graph = load_graph(name), graph_of(nodes)
    assert names(nodes) == {config.name for config in graph.nodes}
    for config in graph.nodes:
        there = launched_graph.node(config.name)
        assert there.type is config.type
        assert there.subscriptions == config.subscriptions
        assert {k: v for k, v in there.parameters.items() if "_file" not in k or k in config.parameters} == dict(
            config.parameters
        )


def test_a_node_process_has_its_name_and_parent(launch):
    (head,) = [node for node in launch("waldo") if node.name == "head"]
    assert (head.package, head.executable, head.respawn) == ("socialbot", "node", True)
    assert head.command[2:] == ["head", "--parent", str(os.getpid()), "--ros-args", "-r", "__node:=head"]


def test_sets_the_camera_and_the_detector(launch):
    nodes = launch("waldo", camera="my film.mp4", detector="hog", set="speech.volume=0.5")
    graph = graph_of(nodes)
    assert graph.node("camera").parameters["source"] == "my film.mp4"
    assert graph.node("person_detector").parameters["detector"] == "hog"
    assert graph.node("speech").parameters["volume"] == 0.5


def test_passes_common_options_to_all_nodes(launch):
    nodes = launch("waldo", params_file="mine.yaml", respawn="false", sim_time="true")
    assert all(node.command[-2:] == ["--params-file", "mine.yaml"] for node in nodes)
    assert not any(node.respawn for node in nodes)
    assert all("--sim-time" in node.arguments for node in nodes)


def test_starts_the_translator_on_request(launch, tmp_path):
    assert "translator" not in names(launch("waldo"))
    *_, translator = launch("waldo", translate="true", set="head.camera_on_head=true", sim_time="true")
    assert (translator.name, translator.executable) == ("translator", "socialbot")
    ours, ros = split_ros_args(translator.command)
    assert ours[:2] == ["translate", "waldo"]
    assert "head.camera_on_head=true" in ours
    assert ros == ["--ros-args", "-p", "use_sim_time:=true", "--ros-args", "-r", "__node:=translator"]
    file = tmp_path / "waldo.yaml"
    file.write_text(PAGE)
    *_, translator = launch("workstation", deployment=str(file), translate="head")
    assert translator.command[:5] == ["translate", str(file), "--machine", "workstation", "--head"]


def test_refuses_an_unknown_parameter(launch):
    with pytest.raises(ParameterError, match="no parameter 'sauce'"):
        launch("graph", set="camera.sauce=0")


def test_each_machine_has_its_nodes_and_image_links(launch, tmp_path):
    file = tmp_path / "waldo.yaml"
    file.write_text(PAGE)
    robot = launch("robot", deployment=str(file))
    assert names(robot) == {"camera", "speech", "head", "camera_image_raw_to_workstation"}
    workstation = launch("workstation", deployment=str(file))
    assert names(robot) | names(workstation) == {config.name for config in graph_of(workstation).nodes}
    assert not names(robot) & names(workstation)


def test_each_machine_has_its_domain_peers_and_keys(launch, tmp_path):
    file = tmp_path / "waldo.yaml"
    file.write_text(PAGE)
    # What is right as it is they inherit.
    nodes = {node.name: {**os.environ, **(node.additional_env or {})} for node in launch("robot", deployment=str(file))}
    assert {env["ROS_DOMAIN_ID"] for env in nodes.values()} == {"42"}
    assert {env["ROS_STATIC_PEERS"] for env in nodes.values()} == {"10.77.0.2"}
    assert {env[KEYS_VARIABLE] for env in nodes.values()} == {f"{tmp_path / 'keys'}:robot"}
    assert nodes["camera"][DATAGRAM_VARIABLE] == str(UNBOUNDED_BYTES)
    assert nodes["speech"][DATAGRAM_VARIABLE] == str(PACKET_BYTES)


def test_refuses_an_unknown_machine(launch, tmp_path):
    file = tmp_path / "waldo.yaml"
    file.write_text(PAGE)
    with pytest.raises(GraphError, match="no machine 'kitchen'"):
        launch("graph", deployment=str(file), machine="kitchen")
