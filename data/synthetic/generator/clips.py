"""The clips: a building, its light over time, and who walks through it.

People D to I are in the tuning clips, J to O in the held-back ones. The corridor clip is the old story of A, B and C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from layout import EVEN, OLD, SUNNY, Layout, Light, Room, Thing
from optics import CORRIDOR as CORRIDOR_VIEW
from optics import View
from story import RATE, ROLES, SECONDS
from visits import Go, Stay, Visit, visit

NOSE = (0.02, 0.03)  # m from the axis of the tilt to the lens: ahead, up
SOFT = 0.25  # s


@dataclass(frozen=True)
class Clip:
    """A recording before it is made.

    lights: (from s, state); a fade (from s, to s) goes over to the state that begins at its end. view: the camera;
    turning: (s, pan, tilt) of a head, degrees to the left and downwards; the camera's eye is beside its axes. depth:
    whether depth images are recorded. noise: of the sensor (grey levels); quality: of the JPEGs; shutter: time of
    exposure (s).
    """

    name: str
    scene: str
    split: str
    seconds: float
    layout: Layout | Room
    lights: tuple[tuple[float, Light], ...]
    visits: tuple[Visit, ...]
    fades: tuple[tuple[float, float], ...] = ()
    start: int = 1_700_000_000  # s
    view: View = CORRIDOR_VIEW
    rate: int = RATE
    turning: tuple[tuple[float, float, float], ...] = ()
    depth: bool = False
    noise: float = 1.3
    quality: int = 80
    shutter: float = 0.0

    def pan_tilt(self, time: float) -> tuple[float, float]:
        """Angles of the head's joints (rad) at a time, with soft starts and stops."""
        if not self.turning:
            return 0.0, self.view.pitch
        times, *angles = np.radians(np.array(self.turning)).T
        spread = time + np.linspace(-1, 1, 21) * SOFT
        pan, tilt = (float(np.interp(np.radians(spread), times, angle).mean()) for angle in angles)
        return pan, tilt

    def view_at(self, time: float) -> View:
        """The camera at a time; the axis of the tilt lies behind and below the lens."""
        if not self.turning:
            return self.view
        pan, tilt = self.pan_tilt(time)
        ahead, up = (
            NOSE[0] * math.cos(tilt) + NOSE[1] * math.sin(tilt),
            NOSE[1] * math.cos(tilt) - NOSE[0] * math.sin(tilt),
        )
        eye = (-ahead * math.sin(pan), ahead * math.cos(pan), self.view.eye[2] + up)
        return replace(self.view, eye=eye, pitch=tilt, yaw=pan)

    def frames(self) -> int:
        """How many pictures."""
        return round(self.seconds * self.rate)

    def light(self, index: int) -> Light:
        """The state of the light in a picture."""
        return [light for start, light in self.lights if start <= index / self.rate + 1e-9][-1]

    def fading(self, index: int) -> tuple[Light, Light, float]:
        """The states before and after, and the share of the one after."""
        time, now = index / self.rate, self.light(index)
        for start, end in self.fades:
            if start < time < end:
                return now, self.light(round(end * self.rate)), (time - start) / (end - start)
        return now, now, 0.0


STEADY = Light("even", ambient=(0.40, 0.37, 0.317))
SUN = Light("sun", sun=1, sky=1, lamps=0, ambient=(0.51, 0.52, 0.52))
SUN_LAMPS = Light("sun and lamps", sun=1, sky=1, lamps=1, ambient=(0.80, 0.78, 0.74))
LAMPS = Light("lamps", sky=0.12, lamps=1, ambient=(0.31, 0.29, 0.26))
DUSK = Light("dim", sky=0.12, lamps=0.8, every=4, ambient=(0.075, 0.075, 0.07))

