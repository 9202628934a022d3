"""What the shell offers for the names in a command: graphs, nodes and runs; files besides where they fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from socialbot.core.errors import SocialbotError


class Given(Protocol):
    """What was given on the command line so far."""

    params: Mapping[str, Any]


def graph_names(incomplete: str) -> list[str]:
    """The graphs that come with socialbot, and the YAML files and folders that begin like ``incomplete``."""
    from socialbot.core import registry

    return [name for name in registry.graph_names() if name.startswith(incomplete)] + list(
        paths(incomplete, (".yaml", ".yml"))
    )


def node_names(ctx: Given, incomplete: str) -> list[str]:
    """The nodes of the graph that ``--graph`` names; none when it cannot be read."""
    from socialbot.graph.files import load_graph

    given = set(ctx.params.get("names") or ())
    try:
        graph = load_graph(ctx.params.get("graph") or "waldo")
    except SocialbotError:
        return []
    names = (placement.name for placement in graph.placements)
    return [name for name in names if name.startswith(incomplete) and name not in given]


def run_folders(incomplete: str) -> list[str]:
    """The folders of runs in ``runs/``, the newest first, and others that begin like ``incomplete``."""
    runs = sorted(Path("runs").glob("*/trace.jsonl"), key=lambda trace: trace.stat().st_mtime_ns, reverse=True)
    names = [str(trace.parent) for trace in runs]
    return unique([name for name in names if name.startswith(incomplete)] + list(paths(incomplete, ())))


def paths(incomplete: str, suffixes: tuple[str, ...]) -> Iterator[str]:
    """Folders, and files with one of the ``suffixes``, that begin like ``incomplete``; hidden ones when it is a dot."""
    folder, _, begin = incomplete.rpartition("/")
    place = Path(f"{folder}/" if "/" in incomplete else ".")
    try:
        found = sorted(place.iterdir())
    except OSError:
        return
    for path in found:
        hidden = path.name.startswith(".") and not begin.startswith(".")
        if path.name.startswith(begin) and not hidden and (path.is_dir() or path.suffix in suffixes):
            name = incomplete[: len(incomplete) - len(begin)] + path.name
            yield f"{name}/" if path.is_dir() else name


def unique(names: Iterable[str]) -> list[str]:
    """``names`` without those that name the same folder as one before."""
    kept: dict[str, str] = {}
    for name in names:
        kept.setdefault(name.rstrip("/"), name)
    return list(kept.values())
