"""Run agents in a simulated world until they finish."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import AgentCommand, CompressedImage, Health, Message, TraceRecord
from socialbot.core.paths import writing
from socialbot.core.registry import CompletionCheck, completion_of, recorded_types
from socialbot.deliberation.messages import AgentReply, AgentRequest, DesireSet, LifecycleStatus, PlanExecutionInfo
from socialbot.graph.files import dump_graph
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs.record import NOTHING_SHOWN, NOTHING_WANTED, RECORDED, STOPPED, TIME_UP, world_view_topics
from socialbot.runtime.bag_source import BAG_GRAPH
from socialbot.runtime.run import Execution, Runner, RunSource, with_speech_files

STEP_S = 0.1  # simulated interval between completion checks
QUIET_S = 3.0  # time for messages on their way, after the agents or all simulators have ended


class DesiresDone:
    """Completion check: all desires have ended, and no agent is at work, for `QUIET_S`.

    An agent is at work while it has a desire, stops a plan, misses a sensor, or states as the reason of its lifecycle
    status what it waits for.
    """

    def __init__(self) -> None:
        self._busy: set[tuple[str, type[Message]]] = set()
        self._quiet_since: int | None = None
        self._any = False

    def observe(self, message: Message) -> None:
        if isinstance(message, DesireSet):
            busy = bool(message.value)
            self._any = self._any or busy
        elif isinstance(message, LifecycleStatus):
            busy = message.status in ("ABORTING", "PAUSED") or (message.status == "SCHEDULING" and bool(message.reason))
        else:
            return
        key = message.agent_id, type(message)
        (self._busy.add if busy else self._busy.discard)(key)
        if self._busy:
            self._quiet_since = None
        elif self._any and self._quiet_since is None:
            self._quiet_since = message.stamp

    def are_over(self, now: int) -> bool:
        return self._quiet_since is not None and now - self._quiet_since >= nanoseconds(QUIET_S)


class SimulatorsDone:
    """Completion check: all simulators (``names``) ended `QUIET_S` ago."""

    def __init__(self, names: frozenset[str]) -> None:
        self._active = set(names)
        self._ended: int | None = None

    def observe(self, message: Message) -> None:
        if isinstance(message, Health) and message.node in self._active and message.state == "ended":
            self._active.discard(message.node)
            self._ended = message.stamp

    def are_over(self, now: int) -> bool:
        return not self._active and self._ended is not None and now - self._ended >= nanoseconds(QUIET_S)


def completion_check(graph: Graph) -> CompletionCheck:
    """Return the completion check of a simulation, by its simulators or its agents' desires."""
    found = completion_of(graph)
    if found is not None:
        return found
    simulators = frozenset(config.name for config in graph.nodes if config.type.is_simulator)
    has_desires = any(issubclass(kind, DesireSet) for kind in graph.topics().values())
    return SimulatorsDone(simulators) if simulators and not has_desires else DesiresDone()