SCENE1_HELDBACK = Clip(
    "scene1_heldback",
    "scene1",
    "held-back",
    43.0,
    replace(
        EVEN,
        things=(
            Thing("coat stand", 1.18, 6.6, 25, 1),
            Thing("poster", -0.95, 22.0, 0, 1),
            Thing("trolley", -1.15, 13.4, 8, 1),
            Thing("coat on a hook", 1, 12.7, 0, 1),
            Thing("board", 1, 14.0),
            Thing("radiator", -1, 16.9),
            Thing("bin", -1.3, 9.7),
            Thing("extinguisher", -1, 4.6),
            Thing("banner", 1.1, 17.6, 6, 1),
        ),
    ),
    ((0.0, STEADY),),
    (
        visit(
            "J", 2.0, (-2.9, 19.1), Go(-1.1, 19.1), Go(-0.5, 17.6, 1.4), Go(-0.45, 1.4, 1.5), Stay(2.2, 8),
            Stay(2.0, 62, "hips"), Stay(2.0, 0), Stay(1.8, -14, "wave"), Go(-0.85, 0.2), Go(-0.9, -0.9),
        ),
        visit(
            "K", 2.9, (-2.9, 19.0), Go(-1.1, 19.0), Go(0.3, 17.3, 1.4), Go(0.42, 1.2, 1.5), Stay(2.2, -10),
            Stay(2.2, -58, "crossed"), Go(0.5, 1.45, 0.5, -15), Stay(2.2, 0, "phone"), Go(-0.3, 3.2),
            Go(-1.2, 5.7), Go(-2.9, 5.7), step=0.5,
        ),
        visit(
            "L", 9.0, (2.9, 8.1), Go(1.2, 8.1), Go(0.95, 9.2), Go(0.95, 14.9), Go(1.4, 16.1), Go(2.9, 16.1),
            carries="box", step=0.56,
        ),
        visit(
            "M", 12.0, (-2.9, 11.95), Go(-1.2, 11.95, 1.1), Go(0.2, 10.8, 1.1), Go(0.6, 8.0), Go(0.95, 5.0),
            Go(1.05, -0.9), carries="trolley",
        ),
        visit(
            "N", 18.0, (-1.05, -0.9), Go(-1.0, 1.4), Go(-0.6, 3.2), Go(0.2, 6.6, 1.4), Go(1.3, 8.1), Go(2.9, 8.1),
        ),
        visit(
            "O", 30.2, (-2.9, 5.7), Go(-1.2, 5.7, 1.1), Go(-0.35, 4.8, 1.1), Go(-0.05, 1.05, 1.05), Stay(2.4, 4),
            Stay(2.4, -35, "reading"), Go(-0.85, 0.4), Go(-0.9, -0.9), step=0.6,
        ),
    ),
    start=1_700_001_000,
)  # fmt: skip

