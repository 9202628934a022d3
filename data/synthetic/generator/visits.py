"""Visits: a walk through the corridor said in legs, and made into a role with times, headings and steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from story import Role

AT_ONCE, TURN = 0.45, 0.9
ABOUT = 100.0
SHUFFLE = 12.0
SETTLE = 0.25
APART = 0.7


@dataclass(frozen=True)
class Go:
    """Walk to x, y (m) at a speed (m/s); with a face (heading, degrees) sideways or backwards instead of ahead."""

    x: float
    y: float
    speed: float = 1.25
    face: float | None = None
    arms: str | None = None


@dataclass(frozen=True)
class Stay:
    """Stand for some seconds, after turning to a heading (degrees; 0 faces the camera) if one is given."""

    seconds: float
    heading: float | None = None
    arms: str | None = None


@dataclass(frozen=True)
class Sit:
    """Sit for some seconds on a seat of a height (m) that stands right behind."""

    seconds: float
    height: float = 0.45
    arms: str | None = None


@dataclass(frozen=True)
class Visit:
    """One person's time in the corridor."""

    name: str
    role: Role


class Planner:
    """Walks the legs and writes down where the person is when."""

    def __init__(self, start: float, place: tuple[float, float]) -> None:
        """From a place (m) at a time (s)."""
        self.time, (self.x, self.y) = start, place
        self.heading: float | None = None
        self.waypoints: list[tuple[float, float, float, float]] = []
        self.moving: list[tuple[float, float]] = []
        self.arms: list[tuple[float, float, str]] = []
        self.seated: list[tuple[float, float, float]] = []

    def mark(self, heading: float) -> None:
        """A waypoint here and now."""
        self.waypoints.append((round(self.time, 3), round(self.x, 3), round(self.y, 3), round(heading, 2)))

    def turned(self, heading: float) -> float:
        """The heading as the nearest turn from the present one."""
        if self.heading is None:
            return heading
        return self.heading + (heading - self.heading + 180) % 360 - 180

    def go(self, leg: Go) -> None:
        """A walk along a straight line, turning on the way."""
        dx, dy = leg.x - self.x, leg.y - self.y
        reach = math.hypot(dx, dy)
        wanted = self.turned(math.degrees(math.atan2(dx, -dy)) if leg.face is None else leg.face)
        before = wanted if self.heading is None else self.heading
        self.mark(before)
        begun = self.time
        turn = min(TURN if abs(wanted - before) > ABOUT else AT_ONCE, 0.8 * reach / leg.speed)
        turn *= abs(wanted - before) > 0.5
        share = min(0.6 * turn * leg.speed / reach, 0.5)
        self.time, self.x, self.y = self.time + turn, self.x + share * dx, self.y + share * dy
        self.mark(wanted)
        self.time += (1 - share) * reach / leg.speed
        self.x, self.y, self.heading = leg.x, leg.y, wanted
        self.moving.append((begun, self.time + SETTLE))

    def stay(self, leg: Stay) -> None:
        """A stand, with a turn on the spot before it."""
        before = self.heading or 0.0
        wanted = before if leg.heading is None else self.turned(leg.heading)
        self.mark(before)
        begun, turn = self.time, min(TURN, leg.seconds / 2)
        self.time += turn
        self.mark(wanted)
        if abs(wanted - before) > SHUFFLE:
            self.moving.append((begun, self.time + SETTLE))
        self.time += leg.seconds - turn
        self.heading = wanted

    def sit(self, leg: Sit) -> None:
        """A time on a seat."""
        self.mark(self.heading or 0.0)
        self.seated.append((round(self.time, 3), round(self.time + leg.seconds, 3), leg.height))
        self.time += leg.seconds

    def walk(self, legs: Sequence[Go | Stay | Sit]) -> None:
        """All legs, one after the other."""
        for leg in legs:
            begun = self.time
            if isinstance(leg, Go):
                self.go(leg)
            elif isinstance(leg, Sit):
                self.sit(leg)
            else:
                self.stay(leg)
            if leg.arms:
                self.arms.append((round(begun, 3), round(self.time, 3), leg.arms))
        self.mark(self.heading or 0.0)


def joined(spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Spans in order, those that nearly touch as one."""
    out: list[tuple[float, float]] = []
    for start, end in spans:
        if out and start - out[-1][1] < APART:
            out[-1] = (out[-1][0], max(end, out[-1][1]))
        else:
            out.append((start, end))
    return tuple((round(start, 3), round(end, 3)) for start, end in out)


def held(spans: Sequence[tuple[float, float, str]]) -> tuple[tuple[float, float, str], ...]:
    """Postures in order; one that goes on into the next leg stays one span."""
    out: list[tuple[float, float, str]] = []
    for start, end, posture in spans:
        if out and out[-1][2] == posture and start - out[-1][1] < 1e-6:
            out[-1] = (out[-1][0], end, posture)
        else:
            out.append((start, end, posture))
    return tuple(out)


def visit(
    name: str,
    start: float,
    place: tuple[float, float],
    *legs: Go | Stay | Sit,
    step: float = 0.53,
    carries: str | None = None,
    heading: float | None = None,
) -> Visit:
    """A person's visit from a start (s) and a place (m) on, step in s; heading: of somebody who does not walk first.

    Somebody with a wheelchair takes no steps.
    """
    plan = Planner(start, place)
    plan.heading = heading
    plan.walk(legs)
    rides = carries == "wheelchair"
    stepping = () if rides else joined(plan.moving)
    role = Role(tuple(plan.waypoints), stepping, step, None, held(plan.arms), carries, tuple(plan.seated), rides)
    return Visit(name, role)
