"""Messages of robots and sensors of the warehouse, and their commands."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from socialbot.core.clock import SECOND
from socialbot.core.messages import Structured

OBEYED_NS = SECOND  # time that a command may take to arrive. Until then, a status shows the previous target


class Point(msgspec.Struct, frozen=True):
    """A position, m: x along the row of bays, y from the bays to the deposits, z up from the floor."""

    x: float
    y: float
    z: float


class MoveStatus(Structured, frozen=True, kw_only=True):
    """Place and movement of a robot.

    ``current_name`` is ``moving`` between places. ``dist`` is the remaining distance (m), ``progress`` the finished
    share of the path. For the gripper, the z of ``current_pos`` is the height of its fingers.
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
    """Command to move: a carrier to ``base`` or ``deposit``, the gripper to a named place."""

    target: str


class GripperPose(Structured, frozen=True, kw_only=True):
    """Command to lower the fingers to the next surface, or to lift them."""

    pose: Literal["high", "low"]


class GripperStatus(Structured, frozen=True, kw_only=True):
    """Command to open or close the fingers, or their status."""

    status: Literal["open", "close"]


class UnloadCommand(Structured, frozen=True, kw_only=True):
    """Command to a carrier at its deposit to unload its boxes."""


class BoxPosition(msgspec.Struct, frozen=True, kw_only=True):
    """Position of the middle of a box, and its holder: a base, the gripper, a carrier, a deposit or ``floor``."""

    name: str
    position: Point
    holder: str


class BoxPositions(Structured, frozen=True, kw_only=True):
    """Positions of all boxes, sorted by name."""

    boxes: tuple[BoxPosition, ...]


WAREHOUSE_MESSAGES: tuple[type[Structured], ...] = (
    MoveStatus, MoveCommand, GripperPose, GripperStatus, UnloadCommand, BoxPositions,
)  # fmt: skip
