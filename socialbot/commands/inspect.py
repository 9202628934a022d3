"""``socialbot inspect``, and ``--inspect`` of what runs graphs: a run in the browser; see docs/inspect.md."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from socialbot.completion import run_folders
from socialbot.ending import Ending

if TYPE_CHECKING:
    from socialbot.graph import Graph
    from socialbot.inspect.commands import Office
    from socialbot.inspect.live_run import LiveRun
    from socialbot.inspect.run import Pictures
    from socialbot.inspect.run_folder import RecordedRun
    from socialbot.inspect.serving import Serving
    from socialbot.run_record import RunTrace

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
    from socialbot.inspect.serving import Address, serving, token_given
    from socialbot.recorded_run import recorded

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
    from socialbot.bridge.observing import observing
    from socialbot.clock import WallClock
    from socialbot.inspect.live_run import LiveRun
    from socialbot.live import topics_of
    from socialbot.report.telling import telling

    graph = graph_of(file, machine)
    clock, names = WallClock(), {placement.name for placement in graph.placements}
    with presence(graph) as (pictures, office):
        live = LiveRun(graph, pictures)

        def note(name: str, values: dict[str, str]) -> None:
            if name in names:
                live.note_node(clock.now(), name, values)

        with observing(topics_of(graph, None), telling(graph, live.observe), note, graph.wire):
            yield live, office


def graph_of(file: str, machine: str | None) -> Graph:
    """The graph that a file describes; this process becomes part of the deployment, where it is one."""
    from socialbot.commands.status import join
    from socialbot.deployment.deployment_file import is_deployment, load_deployment
    from socialbot.graph_file import load_graph

    join(file, machine)
    return load_deployment(Path(file)).graph if is_deployment(file) else load_graph(file)


@contextmanager
def presence(graph: Graph) -> Iterator[tuple[Pictures | None, Office]]:
    """A node of one's own beside ``graph``: it sees what the camera sees, and takes requests to agents."""
    from socialbot.bridge.live_pictures import LivePictures, picture_topic
    from socialbot.bridge.office import RosOffice
    from socialbot.bridge.session import spinning_node

    with spinning_node("inspector") as ros:
        topic = picture_topic(graph)
        yield None if topic is None else LivePictures(ros, *topic), RosOffice(ros, graph.wire)


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
    from socialbot.bridge.bag_pictures import pictures_of
    from socialbot.inspect.commands import Shut
    from socialbot.inspect.live_run import LiveRun
    from socialbot.inspect.serving import Address, serving, token_given
    from socialbot.recorded_run import recorded

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
