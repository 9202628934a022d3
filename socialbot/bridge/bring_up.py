"""The order in which the nodes of a graph are activated: who listens comes before who speaks."""

from __future__ import annotations

from collections.abc import Callable, Collection

from socialbot.graph import Graph

CONFIGURED_S = 10.0
"""So long it is waited until all nodes are configured; then those begin that are."""

ACTIVE_S = 1.0
"""So long each node may take to become active before the next one is asked to."""


def sinks_first(graph: Graph) -> list[str]:
    """The names of the nodes, each as far as possible after those that listen to it."""
    heard_by = {
        placement.name: {
            other.name
            for other in graph.placements
            if other is not placement
            and {topic for topic, _ in other.subscriptions} & {topic for topic, _ in placement.publications}
        }
        for placement in graph.placements
    }
    left = list(reversed(heard_by))
    order: list[str] = []
    while left:
        # Where they listen to each other in a circle, with the one that has the fewest listeners.
        name = min(left, key=lambda name: len(heard_by[name].intersection(left)))
        left.remove(name)
        order.append(name)
    return order


class BringUp:
    """Asks nodes to become active by ``activate``, one after the other in ``order``. Times are in s."""

    def __init__(self, order: Collection[str], activate: Callable[[str], None], now: float) -> None:
        self._waiting = list(order)
        self._activate = activate
        self._begun = now
        self._asked = ""
        self._asked_at = now

    def look(self, inactive: Collection[str], dead: Collection[str], now: float) -> None:
        """Goes on as far as it can. ``inactive`` are the nodes that are configured, ``dead`` those not to wait for."""
        self._waiting = [name for name in self._waiting if name not in dead]
        if not self._asked and set(self._waiting) - set(inactive) and now < self._begun + CONFIGURED_S:
            return
        while self._waiting and not self._is_busy(inactive, dead, now):
            name = self._asked = self._waiting.pop(0)
            self._asked_at = now
            self._activate(name)

    @property
    def done(self) -> bool:
        """Whether all have been asked."""
        return not self._waiting

    def _is_busy(self, inactive: Collection[str], dead: Collection[str], now: float) -> bool:
        name = self._asked
        return name in inactive and name not in dead and now < self._asked_at + ACTIVE_S
