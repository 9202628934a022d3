"""The ``socialbot`` command line. User errors print one message and set an exit code (`socialbot.core.errors`)."""

from __future__ import annotations

import logging
import sys
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from typer.core import TyperGroup

from socialbot import __version__
from socialbot.bridge.environment import split_ros_args
from socialbot.cli.completion import graph_names, node_names
from socialbot.cli.inspect import PORT, InspectOption, PortOption, watched
from socialbot.core.errors import ParameterError, SocialbotError

if TYPE_CHECKING:
    from socialbot.core.messages import Message
    from socialbot.graph.node import Graph

app = typer.Typer(
    name="socialbot",
    help="A robot that notices people and acts without being asked.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

GraphOption = Annotated[
    str,
    typer.Option("--graph", help="A graph that comes with socialbot, or a graph file.", autocompletion=graph_names),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NODE.PARAMETER=VALUE",
        help="Change a parameter; may be repeated. wire=typed: messages as socialbot_msgs.",
    ),
]
ComposedOption = Annotated[bool, typer.Option("--composed", help="All nodes in one process.")]
KeepOption = Annotated[float, typer.Option(min=1.0, help="MB of the record that are kept: of a long run the newest.")]
ParentOption = Annotated[int | None, typer.Option(hidden=True, help="End when this process has ended.")]


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """A robot that notices people and acts without being asked."""
    if version:
        typer.echo(f"socialbot {__version__}")
        raise typer.Exit


@app.command()
def replay(
    context: typer.Context,
    bag: Annotated[Path, typer.Argument(help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag.")],
    graph: Annotated[
        str | None,
        typer.Option(
            help="A graph that comes with socialbot, or a file; default: the bag's own, or waldo.",
            autocompletion=graph_names,
        ),
    ] = None,
    runner: Annotated[
        Literal["ros", "inline"], typer.Option(help="ros: real nodes over DDS; inline: one thread, simulated time.")
    ] = "ros",
    composed: ComposedOption = False,
    image_topic: Annotated[str | None, typer.Option(help="The pictures to use, when the bag has several.")] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="Speed of a ros replay; 1 is as recorded.")] = 1.0,
    pace: Annotated[bool, typer.Option(help="Wait for slow nodes instead of skipping frames (ros).")] = True,
    truth: Annotated[Path | None, typer.Option(help="Ground truth; default: BAG.truth.json if it exists.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the record of the run; default: runs/TIME.")] = None,
    video: Annotated[bool, typer.Option(help="Write the annotated video.")] = True,
    show_page: InspectOption = False,
    port: PortOption = PORT,
    changes: SetOption = None,
) -> None:
    """Replay a bag through a graph; show, record and score what happens."""
    from socialbot.bags.reader import open_bag
    from socialbot.bags.topic_mapping import takes_pictures
    from socialbot.core.progress import bar
    from socialbot.graph.files import load_graph
    from socialbot.runs.console import Display
    from socialbot.runs.record import RunRecord
    from socialbot.runs.report import RunReport
    from socialbot.runs.video import write_video
    from socialbot.runtime.replay import Replay, find_truth, graph_of
    from socialbot.runtime.replay import replay as run_replay

    console = Console(highlight=False)
    whole = with_changes(load_graph(graph) if graph else graph_of(bag), changes or [])
    sees = takes_pictures(whole.without_sources())
    report, title = RunReport(whole), f"{whole.name.capitalize()}: replay of {bag}"
    with open_bag(bag) as opened:
        topics = [topic.name for topic in opened.image_topics] if sees else []
        chosen = image_topic or _ask_image_topic(topics)
        plan = Replay(
            bag=opened,
            graph=whole,
            runner=runner,
            composed=composed,
            image_topic=chosen,
            rate=rate,
            paced=pace,
            truth=truth,
        )
        topic = opened.choose_image_topic(chosen).name if sees else None
        truth_of_all = find_truth(plan)
        folder = out or new_run_folder()
        with RunRecord(folder) as record:
            if show_page:
                seen = None if topic is None else (bag, topic)
                context.with_resource(watched(record, whole, console, port, over_ros=runner == "ros", bag=seen))
            with Display(console, whole.without_sources(), start=opened.start, until=opened.end) as display:

                def show(topic: str, message: Message) -> None:
                    report.observe(topic, message)
                    display.show(topic, message)

                try:
                    outcome = run_replay(plan, record, show)
                except SocialbotError:
                    report.write(folder, title)
                    raise
            if video and topic is not None and record.detections:
                with bar("writing annotated.mp4", "pictures", opened.topic(topic).count) as advance:
                    write_video(opened, topic, record, truth_of_all, folder / "annotated.mp4", advance)
    if outcome.scores is not None:
        console.print(scores_table(outcome.scores))
    if outcome.decisions is not None:
        console.print(outcome.decisions.told, soft_wrap=True, markup=False)
    report_faults(console, outcome.results)
    page = report.write(folder, title)
    console.print(f"The record of this run: {folder}; its page: {page}", soft_wrap=True, markup=False)
    outcome.check()


