"""``socialbot forget``: remove one person from the record of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from socialbot.cli import _options as options
from socialbot.cli._console import Console

PANEL = "Look into a run"
EXAMPLES = ("socialbot forget runs/waldo --person t1",)


def forget(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.", autocompletion=options.run_folders)],
    person: Annotated[str, typer.Option(metavar="ID", help="Id of the person, as in the page or `visitors`.")],
) -> None:
    """Remove a person from a run: boxes, beliefs, actions towards them, and files with pictures.

    The bag of the run is not changed. docs/privacy.md lists the removed data.
    """
    from socialbot.runs.folder import open_run
    from socialbot.runs.forgetting import forget_person

    made = forget_person(run, person)
    console = Console(soft_wrap=True)
    frames = options.many(made.frames, "frame")
    console.print_plain(f"{run}: {person} is removed from {frames}, with {options.many(made.records, 'record')}")
    if made.files:
        console.print(f"removed: {', '.join(made.files)}", markup=False)
    for name in made.left:
        console.print(f"[yellow]not changed[/]: {escape(name)} may still show them")
    if made.unnamed:
        sentences = options.many(made.unnamed, "heard sentence")
        console.print(
            f"[yellow]not changed[/]: {sentences} of unknown speakers may be theirs: see kind `hearing` in trace.jsonl"
        )
    bag = open_run(run).results.get("bag", {}).get("path")
    if bag:
        console.print(
            f"[yellow]not changed[/]: the bag {escape(str(bag))} still shows them; see `socialbot bag redact`"
        )
        console.print("[yellow]not changed[/]: the cache may hold where they were; `socialbot cache clear` empties it")
