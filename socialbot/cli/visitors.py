"""``socialbot visitors``: list the visits of a run, with the sentences to each visitor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from socialbot.cli._console import Console
from socialbot.cli._options import JsonOption, RunArgument, many, plain_table
from socialbot.cli._runs import opened_run, print_json

if TYPE_CHECKING:
    from rich.table import Table

    from socialbot.runs.visits import Visit

PANEL = "Look into a run"
EXAMPLES = ("socialbot visitors", "socialbot visitors runs/waldo --range 4")
SOURCES = {"truth": "the ground truth of the bag", "tracks": "the tracks of the detector"}


def visitors(
    run: RunArgument = None,
    range_m: Annotated[
        float | None,
        typer.Option("--range", min=0.1, metavar="METRES", help="Distance of a visit; default: range_m of an agent."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the visits of a run: arrival, engagement, reaction of the robot, departure. Exit code 10: one was missed."""
    from socialbot.runs.visits import visits_of

    found, source = visits_of(opened_run(run), range_m)
    missed = sum(visit.outcome == "missed" for visit in found)
    if as_json:
        print_json(found)
    else:
        console = Console(highlight=False)
        if found:
            console.print(_table(found))
        people = many(len({visit.person for visit in found}), "person").replace("persons", "people")
        engaged = sum(visit.engaged_s is not None for visit in found)
        counts = f"{many(len(found), 'visit')} of {people}, {engaged} engaged, {missed} missed"
        console.print(f"{counts}; people from {SOURCES[source]}")
    if missed:
        raise typer.Exit(10)


def _table(found: list[Visit]) -> Table:
    table = plain_table("visitor", "came", "nearest", "faced", "engaged", "said", "left", "addressed")
    for visit in found:
        nearest = "" if visit.nearest_m is None else f"{visit.nearest_m:.1f} m at {visit.nearest_s:.1f} s"
        table.add_row(
            escape(visit.person),
            f"{visit.came_s:.1f} s #{visit.came_frame}",
            nearest,
            "" if visit.faced_s is None else f"{visit.faced_s:.1f} s",
            "" if visit.engaged_s is None else f"{visit.engaged_s:.1f} s",
            escape("\n".join(f"{said.at_s:.1f} s {said.text}" for said in visit.said)),
            f"{visit.left_s:.1f} s #{visit.left_frame}",
            visit.outcome if visit.delay_s is None else f"{visit.outcome}, after {visit.delay_s:.1f} s",
        )
    return table
