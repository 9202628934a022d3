"""``socialbot sim``: a simulated place with people and a robot, live or recorded with ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from socialbot.cli import _options as options
from socialbot.cli.run import simulate
from socialbot.graph.node import Graph

PANEL = "Run a graph"
EXAMPLES = (
    "socialbot sim foyer --inspect",
    "socialbot sim office --control sweep --seed 3 --record office_3",
)


def _place(
    place: Annotated[
        Literal["corridor", "foyer", "office"] | None,
        typer.Argument(help="Place; default: that of the script, or foyer."),
    ] = None,
    visitors: Annotated[
        int | None, typer.Option(min=0, max=26, help="Number of people of a random schedule; default: 8.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the schedule and of the looks of people.")] = 0,
    duration: Annotated[
        float | None,
        typer.Option(min=1.0, metavar="SECONDS", help="Time limit; default: 60 s, or that of the script."),
    ] = None,
    script: Annotated[
        Path | None, typer.Option(metavar="FILE", help="What people do (YAML), instead of a random schedule.")
    ] = None,
    control: Annotated[
        Literal["waldo", "still", "sweep"], typer.Option(help="What turns the head: Waldo, or no agent.")
    ] = "waldo",
    perception: Annotated[
        Literal["camera", "truth"], typer.Option(help="truth: detections from the ground truth, without pictures.")
    ] = "camera",
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the pictures, px.")] = "640x480",
    fps: Annotated[float, typer.Option(min=0.5, max=60.0, metavar="HZ", help="Pictures per second.")] = 10.0,
    record: Annotated[
        Path | None, typer.Option(metavar="BAG", help="Record a bag with ground truth: socialbot evaluate BAG.")
    ] = None,
) -> tuple[str, Graph, Path | None]:
    """Simulate a place with people, and a robot that meets them. Needs the extra sim (MuJoCo).

    The same options and seed give the same bag.
    """
    from socialbot.core import paths
    from socialbot.core.errors import BagError, ParameterError
    from socialbot.robots.simulation.demo import simulation, size_of
    from socialbot.robots.simulation.people import read_script

    width, height = size_of(size)
    if record is not None and record.exists():
        raise BagError("exists already", where=str(record), remedy="give another path to --record, or remove it")
    if control != "waldo" and perception == "truth":
        raise ParameterError(
            "nobody takes detections without an agent", where="--perception truth", remedy="omit it or --control"
        )
    if script is not None:
        if visitors is not None:
            raise ParameterError("the script names its people", where="--visitors", remedy="omit it or --script")
        named = read_script(paths.read_text(script, ParameterError), where=str(script)).place
        if place not in (None, named):
            raise ParameterError(f"is not the place of {script}, {named!r}", where=place, remedy=f"omit {place}")
    else:
        named = place or "foyer"
    graph = simulation(
        named,
        head=control,
        perception=perception,
        script=script,
        people=8 if visitors is None else visitors,
        seed=seed,
        duration_s=(60.0 if script is None else 0.0) if duration is None else duration,
        width=width,
        height=height,
        rate_hz=fps,
    )
    return f"People in the {named}", graph, record


sim = options.command_of(_place, ("title", "graph", "bag_path"), simulate, without=("bag",), limit=86400.0)
