"""A run that still goes on: what is heard of it, as it is heard."""

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
from socialbot.runs.record import NodeTold, trace_record
from socialbot.runs.run import GraphView, NodesThen, Picture, Pictures, graph_view
from socialbot.runs.state import Course
from socialbot.runs.timeline import Timeline

LOOKS_BACK_S = 3600.0
MOST_RECORDS = 100_000

LATER_S = 300.0
"""So much more than it looks back it may keep, as to forget takes time."""

RECENT = 9
"""The stamp in the middle of those that came last says what time it is, so that a wrong one has nothing forgotten."""


@dataclass(frozen=True)
class _Heard:
    topic: str
    message: Message


class LiveRun:
    """A run of ``graph``. Any thread may `observe` and `note_node`; all else is for one thread.

    What was heard waits until somebody looks, so that is to be done now and then. A robot may run for weeks: what is
    longer ago than `LOOKS_BACK_S` is forgotten, and of so many records that they are more than `MOST_RECORDS`, the
    older half. What still holds from then is not.
    """

    live = True

    def __init__(self, graph: Graph, pictures: Pictures | None = None) -> None:
        self._graph = graph
        self._pictures = pictures
        self._heard: deque[_Heard | NodeTold] = deque()
        self._history = History()
        self._wording = wording_of(graph)
        self._course = Course(self._history, self._wording)
        self._timeline = Timeline(self._history, self._wording)
        self._world: WorldView | None = world_view_of(graph)
        self._nodes = NodesThen([placement.name for placement in graph.placements])
        self._end = 0
        self._recent: deque[int] = deque(maxlen=RECENT)
        self._forgot = 0

    # What happens, from any thread

    def observe(self, topic: str, message: Message) -> None:
        """Takes a message of the run."""
        self._heard.append(_Heard(topic, message))

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        """Takes what a node tells on /diagnostics at ``stamp`` (ns)."""
        self._heard.append(NodeTold(stamp, name, values))

    # What there is to see, from one thread

    @property
    def title(self) -> str:
        """The name of the graph."""
        return self._graph.name.capitalize()

    @property
    def results(self) -> Mapping[str, Any]:
        """Nothing yet."""
        return {}

    @property
    def wording(self) -> Wording:
        """How it calls things."""
        return self._wording

    @property
    def history(self) -> History:
        """What was heard up to now."""
        self._listen()
        return self._history

    @property
    def end(self) -> int:
        """The stamp (ns) of the newest message; 0 before the first record, with which time begins."""
        self._listen()
        return max(self._end, self._history.end) if self._history else 0

    @property
    def sees(self) -> bool:
        """Whether there are pictures."""
        return self._pictures is not None

    @property
    def course(self) -> Course:
        """What held when."""
        self._listen()
        return self._course

    @property
    def timeline(self) -> Timeline:
        """Everything as bars."""
        self._listen()
        return self._timeline

    def picture(self, stamp: int) -> Picture | None:
        """What the camera saw at ``stamp`` (ns)."""
        return None if self._pictures is None else self._pictures.at(stamp or self._end)

    def world(self, stamp: int) -> str | None:
        """The floor or the ward at ``stamp`` (ns) as SVG."""
        self._listen()
        return self._world.picture(stamp, "") if self._world else None

    def trees(self, stamp: int) -> tuple[PlanTree, ...]:
        """The plans of the agents at ``stamp`` (ns)."""
        self._listen()
        return trees_at(self._history, stamp, self._wording)

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]:
        """How the nodes were at ``stamp`` (ns)."""
        self._listen()
        return self._nodes.at(self._history.seconds(stamp), {})

    def graph(self) -> GraphView:
        """The nodes, and how they are connected."""
        self._listen()
        return graph_view(self._graph, self._nodes.machines)

    def _listen(self) -> None:
        """Takes in what was heard since."""
        heard = self._heard
        while heard:
            each = heard.popleft()
            message = each if isinstance(each, NodeTold) else each.message
            self._end = max(self._end, message.stamp)
            self._recent.append(message.stamp)
            if isinstance(message, (NodeTold, Health)):
                if self._history:  # time begins with the first record
                    self._nodes.take(self._history.seconds(message.stamp), message)
                continue
            assert isinstance(each, _Heard)
            record = trace_record(each.topic, message)
            if record is None:
                if self._world is not None:
                    self._world.take(message)
                continue
            self._history.append(record)
            self._timeline.take(record)
        self._forget()

    def _forget(self) -> None:
        """Forgets what is too long ago."""
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
