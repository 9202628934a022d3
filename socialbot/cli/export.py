"""``socialbot export``: convert a run for Foxglove, Rerun, ELAN or a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import run_folders
from socialbot.cli._runs import images_of, opened_run
from socialbot.core.errors import ParameterError

PANEL = "Look into a run"
EXAMPLES = ("socialbot export runs/waldo waldo.mcap", "socialbot export runs/waldo waldo.eaf")
Format = Literal["foxglove", "rerun", "csv", "elan"]
SUFFIXES: dict[str, Format] = {".mcap": "foxglove", ".rrd": "rerun", ".csv": "csv", ".eaf": "elan"}


def export(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", autocompletion=run_folders)],
    out: Annotated[Path, typer.Argument(help="New file: .mcap for Foxglove, .rrd for Rerun, .eaf for ELAN, or .csv.")],
    kind: Annotated[Format | None, typer.Option("--format", help="Format of the file; default: by its suffix.")] = None,
) -> None:
    """Write a run as a file for Foxglove, Rerun or ELAN, or as a table: detections, beliefs, actions and reasons.

    Foxglove (.mcap) and Rerun (.rrd) show the images, too. ELAN (.eaf) gets a tier for each visitor, for speech, and
    for the beliefs, goals and actions of each agent. A table (.csv) has one row per record.
    """
    kind = kind or SUFFIXES.get(out.suffix)
    if kind is None:
        remedy = f"end it in {', '.join(SUFFIXES)}, or give --format"
        raise ParameterError("the suffix names no format", where=str(out), remedy=remedy)
    console, recorded = Console(), opened_run(run)
    if kind in ("csv", "elan"):
        from socialbot.runs.annotations import write_csv, write_elan

        rows = write_csv(recorded, out) if kind == "csv" else write_elan(recorded, out)
        console.print(f"{rows} {'rows' if kind == 'csv' else 'annotations'} in {out}")
        return
    with images_of(recorded) as bag, console.status(f"writing {out}"):
        if kind == "foxglove":
            from socialbot.runs.foxglove import export_foxglove

            export_foxglove(recorded, bag, out)
        else:
            from socialbot.runs.rerun import export_rerun

            export_rerun(recorded, bag, out)
    without = "" if bag is not None else "; without images: its bag is missing"
    size, seconds = out.stat().st_size / 1e6, recorded.history.duration_s
    console.print(f"{len(recorded.history)} records of {seconds:.1f} s in {out}, {size:.1f} MB{without}")
