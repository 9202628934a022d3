"""Run the warehouse over DDS in simulated time, which waits for its processes, and collect its messages."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialbot.agents.warehouse.messages import BoxPositions
from socialbot.bridge.graph_observer import LatestStatistics, await_graph, expect_free_names, observe_graph
from socialbot.bridge.sim_clock import SimClock
from socialbot.core.messages import Message, TraceRecord
from socialbot.deliberation.messages import BeliefSet, PlanExecutionInfo
from socialbot.graph.node import Graph
from socialbot.runtime.launch import Launch
from tests.system.running import PATIENCE_S

GRIPPER = "gripper_a"
STEP_S = 0.5
"""Step of the simulated time and period of the world. Each step waits for all processes, so short ones cost most."""
DESIRES = ("desire", "desire_fulfilled", "desire_dropped")
SEEN = (TraceRecord, PlanExecutionInfo, BeliefSet, BoxPositions)


class Seen:
    """Messages received so far."""

    def __init__(self) -> None:
        self.records: list[TraceRecord] = []
        self.infos: list[PlanExecutionInfo] = []
        self.beliefs: dict[str, BeliefSet] = {}
        self.boxes: dict[str, str] = {}

    def observe(self, topic: str, message: Message) -> None:
        match message:
            case TraceRecord():
                self.records.append(message)
            case PlanExecutionInfo():
                self.infos.append(message)
            case BeliefSet():
                self.beliefs[message.agent_id] = message
            case BoxPositions():
                self.boxes = {box.name: box.holder for box in message.boxes}

    def of(self, kind: str, source: str = "", what: str = "", **detail: Any) -> list[TraceRecord]:
        """Records of ``kind``; of all agents and subjects unless given."""
        return [
            record
            for record in self.records
            if record.kind == kind
            and source in ("", record.source)
            and what in ("", record.what)
            and all(record.detail.get(key) == value for key, value in detail.items())
        ]

    def ended(self, desire: str, source: str = GRIPPER) -> str:
        """Record kind with which a desire ended; empty if it has not ended."""
        found = [record.kind for record in self.records if record.source == source and record.what == desire]
        return next((kind for kind in found if kind in ("desire_fulfilled", "desire_dropped")), "")

    def done(self) -> bool:
        """Whether all desires have ended, including the one to sort the boxes."""
        latest = {(record.source, record.what): record.kind for record in self.records if record.kind in DESIRES}
        return latest.get((GRIPPER, "sort_boxes"), "desire") != "desire" and "desire" not in latest.values()

    def plans(self) -> list[Counter[str]]:
        """The actions of each plan of the gripper, by name."""
        starts = self.of("plan_start", GRIPPER)
        return [Counter(step.split("(")[1].split()[0] for step in record.detail["steps"]) for record in starts]

    def story(self) -> str:
        """Text of the main records, for failure messages."""
        kinds = ("desire", "desire_fulfilled", "desire_dropped", "plan_start", "plan_end", "step", "step_end",
                 "planning", "request", "refused", "failure", "silent", "heard")  # fmt: skip
        return "\n".join(
            f"{record.stamp / 1e9:8.2f} {record.source} {record.kind} {record.what} "
            f"{record.detail.get('reason', '')}{record.detail.get('message', '')}"
            for record in self.records
            if record.kind in kinds
        )


@dataclass(frozen=True)
class Live:
    """A running graph: processes, log folder, simulated time and node statistics."""

    folder: Path
    seen: Seen
    ros: Any
    launch: Launch
    statistics: LatestStatistics
    time: SimClock

    def kill(self, node: str) -> None:
        """Kill the process of a node. The simulated time no longer waits for it."""
        self.time.awaited.remove(node)
        os.kill(self.launch.pids[node], signal.SIGKILL)

    def start(self, node: str) -> None:
        """Start the process again. The simulated time waits for it."""
        self.launch.start(node, ["node", "--graph", str(self.folder / "graph.yaml"), "--sim-time", node])
        self.time.awaited.add(node)


@contextmanager
def over_dds(graph: Graph, folder: Path, *, composed: bool = False) -> Iterator[Live]:
    """Bring the graph up to the start of its simulated time."""
    seen, statistics = Seen(), LatestStatistics(graph)
    topics = {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, SEEN)}
    with observe_graph(topics, seen.observe, statistics.note) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, folder, sim_time=True, composed=composed) as launch:
            names = [config.name for config in graph.nodes]
            clock = SimClock(onlooker.ros, names, step_s=STEP_S, subscriptions=onlooker.subscriptions.values())

            def failed() -> bool:
                launch.check()
                return False

            connections = onlooker.connections(graph)
            missing = await_graph(onlooker.ros, graph, connections, timeout_s=PATIENCE_S, ended=failed)
            assert not missing, missing
            yield Live(folder, seen, onlooker.ros, launch, statistics, clock)
