"""Recorded or live run, with its node history and its overview for the page."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import msgspec

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import AgentAnswer, Command, Health, Message
from socialbot.core.registry import phrases_of, world_view_of
from socialbot.graph.node import Graph
from socialbot.graph.status import NodeStatus, NodeStatuses
from socialbot.graph.wizard import WizardKey
from socialbot.runs.history import MOST_BYTES, History, size_of
from socialbot.runs.narration import Wording, plan_name, rejected_plans
from socialbot.runs.plan_trees import PlanTree, trees_at
from socialbot.runs.record import NodeReport, trace_record
from socialbot.runs.state import StateIndex
from socialbot.runs.timeline import Timeline, timeline_of
from socialbot.runs.tracks import forget

T = TypeVar("T")


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
    """Node of a graph with its machine (empty if unknown) and topics; an ``agent`` has a mind.

    A bag or a simulator took the place of a ``replaced`` node.
    """

    name: str
    type: str
    machine: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    agent: bool
    replaced: bool = False


class GraphView(msgspec.Struct, frozen=True):
    """Nodes of a graph, message types by topic, and the keys of the person behind the scenes."""

    nodes: tuple[NodeView, ...] = ()
    topics: Mapping[str, str] = {}
    wizard: tuple[WizardKey, ...] = ()


class RunView:
    """Recorded or live run of ``graph`` (None if unknown). All stamps are ns."""

    live = False

    def __init__(self, graph: Graph | None, history: History, images: ImageSource | None) -> None:
        self.graph = graph
        self.results: Mapping[str, Any] = {}
        """Content of results.json; empty for a live run."""
        self.wording = wording_of(graph)
        self.world_view = None if graph is None else world_view_of(graph)
        self.node_history = NodeHistory([each.name for each in graph.nodes] if graph else [])
        self._history = history
        self.images = images
        self._states = StateIndex(history, self.wording)

    @property
    def problems(self) -> Sequence[str]:
        """Warnings about this run, such as missing records; empty for a complete run."""
        return ()

    @property
    def title(self) -> str:
        return self.graph.name.capitalize() if self.graph is not None else ""

    @property
    def history(self) -> History:
        self._update()
        return self._history

    @property
    def end(self) -> int:
        return self.history.end

    @property
    def has_images(self) -> bool:
        return self.images is not None

    @property
    def states(self) -> StateIndex:
        self._update()
        return self._states

    @property
    def timeline(self) -> Timeline:
        self._update()
        return self._timeline

    @cached_property
    def rules(self) -> Mapping[str, Sequence[str]]:
        """Texts of the rules of each agent as they are now; empty without a graph, or if an agent cannot be created."""
        from socialbot.runs.agent_rules import rules_of  # the engine takes long to import

        try:
            found = {} if self.graph is None else rules_of(self.graph)
        except SocialbotError:
            return {}
        return {agent: [str(plan) for plan in plans] for agent, plans in found.items()}

    @cached_property
    def _timeline(self) -> Timeline:
        return timeline_of(self._history, self.wording)

    def picture(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp``."""
        return None if self.images is None else self.images.at(stamp)

    def sound(self, name: str) -> bytes | None:
        """Return a sound file of an utterance by its name; None if it is not kept."""
        return None

    def world(self, stamp: int) -> str | None:
        """Return the world at ``stamp`` as SVG."""
        self._update()
        return self.world_view.picture(stamp, "") if self.world_view else None

    def trees(self, stamp: int) -> tuple[PlanTree, ...]:
        return trees_at(self.history, stamp, self.wording)

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]:
        if self.graph is None:
            return ()
        return self.node_history.at(self.history.seconds(stamp), self.results.get("nodes", {}))

    def graph_view(self) -> GraphView:
        """Return the nodes with their machines, and the topics."""
        if self.graph is None:
            return GraphView()
        self._update()
        ran = self.results.get("nodes", {}) if "bag" in self.results else {}
        nodes = tuple(
            NodeView(
                each.name,
                each.type.__name__,
                self.node_history.machine(each.name),
                tuple(topic for topic, _ in each.subscriptions),
                tuple(topic for topic, _ in each.publications),
                each.type.is_agent,
                bool(ran) and each.name not in ran,
            )
            for each in self.graph.nodes
        )
        return GraphView(
            nodes, {topic: kind.__name__ for topic, kind in sorted(self.graph.topics().items())}, self.graph.wizard
        )

    def _update(self) -> None:
        """Process pending messages."""


LOOKS_BACK_S = 3600.0
MOST_RECORDS = 100_000
LONGEST_RECORD = 1 << 18
"""Most bytes of a record, so that the last ones, which are dropped many at once, take little memory."""

LATER_S = 300.0  # step size (s) in which old items are dropped
RECENT = 9  # number of stamps whose median is the current time; a single wrong stamp has no effect


