"""``socialbot inspect``, ``--inspect``, and ``socialbot translate``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from socialbot.cli.completion import graph_names, run_folders
from socialbot.core.process import Ending

if TYPE_CHECKING:
    from socialbot.graph.node import Graph
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.record import RunTrace
    from socialbot.runs.run import Office, Pictures
    from socialbot.runs.serving import Serving
    from socialbot.runtime.live_run import LiveRun


PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Of the inspector; 0: any that is free.")]
HostOption = Annotated[str, typer.Option(help="The address to serve on; others than this machine's need a token.")]
TokenOption = Annotated[
    str | None, typer.Option(help="What who opens the page has to bring; default: SOCIALBOT_TOKEN.", show_default=False)
]
InspectOption = Annotated[bool, typer.Option("--inspect", help="Show it in the browser, while it runs and after.")]

PORT = 8765
LOOK_AGAIN_S = 0.1

INLINE = "the inline runner takes no requests of people: run it with --runner ros"


def inspect(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[RUN|FILE|GRAPH]",
            help="The folder of a run, or the file of a deployment or graph that runs; default: the newest in runs/.",
            autocompletion=run_folders,
        ),
    ] = None,
    machine: Annotated[str | None, typer.Option(help="Of a deployment: the one this is.")] = None,
    port: PortOption = PORT,
    host: HostOption = "127.0.0.1",
    token: TokenOption = None,
    show: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
) -> None:
    """Show a run in the browser until Ctrl-C: what was seen, believed, wanted and done, and why."""
    from socialbot.runs.report import recorded
    from socialbot.runs.serving import Address, serving, token_given

    address = Address(host, port, token_given(token))
    console = Console(highlight=False)
    if what is not None and not Path(what).is_dir():
        with attached(what, machine) as (live, office), serving(live, address, office) as served:
            announce(console, served, f"{live.title} as it runs", show=show)
            until_told()
        return
    with recorded(None if what is None else Path(what)) as run, serving(run, address) as served:
        tell_damage(run)
        announce(console, served, str(run.folder), show=show)
        until_told()


@contextmanager
def attached(file: str, machine: str | None) -> Iterator[tuple[LiveRun, Office]]:
    """The graph that ``file`` describes, which runs somewhere, as it is heard from here; and who takes requests."""
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.core.clock import WallClock
    from socialbot.runs.record import with_event_log
    from socialbot.runtime.live import topics_of
    from socialbot.runtime.live_run import LiveRun

    graph = graph_of(file, machine)
    clock, names = WallClock(), {placement.name for placement in graph.placements}
    with presence(graph) as (pictures, office):
        live = LiveRun(graph, pictures)

        def note(name: str, values: dict[str, str]) -> None:
            if name in names:
                live.note_node(clock.now(), name, values)

        with observe_graph(topics_of(graph, None), with_event_log(graph, live.observe), note, graph.wire):
            yield live, office


def graph_of(file: str, machine: str | None) -> Graph:
    """The graph that a file describes; this process becomes part of the deployment, where it is one."""
    from socialbot.cli.status import join
    from socialbot.graph.files import load_graph
    from socialbot.runtime.deployment import is_deployment, load_deployment

    join(file, machine)
    return load_deployment(Path(file)).graph if is_deployment(file) else load_graph(file)


@contextmanager
def presence(graph: Graph) -> Iterator[tuple[Pictures | None, Office]]:
    """A node of one's own beside ``graph``: it sees what the camera sees, and takes requests to agents."""
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.inspection import CommandClient, LiveImages, live_image_topic

    with spinning_node("inspector") as ros:
        topic = live_image_topic(graph)
        yield None if topic is None else LiveImages(ros, *topic), CommandClient(ros, graph.wire)


@contextmanager
def watched(
    record: RunTrace,
    graph: Graph,
    console: Console,
    port: int,
    *,
    over_ros: bool,
    bag: tuple[Path, str] | None = None,
    stays: bool = True,
) -> Iterator[None]:
    """Serves the run that ``record`` is being made of, and when that ``stays``, what was recorded until Ctrl-C.

    The pictures are those of a topic of a ``bag``, or of the camera in a graph over ROS.
    """
    from socialbot.runs.bag_images import pictures_of
    from socialbot.runs.report import recorded
    from socialbot.runs.run import Shut
    from socialbot.runs.serving import Address, serving, token_given
    from socialbot.runtime.live_run import LiveRun

    with ExitStack() as stack:
        pictures: Pictures | None = None
        office: Office = Shut(INLINE)
        if over_ros:
            pictures, office = stack.enter_context(presence(graph))
        if bag is not None:
            pictures = stack.enter_context(pictures_of(bag[0], [bag[1]]))
        live = LiveRun(graph, pictures)
        served = stack.enter_context(serving(live, Address(port=port, token=token_given(None)), office))
        record.tell(live)
        announce(console, served, graph.name)
        left: typer.Exit | None = None
        try:
            yield
        except typer.Exit as error:
            left = error
        if not stays:
            return
        with recorded(record.folder) as run:
            served.show(run)
            announce(console, served, f"{run.folder}: it has ended")
            until_told()
        if left is not None:
            raise left


def announce(console: Console, served: Serving, what: str, *, show: bool = False) -> None:
    """Says where the page is, and with ``show`` opens it."""
    console.print(f"{what}: Ctrl-C ends it", soft_wrap=True, markup=False)
    console.print(f"Inspector: [bold]{served.url}[/]", soft_wrap=True)
    if show:
        typer.launch(served.url)


def tell_damage(run: RecordedRun) -> None:
    """Says on stderr what of a run could not be read."""
    for damage in run.damage:
        Console(stderr=True, highlight=False).print(f"warning: {damage}", soft_wrap=True, markup=False)


def until_told() -> None:
    """Waits for SIGINT or SIGTERM."""
    with Ending().on_signals() as ending:
        while not ending.asked:
            time.sleep(LOOK_AGAIN_S)


def translate(
    context: typer.Context,
    file: Annotated[
        str,
        typer.Argument(metavar="FILE|GRAPH", help="The graph or the deployment that runs.", autocompletion=graph_names),
    ],
    machine: Annotated[str | None, typer.Option(help="Of a deployment: the one this is.")] = None,
    head: Annotated[
        bool, typer.Option("--head", help="Also say where the head is, which on a robot its drivers do.")
    ] = False,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="What the graph was started with; may be repeated."),
    ] = None,
) -> None:
    """Say again, in the types of RViz, vision_msgs and ROS4HRI, what a running graph sees and does; until Ctrl-C.

    Takes the arguments of ROS, too: --ros-args -r /tf:=/robot/tf -p use_sim_time:=true.
    """
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.bridge.translator import Translator, translated_topics
    from socialbot.cli.main import with_changes

    console = Console(highlight=False)
    graph = with_changes(graph_of(file, machine), changes or [])
    with spinning_node("translator", context.obj) as ros:
        translator = Translator(ros, graph, head=head)
        for topic in translator.topics:
            console.print(topic, markup=False, soft_wrap=True)
        for package in sorted(translator.missing):
            console.print(
                f"without {package}, which is not installed, or whose libraries are not found",
                style="yellow",
                soft_wrap=True,
            )
        with observe_graph(translated_topics(graph), translator.take, lambda *_: None, graph.wire):
            until_told()
