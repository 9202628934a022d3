"""Files of other programs, given to the readers of socialbot."""

from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.core.errors import GraphError
from socialbot.core.foreign_files import foreign_page, foreign_text
from socialbot.core.registry import graph_names, graph_text, robot_files
from socialbot.core.yaml import read_page
from socialbot.graph.files import load_graph
from socialbot.robots.profile import load_profile
from socialbot.runtime.deployment import load_deployment

FILES = {
    "nav2.yaml": ("a file of Nav2 parameters", "bt_navigator: {ros__parameters: {global_frame: map}}"),
    "all.yaml": ("a file of ROS parameters", "/**: {ros__parameters: {use_sim_time: true}}"),
    "control.yaml": ("a file of ROS parameters", "controller_manager:\n  ros__parameters: {update_rate: 100}"),
    "space.yaml": ("a file of ROS parameters", "robot: {camera: {ros__parameters: {fps: 30}}}"),
    "start.yaml": ("a ROS 2 launch file", "launch:\n- node: {pkg: demo_nodes_cpp, exec: talker}"),
    "start.launch.py": ("a ROS 2 launch file", "import os\n\ndef generate_launch_description():\n    return 1"),
    "start.launch.xml": ("a ROS 2 launch file", "<launch><node pkg='a' exec='b'/></launch>"),
    "robot.urdf": ("a URDF", "<?xml version='1.0'?>\n<!-- a robot -->\n<robot name='r'><link name='base'/></robot>"),
    "world.sdf": ("an SDF of Gazebo", "<?xml version='1.0'?><sdf version='1.6'><world name='w'/></sdf>"),
    "other.xml": ("an XML file", "<?xml version='1.0'?><other/>"),
    "map.yaml": ("a map of Nav2", "{image: map.pgm, resolution: 0.05, origin: [0, 0, 0], occupied_thresh: 0.65}"),
    "view.rviz": (
        "a configuration of RViz",
        "{Panels: [], Visualization Manager: {Displays: []}, Window Geometry: {}}",
    ),
    "camera.yaml": ("a camera calibration", "{image_width: 640, image_height: 480, camera_matrix: {rows: 3}}"),
}
READERS = {
    "graph": load_graph,
    "deployment": lambda path: load_deployment(Path(path)),
    "robot": load_profile,
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", FILES)
def test_an_error_says_what_the_file_is_and_what_to_do(reader: str, name: str, tmp_path: Path) -> None:
    what, text = FILES[name]
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(GraphError) as caught:
        READERS[reader](str(file))
    assert caught.value.what == f"this is {what}, not a file of socialbot"
    assert caught.value.where == str(file)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "text", ["", "name: x", "launch: 1", "# <robot>\nname: x", "a: {b: {c: {ros__parameters: {}}}}"]
)
def test_other_files_are_not_recognised(text: str) -> None:
    assert foreign_text(text) is None
    if text:
        assert foreign_page(read_page(text, where="here").page) is None


def test_all_own_graphs_and_profiles_are_read() -> None:
    texts = [*map(graph_text, graph_names()), *(Path(path).read_text() for path in robot_files().values())]
    assert texts
    for text in texts:
        read_page(text, where="here")
