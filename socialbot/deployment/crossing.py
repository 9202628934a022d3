"""Pictures that go from one machine to another: a sender and a receiver are put in, so that no raw one does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from socialbot.errors import GraphError
from socialbot.graph import Graph, Placement
from socialbot.messages import Image
from socialbot.vision.picture_receiver import PictureReceiver
from socialbot.vision.picture_sender import PictureSender

Transport = Literal["jpeg", "raw"]


@dataclass(frozen=True)
class Pictures:
    """How the pictures of a topic cross: as JPEG with these parameters of a `PictureSender`, or raw."""

    transport: Transport = "jpeg"
    parameters: Mapping[str, object] = field(default_factory=dict)


def with_crossings(
    graph: Graph, places: Mapping[str, str], pictures: Mapping[str, Pictures]
) -> tuple[Graph, dict[str, str]]:
    """``graph`` and ``places``, the machine of each node by its name, after all crossings were put in.

    Pictures of ``/camera/image_raw`` wanted on the machine ``desk`` arrive there as ``/camera/image_raw/desk``.
    Raises GraphError where pictures of one topic are published on several machines.
    """
    crossed = dict(places)
    for topic in picture_topics(graph):
        settings = pictures.get(topic, Pictures())
        home = _home(graph, topic, places)
        if not home or settings.transport == "raw":
            continue
        takers = {crossed[one.name] for one in graph.placements if _takes(one, topic)}
        for machine in sorted(takers - {home}):
            sender, receiver = _pair(topic, machine, settings)
            placements = [
                _remapped(one, topic, machine) if crossed[one.name] == machine else one for one in graph.placements
            ]
            graph = replace(graph, placements=(*placements, sender, receiver))
            crossed |= {sender.name: home, receiver.name: machine}
    return graph, crossed


def picture_topics(graph: Graph) -> list[str]:
    """The topics of raw pictures, in order."""
    return sorted(topic for topic, kind in graph.topics().items() if kind is Image)


def publishes_pictures(placement: Placement) -> bool:
    """Whether a node publishes raw pictures."""
    return any(port.message_type is Image for _, port in placement.publications)


def _takes(placement: Placement, topic: str) -> bool:
    return any(topic == taken for taken, _ in placement.subscriptions)


def _home(graph: Graph, topic: str, places: Mapping[str, str]) -> str:
    """The machine that publishes ``topic``; none where it comes from outside."""
    publishers = [one for one in graph.placements if any(topic == said for said, _ in one.publications)]
    homes = sorted({places[one.name] for one in publishers})
    if len(homes) > 1:
        raise GraphError(
            f"pictures of {topic} are published on several machines: {', '.join(homes)}",
            where=f"nodes.{publishers[-1].name}",
            remedy="move the nodes to one, or remap one of them to another topic",
        )
    return homes[0] if homes else ""


def _pair(topic: str, machine: str, pictures: Pictures) -> tuple[Placement, Placement]:
    stem = topic.strip("~/").replace("/", "_")
    arrived = _arrived(topic, machine)
    link = {"link": f"{arrived}/link", "ack": f"{arrived}/link/ack"}
    return (
        Placement(f"{stem}_to_{machine}", PictureSender, pictures.parameters, {"image": topic, **link}),
        Placement(f"{stem}_at_{machine}", PictureReceiver, {}, {"image": arrived, **link}),
    )


def _remapped(placement: Placement, topic: str, machine: str) -> Placement:
    moved = {port.name: _arrived(topic, machine) for taken, port in placement.subscriptions if taken == topic}
    return replace(placement, remap={**placement.remap, **moved})


def _arrived(topic: str, machine: str) -> str:
    return f"{topic}/{machine}"
