"""Graphs of simulated places, and the demo in the foyer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.core import paths
from socialbot.core.errors import ParameterError
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, NodeConfig
from socialbot.robots.simulation.node import SimulatedPlace
from socialbot.robots.simulation.truth_detector import TruthDetector

HeadMotion = Literal["waldo", "still", "sweep"]
Perception = Literal["camera", "truth"]
PLACE = "place"
"""Name of the node of the place."""


def simulation(
    place: str = "foyer",
    *,
    head: HeadMotion = "waldo",
    perception: Perception = "camera",
    script: Path | None = None,
    **parameters: Any,
) -> Graph:
    """Return the graph of a simulated place.

    Args:
        place: Name of the place.
        head: ``waldo`` adds perception and Waldo; else the place is alone, with a head that is still or sweeps.
        perception: ``truth`` makes detections from the ground truth instead of from pictures.
        script: File with what people do; by default a random schedule.
        parameters: Parameters of the node `SimulatedPlace`.

    Raises:
        InstallationError: MuJoCo is not installed.
    """
    load_mujoco()  # before a run or a bag exists
    given: dict[str, Any] = {"place": place, **parameters}
    if script is not None:
        paths.allow(script)
        given["script"] = str(script.resolve())
    if head != "waldo":
        return Graph(place, (NodeConfig(PLACE, SimulatedPlace, {**given, "head": head}),))
    graph = load_graph("foyer")
    nodes = graph.nodes
    if perception == "truth":
        given["pictures"] = False
        seeing = NodeConfig("person_detector", TruthDetector, {"seed": parameters.get("seed", 0)})
        nodes = tuple(
            seeing if config.name == seeing.name else config for config in nodes if config.name != "image_converter"
        )
    changes: Mapping[str, Mapping[str, object]] = {PLACE: given}
    return replace(graph, name=place, nodes=nodes).with_parameters(changes)


def size_of(text: str, *, where: str = "--size") -> tuple[int, int]:
    """Read the width and height of pictures, such as ``640x480``.

    Raises:
        ParameterError: It is no size.
    """
    width, cross, height = text.partition("x")
    if not (cross and all(side.isdecimal() and len(side) < 6 for side in (width, height))):
        raise ParameterError(f"{text!r} is no size", where=where, remedy=f"give width and height: {where} 320x240")
    return int(width), int(height)


def demo(
    visitors: Annotated[int, typer.Option(min=0, max=26, help="Number of people of a random schedule.")] = 8,
    seed: Annotated[int, typer.Option(help="Seed of the people and what they do.")] = 0,
    duration: Annotated[float, typer.Option(min=5.0, max=3600.0, metavar="SECONDS", help="Time limit, s.")] = 60.0,
) -> tuple[str, Graph]:
    """Waldo meets people in a simulated foyer: he turns to them, greets those who come, and leaves company alone."""
    return "Waldo in the foyer", simulation("foyer", people=visitors, seed=seed, duration_s=duration)
