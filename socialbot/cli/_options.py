"""Shared command options and their shell completion, and what commands do with their arguments."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socialbot.core.errors import ParameterError, SocialbotError

if TYPE_CHECKING:
    from rich.table import Table

    from socialbot.graph.node import Graph

PORT = 8765
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def graph_names(incomplete: str) -> list[str]:
    """Complete a graph: names of built-in graphs, YAML files and folders."""
    from socialbot.core import registry

    names = [name for name in registry.graph_names() if name.startswith(incomplete)]
    return [*names, *paths(incomplete, (".yaml", ".yml"))]


def robot_names(incomplete: str) -> list[str]:
    """Complete a robot: names of profiles, YAML files and folders."""
    from socialbot.core import registry

    names = [name for name in sorted(registry.robot_files()) if name.startswith(incomplete)]
    return [*names, *paths(incomplete, (".yaml", ".yml"))]


def node_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete a node of the graph that ``--graph`` names; nothing if the graph is unreadable."""
    from socialbot.graph.files import load_graph

    given = set(ctx.params.get("names") or ())
    try:
        graph = load_graph(ctx.params.get("graph") or "waldo")
    except SocialbotError:
        return []
    names = (config.name for config in graph.nodes)
    return [name for name in names if name.startswith(incomplete) and name not in given]


def run_folders(incomplete: str) -> list[str]:
    """Complete a run: the folders in ``runs/``, newest first, then other folders."""
    runs = sorted(Path("runs").glob("*/trace.jsonl"), key=lambda trace: trace.stat().st_mtime_ns, reverse=True)
    names = [name for name in (str(trace.parent) for trace in runs) if name.startswith(incomplete)]
    unique: dict[str, str] = {}
    for name in (*names, *paths(incomplete, ())):
        unique.setdefault(name.rstrip("/"), name)
    return list(unique.values())


def paths(incomplete: str, suffixes: tuple[str, ...]) -> Iterator[str]:
    """Complete a path: folders, and files with one of the ``suffixes``; hidden ones after a dot only."""
    folder, _, begin = incomplete.rpartition("/")
    try:
        found = sorted(Path(f"{folder}/" if "/" in incomplete else ".").iterdir())
    except OSError:
        return
    for path in found:
        hidden = path.name.startswith(".") and not begin.startswith(".")
        if path.name.startswith(begin) and not hidden and (path.is_dir() or path.suffix in suffixes):
            name = incomplete[: len(incomplete) - len(begin)] + path.name
            yield f"{name}/" if path.is_dir() else name


def join(file: str, machine: str | None) -> tuple[Graph, dict[str, str]]:
    """Join the ROS domain of the graph or deployment in ``file``, as ``machine``, by default this one.

    Returns:
        The graph, and the machine of each node ("" without a deployment).

    Raises:
        GraphError: The file is not a valid graph or deployment.
        ParameterError: ``machine`` is given without a deployment.
    """
    from socialbot.graph.files import load_graph
    from socialbot.runtime.deployment import is_deployment, load_deployment

    if is_deployment(file):
        from socialbot.runtime.machine import enter

        deployment = load_deployment(Path(file))
        enter(deployment, machine or deployment.this_machine())
        machines = {node.name: name for name in deployment.machines for node in deployment.half(name)}
        return deployment.graph, {node.name: machines[node.name] for node in deployment.graph.nodes}
    expect_no_machine(machine)
    graph = load_graph(file)
    return graph, {node.name: "" for node in graph.nodes}


def expect_no_machine(machine: str | None) -> None:
    """Raise ParameterError if a machine is given without a deployment."""
    if machine is not None:
        raise ParameterError("only deployments have machines", where="--machine", remedy="give a deployment file")


