"""What robots and sensors of the warehouse say, and what they are told."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from socialbot.core.clock import SECOND
from socialbot.core.messages import Structured

OBEYED_NS = SECOND
"""A command may be under way so long; meanwhile a robot still tells what it was told before."""


class Point(msgspec.Struct, frozen=True):
    """A position, m: x along the row of bays, y from the bays to the deposits, z up from the floor."""

    x: float
    y: float
    z: float


class MoveStatus(Structured, frozen=True, kw_only=True):
    """Where a robot is and where it goes.

    ``current_name`` is ``moving`` between places. ``dist`` is what is left of the way, m, and ``progress`` what is
    done of it, 0 to 1. For the gripper the z of ``current_pos`` is that of its fingers.
    """

    robot: str
    start_name: str
    current_name: str
    target_name: str
    current_pos: Point
    target_pos: Point
    dist: float
    progress: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class MoveCommand(Structured, frozen=True, kw_only=True):
    """Tells a robot where to go: a carrier to ``base`` or ``deposit``, the gripper to a place by its name."""

    target: str


class GripperPose(Structured, frozen=True, kw_only=True):
    """Tells the gripper to go down until it touches what is beneath, or up."""

    pose: Literal["high", "low"]


class GripperStatus(Structured, frozen=True, kw_only=True):
    """Tells the gripper to open or close its fingers, or tells which they are."""

    status: Literal["open", "close"]


class UnloadCommand(Structured, frozen=True, kw_only=True):
    """Tells a carrier at its deposit to put down its boxes there."""


class BoxPosition(msgspec.Struct, frozen=True, kw_only=True):
    """A box, where its middle is, and what bears it: a base, the gripper, a carrier, a deposit or ``floor``."""

    name: str
    position: Point
    holder: str


class BoxPositions(Structured, frozen=True, kw_only=True):
    """All boxes, sorted by name."""

    boxes: tuple[BoxPosition, ...]


WAREHOUSE_MESSAGES: tuple[type[Structured], ...] = (
    MoveStatus, MoveCommand, GripperPose, GripperStatus, UnloadCommand, BoxPositions,
)  # fmt: skip
