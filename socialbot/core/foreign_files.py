"""Recognise files of other programs that users give to socialbot by mistake."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

PARAMETERS = "ros__parameters"
_PARAMETERS_DEPTH = 3  # namespace, node, ros__parameters
_HEAD = 10_000  # characters in which the root of an XML document, or the function of a launch file, is looked for
_ROOT = re.compile(r"<([A-Za-z][\w.-]*)[\s/>]")
_LAUNCH_FUNCTION = re.compile(r"^def generate_launch_description\b", re.MULTILINE)
_NAV2_NODES = frozenset({"amcl", "bt_navigator", "controller_server", "planner_server", "behavior_server"})


@dataclass(frozen=True)
class ForeignFile:
    """What a file is, and what its user can do."""

    what: str
    remedy: str


_LAUNCH = ForeignFile("a ROS 2 launch file", "start it with ros2 launch, beside socialbot")
_XML = {
    "launch": _LAUNCH,
    "robot": ForeignFile(
        "a URDF", "leave it to robot_state_publisher; a robot profile names joints and their limits: docs/robots.md"
    ),
    "sdf": ForeignFile(
        "an SDF of Gazebo", "start Gazebo with it; a robot profile names the topics of the robot there: docs/robots.md"
    ),
}


def foreign_text(text: str) -> ForeignFile | None:
    """Recognise XML and Python; None for other text."""
    head = text[:_HEAD]
    if head.lstrip("\ufeff \t\r\n").startswith("<"):
        root = _ROOT.search(head)
        name = root[1] if root else ""
        remedy = "give a YAML file: docs/tutorial.md shows that of a graph, docs/deploy.md that of a deployment"
        return _XML.get(name) or ForeignFile("an XML file", remedy)
    if _LAUNCH_FUNCTION.search(head):
        return _LAUNCH
    return None


def foreign_page(page: Any) -> ForeignFile | None:
    """Recognise a parsed YAML file of ROS; None for other content."""
    if not isinstance(page, Mapping):
        return None
    if isinstance(page.get("launch"), list):
        return _LAUNCH
    if _has_parameters(page, _PARAMETERS_DEPTH):
        kind = "Nav2" if _NAV2_NODES & page.keys() else "ROS"
        return ForeignFile(
            f"a file of {kind} parameters",
            "give it to its own nodes with --params-file; a robot profile names topics and actions (docs/robots.md), "
            "and --set NODE.PARAMETER=VALUE sets a parameter of a node of socialbot",
        )
    if {"image", "resolution", "occupied_thresh"} <= page.keys():
        return ForeignFile("a map of Nav2", "give it to map_server")
    if {"Panels", "Visualization Manager"} <= page.keys():
        return ForeignFile(
            "a configuration of RViz",
            "open it with rviz2 -d; socialbot translate publishes what RViz can show: docs/rviz.md",
        )
    if {"image_width", "camera_matrix"} <= page.keys():
        return ForeignFile(
            "a camera calibration",
            "give it to the driver of the camera, or to the node camera: --set camera.camera_info_url=FILE",
        )
    return None


def _has_parameters(page: Any, depth: int) -> bool:
    if not isinstance(page, Mapping) or not depth:
        return False
    return PARAMETERS in page or any(_has_parameters(value, depth - 1) for value in page.values())
