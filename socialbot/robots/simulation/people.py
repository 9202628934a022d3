"""What simulated people do: scripts in YAML or drawn at random, and their motion in time."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from socialbot.core.errors import ParameterError, suggestion
from socialbot.core.yaml import read_page
from socialbot.robots.simulation.figure import Looks, random_looks
from socialbot.robots.simulation.place import Door, Place, Spot, place_names
from socialbot.robots.simulation.posture import Stance

ROBOT, WALL = "robot", "wall"
Activity = Literal["walk", "stand", "talk", "sit"]
Aim = Literal["", "visit", "help", "pass", "company", "rest"]
"""What a person wants: a greeting, help, to pass by, to talk to others, or to rest."""

_STEP_S = 0.05
_WALK_MPS = 1.2
_SIT_S, _SETTLE_S, _TURN_S = 1.4, 0.30, 0.35
_SEAT_M = 0.42  # A person stands this far before a seat to sit down.
_ROBOT_M = 0.3
_BESIDE_M = 0.28  # Room that walkers leave beside furniture.
LONGEST_S = 86_400.0
"""Longest time in a script, s."""
MOST_STEPS = 1_000_000
"""Moments of all people of a script together, about 14 hours."""
_ROUND = {"column": 0.2, "plant": 0.26, "bin": 0.16, "low_table": 0.62}  # Furniture that people walk around, radius.


_Duration = Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_S)]


class Leg(msgspec.Struct, frozen=True):
    """One thing that a person does; exactly one of the first four.

    Attributes:
        walk: Spot, door, or x and y, to walk to. A door as the first leg is where the person comes from.
        stand: Duration of standing, s.
        talk: Duration of talking to ``to``, s.
        sit: Seat, for ``seconds``.
        face: Whom or what the person looks at: ``robot``, ``wall`` (the nearest), an id, or a spot. Default: ahead.
    """

    walk: str | Spot | None = None
    stand: _Duration | None = None
    talk: _Duration | None = None
    sit: str | None = None
    seconds: _Duration = 10.0
    to: str = ""
    face: str = ""
    speed: float = _WALK_MPS
    aim: Aim = ""


class Actor(msgspec.Struct, frozen=True):
    """A person of a script.

    Attributes:
        enter: Door through which the person comes.
        start: Time of that, s.
        looks: Seed of the appearance; default: by the place in the script.
    """

    id: str
    enter: str
    legs: tuple[Leg, ...]
    start: Annotated[float, msgspec.Meta(ge=-LONGEST_S, le=LONGEST_S)] = 0.0
    looks: int | None = None


class Script(msgspec.Struct, frozen=True):
    """People in a place, and what they do."""

    place: str
    people: tuple[Actor, ...]
    duration: _Duration | None = None


def read_script(text: str, *, where: str) -> Script:
    """Read a script from YAML. Raises ParameterError if it is none."""
    root = read_page(text, where=where, error=ParameterError)
    script = root.read(Script)
    if script.place not in place_names():
        what, remedy = f"there is no place {script.place!r}", suggestion(script.place, place_names())
        raise ParameterError(what, where=root.line("place"), remedy=remedy)
    names = [actor.id for actor in script.people]
    if len(set(names)) < len(names) or ROBOT in names:
        raise ParameterError(f"ids of people must differ, and none is {ROBOT!r}", where=root.line("people"))
    for index, actor in enumerate(script.people):
        for number, leg in enumerate(actor.legs):
            place = root.line("people", index, "legs", number)
            if sum(each is not None for each in (leg.walk, leg.stand, leg.talk, leg.sit)) != 1:
                raise ParameterError("a leg needs one of walk, stand, talk and sit", where=place)
            if leg.talk is not None and leg.to not in names:
                what, remedy = f"'to' must be a person of the script, not {leg.to!r}", suggestion(leg.to, names)
                raise ParameterError(what, where=place, remedy=remedy)
    return script


@dataclass(frozen=True)
class Episode:
    """A part of a person's stay: what they do and want from ``begin`` to ``end`` (s), and with whom."""

    begin: float
    end: float
    activity: Activity
    aim: Aim = ""
    partner: str = ""
    face: str = ""


