"""Where things are in the warehouse, m: x along the row of bays, y from the bays to the deposits, z up."""

from __future__ import annotations

import math

from socialbot.agents.warehouse.cast import START, Cast
from socialbot.agents.warehouse.messages import Point

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


class Layout:
    """The places of a cast by name: ``places`` of the crane, ``bays`` and ``deposits`` of the carriers."""

    def __init__(self, cast: Cast) -> None:
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
