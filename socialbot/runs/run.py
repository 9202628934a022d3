"""Interface of a run, recorded or live, and its overview for the page."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import msgspec

from socialbot.core.clock import SECOND
from socialbot.core.messages import Command, Health
from socialbot.graph.node import Graph
from socialbot.graph.status import NodeStatus, RollCall
from socialbot.runs.history import History
from socialbot.runs.narration import Wording, plan_name
from socialbot.runs.plan_trees import PlanTree
from socialbot.runs.record import NodeTold
from socialbot.runs.state import Course
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


class Answer(Protocol):
    """What became of it."""

    @property
    def accepted(self) -> bool:
        """Whether it is done."""
        ...

    @property
    def reason(self) -> str:
        """Why not."""
        ...


class Office(Protocol):
    """Takes what people ask of agents to them."""

    @property
    def shut(self) -> str:
        """Why nothing can be asked; empty when it can."""
        ...

    async def ask(self, agent: str, command: Command, text: str) -> Answer | None:
        """Asks an agent for something; None when it does not answer."""
        ...


@dataclass(frozen=True)
class Shut:
    """Where nothing can be asked."""

    shut: str

    async def ask(self, agent: str, command: Command, text: str) -> None:
        """Does nothing."""


T = TypeVar("T")


@dataclass
class _Course(Generic[T]):
    """What somebody has told, and when (s)."""

    times: list[float] = field(default_factory=list)
    told: list[T] = field(default_factory=list)

    def note(self, at_s: float, told: T) -> None:
        place = bisect_right(self.times, at_s)
        self.times.insert(place, at_s)
        self.told.insert(place, told)

    def forget(self, at_s: float) -> None:
        count = max(0, bisect_right(self.times, at_s) - 1)
        del self.times[:count], self.told[:count]

    def before(self, at_s: float) -> tuple[float, T] | None:
        place = bisect_right(self.times, at_s)
        return (self.times[place - 1], self.told[place - 1]) if place else None


class NodesThen:
    """The nodes with these ``names`` in the course of a run. Times are s from its start."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._health: dict[str, _Course[Health]] = {}
        self._told: dict[str, _Course[NodeTold]] = {}

    def take(self, at_s: float, told: Health | NodeTold) -> None:
        """Takes what a node tells."""
        if isinstance(told, Health):
            self._health.setdefault(told.node, _Course()).note(at_s, told)
        else:
            self._told.setdefault(told.name, _Course()).note(at_s, told)

    def forget(self, at_s: float) -> None:
        """Forgets what was told before, but for what each of them had told last by ``at_s``."""
        for course in (*self._health.values(), *self._told.values()):
            course.forget(at_s)

    @property
    def health(self) -> list[tuple[float, Health]]:
        """What they said of their health, and when, in order."""
        said = (pair for course in self._health.values() for pair in zip(course.times, course.told, strict=True))
        return sorted(said, key=lambda pair: pair[0])

    @property
    def told(self) -> Mapping[str, Sequence[tuple[float, NodeTold]]]:
        """What each of them told on /diagnostics, and when, in order."""
        return {name: list(zip(course.times, course.told, strict=True)) for name, course in self._told.items()}

    @property
    def machines(self) -> Mapping[str, str]:
        """The machines of the nodes that have told theirs."""
        return {name: course.told[-1].values.get("machine", "") for name, course in self._told.items()}

    def at(self, now: float, fates: Mapping[str, Any]) -> tuple[NodeStatus, ...]:
        """How they were at ``now``. ``fates`` is how they fared in the end, for those of the inline runner."""
        if not self._told:
            return tuple(self._inline(now, name, fates.get(name, {})) for name in fates or self._names)
        roll = RollCall(dict.fromkeys(self._names, ""))
        for name in self._names:
            told, health = self._said(self._told, name, now), self._said(self._health, name, now)
            if told is not None:
                roll.note(name, told[1].values, told[0])
            if health is not None:
                roll.note_health(health[1], now)  # said again and again, kept once
        return tuple(roll.statuses(now))

    def _inline(self, now: float, name: str, fate: Mapping[str, Any]) -> NodeStatus:
        health = self._said(self._health, name, now)
        said = health[1] if health is not None else None
        return NodeStatus(
            name,
            state="active",
            heard_s=0.0,
            health=said.state if said else "",
            reason=said.reason if said else "",
            silent=said.silent if said else (),
            failures=fate.get("failures", 0),
            first_failure=fate.get("first_failure", ""),
        )

    @staticmethod
    def _said(courses: Mapping[str, _Course[T]], name: str, now: float) -> tuple[float, T] | None:
        course = courses.get(name)
        return None if course is None else course.before(now)