class _Sample(NamedTuple):
    """A moment of a stay; a ``heading`` that is NaN is that of the way or the face."""

    x: float
    y: float
    heading: float
    face: str
    seated: float = 0.0
    talking: float = 0.0


class Motion:
    """Motion of a person through a place, from their legs.

    Args:
        actor: The person and what they do.
        place: Room, doors and furniture.
        most: Moments that the person may stay.

    Raises:
        ParameterError: A leg names an unknown door, spot or seat, or the person stays longer.
    """

    def __init__(self, actor: Actor, place: Place, most: int = MOST_STEPS) -> None:
        self.actor = actor
        self._most = most
        self.episodes: list[Episode] = []
        self._place = place
        self._samples: list[_Sample] = []
        entrance = self._door(actor.enter)
        self._at: Spot = entrance.outside
        self._heading = math.atan2(entrance.inside[1] - self._at[1], entrance.inside[0] - self._at[0])
        self._walk(entrance.inside, Leg(walk=actor.enter))
        for leg in actor.legs:
            self._act(leg)
        self._finish()

    @property
    def begin(self) -> float:
        """Time of the entrance, s."""
        return self.actor.start

    @property
    def end(self) -> float:
        """Time after which the person is gone, s."""
        return self.actor.start + (len(self.x) - 1) * _STEP_S

    def _door(self, name: str) -> Door:
        if name not in self._place.doors:
            remedy = f"choose one of: {', '.join(self._place.doors)}"
            raise ParameterError(f"there is no door {name!r}", where=self.actor.id, remedy=remedy)
        return self._place.doors[name]

    def _now(self) -> float:
        return self.actor.start + len(self._samples) * _STEP_S

    def _act(self, leg: Leg) -> None:
        begin = self._now()
        activity: Activity = "walk"
        if leg.walk is not None:
            if isinstance(leg.walk, str) and leg.walk in self._place.doors:
                door = self._door(leg.walk)
                self._walk(door.inside, leg)
                self._walk(door.outside, leg)
            else:
                self._walk(self._spot(leg.walk), leg)
        elif leg.sit is not None:
            activity = "sit"
            begin = self._sit(leg)
        else:
            activity = "talk" if leg.talk is not None else "stand"
            self._stay(leg.talk or leg.stand or 0.0, leg.to or leg.face, talking=leg.talk is not None)
        self.episodes.append(Episode(begin, self._now(), activity, leg.aim, leg.to, leg.to or leg.face))

    def _spot(self, goal: str | Spot) -> Spot:
        if not isinstance(goal, str):
            return goal
        if goal not in self._place.spots:
            remedy = (
                f"choose a spot ({', '.join(self._place.spots)}), a door ({', '.join(self._place.doors)}), or [x, y]"
            )
            raise ParameterError(f"there is no spot {goal!r}", where=self.actor.id, remedy=remedy)
        return self._place.spots[goal]

    def _expect(self, steps: int) -> None:
        """Raise ParameterError at once, before the steps are made, if they are too many."""
        if len(self._samples) + steps > self._most:
            hours = MOST_STEPS * _STEP_S / 3600
            what = f"the people of a script may stay for {hours:.1f} hours together"
            raise ParameterError(what, where=self.actor.id, remedy="shorten the legs")

    def _put(self, sample: _Sample) -> None:
        self._expect(1)
        self._samples.append(sample)

    def _walk(self, goal: Spot, leg: Leg) -> None:
        (x0, y0), (x1, y1) = self._at, goal
        length = math.hypot(x1 - x0, y1 - y0)
        steps = max(round(length / max(leg.speed, 0.2) / _STEP_S), 1)
        self._expect(steps)
        for step in range(1, steps + 1):
            share = step / steps
            x, y = self._beside(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            self._put(_Sample(x, y, math.nan, leg.face))
        self._at = goal

    def _beside(self, x: float, y: float) -> Spot:
        """Move a point of a path out of furniture and of the robot."""
        round_things = [(piece.at, _ROUND[piece.kind]) for piece in self._place.furniture if piece.kind in _ROUND]
        for (px, py), size in [((0.0, 0.0), _ROBOT_M), *round_things]:
            radius, away = size + _BESIDE_M, math.hypot(x - px, y - py)
            if away < radius:
                aside = ((x - px) / away, (y - py) / away) if away > 0.01 else (0.0, 1.0)
                x, y = px + aside[0] * radius, py + aside[1] * radius
        return x, y

    def _stay(self, seconds: float, face: str, *, talking: bool = False) -> None:
        steps = round(seconds / _STEP_S)
        self._expect(steps)
        for _ in range(steps):
            self._put(_Sample(*self._at, math.nan, face or "ahead", talking=float(talking)))

    def _sit(self, leg: Leg) -> float:
        seat = self._place.seats.get(leg.sit or "")
        if seat is None:
            remedy = f"choose one of: {', '.join(self._place.seats)}"
            raise ParameterError(f"there is no seat {leg.sit!r}", where=self.actor.id, remedy=remedy)
        ahead = math.cos(seat.heading), math.sin(seat.heading)
        before = seat.at[0] + _SEAT_M * ahead[0], seat.at[1] + _SEAT_M * ahead[1]
        self._walk(before, leg)
        begin = self._now()
        down = np.linspace(0, 1, round(_SIT_S / _STEP_S))
        self._expect(2 * len(down) + round(leg.seconds / _STEP_S))
        for share in (*down, *[1.0] * round(leg.seconds / _STEP_S), *np.linspace(1, 0, len(down))):
            x, y = (start + share * (end - start) for start, end in zip(before, seat.at, strict=True))
            self._put(_Sample(x, y, seat.heading, leg.face, seated=float(share)))
        return begin

    def _finish(self) -> None:
        """Round corners, starts and stops."""
        x, y, heading, self.faces, seated, talking = zip(*self._samples, strict=True)
        self.x, self.y = (_smoothed(np.array(values), _SETTLE_S) for values in (x, y))
        self.seated, self.talking = _smoothed(np.array(seated), 0.2), _smoothed(np.array(talking), 0.5)
        dx, dy = np.gradient(self.x) / _STEP_S, np.gradient(self.y) / _STEP_S
        self.speed = np.hypot(dx, dy)
        self.walked = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(self.x), np.diff(self.y)))])
        course = np.where(self.speed > 0.25, np.arctan2(dy, dx), np.nan)
        self.wanted = np.where(np.isnan(heading), course, np.array(heading))

    def settle(self, others: Mapping[str, Motion]) -> None:
        """Turn body and head, once the ways of all people are known."""
        course, gaze = np.empty(len(self.x)), np.empty(len(self.x))
        last = self._heading
        for step, face in enumerate(self.faces):
            towards = self._direction(step, face, others)
            if not math.isnan(self.wanted[step]):
                last = self.wanted[step]
            elif face and towards is not None:
                last = towards
            course[step] = last
            gaze[step] = last if towards is None else towards
        self.heading = _smoothed(np.unwrap(course), _TURN_S)
        gaze = self.heading + np.clip(np.remainder(gaze - self.heading + math.pi, math.tau) - math.pi, -1.4, 1.4)
        self.gaze = _smoothed(gaze, 0.15)

    def _direction(self, step: int, face: str, others: Mapping[str, Motion]) -> float | None:
        x, y = self.x[step], self.y[step]
        if face in ("", "ahead"):
            return None
        if face == ROBOT:
            return math.atan2(-y, -x)
        if face == WALL:
            x0, x1, y0, y1 = self._place.size
            return min((x - x0, math.pi), (x1 - x, 0.0), (y - y0, -math.pi / 2), (y1 - y, math.pi / 2))[1]
        if face in others:
            at = others[face].where(self.begin + step * _STEP_S)
            return None if at is None else math.atan2(at[1] - y, at[0] - x)
        spot = self._spot(face)
        return math.atan2(spot[1] - y, spot[0] - x)

    def where(self, time: float) -> Spot | None:
        """Position at ``time`` (s); None outside of the stay."""
        step = round((time - self.begin) / _STEP_S)
        return (float(self.x[step]), float(self.y[step])) if 0 <= step < len(self.x) else None

    def stance(self, time: float) -> Stance | None:
        """Where the person is and what they do at ``time`` (s); None outside of the stay."""
        position = (time - self.begin) / _STEP_S
        low = int(position)
        if position < 0 or low >= len(self.x) - 1:
            return None
        share = position - low

        def at(values: np.ndarray) -> float:
            return float(values[low] + share * (values[low + 1] - values[low]))

        return Stance(
            x=at(self.x), y=at(self.y), heading_rad=at(self.heading), gaze_rad=at(self.gaze), speed_mps=at(self.speed),
            walked_m=at(self.walked), seated=at(self.seated), talking=at(self.talking), time_s=time,
        )  # fmt: skip

    def episode(self, time: float) -> Episode | None:
        """What the person does at ``time`` (s)."""
        return next((one for one in reversed(self.episodes) if one.begin <= time < one.end), None)


