"""What goes wrong in the ward, and when: written down, or drawn by chance."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Literal

from socialbot.agents.hospital.ward.messages import (
    CLOSED_DOOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
)
from socialbot.agents.hospital.ward.ward import NURSE, Ward
from socialbot.core.errors import ParameterError

FaultKind = Literal["dirty", "closes", "drains", "enters", "leaves", "silent", "slow", "stalls"]

STATE_SENSOR = "state"
"""All sensors of the ward at once."""
SLOW_S = 2.0
"""A slow sensor looks this seldom."""

PROBLEM_OF: dict[FaultKind, str] = {
    "dirty": DIRTY_ROOM,
    "closes": CLOSED_DOOR,
    "drains": LOW_BATTERY,
    "enters": PERSON_IN_ROOM,
    "leaves": NURSE_ABSENT,
}
"""The problem that actions meet after a fault of that kind."""

STAY_S = (5.0, 15.0)
"""How long a person who walks in stays, and a nurse who is called away, at least and at most."""

_REMEDY = (
    "write faults as: 2 dirty room1; 3 closes room2; 4 drains spotrobot1; 5 enters room1 10; "
    "6 leaves nurse_disinfected1 10; 7 silent uvdrobot1 5; 8 slow state 5; 9 stalls uvdrobot1 3"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong at ``time_s`` (s from the start of the world).

    A room gets ``dirty``, its door ``closes``; the battery of a robot ``drains``. For ``duration_s`` a person
    ``enters`` a room, a nurse ``leaves`` the ward, a robot or nurse ``stalls``. The sensor of a room, robot or nurse,
    or `STATE_SENSOR`, is ``silent`` for so long, or ``slow``: it tells of what was up to `SLOW_S` ago.
    """

    time_s: float
    kind: FaultKind
    who: str
    duration_s: float = 0.0

    def __str__(self) -> str:
        lasting = [] if self.kind in ("dirty", "closes", "drains") else [_written(self.duration_s)]
        return " ".join([_written(self.time_s), self.kind, self.who, *lasting])


def parse_faults(text: str, ward: Ward) -> tuple[Fault, ...]:
    """The faults that ``text`` lists, separated by semicolons. Raises ParameterError."""
    return tuple(_fault(part.split(), ward) for part in text.split(";") if part.strip())


def _fault(words: list[str], ward: Ward) -> Fault:
    rooms, members = ward.room_by_name, ward.member_by_name
    try:
        match words:
            case time, ("dirty" | "closes") as kind, room if room in rooms:
                return Fault(_seconds(time), kind, room)
            case time, "drains", robot if robot in ward.robots:
                return Fault(_seconds(time), "drains", robot)
            case time, "enters", room, duration if room in rooms:
                return Fault(_seconds(time), "enters", room, _seconds(duration))
            case time, "leaves", nurse, duration if nurse in ward.of_kind(NURSE):
                return Fault(_seconds(time), "leaves", nurse, _seconds(duration))
            case time, "stalls", who, duration if who in members:
                return Fault(_seconds(time), "stalls", who, _seconds(duration))
            case time, ("silent" | "slow") as kind, who, duration if who in {*rooms, *members, STATE_SENSOR}:
                return Fault(_seconds(time), kind, who, _seconds(duration))
    except ValueError as error:
        raise ParameterError(f"no time in s: {error}", where=f"fault {' '.join(words)!r}", remedy=_REMEDY) from error
    raise ParameterError(f"no fault: {' '.join(words)!r}", where="faults", remedy=_REMEDY)


def _written(seconds: float) -> str:
    return str(seconds).removesuffix(".0")


def _seconds(word: str) -> float:
    seconds = float(word)
    if not 0.0 <= seconds <= 1e6:
        raise ValueError(f"{word} is not between 0 and 1000000")
    return seconds


def drawn_problems(ward: Ward, seed: int, rate: float) -> tuple[Fault, ...]:
    """What the missions of one run meet: of ``rate`` per cent of the infections, each by itself, one problem.

    It is the same for the same seed, and no command changes it. Sorted by time.
    """
    chance = random.Random(f"problems {seed}")
    found = []
    for time_s, room in ward.infections:
        [meets] = chance.choices((False, True), weights=(100.0 - rate, rate))
        problem = _problem(ward, room, chance, time_s)
        if meets:
            found.append(problem)
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))


def _problem(ward: Ward, room: str, chance: random.Random, infected_s: float) -> Fault:
    """A problem of the mission in ``room``; a low battery may be that of any robot."""
    time_s = max(round(infected_s + chance.uniform(*ward.window_s), 2), 0.0)
    stay_s = round(chance.uniform(*STAY_S), 1)
    robot = chance.choice(ward.robots or ("",))
    nurse = next((member.name for member in ward.members if (member.kind, member.home) == (NURSE, room)), "")
    could = {
        DIRTY_ROOM: Fault(time_s, "dirty", room),
        CLOSED_DOOR: Fault(time_s, "closes", room),
        PERSON_IN_ROOM: Fault(time_s, "enters", room, stay_s),
        **({LOW_BATTERY: Fault(time_s, "drains", robot)} if robot else {}),
        **({NURSE_ABSENT: Fault(time_s, "leaves", nurse, stay_s)} if nurse else {}),
    }
    kinds = [kind for kind in ward.problems if kind in could]
    return could[chance.choice(kinds)] if kinds else could[DIRTY_ROOM]


def random_faults(ward: Ward, seed: int, *, until_s: float = 60.0) -> tuple[Fault, ...]:
    """One to six faults of any kind before ``until_s``, in the order of their times; the same for the same seed."""
    chance = random.Random(f"faults {seed}")
    rooms, members = list(ward.room_by_name), list(ward.member_by_name)
    robots, nurses = ward.robots, ward.of_kind(NURSE)
    kinds: list[FaultKind] = ["dirty", "closes", "enters", "silent", "slow", "stalls"]
    if robots:
        kinds.append("drains")
    if nurses:
        kinds.append("leaves")
    found = []
    for _ in range(chance.randint(1, 6)):
        time_s, duration_s = round(chance.uniform(0.0, until_s), 1), round(chance.uniform(1.0, 15.0), 1)
        kind = chance.choice(kinds)
        match kind:
            case "dirty" | "closes":
                found.append(Fault(time_s, kind, chance.choice(rooms)))
            case "drains":
                found.append(Fault(time_s, kind, chance.choice(robots)))
            case "enters":
                found.append(Fault(time_s, kind, chance.choice(rooms), duration_s))
            case "leaves":
                found.append(Fault(time_s, kind, chance.choice(nurses), duration_s))
            case "stalls":
                found.append(Fault(time_s, kind, chance.choice(members), duration_s))
            case _:
                found.append(Fault(time_s, kind, chance.choice([*rooms, *members, STATE_SENSOR]), duration_s))
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))
