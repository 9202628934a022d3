"""The commands ``socialbot lifecycle``: states and transitions of running managed nodes."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.text import Text

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import TimeoutOption, plain_table

PANEL = "Join a running graph"
EXAMPLES = (
    "socialbot lifecycle list",
    "socialbot lifecycle set lidar_driver activate",
)
lifecycle = typer.Typer(
    add_completion=False, help="Print and change the lifecycle states of running nodes.", no_args_is_help=True
)

NodeArgument = Annotated[str, typer.Argument(metavar="NODE", help="Managed node, such as lidar_driver or /arm/driver.")]


@lifecycle.command(name="list")
def list_states(
    node: Annotated[
        str | None, typer.Argument(metavar="[NODE]", help="Node; without one, list the managed nodes.")
    ] = None,
    timeout: TimeoutOption = 5.0,
) -> None:
    """List the managed nodes with their states, or the transitions that one can take now."""
    from socialbot.bridge.node_services import lifecycle_client

    with lifecycle_client(timeout_s=timeout) as client:
        if node is None:
            columns, rows = ("node", "state"), [(name, client.state(name)) for name in client.managed_nodes()]
        else:
            columns, rows = ("transition", "leads to"), list(client.transitions(node).items())
    table = plain_table(*columns)
    for first, second in rows:
        table.add_row(Text(first, "bold"), Text(second))
    empty = "no managed nodes" if node is None else "no transitions"
    Console().print(table if rows else empty)


@lifecycle.command()
def get(node: NodeArgument, timeout: TimeoutOption = 5.0) -> None:
    """Print the state of a node."""
    from socialbot.bridge.node_services import lifecycle_client

    with lifecycle_client(timeout_s=timeout) as client:
        print_line(client.state(node))


@lifecycle.command(name="set")
def set_state(
    node: NodeArgument,
    transition: Annotated[
        str, typer.Argument(metavar="TRANSITION", help="configure, activate, deactivate, cleanup or shutdown.")
    ],
    timeout: TimeoutOption = 5.0,
) -> None:
    """Request a transition, and print the state after it."""
    from socialbot.bridge.node_services import lifecycle_client

    with lifecycle_client(timeout_s=timeout) as client:
        print_line(client.change(node, transition))
