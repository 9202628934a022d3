"""Live view of a run in progress."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Health, Message
from socialbot.core.registry import WorldView, world_view_of
from socialbot.graph.node import Graph
from socialbot.graph.status import NodeStatus
from socialbot.runs.folder import wording_of
from socialbot.runs.history import History
from socialbot.runs.narration import Wording
from socialbot.runs.plan_trees import PlanTree, trees_at
from socialbot.runs.record import NodeReport, trace_record
from socialbot.runs.run import GraphView, ImageSource, NodeHistory, Picture, graph_view
from socialbot.runs.state import StateIndex
from socialbot.runs.timeline import Timeline

LOOKS_BACK_S = 3600.0
MOST_RECORDS = 100_000

LATER_S = 300.0
"""Step size (s) in which old items are dropped."""

RECENT = 9
"""Number of stamps whose median is the current time; a single wrong stamp has no effect."""


@dataclass(frozen=True)
class _ReceivedMessage:
    topic: str
    message: Message


class LiveRun:
    """Live run of ``graph``. `observe` and `note_node` may be called from any thread, all else from one thread.

    Messages are processed when the run is read, so read it regularly. Items older than `LOOKS_BACK_S` are dropped, and
    the older half of more than `MOST_RECORDS` records; current items are kept.
    """

    live = True

    def __init__(self, graph: Graph, pictures: ImageSource | None = None) -> None:
        self._graph = graph
        self._pictures = pictures
        self._heard: deque[_ReceivedMessage | NodeReport] = deque()
        self._history = History()
        self._wording = wording_of(graph)
        self._course = StateIndex(self._history, self._wording)
        self._timeline = Timeline(self._history, self._wording)
        self._world: WorldView | None = world_view_of(graph)
        self._nodes = NodeHistory([placement.name for placement in graph.placements])
        self._end = 0
        self._recent: deque[int] = deque(maxlen=RECENT)
        self._forgot = 0

    # Inputs, from any thread

    def observe(self, topic: str, message: Message) -> None:
        self._heard.append(_ReceivedMessage(topic, message))

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        self._heard.append(NodeReport(stamp, name, values))

    # Views, from one thread

    @property
    def title(self) -> str:
        return self._graph.name.capitalize()

    @property
    def results(self) -> Mapping[str, Any]:
        return {}

    @property
    def wording(self) -> Wording:
        return self._wording

    @property
    def history(self) -> History:
        self._listen()
        return self._history

    @property
    def end(self) -> int:
        """Stamp (ns) of the newest message; 0 before the first record."""
        self._listen()
        return max(self._end, self._history.end) if self._history else 0

    @property
    def sees(self) -> bool:
        return self._pictures is not None

    @property
    def course(self) -> StateIndex:
        self._listen()
        return self._course

    @property
    def timeline(self) -> Timeline:
        self._listen()
        return self._timeline

    def picture(self, stamp: int) -> Picture | None:
        return None if self._pictures is None else self._pictures.at(stamp or self._end)

    def world(self, stamp: int) -> str | None:
        self._listen()
        return self._world.picture(stamp, "") if self._world else None

    def trees(self, stamp: int) -> tuple[PlanTree, ...]:
        self._listen()
        return trees_at(self._history, stamp, self._wording)

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]:
        self._listen()
        return self._nodes.at(self._history.seconds(stamp), {})

    def graph(self) -> GraphView:
        self._listen()
        return graph_view(self._graph, self._nodes.machines)

    def _listen(self) -> None:
        heard = self._heard
        while heard:
            each = heard.popleft()
            message = each if isinstance(each, NodeReport) else each.message
            self._end = max(self._end, message.stamp)
            self._recent.append(message.stamp)
            if isinstance(message, (NodeReport, Health)):
                if self._history:  # time begins with the first record
                    self._nodes.take(self._history.seconds(message.stamp), message)
                continue
            assert isinstance(each, _ReceivedMessage)
            record = trace_record(each.topic, message)
            if record is None:
                if self._world is not None:
                    self._world.take(message)
                continue
            self._history.append(record)
            self._timeline.take(record)
        self._forget()

    def _forget(self) -> None:
        history = self._history
        now = sorted(self._recent)[len(self._recent) // 2] if self._recent else 0
        back = now - nanoseconds(LOOKS_BACK_S)
        if len(history) > MOST_RECORDS:
            back = max(back, history[len(history) // 2].stamp)
        elif abs(now - self._forgot) < nanoseconds(LATER_S):
            return
        self._forgot = now
        self._course.forget(history.until(back))
        history.hide(back)
        self._timeline.forget(back)
        self._nodes.forget(history.seconds(back))
        if self._world is not None:
            self._world.forget(back)
