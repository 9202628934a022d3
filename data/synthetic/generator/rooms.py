"""Clips in rooms: visitors in a row, seated and still people, a head that turns, crowds, other cameras.

People D to I and P to R are in the tuning clips, J to O and S to U in the held-back ones; R and U are children.
"""

from __future__ import annotations

import math
from typing import Any

import clips
from clips import Clip
from layout import Light, Room, Thing
from optics import View
from visits import Go, Sit, Stay, Visit, visit

LIT = Light("lamps", ambient=(0.40, 0.38, 0.35))
NIGHT = Light("night", lamps=0.07, every=2, ambient=(0.009, 0.009, 0.011))
EVER = -4.0  # s; begin of people who are present in the first picture
BEHIND = 0.43  # m from the feet of a seated person to the middle of the seat


def to_camera(x: float, y: float) -> float:
    """The heading (degrees) of somebody at x, y who faces the camera."""
    return math.degrees(math.atan2(-x, y))


def caller(
    name: str,
    start: float,
    ways: tuple[tuple[float, float], ...],
    spot: tuple[float, float],
    seconds: float,
    away: tuple[tuple[float, float], ...],
    arms: str | None = None,
    speed: float = 1.25,
) -> Visit:
    """A visitor who comes along some points to a spot, faces the camera for some seconds, and leaves."""
    legs = [Go(*way, speed) for way in (*ways[1:], spot)]
    legs += [Stay(seconds, to_camera(*spot), arms), *(Go(*way, speed) for way in away)]
    return visit(name, start, ways[0], *legs)


def stands(name: str, x: float, y: float, heading: float, until: float, arms: str | None = None) -> Visit:
    """Somebody who stands all the time."""
    return visit(name, EVER, (x, y), Stay(until - EVER + 2, heading, arms), heading=heading)


def sits(
    name: str, x: float, y: float, heading: float, until: float, arms: str | None = "lap", height: float = 0.45
) -> Visit:
    """Somebody who sits all the time on a seat at x, y."""
    turn = math.radians(heading)
    feet = (x + BEHIND * math.sin(turn), y - BEHIND * math.cos(turn))
    return visit(name, EVER, feet, Sit(until - EVER + 4, height, arms), heading=heading)


def rolls(name: str, start: float, place: tuple[float, float], *legs: Go | Stay, heading: float = 0.0) -> Visit:
    """Somebody in a wheelchair."""
    return visit(name, start, place, *legs, carries="wheelchair", heading=heading)


# Visitors in a row

