"""Graph files in YAML: nodes with their types, parameters and remapped topics.

::

    name: waldo
    inputs: [/camera/image_raw]          # external topics
    paced_by: /humans/bodies/detections  # a replay waits for this topic after each frame
    messages: json                       # or socialbot: typed messages; or standard: JSON, and standard types beside it
    robot: tiago                         # name or file of a robot profile, or a profile
    services: [/navigate_to_pose]        # services and actions of nodes outside the graph
    needs:                               # nodes outside the graph, watched by their services
      /lidar_driver: {state: active}
    stand_ins:                           # nodes that offer them in replays, simulations and tests
      navigator: {type: "tests.robot:Navigator"}
    nodes:
      person_detector:
        type: person_detector            # a registered name, or package.module:Class
        parameters: {threshold: 0.4}
        remap: {image: /camera/image_color}
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
from ruamel.yaml import YAML

from socialbot.core import paths, registry
from socialbot.core.errors import GraphError, ParameterError, suggestion
from socialbot.core.references import load_reference, look_in, reading_record
from socialbot.core.yaml import YamlSection, read_page
from socialbot.graph.node import Graph, Node, NodeConfig, WireForm, check_topic
from socialbot.graph.wizard import WizardEntry, read_wizard, wizard_page

MESSAGE_FORMS: Mapping[str, tuple[WireForm, bool]] = {
    "json": ("json", False),
    "socialbot": ("typed", False),
    "standard": ("json", True),
}
"""Values of ``messages`` in a graph file: encoding of structured messages, and whether to add standard ROS types."""

FOREIGN_NODE = "foreign_node"
"""Registered type of the watch of a node outside the graph."""


class _Node(msgspec.Struct):
    type: str
    parameters: dict[str, Any] = {}
    remap: dict[str, str] = {}


class _Page(msgspec.Struct):
    nodes: dict[str, _Node]
    name: str
    inputs: frozenset[str] = frozenset()
    paced_by: str = ""
    messages: str | None = None
    wire: str | None = None
    services: frozenset[str] = frozenset()
    needs: dict[str, dict[str, Any]] = {}
    stand_ins: dict[str, _Node] = {}
    wizard: dict[str, WizardEntry] = {}
    robot: str | dict[str, Any] | None = None


def load_graph(name: str | Path, *, robot: str | Path = "") -> Graph:
    """Load a registered graph by its name, or a graph file by its path.

    The folder of the file may hold modules with node types, and files that nodes read or write. ``robot`` is the name
    or file of a robot profile, in place of that of the file. Raises GraphError.
    """
    name, robot = str(name), str(robot)
    if (registered := registry.graph_text(name)) is not None:
        return parse_graph(registered, where=name, robot=robot)
    path = Path(name)
    if os.path.isdir(path):
        remedy = "name a graph file in it; or install its package, whose entry point socialbot.agents names its graphs"
        raise GraphError("is a folder, and no registered graph", where=name, remedy=remedy)
    text = paths.read_text(path, GraphError, remedy=suggestion(name, registry.graph_names()))
    folder = path.resolve().parent
    paths.allow(folder)
    look_in(folder)
    return parse_graph(text, where=str(path), robot=robot, folder=folder)


def parse_graph(text: str, *, where: str, robot: str = "", folder: Path | None = None) -> Graph:
    """Parse a graph from YAML. Errors name the source ``where``.

    ``robot`` is the name or file of a robot profile, in place of that of the text, whose files start at ``folder``.
    """
    root = read_page(text, where=where)
    page = root.read(_Page)
    for key in ("inputs", "services"):
        for place, topic in enumerate(root.page.get(key, ())):
            check_topic(topic, root.line(key, place))
    graph = Graph(
        name=page.name,
        nodes=(*_configs(root, "nodes", page.nodes), *_watches(root, page.needs)),
        inputs=page.inputs,
        services=page.services,
        stand_ins=tuple(_configs(root, "stand_ins", page.stand_ins)),
        wizard=read_wizard(root, page.wizard),
    )
    if page.messages is not None and page.wire is not None:
        raise GraphError("'wire' is the old name of 'messages'", where=root.line("wire"), remedy="leave 'wire' out")
    for key, form in (("messages", page.messages), ("wire", page.wire)):
        if form is not None:
            graph = with_messages(graph, form, where=root.line(key))
    try:
        graph = replace(graph, paced_by=page.paced_by)
    except GraphError as error:
        raise GraphError(error.what, where=root.line("paced_by"), remedy=error.remedy) from error
    if robot:
        return registry.robot_binding()(graph, robot, where="--robot")
    if page.robot is None:
        return graph
    named = page.robot if isinstance(page.robot, str) else root.section("robot")
    return registry.robot_binding()(graph, named, where=root.line("robot"), folder=folder)


MOVING = "in_simulated_time"
"""Parameter of nodes that move a robot also in replays and simulations."""


def parse_recorded(text: str, *, where: str, folder: Path) -> Graph:
    """Parse the graph of a bag or run in ``folder``, which are data of anybody.

    It imports nothing from the folder, and moves no robot. Raises GraphError.
    """
    with reading_record(folder):
        graph = parse_graph(text, where=where)
    return graph.with_parameters({one.name: {MOVING: False} for one in graph.nodes if MOVING in one.parameters})


def with_messages(graph: Graph, form: str, *, where: str) -> Graph:
    """Return ``graph`` with messages in one of `MESSAGE_FORMS`; ``typed`` is the old name of ``socialbot``.

    Raises GraphError.
    """
    form = "socialbot" if form == "typed" else form
    if form not in MESSAGE_FORMS:
        raise GraphError(f"no form of messages: {form!r}", where=where, remedy=suggestion(form, MESSAGE_FORMS))
    wire, standard = MESSAGE_FORMS[form]
    return replace(graph, wire=wire, standard=standard)


def dump_graph(graph: Graph) -> str:
    """Format a graph as YAML for `parse_graph`."""
    page = {
        "name": graph.name,
        "inputs": sorted(graph.inputs),
        "paced_by": graph.paced_by,
        "messages": next(name for name, form in MESSAGE_FORMS.items() if form == (graph.wire, graph.standard)),
        **({"services": sorted(graph.services)} if graph.services else {}),
        "nodes": _page(graph.nodes),
        **({"stand_ins": _page(graph.stand_ins)} if graph.stand_ins else {}),
        **({"wizard": wizard_page(graph.wizard)} if graph.wizard else {}),
    }
    text = io.StringIO()
    YAML(typ="rt").dump(page, text)
    return text.getvalue()


def _page(configs: Sequence[NodeConfig]) -> dict[str, object]:
    return {
        config.name: {
            "type": f"{config.type.__module__}:{config.type.__qualname__}",
            "parameters": dict(config.parameters),
            "remap": dict(config.remap),
        }
        for config in configs
    }


def _is_node(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Node)


def node_type(name: str, *, where: str = "") -> type[Node]:
    """Return the class of a registered node type, or of package.module:Class. Raises GraphError."""
    module, _, attribute = (name if ":" in name else registry.node_reference(name) or name).partition(":")
    if not attribute:
        raise GraphError(
            f"unknown node type {name!r}",
            where=where,
            remedy=f"{suggestion(name, registry.node_types())}; or package.module:Class of your own",
        )
    places = "beside the graph file or into the working directory"
    reference = f"{module}:{attribute}"
    found = load_reference(reference, "node type", _is_node, name=name, where=where, places=places)
    if not _is_node(found):
        raise GraphError(f"{name!r} is no node", where=where, remedy="give a subclass of socialbot.graph.node.Node")
    return found


def _configs(root: YamlSection, key: str, nodes: Mapping[str, _Node]) -> Iterator[NodeConfig]:
    for name, node in nodes.items():
        kind = node_type(node.type, where=root.line(key, name, "type"))
        yield NodeConfig(name, kind, node.parameters, node.remap, root.line(key, name))


def _watches(root: YamlSection, needs: Mapping[str, Mapping[str, Any]]) -> Iterator[NodeConfig]:
    """Yield a watch for each node that the graph needs, with parameters such as ``state`` and ``manage``."""
    for key, given in needs.items():
        full, where = f"/{key.lstrip('/')}", root.line("needs", key)
        if "node" in given:
            raise GraphError("the name of the node is its key", where=where, remedy="leave 'node' out")
        watch = node_type(FOREIGN_NODE, where=where)
        yield NodeConfig(
            name=f"{full.strip('/').replace('/', '_')}_watch",
            type=watch,
            parameters={"node": full, **given},
            remap={name: f"{full}{port.topic[1:]}" for name, port in watch.clients().items()},
            where=where,
        )


def with_changes(graph: Graph, changes: Sequence[str]) -> Graph:
    """Return ``graph`` with ``NODE.PARAMETER=VALUE`` and ``messages=FORM`` applied; files named there may be read.

    Raises:
        ParameterError: A change is malformed, or names an unknown parameter.
        GraphError: A change names an unknown node.
    """
    parameters: dict[str, dict[str, object]] = {}
    for change in changes:
        target, equals, text = change.partition("=")
        node, dot, name = target.partition(".")
        if target in ("messages", "wire"):
            graph = with_messages(graph, text, where=f"--set {target}")
            continue
        if not equals or not dot:
            raise ParameterError(f"cannot read {change!r}", where="--set", remedy="write NODE.PARAMETER=VALUE")
        node = _named(graph, node)
        declared = graph.node(node).type.parameters()
        if name not in declared:
            raise ParameterError(f"no parameter {name!r}", where=node, remedy=suggestion(name, declared))
        parameters.setdefault(node, {})[name] = _value(text, type(declared[name].default), target)
        if "/" in text:
            paths.allow(Path(text))
    return graph.with_parameters(parameters)


def _named(graph: Graph, name: str) -> str:
    """Return the name of a node, which may be given by its registered type if there is one node of it."""
    if any(name == config.name for config in (*graph.nodes, *graph.stand_ins)) or not registry.node_reference(name):
        return name
    kind = node_type(name)
    found = [config.name for config in graph.nodes if config.type is kind]
    return found[0] if len(found) == 1 else name


def _value(text: str, kind: type, where: str) -> object:
    try:
        return {"true": True, "false": False}[text.lower()] if kind is bool else kind(text)
    except (ValueError, KeyError) as error:
        raise ParameterError(f"{text!r} is not of type {kind.__name__}", where=where) from error
