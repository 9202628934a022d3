"""``socialbot status``: how every node fares; see docs/cli.md."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.live import Live

from socialbot.commands.status_page import Screen, page
from socialbot.completion import graph_names
from socialbot.ending import Ending
from socialbot.errors import ParameterError
from socialbot.health import HEALTH_TOPIC
from socialbot.messages import Health, Message
from socialbot.status import NodeStatus, RollCall, all_well

if TYPE_CHECKING:
    from socialbot.graph import WireForm

NOT_WELL = 10
"""The exit code when a node is missing, failed, given up, or otherwise not well."""

LISTEN_S = 4.0
"""So long nodes are waited for that do not speak."""

HEARD_S = 2.0
"""So long it listens where it does not know who there should be: who is there has spoken twice by then."""

WIDE = 200
"""Columns of a page that goes into a file or pipe."""

LOOK_AGAIN_S = 0.05
REFRESH_S = 0.5

FileArgument = Annotated[
    str | None,
    typer.Argument(
        help="A deployment file, a graph file, or a graph that comes with socialbot.", autocompletion=graph_names
    ),
]


def status(
    file: FileArgument = None,
    machine: Annotated[str | None, typer.Option(help="Of a deployment: the one this is.")] = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Go on until Ctrl-C.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
    wait: Annotated[float, typer.Option(min=0.0, help="Wait up to so many seconds until all is well.")] = 0.0,
) -> None:
    """Show how every node of a running graph fares, on all machines. Exit code 10 when one is not well.

    With a FILE it knows which nodes there should be; without one it shows all that it hears in the ROS domain.
    """
    party = join(file, machine)
    roll = RollCall(party.expected)
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = WIDE
    with Ending().on_signals() as ending, calling(roll, party.form):
        if watch and not as_json:
            _watch(roll, ending, console)
        else:
            _listen(roll, ending, wait)
        statuses = roll.statuses(time.monotonic())
    if as_json:
        typer.echo(as_text(statuses))
    else:
        console.print(page(statuses))
    if not all_well(statuses):
        raise typer.Exit(NOT_WELL)


@dataclass(frozen=True)
class Party:
    """The nodes ``expected`` in a graph with their machines, and the ``form`` of their messages."""

    expected: Mapping[str, str] = field(default_factory=dict)
    form: WireForm = "json"


def join(file: str | None, machine: str | None) -> Party:
    """Joins the graph that ``file`` describes, as ``machine`` of it.

    Without a file it joins the ROS domain that the environment names, and nobody is expected. Raises GraphError and
    ParameterError for what does not fit.
    """
    from socialbot.deployment.deployment_file import is_deployment, load_deployment

    if file is not None and is_deployment(file):
        from socialbot.deployment.entering import enter

        deployment = load_deployment(Path(file))
        enter(deployment, machine or deployment.this_machine())
        places = {one.name: name for name in deployment.machines for one in deployment.half(name)}
        graph = deployment.graph
        return Party({one.name: places[one.name] for one in graph.placements}, graph.wire)
    if machine is not None:
        raise ParameterError("without a deployment there are no machines", where="--machine", remedy="give its file")
    if file is None:
        return Party()
    from socialbot.graph_file import load_graph

    graph = load_graph(file)
    return Party({one.name: "" for one in graph.placements}, graph.wire)


@contextmanager
def calling(roll: RollCall, form: WireForm) -> Iterator[None]:
    """``roll`` takes what nodes tell as long as the block lasts; ``form`` is that of their messages."""
    from socialbot.bridge.observing import observing

    def observe(_: str, message: Message) -> None:
        if isinstance(message, Health):
            roll.note_health(message, time.monotonic())

    def note(name: str, values: Mapping[str, str]) -> None:
        roll.note(name, values, time.monotonic())

    with observing({HEALTH_TOPIC: Health}, observe, note, form=form):
        yield


def _watch(roll: RollCall, ending: Ending, console: Console) -> None:
    """Shows the nodes on a screen of their own until told to end."""
    screen = Screen(time.monotonic() + HEARD_S)
    with Live(console=console, auto_refresh=False, screen=console.is_terminal, vertical_overflow="crop") as live:
        while not ending.asked:
            now = time.monotonic()
            live.update(screen.at(now, roll.statuses(now)), refresh=True)
            _pause(ending, REFRESH_S)


def _listen(roll: RollCall, ending: Ending, wait_s: float) -> None:
    """Listens until all that matters has been heard; with ``wait_s`` until all is well, but not longer."""
    begun = time.monotonic()
    while not ending.asked:
        passed = time.monotonic() - begun
        heard = roll.complete or passed > (LISTEN_S if roll.expects else HEARD_S)
        if heard and (passed > wait_s or all_well(roll.statuses(time.monotonic()))):
            return
        time.sleep(LOOK_AGAIN_S)


def _pause(ending: Ending, seconds: float) -> None:
    until = time.monotonic() + seconds
    while not ending.asked and time.monotonic() < until:
        time.sleep(LOOK_AGAIN_S)


def as_text(statuses: Sequence[NodeStatus]) -> str:
    """``statuses`` as JSON; docs/cli.md tells its shape."""
    nodes = [{**asdict(one), "condition": one.condition, "well": one.is_well} for one in statuses]
    report = {"schema": "socialbot/status", "version": 1, "well": all_well(statuses), "nodes": nodes}
    return json.dumps(report, indent=2)