OFFICE = Room(
    half=3.4, depth=5.4, doorways=((-2.3, -1.2), (0.4, 1.5)), wall=(0.62, 0.64, 0.62), accent=(0.45, 0.22, 0.1),
    things=(
        Thing("painting", -0.4, 5.39, 0, 0), Thing("plant", 2.9, 4.9), Thing("coat stand", -2.8, 4.6, 30, 0),
        Thing("shelf", 2.5, 5.2, 0, 0), Thing("chair", -2.7, 3.5, 60, 0),
    ),
)  # fmt: skip
HALL = Room(
    half=3.1, depth=6.0, doorways=((-1.4, -0.3), (1.3, 2.3)), wall=(0.68, 0.6, 0.5), floor=(0.22, 0.16, 0.11),
    accent=(0.12, 0.25, 0.3),
    things=(
        Thing("painting", 0.5, 5.99, 0, 3), Thing("banner", -2.3, 5.4, 12, 1), Thing("bench", 2.6, 3.9, -75, 1),
        Thing("plant", -2.7, 3.9), Thing("bin", 2.75, 5.6),
    ),
)  # fmt: skip
FROM_RIGHT, FROM_LEFT = ((2.6, 6.4), (0.95, 6.3), (0.95, 5.2)), ((-0.6, 6.5), (0.95, 6.35), (0.95, 5.2))
TO_LEFT = ((-1.75, 5.0), (-1.75, 6.3), (-2.9, 6.4))
VISITORS_TUNE = Clip(
    "visitors_tune", "visitors", "tune", 57.0, OFFICE, ((0.0, LIT),),
    (
        caller("D", 0.6, FROM_RIGHT, (0.15, 2.0), 4.2, TO_LEFT, "wave"),
        caller("E", 8.6, FROM_LEFT, (-0.2, 1.8), 3.6, TO_LEFT),
        caller("F", 16.4, FROM_RIGHT, (0.3, 2.2), 4.4, TO_LEFT, speed=1.1),
        visit("P", 20.6, (2.6, 6.4), Go(0.95, 6.3), Go(0.8, 4.9), Go(-1.75, 4.7), Go(-1.75, 6.3), Go(-2.9, 6.4)),
        caller("D", 25.4, FROM_RIGHT, (-0.1, 1.9), 3.4, TO_LEFT),
        visit("Q", 24.0, (2.3, -0.8), Go(2.2, 2.0), Go(2.1, 4.1), Stay(3.4, 178), Go(0.95, 5.1), Go(0.95, 6.4),
              Go(2.4, 6.5)),
        caller("G", 35.0, FROM_LEFT, (0.05, 1.6), 3.8, TO_LEFT, "pockets"),
        caller("H", 42.0, FROM_RIGHT, (0.35, 2.4), 4.8, TO_LEFT),
        caller("I", 49.4, FROM_LEFT, (-0.25, 2.0), 6.0, ((-1.75, 5.0),)),
    ),
    start=1_700_011_000, rate=5, quality=50, view=View(eye=(0, 0, 1.0), pitch=math.radians(-3)),
)  # fmt: skip
IN_LEFT, IN_RIGHT = ((-2.4, 7.1), (-0.85, 7.0), (-0.85, 5.8)), ((0.6, 7.2), (-0.85, 7.0), (-0.85, 5.8))
OUT_RIGHT = ((1.8, 5.6), (1.8, 6.9), (2.8, 7.0))
VISITORS_HELDBACK = Clip(
    "visitors_heldback", "visitors", "held-back", 58.0, HALL, ((0.0, LIT),),
    (
        caller("M", 0.4, IN_RIGHT, (-0.25, 2.3), 3.8, OUT_RIGHT),
        caller("J", 8.0, IN_LEFT, (0.2, 1.9), 4.6, OUT_RIGHT, speed=1.1),
        visit("S", 20.4, (-2.4, 7.1), Go(-0.85, 7.0), Go(-0.85, 5.6), Go(1.8, 5.5), Go(1.8, 6.9), Go(2.8, 7.0)),
        caller("O", 17.4, IN_LEFT, (-0.1, 1.7), 4.0, OUT_RIGHT),
        caller("N", 25.0, IN_RIGHT, (0.3, 2.5), 3.6, OUT_RIGHT, "crossed"),
        visit("T", 29.0, (-2.2, -0.8), Go(-2.1, 1.9), Go(-1.9, 4.4), Stay(4.0, -176, "hips"), Go(-0.9, 5.5),
              Go(-0.85, 7.0), Go(0.6, 7.2)),
        caller("M", 32.4, IN_RIGHT, (0.1, 2.0), 3.2, OUT_RIGHT),
        caller("K", 40.4, IN_LEFT, (0.25, 1.8), 5.2, OUT_RIGHT, "wave"),
        caller("L", 49.2, IN_RIGHT, (-0.3, 2.1), 4.4, ((1.8, 5.6), (1.8, 6.9))),
    ),
    start=1_700_012_000, rate=5, quality=50, view=View(eye=(0, 0, 1.0), pitch=math.radians(-2)),
)  # fmt: skip

# Seated and still people

