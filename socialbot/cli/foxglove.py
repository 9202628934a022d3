"""``socialbot foxglove``: play a recorded run to Foxglove or Lichtblick."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli import _options as options
from socialbot.cli._console import Console

if TYPE_CHECKING:
    from socialbot.graph.node import Graph
    from socialbot.runs.record import RunTrace
    from socialbot.runs.serving import Address

PANEL = "Look into a run"
EXAMPLES = ("socialbot foxglove runs/waldo", "socialbot foxglove runs/waldo --rate 4 --loop")
PORT = 8766  # that of the inspector is 8765


def foxglove(
    run: options.RunArgument = None,
    rate: Annotated[float, typer.Option(min=0.0, max=100.0, help="Speed; 0: as fast as possible.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    host: Annotated[str, typer.Option(help="Address to listen at; all but loopback need a token.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0: any free port.")] = PORT,
    token: Annotated[
        str | None,
        typer.Option(help="Token that viewers give; default: SOCIALBOT_TOKEN, which other users do not see."),
    ] = None,
) -> None:
    """Play a recorded run to Foxglove or Lichtblick over a WebSocket, until Ctrl-C."""
    from socialbot.cli._runs import images_of, opened_run
    from socialbot.cli.inspect import wait_for_signal
    from socialbot.core.process import Ending
    from socialbot.runs.foxglove_live import foxglove_server, play_to_foxglove
    from socialbot.runs.serving import Address, token_given

    recorded, console = opened_run(run), Console(soft_wrap=True)
    address = Address(host, port, token_given(token))
    with ExitStack() as stack:
        bag = stack.enter_context(images_of(recorded))
        server, url = stack.enter_context(foxglove_server(recorded.title, recorded.graph, address))
        console.print(f"{recorded.title}: Ctrl-C ends it{'' if bag is not None else '; without images'}", markup=False)
        console.print_address("Foxglove: open connection, WebSocket", url)
        stopped = threading.Event()
        player = threading.Thread(
            target=lambda: play_to_foxglove(server, recorded, bag, rate, stopped, loop=loop), name="player", daemon=True
        )
        with Ending().on_signals() as ending:
            player.start()
            while player.is_alive() and not ending.asked:
                player.join(0.2)
            stopped.set()
            player.join()
        if not ending.asked:
            console.print("the run is over")
            wait_for_signal()


@contextmanager
def shown_in_foxglove(record: RunTrace, graph: Graph, console: Console, address: Address) -> Iterator[None]:
    """Serve the live run of ``record`` to Foxglove, with images of its camera, and parameters that can be set."""
    from socialbot.bridge.node_services import set_parameter
    from socialbot.cli.inspect import client_node
    from socialbot.runs.foxglove_live import LiveFeed, foxglove_server

    with ExitStack() as stack:
        images, _ = stack.enter_context(client_node(graph))
        server, url = stack.enter_context(foxglove_server(graph.name, graph, address, set_parameter))
        record.add_listener(stack.enter_context(LiveFeed(server, graph, images)))
        console.print_address("Foxglove: open connection, WebSocket", url)
        yield
