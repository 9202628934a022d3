"""Whether a graph stands: each node tells on /diagnostics which of its connections are not there yet.

That both ends of a connection are known to somebody does not mean that they know each other; what is
published before they do is lost. So every node counts its own peers.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from socialbot.bridge.diagnostics import UNCONNECTED, Connection, DiagnosticsInlet, unconnected
from socialbot.core.errors import NodeError
from socialbot.graph.node import Graph

LOOK_AGAIN_S = 0.02
LOOK_ROUND_S = 0.8
SPEAKS_S = 2.5
"""Every node that is alive says something on /diagnostics within this time."""


class Readiness:
    """Watches, through the rclpy node ``ros``, whether ``graph`` stands."""

    def __init__(self, ros: Any, graph: Graph) -> None:
        self._lacking = dict.fromkeys((placement.name for placement in graph.placements), "everything")
        self._inlet = DiagnosticsInlet(ros, self._note)

    def missing(self) -> list[str]:
        """What is missing, such as "head: /head/command"; empty when the graph stands."""
        return [f"{name}: {lacking}" for name, lacking in self._lacking.items() if lacking]

    def _note(self, name: str, values: Mapping[str, str]) -> None:
        if UNCONNECTED in values and name in self._lacking:
            self._lacking[name] = values[UNCONNECTED]


def await_graph(
    ros: Any,
    graph: Graph,
    own: list[Connection] | None = None,
    *,
    timeout_s: float,
    ended: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Waits until ``graph`` and the caller's ``own`` connections stand, or ``ended`` says stop.

    Returns what is missing when that, or the time, is up.
    """
    readiness = Readiness(ros, graph)
    deadline = time.monotonic() + timeout_s
    while True:
        lacking = unconnected(own or [])
        missing = [*readiness.missing(), *([f"{ros.get_name()}: {lacking}"] if lacking else [])]
        if not missing or ended() or time.monotonic() > deadline:
            return missing
        time.sleep(LOOK_AGAIN_S)


def expect_free_names(ros: Any, graph: Graph, only: Collection[str] | None = None) -> None:
    """Raises NodeError when nodes of these names run in the ROS domain already: both graphs would hear each other.

    ``only`` names those nodes of ``graph`` that are about to be started; without it all are. ``ros`` has to be
    spinning: a node that was killed stays known for a while, but does not speak on /diagnostics any more. With keys
    only who has one counts: a stranger keeps no graph from starting.
    """
    ours = {placement.name for placement in graph.placements if only is None or placement.name in only}
    speaking: set[str] = set()

    def note(name: str, _: Mapping[str, str]) -> None:
        speaking.add(name)

    inlet = DiagnosticsInlet(ros, note)
    begun = time.monotonic()
    look_s = LOOK_ROUND_S
    while time.monotonic() - begun < look_s:
        known = ours & set(ros.get_node_names())
        taken = known & speaking
        if taken:
            raise NodeError(
                f"nodes of these names are running already: {', '.join(sorted(taken))}",
                where=f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}",
                remedy="end them, or set ROS_DOMAIN_ID to another number (0 to 101)",
            )
        look_s = SPEAKS_S if known else LOOK_ROUND_S
        time.sleep(LOOK_AGAIN_S)
    ros.destroy_subscription(inlet.subscription)
