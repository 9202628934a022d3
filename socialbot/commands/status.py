"""``socialbot status``: how every node fares; see docs/cli.md."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from socialbot.completion import graph_names
from socialbot.ending import Ending
from socialbot.errors import ParameterError
from socialbot.health import HEALTH_TOPIC
from socialbot.messages import Health, Message
from socialbot.status import PAUSED, NodeStatus, RollCall, Spread, all_well

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

PASSING = {"unconfigured", "inactive", "starting", "configuring", "activating", "input silent", "no input yet", PAUSED}
"""Conditions that may pass by themselves."""

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
            begun = time.monotonic()
            with Live(console=console, auto_refresh=False, screen=False) as live:
                while not ending.asked:
                    live.update(page(roll.statuses(time.monotonic()), listening=time.monotonic() < begun + HEARD_S))
                    live.refresh()
                    _pause(ending, REFRESH_S)
        else:
            _listen(roll, ending, wait)
        statuses = roll.statuses(time.monotonic())
    if as_json:
        typer.echo(as_text(statuses))
    elif not watch:
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


def page(statuses: Sequence[NodeStatus], *, listening: bool = False) -> RenderableType:
    """A table of ``statuses``, what is wrong below it, and all of it in one line."""
    if not statuses:
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        return Text("listening ..." if listening else f"no node is heard in ROS domain {domain}", style="yellow")
    well = sum(one.is_well for one in statuses)
    summary = Text(
        f"all {well} nodes are well" if well == len(statuses) else f"{well} of {len(statuses)} nodes are well",
        style="green" if well == len(statuses) else "bold red",
    )
    told = [Text.assemble((f"{one.name}: ", "bold"), text) for one in statuses for text in remarks(one)]
    return Group(table(statuses), *(Text(""), *told) if told else (), Text(""), summary)


def table(statuses: Sequence[NodeStatus]) -> Table:
    """A line for each node; columns that hold nothing are left out."""
    shown = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    shown.add_column("node", style="bold", overflow="fold", min_width=10)
    shown.add_column("machine", overflow="fold", min_width=5)
    shown.add_column("state", overflow="fold", min_width=10)
    columns = {
        "in Hz": [_figure(one.handled_hz) for one in statuses],
        "out Hz": [_figure(one.published_hz) for one in statuses],
        "call ms": [_both(one.call) for one in statuses],
        "age ms": [_both(one.age) for one in statuses],
        "CPU %": _once_a_process(statuses, [_figure(one.cpu_percent) for one in statuses]),
        "MB": _once_a_process(statuses, [_figure(one.memory_mb) for one in statuses]),
        "restarts": [str(one.restarts or "") for one in statuses],
        "refused": [str(one.refused or "") for one in statuses],
    }
    columns = {heading: cells for heading, cells in columns.items() if any(cells)}
    for heading in columns:
        shown.add_column(heading, justify="right", no_wrap=True)
    for number, one in enumerate(statuses):
        cells = [cells[number] for cells in columns.values()]
        shown.add_row(one.name, one.machine, Text(one.condition, style=_style(one)), *cells)
    return shown


def remarks(one: NodeStatus) -> list[str]:
    """What there is to say of a node beyond its line in the table."""
    found = []
    if one.twin:
        found.append(f"another node of this name is {one.twin}: both hear and say the same; end one of them")
    if one.last_error:
        found.append(f"its process {one.last_error}")
    if one.reason:
        found.append(one.reason)
    if one.failures:
        found.append(f"failed {one.failures} times; first: {one.first_failure}")
    if one.lacks:
        found.append(f"nobody at the other end of {one.lacks}")
    if one.refused:
        found.append(f"refused {one.refusals or one.refused}")
    return found


def _style(one: NodeStatus) -> str:
    if one.condition in PASSING:
        return "yellow"
    return "green" if one.is_well else "bold red"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def _both(spread: Spread | None) -> str:
    return "" if spread is None else f"{_figure(spread.mean_ms)}/{_figure(spread.p99_ms)}"


def _once_a_process(statuses: Sequence[NodeStatus], figures: Sequence[str]) -> list[str]:
    """``figures``, with a ditto mark where a node of the same process has shown its own."""
    cells = []
    shown: set[str] = set()
    for one, figure in zip(statuses, figures, strict=True):
        cells.append('"' if figure and shown.intersection(one.shares) else figure)
        shown.add(one.name)
    return cells
