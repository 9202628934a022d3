"""``socialbot export``: convert a run for Foxglove or Rerun."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console

from socialbot.cli._options import run_folders
from socialbot.cli._runs import opened_run
from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    from socialbot.bags.reader import Bag
    from socialbot.runs.folder import RecordedRun

Format = Literal["foxglove", "rerun"]
SUFFIXES: dict[str, Format] = {".mcap": "foxglove", ".rrd": "rerun"}


def export(
    run: Annotated[Path, typer.Argument(help="The folder of a run.", autocompletion=run_folders)],
    out: Annotated[Path, typer.Argument(help="The file to make: .mcap for Foxglove, .rrd for Rerun.")],
    kind: Annotated[Format | None, typer.Option("--format", help="Default: as the name of the file says.")] = None,
) -> None:
    """Write a run as a file for Foxglove (.mcap) or Rerun (.rrd): images, detections, beliefs, actions and reasons."""
    kind = kind or SUFFIXES.get(out.suffix)
    if kind is None:
        remedy = "end it in .mcap or .rrd, or give --format foxglove or --format rerun"
        raise ParameterError("the name does not say for which tool", where=str(out), remedy=remedy)
    console, recorded = Console(highlight=False), opened_run(run)
    with ExitStack() as stack, console.status(f"writing {out}"):
        bag = _bag(recorded, stack)
        if kind == "foxglove":
            from socialbot.runs.foxglove import export_foxglove

            export_foxglove(recorded, bag, out)
        else:
            from socialbot.runs.rerun import export_rerun

            export_rerun(recorded, bag, out)
    without = "" if bag is not None else "; without pictures: its bag is not at hand"
    size = out.stat().st_size / 1e6
    console.print(
        f"{len(recorded.history)} records of {recorded.history.duration_s:.1f} s in {out}, {size:.1f} MB{without}"
    )


def _bag(run: RecordedRun, stack: ExitStack) -> Bag | None:
    """Open the replayed bag of a run, if it still exists."""
    from socialbot.bags.reader import open_bag

    path = run.results.get("bag", {}).get("path")
    if not path or not Path(path).exists():
        return None
    bag = stack.enter_context(open_bag(path))
    return bag if bag.image_topics else None
