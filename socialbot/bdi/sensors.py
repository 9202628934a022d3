"""Sensors turn what comes in from the world into beliefs. Subclass `Sensor` and override `Sensor.sense`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from socialbot.bdi.literals import Belief, Change, Event
from socialbot.errors import RuleError

Sensed = Belief | Event | Iterable[Belief | Event] | None
"""What a sensor may return: nothing, one belief (to hold it), one change, or several of them."""


class Sensor:
    """Looks at the world for the agent.

    A pushed sensor gets each percept through `Engine.perceive`; one with a ``period_s`` is asked
    that often, with None. It runs in the engine's thread, and its exceptions never stop the agent.
    """

    period_s: float | None = None

    def sense(self, percept: Any) -> Sensed:
        """The beliefs that follow from ``percept``."""
        raise RuleError(f"the sensor {type(self).__name__} senses nothing", remedy="override sense()")


def changes(sensed: Sensed) -> list[Event]:
    """What a sensor returned, as changes of beliefs. Raises RuleError for anything else."""
    if sensed is None:
        return []
    items = [sensed] if isinstance(sensed, (Belief, Event)) else list(sensed)
    for item in items:
        change = item.change if isinstance(item, Event) else Change.ADDED
        if not isinstance(item, (Belief, Event)) or change not in (Change.ADDED, Change.REMOVED):
            raise RuleError(f"a sensor returned {item!r}", remedy="return beliefs, +belief, -belief or None")
    return [+item if isinstance(item, Belief) else item for item in items]