class LiveRun(RunView):
    """Live run of ``graph``. `observe` and `note_node` may be called from any thread, all else from one thread.

    Messages are processed when the run is read, so read it regularly. Items older than `LOOKS_BACK_S` are dropped, and
    the older half of more than `MOST_RECORDS` records or `MOST_BYTES`; current items are kept. A record longer than
    `LONGEST_RECORD` is left out.
    """

    live = True

    def __init__(self, graph: Graph, images: ImageSource | None = None) -> None:
        super().__init__(graph, History(), images)
        self._timeline = Timeline(self._history, self.wording)
        self._received: deque[tuple[str, Message | NodeReport]] = deque()
        self._end = 0
        self._recent: deque[int] = deque(maxlen=RECENT)
        self._forgot = 0
        self._bytes = 0
        self._left_out = 0
        self._problem = ""

    @property
    def problems(self) -> list[str]:
        found = [self._problem] if self._problem else []
        if self._left_out:
            found.append(f"records longer than {LONGEST_RECORD} bytes are on disk only: {self._left_out}")
        return found

    # Inputs, from any thread

    def observe(self, topic: str, message: Message) -> None:
        self._received.append((topic, message))

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        self._received.append(("", NodeReport(stamp, name, values)))

    def note_problem(self, text: str) -> None:
        self._problem = text

    # Views, from one thread

    @property
    def end(self) -> int:
        """Stamp (ns) of the newest message; 0 before the first record."""
        history = self.history
        return max(self._end, history.end) if history else 0

    def picture(self, stamp: int) -> Picture | None:
        return super().picture(stamp or self._end)

    def _update(self) -> None:
        for _ in range(len(self._received)):  # those that arrive meanwhile wait, or a flood would never let go
            topic, message = self._received.popleft()
            self._end = max(self._end, message.stamp)
            self._recent.append(message.stamp)
            if isinstance(message, (NodeReport, Health)):
                if self._history:  # time begins with the first record
                    self.node_history.take(self._history.seconds(message.stamp), message)
                continue
            record = trace_record(topic, message)
            if record is None:
                if self.world_view is not None:
                    self.world_view.take(message)
                continue
            size = size_of(record)
            if size > LONGEST_RECORD:
                self._left_out += 1
                continue
            self._bytes += size
            self._history.append(record)
            self._timeline.take(record)
        self._forget()

    def _forget(self) -> None:
        history = self._history
        now = sorted(self._recent)[len(self._recent) // 2] if self._recent else 0
        back = now - nanoseconds(LOOKS_BACK_S)
        if len(history) > MOST_RECORDS or self._bytes > MOST_BYTES:
            back = max(back, history[len(history) // 2].stamp)
        elif abs(now - self._forgot) < nanoseconds(LATER_S):
            return
        self._forgot = now
        self._states.forget(history.until(back))
        self._bytes = sum(map(size_of, history))
        history.hide(back)
        self._timeline.forget(back)
        self.node_history.forget(history.seconds(back))
        if self.world_view is not None:
            self.world_view.forget(back)


def wording_of(graph: Graph | None) -> Wording:
    """Return the names and phrases for a graph; nodes that share a display name keep their own."""
    displayed = {each.name: each.type.display_name for each in graph.nodes} if graph is not None else {}
    count = Counter(displayed.values())
    return Wording({name: text for name, text in displayed.items() if text and count[text] == 1}, phrases_of(graph))


def node_views(run: RunView, stamp: int) -> list[dict[str, Any]]:
    """Return the status of the nodes at ``stamp`` (ns) as plain data."""
    return [
        {**msgspec.to_builtins(each), "condition": each.condition, "well": each.is_well} for each in run.nodes(stamp)
    ]


class CommandSender(Protocol):
    """Sends commands of people to agents."""

    @property
    def shut(self) -> str:
        """Reason to refuse commands; empty if accepted."""
        ...

    async def ask(self, agent: str, command: Command, text: str) -> AgentAnswer | None:
        """Send a command and return the answer; None without one."""
        ...

    async def say(self, text: str) -> str:
        """Have the robot say a sentence; return the reason of a refusal, or an empty text."""
        ...


@dataclass(frozen=True)
class NoCommands:
    """Command client that refuses all commands."""

    shut: str

    async def ask(self, agent: str, command: Command, text: str) -> None: ...

    async def say(self, text: str) -> str:
        return self.shut


class NodeHistory:
    """Health and diagnostics of the nodes called ``names``, by time. Times are seconds from the start."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._health: dict[str, list[tuple[float, Health]]] = {}
        self.reports: dict[str, list[tuple[float, NodeReport]]] = {}
        """Diagnostics of each node."""

    def take(self, at_s: float, message: Health | NodeReport) -> None:
        if isinstance(message, Health):
            insort(self._health.setdefault(message.node, []), (at_s, message), key=_time)
        else:
            insort(self.reports.setdefault(message.name, []), (at_s, message), key=_time)

    def forget(self, at_s: float) -> None:
        """Drop reports before ``at_s``, except for the latest one of each node."""
        for track in (*self._health.values(), *self.reports.values()):
            forget(track, at_s)  # type: ignore[arg-type]

    @property
    def health(self) -> list[tuple[float, Health]]:
        """Changes of health, in order."""
        return sorted((pair for track in self._health.values() for pair in track), key=_time)

    def machine(self, name: str) -> str:
        return self.reports[name][-1][1].values.get("machine", "") if name in self.reports else ""

    def at(self, now: float, results: Mapping[str, Any]) -> tuple[NodeStatus, ...]:
        """Return the status of the nodes at ``now``. ``results`` holds the totals of an inline run."""
        if not self.reports:
            inline = [self._inline(now, name, results.get(name, {})) for name in results or self._names]
            return self._excused(inline, now)
        roll = NodeStatuses(dict.fromkeys(self._names, ""))
        for name in self._names:
            if report := _latest(self.reports.get(name, []), now):
                roll.note(name, report[1].values, report[0])
            if health := _latest(self._health.get(name, []), now):
                roll.note_health(health[1], now)  # repeated reports are stored once
        return self._excused(roll.statuses(now), now)

    def _excused(self, statuses: Iterable[NodeStatus], now: float) -> tuple[NodeStatus, ...]:
        """Call no node silent whose inputs come from a recording that is over, directly or through other nodes."""
        found = {each.name: each for each in statuses}
        reported = {name: latest[1] for name, track in self._health.items() if (latest := _latest(track, now))}
        over = {topic for health in reported.values() if health.state == "ended" for topic in health.outputs}
        waiting = [each for each in found.values() if each.silent] if over else []
        while excused := [each for each in waiting if over.issuperset(each.silent)]:
            for each in excused:
                waiting.remove(each)
                found[each.name] = replace(each, health="ended", reason="the recording is over", silent=())
                over.update(reported[each.name].outputs if each.name in reported else ())
        return tuple(found.values())

    def _inline(self, now: float, name: str, result: Mapping[str, Any]) -> NodeStatus:
        latest = _latest(self._health.get(name, []), now)
        health = latest[1] if latest else None
        return NodeStatus(
            name,
            state="active",
            heard_s=0.0,
            health=health.state if health else "",
            reason=health.reason if health else "",
            silent=health.silent if health else (),
            failures=result.get("failures", 0),
            first_failure=result.get("first_failure", ""),
        )


def _time(moment: tuple[float, Any]) -> float:
    return moment[0]


def _latest(track: Sequence[tuple[float, T]], now: float) -> tuple[float, T] | None:
    place = bisect_right(track, now, key=_time)
    return track[place - 1] if place else None


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

    ``began_s`` is in s since 1970 unless time is simulated. Everything before ``since_s`` was dropped. ``problems``
    are texts about a run that was stopped, failed or is damaged.
    """

    title: str
    problems: Sequence[str]
    live: bool
    began_s: float
    since_s: float
    duration_s: float
    opens_s: float
    agents: tuple[AgentView, ...]
    graph: GraphView
    has: Has
    results: Mapping[str, Any]


def overview(run: RunView, commands: CommandSender) -> Overview:
    """Return the overview of ``run``."""
    end = run.end
    return Overview(
        title=run.title,
        problems=run.problems,
        live=run.live,
        began_s=run.history.start / SECOND,
        since_s=run.history.seconds(run.history.since),
        duration_s=run.history.seconds(end),
        opens_s=_opens_s(run.history),
        agents=tuple(_agents(run)),
        graph=run.graph_view(),
        has=Has(
            pictures=run.has_images,
            world=run.world(end) is not None,
            trees=any(record.kind == "plan_start" for record in run.history),
            commands=not commands.shut,
            why_not=commands.shut,
        ),
        results=run.results,
    )


def _opens_s(history: History) -> float:
    """Return the time (s) of the first utterance, or else of the first action, or else the start."""
    done = (each for each in history if each.kind in ("action", "step"))
    first = next((each for each in history if each.kind == "utterance"), None) or next(done, None)
    return history.seconds(first.stamp) if first is not None else 0.0


def _agents(run: RunView) -> Iterator[AgentView]:
    chosen: Counter[tuple[str, str]] = Counter()
    rejected: Counter[tuple[str, str]] = Counter()
    for record in run.history:
        if record.kind == "plan":
            chosen[record.source, plan_name(record)] += 1
        rejected.update((record.source, plan) for plan, _ in rejected_plans(record))
    known = dict.fromkeys([*chosen, *rejected])
    without_records = (node.name for node in run.graph_view().nodes if node.agent)
    for name in dict.fromkeys((*run.history.agents, *without_records)):
        plans = (PlanView(plan, chosen[name, plan], rejected[name, plan]) for agent, plan in known if agent == name)
        yield AgentView(name, run.wording.name(name), tuple(plans))
