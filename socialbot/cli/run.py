"""``socialbot run``: run agents with their simulated world, and write a page of the run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli import _options as options
from socialbot.cli._console import Console
from socialbot.graph.node import Graph

if TYPE_CHECKING:
    from socialbot.runs.story import Story

PANEL = "Run a graph"
EXAMPLES = (
    "socialbot run hospital --bag",
    "socialbot run my_graph.yaml --limit 60 --inspect",
)
NOT_REACHED = 10  # exit code: a desire or mission was not reached

RateOption = Annotated[
    float, typer.Option(min=0.0, max=1000.0, metavar="TIMES", help="Speed as a multiple of real time; 0: no limit.")
]
LimitOption = Annotated[float, typer.Option(min=1.0, metavar="SECONDS", help="Limit of simulated time.")]
RecordBagOption = Annotated[bool, typer.Option("--bag", help="Record a bag for replays, in the folder of the run.")]


def simulate(
    context: typer.Context,
    title: str,
    graph: Graph,
    runner: options.RunnerOption = "inline",
    composed: options.ComposedOption = False,
    domain: options.DomainOption = None,
    rate: RateOption = 0.0,
    limit: LimitOption = 1800.0,
    out: options.OutOption = None,
    bag: RecordBagOption = False,
    show_page: options.InspectOption = False,
    port: options.PortOption = options.PORT,
    changes: options.SetOption = None,
    labels: options.LabelOption = None,
    verbose: options.VerboseOption = False,
    bag_path: Path | None = None,
) -> None:
    """Run ``graph`` on its simulated world, show it in the terminal and write its page."""
    from socialbot.cli._runs import enter_domain, print_outcome, write_page
    from socialbot.cli.inspect import watched
    from socialbot.core.clock import SECOND, nanoseconds
    from socialbot.core.messages import Message
    from socialbot.core.registry import terminal_view_of, world_view_of
    from socialbot.graph.files import with_changes
    from socialbot.runs.bag_images import RecentPictures
    from socialbot.runs.console import Display
    from socialbot.runs.record import STOPPED, RunRecord
    from socialbot.runs.report import RunReport
    from socialbot.runtime.run import new_run_folder
    from socialbot.runtime.run import run as run_graph
    from socialbot.runtime.simulated_source import SimulatedSource, image_topics

    if not show_page:
        options.expect_effect(context, ("port",), "without --inspect")
    graph = with_changes(graph, changes or [])
    report, folder, console = RunReport(graph), out or new_run_folder(), Console()
    enter_domain(context, console, domain, runner, verbose=verbose)
    world, view = terminal_view_of(graph, console), world_view_of(graph)
    pictures = RecentPictures() if image_topics(graph) else None
    # The page shows the pictures of the bag.
    is_recorded = bag_path is not None or bag or pictures is not None
    source = SimulatedSource(rate, limit, (bag_path or folder / "bag") if is_recorded else None)
    start, end = (None, None) if report.deliberates else (SECOND, SECOND + nanoseconds(limit))
    view_of_run = Display(console, graph.without_sources(), start=start, until=end, details=verbose)
    with RunRecord(folder, labels=options.labels_of(labels)) as record, view_of_run as display:

        def observe(topic: str, message: Message) -> None:
            report.observe(topic, message)
            if pictures is not None:
                pictures.take(message)
            if view is not None:
                view.take(message)
            display.show(topic, message)
            if world is not None:
                world.show(message)

        if show_page:
            context.with_resource(watched(record, graph, console, port, over_ros=runner == "ros", images=pictures))
        result = run_graph(
            graph,
            source,
            record,
            observe,
            runner=runner,
            composed=composed,
            summarize=lambda: report.story().results(),
        )
    story = report.story()
    if world is not None:
        console.print()
        world.finish()
    elif report.deliberates:
        console.print()
        _print_summary(console, story)
        for line in view.summary(story.start, story.end) if view is not None else ():
            console.print_plain(line)
    print_outcome(console, result)
    console.print(f"\n{result.seconds:.1f} s, in {result.wall_s:.1f} s of real time; {result.ended}")
    write_page(console, record, title, report=report)
    result.check()
    if report.deliberates and not story.reached and result.ended != STOPPED:
        raise typer.Exit(NOT_REACHED)


def _loaded(graph: options.GraphArgument, robot: options.RobotOption = None) -> tuple[str, Graph]:
    """Run agents and their world in simulated time, until no agent has a desire or the world has ended.

    Exit code 10: a desire was not reached.
    """
    from socialbot.graph.files import load_graph

    loaded = load_graph(graph, robot=robot or "")
    return loaded.name.capitalize(), loaded


run = options.command_of(_loaded, ("title", "graph"), simulate, without=("bag_path",))


def _print_summary(console: Console, story: Story) -> None:
    """Print counts by agent and the outcome of each desire."""
    table = options.plain_table("agent", right=("plans", "given up", "steps", "requests"))
    for agent, counts in story.results()["agents"].items():
        table.add_row(agent, *(str(counts[key]) for key in ("plans", "given_up", "steps", "requests")))
    console.print(table)
    console.print()
    for desire in story.aims:
        planned_s, took_s = story.makespans_s(desire)
        planned = "" if planned_s is None else f", planned {planned_s:.1f} s"
        how = f"{desire.how or 'still wanted'}{f' after {took_s:.1f} s' if took_s is not None else ''}"
        reason = f": {desire.reason}" if desire.reason else ""
        console.print_plain(f"{desire.agent}: {desire.name} {how}{planned}{reason}")