def _smoothed(values: np.ndarray, seconds: float) -> np.ndarray:
    """Average over ``seconds``, twice, with the first and last values held."""
    half = max(round(seconds / _STEP_S / 2), 1)
    kernel = np.ones(2 * half + 1) / (2 * half + 1)
    for _ in range(2):
        values = np.convolve(np.pad(values, half, mode="edge"), kernel, mode="valid")
    return values


class Crowd:
    """All people of a script, in a place."""

    def __init__(self, script: Script, place: Place, *, seed: int = 0) -> None:
        self.script, self.place = script, place
        self.motions: dict[str, Motion] = {}
        left = MOST_STEPS
        for actor in script.people:
            self.motions[actor.id] = motion = Motion(actor, place, left)
            left -= len(motion.x)
        for motion in self.motions.values():
            motion.settle(self.motions)
        self._seed = seed

    @cached_property
    def looks(self) -> dict[str, Looks]:
        """Appearance of each person."""
        return {
            actor.id: random_looks(random.Random(f"{self._seed} {number}" if actor.looks is None else actor.looks))
            for number, actor in enumerate(self.script.people)
        }

    @property
    def duration(self) -> float:
        """Time (s) until the last person has gone, or that of the script."""
        if self.script.duration is not None:
            return self.script.duration
        return max((motion.end for motion in self.motions.values()), default=0.0) + 3.0

    def at(self, time: float) -> dict[str, Stance]:
        """All people who are there at ``time`` (s)."""
        stances = ((name, motion.stance(time)) for name, motion in self.motions.items())
        return {name: stance for name, stance in stances if stance is not None}