def plain_table(*columns: str, right: Sequence[str] = ()) -> Table:
    """Return a table without lines. Columns of ``columns`` fold long texts, numbers in the columns ``right`` do not."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for heading in columns:
        table.add_column(heading, overflow="fold")
    for heading in right:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


@contextmanager
def bar(what: str, of: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar for ``what``; call the result with the number of finished items, and perhaps text and total.

    ``of`` is the name of the items, ``total`` their number, if known.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from socialbot.cli._console import Console

    console = Console(stderr=True)
    texts = TextColumn("{task.description}", markup=False), TextColumn(of, markup=False)
    columns = (texts[0], BarColumn(), MofNCompleteColumn(), texts[1], TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done, what=None, total=None: progress.update(task, completed=done, description=what, total=total)


def labels_of(texts: Sequence[str] | None) -> dict[str, str]:
    """Parse labels such as ``participant=P01``. Raises ParameterError for a text without a name or a value."""
    labels: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not (name.isidentifier() and equals and value):
            remedy = "write NAME=VALUE, such as participant=P01"
            raise ParameterError(f"{text!r} is not a label", where="--label", remedy=remedy)
        labels[name] = value
    return labels


def command_of(
    make: Callable[..., tuple[Any, ...]],
    chosen: Sequence[str],
    start: Callable[..., None],
    *,
    without: Collection[str] = (),
    **defaults: Any,
) -> Callable[..., None]:
    """Return a command that calls ``start`` with what ``make`` returns.

    Args:
        make: Its parameters are options of the command, and its docstring is the help text.
        chosen: Names of the arguments of ``start`` that it returns.
        start: Its other parameters are options of the command, too; the first one is the context.
        without: Parameters of ``start`` that are no options.
        defaults: Other default values of the parameters of ``start``.

    Raises:
        ParameterError: Both have a parameter of the same name.
    """
    own = inspect.signature(make, eval_str=True).parameters
    known = inspect.signature(start, eval_str=True).parameters
    context, *others = (each for name, each in known.items() if name not in (*chosen, *without))
    if taken := sorted(own.keys() & {each.name for each in others}):
        remedy = "rename the parameter: all demos have an option of this name"
        raise ParameterError(f"the parameter {taken[0]!r} is taken", where=make.__name__, remedy=remedy)

    def command(**given: Any) -> None:
        made = make(**{name: given.pop(name) for name in own})
        start(**dict(zip(chosen, made, strict=True)), **given)

    keywords = [
        each.replace(kind=inspect.Parameter.KEYWORD_ONLY, default=defaults.get(each.name, each.default))
        for each in (context, *own.values(), *others)
    ]
    command.__doc__ = make.__doc__
    command.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in keywords}
    return command


def many(count: int, noun: str) -> str:
    """Return a count with its noun, in the plural if needed."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def expect_effect(context: typer.Context, names: Collection[str], when: str) -> None:
    """Refuse options on the command line that change nothing.

    Args:
        names: Parameters of the command.
        when: Circumstances, such as ``without --inspect``.

    Raises:
        ParameterError: One of ``names`` is given.
    """
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name == "COMMANDLINE":
            _, without, other = when.rpartition("without ")
            remedy = f"add {other}, or leave it out" if without else "leave it out"
            raise ParameterError(f"without effect {when}", where=max(parameter.opts, key=len), remedy=remedy)


def times(count: int) -> str:
    """Return how often something happened."""
    return "once" if count == 1 else f"{count} times"


GraphArgument = Annotated[str, typer.Argument(help="Built-in graph or graph file.", autocompletion=graph_names)]
CameraInfoOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Calibration of the camera, YAML of camera_calibration.")
]
BagGraphOption = Annotated[
    str | None,
    typer.Option(help="Built-in graph or graph file; default: the bag's own, or waldo.", autocompletion=graph_names),
]
RunArgument = Annotated[
    Path | None, typer.Argument(help="Folder of a run; default: the newest in runs/.", autocompletion=run_folders)
]
BagArgument = Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag file.")]
RobotOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Robot: name or file of a profile.", autocompletion=robot_names),
]
MachineOption = Annotated[str | None, typer.Option(help="Machine of a deployment; default: this one.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NODE.PARAMETER=VALUE",
        help="Change a parameter; repeatable. messages=FORM: json, socialbot or standard.",
    ),
]
Runner = Literal["inline", "ros"]
_RUNNER = typer.Option(help="inline: one thread, simulated time; ros: one process per node, over DDS.")
RunnerOption = Annotated[Runner, _RUNNER]
CheckedRunnerOption = Annotated[Runner | None, _RUNNER]
"""Runner that a graph is checked for."""
ComposedOption = Annotated[bool, typer.Option("--composed", help="Run all nodes in one process (ros).")]
DomainOption = Annotated[
    int | None,
    typer.Option(
        min=0, max=232, help="ROS domain to join (ros); default: ROS_DOMAIN_ID, or else an unused one for this run."
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the record of the run; default: runs/TIME.")]
LabelOption = Annotated[
    list[str] | None,
    typer.Option("--label", metavar="NAME=VALUE", help="Label the run, such as participant=P01; repeatable."),
]
ParentOption = Annotated[int | None, typer.Option(hidden=True, help="Stop when this process has stopped.")]
VerboseOption = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Also print progress and details: people in view, head motions, ROS domain."),
]
TimeoutOption = Annotated[
    float, typer.Option(min=0.0, metavar="SECONDS", help="Time limit for the node to appear and to answer.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
InspectOption = Annotated[bool, typer.Option("--inspect", help="Show the run in the browser, live and afterwards.")]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Port of the inspector; 0: any free port.")]
