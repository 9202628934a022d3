"""Who and what is in a warehouse: boxes in stacks, carriers, and what each agent believes and wants at the start."""

from __future__ import annotations

import random
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from string import ascii_lowercase

from socialbot.agent_messages import FLUENT, INSTANCE, Desire, Fact
from socialbot.errors import ParameterError

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
class Cast:
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


SIX = Cast(
    stacks=(("box_a1", "box_c2", "box_a2"), ("box_b1", "box_b2", "box_c1"), ()),
    loads=(("box_a1", "box_a2"), ("box_b1", "box_b2"), ("box_c1", "box_c2")),
)
"""The demonstration: six boxes and three carriers."""


def cast_of(boxes: int = 6, carriers: int = 3) -> Cast:
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
    return Cast((*stacks, ()), tuple(map(tuple, loads)))


def gripper_beliefs(cast: Cast) -> tuple[Fact, ...]:
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


def gripper_desires(cast: Cast) -> tuple[Desire, ...]:
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
