"""``socialbot whatif``: branch a recorded run at a moment, and show the differences."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from socialbot.cli import _options as options
from socialbot.cli._console import Console, print_line
from socialbot.core.errors import ParameterError

PANEL = "Test behaviours"
EXAMPLES = (
    "socialbot whatif runs/waldo --at 12 --forget 'greeted(_)'",
    "socialbot whatif runs/waldo --at 12 --set waldo.help_after_s=2",
)
DIFFERENT = 1  # exit code of different futures, as of `socialbot diff`
_KINDS = (
    "believe",
    "forget",
    "achieve",
    "drop",
    "set",
    "rule",
    "proposal",
    "without",
)  # options without dashes, in order
_Texts = list[str] | None


def whatif(
    run: options.RunArgument = None,
    at: Annotated[str | None, typer.Option(metavar="TIME", help="Time of the change: 8.9 or 1:23.4.")] = None,
    believe: Annotated[_Texts, typer.Option(metavar="BELIEF", help="Add a belief.")] = None,
    forget: Annotated[_Texts, typer.Option(metavar="BELIEF", help="Remove beliefs; _ matches anything.")] = None,
    achieve: Annotated[_Texts, typer.Option(metavar="GOAL", help="Adopt a goal.")] = None,
    drop: Annotated[_Texts, typer.Option(metavar="GOAL", help="Drop a goal.")] = None,
    changes: Annotated[
        _Texts, typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="Change a parameter; repeatable.")
    ] = None,
    rule: Annotated[_Texts, typer.Option(metavar="PLAN", help="Add a rule, in AgentSpeak.")] = None,
    proposal: Annotated[
        _Texts,
        typer.Option(metavar="ID", help="Add the plans that a language model proposed: its record."),
    ] = None,
    without: Annotated[_Texts, typer.Option(metavar="RULE", help="Remove a rule: (part of) its label.")] = None,
    agent: Annotated[str, typer.Option(metavar="NODE", help="Agent to change, if there are several.")] = "",
    out: Annotated[Path | None, typer.Option(help="Folder for both runs; default: runs/TIME.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with both runs.")] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run the input of a recorded run twice, with and without a change at a moment, and show the differences.

    Exit code 1: they differ.
    """
    from socialbot.cli._runs import opened_run, print_json
    from socialbot.cli.why import seconds_of
    from socialbot.runs.difference import difference
    from socialbot.runtime.run import new_run_folder
    from socialbot.runtime.what_if import BranchChange, branch, side_by_side

    texts = zip(_KINDS, (believe, forget, achieve, drop, changes, rule, proposal, without), strict=True)
    wanted = [BranchChange(kind, text) for kind, given in texts for text in given or ()]
    if at is None or not wanted:
        missing = "--at" if at is None else "--believe, --forget, --set, --rule or another change"
        raise ParameterError("nothing to branch", where="whatif", remedy=f"give {missing}")
    recorded, folder, at_s = opened_run(run), out or new_run_folder(), seconds_of(at)
    console, errors = Console(), Console(stderr=True)
    logging.getLogger("socialbot").setLevel(logging.ERROR)
    futures = branch(recorded, at_s, wanted, agent, folder)
    if not futures.reproduced:
        text = "warning: the unchanged run does not decide as recorded; the record has other options or another version"
        errors.print(text, soft_wrap=True)
    found = difference(futures.unchanged, futures.changed, ("as it was", ", ".join(map(str, wanted))))
    rows = side_by_side(futures)
    if as_json:
        content = {"at_s": at_s, "changes": [str(change) for change in wanted], "difference": found, "acts": rows}
        print_json(content)
    else:
        table = options.plain_table("", "as it was", ", ".join(map(str, wanted)))
        for time, before, now in rows:
            table.add_row(f"{time:.2f} s", escape(before), "the same" if before and before == now else escape(now))
        shown = console if sys.stdout.isatty() else Console(width=150)
        shown.print(table if rows else f"No agent acts after {at_s:.2f} s in either run.")
        console.print()
        for line in found.text():
            console.print_plain(line)
        console.print_plain(f"\nBoth runs: {folder}")
    if html is not None:
        from socialbot.runs.report import difference_page
        from socialbot.runs.report import recorded as opened

        with opened(folder / "unchanged") as one, opened(folder / "changed") as other:
            print_line(f"The page of both: {difference_page(one, other, found).write(html)}", err=True)
    if not found.same:
        raise typer.Exit(DIFFERENT)
