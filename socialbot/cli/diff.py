"""``socialbot diff``: compare the decisions of two runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli._console import print_line
from socialbot.cli._options import JsonOption, run_folders
from socialbot.cli._runs import opened_run, print_found

if TYPE_CHECKING:
    from socialbot.runs.difference import Difference

PANEL = "Look into a run"
EXAMPLES = ("socialbot diff runs/before runs/after",)
DIFFERENT = 1  # exit code of runs with different decisions


def diff(
    first: Annotated[Path, typer.Argument(metavar="RUN1", help="Folder of a run.", autocompletion=run_folders)],
    second: Annotated[Path, typer.Argument(metavar="RUN2", help="Folder of another run.", autocompletion=run_folders)],
    as_json: JsonOption = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with both runs.")] = None,
) -> None:
    """Print the first different decision of two runs, and its reason. Exit code 1: they differ."""
    from socialbot.runs.difference import difference

    found = difference(opened_run(first), opened_run(second))
    print_found(found, list(found.text()), as_json=as_json)
    if html is not None:
        _write_page(first, second, found, html)
    if not found.same:
        raise typer.Exit(DIFFERENT)


def _write_page(first: Path, second: Path, found: Difference, file: Path) -> None:
    """Write the page of two runs with the images of their bags."""
    from socialbot.runs.report import difference_page, recorded

    with recorded(first) as one, recorded(second) as other:
        path = difference_page(one, other, found).write(file)
    print_line(f"The page of both: {path}", err=True)
