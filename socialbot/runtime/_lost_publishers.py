"""Decide whether a process has lost publishers that run, and needs a new DDS participant.

False packets of discovery, in the name of a participant, remove its publishers or subscriptions in another process for
good. Nodes report lost publishers, whose sealed messages they do not receive even after they have subscribed again. A
publisher that does not run, or whose machine cannot be reached, is missed for a better reason.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC
from socialbot.bridge.stream_watch import LOST_S, SILENT_S
from socialbot.graph.health import publishers
from socialbot.graph.node import Graph
from socialbot.graph.status import ACTIVE

FRESH_S = 3.0
"""Longest time (s) between two reports of a running node; on /diagnostics they come once a second."""
STEADY_S = LOST_S + SILENT_S
"""Time (s) after which others should have heard a running node."""
RENEWAL_PAUSE_S = 30.0
"""Shortest life (s) of a participant that is replaced: a flood of false packets goes on."""
LONGEST_PAUSE_S = 300.0
"""Longest such life (s), if replacements before did not help."""


@dataclass
class RunningNodes:
    """Nodes of ``graph`` that run, on all machines."""

    graph: Graph
    clock: Callable[[], float] = time.monotonic
    _seen: dict[str, tuple[float, float]] = field(default_factory=dict, init=False)
    """Since when each node has been active, and its last report."""

    def note(self, node: str, state: str) -> None:
        """Note a report of ``node``. Thread-safe."""
        now = self.clock()
        since, last = self._seen.get(node, (now, now))
        if state == ACTIVE:
            self._seen[node] = (since if now - last <= FRESH_S else now), now
        else:
            self._seen.pop(node, None)

    def lost(self, lost: Mapping[str, int]) -> str:
        """Return a topic of whose publishers, ``lost`` by topic, at least one runs; empty if there is none."""
        for topic, count in lost.items():
            names = self._publishers(topic)
            if count > sum(not self._runs(name) for name in names):
                return topic
        return ""

    def _publishers(self, topic: str) -> list[str]:
        if topic == DIAGNOSTICS_TOPIC:
            return [config.name for config in self.graph.nodes]
        return publishers(self.graph, topic)

    def _runs(self, node: str) -> bool:
        since, last = self._seen.get(node, (0.0, -FRESH_S))
        return last - since >= STEADY_S and self.clock() - last <= FRESH_S


@dataclass(eq=False)
class RenewalBackoff:
    """Pauses between new participants of one process. Each that does not help doubles the next pause."""

    clock: Callable[[], float] = time.monotonic
    _begun: float = field(default=-math.inf, init=False)
    _lost_at: float = field(default=-math.inf, init=False)
    _pause_s: float = field(default_factory=lambda: RENEWAL_PAUSE_S, init=False)

    def started(self) -> None:
        """Note that the process has a new participant."""
        self._begun = self.clock()

    def is_due(self, *, is_lost: bool) -> bool:
        """Whether to renew the participant now, as it has lost a publisher. Call it often."""
        now = self.clock()
        if is_lost:
            self._lost_at = now
        elif now - max(self._begun, self._lost_at) >= RENEWAL_PAUSE_S:
            self._pause_s = RENEWAL_PAUSE_S
        if not is_lost or now - self._begun < self._pause_s:
            return False
        self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)
        return True