def nearest_approach(one: Motion, other: Motion) -> float:
    """Least distance (m) of two people while both are there."""
    begin, end = max(one.begin, other.begin), min(one.end, other.end)
    if end <= begin:
        return math.inf
    count = round((end - begin) / _STEP_S)
    first, second = (round((begin - motion.begin) / _STEP_S) for motion in (one, other))
    count = min(count, len(one.x) - first, len(other.x) - second)
    if count <= 0:
        return math.inf
    gaps = np.hypot(
        one.x[first : first + count] - other.x[second : second + count],
        one.y[first : first + count] - other.y[second : second + count],
    )
    return float(gaps.min())


_APART_M = 0.5  # Least distance between two people; nearer ones are drawn again.
_TRIES, _GIVE_UP = 40, 5
NAMES: tuple[str, ...] = (
    "ada", "ben", "cleo", "dan", "eva", "finn", "gina", "hugo", "ida", "jon", "kim", "leo", "mia", "nils", "ona",
    "paul", "quin", "rosa", "sam", "tina", "udo", "vera", "wim", "xenia", "yann", "zoe",
)  # fmt: skip


class Schedule:
    """Draws the people of one schedule."""

    def __init__(self, name: str, place: Place, *, people: int, duration_s: float, seed: int) -> None:
        self._name, self._place = name, place
        self._people, self._duration = min(people, len(NAMES)), duration_s
        self._rng = random.Random(f"{name} {seed}")
        self._actors: list[Actor] = []
        self._motions: list[Motion] = []

    def script(self) -> Script:
        """Return the script. Fewer people come if there is no room for more."""
        kinds: list[tuple[Callable[[list[str], float], list[Actor]], int, float]] = [
            (self._visitor, 1, 4.0),
            (self._passer, 1, 2.5),
            (self._company, 2, 2.5),
            (self._pair, 2, 1.0),
            (self._reader, 1, 1.0),
        ]
        if self._place.seats:
            kinds.append((self._rester, 1, 1.0))
        failed = 0
        while self._people > len(self._actors):
            left = self._people - len(self._actors)
            able = [kind for kind in kinds if kind[1] <= left]
            make, count, _ = self._rng.choices(able, [weight for *_, weight in able])[0]
            failed += not self._add(make, count)
            if failed == _GIVE_UP:
                break
        return Script(self._name, tuple(sorted(self._actors, key=lambda one: one.start)), self._duration)

    def _add(self, make: Callable[[list[str], float], list[Actor]], count: int) -> bool:
        names = list(NAMES[len(self._actors) : len(self._actors) + count])
        # Some are there already at the beginning.
        earliest = -20.0 if make in (self._company, self._rester) else 0.5
        for _ in range(_TRIES):
            actors = make(names, round(self._rng.uniform(earliest, max(self._duration - 22.0, 1.0)), 2))
            motions = [Motion(actor, self._place) for actor in actors]
            pairs = [(a, b) for a in motions for b in self._motions] + [
                (a, b) for n, a in enumerate(motions) for b in motions[:n]
            ]
            if all(nearest_approach(a, b) >= _APART_M for a, b in pairs):
                self._actors += actors
                self._motions += motions
                return True
        return False

    def _door(self, *, but: str = "") -> str:
        return self._rng.choice([door for door in self._place.doors if door != but] or [but])

    def _near(self, spot: str, spread: float = 0.25) -> tuple[float, float]:
        x, y = self._place.spots[spot]
        return round(x + self._rng.uniform(-spread, spread), 2), round(y + self._rng.uniform(-spread, spread), 2)

    def _speed(self) -> float:
        return round(min(max(self._rng.gauss(1.15, 0.15), 0.7), 1.5), 2)

    def _visitor(self, names: list[str], start: float) -> list[Actor]:
        """Comes to the robot; some want help, others only say hello."""
        door, speed = self._door(), self._speed()
        wants_help = self._rng.random() < 0.55
        stay = self._rng.uniform(16, 26) if wants_help else self._rng.uniform(4, 7)
        spot = self._rng.choice([spot for spot in self._place.spots if spot.startswith("robot")])
        legs = (
            Leg(walk=self._near(spot, 0.3), speed=speed, face="robot", aim="help" if wants_help else "visit"),
            Leg(stand=round(stay, 1), face="robot", aim="help" if wants_help else "visit"),
            Leg(walk=self._door(), speed=speed),
        )
        return [Actor(names[0], door, legs, start)]

    def _pair(self, names: list[str], start: float) -> list[Actor]:
        """Two people come to the robot together."""
        door, leaving, speed = self._door(), self._door(), self._speed()
        stay = round(self._rng.uniform(6, 20), 1)
        aim = "help" if stay > 14 else "visit"
        actors = []
        for name, side, late in zip(names, (-0.45, 0.45), (0.0, 0.9), strict=True):
            goal = (round(1.9 + self._rng.uniform(-0.1, 0.2), 2), round(side + self._rng.uniform(-0.1, 0.1), 2))
            legs = (
                Leg(walk=goal, speed=speed, face="robot", aim=aim),
                Leg(stand=round(stay + late, 1), face="robot", aim=aim),
                Leg(walk=leaving, speed=speed),
            )
            actors.append(Actor(name, door, legs, round(start + late, 2)))
        return actors

    def _passer(self, names: list[str], start: float) -> list[Actor]:
        """Walks through, past the robot, without interest in it."""
        door, speed = self._door(), self._speed()
        across = (round(self._rng.uniform(2.2, 4.5), 2), round(self._rng.uniform(-1.5, 1.5), 2))
        glance = "robot" if self._rng.random() < 0.25 else ""
        legs = (
            Leg(walk=across, speed=speed, face=glance, aim="pass"),
            Leg(walk=self._door(but=door), speed=speed, aim="pass"),
        )
        return [Actor(names[0], door, legs, start)]

    def _company(self, names: list[str], start: float) -> list[Actor]:
        """Two people meet, talk to each other and go; sometimes one of them comes to the robot afterwards."""
        spot = self._rng.choice([spot for spot in self._place.spots if spot.startswith(("chat", "middle"))])
        x, y = self._near(spot)
        reach, talk = self._rng.uniform(0.42, 0.6), round(self._rng.uniform(12, 28), 1)
        aside = self._rng.random() < 0.5
        offsets = ((0.0, reach), (0.0, -reach)) if aside else ((reach * 0.8, reach * 0.6), (-reach * 0.8, -reach * 0.6))
        actors = []
        for number, (name, (dx, dy)) in enumerate(zip(names, offsets, strict=True)):
            late = round(number * self._rng.uniform(0.8, 3.0), 2)
            other = names[1 - number]
            legs = [
                Leg(walk=(round(x + dx, 2), round(y + dy, 2)), speed=self._speed(), aim="company"),
                Leg(talk=round(talk - late, 1), to=other, aim="company"),
            ]
            if number and self._rng.random() < 0.3:
                legs += [
                    Leg(walk=self._near("robot_1", 0.3), face="robot", aim="visit"),
                    Leg(stand=5.0, face="robot", aim="visit"),
                ]
            legs.append(Leg(walk=self._door(), speed=self._speed()))
            actors.append(Actor(name, self._door(), tuple(legs), round(start + late, 2)))
        return actors

    def _reader(self, names: list[str], start: float) -> list[Actor]:
        """Looks at a picture on a wall with the back to the robot, and goes."""
        spots = [spot for spot in self._place.spots if not spot.startswith(("robot", "chat", "middle"))]
        spot = self._rng.choice(spots or list(self._place.spots))
        x, y = self._near(spot, 0.15)
        legs = (
            Leg(walk=(x, y), speed=self._speed(), aim="pass"),
            Leg(stand=round(self._rng.uniform(6, 14), 1), face="wall", aim="rest"),
            Leg(walk=self._door(), speed=self._speed(), aim="pass"),
        )
        return [Actor(names[0], self._door(), legs, start)]

    def _rester(self, names: list[str], start: float) -> list[Actor]:
        """Sits for a while."""
        seat = self._rng.choice(list(self._place.seats))
        legs = (
            Leg(sit=seat, seconds=round(self._rng.uniform(12, 30), 1), aim="rest", speed=self._speed()),
            Leg(walk=self._door(), speed=self._speed(), aim="pass"),
        )
        return [Actor(names[0], self._door(), legs, start)]