@app.command()
def up(
    context: typer.Context,
    graph: Annotated[
        str,
        typer.Argument(
            help="A graph that comes with socialbot, a graph file or a deployment file.", autocompletion=graph_names
        ),
    ] = "waldo",
    machine: Annotated[str | None, typer.Option(help="Of a deployment; default: the one this is.")] = None,
    composed: ComposedOption = False,
    camera: Annotated[str | None, typer.Option(help="Device, video or folder: sets camera.source.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the record of the run; default: runs/TIME.")] = None,
    minds: Annotated[Path | None, typer.Option(help="Folder of agents' minds, to go on with those in it.")] = None,
    keep: KeepOption = 200.0,
    show_page: InspectOption = False,
    port: PortOption = PORT,
    changes: SetOption = None,
) -> None:
    """Bring up a graph, or one machine's nodes of a deployment, on live input, until Ctrl-C."""
    from socialbot.cli.deploy import up_machine
    from socialbot.graph.files import load_graph
    from socialbot.runs.record import RunTrace, room_of
    from socialbot.runtime.deployment import is_deployment
    from socialbot.runtime.live import run_live

    changes = ([f"camera.source={camera}"] if camera is not None else []) + (changes or [])
    folder = out or new_run_folder()
    if is_deployment(graph):
        if composed:
            raise ParameterError("nodes of a deployment have a process each", where="--composed", remedy="leave it out")
        up_machine(graph, machine, changes, folder, minds, context if show_page else None, port, room=room_of(keep))
        return
    if machine is not None:
        raise ParameterError(f"{graph} names no machines", where="--machine", remedy="give a deployment file")
    whole = with_changes(load_graph(graph), changes)
    console = Console(highlight=False)
    console.print(f"{whole.name}: Ctrl-C ends it; its record: {folder}", soft_wrap=True, markup=False)
    with RunTrace(folder, room=room_of(keep)) as record:
        if show_page:
            context.with_resource(watched(record, whole, console, port, over_ros=True, stays=False))
        run_live(whole, record, console, composed=composed, minds=minds)


@app.command()
def node(
    context: typer.Context,
    names: Annotated[list[str], typer.Argument(help="The nodes to run in this process.", autocompletion=node_names)],
    graph: GraphOption = "waldo",
    sim_time: Annotated[bool, typer.Option("--sim-time", help="Take the time from /clock.")] = False,
    parent: ParentOption = None,
    changes: SetOption = None,
) -> None:
    """Run single nodes of a graph; they join the running graph, and leave it on Ctrl-C.

    Takes the arguments of ROS, too: --ros-args -p NAME:=VALUE --params-file FILE.
    """
    from socialbot.bridge.process import run_nodes
    from socialbot.graph.files import load_graph
    from socialbot.runtime.supervisor_channel import own_channel

    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", handlers=[])
    graph_with_changes = with_changes(load_graph(graph), changes or [])
    run_nodes(
        graph_with_changes, names, sim_time=sim_time, parent=parent, ros_args=context.obj, supervisor=own_channel()
    )


@app.command(name="graph")
def show_graph(
    graph: Annotated[
        str, typer.Argument(help="A graph that comes with socialbot, or a file.", autocompletion=graph_names)
    ],
) -> None:
    """Check a graph and show its nodes, topics and parameters."""
    from socialbot.graph.files import load_graph

    loaded = load_graph(graph)
    console = Console(highlight=False)
    table = Table("node", "input", "output", title=loaded.name, title_justify="left", show_lines=True)
    for placement in loaded.placements:
        table.add_row(
            placement.name,
            "\n".join(topic for topic, _ in placement.subscriptions),
            "\n".join(topic for topic, _ in placement.publications),
        )
    console.print(table)
    for placement in loaded.placements:
        for name, parameter in placement.type.parameters().items():
            value = placement.parameters.get(name, parameter.default)
            console.print(f"{placement.name}.{name} = {value!r}", style="bold", soft_wrap=True)
            console.print(f"    {parameter.doc}", style="dim", soft_wrap=True)


def main() -> None:
    """The entry point of the ``socialbot`` command."""
    arguments, ros_args = sys.argv[1:], []
    if arguments[:1] in (["node"], ["translate"]):
        arguments, ros_args = split_ros_args(arguments)
    try:
        command()(arguments, obj=ros_args)
    except SocialbotError as error:
        Console(stderr=True, highlight=False).print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True)
        sys.exit(error.exit_code)


