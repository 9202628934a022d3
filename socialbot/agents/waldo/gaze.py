"""Whom an attentive head looks at, and where it searches while there is nobody to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from socialbot.agents.waldo.encounters import View


class Pose(NamedTuple):
    """Head pose in rad: pan positive to the left, tilt positive up (REP-103); 0, 0 is straight ahead."""

    pan: float
    tilt: float

    def distance(self, other: Pose) -> float:
        """The larger of the two angles between the poses, in rad."""
        return max(abs(self.pan - other.pan), abs(self.tilt - other.tilt))


class Seen(NamedTuple):
    """Detected person: distance in m (infinite if unknown), bearing as a head pose, and track id if any.

    ``attentive`` is whether the person faces the robot or comes nearer; None if unknown.
    """

    distance_m: float
    pose: Pose
    track_id: str
    attentive: bool | None = None


_GLANCE_S = 1.5  # A person who does not attend to the robot is looked at for this long,
_REST_S = 9.0  # and not again for this long.
_ATTENTIVE_M = 2.5  # An attentive person counts as nearer by this distance.
_SPEAKER_S = 4.0  # Who speaks is looked at for this long.
_LEAD_S, _EASE_S = 0.2, 0.4  # The head leads a walker by this time; speeds are averaged over this time.
_FASTEST_RAD_S = 0.8
_LOST_S = 2.5  # The head looks where it lost a person for this long,
_BEYOND_RAD = 0.35  # farther on in the direction in which the person went.
_COAST_S = 1.2  # Somebody who walks out of view is expected to walk on for this long.
_TURNS_S = 1.5  # An attentive person out of view is looked at after this time.
_MISSED_S = 1.0  # An attentive person is forgotten after this time if their direction is in view, but not they,
_UNSEEN_S = 6.0  # or after this time out of view.
_SEARCH = ((0.0, 3.0), (0.55, 1.6), (0.0, 2.0), (-0.55, 1.6))
"""Directions (rad) in which the head looks around, and how long (s) it stays there."""


@dataclass
class _Walker:
    pan: float
    at_s: float
    speed_rad_s: float = 0.0


@dataclass
class _Member:
    """Attentive person: direction, distance, and speed of the direction, when they were seen last."""

    last_pan: float
    distance_m: float
    at_s: float
    speed_rad_s: float
    pan: float = 0.0

    def expect(self, now_s: float) -> None:
        """Set the direction that is expected now."""
        self.pan = self.last_pan + self.speed_rad_s * min(now_s - self.at_s + _LEAD_S, _COAST_S)


@dataclass
class Gaze:
    """Chooses the direction of an attentive head from the people in view, their interest, and who speaks.

    Args:
        switch_margin_m: Another person is looked at if nearer by this distance.
    """

    switch_margin_m: float = 0.5
    target: str = ""
    _group: dict[str, _Member] = field(default_factory=dict)
    _since_s: float = 0.0
    _rests: dict[str, float] = field(default_factory=dict)
    _walkers: dict[str, _Walker] = field(default_factory=dict)
    _speaker: tuple[str, float] = ("", -math.inf)
    _lost: tuple[float, float] = (0.0, -math.inf)
    _search_step: int = 0
    _search_since_s: float | None = None

    def hear(self, person: str, now_s: float) -> None:
        """Look at a person who speaks."""
        self._speaker = person, now_s + _SPEAKER_S

    def look(self, seen: Sequence[Seen], now_s: float, view: View | None = None) -> Pose | None:
        """Return where to look; None to keep the direction.

        Args:
            seen: People in view, with poses from the robot's base.
            now_s: Time of the image.
            view: What the camera sees; the head keeps all attentive people in it, if they fit.
        """
        self._measure(seen, now_s)
        if view is not None:
            self._remember(seen, now_s, view)
        chosen = self._choose(seen, now_s)
        if chosen is None:
            waiting = self._waiting(now_s, view)
            return self._search(now_s) if waiting is None else Pose(waiting, 0.0)
        self._search_since_s = None
        speed = self._walkers[chosen.track_id].speed_rad_s
        if chosen.attentive is not False:
            self._lost = chosen.pose.pan + math.copysign(_BEYOND_RAD, speed) * (abs(speed) > 0.1), now_s + _LOST_S
        pan = chosen.pose.pan + _LEAD_S * speed
        if view is not None and chosen.attentive:
            pan = self._with_group(pan, now_s, view)
        return Pose(pan, chosen.pose.tilt)

    def _remember(self, seen: Sequence[Seen], now_s: float, view: View) -> None:
        """Note who attends to the robot, also while they are out of view."""
        for person in seen:
            if person.attentive:
                speed = self._walkers[person.track_id].speed_rad_s
                self._group[person.track_id] = _Member(person.pose.pan, person.distance_m, now_s, speed)
            elif person.attentive is False:
                self._group.pop(person.track_id, None)
        for name, one in list(self._group.items()):
            one.expect(now_s)
            if now_s - one.at_s > (_MISSED_S if view.shows(one.pan) else _UNSEEN_S):
                del self._group[name]

    def _waiting(self, now_s: float, view: View | None) -> float | None:
        """Return the direction of the attentive person who left the view first; None if all are in view."""
        if view is None:
            return None
        unseen = [one for one in self._group.values() if now_s - one.at_s > _TURNS_S and not view.shows(one.pan)]
        return min(unseen, key=lambda one: one.at_s).pan if unseen else None

    def _with_group(self, pan: float, now_s: float, view: View) -> float:
        """Return the direction nearest to ``pan`` that also shows the attentive people, the nearest of them first.

        If they do not fit into the view, the head turns to those whom it has not seen for a while.
        """
        waiting = self._waiting(now_s, view)
        if waiting is not None:
            pan = waiting
        width = 2 * view.clear_rad
        low = high = pan
        for one in sorted(self._group.values(), key=lambda one: one.distance_m):
            if max(high, one.pan) - min(low, one.pan) <= width:
                low, high = min(low, one.pan), max(high, one.pan)
        return min(max(pan, high - view.clear_rad), low + view.clear_rad)

    def _measure(self, seen: Sequence[Seen], now_s: float) -> None:
        for person in seen:
            known = self._walkers.get(person.track_id)
            if known is None or not 0 < now_s - known.at_s < 1.0:
                self._walkers[person.track_id] = _Walker(person.pose.pan, now_s)
                continue
            step = now_s - known.at_s
            speed = (person.pose.pan - known.pan) / step
            share = 1 - math.exp(-step / _EASE_S)
            limited = min(max(speed, -_FASTEST_RAD_S), _FASTEST_RAD_S)
            known.speed_rad_s += share * (limited - known.speed_rad_s)
            known.pan, known.at_s = person.pose.pan, now_s
        self._walkers = {name: one for name, one in self._walkers.items() if now_s - one.at_s < 5.0}
        self._rests = {name: until for name, until in self._rests.items() if until > now_s}

    def _choose(self, seen: Sequence[Seen], now_s: float) -> Seen | None:
        speaker = self._speaker[0] if now_s < self._speaker[1] else ""
        for person in seen:
            if person.attentive or person.track_id == speaker:
                self._rests.pop(person.track_id, None)
            elif person.track_id == self.target and now_s - self._since_s > _GLANCE_S:
                self._rests[person.track_id] = now_s + _REST_S
        awake = [person for person in seen if person.track_id not in self._rests]
        if not awake:
            self.target = ""
            return None

        def cost(person: Seen) -> float:
            if person.track_id == speaker:
                return -math.inf
            bonus = _ATTENTIVE_M if person.attentive else 0.0
            kept = self.switch_margin_m if person.track_id == self.target else 0.0
            return person.distance_m - bonus - kept

        best = min(awake, key=lambda person: (cost(person), abs(person.pose.pan)))
        if best.track_id != self.target:
            self.target, self._since_s = best.track_id, now_s
        elif best.attentive:
            self._since_s = now_s
        return best

    def _search(self, now_s: float) -> Pose | None:
        """Look where the last person went, then around."""
        pan, until = self._lost
        if now_s < until:
            return Pose(pan, 0.0)
        if self._search_since_s is None:
            self._search_step, self._search_since_s = 0, now_s
        pan, stay_s = _SEARCH[self._search_step % len(_SEARCH)]
        if now_s - self._search_since_s > stay_s:
            self._search_step, self._search_since_s = self._search_step + 1, now_s
            pan, _ = _SEARCH[self._search_step % len(_SEARCH)]
        return Pose(pan, 0.0)