LOUNGE = Room(
    half=3.0, depth=5.6, wall=(0.6, 0.62, 0.68), floor=(0.36, 0.3, 0.22),
    things=(
        Thing("chair", -1.25, 2.5, 20, 0), Thing("bench", 0.95, 3.7, -12, 0), Thing("table", -1.3, 3.9, 0, 0),
        Thing("chair", -1.3, 4.7, 0, 1), Thing("shelf", 2.3, 5.4, 0, 1), Thing("painting", 0.3, 5.59, 0, 1),
        Thing("coat stand", -2.5, 5.2, 20, 1), Thing("chair", 1.9, 2.4, -35, 2), Thing("poster", -0.75, 5.6, 0, 1),
    ),
)  # fmt: skip
SEATED_TUNE = Clip(
    "seated_tune", "seated", "tune", 11.0, LOUNGE, ((0.0, LIT),),
    (
        sits("E", -1.25, 2.5, 20, 14.0), sits("D", 0.6, 3.78, -8, 14.0, "reading"), sits("R", 1.35, 3.62, -14, 14.0),
        sits("P", -1.3, 4.7, 6, 14.0, None), stands("G", 0.05, 4.7, 4, 14.0, "phone"),
        stands("H", -2.3, 3.4, 40, 14.0, "crossed"),
        rolls("I", 2.0, (2.7, -0.8), Go(1.1, 1.4, 0.8), Go(0.45, 2.1, 0.6, 8), Stay(8.0, 6, "lap"), heading=150),
        visit("Q", 6.2, (2.6, -0.6), Go(2.05, 1.0), Go(1.55, 1.75, 1.1), Stay(1.0, -35), Sit(9.0, arms="lap")),
    ),
    start=1_700_013_000, rate=5, quality=45, view=View(eye=(0, 0, 1.25), pitch=math.radians(6)), depth=True,
)  # fmt: skip
WARD = Room(
    half=2.7, depth=6.2, wall=(0.58, 0.66, 0.6), floor=(0.42, 0.42, 0.4), accent=(0.3, 0.3, 0.1),
    things=(
        Thing("bench", -1.0, 3.3, 14, 1), Thing("chair", 1.3, 2.3, -50, 1), Thing("chair", 1.5, 4.4, -12, 2),
        Thing("table", 0.0, 5.4, 0, 1), Thing("painting", -1.3, 6.19, 0, 4), Thing("banner", 2.1, 5.6, -10, 0),
        Thing("coat stand", -2.3, 5.6, 80, 0), Thing("chair", -1.8, 1.75, 40, 0),
    ),
)  # fmt: skip
SEATED_HELDBACK = Clip(
    "seated_heldback", "seated", "held-back", 11.0, WARD, ((0.0, LIT),),
    (
        sits("S", 1.3, 2.3, -50, 14.0), sits("T", -1.35, 3.22, 14, 14.0, "phone"), sits("U", -0.6, 3.4, 14, 14.0),
        sits("J", 1.5, 4.4, -12, 14.0, "reading"), stands("O", 0.55, 3.9, -6, 14.0),
        stands("N", -0.1, 4.9, 10, 14.0, "hips"),
        rolls("L", 1.4, (-2.4, -0.9), Go(-0.9, 1.3, 0.8), Go(-0.3, 1.95, 0.6, -8), Stay(8.6, -4, "lap"), heading=-150),
    ),
    start=1_700_014_000, rate=5, quality=45, view=View(eye=(0, 0, 1.15), pitch=math.radians(4)), depth=True,
)  # fmt: skip

# A head that turns

