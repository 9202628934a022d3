"""Shared command options, their shell completion, and the parser of ``--set``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer

from socialbot.core.errors import SocialbotError

PORT = 8765
"""Default port of the inspector."""


class _CommandContext(Protocol):
    """Context of a command line that is being completed."""

    params: Mapping[str, Any]


def graph_names(incomplete: str) -> list[str]:
    """Complete a graph: names of built-in graphs, YAML files and folders."""
    from socialbot.core import registry

    names = [name for name in registry.graph_names() if name.startswith(incomplete)]
    return [*names, *paths(incomplete, (".yaml", ".yml"))]


def node_names(ctx: _CommandContext, incomplete: str) -> list[str]:
    """Complete a node of the graph that ``--graph`` names; nothing if the graph is unreadable."""
    from socialbot.graph.files import load_graph

    given = set(ctx.params.get("names") or ())
    try:
        graph = load_graph(ctx.params.get("graph") or "waldo")
    except SocialbotError:
        return []
    names = (config.name for config in graph.placements)
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


GraphArgument = Annotated[str, typer.Argument(help="A built-in graph or a graph file.", autocompletion=graph_names)]
RunArgument = Annotated[
    Path | None, typer.Argument(help="Folder of a run; default: the newest in runs/.", autocompletion=run_folders)
]
BagArgument = Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag file.")]
MachineOption = Annotated[str | None, typer.Option(help="Machine of a deployment; default: this one.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NODE.PARAMETER=VALUE",
        help="Change a parameter; repeatable. wire=typed: messages as socialbot_msgs.",
    ),
]
ComposedOption = Annotated[bool, typer.Option("--composed", help="Run all nodes in one process (ros).")]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the record of the run; default: runs/TIME.")]
ParentOption = Annotated[int | None, typer.Option(hidden=True, help="Stop when this process has stopped.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
InspectOption = Annotated[bool, typer.Option("--inspect", help="Show the run in the browser, live and afterwards.")]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Port of the inspector; 0: any free port.")]
