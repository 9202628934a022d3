"""``socialbot ask``: ask a recorded run in plain language why, what, who, when and how often."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from socialbot.cli._options import JsonOption, RunArgument
from socialbot.cli._runs import opened_run, print_found
from socialbot.cli.why import seconds_of
from socialbot.core.errors import ParameterError

PANEL = "Look into a run"
EXAMPLES = (
    "socialbot ask runs/waldo 'Why did you greet me?'",
    "socialbot ask runs/waldo --json 'What did you see at 12 seconds?'",
)


def ask(
    run: RunArgument = None,
    question: Annotated[str, typer.Argument(help="Question; with one argument, that of the newest run.")] = "",
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Time of the question, such as 8.9 or 1:23.4; default: the end.")
    ] = None,
    person: Annotated[
        str, typer.Option(metavar="ID", help="Id of the person who asks, as in the page: 'me' in the question.")
    ] = "",
    agent: Annotated[str, typer.Option(metavar="NODE", help="Agent to ask; default: any.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Ask a run in plain language why it did something, what it saw, who was there, and more."""
    from socialbot.runs.asking import answer

    if not question and run is not None and not os.path.exists(run):
        run, question = None, str(run)
    if not question.strip():
        raise ParameterError("there is no question", remedy="socialbot ask runs/waldo 'Why did you greet me?'")
    recorded = opened_run(run)
    at_s = None if at is None else seconds_of(at)
    if at_s is not None and not 0 <= at_s <= recorded.lasted_s:
        remedy = f"give a time from 0 to {recorded.lasted_s:.2f} s"
        raise ParameterError(f"the run does not contain {at_s:.2f} s", where="--at", remedy=remedy)
    found = answer(recorded, question, at_s=at_s, speaker=person, agent=agent)
    lines = [found.text, *([found.assumes] if found.assumes else [])]
    if found.options:
        lines += ["", *(f"    {one.question}: {one.text}" for one in found.options)]
    elif not found.known and found.examples:
        lines += ["", *(f"    {one}" for one in found.examples)]
    print_found(found, lines, as_json=as_json)
