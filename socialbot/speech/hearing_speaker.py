"""Find the person who speaks."""

from __future__ import annotations

import math

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import PersonDetection, PersonDetections

_RECENT_S = 1.0
_WITHIN_RAD = 0.35  # Largest angle between the sound and the person.
_FACING_RAD = 0.6


class SpeakerFinder:
    """Finds the person who speaks by the direction of the sound, or else by who is in view and faces the robot."""

    def __init__(self) -> None:
        self._seen: PersonDetections | None = None
        self._sound: tuple[int, float] | None = None

    def on_persons(self, detections: PersonDetections) -> None:
        self._seen = detections

    def on_direction(self, stamp: int, bearing_rad: float) -> None:
        """Set the direction of the sound, positive to the left; one that is not finite is ignored."""
        if math.isfinite(bearing_rad):
            self._sound = (stamp, bearing_rad)

    def find(self, time: int) -> tuple[str, float | None]:
        """Track id and bearing (rad) of the person who speaks at ``time`` (ns); "" or None if unknown."""
        seen = self._seen
        persons: list[PersonDetection] = []
        if seen is not None and abs(time - seen.stamp) <= nanoseconds(_RECENT_S):
            persons = [person for person in seen.persons if person.track_id]
        if self._sound is not None and abs(time - self._sound[0]) <= nanoseconds(_RECENT_S):
            return self._towards(self._sound[1], persons), self._sound[1]
        if len(persons) > 1:
            persons = [each for each in persons if each.facing_rad is not None and each.facing_rad <= _FACING_RAD]
        if len(persons) != 1:
            return "", None
        return persons[0].track_id, persons[0].bearing_rad

    @staticmethod
    def _towards(bearing: float, persons: list[PersonDetection]) -> str:
        near = [
            (abs(person.bearing_rad - bearing), person.track_id)
            for person in persons
            if person.bearing_rad is not None and abs(person.bearing_rad - bearing) <= _WITHIN_RAD
        ]
        return min(near)[1] if near else ""
