"""``socialbot export``: convert a run for Foxglove or Rerun."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from socialbot.cli._options import run_folders
from socialbot.cli._runs import opened_run
from socialbot.core.errors import ParameterError

PANEL = "Look into a run"
EXAMPLES = ("socialbot export runs/waldo waldo.mcap",)
Format = Literal["foxglove", "rerun"]
SUFFIXES: dict[str, Format] = {".mcap": "foxglove", ".rrd": "rerun"}


def export(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", autocompletion=run_folders)],
    out: Annotated[Path, typer.Argument(help="New file: .mcap for Foxglove, .rrd for Rerun.")],
    kind: Annotated[Format | None, typer.Option("--format", help="Default: by the suffix of the file.")] = None,
) -> None:
    """Write a run as a file for Foxglove (.mcap) or Rerun (.rrd): images, detections, beliefs, actions and reasons."""
    from socialbot.bags.reader import open_bag

    kind = kind or SUFFIXES.get(out.suffix)
    if kind is None:
        remedy = "end it in .mcap or .rrd, or give --format foxglove or --format rerun"
        raise ParameterError("the suffix is neither .mcap nor .rrd", where=str(out), remedy=remedy)
    console, recorded = Console(highlight=False), opened_run(run)
    with ExitStack() as stack, console.status(f"writing {out}"):
        path = recorded.results.get("bag", {}).get("path")
        bag = stack.enter_context(open_bag(path)) if path and Path(path).exists() else None
        bag = bag if bag is not None and bag.image_topics else None
        if kind == "foxglove":
            from socialbot.runs.foxglove import export_foxglove

            export_foxglove(recorded, bag, out)
        else:
            from socialbot.runs.rerun import export_rerun

            export_rerun(recorded, bag, out)
    without = "" if bag is not None else "; without images: its bag is missing"
    size, seconds = out.stat().st_size / 1e6, recorded.history.duration_s
    console.print(f"{len(recorded.history)} records of {seconds:.1f} s in {out}, {size:.1f} MB{without}")
