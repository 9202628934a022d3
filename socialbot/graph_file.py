"""Graph files: a YAML page that names nodes, their types, parameters and remapped topics.

::

    name: waldo
    inputs: [/camera/image_raw]          # topics that come from outside
    paced_by: /humans/bodies/detections  # the answer to each frame that a replay waits for
    nodes:
      person_detector:
        type: person_detector            # a name of `NODE_TYPES`, or package.module:Class
        parameters: {threshold: 0.4}
        remap: {image: /camera/image_color}
"""

from __future__ import annotations

import importlib
import importlib.resources
import io
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ruamel.yaml import YAML

from socialbot.errors import GraphError
from socialbot.graph import Graph, Node, Placement, suggestion
from socialbot.yaml_page import Section, plain, read_page

NODE_TYPES: Mapping[str, str] = {
    "camera": "socialbot.vision.camera_node:Camera",
    "carrier": "socialbot.agents.warehouse.carrier:Carrier",
    "cleaner": "socialbot.agents.cleaner.cleaner:Cleaner",
    "gripper": "socialbot.agents.warehouse.gripper:Gripper",
    "head": "socialbot.agents.waldo.head:Head",
    "hospital_coordinator": "socialbot.agents.hospital.coordinator_node:HospitalCoordinator",
    "hospital_world": "socialbot.agents.hospital.ward_node:HospitalWorld",
    "image_converter": "socialbot.vision.image_converter:ImageConverter",
    "listener": "socialbot.agents.waldo.listener:Listener",
    "nurse": "socialbot.agents.hospital.robot_node:Nurse",
    "person_detector": "socialbot.vision.person_detector:PersonDetector",
    "picture_receiver": "socialbot.vision.picture_receiver:PictureReceiver",
    "picture_sender": "socialbot.vision.picture_sender:PictureSender",
    "speaker": "socialbot.speech.speaker:Speaker",
    "spot": "socialbot.agents.hospital.robot_node:Spot",
    "sweeper": "socialbot.agents.cleaner.team:Sweeper",
    "team_cleaner": "socialbot.agents.cleaner.team:TeamCleaner",
    "uvd": "socialbot.agents.hospital.robot_node:Uvd",
    "waldo": "socialbot.agents.waldo.waldo_node:WaldoNode",
    "warehouse_world": "socialbot.agents.warehouse.world_node:World",
}
"""The nodes that come with socialbot."""

GRAPHS: Mapping[str, str] = {
    "cleaner": "agents/cleaner/graph.yaml",
    "cleaner-sweeper": "agents/cleaner/pair.yaml",
    "hospital": "agents/hospital/graph.yaml",
    "waldo": "agents/waldo/graph.yaml",
    "warehouse": "agents/warehouse/graph.yaml",
}
"""The graphs that come with socialbot."""


def load_graph(name: str) -> Graph:
    """The graph called ``name``, one of `GRAPHS` or a file.

    Node types of its own may stand in modules beside the file. Raises GraphError with file and line.
    """
    if name in GRAPHS:
        text = importlib.resources.files("socialbot").joinpath(GRAPHS[name]).read_text("utf-8")
        return parse_graph(text, where=name)
    path = Path(name)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GraphError(f"cannot read the graph: {error}", where=name, remedy=suggestion(name, GRAPHS)) from error
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    return parse_graph(text, where=str(path))


def parse_graph(text: str, *, where: str) -> Graph:
    """The graph that the YAML ``text`` describes; ``where`` is named in errors."""
    root = read_page(text, where=where)
    root.only("name", "inputs", "paced_by", "nodes")
    nodes = root.section("nodes")
    placements = tuple(_placement(str(node), nodes.section(node), nodes.line(node)) for node in nodes.page)
    graph = Graph(name=root.text("name"), placements=placements, inputs=frozenset(root.texts("inputs")))
    try:
        return replace(graph, paced_by=root.text("paced_by", ""))
    except GraphError as error:
        raise GraphError(error.what, where=root.line("paced_by"), remedy=error.remedy) from error


def dump_graph(graph: Graph) -> str:
    """The YAML text that `parse_graph` makes ``graph`` of."""
    page = {
        "name": graph.name,
        "inputs": sorted(graph.inputs),
        "paced_by": graph.paced_by,
        "nodes": {
            placement.name: {
                "type": f"{placement.type.__module__}:{placement.type.__qualname__}",
                "parameters": dict(placement.parameters),
                "remap": dict(placement.remap),
            }
            for placement in graph.placements
        },
    }
    text = io.StringIO()
    YAML(typ="rt").dump(page, text)
    return text.getvalue()


def node_type(name: str, *, where: str = "") -> type[Node]:
    """The node class called ``name``: one of `NODE_TYPES` or package.module:Class. Raises GraphError."""
    path = NODE_TYPES.get(name, name)
    module, _, attribute = path.partition(":")
    if not attribute:
        raise GraphError(
            f"unknown node type {name!r}",
            where=where,
            remedy=f"{suggestion(name, NODE_TYPES)}; or package.module:Class of your own",
        )
    try:
        found = getattr(importlib.import_module(module), attribute)
    except Exception as error:
        what = f"cannot load node type {name!r}: {type(error).__name__}: {error}"
        raise GraphError(what, where=where, remedy="mend the module; it may stand beside the graph file") from error
    if not (isinstance(found, type) and issubclass(found, Node)):
        raise GraphError(f"{name!r} is no node", where=where, remedy="give a subclass of socialbot.graph.Node")
    return found


def _placement(name: str, section: Section, where: str) -> Placement:
    section.only("type", "parameters", "remap")
    remap = section.section("remap", {})
    return Placement(
        name=name,
        type=node_type(section.text("type"), where=section.line("type")),
        parameters={str(key): plain(value) for key, value in section.section("parameters", {}).page.items()},
        remap={str(port): remap.text(port) for port in remap.page},
        where=where,
    )
