"""A warehouse scenario: where things are (m), which boxes and carriers there are, and which faults occur."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from string import ascii_lowercase
from typing import Literal

from socialbot.agents.warehouse.messages import Point
from socialbot.core.errors import ParameterError
from socialbot.deliberation.messages import FLUENT, INSTANCE, Desire, Fact

BASE_Y = 1.08
DEPOSIT_Y = 4.28
"""Where carriers stop."""

COLUMN_M = 0.9
"""From one bay, or stack, to the next."""
SLOT_M = 0.16
"""The two boxes on a carrier stand this far before and behind its middle."""

BOX_M = 0.22
"""Height of a box; it is 0.28 m long and wide."""
BOX_WIDTH_M = 0.28
DECK_M = 0.25
"""Height of a carrier's deck."""
FOOTPRINT = (0.44, 1.0)
"""Size of the deck in x and y."""
CARRIED_M = 0.30
"""A box counts as carried when its middle is over the deck, no higher than this."""

HIGH_M = 1.5
"""Height of the gripper's fingers when it is up."""

STACKS_Y = -0.6
SHELF = 4
"""Boxes of a deposit that stand in a row."""


class FloorLayout:
    """The places of a cast by name: ``places`` of the crane, ``bays`` and ``deposits`` of the carriers."""

    def __init__(self, cast: Scenario) -> None:
        self.columns = max(len(cast.carriers), 3)
        self.places: dict[str, Point] = {START: Point(self._x(0) - COLUMN_M, 0.24, 0.0)}
        for number, base in enumerate(cast.bases):
            row, column = divmod(number, self.columns)
            self.places[base] = Point(self._x(column), STACKS_Y - row * COLUMN_M, 0.0)
        self.bays: dict[str, Point] = {}
        self.deposits: dict[str, Point] = {}
        for column, (bay, deposit) in enumerate(zip(cast.bays, cast.deposits, strict=True)):
            x = self._x(column)
            self.bays[bay] = self.places[bay] = Point(x, BASE_Y, 0.0)
            self.places[f"{bay}1"] = Point(x, BASE_Y - SLOT_M, 0.0)
            self.places[f"{bay}2"] = Point(x, BASE_Y + SLOT_M, 0.0)
            self.deposits[deposit] = Point(x, DEPOSIT_Y, 0.0)

    def _x(self, column: int) -> float:
        return (column - (self.columns - 1) / 2) * COLUMN_M

    @property
    def longest_m(self) -> float:
        """The longest way of the crane."""
        points = self.places.values()
        return max(flat_distance(a, b) for a in points for b in points)

    def stored(self, deposit: str, number: int) -> Point:
        """Where the box ``number`` (from 0) of a deposit stands: in rows behind the place where the carrier stops."""
        stop = self.deposits[deposit]
        level, number = divmod(number, 2 * SHELF)
        row, place = divmod(number, SHELF)
        x = stop.x + (row - 0.5) * (BOX_WIDTH_M + 0.06)
        return Point(x, stop.y + 0.8 + place * (BOX_WIDTH_M + 0.04), (level + 0.5) * BOX_M)


def carrier_places(bay: Point, deposit: Point) -> dict[str, Point]:
    """The places of a carrier as it calls them."""
    return {"base": bay, "deposit": deposit}


def flat_distance(a: Point, b: Point) -> float:
    """The distance without regard to height, m."""
    return math.hypot(a.x - b.x, a.y - b.y)


def is_over(carrier: Point, point: Point) -> bool:
    """Whether ``point`` is over the deck of a carrier that stands at ``carrier``."""
    return abs(point.x - carrier.x) <= FOOTPRINT[0] / 2 and abs(point.y - carrier.y) <= FOOTPRINT[1] / 2


def is_carried(carrier: Point, box: Point) -> bool:
    """Whether a box counts as carried: its middle is over the deck, and hardly above it."""
    return is_over(carrier, box) and 0.0 <= box.z - DECK_M <= CARRIED_M


def carried(carrier: Point, boxes: dict[str, Point]) -> tuple[str, ...]:
    """Which of ``boxes`` count as carried, sorted."""
    return tuple(sorted(name for name, box in boxes.items() if is_carried(carrier, box)))


FOLDER = Path(str(files("socialbot.agents.warehouse")))
GRIPPER_DOMAIN = FOLDER / "gripper.pddl"
CARRIER_DOMAIN = FOLDER / "carrier.pddl"
GRIPPER_RULES = FOLDER / "gripper_rules.yaml"
CARRIER_RULES = FOLDER / "carrier_rules.yaml"
HASTY_CARRIER_RULES = FOLDER / "hasty_carrier_rules.yaml"
"""A carrier that leaves with one box instead of two."""

