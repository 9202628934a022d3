"""``socialbot status``: show the status of every node in a running graph."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from socialbot.cli._console import Console
from socialbot.cli._options import JsonOption, expect_effect, expect_no_machine, graph_names, join, times
from socialbot.cli._runs import print_json
from socialbot.core.messages import Health, Message
from socialbot.core.process import Ending
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.status import PAUSED, NodeStatus, NodeStatuses, Spread, all_well

if TYPE_CHECKING:
    from socialbot.graph.node import WireForm


PANEL = "Run a graph"
EXAMPLES = (
    "socialbot status",
    "socialbot status deploy.yaml --watch",
)
PASSING = {"unconfigured", "inactive", "starting", "configuring", "activating", "input silent", "no input yet", PAUSED}

TEXTS = {"node": (10, 21), "machine": (5, 11), "state": (10, 15)}
"""Columns of text: minimum width of a page, and maximum width of the live screen."""

FIGURES = {"for": 6, "in Hz": 5, "out Hz": 6, "call ms": 9, "age ms": 9, "CPU %": 5, "MB": 4}
"""Columns of the live screen with their widths: fixed so that it does not shift, and for 100 columns in total."""

UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))

NOT_WELL = 10  # exit code: a node is missing, failed, given up, or otherwise unhealthy
LISTEN_S = 4.0  # timeout (s) for expected nodes
HEARD_S = 2.0  # listening time (s) if no nodes are expected: each live node publishes at least twice

LOOK_AGAIN_S = 0.05
REFRESH_S = 0.5


def status(
    context: typer.Context,
    file: Annotated[
        str | None, typer.Argument(help="Deployment file, graph file or built-in graph.", autocompletion=graph_names)
    ] = None,
    machine: Annotated[
        str | None, typer.Option(help="Machine of a deployment that this one is; default: by address.")
    ] = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Refresh the table until Ctrl-C.")] = False,
    as_json: JsonOption = False,
    wait: Annotated[float, typer.Option(min=0.0, help="Wait at most this many seconds until all nodes are well.")] = 0,
) -> None:
    """Show the status of every node in a running graph, on all machines. Exit code 10: a node is not well.

    With a FILE it reports missing nodes. Without one it shows all nodes in the ROS domain.
    """
    if watch:
        expect_effect(context, ("as_json", "wait"), "with --watch")
    form, machines = "json", {}
    if file is None:
        expect_no_machine(machine)
    else:
        graph, machines = join(file, machine)
        form = graph.wire
    roll = NodeStatuses(machines)
    console = Console()
    with Ending().on_signals() as ending, calling(roll, form):
        if watch:
            _watch(roll, ending, console)
        else:
            _listen(roll, ending, wait)
        statuses = roll.statuses(time.monotonic())
    if as_json:
        print_json(as_data(statuses))
    else:
        console.print(page(statuses))
    if not all_well(statuses):
        raise typer.Exit(NOT_WELL)


@contextmanager
def calling(roll: NodeStatuses, form: WireForm) -> Iterator[None]:
    """Collect node statuses in ``roll`` inside the block; ``form`` is the message form of the graph."""
    from socialbot.bridge.graph_observer import observe_graph

    def observe(_: str, message: Message) -> None:
        if isinstance(message, Health):
            roll.note_health(message, time.monotonic())

    def note(name: str, values: Mapping[str, str]) -> None:
        roll.note(name, values, time.monotonic())

    with observe_graph({HEALTH_TOPIC: Health}, observe, note, form=form):
        yield


def _watch(roll: NodeStatuses, ending: Ending, console: Console) -> None:
    screen = Screen(time.monotonic() + HEARD_S)
    with Live(console=console, auto_refresh=False, screen=console.is_terminal, vertical_overflow="crop") as live:
        while not ending.asked:
            now = time.monotonic()
            live.update(screen.at(now, roll.statuses(now)), refresh=True)
            while not ending.asked and time.monotonic() < now + REFRESH_S:
                time.sleep(LOOK_AGAIN_S)


def _listen(roll: NodeStatuses, ending: Ending, wait_s: float) -> None:
    """Wait until the statuses are complete; with ``wait_s``, also until all nodes are well, or at most that long."""
    begun = time.monotonic()
    while not ending.asked:
        passed = time.monotonic() - begun
        found = roll.complete or passed > (LISTEN_S if roll.expects else HEARD_S)
        if found and (passed > wait_s or all_well(roll.statuses(time.monotonic()))):
            return
        time.sleep(LOOK_AGAIN_S)


def as_data(statuses: Sequence[NodeStatus]) -> dict[str, Any]:
    """Return ``statuses`` as data for JSON; docs/cli.md describes the schema."""
    nodes = [{**asdict(one), "condition": one.condition, "well": one.is_well} for one in statuses]
    return {"schema": "socialbot/status", "version": 1, "well": all_well(statuses), "nodes": nodes}


def page(statuses: Sequence[NodeStatus]) -> RenderableType:
    """Return the table of ``statuses``, the remarks below it, and the summary."""
    if not statuses:
        return _summary(statuses)
    return Group(_table(statuses), *_remarks(statuses), Text(""), _summary(statuses))


class Screen:
    """Live status screen, which also measures how long each node has had its condition.

    Missing nodes are not reported before the time ``listen_until`` (s).
    """

    def __init__(self, listen_until: float) -> None:
        self._listen_until = listen_until
        self._since: dict[str, tuple[str, float]] = {}

    def at(self, now: float, statuses: Sequence[NodeStatus]) -> RenderableType:
        """Return the screen for ``statuses`` at the time ``now`` (s)."""
        title = Text.assemble(_summary(statuses), (f"   {time.strftime('%H:%M:%S')}   Ctrl-C ends it", "dim"))
        if not statuses:
            return Text("listening ...", style="yellow") if now < self._listen_until else title
        shown = _table(statuses, [self._lasting(one, now) for one in statuses])
        return Group(title, Text(""), shown, *_remarks(statuses))

    def _lasting(self, one: NodeStatus, now: float) -> tuple[str, float]:
        """Return the condition of a node, and its duration (s)."""
        what = "no messages" if one.condition.startswith("no messages") else one.condition
        if self._since.get(one.name, ("",))[0] != what:
            heard_s = one.heard_s if what == "no messages" and one.heard_s is not None else 0.0
            self._since[one.name] = (what, now - heard_s)
        return what, now - self._since[one.name][1]


def _table(statuses: Sequence[NodeStatus], lasting: Sequence[tuple[str, float]] = ()) -> Table:
    """Return a table with one row per node, without empty columns.

    With ``lasting``, the condition of each node and its duration (s), the columns are fixed for the live screen.
    """
    shown = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 1 if lasting else 2, 0, 0))
    for heading, (least, most) in TEXTS.items():
        if lasting:
            shown.add_column(heading, no_wrap=True, min_width=min(most, 15), max_width=most)
        else:
            shown.add_column(heading, overflow="fold", min_width=least)
    figures = [_figures(one) for one in statuses]
    for number, one in enumerate(statuses):
        if lasting:
            figures[number]["for"] = in_short(lasting[number][1])
        if {before.name for before in statuses[:number]}.intersection(one.shares):
            # Figures of a process are shown once.
            figures[number] |= {name: '"' for name in ("CPU %", "MB") if figures[number][name]}
    headings = FIGURES if lasting else [name for name in _figures(statuses[0]) if any(row[name] for row in figures)]
    for heading in headings:
        shown.add_column(heading, justify="right", no_wrap=True, min_width=FIGURES[heading] if lasting else None)
    for number, one in enumerate(statuses):
        style = "yellow" if one.condition in PASSING else "green" if one.is_well else "bold red"
        name = in_the_middle(one.name, TEXTS["node"][1]) if lasting else one.name
        state = lasting[number][0] if lasting else one.condition
        cells = (figures[number][heading] for heading in headings)
        shown.add_row(Text(name, "bold" if one.is_well else style), Text(one.machine), Text(state, style), *cells)
    return shown


def _figures(one: NodeStatus) -> dict[str, str]:
    """Return rates, costs and counts by heading."""
    return {
        "in Hz": _figure(one.handled_hz),
        "out Hz": _figure(one.published_hz),
        "call ms": _both(one.call),
        "age ms": _both(one.age),
        "CPU %": _figure(one.cpu_percent),
        "MB": _figure(one.memory_mb),
        "restarts": str(one.restarts or ""),
        "refused": str(one.refused or ""),
    }


def _summary(statuses: Sequence[NodeStatus]) -> Text:
    if not statuses:
        from socialbot.bridge.environment import ros_domain
        from socialbot.bridge.shared_memory import other_users

        domain = ros_domain()
        hint = "" if domain else "; replay, run and demo use an own domain: they print it with -v"
        if users := other_users(domain):
            hint = f"; {' and '.join(users)} may run nodes there: only the same user sees them"
        return Text(f"no node found in ROS domain {domain}{hint}", style="yellow")
    well = sum(one.is_well for one in statuses)
    if well == len(statuses):
        return Text(f"all {well} nodes are well", style="green")
    return Text(f"{well} of {len(statuses)} nodes are well", style="bold red")


def _remarks(statuses: Sequence[NodeStatus]) -> list[Text]:
    """Return remarks that the table has no column for, after a blank line."""
    found = []
    for one in statuses:
        restarted = f"; restarted {times(one.restarts)}" if one.restarts else ""
        remarks = {
            f"another node has this name: {one.twin}; stop one of them": one.twin,
            f"its process {one.last_error}{restarted}": one.last_error,
            one.reason: one.reason,
            f"failed {times(one.failures)}; first: {one.first_failure}": one.failures,
            f"not connected: {one.lacks}": one.lacks,
            f"refused {one.refusals or one.refused}": one.refused,
            f"missed messages and subscribed again: {one.resubscribed}": one.resubscribed,
            f"too slow for its inputs, and dropped messages: {one.dropped}": one.dropped,
        }
        found += [Text.assemble((f"{one.name}: ", "bold"), text) for text, applies in remarks.items() if applies]
    return [Text(""), *found] if found else []


def in_short(seconds: float) -> str:
    """Format a duration in its largest unit."""
    size, unit = next((each for each in UNITS if seconds >= each[0]), UNITS[-1])
    return f"{seconds // size:.0f} {unit}"


def in_the_middle(text: str, longest: int) -> str:
    """Shorten ``text`` to ``longest`` characters by an ellipsis in the middle."""
    half = (longest - 1) // 2
    return text if len(text) <= longest else f"{text[: longest - 1 - half]}…{text[-half:]}"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def _both(spread: Spread | None) -> str:
    return "" if spread is None else f"{_figure(spread.mean_ms)}/{_figure(spread.p99_ms)}"
