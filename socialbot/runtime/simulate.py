"""A graph of agents with its world, run until nobody wants anything more, or the world has nothing more to show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec

from socialbot.agents.hospital.result import MissionMonitor, ward_in
from socialbot.bags.writer import BagWriter
from socialbot.bridge.graph_observer import LatestStatistics, await_graph, expect_free_names, observe_graph
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.core.messages import AgentCommand, Health, Message, TraceRecord
from socialbot.core.process import Ending
from socialbot.core.registry import recorded_types
from socialbot.deliberation.messages import AgentReply, AgentRequest, DesireSet, PlanExecutionInfo
from socialbot.graph.files import dump_graph
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph
from socialbot.runs.record import (
    NOTHING_SHOWN,
    NOTHING_WANTED,
    RECORDED,
    STOPPED,
    TIME_UP,
    Observer,
    versions,
    with_event_log,
)
from socialbot.runtime.launch import Launch
from socialbot.runtime.replay import BAG_GRAPH, GRAPH_TIMEOUT_S, Fate, keep_speech, parameters_of, ros_fates

STEP_S = 0.1
"""So much time passes between two looks at whether the run is over."""

QUIET_S = 3.0
"""A run is over when nobody has wanted anything for so long, or nothing has been shown."""


@dataclass(frozen=True)
class Run:
    """What to run, and how. ``rate`` is how many times as fast as real time, 0 as fast as it can."""

    graph: Graph
    runner: Literal["inline", "ros"] = "inline"
    composed: bool = False
    rate: float = 0.0
    limit_s: float = 1800.0


@dataclass
class RunResult:
    """How a run went: for how long (s, simulated and real), why it ended, and how the nodes fared."""

    seconds: float = 0.0
    wall_s: float = 0.0
    ended: str = ""
    fates: dict[str, Fate] = field(default_factory=dict)


class Left(Protocol):
    """Knows whether anything is left to do in a run, by its messages."""

    def observe(self, message: Message) -> None:
        """Takes a message of the run."""
        ...

    def are_over(self, now: int) -> bool:
        """Whether nothing is left to do at ``now`` (ns)."""
        ...


class Wishes:
    """Knows whether anybody still wants something, by what agents tell of their desires."""

    def __init__(self) -> None:
        self._wanted: dict[str, bool] = {}
        self._quiet_since: int | None = None
        self._any = False

    def observe(self, message: Message) -> None:
        """Takes a message of the run."""
        if not isinstance(message, DesireSet):
            return
        self._wanted[message.agent_id] = bool(message.value)
        self._any = self._any or bool(message.value)
        if any(self._wanted.values()):
            self._quiet_since = None
        elif self._any and self._quiet_since is None:
            self._quiet_since = message.stamp

    def are_over(self, now: int) -> bool:
        """Whether nobody has wanted anything for `QUIET_S`."""
        return self._quiet_since is not None and now - self._quiet_since >= nanoseconds(QUIET_S)


class Worlds:
    """Knows whether there is anything more to see, by what the nodes ``names`` that stand for the world say."""

    def __init__(self, names: frozenset[str]) -> None:
        self._going_on = set(names)
        self._ended: int | None = None

    def observe(self, message: Message) -> None:
        """Takes a message of the run."""
        if not isinstance(message, Health) or message.node not in self._going_on:
            return
        if message.state == "ended":
            self._going_on.discard(message.node)
            self._ended = message.stamp

    def are_over(self, now: int) -> bool:
        """Whether all of them ended `QUIET_S` ago."""
        return not self._going_on and self._ended is not None and now - self._ended >= nanoseconds(QUIET_S)


def run(what: Run, folder: Path, observe: Observer, *, bag: Path | None = None) -> RunResult:
    """Runs a graph until nothing is left to do (`left_in`), its time is up, or SIGINT or SIGTERM comes.

    ``observe`` gets the messages of `watched`, and as records what they tell. With ``bag`` what `replayable` lists is
    recorded there; what is said is kept in ``folder``, and not played. Raises NodeError when a node fails over ROS.
    """
    what = replace(what, graph=keep_speech(what.graph, folder, playback="off"))
    ran, left, tell = RunResult(), left_in(what.graph), with_event_log(what.graph, observe)

    def note(topic: str, message: Message) -> None:
        left.observe(message)
        tell(topic, message)

    finished = NOTHING_SHOWN if isinstance(left, Worlds) else NOTHING_WANTED
    carry_out = _inline if what.runner == "inline" else _over_ros
    with _recording(what.graph, bag, note) as seen, Ending().on_signals() as ending:

        def go_on(advance: Callable[[], int], start: int) -> None:
            begun = time.monotonic()
            ran.ended = TIME_UP
            now = start
            while now - start < nanoseconds(what.limit_s):
                if ending.asked or left.are_over(now):
                    ran.ended = STOPPED if ending.asked else finished
                    break
                now = advance()
                ran.seconds, ran.wall_s = (now - start) / SECOND, time.monotonic() - begun
                if what.rate:
                    time.sleep(max(0.0, ran.seconds / what.rate - ran.wall_s))

        ran.fates = carry_out(what, folder, seen, go_on)
    return ran


def left_in(graph: Graph) -> Left:
    """What knows whether anything is left to do in a run of ``graph``: of infected rooms, of desires, or to be seen."""
    ward = ward_in(graph)
    if ward is not None:
        return MissionMonitor(ward)
    worlds = frozenset(placement.name for placement in graph.placements if placement.type.is_simulator)
    wanted = any(issubclass(kind, DesireSet) for kind in graph.topics().values())
    return Worlds(worlds) if worlds and not wanted else Wishes()


def results_of(what: Run, ran: RunResult, summary: Mapping[str, Any]) -> dict[str, Any]:
    """What came of a run, for results.json: its ``summary``, and how it was run."""
    return {
        "schema": "socialbot/results",
        "version": 1,
        "graph": what.graph.name,
        "runner": what.runner,
        "composed": what.composed,
        "parameters": parameters_of(what.graph),
        "ended": ran.ended,
        **summary,
        "nodes": {name: msgspec.to_builtins(fate) for name, fate in ran.fates.items()},
        "simulated_s": round(ran.seconds, 3),
        "wall_s": round(ran.wall_s, 3),
        "versions": versions(),
    }


def watched(graph: Graph) -> dict[str, type[Message]]:
    """The topics that a run is told by: what it is made of, plans, desires, and what is recorded for replays.

    Where a world says how it fares when it has ended, that too.
    """
    kinds = (*RECORDED, PlanExecutionInfo, DesireSet)
    told = {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, kinds)}
    ended: dict[str, type[Message]] = {HEALTH_TOPIC: Health} if isinstance(left_in(graph), Worlds) else {}
    return {**told, **replayable(graph), **ended}


def replayable(graph: Graph) -> dict[str, type[Message]]:
    """The topics that a bag needs for a replay: what the world says and is told, what agents say, and the traces."""
    worldly = {
        topic
        for placement in graph.placements
        if placement.type.is_simulator
        for topic, _ in (*placement.publications, *placement.subscriptions)
    }
    kinds = (TraceRecord, AgentRequest, AgentReply, AgentCommand, *recorded_types(graph))
    return {topic: kind for topic, kind in graph.topics().items() if topic in worldly or issubclass(kind, kinds)}


GoOn = Callable[[Callable[[], int], int], None]
"""Lets time pass until the end; takes how to let some pass, which returns the time (ns), and the time at the start."""


def _inline(what: Run, folder: Path, observe: Observer, go_on: GoOn) -> dict[str, Fate]:
    runner = InlineRunner(what.graph, start=SECOND)
    for topic in watched(what.graph):
        runner.tap(topic, observe)

    def advance() -> int:
        runner.advance(runner.clock.now() + nanoseconds(STEP_S))
        return runner.clock.now()

    try:
        runner.start()
        go_on(advance, runner.clock.now())
    finally:
        runner.close()
    return {name: Fate(faults.calls, faults.failures, faults.first) for name, faults in runner.faults.items()}


def _over_ros(what: Run, folder: Path, observe: Observer, go_on: GoOn) -> dict[str, Fate]:
    from socialbot.bridge.sim_clock import SimClock

    graph, fates, logs = what.graph, LatestStatistics(what.graph), folder / "log"
    with observe_graph(watched(graph), observe, fates.note, graph.wire) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, logs, sim_time=True, composed=what.composed) as launch:
            keeper = SimClock(onlooker.ros, [placement.name for placement in graph.placements])

            def ended() -> bool:
                launch.check()
                return False

            connections = onlooker.connections(graph)
            missing = await_graph(onlooker.ros, graph, connections, timeout_s=GRAPH_TIMEOUT_S, ended=ended)
            if missing:
                raise NodeError(
                    f"the graph does not stand after {GRAPH_TIMEOUT_S:.0f} s; missing {'; '.join(missing)}",
                    remedy="look into the nodes' logs in the folder of the run",
                )

            def advance() -> int:
                launch.check()
                keeper.advance(STEP_S)
                return keeper.now

            go_on(advance, keeper.now)
    return ros_fates(fates)


@contextmanager
def _recording(graph: Graph, path: Path | None, observe: Observer) -> Iterator[Observer]:
    """``observe``, which also writes what it gets into a bag where there is to be one."""
    if path is None:
        yield observe
        return
    topics: Mapping[str, type[Message]] = replayable(graph)
    with BagWriter(path, compressed=True) as bag:

        def write(topic: str, message: Message) -> None:
            if topic in topics:
                bag.write(topic, message, message.stamp)
            observe(topic, message)

        yield write
    try:
        (path / BAG_GRAPH).write_text(dump_graph(graph), encoding="utf-8")
    except OSError as error:
        raise SocialbotError(f"cannot be written: {error.strerror}", where=str(path / BAG_GRAPH)) from error
