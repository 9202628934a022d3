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
from socialbot.runs.record import NodeReport
from socialbot.runs.state import StateIndex
from socialbot.runs.timeline import Timeline


class Picture(msgspec.Struct, frozen=True):
    """JPEG of a camera with its stamp (ns)."""

    stamp: int
    jpeg: bytes


class ImageSource(Protocol):
    """Images of a run by time."""

    def at(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp`` (ns)."""
        ...


class NodeView(msgspec.Struct, frozen=True):
    """Node of a graph with its machine (empty if unknown) and topics; an ``agent`` has a mind."""

    name: str
    type: str
    machine: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    agent: bool


class GraphView(msgspec.Struct, frozen=True):
    """Nodes of a graph, and message types by topic."""

    nodes: tuple[NodeView, ...] = ()
    topics: Mapping[str, str] = {}


class RunRecords(Protocol):
    """Records of a run with their wording."""

    @property
    def title(self) -> str: ...

    @property
    def history(self) -> History: ...

    @property
    def wording(self) -> Wording: ...

    @property
    def results(self) -> Mapping[str, Any]:
        """Content of results.json; empty for a live run."""
        ...


class RunView(RunRecords, Protocol):
    """Recorded or live run. All stamps are ns."""

    @property
    def live(self) -> bool: ...

    @property
    def end(self) -> int: ...

    @property
    def sees(self) -> bool:
        """Whether there are images."""
        ...

    @property
    def course(self) -> StateIndex: ...

    @property
    def timeline(self) -> Timeline: ...

    def picture(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp``."""
        ...

    def world(self, stamp: int) -> str | None:
        """Return the world at ``stamp`` as SVG."""
        ...

    def trees(self, stamp: int) -> tuple[PlanTree, ...]: ...

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]: ...

    def graph(self) -> GraphView: ...


def graph_view(graph: Graph, machines: Mapping[str, str] | None = None) -> GraphView:
    """Return the nodes and topics of a graph; ``machines`` by node."""
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


def node_views(run: RunView, stamp: int) -> list[dict[str, Any]]:
    """Return the status of the nodes at ``stamp`` (ns) as plain data."""
    return [
        {**msgspec.to_builtins(each), "condition": each.condition, "well": each.is_well} for each in run.nodes(stamp)
    ]


class Answer(Protocol):
    """Answer of an agent to a command."""

    @property
    def accepted(self) -> bool: ...

    @property
    def reason(self) -> str: ...


class CommandSender(Protocol):
    """Sends commands of people to agents."""

    @property
    def shut(self) -> str:
        """Reason to refuse commands; empty if accepted."""
        ...

    async def ask(self, agent: str, command: Command, text: str) -> Answer | None:
        """Send a command and return the answer; None without one."""
        ...


@dataclass(frozen=True)
class NoCommands:
    """Command client that refuses all commands."""

    shut: str

    async def ask(self, agent: str, command: Command, text: str) -> None: ...


T = TypeVar("T")


@dataclass
class _Course(Generic[T]):
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


class NodeHistory:
    """Health and diagnostics of the nodes called ``names``. Times are seconds from the start."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._health: dict[str, _Course[Health]] = {}
        self._told: dict[str, _Course[NodeReport]] = {}

    def take(self, at_s: float, told: Health | NodeReport) -> None:
        if isinstance(told, Health):
            self._health.setdefault(told.node, _Course()).note(at_s, told)
        else:
            self._told.setdefault(told.name, _Course()).note(at_s, told)

    def forget(self, at_s: float) -> None:
        """Drop reports before ``at_s``, except for the latest one of each node."""
        for course in (*self._health.values(), *self._told.values()):
            course.forget(at_s)

    @property
    def health(self) -> list[tuple[float, Health]]:
        """Changes of health with their times, in order."""
        said = (pair for course in self._health.values() for pair in zip(course.times, course.told, strict=True))
        return sorted(said, key=lambda pair: pair[0])

    @property
    def told(self) -> Mapping[str, Sequence[tuple[float, NodeReport]]]:
        """Diagnostics of each node with their times, in order."""
        return {name: list(zip(course.times, course.told, strict=True)) for name, course in self._told.items()}

    @property
    def machines(self) -> Mapping[str, str]:
        return {name: course.told[-1].values.get("machine", "") for name, course in self._told.items()}

    def at(self, now: float, fates: Mapping[str, Any]) -> tuple[NodeStatus, ...]:
        """Return the status of the nodes at ``now``. ``fates`` holds the totals of an inline run."""
        if not self._told:
            return tuple(self._inline(now, name, fates.get(name, {})) for name in fates or self._names)
        roll = RollCall(dict.fromkeys(self._names, ""))
        for name in self._names:
            told, health = self._said(self._told, name, now), self._said(self._health, name, now)
            if told is not None:
                roll.note(name, told[1].values, told[0])
            if health is not None:
                roll.note_health(health[1], now)  # repeated reports are stored once
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
    """Plan that an agent considered, with counts."""

    label: str
    chosen: int
    rejected: int


class AgentView(msgspec.Struct, frozen=True):
    """Agent with its display name and plans."""

    name: str
    called: str
    plans: tuple[PlanView, ...]


class Has(msgspec.Struct, frozen=True):
    """Available views of a run; ``why_not``: why agents take no commands."""

    pictures: bool
    world: bool
    trees: bool
    commands: bool
    why_not: str


class Overview(msgspec.Struct, frozen=True):
    """Summary of a run for the page, which opens at ``opens_s``.

    ``began_s`` is in s since 1970 unless time is simulated. Everything before ``since_s`` was dropped.
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


def overview(run: RunView, office: CommandSender) -> Overview:
    """Return the overview of ``run``."""
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
    """Return the time (s) of the first utterance, or else of the first action, or else the start."""
    done = (each for each in history if each.kind in ("action", "step"))
    first = next((each for each in history if each.kind == "utterance"), None) or next(done, None)
    return history.seconds(first.stamp) if first is not None else 0.0


def _agents(run: RunView) -> Iterator[AgentView]:
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
