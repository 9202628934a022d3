"""Layout files of warehouses in YAML: grippers, carriers, stacks, deposits and speeds.

::

    carriers: 2                    # up to 26: carrier_a and carrier_b, each with a loading bay and a deposit
    stacks:                        # boxes of each stack, from bottom to top
      - [box_1, box_2, box_3]
      - []
    deposits:                      # boxes for the deposit of each carrier
      - [box_1, box_3]
      - [box_2]
    deposit_distance_m: 3.2        # from a bay to its deposit
    speeds: {crane: 1.0, carriers: 1.2}    # relative to the standard speeds

Instead of ``stacks`` and ``deposits``, ``boxes: 40`` and ``seed: 3`` give equal loads in stacks of random order. Only
then ``grippers: 3`` is possible: gripper_a, gripper_b and gripper_c, each in an aisle with its share of the carriers.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import msgspec

from socialbot.agents.warehouse.scenario import (
    BASE_Y,
    DEPOSIT_Y,
    MAX_CARRIERS,
    MAX_GRIPPERS,
    STACK_HEIGHT,
    Scenario,
    Speeds,
    aisles_of,
)
from socialbot.agents.warehouse.world import CARRIER_ACCELERATION, CARRIER_SPEED
from socialbot.core import paths
from socialbot.core.errors import GraphError
from socialbot.core.yaml import YamlSection, read_page

MAX_BOXES = 96
DEPOSIT_DISTANCE_M = round(DEPOSIT_Y - BASE_Y, 3)
LONGEST_TRIP_S = 6.5  # without noise; the gripper waits for 8 s

_Box = Annotated[
    str, msgspec.Meta(pattern=r"box_[a-z0-9_]+", description="a name of a box; write box_, then a-z, 0-9 or _")
]
_Boxes = Annotated[
    tuple[tuple[_Box, ...], ...],
    msgspec.Meta(description="a list of lists of boxes; or give 'boxes' for random stacks"),
]


class _Layout(msgspec.Struct):
    carriers: Annotated[int, msgspec.Meta(ge=1, le=MAX_CARRIERS)]
    grippers: int = 1
    boxes: int = 0
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)] = 0
    stacks: _Boxes = ()
    deposits: _Boxes = ()
    deposit_distance_m: Annotated[float, msgspec.Meta(ge=2.0, le=5.0)] = DEPOSIT_DISTANCE_M
    speeds: Speeds = Speeds()


def load_layout(file: str | Path, *, where: str = "layout") -> tuple[Scenario, ...]:
    """Read a layout file of the workspace, as a scenario for each gripper.

    Args:
        file: Path, relative to the working directory.
        where: Name of the parameter, for errors.

    Raises:
        ParameterError: The file is outside of the workspace.
        GraphError: The file cannot be read, or is no layout; with file and line.
    """
    path = paths.in_workspace(file, where=where)
    return parse_layout(paths.read_text(path, GraphError), where=str(path))


def parse_layout(text: str, *, where: str) -> tuple[Scenario, ...]:
    """Parse a layout from YAML, as a scenario for each gripper; errors name ``where``. Raises GraphError."""
    root = read_page(text, where=where)
    layout = root.read(_Layout)
    scenarios = _random(root, layout) if "boxes" in root.page else (_explicit(root, layout),)
    speed = layout.speeds.carriers * CARRIER_SPEED
    trip_s = layout.deposit_distance_m / speed + speed / CARRIER_ACCELERATION
    if trip_s > LONGEST_TRIP_S:
        key = ("deposit_distance_m",) if layout.speeds.carriers == 1.0 else ("speeds", "carriers")
        raise GraphError(
            f"a carrier drives {trip_s:.1f} s from its deposit; the gripper waits for {LONGEST_TRIP_S} s",
            where=root.line(*key),
            remedy="give a shorter 'deposit_distance_m', or higher 'speeds: {carriers}'",
        )
    deposit_y = BASE_Y + layout.deposit_distance_m
    return tuple(replace(scenario, deposit_y=deposit_y, speeds=layout.speeds) for scenario in scenarios)


def _random(root: YamlSection, layout: _Layout) -> tuple[Scenario, ...]:
    for key in ("stacks", "deposits"):
        if key in root.page:
            raise GraphError(
                f"both 'boxes' and {key!r}", where=root.line(key), remedy=f"remove {key!r}, or 'boxes' and 'seed'"
            )
    boxes = root.value("boxes", Annotated[int, msgspec.Meta(ge=layout.carriers, le=MAX_BOXES)])
    most = min(MAX_GRIPPERS, layout.carriers)
    grippers = root.value("grippers", Annotated[int, msgspec.Meta(ge=1, le=most)], 1)
    return aisles_of(boxes, layout.carriers, grippers, seed=layout.seed)


def _explicit(root: YamlSection, layout: _Layout) -> Scenario:
    if layout.grippers != 1:
        raise GraphError(
            "several grippers have random stacks only",
            where=root.line("grippers"),
            remedy="give 'boxes' and 'seed' instead of 'stacks' and 'deposits'",
        )
    if "seed" in root.page:
        raise GraphError("'seed' without 'boxes'", where=root.line("seed"), remedy="give 'boxes' for random stacks")
    boxes = {key: _unique(root, key) for key in ("stacks", "deposits")}
    for number, stack in enumerate(layout.stacks):
        if len(stack) > STACK_HEIGHT:
            what = f"a stack of {len(stack)} boxes; the highest has {STACK_HEIGHT}"
            raise GraphError(what, where=root.line("stacks", number))
    if len(layout.deposits) != layout.carriers:
        raise GraphError(
            f"{len(layout.deposits)} deposits for {layout.carriers} carriers",
            where=root.line("deposits"),
            remedy="give a list of boxes for each carrier",
        )
    for key, other in (("deposits", "stacks"), ("stacks", "deposits")):
        if missing := boxes[key] - boxes[other]:
            raise GraphError(
                f"{', '.join(sorted(missing))} is not in {other!r}", where=root.line(key), remedy=f"add it to {other!r}"
            )
    if not 0 < len(boxes["stacks"]) <= MAX_BOXES:
        what = f"{len(boxes['stacks'])} boxes; there must be 1 to {MAX_BOXES}"
        raise GraphError(what, where=root.line("stacks"))
    return Scenario(layout.stacks, layout.deposits)


def _unique(root: YamlSection, key: str) -> set[str]:
    """Return the names of the boxes below ``key``. Raises GraphError if it is missing, or a box stands there twice."""
    found: set[str] = set()
    for number, names in enumerate(root.value(key, _Boxes)):
        for name in names:
            if name in found:
                raise GraphError(f"{name} stands twice in {key!r}", where=root.line(key, number))
            found.add(name)
    return found
