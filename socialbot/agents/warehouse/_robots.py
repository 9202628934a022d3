"""Motion of warehouse robots: straight lines with constant acceleration."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass

from socialbot.agents.warehouse.messages import MoveStatus, Point
from socialbot.agents.warehouse.scenario import flat_distance
from socialbot.core.clock import SECOND, nanoseconds


@dataclass(frozen=True)
class Leg:
    """Straight path from ``start`` to ``end``, from the time ``begin`` (ns) on.

    A phase has a duration (s), an initial speed (m/s) and an acceleration (m/s2).
    """

    begin: int
    start: Point
    end: Point
    phases: tuple[tuple[float, float, float], ...]

    @property
    def finish(self) -> int:
        return self.begin + nanoseconds(sum(duration for duration, _, _ in self.phases))

    def motion(self, time: int) -> tuple[float, float]:
        """Distance covered (m) and speed (m/s) at ``time`` (ns)."""
        left, made = max(time - self.begin, 0) / SECOND, 0.0
        for duration, speed, acceleration in self.phases:
            spent = min(left, duration)
            made += spent * (speed + acceleration * spent / 2)
            if left < duration:
                return made, speed + acceleration * spent
            left -= duration
        return made, 0.0

    def position(self, time: int) -> Point:
        if time >= self.finish:
            return self.end
        whole = _distance(self.start, self.end)
        return _ahead(self.start, self.start, self.end, self.motion(time)[0] / whole) if whole else self.end


class Drive:
    """Drive of a robot, or of a part of it. Times are ns and never decrease."""

    def __init__(self, position: Point) -> None:
        self._legs: tuple[Leg, ...] = (Leg(0, position, position, ()),)
        self._pauses: list[tuple[int, int]] = []

    @property
    def target(self) -> Point:
        """Stop position."""
        return self._legs[-1].end

    @property
    def arrival(self) -> int:
        """Time of the stop, ns."""
        return self._with_pauses(self._legs[-1].finish)

    def position(self, time: int) -> Point:
        time = self._without_pauses(time)
        return self._leg(time).position(time)

    def go(self, now: int, target: Point, *, speed: float, acceleration: float, begin: int = 0) -> None:
        """Move to ``target`` from ``now``, or from ``begin`` if that is later. A moving drive brakes first."""
        time = self._without_pauses(now)
        leg = self._leg(time)
        start, speed_now = leg.position(time), leg.motion(time)[1]
        legs = []
        if speed_now > 0.0:
            rate = max(acceleration, *(abs(phase[2]) for phase in leg.phases))
            # Rounding must not make the braking distance longer than the path.
            share = min(speed_now**2 / 2 / rate / _distance(leg.start, leg.end), 1.0)
            stop = _ahead(start, leg.start, leg.end, share)
            legs.append(Leg(time, start, stop, ((speed_now / rate, speed_now, -rate),)))
            start, time = stop, legs[-1].finish
        time = max(time, self._without_pauses(begin)) if begin > now else time
        legs.append(Leg(time, start, target, _phases(_distance(start, target), speed, acceleration)))
        self._legs = tuple(legs)

    def pause(self, begin: int, seconds: float) -> None:
        """Stand still from ``begin`` (ns, not in the past) for some seconds, then continue."""
        merged: list[tuple[int, int]] = []
        for first, last in sorted([*self._pauses, (begin, begin + nanoseconds(seconds))]):
            if merged and first <= merged[-1][1]:
                merged[-1] = (merged[-1][0], max(last, merged[-1][1]))
            else:
                merged.append((first, last))
        self._pauses = merged

    def paused_until(self, time: int) -> int:
        """Return the end (ns) of the pause at ``time``; ``time`` itself if there is none."""
        return next((last for first, last in self._pauses if first <= time < last), time)

    def _leg(self, time: int) -> Leg:
        return next((leg for leg in self._legs if time < leg.finish), self._legs[-1])

    def _without_pauses(self, time: int) -> int:
        return time - sum(min(time, last) - first for first, last in self._pauses if first < time)

    def _with_pauses(self, time: int) -> int:
        for first, last in self._pauses:
            if first < time:
                time += last - first
        return time


def _phases(distance: float, speed: float, acceleration: float) -> tuple[tuple[float, float, float], ...]:
    if distance == 0.0:
        return ()
    top = min(speed, math.sqrt(distance * acceleration))
    change_s = top / acceleration
    cruise_s = max(distance - top * change_s, 0.0) / top
    return ((change_s, 0.0, acceleration), (cruise_s, top, 0.0), (change_s, top, -acceleration))


def _distance(a: Point, b: Point) -> float:
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))


def _ahead(point: Point, start: Point, end: Point, share: float) -> Point:
    """Move ``point`` by a share of the way from ``start`` to ``end``."""
    return Point(
        point.x + share * (end.x - start.x), point.y + share * (end.y - start.y), point.z + share * (end.z - start.z)
    )


MOVING = "moving"  # name of the place of a moving robot

STALLS = 0.2  # share of movements that stall, with noise only
STALL_S = (0.1, 0.5)  # shortest and longest stall, s


class WarehouseRobot:
    """The crane, or a carrier. Speed (m/s) and stalls vary by ``noise``, with a random generator for each robot."""

    def __init__(
        self,
        name: str,
        places: Mapping[str, Point],
        at: str,
        *,
        speed: float,
        acceleration: float,
        noise: float,
        seed: int,
    ) -> None:
        self.name = name
        self.drive = Drive(places[at])
        self._places = places
        self._start_name = self.target_name = at
        self._total_m = 0.0
        self._speed = speed
        self._acceleration = acceleration
        self._noise = noise
        self._chance = random.Random(f"{name} {seed}")

    def rests(self, now: int) -> bool:
        """Whether it stands still at its target."""
        return now >= self.drive.arrival

    def go(self, now: int, target: str, *, begin: int = 0, stop: Point | None = None) -> None:
        """Move to a place from ``now``, not before ``begin``; or only to ``stop``, if the place is blocked.

        A repeated command has no effect.
        """
        end = self._places[target] if stop is None else stop
        if target == self.target_name and end == self.drive.target:
            return
        here = self.status(now)
        if here.current_name != MOVING:
            self._start_name = here.current_name
        self.target_name = target
        self._total_m = flat_distance(here.current_pos, self._places[target])
        self.drive.go(now, end, speed=self._speed * self.factor(), acceleration=self._acceleration, begin=begin)
        if self._noise and self._chance.random() < STALLS:
            way = max(self.drive.arrival - max(now, begin), 0) / SECOND
            moment = max(now, begin) + nanoseconds(self._chance.uniform(0.1, 0.9) * way)
            self.drive.pause(moment, self._chance.uniform(*STALL_S))

    def factor(self) -> float:
        """Random factor of the speed."""
        return 1.0 + self._chance.uniform(-self._noise, self._noise)

    def status(self, now: int) -> MoveStatus:
        position, target = self.drive.position(now), self._places[self.target_name]
        left = flat_distance(position, target)
        there = left == 0.0 and self.rests(now)
        share = 1.0 - left / self._total_m if self._total_m else 0.0
        return MoveStatus(
            stamp=now,
            robot=self.name,
            start_name=self._start_name,
            current_name=self.target_name if there else MOVING,
            target_name=self.target_name,
            current_pos=position,
            target_pos=target,
            dist=left,
            progress=1.0 if there else min(max(share, 0.0), 1.0),
        )
