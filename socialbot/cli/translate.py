"""``socialbot translate``: republish a running graph in standard ROS message types."""

from __future__ import annotations

from typing import Annotated

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import MachineOption, graph_names, join
from socialbot.cli.inspect import wait_for_signal

PANEL = "Join a running graph"
EXAMPLES = ("socialbot translate waldo",)


def translate(
    context: typer.Context,
    file: Annotated[
        str,
        typer.Argument(metavar="FILE|GRAPH", help="The running graph or deployment.", autocompletion=graph_names),
    ],
    machine: MachineOption = None,
    head: Annotated[
        bool, typer.Option("--head", help="Also publish the head pose, which the drivers of a real robot do.")
    ] = False,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NODE.PARAMETER=VALUE",
            help="Change a parameter, as at the start of the graph; repeatable.",
        ),
    ] = None,
) -> None:
    """Republish a running graph as messages of RViz, vision_msgs and ROS4HRI, until Ctrl-C.

    ROS arguments are accepted, too: --ros-args -r /tf:=/robot/tf -p use_sim_time:=true.
    """
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.bridge.translator import NOT_FOUND, Translator, translated_topics
    from socialbot.graph.files import with_changes

    console = Console()
    graph, _ = join(file, machine)
    graph = with_changes(graph, changes or [])
    with spinning_node("translator", context.obj) as ros:
        translator = Translator(ros, graph, head=head)
        for topic in translator.topics:
            console.print_plain(topic)
        for package in sorted(translator.missing):
            console.print_plain(f"without {package}: {NOT_FOUND}", "yellow")
        with observe_graph(translated_topics(graph), translator.take, lambda *_: None, graph.wire):
            wait_for_signal()
