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
    place: Annotated[Literal["corridor", "foyer", "office"], typer.Argument(help="Place.")] = "foyer",
    visitors: Annotated[int, typer.Option(min=0, max=26, help="Number of people of a random schedule.")] = 8,
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
    from socialbot.core.errors import BagError
    from socialbot.robots.simulation.demo import simulation, size_of

    width, height = size_of(size)
    if record is not None and record.exists():
        raise BagError("exists already", where=str(record), remedy="give another path to --record, or remove it")
    graph = simulation(
        place,
        head=control,
        perception=perception,
        script=script,
        people=visitors,
        seed=seed,
        duration_s=(60.0 if script is None else 0.0) if duration is None else duration,
        width=width,
        height=height,
        rate_hz=fps,
    )
    return f"People in the {place}", graph, record


sim = options.command_of(_place, ("title", "graph", "bag_path"), simulate, without=("bag",), limit=86400.0)
