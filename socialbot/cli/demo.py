"""``socialbot demo``: demos of all agent packages, each with a page of its run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer

from socialbot.cli.run import run, simulate
from socialbot.core.errors import ParameterError
from socialbot.core.registry import agent_packages, resolve
from socialbot.graph.node import Graph

PANEL = "Start here"
EXAMPLES = (
    "socialbot demo warehouse --run 2",
    "socialbot demo hospital --problems 50 --inspect",
)
Demo = Callable[..., tuple[str, Graph]]
"""Function that makes the title and the graph of a demo. Its parameters are options, its docstring is the help text."""

demo = typer.Typer(
    add_completion=False, help="Run a demo of agents, with a page of what they did.", no_args_is_help=True
)

_GRAPH_OPTIONS = ("graph", "robot")
COMMON = {
    name: each for name, each in inspect.signature(run, eval_str=True).parameters.items() if name not in _GRAPH_OPTIONS
}
"""Parameters of ``socialbot run``; those that do not choose the graph are options of every demo, too."""


def add_demo(name: str, make: Demo) -> None:
    """Add the demo ``name``. Raises ParameterError if one of its options has the name of a common one."""
    own = inspect.signature(make, eval_str=True).parameters
    context, *common = COMMON.values()
    if taken := sorted(own.keys() & COMMON.keys()):
        remedy = "rename the parameter: all demos have an option of this name"
        raise ParameterError(f"the parameter {taken[0]!r} is taken", where=f"demo {name}", remedy=remedy)

    def command(**given: Any) -> None:
        title, graph = make(**{each: given.pop(each) for each in own})
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