@dataclass
class SimulatedSource(RunSource):
    """World simulated by the graph itself.

    Attributes:
        rate: Speed as a multiple of real time; 0 is as fast as possible.
        limit_s: Simulated time limit.
        bag: Bag to record for replays.
    """

    rate: float = 0.0
    limit_s: float = 1800.0
    bag: Path | None = None
    _check: CompletionCheck = field(default_factory=DesiresDone, init=False)
    _write: Callable[[str, Message], None] | None = field(default=None, init=False)

    def prepare(self, graph: Graph, runner: Runner, folder: Path) -> Graph:
        graph = graph.with_stand_ins()
        graph.expect_answers()
        self._check = completion_check(graph)
        return with_speech_files(graph, folder, playback="off")

    def observe(self, topic: str, message: Message) -> None:
        if self._write is not None:
            self._write(topic, message)
        self._check.observe(message)

    def execute(self, execution: Execution) -> None:
        topics = simulation_topics(execution.graph)
        with self._recording(execution.graph):
            if execution.runner == "inline":
                with execution.inline(topics, start=SECOND) as runner:

                    def advance() -> int:
                        runner.advance(runner.clock.now() + nanoseconds(STEP_S))
                        return runner.clock.now()

                    runner.start()
                    self._advance(execution, advance, runner.clock.now())
                return
            with execution.processes(topics) as (observer, launch):
                from socialbot.bridge.sim_clock import SimClock

                names = [config.name for config in execution.graph.nodes]
                step_s = clock_step_s(execution.graph)
                clock = SimClock(observer.ros, names, step_s=step_s, subscriptions=observer.subscriptions.values())

                def advance_clock() -> int:
                    launch.check()
                    clock.advance(STEP_S)
                    return clock.now

                execution.await_graph(observer, launch)
                self._advance(execution, advance_clock, clock.now)

    def results(self, execution: Execution) -> dict[str, Any]:
        results: dict[str, Any] = {"simulated_s": round(execution.result.seconds, 3)}
        if self.bag is not None and (topics := image_topics(execution.graph)):
            results["bag"] = {"path": str(self.bag.resolve()), "topics": topics}
        return results

    def _advance(self, execution: Execution, advance: Callable[[], int], start: int) -> None:
        """Call ``advance``, which returns the new time (ns), until completion or the time limit."""
        result, begun, now = execution.result, time.monotonic(), start
        result.ended = TIME_UP
        while now - start < nanoseconds(self.limit_s):
            if execution.ending.asked or self._check.are_over(now):
                finished = NOTHING_SHOWN if isinstance(self._check, SimulatorsDone) else NOTHING_WANTED
                result.ended = STOPPED if execution.ending.asked else finished
                return
            now = advance()
            result.seconds = (now - start) / SECOND
            if self.rate:
                time.sleep(max(0.0, result.seconds / self.rate - (time.monotonic() - begun)))

    @contextmanager
    def _recording(self, graph: Graph) -> Iterator[None]:
        """Record `replay_topics` in the bag, and the graph beside it."""
        if self.bag is None:
            yield
            return
        topics = replay_topics(graph)
        with BagWriter(self.bag, compressed=True) as bag:

            def write(topic: str, message: Message) -> None:
                if topic in topics:
                    bag.write(topic, message, message.stamp)

            self._write = write
            yield
        with writing(self.bag / BAG_GRAPH):
            (self.bag / BAG_GRAPH).write_text(dump_graph(graph), encoding="utf-8")


def clock_step_s(graph: Graph) -> float:
    """Return the step (s) of a simulated clock in which no simulator of ``graph`` acts twice."""
    simulators = (config for config in graph.nodes if config.type.is_simulator)
    longest = (
        config.type.longest_step_s(check_parameters(config.type, config.parameters, where=config.name))
        for config in simulators
    )
    return min((STEP_S, *longest))


def simulation_topics(graph: Graph) -> dict[str, type[Message]]:
    """Return the topics to observe: the trace, `replay_topics`, world view, desires, statuses, end of simulators."""
    kinds = (*RECORDED, PlanExecutionInfo, DesireSet, LifecycleStatus)
    found = {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, kinds)}
    health: dict[str, type[Message]] = {HEALTH_TOPIC: Health}
    return {
        **found,
        **world_view_topics(graph),
        **replay_topics(graph),
        **(health if isinstance(completion_check(graph), SimulatorsDone) else {}),
    }


def image_topics(graph: Graph) -> list[str]:
    """Return the topics of compressed images that simulators of ``graph`` publish."""
    simulators = (config for config in graph.nodes if config.type.is_simulator)
    ports = (each for config in simulators for each in config.publications)
    return [topic for topic, port in ports if issubclass(port.message_type, CompressedImage)]


def replay_topics(graph: Graph) -> dict[str, type[Message]]:
    """Return the topics to record for a replay: simulators, messages between agents, and traces."""
    simulated = {
        topic
        for config in graph.nodes
        if config.type.is_simulator
        for topic, _ in (*config.publications, *config.subscriptions)
    }
    kinds = (TraceRecord, AgentRequest, AgentReply, AgentCommand, *recorded_types(graph))
    return {topic: kind for topic, kind in graph.topics().items() if topic in simulated or issubclass(kind, kinds)}