FOYER = Room(
    half=4.2, depth=5.4, wall=(0.66, 0.62, 0.56), floor=(0.25, 0.24, 0.24), doorways=((-0.6, 0.5),),
    accent=(0.25, 0.32, 0.2),
    things=(
        Thing("chair", 2.1, 3.3, -30, 1), Thing("table", 3.1, 3.9, 80, 0), Thing("shelf", -3.4, 5.2, 0, 0),
        Thing("banner", -2.2, 5.1, 8, 0), Thing("plant", 1.3, 5.1), Thing("coat stand", 3.6, 5.0, 40, 0),
        Thing("painting", 2.4, 5.39, 0, 6),
    ),
)  # fmt: skip
TURNING_TUNE = Clip(
    "turning_tune", "turning", "tune", 14.0, FOYER, ((0.0, LIT),),
    (
        stands("G", -2.1, 3.2, to_camera(-2.1, 3.2), 14.0, "phone"), sits("H", 2.1, 3.3, -30, 14.0),
        stands("D", 0.35, 4.4, -10, 14.0, "crossed"),
        visit("E", 0.2, (3.4, 2.6), Go(-3.6, 2.3, 1.0), Stay(1.0, 90), Go(1.0, 2.4, 1.1), Go(3.6, 2.2, 1.1)),
        visit("P", 3.0, (-0.1, 6.6), Go(-0.1, 5.0), Go(-0.9, 3.2), Stay(3.5, to_camera(-0.9, 3.2)), Go(-0.3, 5.0),
              Go(-0.1, 6.8)),
    ),
    start=1_700_015_000, rate=5, quality=45, view=View(eye=(0, 0, 1.2), pitch=math.radians(4)),
    turning=((0, 0, 4), (1.5, 0, 4), (3.5, 30, 4), (5.5, 30, -2), (8.5, -32, 4), (10.5, -32, 10), (12.5, 5, 4),
             (14, 5, 4)),
)  # fmt: skip
STUDIO = Room(
    half=4.0, depth=5.8, wall=(0.5, 0.56, 0.62), floor=(0.33, 0.22, 0.13), doorways=((1.0, 2.1),),
    accent=(0.4, 0.36, 0.28),
    things=(
        Thing("bench", -2.1, 3.5, 28, 1), Thing("shelf", 3.2, 5.6, 0, 1), Thing("banner", 0.2, 5.5, 0, 1),
        Thing("plant", -3.6, 5.3), Thing("table", -0.9, 5.2, 0, 1), Thing("coat stand", 2.9, 4.4, 10, 1),
        Thing("painting", -2.4, 5.79, 0, 8),
    ),
)  # fmt: skip
TURNING_HELDBACK = Clip(
    "turning_heldback", "turning", "held-back", 14.0, STUDIO, ((0.0, LIT),),
    (
        sits("L", -2.5, 3.28, 28, 14.0, "reading"), sits("U", -1.7, 3.7, 28, 14.0),
        stands("K", 1.9, 3.4, to_camera(1.9, 3.4), 14.0), stands("J", -0.1, 3.9, 15, 14.0, "pockets"),
        visit("N", 0.0, (-3.4, 2.2), Go(3.5, 2.5, 1.05), Stay(1.0, -90), Go(-1.0, 2.3, 1.15), Go(-3.5, 2.1, 1.15)),
        visit("T", 2.4, (1.5, 7.0), Go(1.5, 5.4), Go(0.9, 2.9), Stay(3.8, to_camera(0.9, 2.9)), Go(1.5, 5.4),
              Go(1.5, 7.2)),
    ),
    start=1_700_016_000, rate=5, quality=45, view=View(eye=(0, 0, 1.35), pitch=math.radians(5)),
    turning=((0, 5, 5), (1.0, 5, 5), (4.0, -30, 5), (5.5, -30, 12), (6.5, -20, 5), (9.5, 33, 5), (11.0, 33, 0),
             (13.0, 0, 5), (14, 0, 5)),
)  # fmt: skip

# Crowds, and people behind glass

