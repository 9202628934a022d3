"""What others see of the missions."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping

from socialbot.agents.hospital.course import Course, view
from socialbot.agents.hospital.messages import MissionView
from socialbot.agents.hospital.missions import Mission

SHOWN = 20
"""So many missions that are over are still shown."""


class Board:
    """Shows missions; only those are drawn anew of which it was told that they have changed."""

    def __init__(self) -> None:
        self.changed = True
        """Whether there may be something new since this was last set to False."""
        self._over: deque[MissionView] = deque(maxlen=SHOWN)
        self._drawn: dict[int, MissionView] = {}

    def redraw(self, mission: Mission) -> None:
        """Notes that a mission has changed."""
        self._drawn.pop(mission.id, None)
        self.changed = True

    def close(self, mission: Mission, course: Course | None) -> None:
        """Shows how a mission has ended."""
        self.redraw(mission)
        self._over.append(view(mission, course))

    def views(self, missions: Iterable[Mission], courses: Mapping[int, Course]) -> Iterator[MissionView]:
        """The latest missions that are over, in the order of their end, then ``missions``."""
        yield from self._over
        for mission in missions:
            drawn = self._drawn.get(mission.id)
            if drawn is None:
                drawn = self._drawn[mission.id] = view(mission, courses.get(mission.id))
            yield drawn
