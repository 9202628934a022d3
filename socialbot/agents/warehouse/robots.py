"""Robots that go from place to place, as fast as they happen to today."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass

from socialbot.agents.warehouse.drives import Drive
from socialbot.agents.warehouse.layout import flat_distance
from socialbot.agents.warehouse.messages import Point
from socialbot.clock import SECOND, nanoseconds

MOVING = "moving"
"""The name of where a robot is while it is at no place."""

STALLS = 0.2
STALL_S = (0.1, 0.5)
"""How many of the movements stall on the way, and for how long, s; where there is noise at all."""


@dataclass(frozen=True)
class Whereabouts:
    """Where a robot is and where it goes at a moment; see `messages.MoveStatus`."""

    start_name: str
    current_name: str
    target_name: str
    position: Point
    target: Point
    left_m: float
    progress: float


class Robot:
    """The crane, or a carrier. ``speed`` (m/s) and stalls vary by ``noise``, each robot by a chance of its own."""

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
        self._start_name = self._target_name = at
        self._total_m = 0.0
        self._speed = speed
        self._acceleration = acceleration
        self._noise = noise
        self._chance = random.Random(f"{name} {seed}")

    @property
    def target_name(self) -> str:
        """The place where it goes, or is."""
        return self._target_name

    def rests(self, now: int) -> bool:
        """Whether it stands still because it has nowhere else to go."""
        return now >= self.drive.arrival

    def go(self, now: int, target: str, *, begin: int = 0, stop: Point | None = None) -> None:
        """Goes to a place from ``now``, not before ``begin``; or only to ``stop``, if something stands in the way.

        Told again what it does already, it carries on.
        """
        end = self._places[target] if stop is None else stop
        if target == self._target_name and end == self.drive.target:
            return
        here = self.whereabouts(now)
        if here.current_name != MOVING:
            self._start_name = here.current_name
        self._target_name = target
        self._total_m = flat_distance(here.position, self._places[target])
        self.drive.go(now, end, speed=self._speed * self.factor(), acceleration=self._acceleration, begin=begin)
        if self._noise and self._chance.random() < STALLS:
            way = max(self.drive.arrival - max(now, begin), 0) / SECOND
            moment = max(now, begin) + nanoseconds(self._chance.uniform(0.1, 0.9) * way)
            self.drive.pause(moment, self._chance.uniform(*STALL_S))

    def factor(self) -> float:
        """By how much it is faster or slower this time."""
        return 1.0 + self._chance.uniform(-self._noise, self._noise)

    def whereabouts(self, now: int) -> Whereabouts:
        """Where it is and where it goes."""
        position, target = self.drive.position(now), self._places[self._target_name]
        left = flat_distance(position, target)
        there = left == 0.0 and self.rests(now)
        share = 1.0 - left / self._total_m if self._total_m else 0.0
        return Whereabouts(
            start_name=self._start_name,
            current_name=self._target_name if there else MOVING,
            target_name=self._target_name,
            position=position,
            target=target,
            left_m=left,
            progress=1.0 if there else min(max(share, 0.0), 1.0),
        )
