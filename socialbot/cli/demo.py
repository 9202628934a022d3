"""``socialbot demo``: demos of all agent packages, each with a page of its run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer

from socialbot.cli.run import run, simulate
from socialbot.core.registry import agent_packages, resolve
from socialbot.graph.node import Graph

Demo = Callable[..., tuple[str, Graph]]
"""Function that makes the title and the graph of a demo. Its parameters are options, its docstring is the help text."""

demo = typer.Typer(help="Run a demo of agents, with a page of what they did.", no_args_is_help=True)

COMMON = inspect.signature(run, eval_str=True).parameters
"""Parameters of ``socialbot run``; those after the graph are options of every demo, too."""


def add_demo(name: str, make: Demo) -> None:
    """Add the demo ``name``. If it has an option ``rate`` of its own, the speed of the run is ``--speed``."""
    own = inspect.signature(make, eval_str=True).parameters
    speed = "speed" if "rate" in own else "rate"
    options = [each.replace(name=speed if each.name == "rate" else each.name) for each in COMMON.values()]
    context, _, *common = options

    def command(**given: Any) -> None:
        title, graph = make(**{each: given.pop(each) for each in own})
        given["rate"] = given.pop(speed)
        simulate(title=title, graph=graph, **given)

    command.__doc__ = make.__doc__
    parameters = [context, *own.values(), *common]
    keywords = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in parameters]
    command.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    demo.command(name)(command)


for package in agent_packages():
    for name, reference in package.demos.items():
        add_demo(name, resolve(reference))
