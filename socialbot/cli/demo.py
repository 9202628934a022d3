"""``socialbot demo``: demos of all agent packages, each with a page of its run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import typer

from socialbot.cli._options import command_of
from socialbot.cli.replay import replay_bag
from socialbot.cli.run import simulate
from socialbot.core.registry import agent_packages
from socialbot.graph.node import Graph

PANEL = "Start here"
EXAMPLES = (
    "socialbot demo warehouse --run 2",
    "socialbot demo hospital --problems 50 --inspect",
    "socialbot demo reception --inspect",
)
Demo = Callable[..., tuple[str, Graph]]
"""Function that makes the title and the graph of a demo. Its parameters are options, its docstring is the help text."""

ReplayDemo = Callable[..., tuple[Graph, Path]]
"""Function that makes the graph of a demo on a recorded bag, and names the bag."""

demo = typer.Typer(
    add_completion=False, help="Run a demo of agents, with a page of what they did.", no_args_is_help=True
)


for package in agent_packages():
    for name, reference in package.demos.items():
        make: Demo = package.load("demos", reference)
        demo.command(name)(command_of(make, ("title", "graph"), simulate, without=("bag_path",)))
    for name, reference in package.replays.items():
        make_replay: ReplayDemo = package.load("replays", reference)
        hidden = ("image_topic", "truth")
        demo.command(name)(command_of(make_replay, ("graph", "bag"), replay_bag, without=hidden))