@cache
def command() -> TyperGroup:
    """The whole command line, made once."""
    _add_commands()
    return cast(TyperGroup, typer.main.get_command(app))


def _add_commands() -> None:
    from socialbot.cli.agent import agent
    from socialbot.cli.asl import asl
    from socialbot.cli.bag import bag, play
    from socialbot.cli.deploy import down, systemd
    from socialbot.cli.doctor import doctor
    from socialbot.cli.evaluate import evaluate
    from socialbot.cli.export import export
    from socialbot.cli.inspect import inspect, translate
    from socialbot.cli.key import key
    from socialbot.cli.new import new
    from socialbot.cli.plan import plan
    from socialbot.cli.simulate import demo, run
    from socialbot.cli.status import status
    from socialbot.cli.topic import topic
    from socialbot.cli.why import diff, report, why

    bag.command()(play)
    app.add_typer(bag, name="bag")
    app.add_typer(topic, name="topic")
    app.add_typer(key, name="key")
    app.add_typer(asl, name="asl")
    app.add_typer(agent, name="agent")
    app.add_typer(demo, name="demo")
    app.command()(evaluate)
    app.command()(export)
    app.command()(new)
    app.command()(plan)
    app.command()(run)
    app.command()(status)
    app.command()(down)
    app.command()(inspect)
    app.command()(translate)
    app.command()(why)
    app.command()(diff)
    app.command()(report)
    app.command()(systemd)
    app.command()(doctor)


def with_changes(graph: Graph, changes: list[str]) -> Graph:
    """``graph`` with ``NODE.PARAMETER=VALUE`` applied, and ``wire=FORM``; files that the user names may be anywhere.

    Raises ParameterError or GraphError for what does not fit.
    """
    from dataclasses import replace

    from socialbot.core import paths
    from socialbot.core.errors import suggestion

    parameters: dict[str, dict[str, object]] = {}
    for change in changes:
        target, equals, text = change.partition("=")
        node_name, dot, name = target.partition(".")
        if target == "wire":
            graph = replace(graph, wire=text)
            continue
        if not equals or not dot:
            raise ParameterError(f"cannot read {change!r}", where="--set", remedy="write NODE.PARAMETER=VALUE")
        declared = graph.placement(node_name).type.parameters()
        if name not in declared:
            raise ParameterError(f"no parameter {name!r}", where=node_name, remedy=suggestion(name, declared))
        parameters.setdefault(node_name, {})[name] = _parse(text, type(declared[name].default), target)
        if "/" in text:
            paths.allow(Path(text))
    return graph.with_parameters(parameters)


def _parse(text: str, kind: type, where: str) -> Any:
    try:
        if kind is bool:
            return {"true": True, "false": False}[text.lower()]
        return kind(text)
    except (ValueError, KeyError) as error:
        raise ParameterError(f"{text!r} is not of type {kind.__name__}", where=where) from error


def new_run_folder() -> Path:
    """A folder below runs/ named by the time of day."""
    return Path("runs") / datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")


def _ask_image_topic(names: list[str]) -> str | None:
    """Asks which of several image topics to use, where there is somebody to ask."""
    if len(names) < 2 or not sys.stdin.isatty():
        return None
    for number, name in enumerate(names, 1):
        typer.echo(f"  {number}  {name}")
    answer = typer.prompt("Which pictures", type=int, default=1)
    return names[answer - 1] if 1 <= answer <= len(names) else None


def scores_table(scores: Any) -> Table:
    """Precision, recall and F1 by distance band."""
    table = Table(title=f"Detections of {scores.frames} frames at IoU 0.5", title_justify="left")
    for heading in ("distance", "found", "false", "missed", "precision", "recall", "F1"):
        table.add_column(heading, justify="left" if heading == "distance" else "right")
    for name, band in scores.bands.items():
        if band.tp or band.fp or band.fn or "-" in name:
            rates = ["-" if rate is None else f"{rate:.3f}" for rate in (band.precision, band.recall, band.f1)]
            table.add_row(name, str(band.tp), str(band.fp), str(band.fn), *rates)
    return table


def report_faults(console: Console, results: dict[str, Any]) -> None:
    """Says what was skipped and what failed."""
    for topic, skipped in results.get("bag", {"skipped": {}})["skipped"].items():
        console.print(
            f"[yellow]warning[/] {topic}: {skipped['count']} damaged messages skipped: {escape(skipped['first'])}"
        )
    for name, fate in results["nodes"].items():
        if fate["failures"]:
            text = f"{name}: failed {fate['failures']} of {fate['calls']} times; first: {fate['first_failure']}"
            console.print(f"[yellow]warning[/] {escape(text)}", soft_wrap=True)
