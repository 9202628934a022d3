"""Warehouse scenarios: floor layout (m), boxes and carriers, initial beliefs and desires, and faults."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from string import ascii_lowercase
from typing import Annotated

import msgspec

from socialbot.agents.base._simulation import WorldFault, parse_world_faults
from socialbot.agents.warehouse.messages import Point
from socialbot.core.errors import ParameterError
from socialbot.deliberation.messages import Desire, Fact
from socialbot.deliberation.sensing import fluent, instance, predicate

BASE_Y, DEPOSIT_Y = 1.08, 4.28  # stops of the carriers
COLUMN_M = 0.9  # distance between neighbouring bays or stacks
SLOT_M = 0.16  # distance of the two boxes on a carrier from its middle
BOX_M = 0.22  # height of a box; it is 0.28 m long and wide
BOX_WIDTH_M = 0.28
DECK_M = 0.25  # height of a carrier's deck
FOOTPRINT = (0.44, 1.0)  # size of the deck in x and y
CARRIED_M = 0.30  # largest height of the middle of a carried box above the deck
HIGH_M = 1.5  # height of the lifted fingers

STACKS_Y = -0.6
SHELF = 4  # boxes in a row of a deposit


class FloorLayout:
    """Positions of a scenario by name: ``places`` of the crane, ``bays`` and ``deposits`` of the carriers."""

    def __init__(self, scenario: Scenario) -> None:
        self.columns = max(len(scenario.carriers), 3)
        self._middle_x = scenario.middle_x
        self.places: dict[str, Point] = {START: Point(self._x(0) - COLUMN_M, 0.24, 0.0)}
        for number, base in enumerate(scenario.bases):
            row, column = divmod(number, self.columns)
            self.places[base] = Point(self._x(column), STACKS_Y - row * COLUMN_M, 0.0)
        self.bays: dict[str, Point] = {}
        self.deposits: dict[str, Point] = {}
        for column, (_, bay, deposit) in enumerate(scenario.routes):
            x = self._x(column)
            self.bays[bay] = self.places[bay] = Point(x, BASE_Y, 0.0)
            self.places[f"{bay}1"] = Point(x, BASE_Y - SLOT_M, 0.0)
            self.places[f"{bay}2"] = Point(x, BASE_Y + SLOT_M, 0.0)
            self.deposits[deposit] = Point(x, scenario.deposit_y, 0.0)

    def _x(self, column: int) -> float:
        return self._middle_x + (column - (self.columns - 1) / 2) * COLUMN_M

    @property
    def longest_m(self) -> float:
        """Longest path of the crane, m."""
        points = self.places.values()
        return max(flat_distance(a, b) for a in points for b in points)

    def stored(self, deposit: str, number: int) -> Point:
        """Position of the box ``number`` (from 0) of a deposit, in rows behind the stop of the carrier."""
        stop = self.deposits[deposit]
        level, number = divmod(number, 2 * SHELF)
        row, place = divmod(number, SHELF)
        x = stop.x + (row - 0.5) * (BOX_WIDTH_M + 0.06)
        return Point(x, stop.y + 0.8 + place * (BOX_WIDTH_M + 0.04), (level + 0.5) * BOX_M)


def flat_distance(a: Point, b: Point) -> float:
    """Horizontal distance, m."""
    return math.hypot(a.x - b.x, a.y - b.y)


def is_over(carrier: Point, point: Point) -> bool:
    """Whether a point is over the deck of a carrier at ``carrier``."""
    return abs(point.x - carrier.x) <= FOOTPRINT[0] / 2 and abs(point.y - carrier.y) <= FOOTPRINT[1] / 2


def is_carried(carrier: Point, box: Point) -> bool:
    """Whether a box is on the carrier: over its deck, and at most `CARRIED_M` above it."""
    return is_over(carrier, box) and 0.0 <= box.z - DECK_M <= CARRIED_M


FOLDER = Path(str(files("socialbot.agents.warehouse")))
GRIPPER_DOMAIN = FOLDER / "gripper.pddl"
CARRIER_DOMAIN = FOLDER / "carrier.pddl"
GRIPPER_RULES = FOLDER / "gripper_rules.yaml"
CARRIER_RULES = FOLDER / "carrier_rules.yaml"
HASTY_CARRIER_RULES = FOLDER / "hasty_carrier_rules.yaml"  # rules of a carrier that leaves with one box instead of two

GRIPPER = "gripper_a"
MAX_GRIPPERS = 4
GRIPPER_NAMES = tuple(f"gripper_{letter}" for letter in ascii_lowercase[:MAX_GRIPPERS])
START = "start"
STACK_HEIGHT = 3  # largest number of boxes in a stack
LOAD = 2  # largest number of boxes on a carrier

CARRIER_NAMES = tuple(f"carrier_{letter}" for letter in ascii_lowercase)  # of the largest warehouse
MAX_CARRIERS = len(CARRIER_NAMES)

SIX_SORTED_S = 116.0  # deadline of the six boxes, whose plan takes 107 s
BOX_SORTED_S = 30.0  # deadline of each box of another scenario


_Speed = Annotated[float, msgspec.Meta(ge=0.5, le=3.0)]


@dataclass(frozen=True)
class Speeds:
    """Speeds of the crane and the carriers, relative to the standard speeds."""

    crane: _Speed = 1.0
    carriers: _Speed = 1.0


@dataclass(frozen=True)
class Scenario:
    """Initial stacks of boxes, and the load of each carrier.

    ``stacks`` are the boxes of base_1, base_2, ... from bottom to top; ``loads`` those for carrier_a, ...
    ``deposit_y`` is the position of the deposits, and ``middle_x`` that of the aisle, m. A warehouse with several
    grippers has an aisle for each, with carriers from ``first_carrier`` and bases from ``first_base`` on.
    """

    stacks: tuple[tuple[str, ...], ...]
    loads: tuple[tuple[str, ...], ...]
    deposit_y: float = DEPOSIT_Y
    speeds: Speeds = Speeds()
    gripper: str = GRIPPER
    first_carrier: int = 0
    first_base: int = 0
    middle_x: float = 0.0

    @property
    def letters(self) -> str:
        """A letter for each carrier, its bay and its deposit."""
        return ascii_lowercase[self.first_carrier : self.first_carrier + len(self.loads)]

    @property
    def carriers(self) -> tuple[str, ...]:
        """carrier_a, carrier_b, ..."""
        return tuple(f"carrier_{letter}" for letter in self.letters)

    @property
    def bases(self) -> tuple[str, ...]:
        """base_1, base_2, ...: bases of stacks."""
        return tuple(f"base_{self.first_base + number + 1}" for number in range(len(self.stacks)))

    @property
    def bays(self) -> tuple[str, ...]:
        """base_a, base_b, ...: loading bays."""
        return tuple(f"base_{letter}" for letter in self.letters)

    @property
    def deposits(self) -> tuple[str, ...]:
        """deposit_a, deposit_b, ..."""
        return tuple(f"deposit_{letter}" for letter in self.letters)

    @property
    def boxes(self) -> tuple[str, ...]:
        """All boxes, sorted."""
        return tuple(sorted(box for stack in self.stacks for box in stack))

    @property
    def routes(self) -> tuple[tuple[str, str, str], ...]:
        """Each carrier with its bay and its deposit."""
        return tuple(zip(self.carriers, self.bays, self.deposits, strict=True))


SIX = Scenario(
    stacks=(("box_a1", "box_c2", "box_a2"), ("box_b1", "box_b2", "box_c1"), ()),
    loads=(("box_a1", "box_a2"), ("box_b1", "box_b2"), ("box_c1", "box_c2")),
)
"""Scenario of the demo: six boxes and three carriers."""


def scenario_of(boxes: int = 6, carriers: int = 3, *, seed: int = 0) -> Scenario:
    """The scenario with so many boxes and carriers: equal loads, stacked in a mixed order.

    The same numbers give the same scenario; a ``seed`` other than 0 gives another order. Raises ParameterError for
    fewer boxes than carriers, or more than 26 carriers.
    """
    return aisles_of(boxes, carriers, 1, seed=seed)[0]


def aisles_of(boxes: int, carriers: int, grippers: int, *, seed: int = 0) -> tuple[Scenario, ...]:
    """The scenarios of the aisles of several grippers, which share the boxes and carriers; see `scenario_of`.

    Raises ParameterError, also for fewer carriers than grippers, or more than `MAX_GRIPPERS`.
    """
    if (boxes, carriers, grippers, seed) == (6, 3, 1, 0):
        return (SIX,)
    if not 1 <= grippers <= min(MAX_GRIPPERS, max(carriers, 1)):
        raise ParameterError(
            f"no warehouse with {grippers} grippers and {carriers} carriers",
            remedy=f"give 1 to {MAX_GRIPPERS} grippers, and at least one carrier for each",
        )
    if not 1 <= carriers <= MAX_CARRIERS or boxes < carriers:
        raise ParameterError(
            f"no warehouse with {boxes} boxes and {carriers} carriers",
            remedy="give 1 to 26 carriers, and at least one box for each",
        )
    loads: list[list[str]] = [[] for _ in range(carriers)]
    for number in range(boxes):
        share = loads[number % carriers]
        share.append(f"box_{ascii_lowercase[number % carriers]}{len(share) + 1}")
    chance = random.Random(f"{boxes} boxes {seed}" if seed else f"{boxes} boxes")
    found: list[Scenario] = []
    first_base = 0
    right_x = 0.0
    for number in range(grippers):
        first, end = (carriers * edge // grippers for edge in (number, number + 1))
        mixed = [box for share in loads[first:end] for box in share]
        chance.shuffle(mixed)
        stacks = [tuple(mixed[low : low + STACK_HEIGHT]) for low in range(0, len(mixed), STACK_HEIGHT)]
        half_m = max(end - first, 3) / 2 * COLUMN_M
        found.append(
            Scenario(
                (*stacks, ()),
                tuple(map(tuple, loads[first:end])),
                gripper=GRIPPER_NAMES[number],
                first_carrier=first,
                first_base=first_base,
                middle_x=right_x + COLUMN_M + half_m if number else 0.0,
            )
        )
        first_base += len(stacks) + 1
        right_x = found[-1].middle_x + half_m
    return tuple(found)


def gripper_beliefs(scenario: Scenario) -> tuple[Fact, ...]:
    """Initial beliefs of the gripper.

    Boxes may be put down on all bases of the demo. Larger scenarios allow only the last one, as each base costs the
    planner time.
    """
    stackbases = (START, *scenario.bases, *scenario.bays)
    objects = {"gripper": (scenario.gripper,), "box": scenario.boxes, "stackbase": stackbases}
    objects |= {"carrier": scenario.carriers, "deposit": scenario.deposits}
    found = [instance(name, kind) for kind, names in objects.items() for name in names]
    found += [predicate("upon", scenario.gripper, START), fluent("holding_boxes", scenario.gripper)]
    found += [predicate("in", base, base) for base in stackbases]
    for base, stack in zip(scenario.bases, scenario.stacks, strict=True):
        found += [predicate("on", box, below, base) for below, box in pairwise((base, *stack))]
        found += [predicate("in", box, base) for box in stack]
        found += [predicate("clear", (base, *stack)[-1]), fluent("stacked", base, value=float(len(stack)))]
    for carrier, bay, deposit in scenario.routes:
        found += [predicate("clear", bay), fluent("stacked", bay), predicate("carrier_in_deposit", carrier, deposit)]
        found += [predicate("carrier_can_come", carrier, bay), predicate("carrier_can_go", carrier, deposit)]
        found += [fluent("moving_boxes", carrier)]
    found += [predicate("takes_boxes", base) for base in (scenario.bases if scenario == SIX else scenario.bases[-1:])]
    return tuple(found)


def gripper_desires(scenario: Scenario) -> tuple[Desire, ...]:
    """Initial desire of the gripper: each box with its carrier, and the gripper at its start."""
    wanted = [predicate("upon", scenario.gripper, START)]
    for carrier, load in zip(scenario.carriers, scenario.loads, strict=True):
        wanted += [predicate("carrier_moving", carrier, box) for box in load]
    deadline = SIX_SORTED_S if scenario == SIX else BOX_SORTED_S * len(scenario.boxes)
    return (Desire(name="sort_boxes", priority=0.2, deadline=deadline, value=tuple(wanted)),)


def carrier_beliefs(carrier: str) -> tuple[Fact, ...]:
    """Initial beliefs of a carrier."""
    return (
        instance(carrier, "carrier"),
        instance("base", "base_wp"),
        instance("deposit", "deposit_wp"),
        predicate("in", carrier, "deposit"),
        predicate("fully_unloaded", carrier),
        fluent("moving_boxes", carrier),
    )


BOXES = "boxes"  # name of the sensor for box positions


def parse_faults(text: str, *scenarios: Scenario) -> tuple[WorldFault, ...]:
    """Parse the faults of a warehouse with an aisle for each scenario. Raises ParameterError.

    Kinds: a carrier ``leaves`` for its deposit; the box ``slips`` at the next grasp; a box ``vanishes``. The sensor of
    a robot, or `BOXES`, is ``silent``, or a robot ``stalls``, for a duration.
    """
    examples = "30 leaves carrier_c; 40 slips; 50 silent carrier_a 10; 60 stalls gripper_a 3"
    targets = {**_fault_targets(*scenarios), "vanishes": [box for scenario in scenarios for box in scenario.boxes]}
    return parse_world_faults(text, targets, ("silent", "stalls"), examples)


def faults_in(scenario: Scenario, faults: Iterable[WorldFault]) -> tuple[WorldFault, ...]:
    """The faults of one aisle. The next grasp, which slips, is that of the first gripper."""
    names = {scenario.gripper, *scenario.carriers, *scenario.boxes, BOXES}
    if scenario.gripper == GRIPPER:
        names.add("")
    return tuple(fault for fault in faults if fault.target in names)


def _fault_targets(*scenarios: Scenario) -> dict[str, list[str] | None]:
    carriers = [carrier for scenario in scenarios for carrier in scenario.carriers]
    robots = [robot for scenario in scenarios for robot in (scenario.gripper, *scenario.carriers)]
    return {"leaves": carriers, "slips": None, "silent": [*robots, BOXES], "stalls": robots}


def random_faults(seed: int, scenario: Scenario, *, until_s: float = 150.0) -> tuple[WorldFault, ...]:
    """One to four faults before ``until_s``, sorted by time. The same seed gives the same faults."""
    chance = random.Random(f"faults {seed}")
    targets = _fault_targets(scenario)
    found = []
    for _ in range(chance.randint(1, 4)):
        time_s, kind = round(chance.uniform(5.0, until_s), 1), chance.choice(tuple(targets))
        target = chance.choice(targets[kind] or ()) if kind != "slips" else ""
        duration_s = round(chance.uniform(1.0, 8.0), 1) if kind == "stalls" else 10.0 if kind == "silent" else None
        found.append(WorldFault(time_s, kind, target, duration_s))
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.target)))