GRIPPER = "gripper_a"
START = "start"
STACK_HEIGHT = 3
"""As many boxes may stand on each other."""
LOAD = 2
"""As many boxes fit on a carrier."""

SIX_SORTED_S = 116.0
BOX_SORTED_S = 30.0
"""s that sorting may take: the demonstration (its plan lasts 107 s), and each box of another cast."""


@dataclass(frozen=True)
class Scenario:
    """The boxes as they are stacked, and the carriers with the boxes that each shall take.

    ``stacks`` are the boxes of base_1, base_2, ... from bottom to top; ``loads`` those for carrier_a, carrier_b, ...
    """

    stacks: tuple[tuple[str, ...], ...]
    loads: tuple[tuple[str, ...], ...]

    @property
    def letters(self) -> str:
        """``abc``: one letter for each carrier, its bay and its deposit."""
        return ascii_lowercase[: len(self.loads)]

    @property
    def carriers(self) -> tuple[str, ...]:
        """carrier_a, carrier_b, ..."""
        return tuple(f"carrier_{letter}" for letter in self.letters)

    @property
    def bases(self) -> tuple[str, ...]:
        """base_1, base_2, ...: where boxes are stacked."""
        return tuple(f"base_{number + 1}" for number in range(len(self.stacks)))

    @property
    def bays(self) -> tuple[str, ...]:
        """base_a, base_b, ...: where carriers are loaded."""
        return tuple(f"base_{letter}" for letter in self.letters)

    @property
    def deposits(self) -> tuple[str, ...]:
        """deposit_a, deposit_b, ..."""
        return tuple(f"deposit_{letter}" for letter in self.letters)

    @property
    def boxes(self) -> tuple[str, ...]:
        """All boxes, sorted."""
        return tuple(sorted(box for stack in self.stacks for box in stack))


SIX = Scenario(
    stacks=(("box_a1", "box_c2", "box_a2"), ("box_b1", "box_b2", "box_c1"), ()),
    loads=(("box_a1", "box_a2"), ("box_b1", "box_b2"), ("box_c1", "box_c2")),
)
"""The demonstration: six boxes and three carriers."""


def scenario_of(boxes: int = 6, carriers: int = 3) -> Scenario:
    """The demonstration, or as many ``boxes`` and ``carriers``: boxes shared out evenly, stacked in a mixed order.

    The same numbers give the same cast. Raises ParameterError for less than a box a carrier or more than 26 carriers.
    """
    if (boxes, carriers) == (6, 3):
        return SIX
    if not 1 <= carriers <= len(ascii_lowercase) or boxes < carriers:
        raise ParameterError(
            f"no warehouse with {boxes} boxes and {carriers} carriers",
            remedy="give 1 to 26 carriers, and at least one box for each",
        )
    loads: list[list[str]] = [[] for _ in range(carriers)]
    for number in range(boxes):
        share = loads[number % carriers]
        share.append(f"box_{ascii_lowercase[number % carriers]}{len(share) + 1}")
    mixed = [box for share in loads for box in share]
    random.Random(f"{boxes} boxes").shuffle(mixed)
    stacks = [tuple(mixed[first : first + STACK_HEIGHT]) for first in range(0, boxes, STACK_HEIGHT)]
    return Scenario((*stacks, ()), tuple(map(tuple, loads)))


def gripper_beliefs(cast: Scenario) -> tuple[Fact, ...]:
    """What the gripper believes at the start.

    In the demonstration boxes may be put down on all stacks, else on the last base only: planners try each in vain.
    """
    stackbases = (START, *cast.bases, *cast.bays)
    found = [_instance(GRIPPER, "gripper")]
    found += [_instance(name, "box") for name in cast.boxes]
    found += [_instance(name, "stackbase") for name in stackbases]
    found += [_instance(name, "carrier") for name in cast.carriers]
    found += [_instance(name, "deposit") for name in cast.deposits]
    found += [_fact("upon", GRIPPER, START), _value(0, "holding_boxes", GRIPPER)]
    found += [_fact("in", base, base) for base in stackbases]
    for base, stack in zip(cast.bases, cast.stacks, strict=True):
        found += [_fact("on", box, below, base) for below, box in pairwise((base, *stack))]
        found += [_fact("in", box, base) for box in stack]
        found += [_fact("clear", (base, *stack)[-1]), _value(len(stack), "stacked", base)]
    for carrier, bay, deposit in zip(cast.carriers, cast.bays, cast.deposits, strict=True):
        found += [_fact("clear", bay), _value(0, "stacked", bay), _fact("carrier_in_deposit", carrier, deposit)]
        found += [_fact("carrier_can_come", carrier, bay), _fact("carrier_can_go", carrier, deposit)]
        found += [_value(0, "moving_boxes", carrier)]
    found += [_fact("takes_boxes", base) for base in (cast.bases if cast == SIX else cast.bases[-1:])]
    return tuple(found)


