"""``socialbot graph``: check a graph and show its nodes, topics and parameters."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from socialbot.bridge.ros_checks import expect_types, missing_types
from socialbot.cli._console import Console
from socialbot.cli._options import CheckedRunnerOption, GraphArgument, RobotOption
from socialbot.core.errors import GraphError

if TYPE_CHECKING:
    from socialbot.graph.node import Graph


PANEL = "Write agents and graphs"
EXAMPLES = (
    "socialbot graph waldo",
    "socialbot graph my_graph.yaml",
    "socialbot graph my_graph.yaml --runner ros",
)


def graph(
    graph: GraphArgument,
    robot: RobotOption = None,
    runner: CheckedRunnerOption = None,
) -> None:
    """Check a graph and show its nodes, topics and parameters. With --runner, refuse what it cannot run."""
    from socialbot.graph.files import load_graph

    loaded = load_graph(graph, robot=robot or "")
    if runner == "inline":
        loaded.with_stand_ins().expect_answers()
    elif runner == "ros":
        expect_types(loaded)
    console = Console()
    configs = (*loaded.nodes, *loaded.stand_ins)
    extra = ("offers", "calls") if any(config.servers or config.clients for config in configs) else ()
    table = Table("node", "input", "output", *extra, title=loaded.name, title_justify="left", show_lines=True)
    for config in configs:
        ports = (config.subscriptions, config.publications, config.servers, config.clients)[: 2 + len(extra)]
        name = f"{config.name}\n(stand-in)" if config in loaded.stand_ins else config.name
        table.add_row(name, *("\n".join(topic for topic, _ in each) for each in ports))
    console.print(table)
    for problem in _lacks(loaded):
        console.print(f"[yellow]warning[/] {escape(problem)}", soft_wrap=True)
    for config in loaded.nodes:
        for name, parameter in config.type.parameters().items():
            value = config.parameters.get(name, parameter.default)
            console.print_plain(f"{config.name}.{name} = {value!r}", style="bold")
            console.print_plain(f"    {parameter.doc}", style="dim")


def _lacks(graph: Graph) -> Iterator[str]:
    """Yield a sentence for each type or answer that a run of the graph would lack."""
    for topic, error in missing_types(graph) if find_spec("rclpy") is not None else ():
        yield f"{topic}: {error.what}; only --runner inline can run this graph; {error.remedy}"
    try:
        graph.with_stand_ins().expect_answers()
    except GraphError as error:
        yield f"{error.where}: {error.what.replace('this run', 'replays and simulations')}; {error.remedy}"
