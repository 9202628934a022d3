"""``socialbot translate``: a running graph in messages that other packages know; see docs/ros-installation.md."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from socialbot.commands.inspect import graph_of, until_told
from socialbot.completion import graph_names


def translate(
    context: typer.Context,
    file: Annotated[
        str,
        typer.Argument(metavar="FILE|GRAPH", help="The graph or the deployment that runs.", autocompletion=graph_names),
    ],
    machine: Annotated[str | None, typer.Option(help="Of a deployment: the one this is.")] = None,
    head: Annotated[
        bool, typer.Option("--head", help="Also say where the head is, which on a robot its drivers do.")
    ] = False,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="What the graph was started with; may be repeated."),
    ] = None,
) -> None:
    """Say again, in the types of RViz, vision_msgs and ROS4HRI, what a running graph sees and does; until Ctrl-C.

    Takes the arguments of ROS, too: --ros-args -r /tf:=/robot/tf -p use_sim_time:=true.
    """
    from socialbot.bridge.observing import observing
    from socialbot.bridge.session import spinning_node
    from socialbot.bridge.translator import Translator, translated_topics
    from socialbot.cli import with_changes

    console = Console(highlight=False)
    graph = with_changes(graph_of(file, machine), changes or [])
    with spinning_node("translator", context.obj) as ros:
        translator = Translator(ros, graph, head=head)
        for topic in translator.topics:
            console.print(topic, markup=False, soft_wrap=True)
        for package in sorted(translator.missing):
            console.print(
                f"without {package}, which is not installed, or whose libraries are not found",
                style="yellow",
                soft_wrap=True,
            )
        with observing(translated_topics(graph), translator.take, lambda *_: None, graph.wire):
            until_told()
