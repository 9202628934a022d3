"""The commands ``socialbot param``: list, print and set parameters of running nodes."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.text import Text

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import TimeoutOption, plain_table

PANEL = "Join a running graph"
EXAMPLES = (
    "socialbot param list person_detector",
    "socialbot param set person_detector threshold 0.6",
)
param = typer.Typer(add_completion=False, help="List, print and set parameters of running nodes.", no_args_is_help=True)

NodeArgument = Annotated[str, typer.Argument(metavar="NODE", help="Node, such as person_detector or /arm/driver.")]
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Parameter, such as threshold.")]


@param.command(name="list")
def list_parameters(
    node: Annotated[str | None, typer.Argument(metavar="[NODE]", help="Node; without one, list the nodes.")] = None,
    timeout: TimeoutOption = 5.0,
) -> None:
    """List the running nodes, or the parameters of one with their values."""
    from socialbot.bridge.node_services import parameter_client

    console = Console()
    with parameter_client(timeout_s=timeout) as client:
        if node is None:
            console.print("\n".join(client.nodes()) or "no nodes", markup=False)
            return
        found = client.describe(node)
    table = plain_table("parameter", "value", "description")
    for each in found:
        note = f"{each.doc} (fixed)".strip() if each.fixed else each.doc
        table.add_row(Text(each.name, "bold"), Text(repr(each.value)), Text(note))
    console.print(table if found else "no parameters")


@param.command()
def get(node: NodeArgument, name: NameArgument, timeout: TimeoutOption = 5.0) -> None:
    """Print the value of a parameter."""
    from socialbot.bridge.node_services import parameter_client

    with parameter_client(timeout_s=timeout) as client:
        print_line(client.get(node, name).value)


@param.command(name="set")
def set_parameter(
    node: NodeArgument,
    name: NameArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="Value of the type of the present one, as YAML.")],
    timeout: TimeoutOption = 5.0,
) -> None:
    """Set a parameter; the node may refuse it."""
    from socialbot.bridge.node_services import parameter_client

    with parameter_client(timeout_s=timeout) as client:
        print_line(client.set(node, name, value))
