"""``socialbot why``: why an agent did something, or did not; ``socialbot diff``: where two runs part; ``report``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from socialbot.cli.completion import run_folders
from socialbot.core.errors import ParameterError, RunError

if TYPE_CHECKING:
    from socialbot.core.messages import TraceRecord
    from socialbot.runs.difference import Difference
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.why import Considered, Explanation

RunArgument = Annotated[
    Path | None, typer.Argument(help="The folder of a run; default: the newest in runs/.", autocompletion=run_folders)
]
JsonOption = Annotated[bool, typer.Option("--json", help="As JSON, for programs.")]

DIFFERENT = 1
"""The exit code of two runs that decided differently."""


def why(
    run: RunArgument = None,
    action: Annotated[int | None, typer.Option(min=1, help="Why this action, by its number in --list.")] = None,
    at: Annotated[str | None, typer.Option(metavar="TIME", help="Why what was done then: 8.9 (s), or 1:23.4.")] = None,
    plan: Annotated[
        str | None,
        typer.Option("--not", metavar="PLAN", help="Why this plan was not chosen: its label, or some of it."),
    ] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the actions of the run.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say why an agent did what it did last, or something else, down to the video frame."""
    from socialbot.runs.why import actions, explain, why_not

    asked = {"--action": action, "--at": at, "--not": plan, "--list": show_list or None}
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1:
        raise ParameterError("these ask for different things", where=" ".join(given), remedy="give one of them")
    console, recorded = Console(highlight=False), opened(run)
    history = recorded.history
    if plan is not None:
        found = why_not(history, plan)
        _tell(console, found, _not_chosen(found), as_json=as_json)
    elif show_list:
        listed = [explain(history, recorded.wording, record).chain[0] for record in actions(history)]
        rows = [
            f"{number:>4}  {reason.at_s:>8.2f} s  {reason.sentence}" for number, reason in enumerate(listed, start=1)
        ]
        _tell(console, listed, rows or ["nothing was done in this run"], as_json=as_json)
    else:
        records = _decided(recorded, seconds_of(at)) if at is not None else _done(recorded, action)
        explained = [explain(history, recorded.wording, record) for record in records]
        _tell(console, explained, [_explanation(each) for each in explained], as_json=as_json)


def diff(
    first: Annotated[Path, typer.Argument(metavar="RUN1", help="The folder of a run.", autocompletion=run_folders)],
    second: Annotated[Path, typer.Argument(metavar="RUN2", help="The folder of another.", autocompletion=run_folders)],
    as_json: JsonOption = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with both runs here, too.")] = None,
) -> None:
    """Say where two runs decide differently first, and why. Exit code 0 if they do not, 1 if they do."""
    from socialbot.runs.difference import difference

    found = difference(opened(first), opened(second))
    _tell(Console(highlight=False), found, list(found.text()), as_json=as_json)
    if html is not None:
        _write_page(first, second, found, html)
    if not found.same:
        raise typer.Exit(DIFFERENT)


def report(
    run: RunArgument = None,
) -> None:
    """Write the page of a recorded run, report.html, into its folder: of one that was broken off, or a long one."""
    from socialbot.runs.folder import newest_run
    from socialbot.runs.report import write_report

    typer.echo(write_report(newest_run() if run is None else run))


def _write_page(first: Path, second: Path, found: Difference, file: Path) -> None:
    """Writes the page of two runs, with the pictures of their bags."""
    from socialbot.runs.report import difference_page, recorded

    with recorded(first) as one, recorded(second) as other:
        path = difference_page(one, other, found).write(file)
    typer.echo(f"The page of both: {path}", err=True)


def opened(folder: Path | None) -> RecordedRun:
    """The run in a folder, by default the newest; what of it is damaged is said on stderr. Raises RunError."""
    from socialbot.runs.folder import newest_run, open_run

    run = open_run(newest_run() if folder is None else folder)
    for damage in run.damage:
        Console(stderr=True, highlight=False).print(f"warning: {damage}", soft_wrap=True, markup=False)
    return run


def seconds_of(text: str) -> float:
    """``8.9`` or ``1:23.4`` in seconds. Raises ParameterError."""
    minutes, _, seconds = text.rpartition(":")
    try:
        return int(minutes or "0") * 60 + float(seconds)
    except ValueError as error:
        remedy = "write seconds, such as 8.9, or minutes and seconds, such as 1:23.4"
        raise ParameterError(f"{text!r} is no time", where="--at", remedy=remedy) from error


def _done(run: RecordedRun, number: int | None) -> Sequence[TraceRecord]:
    from socialbot.runs.why import actions

    done = actions(run.history)
    if not done:
        raise RunError("nothing was done in this run", where=str(run.folder), remedy="--at TIME tells what was decided")
    if number is not None and number > len(done):
        raise RunError(
            f"there is no action {number}", where=str(run.folder), remedy=f"there are {len(done)}: see --list"
        )
    return done[-1:] if number is None else done[number - 1 : number]


def _decided(run: RecordedRun, seconds: float) -> Sequence[TraceRecord]:
    from socialbot.runs.why import decided_at

    found = decided_at(run.history, run.history.stamp(seconds))
    if not found:
        remedy = f"it lasts until {run.history.duration_s:.2f} s; --list shows what was done when"
        raise RunError(f"nothing was decided until {seconds:.2f} s", where=str(run.folder), remedy=remedy)
    return found


def _explanation(explanation: Explanation) -> str:
    rejected = [f"    not by {each.plan}: {each.because}" for each in explanation.rejected]
    return "\n".join([explanation.text(), *rejected])


def _not_chosen(plans: Sequence[Considered]) -> list[str]:
    lines = []
    for each in plans:
        lines.append(each.plan)
        if each.chosen_s:
            lines.append(f"  chosen at {', '.join(f'{at_s:.2f} s' for at_s in each.chosen_s)}")
        lines += [f"  not chosen at {no.at_s:.2f} s for {no.event}: {no.because}" for no in each.rejected]
        lines += [] if each.rejected else ["  never turned down"]
    return lines


def _tell(console: Console, found: Any, lines: Sequence[str], *, as_json: bool) -> None:
    if as_json:
        import msgspec

        typer.echo(msgspec.json.format(msgspec.json.encode(found), indent=2).decode())
        return
    for line in lines:
        console.print(Text(line), soft_wrap=True)
