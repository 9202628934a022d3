"""Random schedules of people in a place: visitors, passers-by, company and people who rest, by seed."""

from __future__ import annotations

import random
from collections.abc import Callable

from socialbot.robots.simulation.people import Actor, Leg, Motion, Script, nearest_approach
from socialbot.robots.simulation.place import Place

_APART_M = 0.5  # Least distance of two people, who are drawn anew otherwise.
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
