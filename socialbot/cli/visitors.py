"""``socialbot visitors``: list the visits of a run, with the sentences to each visitor."""

from __future__ import annotations

from typing import Annotated

import typer

from socialbot.cli._console import Console
from socialbot.cli._options import JsonOption, RunArgument, many
from socialbot.cli._runs import opened_run, print_json

PANEL = "Look into a run"
EXAMPLES = ("socialbot visitors", "socialbot visitors runs/waldo --range 4")


def visitors(
    run: RunArgument = None,
    range_m: Annotated[
        float | None,
        typer.Option("--range", min=0.1, metavar="METRES", help="Distance of a visit; default: range_m of an agent."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the visits of a run: arrival, engagement, reaction of the robot, departure. Exit code 10: one was missed."""
    from socialbot.runs.visits import SOURCES, visit_table, visits_of

    found, source = visits_of(opened_run(run), range_m)
    missed = sum(visit.outcome == "missed" for visit in found)
    if as_json:
        print_json(found)
    else:
        console = Console()
        if found:
            console.print(visit_table(found).terminal())
        people = many(len({visit.person for visit in found}), "person").replace("persons", "people")
        engaged = sum(visit.engaged_s is not None for visit in found)
        counts = f"{many(len(found), 'visit')} of {people}, {engaged} engaged, {missed} missed"
        console.print(f"{counts}; people from {SOURCES[source]}")
    if missed:
        raise typer.Exit(10)
