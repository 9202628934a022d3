"""The building in numbers: where doors, windows, furniture and lamps are."""

from __future__ import annotations

from dataclasses import dataclass

HALF, CEILING, WALL = 1.5, 2.75, 0.1
DOOR, SILL, LINTEL = 2.1, 0.85, 2.3

Opening = tuple[int, float, float]


@dataclass(frozen=True)
class Thing:
    """A piece of furniture or a distractor; x, y (m) where it stands, or the side and y where it hangs.

    turn: degrees about the upright axis; look: which of several colours or pictures.
    """

    kind: str
    x: float
    y: float
    turn: float = 0.0
    look: int = 0


@dataclass(frozen=True)
class Layout:
    """A corridor along +y; openings are (side: -1 left, 1 right; from y, to y).

    lamps: "panels", "strip" or "spots"; sun: the way its light goes; back: y of the end behind the camera; half: half
    the width.
    """

    length: float
    doorways: tuple[Opening, ...]
    closed: tuple[Opening, ...]
    windows: tuple[Opening, ...] = ()
    things: tuple[Thing, ...] = ()
    lamps: str = "panels"
    sun: tuple[float, float, float] = (0.0, 0.0, -1.0)
    back: float = -1.5
    walled: bool = False
    half: float = HALF


@dataclass(frozen=True)
class Room:
    """A room ahead of the camera, with a passage behind its far wall.

    half: half its width; depth: y of the far wall; back: y of the wall behind the camera (m). doorways: openings of
    the far wall (x from, to). passage: how far it goes on behind them. glass: panes in the room (y, x from, to), up to
    2.3 m. wall, floor: their colours.
    """

    half: float = 3.4
    depth: float = 6.0
    back: float = -1.5
    ceiling: float = CEILING
    doorways: tuple[tuple[float, float], ...] = ()
    passage: float = 2.2
    glass: tuple[tuple[float, float, float], ...] = ()
    things: tuple[Thing, ...] = ()
    wall: tuple[float, float, float] = (0.66, 0.64, 0.58)
    floor: tuple[float, float, float] = (0.30, 0.29, 0.27)
    accent: tuple[float, float, float] = (0.2, 0.3, 0.35)
    lamps: str = "grid"


@dataclass(frozen=True)
class Light:
    """A state of the light: strength of the sun, of the sky in the windows, and of lamps (one in every `every`).

    ambient: what the walls throw back on average (linear RGB), for renders that do not follow the light that far.
    """

    name: str
    sun: float = 0.0
    sky: float = 0.0
    lamps: float = 1.0
    every: int = 1
    ambient: tuple[float, float, float] = (0.3, 0.3, 0.3)


OLD = Layout(
    length=17.0,
    doorways=((-1, 11.45, 12.45), (1, 10.75, 11.75), (1, 7.6, 8.6)),
    closed=((-1, 3.6, 4.5), (1, 4.4, 5.3), (-1, 8.3, 9.2), (1, 13.6, 14.5), (-1, 14.8, 15.7)),
    things=(Thing("board", 1, 6.45), Thing("radiator", -1, 6.7), Thing("extinguisher", -1, 10.37)),
)
DOORWAYS = ((-1, 5.2, 6.2), (-1, 11.45, 12.45), (-1, 18.6, 19.6))
EVEN = Layout(
    length=22.0,
    doorways=(*DOORWAYS, (1, 7.6, 8.6), (1, 15.6, 16.6)),
    closed=((1, 3.3, 4.2), (-1, 8.2, 9.1), (1, 11.2, 12.1), (-1, 14.9, 15.8), (1, 18.9, 19.8)),
    lamps="strip",
    back=-3.0,
    walled=True,
)
SUNNY = Layout(
    length=22.0,
    doorways=DOORWAYS,
    closed=((-1, 8.2, 9.1), (-1, 14.9, 15.8)),
    windows=tuple((1, round(1.2 + 2.3 * k, 2), round(2.7 + 2.3 * k, 2)) for k in range(9)),
    lamps="spots",
    back=-3.0,
    walled=True,
)
