"""Whether a graph stands: which of its connections are not there yet."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from socialbot.graph import Graph

LOOK_AGAIN_S = 0.02
SETTLE_S = 0.3
"""What one participant has discovered, the others may discover a moment later."""


def missing_connections(ros: Any, graph: Graph) -> list[str]:
    """What the rclpy node ``ros`` does not see yet of ``graph``, such as "listener head to /head/command"."""
    return [
        *(
            f"publisher {placement.name} of {topic}"
            for placement in graph.placements
            for topic, _ in placement.publications
            if placement.name not in {info.node_name for info in ros.get_publishers_info_by_topic(topic)}
        ),
        *(
            f"listener {placement.name} to {topic}"
            for placement in graph.placements
            for topic, _ in placement.subscriptions
            if placement.name not in {info.node_name for info in ros.get_subscriptions_info_by_topic(topic)}
        ),
    ]


def await_graph(ros: Any, graph: Graph, *, timeout_s: float, ended: Callable[[], bool]) -> list[str]:
    """Waits until all connections stand, ``ended`` says stop, or the time is over; returns what is missing then."""
    deadline = time.monotonic() + timeout_s
    while (missing := missing_connections(ros, graph)) and time.monotonic() < deadline and not ended():
        time.sleep(LOOK_AGAIN_S)
    if not missing:
        time.sleep(SETTLE_S)
    return missing
