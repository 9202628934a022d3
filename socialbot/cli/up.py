"""``socialbot up``: bring up a graph or one machine of a deployment on live input."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from socialbot.cli import _options as options
from socialbot.cli._console import Console
from socialbot.core.errors import ParameterError

FOXGLOVE_PORT = 8766  # that of the inspector is 8765
PANEL = "Run a graph"
EXAMPLES = (
    "socialbot up --inspect",
    "socialbot up --robot reachy_mini",
    "socialbot up deploy.yaml --machine robot",
)


def up(
    context: typer.Context,
    graph: Annotated[
        str,
        typer.Argument(help="Built-in graph, graph file or deployment file.", autocompletion=options.graph_names),
    ] = "waldo",
    robot: options.RobotOption = None,
    machine: options.MachineOption = None,
    composed: options.ComposedOption = False,
    camera: Annotated[str | None, typer.Option(help="Device, video or folder: sets camera.source.")] = None,
    out: options.OutOption = None,
    minds: Annotated[Path | None, typer.Option(help="Folder of the agents' saved state, which they restore.")] = None,
    keep: Annotated[float, typer.Option(min=1.0, help="Size limit of the record in MB; keeps the newest.")] = 200.0,
    show_page: options.InspectOption = False,
    port: options.PortOption = options.PORT,
    show_foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Serve the run to Foxglove and Lichtblick on a WebSocket.")
    ] = False,
    foxglove_host: Annotated[
        str, typer.Option(help="Its address; all but loopback need SOCIALBOT_TOKEN.")
    ] = "127.0.0.1",
    foxglove_port: Annotated[int, typer.Option(min=0, max=65535, help="Its port; 0: any free port.")] = FOXGLOVE_PORT,
    changes: options.SetOption = None,
    labels: options.LabelOption = None,
    verbose: options.VerboseOption = False,
) -> None:
    """Bring up a graph, or one machine of a deployment, on live input, until Ctrl-C."""
    from socialbot.runtime.fork_server import started_early

    context.with_resource(started_early())  # beside the imports below, which take longest on a busy machine
    from socialbot.cli._runs import MAX_PAGE_BYTES, write_page
    from socialbot.cli.foxglove import shown_in_foxglove
    from socialbot.cli.inspect import watched
    from socialbot.core.process_guard import guarded
    from socialbot.graph.files import load_graph, with_changes
    from socialbot.runs.console import Display
    from socialbot.runs.record import LOGS, RunTrace, log_bytes
    from socialbot.runtime.deployment import is_deployment, load_deployment
    from socialbot.runtime.machine import LiveSource, machine_source
    from socialbot.runtime.run import new_run_folder, run

    if not show_page:
        options.expect_effect(context, ("port",), "without --inspect")
    if not show_foxglove:
        options.expect_effect(context, ("foxglove_host", "foxglove_port"), "without --foxglove")
    changes = ([f"camera.source={camera}"] if camera is not None else []) + (changes or [])
    folder, console = out or new_run_folder(), Console(soft_wrap=True, lossy=True)
    with ExitStack() as stack:
        if is_deployment(graph):
            if composed:
                what = "each node of a deployment runs in its own process"
                raise ParameterError(what, where="--composed", remedy="leave it out")
            deployment = load_deployment(Path(graph), robot=robot or "")
            machine = machine or deployment.this_machine()
            nodes = ", ".join(config.name for config in deployment.half(machine))
            whole = with_changes(deployment.graph, changes)
            source = stack.enter_context(machine_source(deployment, machine, folder / LOGS, minds))
            if verbose:
                console.print(f"{whole.name} on {machine}: {nodes or 'no node'}", markup=False)
        else:
            options.expect_no_machine(machine)
            whole, source = with_changes(load_graph(graph, robot=robot or ""), changes), LiveSource(state_folder=minds)
        for config in whole.nodes:
            if source.nodes is None or config.name in source.nodes:
                config.type.expect_available(config.parameters)
        console.print(f"{whole.name}: Ctrl-C ends it; its record: {folder}", markup=False)
        labels_of_run = options.labels_of(labels)
        trace = RunTrace(folder, max_bytes=log_bytes(keep), labels=labels_of_run, lossy=True)
        record = stack.enter_context(trace)
        try:
            with ExitStack() as served:
                served.enter_context(guarded())  # until the nodes of the page and of Foxglove have left DDS
                if show_page:
                    served.enter_context(watched(record, whole, console, port, over_ros=True, stays=False))
                if show_foxglove:
                    from socialbot.runs.serving import Address, token_given

                    address = Address(foxglove_host, foxglove_port, token_given(None))
                    served.enter_context(shown_in_foxglove(record, whole, console, address))
                display = Display(console, whole.without_sources(), details=verbose, health_of=whole)
                with display as shown:
                    run(whole, source, record, shown.show, runner="ros", composed=composed)
        finally:
            write_page(console, record, f"{whole.name.capitalize()}, live", MAX_PAGE_BYTES)