GALLERY = Room(
    half=3.4, depth=6.2, wall=(0.7, 0.68, 0.64), floor=(0.4, 0.36, 0.3), glass=((4.2, 0.35, 3.3),),
    things=(
        Thing("painting", -1.6, 6.19, 0, 10), Thing("plant", -2.9, 5.6), Thing("shelf", 2.2, 6.0, 0, 0),
        Thing("banner", -0.35, 5.9, 5, 1),
    ),
)  # fmt: skip
CROWD_TUNE = Clip(
    "crowd_tune", "crowd", "tune", 14.0, GALLERY, ((0.0, LIT),),
    (
        stands("E", -1.5, 4.9, 80, 14.0, "crossed"), stands("F", -0.75, 5.0, -85, 14.0),
        stands("I", 1.7, 5.45, 10, 14.0, "phone"),
        visit("H", -1.0, (3.0, 4.8), Go(0.8, 4.8, 0.9), Stay(2.0, 0), Go(2.9, 4.85, 0.9), Stay(1.5, -20),
              Go(0.9, 4.8, 0.9)),
        visit("D", -0.5, (-2.8, 2.3), Go(2.8, 2.2, 1.15), Stay(2.2, -90), Go(2.6, 3.15), Go(-2.8, 3.15, 1.15)),
        visit("G", 0.8, (2.8, 3.0), Go(-2.8, 2.9, 1.2), Stay(2.6, 90), Go(2.8, 2.45, 1.15)),
        visit("P", 1.4, (-2.9, 3.6), Go(0.4, 3.6, 1.1), Stay(1.6, 0, "wave"), Go(2.9, 3.6, 1.1), Stay(1.5, -90),
              Go(-2.6, 3.65, 1.2)),
        visit("Q", 4.6, (2.8, 1.7), Go(-0.3, 1.6, 1.1), Stay(1.8, 0), Go(-2.8, 1.8, 1.1)),
    ),
    start=1_700_017_000, rate=5, quality=45, view=View(eye=(0, 0, 1.5), pitch=math.radians(6)),
)  # fmt: skip
ATRIUM = Room(
    half=3.6, depth=6.6, wall=(0.55, 0.58, 0.54), floor=(0.3, 0.32, 0.34), glass=((4.5, -3.5, -0.2),),
    things=(
        Thing("painting", 1.7, 6.59, 0, 12), Thing("plant", 3.1, 6.1), Thing("table", -2.2, 6.0, 0, 1),
        Thing("coat stand", 0.6, 6.2, 0, 1), Thing("bench", 2.4, 5.3, -40, 0),
    ),
)  # fmt: skip
CROWD_HELDBACK = Clip(
    "crowd_heldback", "crowd", "held-back", 14.0, ATRIUM, ((0.0, LIT),),
    (
        stands("J", 0.75, 5.2, 85, 14.0), stands("M", 1.45, 5.15, -80, 14.0, "hips"),
        stands("L", -1.6, 5.65, -8, 14.0, "reading"),
        visit("O", -0.6, (-3.1, 5.0), Go(-0.7, 5.05, 0.9), Stay(2.2, 5), Go(-3.0, 5.0, 0.9), Stay(1.0, 20),
              Go(-0.9, 5.05, 0.9)),
        visit("K", -0.4, (2.9, 2.4), Go(-2.9, 2.3, 1.2), Stay(2.0, 90), Go(-2.8, 3.15), Go(2.9, 3.15, 1.15)),
        visit("N", 0.6, (-2.9, 3.1), Go(2.9, 3.0, 1.25), Stay(2.4, -90), Go(2.8, 2.3), Go(-2.9, 2.3, 1.2)),
        visit("S", 1.2, (2.9, 3.75), Go(-0.5, 3.75, 1.1), Stay(1.8, 4, "wave"), Go(-2.9, 3.75, 1.15), Stay(1.4, 90),
              Go(2.6, 3.8, 1.2)),
        visit("T", 5.0, (-2.8, 1.8), Go(0.35, 1.7, 1.1), Stay(2.0, -8, "phone"), Go(2.8, 1.8, 1.1)),
    ),
    start=1_700_018_000, rate=5, quality=45, view=View(eye=(0, 0, 1.55), pitch=math.radians(7)),
)  # fmt: skip

# Other heights, lenses and sizes

