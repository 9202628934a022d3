"""``socialbot inspect``: show a run in the browser; also the option ``--inspect`` of other commands."""

from __future__ import annotations

import time
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import PORT, MachineOption, PortOption, expect_effect, join, run_folders
from socialbot.cli._runs import print_problems
from socialbot.core.paths import user_folder, writing
from socialbot.core.process import Ending

if TYPE_CHECKING:
    from socialbot.graph.node import Graph
    from socialbot.runs.record import RunTrace
    from socialbot.runs.run import CommandSender, ImageSource, LiveRun
    from socialbot.runs.serving import Serving


PANEL = "Look into a run"
EXAMPLES = (
    "socialbot inspect",
    "socialbot inspect runs/waldo --open",
)
HostOption = Annotated[str, typer.Option(help="Address to serve on; other than loopback, it needs a token.")]
TokenOption = Annotated[
    str | None,
    typer.Option(
        help="Token that opens the page; default: SOCIALBOT_TOKEN, which other users do not see.", show_default=False
    ),
]
POLL_S = 0.1

INLINE = "the inline runner takes no requests from people: use --runner ros"


def inspect(
    context: typer.Context,
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="RUN|FILE|GRAPH",
            help="Folder of a run, or file of a running deployment or graph; default: the newest in runs/.",
            autocompletion=run_folders,
        ),
    ] = None,
    machine: MachineOption = None,
    port: PortOption = PORT,
    host: HostOption = "127.0.0.1",
    token: TokenOption = None,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Show a run in the browser until Ctrl-C: percepts, beliefs, goals, actions and their reasons."""
    from socialbot.runs.report import recorded
    from socialbot.runs.serving import Address, serving, token_given

    with ExitStack() as stack:
        if what is not None and not Path(what).is_dir():
            run, commands = stack.enter_context(attached(what, machine))
            title = f"{run.title}, live"
        else:
            expect_effect(context, ("machine",), "for a recorded run")
            run, commands = stack.enter_context(recorded(None if what is None else Path(what))), None
            print_problems(run)
            title = str(run.folder)
        served = stack.enter_context(serving(run, Address(host, port, token_given(token)), commands))
        announce(Console(), served, title)
        if show:
            stack.enter_context(opened(served.url))
        wait_for_signal()


@contextmanager
def attached(file: str, machine: str | None) -> Iterator[tuple[LiveRun, CommandSender]]:
    """Observe the running graph of ``file``; yield its live run and the command client."""
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.core.clock import WallClock
    from socialbot.runs.record import with_event_log
    from socialbot.runs.run import LiveRun
    from socialbot.runtime.run import observed_topics

    graph, names = join(file, machine)
    clock = WallClock()
    with client_node(graph) as (images, commands):
        live = LiveRun(graph, images)

        def note(name: str, values: dict[str, str]) -> None:
            if name in names:
                live.note_node(clock.now(), name, values)

        with observe_graph(observed_topics(graph), with_event_log(graph, live.observe), note, graph.wire):
            yield live, commands


@contextmanager
def client_node(graph: Graph) -> Iterator[tuple[ImageSource | None, CommandSender]]:
    """Run a ROS node beside ``graph`` for camera images and requests to agents."""
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.inspection import CommandClient, LiveImages, live_image_topic

    with spinning_node("inspector") as ros:
        topic = live_image_topic(graph)
        yield None if topic is None else LiveImages(ros, *topic), CommandClient(ros, graph)


@contextmanager
def watched(
    record: RunTrace,
    graph: Graph,
    console: Console,
    port: int,
    *,
    over_ros: bool,
    bag: tuple[Path, str] | None = None,
    images: ImageSource | None = None,
    stays: bool = True,
) -> Iterator[None]:
    """Serve the run of ``record``; if it ``stays``, serve the record afterwards until Ctrl-C.

    Images come from ``images``, from a topic of a ``bag``, or from the camera of a graph over ROS.
    """
    from socialbot.runs.bag_images import pictures_of
    from socialbot.runs.report import recorded
    from socialbot.runs.run import LiveRun, NoCommands
    from socialbot.runs.serving import Address, serving, token_given

    with ExitStack() as stack:
        commands: CommandSender = NoCommands(INLINE)
        if over_ros:
            topic_images, commands = stack.enter_context(client_node(graph))
            images = images or topic_images
        if bag is not None:
            images = stack.enter_context(pictures_of(bag[0], [bag[1]]))
        live = LiveRun(graph, images)
        served = stack.enter_context(serving(live, Address(port=port, token=token_given(None)), commands))
        record.add_listener(live)
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
            wait_for_signal()
        if left is not None:
            raise left


def announce(console: Console, served: Serving, what: str) -> None:
    """Print the address of the page."""
    console.print_plain(f"{what}: Ctrl-C ends it")
    console.print_address("Inspector", served.url)


@contextmanager
def opened(url: str) -> Iterator[None]:
    """Open ``url`` in the browser, by a file that only this user may read if it holds a token.

    Other users see the arguments of a browser. The file is in the home folder, as confined browsers read none in /tmp.
    """
    if not urlsplit(url).query:
        typer.launch(url)
        yield
        return
    folder = user_folder("HOME", "")
    with ExitStack() as stack:
        with writing(folder):
            page = stack.enter_context(NamedTemporaryFile("w", prefix="socialbot-", suffix=".html", dir=folder))
        page.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={url}">')
        page.flush()
        webbrowser.open(Path(page.name).resolve().as_uri())
        yield


def wait_for_signal() -> None:
    """Wait for SIGINT or SIGTERM."""
    with Ending().on_signals() as ending:
        while not ending.asked:
            time.sleep(POLL_S)
