"""The warehouse over DDS in simulated time that waits for its processes, and what is seen of it from outside."""

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
from socialbot.bridge.player import SimClock
from socialbot.core.messages import Message, TraceRecord
from socialbot.deliberation.messages import BeliefSet, PlanExecutionInfo
from socialbot.graph.node import Graph
from socialbot.runtime.launch import Launch

GRIPPER = "gripper_a"
STEP_S = 0.2
"""Time goes in steps of this, as the world reports: most of what a run costs is to tell all processes the time."""
DESIRES = ("desire", "desire_fulfilled", "desire_dropped")
SEEN = (TraceRecord, PlanExecutionInfo, BeliefSet, BoxPositions)


class Seen:
    """What came on the topics so far."""

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
        """The records of a kind, of one agent, about something, with such details."""
        return [
            record
            for record in self.records
            if record.kind == kind
            and source in ("", record.source)
            and what in ("", record.what)
            and all(record.detail.get(key) == value for key, value in detail.items())
        ]

    def ended(self, desire: str, source: str = GRIPPER) -> str:
        """How a desire of an agent has ended; an empty text if it has not."""
        found = [record.kind for record in self.records if record.source == source and record.what == desire]
        return next((kind for kind in found if kind in ("desire_fulfilled", "desire_dropped")), "")

    def done(self) -> bool:
        """Whether all desires that there were have ended, that to sort the boxes among them."""
        latest = {(record.source, record.what): record.kind for record in self.records if record.kind in DESIRES}
        return latest.get((GRIPPER, "sort_boxes"), "desire") != "desire" and "desire" not in latest.values()

    def plans(self) -> list[Counter[str]]:
        """The actions of each plan of the gripper, by name."""
        starts = self.of("plan_start", GRIPPER)
        return [Counter(step.split("(")[1].split()[0] for step in record.detail["steps"]) for record in starts]

    def story(self) -> str:
        """What happened, for whoever has to find out why it went wrong."""
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
    """A graph that runs: its processes, with their logs in ``folder``, its time, and how its nodes fare."""

    folder: Path
    seen: Seen
    ros: Any
    launch: Launch
    fates: LatestStatistics
    time: SimClock

    def kill(self, node: str) -> None:
        """Ends the process of a node as a crash would; the time does not wait for it any more."""
        self.time.awaited.remove(node)
        os.kill(self.launch.pids[node], signal.SIGKILL)

    def start(self, node: str) -> None:
        """Starts it again. The time stands still until it is there."""
        self.launch.start(node, ["node", "--graph", str(self.folder / "graph.yaml"), "--sim-time", node])
        self.time.awaited.add(node)


@contextmanager
def over_dds(graph: Graph, folder: Path, *, composed: bool = False) -> Iterator[Live]:
    """Brings the graph up, in a process a node or one for all, at the moment when its time begins."""
    seen, fates = Seen(), LatestStatistics(graph)
    topics = {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, SEEN)}
    with observe_graph(topics, seen.observe, fates.note) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, folder, sim_time=True, composed=composed) as launch:
            keeper = SimClock(onlooker.ros, [config.name for config in graph.nodes], step_s=STEP_S)

            def failed() -> bool:
                launch.check()
                return False

            connections = onlooker.connections(graph)
            missing = await_graph(onlooker.ros, graph, connections, timeout_s=60.0, ended=failed)
            assert not missing, missing
            yield Live(folder, seen, onlooker.ros, launch, fates, keeper)
