"""Postures of simulated people: gait, sitting, gestures and gaze as positions and turns of all segments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from socialbot.robots.simulation.figure import ANKLE_Z, PARENTS, SEGMENTS, Figure

STEP_M = 0.68
"""Length of a step of the reference body at 1.2 m/s."""
SEAT_M = 0.46
"""Height of the seats on which people sit."""
_SWAY_RAD = 0.005, 0.003
"""How far people lean while they stand still (rms), forward and sideways: 8 and 5 mm at the head. Winter (Gait and
Posture 3, 1995) gives half of it for the centre of mass, which is half as high."""
_SWAYS = (0.11, 1.0), (0.23, 0.8), (0.41, 0.6)
"""Frequency (Hz) and share of its parts: most of it is below 0.5 Hz."""
_SHIFT_RAD, _SHIFT_S = 0.012, 17.0
"""Lean to the leg that carries the weight: 20 mm at the head; and time between two changes of the leg. Duarte and
Zatsiorsky, Motor Control 3, 1999, describe such shifts."""
_SWAY_MPS = 0.3
"""Speed from which on nobody sways."""


@dataclass(frozen=True)
class Stance:
    """Where a person is and what they do at one time.

    Attributes:
        heading_rad: Direction of the body.
        gaze_rad: Direction of the head.
        walked_m: Distance walked so far.
        seated: Share of sitting down: 0 stands, 1 sits.
        talking: Extent of gestures, 0 to 1.
        time_s: Time, by which gestures and breath move.
    """

    x: float
    y: float
    heading_rad: float
    gaze_rad: float
    speed_mps: float = 0.0
    walked_m: float = 0.0
    seated: float = 0.0
    talking: float = 0.0
    time_s: float = 0.0


Frame = tuple[np.ndarray, np.ndarray]
"""Rotation matrix and position of a segment."""


def _turn(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """Rotation by roll about x, then pitch about y, then yaw about z."""
    cy, sy, cp, sp, cr, sr = (f(angle) for angle in (yaw, pitch, roll) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def sway(stance: Stance, phase: float = 0.0) -> tuple[float, float]:
    """Return how far a person leans forward and to the left (rad) while standing or sitting.

    People with different ``phase`` move differently.
    """
    time, still = stance.time_s + 61 * phase, max(0.0, 1.0 - stance.speed_mps / _SWAY_MPS)
    rms = math.sqrt(sum(share**2 for _, share in _SWAYS) / 2)

    def swing(start: float) -> float:
        parts = (share * math.sin(math.tau * hertz * time + n * start) for n, (hertz, share) in enumerate(_SWAYS, 1))
        return sum(parts) / rms

    shift = math.tanh(4.0 * math.sin(math.pi * time / _SHIFT_S))
    return still * _SWAY_RAD[0] * swing(0.0), still * (_SWAY_RAD[1] * swing(1.9) + _SHIFT_RAD * shift)


def angles(stance: Stance, scale: float, phase: float = 0.0) -> dict[str, tuple[float, float, float]]:
    """Return yaw, pitch and roll (rad) of each segment against its parent; ``phase`` tells people apart."""
    walk = min(stance.speed_mps / 0.9, 1.0)
    cycle = math.pi * stance.walked_m / (STEP_M * scale)
    swing = 0.40 * walk * min(0.75 + 0.25 * stance.speed_mps / 1.2, 1.2)
    sit, talk, t = stance.seated, stance.talking, stance.time_s + 7 * phase
    breath = 0.008 * math.sin(1.6 * t)
    turn = math.remainder(stance.gaze_rad - stance.heading_rad, math.tau)
    trunk = min(max(0.25 * turn, -0.35), 0.35)
    look = min(max(turn - trunk, -1.25), 1.25)
    forward, left = (sit * each for each in sway(stance, phase))  # of the trunk alone
    found = {
        "pelvis": (0.06 * walk * math.sin(cycle), 0.0, 0.0),
        "chest": (trunk - 0.1 * walk * math.sin(cycle), 0.03 * walk + 0.06 * sit + breath + forward, -left),
        "head": (look, -0.03 * walk - 0.04 * sit + 0.05 * talk * math.sin(2.1 * t), 0.03 * math.sin(0.7 * t)),
    }
    for side, sign in (("l", 1), ("r", -1)):
        own = cycle + (0.0 if side == "l" else math.pi)
        hip = -swing * math.sin(own)
        # The knee bends while the leg swings ahead, and a little when it takes the weight.
        knee = walk * (0.08 + 0.95 * max(0.0, math.cos(own + 0.35)) ** 2 * 0.9)
        hip -= 0.42 * walk * max(0.0, math.cos(own + 0.2)) ** 2
        ankle = -(hip + knee) * 0.75 if walk else 0.0
        hip, knee, ankle = (value * (1 - sit) + end * sit for value, end in ((hip, -1.45), (knee, 1.5), (ankle, -0.05)))
        found[f"thigh_{side}"] = (sign * 0.06, hip, -sign * (0.02 + 0.05 * sit))
        found[f"shin_{side}"] = (0.0, knee, sign * 0.02)
        found[f"foot_{side}"] = (sign * 0.08, ankle, 0.0)
        beat = math.sin((2.6 if side == "l" else 3.1) * t + sign)
        lift = talk * (0.6 + 0.4 * math.sin(0.9 * t + (0.0 if side == "l" else 2.2)))
        shoulder = 0.45 * swing * 1.6 * math.sin(own) - 0.05 - lift * (0.55 + 0.12 * beat) - 0.35 * sit * (1 - lift)
        elbow = -0.15 - 0.25 * walk - lift * (1.35 + 0.3 * beat) - 0.75 * sit * (1 - lift)
        found[f"upper_arm_{side}"] = (0.0, shoulder, sign * (0.10 + 0.12 * lift))
        found[f"forearm_{side}"] = (-sign * 0.35 * lift - sign * 0.2 * sit, elbow, 0.0)
    return found


def pose(body: Figure, stance: Stance, phase: float = 0.0) -> dict[str, Frame]:
    """Return the frame of each segment in the world; the lower foot is on the floor."""
    turns = {name: _turn(*each) for name, each in angles(stance, body.scale, phase).items()}
    forward, left = ((1 - stance.seated) * each for each in sway(stance, phase))  # of the whole body on its feet
    base = _turn(stance.heading_rad) @ _turn(pitch=forward, roll=-left)
    hips = np.array([stance.x, stance.y, 0.0]) + body.joints["pelvis"][2] * base[:, 2] * (1.0, 1.0, 0.0)
    frames: dict[str, Frame] = {}
    for name in SEGMENTS:
        if name == "pelvis":
            frames[name] = base @ turns[name], hips
            continue
        turned, place = frames[PARENTS[name]]
        frames[name] = turned @ turns[name], place + turned @ np.array(body.joints[name])
    lowest = min(_sole(frames[name], body.scale) for name in ("foot_l", "foot_r"))
    height = -lowest
    if stance.seated:
        seat = SEAT_M + 0.115 * body.scale
        height += (seat - height) * stance.seated
    return {name: (turned, place + np.array([0.0, 0.0, height])) for name, (turned, place) in frames.items()}


def _sole(frame: Frame, scale: float) -> float:
    """Height of the lowest point of a shoe."""
    turned, place = frame
    return float(place[2]) + min(
        float(turned[2] @ point) for point in (np.array((x, 0.0, -ANKLE_Z)) * scale for x in (-0.07, 0.06, 0.18))
    )
