"""``socialbot node``: run single nodes of a graph."""

from __future__ import annotations

import logging
from typing import Annotated

import typer

from socialbot.cli._options import ParentOption, SetOption, graph_names, node_names

PANEL = "Run a graph"
EXAMPLES = (
    "socialbot node person_detector",
    "socialbot node camera image_converter --graph my_graph.yaml",
)


def node(
    context: typer.Context,
    names: Annotated[list[str], typer.Argument(help="Nodes to run in this process.", autocompletion=node_names)],
    graph: Annotated[
        str, typer.Option("--graph", help="Built-in graph or graph file.", autocompletion=graph_names)
    ] = "waldo",
    sim_time: Annotated[bool, typer.Option("--sim-time", help="Take the time from /clock.")] = False,
    parent: ParentOption = None,
    changes: SetOption = None,
) -> None:
    """Run single nodes of a graph; they join the running graph until Ctrl-C.

    ROS arguments are accepted, too: --ros-args -p NAME:=VALUE --params-file FILE.
    """
    from socialbot.core.process_settings import apply_settings

    apply_settings()  # before other imports start threads
    from socialbot.bridge.process import run_nodes
    from socialbot.graph.files import load_graph, with_changes

    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", handlers=[])
    changed = with_changes(load_graph(graph), changes or [])
    run_nodes(changed, names, sim_time=sim_time, parent=parent, ros_args=context.obj)
