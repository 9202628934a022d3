"""Live view of a run in progress."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Health, Message
from socialbot.graph.node import Graph
from socialbot.runs.history import History
from socialbot.runs.record import NodeReport, trace_record
from socialbot.runs.run import ImageSource, Picture, RunView
from socialbot.runs.timeline import Timeline

LOOKS_BACK_S = 3600.0
MOST_RECORDS = 100_000

LATER_S = 300.0  # step size (s) in which old items are dropped
RECENT = 9  # number of stamps whose median is the current time; a single wrong stamp has no effect


class LiveRun(RunView):
    """Live run of ``graph``. `observe` and `note_node` may be called from any thread, all else from one thread.

    Messages are processed when the run is read, so read it regularly. Items older than `LOOKS_BACK_S` are dropped, and
    the older half of more than `MOST_RECORDS` records; current items are kept.
    """

    live = True

    def __init__(self, graph: Graph, images: ImageSource | None = None) -> None:
        super().__init__(graph, History(), images)
        self._timeline = Timeline(self._history, self.wording)
        self._received: deque[tuple[str, Message | NodeReport]] = deque()
        self._end = 0
        self._recent: deque[int] = deque(maxlen=RECENT)
        self._forgot = 0

    # Inputs, from any thread

    def observe(self, topic: str, message: Message) -> None:
        self._received.append((topic, message))

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        self._received.append(("", NodeReport(stamp, name, values)))

    # Views, from one thread

    @property
    def end(self) -> int:
        """Stamp (ns) of the newest message; 0 before the first record."""
        history = self.history
        return max(self._end, history.end) if history else 0

    def picture(self, stamp: int) -> Picture | None:
        return super().picture(stamp or self._end)

    def _update(self) -> None:
        while self._received:
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
        self._states.forget(history.until(back))
        history.hide(back)
        self._timeline.forget(back)
        self.node_history.forget(history.seconds(back))
        if self.world_view is not None:
            self.world_view.forget(back)
