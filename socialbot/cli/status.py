"""``socialbot status``: show the status of every node in a running graph."""

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

from socialbot.cli._options import graph_names
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Health, Message
from socialbot.core.process import Ending
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.status import PAUSED, NodeStatus, RollCall, Spread, all_well

if TYPE_CHECKING:
    from socialbot.graph.node import WireForm


PASSING = {"unconfigured", "inactive", "starting", "configuring", "activating", "input silent", "no input yet", PAUSED}
"""Transient conditions."""

FIGURES = {"in Hz": 5, "out Hz": 6, "call ms": 9, "age ms": 9, "CPU %": 5, "MB": 4}
"""The columns of figures with their widths, fixed so that the screen does not shift."""

LONGEST_NAME, LONGEST_MACHINE, LONGEST_STATE, LONGEST_TIME = 21, 11, 15, 6
"""The maximum widths of the other columns, for a screen of 100 columns."""

UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))


class Screen:
    """Live status screen, which also measures how long each node has had its condition.

    Missing nodes are not reported before the time ``heard`` (s).
    """

    def __init__(self, heard: float) -> None:
        self._heard = heard
        self._since: dict[str, tuple[str, float]] = {}

    def at(self, now: float, statuses: Sequence[NodeStatus]) -> RenderableType:
        """Return the screen for ``statuses`` at the time ``now`` (s)."""
        title = Text.assemble(summary(statuses), (f"   {time.strftime('%H:%M:%S')}   Ctrl-C ends it", "dim"))
        if not statuses:
            return Text("listening ...", style="yellow") if now < self._heard else title
        return Group(title, Text(""), self._table(now, statuses), *remarked(statuses))

    def _table(self, now: float, statuses: Sequence[NodeStatus]) -> Table:
        """Return one row per node, without line breaks. Remarks below the table hold the omitted columns."""
        shown = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
        widths = {"node": LONGEST_NAME, "machine": LONGEST_MACHINE, "state": LONGEST_STATE}
        for heading, width in widths.items():
            shown.add_column(heading, no_wrap=True, min_width=min(width, 15), max_width=width)
        for heading, width in {"for": LONGEST_TIME, **FIGURES}.items():
            shown.add_column(heading, justify="right", no_wrap=True, min_width=width)
        columns = figures(statuses).values()
        for number, one in enumerate(statuses):
            what, begun = self._lasting(one, now)
            cells = [cells[number] for cells in columns]
            name = _name(one, in_the_middle(one.name, LONGEST_NAME))
            shown.add_row(name, one.machine, Text(what, style=_style(one)), in_short(now - begun), *cells)
        return shown

    def _lasting(self, one: NodeStatus, now: float) -> tuple[str, float]:
        """Return the condition of a node, and the time (s) when it began."""
        what = "not heard" if one.condition.startswith("not heard") else one.condition
        known = self._since.get(one.name)
        if known is None or known[0] != what:
            heard_s = one.heard_s if what == "not heard" and one.heard_s is not None else 0.0
            known = self._since[one.name] = (what, now - heard_s)
        return known


def page(statuses: Sequence[NodeStatus]) -> RenderableType:
    """Return the table of ``statuses``, the remarks below it, and the summary."""
    if not statuses:
        return summary(statuses)
    return Group(table(statuses), *remarked(statuses), Text(""), summary(statuses))


def summary(statuses: Sequence[NodeStatus]) -> Text:
    """Return the number of healthy nodes."""
    if not statuses:
        return Text(f"no node is heard in ROS domain {os.environ.get('ROS_DOMAIN_ID') or '0'}", style="yellow")
    well = sum(one.is_well for one in statuses)
    if well == len(statuses):
        return Text(f"all {well} nodes are well", style="green")
    return Text(f"{well} of {len(statuses)} nodes are well", style="bold red")


def remarked(statuses: Sequence[NodeStatus]) -> list[Text]:
    """Return the remarks on all nodes after a blank line."""
    told = [Text.assemble((f"{one.name}: ", "bold"), text) for one in statuses for text in remarks(one)]
    return [Text(""), *told] if told else []


def table(statuses: Sequence[NodeStatus]) -> Table:
    """Return a table with one row per node, without empty columns."""
    shown = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    shown.add_column("node", overflow="fold", min_width=10)
    shown.add_column("machine", overflow="fold", min_width=5)
    shown.add_column("state", overflow="fold", min_width=10)
    columns = {
        **figures(statuses),
        "restarts": [str(one.restarts or "") for one in statuses],
        "refused": [str(one.refused or "") for one in statuses],
    }
    columns = {heading: cells for heading, cells in columns.items() if any(cells)}
    for heading in columns:
        shown.add_column(heading, justify="right", no_wrap=True)
    for number, one in enumerate(statuses):
        cells = [cells[number] for cells in columns.values()]
        shown.add_row(_name(one, one.name), one.machine, Text(one.condition, style=_style(one)), *cells)
    return shown


def figures(statuses: Sequence[NodeStatus]) -> dict[str, list[str]]:
    """Return rates and costs by the headings of `FIGURES`, in the order of ``statuses``."""
    return {
        "in Hz": [_figure(one.handled_hz) for one in statuses],
        "out Hz": [_figure(one.published_hz) for one in statuses],
        "call ms": [_both(one.call) for one in statuses],
        "age ms": [_both(one.age) for one in statuses],
        "CPU %": _once_a_process(statuses, [_figure(one.cpu_percent) for one in statuses]),
        "MB": _once_a_process(statuses, [_figure(one.memory_mb) for one in statuses]),
    }


