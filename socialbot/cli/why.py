"""``socialbot why``: explain an action, a decision or a rejected plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli._options import JsonOption, RunArgument
from socialbot.cli._runs import opened_run, print_found
from socialbot.core.errors import ParameterError, RunError

if TYPE_CHECKING:
    from socialbot.core.messages import TraceRecord
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.why import Considered


def why(
    run: RunArgument = None,
    action: Annotated[int | None, typer.Option(min=1, help="Explain the action with this number in --list.")] = None,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Explain decisions at this time: 8.9 or 1:23.4.")
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option("--not", metavar="PLAN", help="Explain why this plan was not chosen: (part of) its label."),
    ] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the actions of the run.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Explain the last action of an agent, or another event, down to the video frame."""
    from socialbot.runs.why import actions, explain, why_not

    asked = {"--action": action, "--at": at, "--not": plan, "--list": show_list or None}
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1:
        raise ParameterError("only one of these options is possible", where=" ".join(given), remedy="give one")
    recorded = opened_run(run)
    history = recorded.history
    if plan is not None:
        found = why_not(history, plan)
        print_found(found, _not_chosen(found), as_json=as_json)
    elif show_list:
        listed = [explain(history, recorded.wording, record).chain[0] for record in actions(history)]
        rows = [f"{number:>4}  {one.at_s:>8.2f} s  {one.sentence}" for number, one in enumerate(listed, start=1)]
        print_found(listed, rows or ["the run has no actions"], as_json=as_json)
    else:
        records = _decided(recorded, seconds_of(at)) if at is not None else _done(recorded, action)
        explained = [explain(history, recorded.wording, record) for record in records]
        lines = [
            "\n".join([each.text(), *(f"    not by {no.plan}: {no.because}" for no in each.rejected)])
            for each in explained
        ]
        print_found(explained, lines, as_json=as_json)


def seconds_of(text: str) -> float:
    """``8.9`` or ``1:23.4`` in seconds. Raises ParameterError."""
    minutes, _, seconds = text.rpartition(":")
    try:
        return int(minutes or "0") * 60 + float(seconds)
    except ValueError as error:
        remedy = "write seconds, such as 8.9, or minutes and seconds, such as 1:23.4"
        raise ParameterError(f"{text!r} is not a time", where="--at", remedy=remedy) from error


def _done(run: RecordedRun, number: int | None) -> Sequence[TraceRecord]:
    from socialbot.runs.why import actions

    done = actions(run.history)
    if not done:
        raise RunError("the run has no actions", where=str(run.folder), remedy="--at TIME explains decisions")
    if number is not None and number > len(done):
        what = f"there is no action {number}"
        raise RunError(what, where=str(run.folder), remedy=f"there are {len(done)}: see --list")
    return done[-1:] if number is None else done[number - 1 : number]


def _decided(run: RecordedRun, seconds: float) -> Sequence[TraceRecord]:
    from socialbot.runs.why import decided_at

    found = decided_at(run.history, run.history.stamp(seconds))
    if not found:
        remedy = f"the run ends at {run.history.duration_s:.2f} s; --list shows its actions"
        raise RunError(f"there are no decisions until {seconds:.2f} s", where=str(run.folder), remedy=remedy)
    return found


def _not_chosen(plans: Sequence[Considered]) -> list[str]:
    lines = []
    for each in plans:
        lines.append(each.plan)
        if each.chosen_s:
            lines.append(f"  chosen at {', '.join(f'{at_s:.2f} s' for at_s in each.chosen_s)}")
        lines += [f"  not chosen at {no.at_s:.2f} s for {no.event}: {no.because}" for no in each.rejected]
        lines += [] if each.rejected else ["  never rejected"]
    return lines
