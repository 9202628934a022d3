"""Deployment files: a YAML page that says which node of a graph runs on which machine.

::

    graph: waldo                  # a graph that comes with socialbot, or a file beside this one
    domain: 42                    # of ROS; 0 by default
    discovery: peers              # machines know each other's addresses; or {server: robot}, {server: 'robot:11811'}
    machines:
      robot: {address: 10.77.0.1}
      workstation: {address: 10.77.0.2}
    nodes:                        # all of them; to move one, edit its line
      camera: robot
      person_detector: workstation
    pictures:                     # for topics of pictures that go from one machine to the other
      /camera/image_raw: {transport: jpeg, quality: 80, rate_hz: 30}    # or {transport: raw}
    restart: {times: 5, within_s: 60, first_s: 0.2, longest_s: 5}
    security: {keys: keys}        # a folder beside this file
    minds: minds                  # another, in which agents find their minds again after a restart
    parameters:
      bdi_engine: {greeting: Hallo}
"""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path

from socialbot.bridge.environment import HIGHEST_DOMAIN
from socialbot.bridge.restarting import RestartPolicy
from socialbot.deployment.crossing import Pictures
from socialbot.deployment.deployment import SERVER_PORT, Deployment, Server
from socialbot.errors import GraphError, ParameterError
from socialbot.graph import Graph, check_parameters, suggestion
from socialbot.graph_file import GRAPHS, load_graph
from socialbot.security import paths
from socialbot.yaml_page import Section, plain, read_page

KEYS = ("graph", "domain", "discovery", "machines", "nodes", "pictures", "restart", "security", "minds", "parameters")
TRANSPORTS = ("jpeg", "raw")


def is_deployment(name: str) -> bool:
    """Whether ``name`` is a file that tells of machines, and so no graph."""
    if name in GRAPHS:
        return False
    try:
        text = Path(name).read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return any(line.startswith(("machines:", "machines :", '"machines"', "'machines'")) for line in text.splitlines())


def load_deployment(path: Path) -> Deployment:
    """The deployment that the file at ``path`` describes; beside it nodes may read and write files.

    Raises GraphError or ParameterError with file and line.
    """
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GraphError(f"cannot read the deployment: {error}", where=str(path)) from error
    folder = path.resolve().parent
    paths.allow(folder)
    return parse_deployment(text, where=str(path), folder=folder)


def parse_deployment(text: str, *, where: str, folder: Path) -> Deployment:
    """The deployment that the YAML ``text`` describes; ``where`` is named in errors, files stand in ``folder``."""
    root = read_page(text, where=where)
    root.only(*KEYS)
    graph = _graph(root, folder)
    try:
        return Deployment(
            written=graph,
            machines=_machines(root.section("machines")),
            places=_texts(root.section("nodes")),
            domain=root.whole("domain", 0, minimum=0, maximum=HIGHEST_DOMAIN),
            server=_server(root),
            pictures=_pictures(root.section("pictures", {})),
            restart=_restart(root.section("restart", {})),
            keys=_keys(root, folder),
            minds=folder / root.text("minds") if "minds" in root.page else None,
        )
    except (GraphError, ParameterError) as error:
        first, _, rest = (error.where or "").partition(".")
        if first not in KEYS:
            raise
        name, _, setting = rest.rpartition(".")
        place = root.line(first, name, setting) if name else root.line(first, rest)
        raise type(error)(error.what, where=place, remedy=error.remedy) from error


def _graph(root: Section, folder: Path) -> Graph:
    name = root.text("graph")
    try:
        graph = load_graph(name if name in GRAPHS else str(folder / name))
    except GraphError as error:
        if name in GRAPHS or os.path.isfile(folder / name):
            raise
        raise GraphError(f"no graph {name!r}", where=root.line("graph"), remedy=suggestion(name, GRAPHS)) from error
    section = root.section("parameters", {})
    parameters = {str(node): {str(k): plain(v) for k, v in section.section(node).page.items()} for node in section.page}
    names = [placement.name for placement in graph.placements]
    for node, values in parameters.items():
        if node not in names:
            raise GraphError(f"no node {node!r}", where=section.line(node), remedy=suggestion(node, names))
        for name, value in values.items():
            check_parameters(graph.placement(node).type, {name: value}, where=section.line(node, name))
    return graph.with_parameters(parameters)


def _machines(section: Section) -> dict[str, str]:
    machines = {}
    for name in section.page:
        machine = section.section(name)
        machine.only("address")
        machines[str(name)] = machine.text("address")
    return machines


def _texts(section: Section) -> dict[str, str]:
    return {str(key): section.text(key) for key in section.page}


def _server(root: Section) -> Server | None:
    if root.page.get("discovery", "peers") == "peers":
        return None
    if isinstance(root.page["discovery"], str):
        raise GraphError(
            f"no kind of discovery: {root.text('discovery')!r}",
            where=root.line("discovery"),
            remedy="peers, or {server: MACHINE}",
        )
    section = root.section("discovery")
    section.only("server")
    machine, colon, port = section.text("server").partition(":")
    if colon and not (port.isascii() and port.isdigit() and len(port) < 6 and 0 < int(port) < 65536):
        raise GraphError(
            f"no port: {port!r}", where=section.line("server"), remedy=f"write MACHINE or MACHINE:{SERVER_PORT}"
        )
    return Server(machine, int(port) if colon else SERVER_PORT)


def _pictures(section: Section) -> dict[str, Pictures]:
    pictures = {}
    for topic in section.page:
        one = section.section(topic)
        one.only("transport", "quality", "least_quality", "rate_hz")
        transport = one.text("transport", "jpeg")
        if transport not in TRANSPORTS:
            raise GraphError(
                f"no transport: {transport!r}", where=one.line("transport"), remedy=f"one of {', '.join(TRANSPORTS)}"
            )
        parameters = {str(name): plain(value) for name, value in one.page.items() if name != "transport"}
        pictures[str(topic)] = Pictures("raw" if transport == "raw" else "jpeg", parameters)
    return pictures


def _restart(section: Section) -> RestartPolicy:
    usual = RestartPolicy()
    names = [field.name for field in fields(RestartPolicy)]
    section.only(*names)
    seconds = {
        name: section.number(name, getattr(usual, name), minimum=0.01, maximum=1e6)
        for name in names
        if name.endswith("_s")
    }
    return RestartPolicy(times=section.whole("times", usual.times, minimum=0, maximum=10**6), **seconds)


def _keys(root: Section, folder: Path) -> Path | None:
    if "security" not in root.page:
        return None
    section = root.section("security")
    section.only("keys")
    return folder / section.text("keys")