SCENE2_HELDBACK = Clip(
    "scene2_heldback",
    "scene2",
    "held-back",
    43.5,
    replace(
        SUNNY,
        sun=(-0.76, -0.3, -0.5),
        things=(
            Thing("coat stand", -1.2, 7.2, 70, 1),
            Thing("poster", -1, 10.2, 0, 1),
            Thing("trolley", 1.15, 10.4, 4, 1),
            Thing("coat on a hook", -1, 4.6, 0, 1),
            Thing("extinguisher", -1, 13.2),
            Thing("plant", -1.15, 16.6, 0, 0),
            Thing("banner", 1.05, 15.2, -8, 1),
        ),
    ),
    ((0.0, SUN), (8.0, SUN_LAMPS), (17.0, SUN), (31.2, DUSK), (36.8, LAMPS)),
    (
        visit(
            "M", 2.0, (-2.9, 11.95), Go(-1.2, 11.95), Go(0.15, 10.6), Go(0.15, 1.75, 1.35), Stay(2.2, 0),
            Stay(2.2, 70, "pockets"), Stay(2.0, 5), Go(0.5, 1.35, 0.6, 10), Stay(2.4, -30), Go(0.85, 0.2),
            Go(0.9, -0.9), carries="case",
        ),
        visit(
            "L", 4.0, (-2.9, 19.1), Go(-1.2, 19.1), Go(-0.3, 17.9), Go(-0.5, 7.4), Go(-1.2, 5.7), Go(-2.9, 5.7),
            step=0.56,
        ),
        visit(
            "N", 4.9, (-2.9, 19.0), Go(-1.2, 19.0), Go(0.35, 17.4), Go(0.0, 8.0, 1.45), Go(-0.5, 1.45, 1.45),
            Stay(2.0, 5), Stay(2.2, 55), Stay(2.2, -8, "crossed"), Go(-0.35, 1.3, 0.5, 0), Stay(1.4, 0, "wave"),
            Go(-0.9, 0.2), Go(-0.95, -0.9), step=0.5,
        ),
        visit(
            "O", 18.6, (-2.9, 5.7), Go(-1.2, 5.7, 1.1), Go(0.4, 7.0, 1.1), Go(0.5, 10.0, 1.1), Go(-1.1, 11.95, 1.1),
            Go(-2.9, 11.95, 1.1), carries="trolley", step=0.6,
        ),
        visit(
            "J", 31.2, (-2.9, 11.95), Go(-1.2, 11.95), Go(-0.1, 10.7), Go(0.3, 3.6, 1.4), Go(0.85, 1.1), Go(0.95, -0.9),
            carries="box",
        ),
        visit(
            "K", 31.1, (-2.9, 5.7), Go(-1.2, 5.7), Go(-0.5, 4.6), Go(-0.2, 1.1, 1.2), Stay(2.2, 6),
            Stay(2.0, 40, "phone"), Stay(1.8, -5), Go(-0.9, 0.1), Go(-0.95, -0.9), step=0.5,
        ),
    ),
    fades=((29.3, 31.2),),
    start=1_700_002_000,
)  # fmt: skip

SCENE1_TUNE = Clip(
    "scene1_tune",
    "scene1",
    "tune",
    43.5,
    replace(
        EVEN,
        things=(
            Thing("coat stand", -1.2, 9.9, 200, 0),
            Thing("poster", 0.95, 22.0, 0, 0),
            Thing("trolley", 1.15, 9.6, -6, 0),
            Thing("coat on a hook", -1, 3.9, 0, 0),
            Thing("board", -1, 13.6),
            Thing("radiator", 1, 13.4),
            Thing("plant", 1.15, 17.7),
            Thing("extinguisher", 1, 6.9),
            Thing("banner", -1.1, 14.4, -10, 0),
        ),
    ),
    ((0.0, STEADY),),
    (
        visit(
            "D", 2.0, (2.9, 16.1), Go(1.2, 16.1), Go(0.5, 15.0), Go(0.5, 1.45, 1.4), Stay(3.2, -5),
            Stay(3.0, -60, "crossed"), Stay(2.2, 6, "wave"), Go(0.38, 1.35, 0.5, 0), Stay(2.4, -10), Go(0.9, 0.2),
            Go(0.95, -0.9),
        ),
        visit(
            "E", 3.6, (-2.9, 11.95), Go(-1.2, 11.95), Go(-0.5, 10.8), Go(-0.4, 1.65, 1.15), Stay(3.2, 4), Stay(3.2, 52),
            Stay(2.4, -6, "phone"), Go(-0.3, 4.2), Go(-1.2, 5.7), Go(-2.9, 5.7), step=0.5,
        ),
        visit(
            "F", 5.0, (-2.9, 19.1), Go(-1.2, 19.1), Go(0.0, 17.8), Go(0.1, 8.9, 1.35), Go(1.3, 8.1), Go(2.9, 8.1),
            carries="box", step=0.56,
        ),
        visit(
            "G", 17.2, (2.9, 8.1), Go(1.2, 8.1, 1.1), Go(0.2, 9.3, 1.1), Go(0.3, 15.0, 1.2), Go(1.3, 16.1, 1.1),
            Go(2.9, 16.1, 1.1), step=0.6,
        ),
        visit(
            "H", 28.6, (-0.75, -0.9), Go(-0.7, 1.2), Go(-0.5, 3.2), Go(0.2, 10.2, 1.4), Go(-1.2, 11.95, 1.4),
            Go(-2.9, 11.95, 1.4), carries="trolley",
        ),
        visit(
            "I", 30.0, (-2.9, 5.7), Go(-1.2, 5.7, 1.1), Go(0.3, 4.8, 1.1), Go(0.1, 1.4, 1.2), Stay(3.2, 2),
            Stay(3.2, 40, "reading"), Go(0.9, 0.3), Go(0.95, -0.9), step=0.52,
        ),
    ),
    start=1_700_003_000,
)  # fmt: skip

