"""``socialbot demo``: demos of all agent packages, each with a page of its run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from socialbot.cli.replay import replay, replay_bag
from socialbot.cli.run import run, simulate
from socialbot.core.errors import ParameterError
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


def _options_of(function: Callable[..., Any], *chosen: str) -> dict[str, inspect.Parameter]:
    """Parameters of a command, without those that a demo chooses."""
    parameters = inspect.signature(function, eval_str=True).parameters
    return {name: each for name, each in parameters.items() if name not in chosen}


COMMON = _options_of(run, "graph", "robot")
"""Parameters of ``socialbot run``; those that do not choose the graph are options of every demo, too."""

REPLAY_COMMON = _options_of(replay, "bag", "graph", "image_topic", "truth")
"""Parameters of ``socialbot replay`` that are options of every demo on a bag."""


def add_demo(name: str, make: Demo) -> None:
    """Add the demo ``name``. Raises ParameterError if one of its options has the name of a common one."""

    def start(own: dict[str, Any], given: dict[str, Any]) -> None:
        title, graph = make(**own)
        simulate(title=title, graph=graph, **given)

    _add(name, make, COMMON, start)


def add_replay_demo(name: str, make: ReplayDemo) -> None:
    """Add the demo ``name`` on a recorded bag. Raises ParameterError as `add_demo` does."""

    def start(own: dict[str, Any], given: dict[str, Any]) -> None:
        graph, bag = make(**own)
        replay_bag(bag=bag, graph=graph, image_topic=None, truth=None, **given)

    _add(name, make, REPLAY_COMMON, start)


def _add(
    name: str,
    make: Callable[..., Any],
    common: dict[str, inspect.Parameter],
    start: Callable[[dict[str, Any], dict[str, Any]], None],
) -> None:
    """Add a command with the options of ``make`` and common ones, which calls ``start`` with both."""
    own = inspect.signature(make, eval_str=True).parameters
    context, *others = common.values()
    if taken := sorted(own.keys() & common.keys()):
        remedy = "rename the parameter: all demos have an option of this name"
        raise ParameterError(f"the parameter {taken[0]!r} is taken", where=f"demo {name}", remedy=remedy)

    def command(**given: Any) -> None:
        start({each: given.pop(each) for each in own}, given)

    command.__doc__ = make.__doc__
    keywords = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in (context, *own.values(), *others)]
    command.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in keywords}
    demo.command(name)(command)


for package in agent_packages():
    for name, reference in package.demos.items():
        add_demo(name, package.load("demos", reference))
    for name, reference in package.replays.items():
        add_replay_demo(name, package.load("replays", reference))