LONG = Room(
    half=2.4, depth=9.0, wall=(0.62, 0.6, 0.56), floor=(0.28, 0.28, 0.3),
    things=(
        Thing("chair", 1.5, 3.9, -25, 0), Thing("bench", -1.9, 6.2, 75, 0), Thing("painting", 0.2, 8.99, 0, 14),
        Thing("plant", 1.9, 8.3), Thing("coat stand", -1.7, 8.4, 10, 0), Thing("bin", 2.1, 5.2),
    ),
)  # fmt: skip
HUB = Room(
    half=2.7, depth=9.6, wall=(0.6, 0.64, 0.68), floor=(0.38, 0.33, 0.24), accent=(0.3, 0.2, 0.2),
    things=(
        Thing("chair", -1.6, 4.3, 30, 2), Thing("bench", 2.2, 6.6, -80, 1), Thing("painting", -0.4, 9.59, 0, 16),
        Thing("plant", -2.2, 8.8), Thing("banner", 1.7, 9.0, -6, 1), Thing("shelf", -1.9, 9.4, 0, 1),
    ),
)  # fmt: skip


def other_camera(name: str, number: int, held_back: bool, view: View, light: Light = LIT, **more: Any) -> Clip:
    """A short clip of the long room: somebody comes up, somebody sits, stands still, or crosses; others each time."""
    people, room, split = ("JSOM", HUB, "heldback") if held_back else ("EDPH", LONG, "tune")
    one, two, three, four = people[number % 4 :] + people[: number % 4]
    side, chair = (-1, (-1.6, 4.3, 30)) if held_back else (1, (1.5, 3.9, -25))
    cast = (
        visit(one, -1.0, (-0.4 * side, 8.2), Go(-0.3 * side, 1.9, 1.3), Stay(1.4, to_camera(-0.3 * side, 1.9)),
              Go(-1.1 * side, 0.3)),
        sits(two, *chair, 7.0), stands(three, -1.2 * side, 4.8, 25.0 * side, 7.0, "pockets"),
        visit(four, 0.4, (1.9 * side, 7.4), Go(-1.3 * side, 6.8, 1.1), Stay(1.2, 0), Go(1.6 * side, 5.6, 1.2)),
    )  # fmt: skip
    start = 1_700_020_000 + 1000 * (2 * number + held_back)
    return Clip(
        f"lens_{name}_{split}", f"lens_{name}", "held-back" if held_back else "tune", 5.0, room, ((0.0, light),), cast,
        start=start, rate=5, quality=45, view=view, **more,
    )  # fmt: skip


def cameras(held_back: bool) -> tuple[Clip, ...]:
    """Cameras at 0.3, 1.0, 1.6 and 2.5 m: a low one, a wide one with depth, a large picture, a dim one from above."""
    a, b = (0.3, -15.0) if held_back else (0.3, -13.0)
    low = View(focal=600.0, eye=(0, 0, a), pitch=math.radians(b))
    lens = (-0.29, 0.085, 0.0008, -0.0005, 0.0) if held_back else (-0.25, 0.06, -0.0006, 0.0004, 0.0)
    wide = View(focal=385.0 if held_back else 400.0, eye=(0, 0, 1.0), pitch=math.radians(1), lens=lens)
    large = View(size=(1280, 720), focal=900.0 if held_back else 860.0, eye=(0, 0, 1.6), pitch=math.radians(5))
    high = View(focal=500.0, eye=(0, 0, 2.5), pitch=math.radians(23 if held_back else 20))
    return (
        other_camera("low", 0, held_back, low),
        other_camera("wide", 1, held_back, wide, depth=True),
        other_camera("large", 2, held_back, large),
        other_camera("dim", 3, held_back, high, NIGHT, noise=2.6, shutter=0.07),
    )


ROOMS = (
    VISITORS_TUNE, VISITORS_HELDBACK, SEATED_TUNE, SEATED_HELDBACK, TURNING_TUNE, TURNING_HELDBACK, CROWD_TUNE,
    CROWD_HELDBACK, *cameras(False), *cameras(True),
)  # fmt: skip
CLIPS = clips.CLIPS | {clip.name: clip for clip in ROOMS}