def gripper_desires(cast: Scenario) -> tuple[Desire, ...]:
    """What the gripper wants at the start: each box with its carrier, and itself where it began."""
    wanted = [_fact("upon", GRIPPER, START)]
    for carrier, load in zip(cast.carriers, cast.loads, strict=True):
        wanted += [_fact("carrier_moving", carrier, box) for box in load]
    deadline = SIX_SORTED_S if cast == SIX else BOX_SORTED_S * len(cast.boxes)
    return (Desire(name="sort_boxes", priority=0.2, deadline=deadline, value=tuple(wanted)),)


def carrier_beliefs(carrier: str) -> tuple[Fact, ...]:
    """What a carrier believes at the start."""
    return (
        _instance(carrier, "carrier"),
        _instance("base", "base_wp"),
        _instance("deposit", "deposit_wp"),
        _fact("in", carrier, "deposit"),
        _fact("fully_unloaded", carrier),
        _value(0, "moving_boxes", carrier),
    )


def _instance(name: str, kind: str) -> Fact:
    return Fact(name=name, pddl_type=INSTANCE, type=kind)


def _fact(name: str, *params: str) -> Fact:
    return Fact(name=name, params=params)


def _value(value: float, name: str, *params: str) -> Fact:
    return Fact(name=name, pddl_type=FLUENT, params=params, value=float(value))


FaultKind = Literal["leaves", "slips", "silent", "stalls"]

BOXES = "boxes"
"""The sensor that knows where the boxes are."""

_REMEDY = "write faults as: 30 leaves carrier_c; 40 slips; 50 silent carrier_a 10; 60 stalls gripper_a 3"


@dataclass(frozen=True, slots=True)
class WarehouseFault:
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


def parse_faults(text: str, cast: Scenario) -> tuple[WarehouseFault, ...]:
    """The faults that ``text`` lists, separated by semicolons. Raises ParameterError."""
    return tuple(_fault(part.split(), cast) for part in text.split(";") if part.strip())


def _fault(words: list[str], cast: Scenario) -> WarehouseFault:
    robots = (GRIPPER, *cast.carriers)
    try:
        match words:
            case time, "leaves", who if who in cast.carriers:
                return WarehouseFault(_seconds(time), "leaves", who)
            case time, "slips":
                return WarehouseFault(_seconds(time), "slips")
            case time, "silent", who, duration if who in (*robots, BOXES):
                return WarehouseFault(_seconds(time), "silent", who, _seconds(duration))
            case time, "stalls", who, duration if who in robots:
                return WarehouseFault(_seconds(time), "stalls", who, _seconds(duration))
    except ValueError as error:
        raise ParameterError(f"no time in s: {error}", where=f"fault {' '.join(words)!r}", remedy=_REMEDY) from error
    raise ParameterError(f"no fault: {' '.join(words)!r}", where="faults", remedy=_REMEDY)


def _seconds(word: str) -> float:
    seconds = float(word)
    if not 0.0 <= seconds <= 1e6:
        raise ValueError(f"{word} is not between 0 and 1000000")
    return seconds


def random_faults(seed: int, cast: Scenario, *, until_s: float = 150.0) -> tuple[WarehouseFault, ...]:
    """One to four faults before ``until_s``, in the order of their times; the same for the same seed."""
    chance = random.Random(f"faults {seed}")
    robots = (GRIPPER, *cast.carriers)
    found = []
    for _ in range(chance.randint(1, 4)):
        time_s = round(chance.uniform(5.0, until_s), 1)
        match chance.choice(("leaves", "slips", "silent", "stalls")):
            case "leaves":
                found.append(WarehouseFault(time_s, "leaves", chance.choice(cast.carriers)))
            case "slips":
                found.append(WarehouseFault(time_s, "slips"))
            case "silent":
                found.append(WarehouseFault(time_s, "silent", chance.choice((*robots, BOXES)), 10.0))
            case _:
                found.append(
                    WarehouseFault(time_s, "stalls", chance.choice(robots), round(chance.uniform(1.0, 8.0), 1))
                )
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))