class PlanView(msgspec.Struct, frozen=True):
    """A plan that an agent has considered for an event, and how often it was chosen."""

    label: str
    chosen: int
    rejected: int


class AgentView(msgspec.Struct, frozen=True):
    """An agent: the name in the records, what people call it, and its plans."""

    name: str
    called: str
    plans: tuple[PlanView, ...]


class Has(msgspec.Struct, frozen=True):
    """What there is to show; ``commands``: whether agents may be asked for something, and ``why_not``."""

    pictures: bool
    world: bool
    trees: bool
    commands: bool
    why_not: str


class Overview(msgspec.Struct, frozen=True):
    """A run in short. A page of its record opens at ``opens_s``, where there is something to see.

    It began at ``began_s`` (s since 1970, where its time is not simulated). Of one that has
    been live for long what was before ``since_s`` is forgotten.
    """

    title: str
    live: bool
    began_s: float
    since_s: float
    duration_s: float
    opens_s: float
    agents: tuple[AgentView, ...]
    graph: GraphView
    has: Has
    results: Mapping[str, Any]


def overview(run: Run, office: Office) -> Overview:
    """``run`` in short; ``office`` takes what people ask of agents."""
    end = run.end
    return Overview(
        title=run.title,
        live=run.live,
        began_s=run.history.start / SECOND,
        since_s=run.history.seconds(run.history.since),
        duration_s=run.history.seconds(end),
        opens_s=_opens_s(run.history),
        agents=tuple(_agents(run)),
        graph=run.graph(),
        has=Has(
            pictures=run.sees,
            world=run.world(end) is not None,
            trees=any(record.kind == "plan_start" for record in run.history),
            commands=not office.shut,
            why_not=office.shut,
        ),
        results=run.results,
    )


def _opens_s(history: History) -> float:
    """When the first word was said (s), where none was when something was done first, else the start."""
    done = (each for each in history if each.kind in ("action", "step"))
    first = next((each for each in history if each.kind == "utterance"), None) or next(done, None)
    return history.seconds(first.stamp) if first is not None else 0.0


def _agents(run: Run) -> Iterator[AgentView]:
    """Those that have done something in the order in which they did, and those of which nothing is known yet."""
    chosen: dict[tuple[str, str], int] = {}
    rejected: dict[tuple[str, str], int] = {}
    for record in run.history:
        if record.kind == "plan":
            key = (record.source, plan_name(record))
            chosen[key] = chosen.get(key, 0) + 1
        found = record.detail.get("rejected")
        for each in found if isinstance(found, (list, tuple)) else ():
            key = (record.source, str(each.get("plan", "")))
            rejected[key] = rejected.get(key, 0) + 1
    known = dict.fromkeys([*chosen, *rejected])
    silent = (node.name for node in run.graph().nodes if node.agent)
    for name in dict.fromkeys((*run.history.agents, *silent)):
        plans = (
            PlanView(label, chosen.get((agent, label), 0), rejected.get((agent, label), 0))
            for agent, label in known
            if agent == name
        )
        yield AgentView(name, run.wording.name(name), tuple(plans))
