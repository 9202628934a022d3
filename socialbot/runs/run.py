"""What a page, a report or a question in the terminal needs of a run, be it recorded or live."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import msgspec

from socialbot.graph.node import Graph
from socialbot.graph.status import NodeStatus
from socialbot.runs.history import History
from socialbot.runs.names import Wording
from socialbot.runs.plan_trees import PlanTree
from socialbot.runs.state_index import Course
from socialbot.runs.timeline import Timeline


class Picture(msgspec.Struct, frozen=True):
    """A picture of a camera and its stamp (ns)."""

    stamp: int
    jpeg: bytes


class Pictures(Protocol):
    """The pictures of a run by time."""

    def at(self, stamp: int) -> Picture | None:
        """The newest one that is not later than ``stamp`` (ns)."""
        ...


class NodeView(msgspec.Struct, frozen=True):
    """A node of a graph, the machine it runs on (empty if unknown), and the topics that it takes and gives.

    An ``agent`` has a mind.
    """

    name: str
    type: str
    machine: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    agent: bool


class GraphView(msgspec.Struct, frozen=True):
    """The nodes of a graph, and the kinds of the messages of its topics by their names."""

    nodes: tuple[NodeView, ...] = ()
    topics: Mapping[str, str] = {}


class Told(Protocol):
    """What happened in a run, and how it calls things."""

    @property
    def title(self) -> str:
        """What people call it."""
        ...

    @property
    def history(self) -> History:
        """Its records."""
        ...

    @property
    def wording(self) -> Wording:
        """How it calls agents and steps."""
        ...

    @property
    def results(self) -> Mapping[str, Any]:
        """What results.json holds; empty as long as there is none."""
        ...


class Run(Told, Protocol):
    """A run to look at. All stamps are ns."""

    @property
    def live(self) -> bool:
        """Whether it still goes on."""
        ...

    @property
    def end(self) -> int:
        """The stamp up to which it goes; later ones when it goes on."""
        ...

    @property
    def sees(self) -> bool:
        """Whether there are pictures."""
        ...

    @property
    def course(self) -> Course:
        """What held when."""
        ...

    @property
    def timeline(self) -> Timeline:
        """Everything as bars."""
        ...

    def picture(self, stamp: int) -> Picture | None:
        """What the camera saw at ``stamp``; None where there is no picture."""
        ...

    def world(self, stamp: int) -> str | None:
        """The world of the agents at ``stamp`` as SVG; None where there is none to draw."""
        ...

    def trees(self, stamp: int) -> tuple[PlanTree, ...]:
        """The plans of the agents at ``stamp``, and how far they have come."""
        ...

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]:
        """How the nodes were at ``stamp``, as far as they have told."""
        ...

    def graph(self) -> GraphView:
        """The nodes, and how they are connected."""
        ...


def graph_view(graph: Graph, machines: Mapping[str, str] | None = None) -> GraphView:
    """A graph to be drawn; ``machines`` are those of its nodes, where they are known."""
    nodes = tuple(
        NodeView(
            placement.name,
            placement.type.__name__,
            (machines or {}).get(placement.name, ""),
            tuple(topic for topic, _ in placement.subscriptions),
            tuple(topic for topic, _ in placement.publications),
            placement.type.is_agent,
        )
        for placement in graph.placements
    )
    return GraphView(nodes, {topic: kind.__name__ for topic, kind in sorted(graph.topics().items())})


def node_views(run: Run, stamp: int) -> list[dict[str, Any]]:
    """How the nodes were at ``stamp`` (ns), each with its condition in words."""
    return [
        {**msgspec.to_builtins(each), "condition": each.condition, "well": each.is_well} for each in run.nodes(stamp)
    ]
