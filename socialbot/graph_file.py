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
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.errors import GraphError
from socialbot.graph import Graph, Node, Placement, suggestion

NODE_TYPES: Mapping[str, str] = {
    "camera": "socialbot.vision.camera_node:Camera",
    "carrier": "socialbot.agents.warehouse.carrier:Carrier",
    "cleaner": "socialbot.agents.cleaner.cleaner:Cleaner",
    "gripper": "socialbot.agents.warehouse.gripper:Gripper",
    "head": "socialbot.agents.waldo.head:Head",
    "image_converter": "socialbot.vision.image_converter:ImageConverter",
    "listener": "socialbot.agents.waldo.listener:Listener",
    "person_detector": "socialbot.vision.person_detector:PersonDetector",
    "speaker": "socialbot.speech.speaker:Speaker",
    "sweeper": "socialbot.agents.cleaner.team:Sweeper",
    "team_cleaner": "socialbot.agents.cleaner.team:TeamCleaner",
    "waldo": "socialbot.agents.waldo.waldo_node:WaldoNode",
    "warehouse_world": "socialbot.agents.warehouse.world_node:World",
}
"""The nodes that come with socialbot."""

GRAPHS: Mapping[str, str] = {
    "cleaner": "agents/cleaner/graph.yaml",
    "cleaner-sweeper": "agents/cleaner/pair.yaml",
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
    try:
        page = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise GraphError(f"no valid YAML: {error.problem}", where=f"{where}:{line}") from error
    except YAMLError as error:
        raise GraphError(f"no valid YAML: {error}", where=where) from error
    root = _Section(page, where)
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


def _placement(name: str, section: _Section, where: str) -> Placement:
    section.only("type", "parameters", "remap")
    remap = section.section("remap", {})
    return Placement(
        name=name,
        type=node_type(section.text("type"), where=section.line("type")),
        parameters={str(key): _plain(value) for key, value in section.section("parameters", {}).page.items()},
        remap={str(port): remap.text(port) for port in remap.page},
        where=where,
    )


def _plain(value: object) -> object:
    """Without the notation (1e3, 0x10, ...) that the YAML loader remembers in subclasses of numbers."""
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value


class _Section:
    """A mapping of the file that knows where it stands."""

    def __init__(self, page: Any, where: str) -> None:
        if not isinstance(page, Mapping):
            raise GraphError(f"expected names with values, got {page!r}", where=where)
        self._file = where.rsplit(":", 1)[0] if where.rsplit(":", 1)[-1].isdigit() else where
        self.page: Mapping[Any, Any] = page
        self.where = f"{self._file}:{page.lc.line + 1}" if isinstance(page, CommentedMap) else where

    def only(self, *known: str) -> None:
        for key in self.page:
            if key not in known:
                raise GraphError(f"unknown key {key!r}", where=self.line(key), remedy=suggestion(str(key), known))

    def text(self, key: Any, default: str | None = None) -> str:
        value = self.page.get(key, default)
        if not isinstance(value, str):
            raise GraphError(f"{key!r} must be a text, got {value!r}", where=self.line(key))
        return value

    def texts(self, key: str) -> list[str]:
        value = self.page.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise GraphError(f"{key!r} must be a list of texts, got {value!r}", where=self.line(key))
        return value

    def section(self, key: Any, default: Mapping[str, object] | None = None) -> _Section:
        if key not in self.page and default is None:
            raise GraphError(f"{key!r} is missing", where=self.where)
        return _Section(self.page.get(key, default), self.line(key))

    def line(self, key: Any) -> str:
        """File and line of ``key``."""
        if isinstance(self.page, CommentedMap) and key in self.page:
            return f"{self._file}:{self.page.lc.key(key)[0] + 1}"
        return self.where