SCENE2_TUNE = Clip(
    "scene2_tune",
    "scene2",
    "tune",
    42.0,
    replace(
        SUNNY,
        sun=(-0.7, 0.34, -0.62),
        things=(
            Thing("coat stand", 1.2, 5.4, 150, 0),
            Thing("poster", -1, 7.3, 0, 0),
            Thing("trolley", -1.15, 9.8, -5, 0),
            Thing("coat on a hook", -1, 13.2, 0, 0),
            Thing("extinguisher", -1, 4.6),
            Thing("banner", -1.1, 16.6, 8, 0),
            Thing("bin", 1.3, 11.5),
        ),
    ),
    ((0.0, LAMPS), (9.0, DUSK), (16.5, LAMPS), (29.2, SUN_LAMPS), (35.0, SUN)),
    (
        visit(
            "G", 2.0, (-2.9, 19.1), Go(-1.2, 19.1, 1.35), Go(0.3, 17.7, 1.35), Go(0.45, 1.5, 1.5), Stay(2.4, -6),
            Stay(2.2, -60), Go(0.35, 1.4, 0.5, 0), Stay(2.4, 10, "hips"), Go(0.9, 0.2), Go(0.95, -0.9),
            carries="case", step=0.5,
        ),
        visit(
            "H", 3.4, (-2.9, 11.95), Go(-1.2, 11.95), Go(-0.5, 10.8), Go(-0.45, 1.35, 1.25), Stay(2.4, 8),
            Stay(2.6, 60, "pockets"), Stay(2.4, 0), Stay(2.2, 14, "reading"), Go(-0.85, 0.2),
            Go(-0.9, -0.9),
        ),
        visit(
            "D", 13.0, (-2.9, 5.7), Go(-1.2, 5.7), Go(0.3, 7.0), Go(0.4, 15.5, 1.3), Go(-1.2, 19.1, 1.3),
            Go(-2.9, 19.1, 1.3), carries="box",
        ),
        visit(
            "F", 16.0, (-2.9, 11.95), Go(-1.2, 11.95, 1.1), Go(-0.5, 10.8, 1.1), Go(-0.4, 7.5, 1.1), Go(-1.2, 5.7, 1.1),
            Go(-2.9, 5.7, 1.1), carries="trolley", step=0.58,
        ),
        visit(
            "I", 28.0, (-0.8, -0.9), Go(-0.75, 1.2), Go(-0.5, 3.2), Go(0.3, 9.9, 1.4), Go(-1.2, 11.95, 1.4),
            Go(-2.9, 11.95, 1.4),
        ),
        visit(
            "E", 28.6, (-2.9, 5.7), Go(-1.2, 5.7), Go(0.1, 4.6), Go(0.15, 1.4, 1.2), Stay(2.4, -4),
            Stay(2.6, -45, "phone"), Stay(1.6, 4), Go(0.9, 0.2), Go(0.95, -0.9), step=0.5,
        ),
    ),
    fades=((27.0, 29.2),),
    start=1_700_004_000,
)  # fmt: skip

CORRIDOR = Clip(
    "corridor",
    "",
    "",
    SECONDS,
    OLD,
    ((0.0, STEADY),),
    tuple(Visit(name, role) for name, role in ROLES.items()),
)

CLIPS = {c.name: c for c in (SCENE1_HELDBACK, SCENE2_HELDBACK, SCENE1_TUNE, SCENE2_TUNE, CORRIDOR)}
