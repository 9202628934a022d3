"""Places for people and a robot: rooms with doors, spots, seats and furniture, from YAML files."""

from __future__ import annotations

import functools
import math
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import msgspec

from socialbot.core.errors import ParameterError, suggestion
from socialbot.core.yaml import read_page
from socialbot.robots.simulation.figure import Colour

Spot = tuple[float, float]


class Door(msgspec.Struct, frozen=True):
    """A door: a point outside, where people appear and vanish, and one inside."""

    outside: Spot
    inside: Spot


class Seat(msgspec.Struct, frozen=True):
    """A seat, with the direction in which people sit on it."""

    at: Spot
    heading: float


class Furniture(msgspec.Struct, frozen=True):
    """A piece of furniture; see `PIECES`."""

    kind: str
    at: Spot
    heading: float = 0.0
    colour: Colour | None = None


class Picture(msgspec.Struct, frozen=True):
    """A picture or window on a wall."""

    at: tuple[float, float, float]
    heading: float
    size: tuple[float, float]
    colour: Colour


class Place(msgspec.Struct, frozen=True):
    """A room. The robot stands at 0, 0 and looks along x."""

    size: tuple[float, float, float, float]
    height: float
    floor: Colour
    walls: Colour
    doors: dict[str, Door]
    spots: dict[str, Spot]
    seats: dict[str, Seat] = {}
    furniture: tuple[Furniture, ...] = ()
    pictures: tuple[Picture, ...] = ()


class Block(NamedTuple):
    """A box, cylinder or ellipsoid of furniture: its middle against that of the piece, and half sizes (m)."""

    shape: str
    at: tuple[float, float, float]
    size: tuple[float, float, float]
    colour: Colour | None = None


_WOOD, _METAL, _LEAF, _POT = (0.50, 0.37, 0.25), (0.30, 0.31, 0.33), (0.16, 0.36, 0.15), (0.62, 0.42, 0.32)
PIECES: dict[str, tuple[Block, ...]] = {
    "sofa": (
        Block("box", (0.05, 0, 0.22), (0.40, 0.85, 0.20)),
        Block("box", (-0.33, 0, 0.56), (0.12, 0.85, 0.26)),
        Block("box", (0.05, 0.80, 0.40), (0.40, 0.09, 0.20)),
        Block("box", (0.05, -0.80, 0.40), (0.40, 0.09, 0.20)),
    ),
    "bench": (
        Block("box", (0.1, 0, 0.43), (0.22, 0.80, 0.03)),
        Block("box", (0.1, 0.65, 0.2), (0.18, 0.03, 0.20), _METAL),
        Block("box", (0.1, -0.65, 0.2), (0.18, 0.03, 0.20), _METAL),
    ),
    "low_table": (
        Block("box", (0, 0, 0.40), (0.35, 0.60, 0.02)),
        Block("box", (0, 0, 0.19), (0.25, 0.45, 0.19), _METAL),
    ),
    "desk": (
        Block("box", (0, 0, 0.72), (0.38, 0.75, 0.02)),
        Block("box", (0, 0.68, 0.36), (0.34, 0.02, 0.35), _METAL),
        Block("box", (0, -0.68, 0.36), (0.34, 0.02, 0.35), _METAL),
        Block("box", (-0.12, 0, 0.95), (0.02, 0.29, 0.17), (0.07, 0.07, 0.08)),
        Block("box", (-0.15, 0, 0.78), (0.06, 0.08, 0.05), (0.07, 0.07, 0.08)),
        Block("box", (0.16, 0, 0.745), (0.07, 0.21, 0.01), (0.20, 0.20, 0.21)),
    ),
    "chair": (
        Block("box", (0, 0, 0.44), (0.22, 0.23, 0.03)),
        Block("box", (-0.25, 0, 0.72), (0.03, 0.20, 0.25)),
        Block("cylinder", (0, 0, 0.22), (0.03, 0.22, 0), _METAL),
        Block("cylinder", (0, 0, 0.03), (0.25, 0.02, 0), _METAL),
    ),
    "plant": (
        Block("cylinder", (0, 0, 0.2), (0.17, 0.2, 0), _POT),
        Block("ellipsoid", (0, 0, 0.75), (0.26, 0.26, 0.36), _LEAF),
        Block("ellipsoid", (0.1, 0.1, 1.1), (0.18, 0.2, 0.28), (0.20, 0.42, 0.18)),
        Block("ellipsoid", (-0.12, -0.06, 0.98), (0.2, 0.16, 0.26), (0.13, 0.31, 0.13)),
    ),
    "column": (Block("cylinder", (0, 0, 1.5), (0.20, 1.5, 0), (0.80, 0.79, 0.76)),),
    "shelf": (
        Block("box", (0, 0, 0.9), (0.15, 0.60, 0.9)),
        Block("box", (0.13, 0.02, 1.35), (0.04, 0.50, 0.13), (0.62, 0.25, 0.20)),
        Block("box", (0.13, -0.05, 0.85), (0.04, 0.50, 0.13), (0.22, 0.36, 0.50)),
        Block("box", (0.13, 0.05, 0.40), (0.04, 0.50, 0.13), (0.66, 0.58, 0.30)),
    ),
    "cabinet": (
        Block("box", (0, 0, 0.55), (0.22, 0.55, 0.55)),
        Block("box", (0.225, 0, 0.55), (0.004, 0.01, 0.5), _METAL),
    ),
    "bin": (Block("cylinder", (0, 0, 0.3), (0.16, 0.3, 0), _METAL),),
}
"""Blocks of each kind of furniture; ahead is the front."""


def placed(piece: Furniture) -> list[tuple[Block, tuple[float, float, float], Colour]]:
    """Return the blocks of a piece of furniture, with their middles in the room and their colours."""
    cos, sin = math.cos(piece.heading), math.sin(piece.heading)
    found = []
    for block in PIECES[piece.kind]:
        x, y, z = block.at
        middle = (piece.at[0] + cos * x - sin * y, piece.at[1] + sin * x + cos * y, z)
        found.append((block, middle, block.colour or piece.colour or _WOOD))
    return found


def place_names() -> list[str]:
    """Return the names of the places that come with socialbot."""
    folder = resources.files("socialbot.robots.simulation") / "places"
    return sorted(Path(each.name).stem for each in folder.iterdir() if each.name.endswith(".yaml"))


@functools.cache
def load_place(name: str) -> Place:
    """Return a place by name. Raises ParameterError for an unknown one."""
    if name not in place_names():
        raise ParameterError(f"there is no place {name!r}", remedy=f"choose one of: {', '.join(place_names())}")
    return read_place(
        (resources.files("socialbot.robots.simulation") / "places" / f"{name}.yaml").read_text("utf-8"), where=name
    )


def read_place(text: str, *, where: str) -> Place:
    """Read a place from YAML. Raises ParameterError if it is none."""
    root = read_page(text, where=where, error=ParameterError)
    place = root.read(Place)
    for number, piece in enumerate(place.furniture):
        if piece.kind not in PIECES:
            what, remedy = f"there is no furniture {piece.kind!r}", suggestion(piece.kind, PIECES)
            raise ParameterError(what, where=root.line("furniture", number, "kind"), remedy=remedy)
    return place
