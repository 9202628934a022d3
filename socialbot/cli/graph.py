"""``socialbot graph``: check a graph and show its nodes, topics and parameters."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from socialbot.cli._options import GraphArgument


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
    for config in loaded.nodes:
        for name, parameter in config.type.parameters().items():
            value = config.parameters.get(name, parameter.default)
            console.print(f"{config.name}.{name} = {value!r}", style="bold", soft_wrap=True)
            console.print(f"    {parameter.doc}", style="dim", soft_wrap=True)
