"""What goes wrong in the warehouse, and when."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Literal

from socialbot.agents.warehouse.cast import GRIPPER, Cast
from socialbot.errors import ParameterError

FaultKind = Literal["leaves", "slips", "silent", "stalls"]

BOXES = "boxes"
"""The sensor that knows where the boxes are."""

_REMEDY = "write faults as: 30 leaves carrier_c; 40 slips; 50 silent carrier_a 10; 60 stalls gripper_a 3"


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong at ``time_s`` (s from the start of the world).

    A carrier ``leaves`` for its deposit; the box ``slips`` at the next grasp; what tells of a robot, or of the
    boxes, is ``silent``, or a robot ``stalls``, for ``duration_s``.
    """

    time_s: float
    kind: FaultKind
    who: str = ""
    duration_s: float = 0.0

    def __str__(self) -> str:
        duration = f"{self.duration_s!r}" if self.kind in ("silent", "stalls") else ""
        return " ".join(filter(None, (f"{self.time_s!r}", self.kind, self.who, duration)))


def parse_faults(text: str, cast: Cast) -> tuple[Fault, ...]:
    """The faults that ``text`` lists, separated by semicolons. Raises ParameterError."""
    return tuple(_fault(part.split(), cast) for part in text.split(";") if part.strip())


def _fault(words: list[str], cast: Cast) -> Fault:
    robots = (GRIPPER, *cast.carriers)
    try:
        match words:
            case time, "leaves", who if who in cast.carriers:
                return Fault(_seconds(time), "leaves", who)
            case time, "slips":
                return Fault(_seconds(time), "slips")
            case time, "silent", who, duration if who in (*robots, BOXES):
                return Fault(_seconds(time), "silent", who, _seconds(duration))
            case time, "stalls", who, duration if who in robots:
                return Fault(_seconds(time), "stalls", who, _seconds(duration))
    except ValueError as error:
        raise ParameterError(f"no time in s: {error}", where=f"fault {' '.join(words)!r}", remedy=_REMEDY) from error
    raise ParameterError(f"no fault: {' '.join(words)!r}", where="faults", remedy=_REMEDY)


def _seconds(word: str) -> float:
    seconds = float(word)
    if not 0.0 <= seconds <= 1e6:
        raise ValueError(f"{word} is not between 0 and 1000000")
    return seconds


def random_faults(seed: int, cast: Cast, *, until_s: float = 150.0) -> tuple[Fault, ...]:
    """One to four faults before ``until_s``, in the order of their times; the same for the same seed."""
    chance = random.Random(f"faults {seed}")
    robots = (GRIPPER, *cast.carriers)
    found = []
    for _ in range(chance.randint(1, 4)):
        time_s = round(chance.uniform(5.0, until_s), 1)
        match chance.choice(("leaves", "slips", "silent", "stalls")):
            case "leaves":
                found.append(Fault(time_s, "leaves", chance.choice(cast.carriers)))
            case "slips":
                found.append(Fault(time_s, "slips"))
            case "silent":
                found.append(Fault(time_s, "silent", chance.choice((*robots, BOXES)), 10.0))
            case _:
                found.append(Fault(time_s, "stalls", chance.choice(robots), round(chance.uniform(1.0, 8.0), 1)))
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))
