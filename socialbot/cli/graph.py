"""``socialbot graph``: check a graph and show its nodes, topics and parameters."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from socialbot.cli._options import GraphArgument
from socialbot.core.errors import InstallationError

if TYPE_CHECKING:
    from socialbot.graph.node import Graph


def graph(graph: GraphArgument) -> None:
    """Check a graph and show its nodes, topics and parameters."""
    from socialbot.graph.files import load_graph

    loaded = load_graph(graph)
    console = Console(highlight=False)
    table = Table("node", "input", "output", title=loaded.name, title_justify="left", show_lines=True)
    for config in loaded.nodes:
        ports = (config.subscriptions, config.publications)
        table.add_row(config.name, *("\n".join(topic for topic, _ in each) for each in ports))
    console.print(table)
    for problem in _missing_types(loaded):
        console.print(f"[yellow]warning[/] {escape(problem)}", soft_wrap=True)
    for config in loaded.nodes:
        for name, parameter in config.type.parameters().items():
            value = config.parameters.get(name, parameter.default)
            console.print(f"{config.name}.{name} = {value!r}", style="bold", soft_wrap=True)
            console.print(f"    {parameter.doc}", style="dim", soft_wrap=True)


def _missing_types(graph: Graph) -> Iterator[str]:
    """Yield a sentence for each ROS type of the graph that ROS processes on this machine could not use."""
    from socialbot.bridge.transport import message_class
    from socialbot.core.messages import RosMessage

    if find_spec("rclpy") is None:
        return
    for topic, kind in sorted(graph.topics().items()):
        if issubclass(kind, RosMessage):
            try:
                message_class(kind.ros_type)
            except InstallationError as error:
                yield f"{topic}: {error.what}; only --runner inline can run this graph; {error.remedy}"
