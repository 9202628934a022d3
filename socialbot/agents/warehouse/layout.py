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

import re
from dataclasses import replace
from pathlib import Path

from ruamel.yaml.comments import CommentedSeq

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
from socialbot.core.yaml import YamlSection, line_of, read_page

MAX_BOXES = 96
DEPOSIT_DISTANCE_M = round(DEPOSIT_Y - BASE_Y, 3)
LONGEST_TRIP_S = 6.5  # without noise; the gripper waits for 8 s

_BOX_NAME = re.compile(r"box_[a-z0-9_]+")


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
    root.only("grippers", "carriers", "boxes", "seed", "stacks", "deposits", "deposit_distance_m", "speeds")
    if "carriers" not in root.page:
        raise GraphError("'carriers' is missing", where=root.where, remedy="give the number of carriers")
    carriers = root.whole("carriers", 1, minimum=1, maximum=MAX_CARRIERS)
    scenarios = _random(root, carriers) if "boxes" in root.page else (_explicit(root, carriers),)
    distance = root.number("deposit_distance_m", DEPOSIT_DISTANCE_M, minimum=2.0, maximum=5.0)
    speeds = root.section("speeds", {})
    speeds.only("crane", "carriers")
    crane, carrier = (speeds.number(name, 1.0, minimum=0.5, maximum=3.0) for name in ("crane", "carriers"))
    speed = carrier * CARRIER_SPEED
    trip_s = distance / speed + speed / CARRIER_ACCELERATION
    if trip_s > LONGEST_TRIP_S:
        key = ("speeds", "carriers") if "carriers" in speeds.page else ("deposit_distance_m",)
        raise GraphError(
            f"a carrier drives {trip_s:.1f} s from its deposit; the gripper waits for {LONGEST_TRIP_S} s",
            where=root.line(*key),
            remedy="give a shorter 'deposit_distance_m', or higher 'speeds: {carriers}'",
        )
    deposit_y, relative = BASE_Y + distance, Speeds(crane, carrier)
    return tuple(replace(scenario, deposit_y=deposit_y, speeds=relative) for scenario in scenarios)


def _random(root: YamlSection, carriers: int) -> tuple[Scenario, ...]:
    for key in ("stacks", "deposits"):
        if key in root.page:
            raise GraphError(
                f"both 'boxes' and {key!r}", where=root.line(key), remedy=f"remove {key!r}, or 'boxes' and 'seed'"
            )
    boxes = root.whole("boxes", carriers, minimum=carriers, maximum=MAX_BOXES)
    grippers = root.whole("grippers", 1, minimum=1, maximum=min(MAX_GRIPPERS, carriers))
    return aisles_of(boxes, carriers, grippers, seed=root.whole("seed", 0, minimum=0, maximum=2**31 - 1))


def _explicit(root: YamlSection, carriers: int) -> Scenario:
    if root.page.get("grippers", 1) != 1:
        raise GraphError(
            "several grippers have random stacks only",
            where=root.line("grippers"),
            remedy="give 'boxes' and 'seed' instead of 'stacks' and 'deposits'",
        )
    if "seed" in root.page:
        raise GraphError("'seed' without 'boxes'", where=root.line("seed"), remedy="give 'boxes' for random stacks")
    stacks, deposits = _boxes(root, "stacks"), _boxes(root, "deposits")
    for line, stack in stacks:
        if len(stack) > STACK_HEIGHT:
            raise GraphError(f"a stack of {len(stack)} boxes; the highest has {STACK_HEIGHT}", where=line)
    if len(deposits) != carriers:
        raise GraphError(
            f"{len(deposits)} deposits for {carriers} carriers",
            where=root.line("deposits"),
            remedy="give a list of boxes for each carrier",
        )
    stacked = {box for _, stack in stacks for box in stack}
    wanted = {box for _, load in deposits for box in load}
    for missing, key, other in ((wanted - stacked, "deposits", "stacks"), (stacked - wanted, "stacks", "deposits")):
        if missing:
            raise GraphError(
                f"{', '.join(sorted(missing))} is not in {other!r}", where=root.line(key), remedy=f"add it to {other!r}"
            )
    if not 0 < len(stacked) <= MAX_BOXES:
        raise GraphError(f"{len(stacked)} boxes; there must be 1 to {MAX_BOXES}", where=root.line("stacks"))
    return Scenario(tuple(stack for _, stack in stacks), tuple(load for _, load in deposits))


def _boxes(root: YamlSection, key: str) -> list[tuple[str, tuple[str, ...]]]:
    """The lists of box names below ``key``, each with its file and line."""
    lists = root.page.get(key)
    if not isinstance(lists, CommentedSeq):
        raise GraphError(
            f"{key!r} must be a list of lists of boxes, got {lists!r}",
            where=root.line(key),
            remedy="or give 'boxes' for random stacks",
        )
    key_line = root.line(key)
    file, _, first = key_line.rpartition(":")
    found: list[tuple[str, tuple[str, ...]]] = []
    seen: set[str] = set()
    for number, names in enumerate(lists):
        line = f"{file}:{line_of(lists, number, int(first))}"
        if not isinstance(names, list):
            raise GraphError(f"expected a list of boxes, got {names!r}", where=line)
        for name in names:
            if not isinstance(name, str) or not _BOX_NAME.fullmatch(name):
                raise GraphError(
                    f"no valid name of a box: {name!r}",
                    where=line,
                    remedy="write box_, then a-z, 0-9 or _",
                )
            if name in seen:
                raise GraphError(f"{name} stands twice in {key!r}", where=line)
            seen.add(name)
        found.append((line, tuple(map(str, names))))
    return found
