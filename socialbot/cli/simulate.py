"""``socialbot demo``: deliberating agents at work, with a page that shows what they did."""

from __future__ import annotations

import logging
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table

from socialbot.cli.completion import graph_names
from socialbot.cli.inspect import PORT, InspectOption, PortOption, watched

if TYPE_CHECKING:
    from socialbot.runs.console import Display
    from socialbot.runs.report import RunReport, Summary
    from socialbot.runtime.simulate import Run

NOT_REACHED = 10
"""Exit code: the run ended, and not all that was wanted was reached."""

demo = typer.Typer(help="Deliberating agents at work, with a page that shows what they did.", no_args_is_help=True)

RunnerOption = Annotated[
    Literal["inline", "ros"],
    typer.Option(help="inline: one thread; ros: a process a node, over DDS. Both as fast as they can."),
]
ComposedOption = Annotated[bool, typer.Option("--composed", help="All nodes in one process (ros).")]
RateOption = Annotated[
    float, typer.Option(min=0.0, max=1000.0, metavar="TIMES", help="How many times as fast as real time; 0: no limit.")
]
LimitOption = Annotated[float, typer.Option(min=1.0, metavar="SECONDS", help="End after so much simulated time.")]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the record of the run; default: runs/TIME.")]
BagOption = Annotated[bool, typer.Option("--bag", help="Record a bag, in the folder of the run, for replays.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="Change a parameter; may be repeated.")
]


class Boxes(str, Enum):
    """How many boxes there are."""

    SIX = "6"
    TWELVE = "12"
    TWENTY_FOUR = "24"


@demo.command()
def warehouse(
    context: typer.Context,
    run: Annotated[
        int, typer.Option(min=1, max=2, help="2: a carrier leaves too early, and plans have to change.")
    ] = 1,
    boxes: Annotated[Boxes, typer.Option(help="6 and 12 with three carriers, 24 with six.")] = Boxes.SIX,
    seed: Annotated[int, typer.Option(help="Chance of the run: speeds and stalls.")] = 0,
    faults: Annotated[
        str,
        typer.Option(metavar="TEXT", help="What goes wrong: '30 leaves carrier_c; 40 slips; 50 silent carrier_a 10'."),
    ] = "",
    runner: RunnerOption = "inline",
    composed: ComposedOption = False,
    rate: RateOption = 0.0,
    limit: LimitOption = 1800.0,
    out: OutOption = None,
    bag: BagOption = False,
    show_page: InspectOption = False,
    port: PortOption = PORT,
    changes: SetOption = None,
) -> None:
    """A gripper sorts boxes onto carriers, which take them away.

    Exit codes beside the usual ones: 10 not all that was wanted was reached.
    """
    from socialbot.agents.warehouse.demo import warehouse as graph_of
    from socialbot.runtime.simulate import Run

    graph = graph_of(int(boxes.value), run=2 if run == 2 else 1, seed=seed, faults=faults)
    title = f"The warehouse, run {run}" + ("" if boxes is Boxes.SIX else f", {boxes.value} boxes")
    _show(title, Run(graph, runner, composed, rate, limit), changes, out, bag, context if show_page else None, port)


@demo.command()
def hospital(
    context: typer.Context,
    rate: Annotated[float, typer.Option(min=0.0, max=100.0, metavar="%", help="Missions that meet a problem.")] = 50.0,
    seed: Annotated[
        int, typer.Option(help="Chance of the run; with the default one the paper's mission meets a problem at 50 %.")
    ] = 0,
    ward: Annotated[
        Literal["paper", "large"],
        typer.Option(
            help="paper: four rooms, a nurse, two robots, dirty rooms; large: problems of five kinds, anywhere."
        ),
    ] = "paper",
    rooms: Annotated[int, typer.Option(min=1, max=1000, help="Rooms of the large ward.")] = 50,
    robots: Annotated[int, typer.Option(min=1, max=100, help="Robots of each kind in the large ward.")] = 4,
    policy: Annotated[
        Literal["auto", "replan", "repair", "none"],
        typer.Option(help="After a problem: a new plan, a mended one, either by its joint actions (auto), or none."),
    ] = "auto",
    foresight: Annotated[
        bool,
        typer.Option("--foresight", help="The coordinator looks at the ward, and acts before a plan meets a problem."),
    ] = False,
    faults: Annotated[
        str,
        typer.Option(
            metavar="TEXT", help="What goes wrong besides: '2 dirty room1; 3 drains uvdrobot1; 4 enters room1 9'."
        ),
    ] = "",
    runner: RunnerOption = "inline",
    composed: ComposedOption = False,
    speed: RateOption = 0.0,
    limit: LimitOption = 1800.0,
    out: OutOption = None,
    bag: BagOption = False,
    show_page: InspectOption = False,
    port: PortOption = PORT,
    changes: SetOption = None,
) -> None:
    """Robots disinfect rooms of a hospital: tasks, teams, what fails, and the new plan.

    Exit codes beside the usual ones: 10 not all missions were done.
    """
    from socialbot.agents.hospital.demo import hospital as small
    from socialbot.agents.hospital.demo import large_hospital
    from socialbot.runtime.simulate import Run

    world, coordinator = {"faults": faults}, {"policy": policy, "proactive": foresight}
    if ward == "paper":
        graph = small(rate=rate, seed=seed, world=world, coordinator=coordinator)
    else:
        graph = large_hospital(rooms, robots, robots, rate=rate, seed=seed, world=world, coordinator=coordinator)
    title = f"The hospital, {rate:g} % problems" + ("" if ward == "paper" else f", {rooms} rooms")
    _show(title, Run(graph, runner, composed, speed, limit), changes, out, bag, context if show_page else None, port)


def _demo_of(name: str, title: str, what: str) -> None:
    """Adds the demo of a graph that comes with socialbot."""

    @demo.command(name=name, help=what)
    def show(
        context: typer.Context,
        runner: RunnerOption = "inline",
        composed: ComposedOption = False,
        rate: RateOption = 0.0,
        limit: LimitOption = 1800.0,
        out: OutOption = None,
        bag: BagOption = False,
        show_page: InspectOption = False,
        port: PortOption = PORT,
        changes: SetOption = None,
    ) -> None:
        from socialbot.graph.files import load_graph
        from socialbot.runtime.simulate import Run

        _show(
            title,
            Run(load_graph(name), runner, composed, rate, limit),
            changes,
            out,
            bag,
            context if show_page else None,
            port,
        )


_demo_of("cleaner", "The cleaner", "A robot cleans rooms, and recharges when its battery runs low.")
_demo_of("cleaner-sweeper", "Cleaner and sweeper", "A robot cleans what another one has swept, which it asks to.")


def run(
    context: typer.Context,
    graph: Annotated[
        str, typer.Argument(help="A graph that comes with socialbot, or a graph file.", autocompletion=graph_names)
    ],
    runner: RunnerOption = "inline",
    composed: ComposedOption = False,
    rate: RateOption = 0.0,
    limit: LimitOption = 1800.0,
    out: OutOption = None,
    bag: BagOption = False,
    show_page: InspectOption = False,
    port: PortOption = PORT,
    changes: SetOption = None,
) -> None:
    """Run agents and their world until nobody wants anything more, or there is nothing more to see.

    Time is simulated. Exit codes beside the usual ones: 10 not all that was wanted was reached.
    """
    from socialbot.graph.files import load_graph
    from socialbot.runtime.simulate import Run

    loaded = load_graph(graph)
    _show(
        loaded.name.capitalize(),
        Run(loaded, runner, composed, rate, limit),
        changes,
        out,
        bag,
        context if show_page else None,
        port,
    )


def _show(
    title: str,
    what: Run,
    changes: list[str] | None,
    out: Path | None,
    bag: bool,
    browser: typer.Context | None,
    port: int,
) -> None:
    from socialbot.agents.hospital.result import ward_in
    from socialbot.agents.hospital.terminal import HospitalTerminal
    from socialbot.cli.main import new_run_folder, report_faults, with_changes
    from socialbot.core.messages import Message
    from socialbot.runs.record import RunRecord
    from socialbot.runs.report import RunReport
    from socialbot.runtime.simulate import STOPPED, results_of
    from socialbot.runtime.simulate import run as carry_out

    what = replace(what, graph=with_changes(what.graph, changes or []))
    report = RunReport(what.graph)
    folder = out or new_run_folder()
    console = Console(highlight=False)
    logging.getLogger("socialbot").setLevel(logging.ERROR)  # what fails is told as it happens
    ward = ward_in(what.graph)
    shown = HospitalTerminal(console, ward) if ward is not None else None
    with RunRecord(folder) as record, _display(console, what, report) as display:

        def observe(topic: str, message: Message) -> None:
            record.observe(topic, message)
            report.observe(topic, message)
            display.show(topic, message)
            if shown is not None:
                shown.show(message)

        record.describe(what.graph)
        if browser is not None:
            browser.with_resource(watched(record, what.graph, console, port, over_ros=what.runner == "ros"))
        ran = carry_out(what, folder, observe, bag=folder / "bag" if bag else None)
    summary = report.summary()
    results = results_of(what, ran, summary.results())
    record.write_results(results)
    page = report.write(folder, title)
    if shown is not None:
        console.print()
        shown.finish()
    elif report.deliberates:
        console.print()
        _tell(console, summary)
    report_faults(console, results)
    console.print(f"\n{ran.seconds:.1f} s, in {ran.wall_s:.1f} s of real time; {ran.ended}")
    console.print(f"The record of this run: {folder}; its page: {page}", soft_wrap=True, markup=False)
    if report.deliberates and not summary.reached and ran.ended != STOPPED:
        raise typer.Exit(NOT_REACHED)


def _display(console: Console, what: Run, report: RunReport) -> Display:
    """Return the terminal display of the run."""
    from socialbot.core.clock import SECOND, nanoseconds
    from socialbot.runs.console import Display

    if report.deliberates:
        return Display(console, what.graph.without_sources())
    return Display(console, start=SECOND, until=SECOND + nanoseconds(what.limit_s))


def _tell(console: Console, summary: Summary) -> None:
    """The run in a few tables and lines."""
    story = summary.story
    table = Table("agent", title_justify="left", box=None, padding=(0, 2, 0, 0), header_style="dim")
    for heading in ("plans", "given up", "steps", "requests"):
        table.add_column(heading, justify="right")
    for agent, counts in summary.results()["agents"].items():
        table.add_row(agent, *(str(counts[key]) for key in ("plans", "given_up", "steps", "requests")))
    console.print(table)
    console.print()
    for desire in story.aims:
        planned_s, took_s = story.makespans_s(desire)
        planned = "" if planned_s is None else f", planned {planned_s:.1f} s"
        how = f"{desire.how or 'still wanted'}{f' after {took_s:.1f} s' if took_s is not None else ''}"
        reason = f": {desire.reason}" if desire.reason else ""
        console.print(f"{desire.agent}: {desire.name} {how}{planned}{reason}", soft_wrap=True, markup=False)
    holders: dict[str, list[str]] = {}
    for box, holder in summary.world.get("boxes", {}).items():
        holders.setdefault(holder, []).append(box)
    for holder in sorted(holders):
        console.print(f"{holder}: {', '.join(sorted(holders[holder]))}", soft_wrap=True, markup=False)