def remarks(one: NodeStatus) -> list[str]:
    """Return the remarks on a node that the table has no column for."""
    found = []
    if one.twin:
        found.append(f"another node of this name is {one.twin}: both hear and say the same; end one of them")
    if one.last_error:
        found.append(
            f"its process {one.last_error}" + (f"; started again {_times(one.restarts)}" if one.restarts else "")
        )
    if one.reason:
        found.append(one.reason)
    if one.failures:
        found.append(f"failed {_times(one.failures)}; first: {one.first_failure}")
    if one.lacks:
        found.append(f"nobody at the other end of {one.lacks}")
    if one.refused:
        found.append(f"refused {one.refusals or one.refused}")
    return found


def in_short(seconds: float) -> str:
    """Format a duration in its largest unit."""
    size, unit = next((each for each in UNITS if seconds >= each[0]), UNITS[-1])
    return f"{seconds // size:.0f} {unit}"


def in_the_middle(text: str, longest: int) -> str:
    """Shorten ``text`` to ``longest`` characters by an ellipsis in the middle."""
    half = (longest - 1) // 2
    return text if len(text) <= longest else f"{text[: longest - 1 - half]}…{text[-half:]}"


def _name(one: NodeStatus, name: str) -> Text:
    return Text(name, style="bold" if one.is_well else _style(one))


def _style(one: NodeStatus) -> str:
    if one.condition in PASSING:
        return "yellow"
    return "green" if one.is_well else "bold red"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def _both(spread: Spread | None) -> str:
    return "" if spread is None else f"{_figure(spread.mean_ms)}/{_figure(spread.p99_ms)}"


def _once_a_process(statuses: Sequence[NodeStatus], figures: Sequence[str]) -> list[str]:
    """Replace repeated figures of one process by a ditto mark."""
    cells = []
    shown: set[str] = set()
    for one, figure in zip(statuses, figures, strict=True):
        cells.append('"' if figure and shown.intersection(one.shares) else figure)
        shown.add(one.name)
    return cells


NOT_WELL = 10
"""Exit code: a node is missing, failed, given up, or otherwise unhealthy."""

LISTEN_S = 4.0
"""The timeout (s) for expected nodes."""

HEARD_S = 2.0
"""The listening time (s) if no nodes are expected: each live node publishes at least twice."""

WIDE = 200
"""The width of a page for a file or pipe."""

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
    """Show the status of every node in a running graph, on all machines. Exit code 10: a node is not well.

    With a FILE it reports missing nodes. Without one it shows all nodes in the ROS domain.
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
    """Join the ROS domain of the graph in ``file``, as ``machine``. Without a file, join the default domain.

    Raises:
        GraphError: The file is not a valid graph or deployment.
        ParameterError: ``machine`` is given without a deployment.
    """
    from socialbot.runtime.deployment import is_deployment, load_deployment

    if file is not None and is_deployment(file):
        from socialbot.runtime.machine import enter

        deployment = load_deployment(Path(file))
        enter(deployment, machine or deployment.this_machine())
        places = {one.name: name for name in deployment.machines for one in deployment.half(name)}
        graph = deployment.graph
        return Party({one.name: places[one.name] for one in graph.placements}, graph.wire)
    if machine is not None:
        raise ParameterError("without a deployment there are no machines", where="--machine", remedy="give its file")
    if file is None:
        return Party()
    from socialbot.graph.files import load_graph

    graph = load_graph(file)
    return Party({one.name: "" for one in graph.placements}, graph.wire)


@contextmanager
def calling(roll: RollCall, form: WireForm) -> Iterator[None]:
    """Collect node statuses in ``roll`` inside the block; ``form`` is the message form of the graph."""
    from socialbot.bridge.graph_observer import observe_graph

    def observe(_: str, message: Message) -> None:
        if isinstance(message, Health):
            roll.note_health(message, time.monotonic())

    def note(name: str, values: Mapping[str, str]) -> None:
        roll.note(name, values, time.monotonic())

    with observe_graph({HEALTH_TOPIC: Health}, observe, note, form=form):
        yield


def _watch(roll: RollCall, ending: Ending, console: Console) -> None:
    screen = Screen(time.monotonic() + HEARD_S)
    with Live(console=console, auto_refresh=False, screen=console.is_terminal, vertical_overflow="crop") as live:
        while not ending.asked:
            now = time.monotonic()
            live.update(screen.at(now, roll.statuses(now)), refresh=True)
            _pause(ending, REFRESH_S)


def _listen(roll: RollCall, ending: Ending, wait_s: float) -> None:
    """Wait until the statuses are complete; with ``wait_s``, also until all nodes are well, or at most that long."""
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
    """Format ``statuses`` as JSON; docs/cli.md describes the schema."""
    nodes = [{**asdict(one), "condition": one.condition, "well": one.is_well} for one in statuses]
    report = {"schema": "socialbot/status", "version": 1, "well": all_well(statuses), "nodes": nodes}
    return json.dumps(report, indent=2)
