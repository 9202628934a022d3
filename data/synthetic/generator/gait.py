"""Walking and standing: plans footsteps along a track, then poses the skeleton so that planted feet stay planted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from posture import Build, Postures, Reach, slerp, smooth_step
from story import GRID, Role, Track

SIDES = {"L": 1.0, "R": -1.0}
SWING = 0.76
HEEL_STRIKE, HEEL_RISE = np.radians(-17), np.radians(42)
STRIKE_TIME, RISE_TIME = 0.11, 0.27
LEG_SLACK = 0.997
HIP_OVER_SEAT, SEAT_TIME = 0.095, 1.3
CHAIR_SEAT, FOOTREST, TOES_OUT = 0.47, 0.13, 0.12
RISING_LEAN, LEANING_BACK = 0.55, -0.09
TURNING = ("root", "upperleg01", "lowerleg01", "foot", "toe", "spine05", "spine03", "neck01", "head", "clavicle",
           "upperarm01", "lowerarm01", "lowerarm02", "wrist", "finger")  # fmt: skip


def turn(axis: str, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[[i, j], [i, j]] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


def frame(along: np.ndarray, hint: np.ndarray) -> np.ndarray:
    """Orthonormal columns: the direction, the hint made square to it, and their cross product."""
    first = along / np.linalg.norm(along)
    second = hint - first * (hint @ first)
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], 1)


def smooth(values: np.ndarray, seconds: float) -> np.ndarray:
    """Gaussian filter over the time grid."""
    reach = np.arange(-int(4 * seconds * GRID), int(4 * seconds * GRID) + 1) / GRID
    kernel = np.exp(-0.5 * (reach / seconds) ** 2)
    wide = np.pad(values, len(reach) // 2, mode="edge")
    return np.convolve(wide, kernel / kernel.sum(), mode="valid")


def wander(time: np.ndarray, period: float, seed: int) -> np.ndarray:
    """Slow aimless motion of about unit size."""
    rng = np.random.default_rng(seed)
    waves = [np.sin(2 * np.pi * time / (period * k) + rng.uniform(0, 6.3)) for k in (1, 1.7, 0.61)]
    return np.sum(waves, axis=0) / 1.8


@dataclass(frozen=True)
class Plant:
    """A foot on the floor from land to lift, at x, y (m) with a heading (rad)."""

    land: float
    lift: float
    place: np.ndarray


class Skeleton:
    """Rest joints and the tree of bones."""

    def __init__(self, labels: list[str], parents: np.ndarray, heads: np.ndarray) -> None:
        """Parents come before their children; the root's parent is -1."""
        self.labels, self.parents, self.heads = labels, parents, heads
        self.index = {label: i for i, label in enumerate(labels)}

    def head(self, label: str) -> np.ndarray:
        """A joint at rest."""
        return self.heads[self.index[label]]

    def carriers(self) -> np.ndarray:
        """For every bone the one it always moves with: itself, or its next forebear that can turn."""
        out = np.arange(len(self.labels))
        for i, (label, parent) in enumerate(zip(self.labels, self.parents, strict=True)):
            if parent >= 0 and not label.startswith(TURNING):
                out[i] = out[parent]
        return out

    def transforms(
        self, root: np.ndarray, turns: dict[str, np.ndarray], grip: dict[str, float] | None = None
    ) -> np.ndarray:
        """(bones, 3, 4): world rotation and shift of every bone; bones without a turn follow their parent.

        grip: how much the fingers of each side bend, 1 the usual.
        """
        out = np.zeros((len(self.labels), 3, 4))
        spot = np.zeros_like(self.heads)
        for i, (label, parent) in enumerate(zip(self.labels, self.parents, strict=True)):
            rotation = out[parent, :, :3] if parent >= 0 else np.eye(3)
            spot[i] = root if parent < 0 else spot[parent] + rotation @ (self.heads[i] - self.heads[parent])
            rotation = turns.get(label, rotation)
            if "finger" in label:
                rotation = rotation @ curl(label, (grip or {}).get(label[-1], 1.0))
            out[i, :, :3] = rotation
            out[i, :, 3] = spot[i] - rotation @ self.heads[i]
        return out


def curl(label: str, grip: float) -> np.ndarray:
    """Fingers bend a little at every joint; the thumb hardly."""
    side = SIDES[label[-1]]
    return turn("y", side * np.radians(4 if label.startswith("finger1") else 15 * grip))


def through(
    bone: str, side: str, arm: dict[str, np.ndarray], calm: dict[str, np.ndarray], goal: np.ndarray, share: float
) -> np.ndarray:
    """A bone's rotation between a swinging arm and a goal, along the way from the calm arm, lest it turns round."""
    elbow = f"lowerarm01.{side}"
    now, still = arm.get(bone, arm[elbow]), calm.get(bone, calm[elbow])
    return slerp(still, goal, share) @ slerp(np.eye(3), still.T @ now, 1 - share)


class Walker:
    """One person's pose at any time."""

    def __init__(self, skeleton: Skeleton, role: Role, seed: int, build: Build) -> None:
        """Plans all footsteps and the motion of the trunk; the seed shapes the idle motion."""
        self.skeleton, self.role = skeleton, role
        self.postures = Postures(role, build)
        self.track = Track(role)
        self.grid = self.track.grid
        self.sole = {s: skeleton.head(f"foot.{s}") for s in SIDES}
        self.ball = {s: skeleton.head(f"toe2-1.{s}") * [1, 1, 0] for s in SIDES}
        self.heel = {s: self.sole[s] * [1, 1, 0] + [0, 0.045, 0] for s in SIDES}
        self.plants = {s: self.plan(s) for s in SIDES}
        self.tracks = self.body_tracks(seed)

    def plan(self, side: str) -> list[Plant]:
        """Footholds along the track; feet come side by side where stepping ends."""
        times = [-np.inf]
        for start, end in self.role.stepping:
            count = max(2, round((end - start) / self.role.step))
            beats = np.linspace(start, end, count + 1)[1:]
            times += list(beats[0 if side == "L" else 1 :: 2])
            if (count % 2 == 0) == (side == "L"):
                times.append(end + self.role.step * 0.9)
        plants = []
        for land, following in zip(times, [*times[1:], np.inf], strict=True):
            lift = following - self.role.step * SWING
            plants.append(Plant(land, lift, self.foothold(side, land, lift)))
        return plants

    def foothold(self, side: str, land: float, lift: float) -> np.ndarray:
        """Under the hip at mid stance, the toes turned out a little."""
        edges = np.clip([land, lift], self.grid[0], self.grid[-1])
        long = edges[1] - edges[0] > 2 * self.role.step
        middle = edges @ [0.57, 0.43] if not long else (edges[1] if np.isinf(land) else edges[0] + 0.5)
        x, y, heading = self.track(middle)
        out = SIDES[side] * (0.085 if not long else 0.105)
        return np.array([x + out * np.cos(heading), y + out * np.sin(heading), heading + SIDES[side] * 0.12])

    def on_floor(self, side: str, plant: Plant, time: float) -> tuple[np.ndarray, float]:
        """Ankle and pitch of a planted foot: it rolls over the heel, lies flat, then over the ball."""
        brisk = self.briskness(time)
        pitch = HEEL_STRIKE * brisk * (1 - smooth_step((time - plant.land) / STRIKE_TIME))
        pitch += HEEL_RISE * max(brisk, 0.35) * smooth_step((time - plant.lift + RISE_TIME) / RISE_TIME) ** 1.5
        pivot = self.ball[side] if pitch > 0 else self.heel[side]
        spin = turn("z", plant.place[2])
        base = np.array([*plant.place[:2], 0]) - spin @ (self.sole[side] * [1, 1, 0])
        return base + spin @ (pivot + turn("x", pitch) @ (self.sole[side] - pivot)), pitch

    def seating(self, time: float) -> tuple[float, float]:
        """How far the person sits, 0 to 1, and how high the seat is (m)."""
        if self.role.rides:
            return 1.0, CHAIR_SEAT
        for start, end, height in self.role.seated:
            if start <= time <= end:
                return smooth_step((time - start) / SEAT_TIME) * smooth_step((end - time) / SEAT_TIME), height
        return 0.0, 0.0

    def thigh(self) -> float:
        """Length from hip to knee."""
        return float(np.linalg.norm(self.skeleton.head("lowerleg01.L") - self.hip("L")))

    def footrest(self, side: str, time: float) -> tuple[np.ndarray, float, float, bool]:
        """The foot of a wheelchair user, as foot gives it."""
        x, y, heading = self.track(time)
        spot = np.array([SIDES[side] * 0.1, -self.thigh() - 0.1, 0.0])
        ankle = np.array([x, y, FOOTREST + self.sole[side][2]]) + turn("z", heading) @ spot
        return ankle, 0.0, heading + SIDES[side] * TOES_OUT, True

    def foot(self, side: str, time: float) -> tuple[np.ndarray, float, float, bool]:
        """Ankle, pitch, heading, and whether the foot stands; feet of small people hang from a high seat."""
        if self.role.rides:
            return self.footrest(side, time)
        ankle, pitch, heading, stands = self.step(side, time)
        share, seat = self.seating(time)
        shin = float(np.linalg.norm(self.sole[side] - self.skeleton.head(f"lowerleg01.{side}")))
        hanging = max(0.0, seat + HIP_OVER_SEAT - 0.02 - shin - self.sole[side][2])
        return ankle + np.array([0, 0, share * hanging]), pitch, heading, stands

    def step(self, side: str, time: float) -> tuple[np.ndarray, float, float, bool]:
        """The foot of a person who walks or stands."""
        for plant, after in zip(self.plants[side], [*self.plants[side][1:], None], strict=True):
            if time <= plant.lift or after is None:
                return *self.on_floor(side, plant, time), plant.place[2], True
            if time < after.land:
                share = (time - plant.lift) / (after.land - plant.lift)
                start, pitch = self.on_floor(side, plant, plant.lift)
                end, strike = self.on_floor(side, after, after.land)
                ankle = start + (end - start) * smooth_step(share) + [0, 0, 0.035 * np.sin(np.pi * share)]
                heading = plant.place[2] + (after.place[2] - plant.place[2]) * smooth_step(share)
                return ankle, pitch + (strike - pitch) * smooth_step(share * 1.1), heading, False
        raise AssertionError("the last plant never ends")

    def briskness(self, time: float) -> float:
        """0 standing, 1 walking fast."""
        a, b = self.track(time - 0.2)[:2], self.track(time + 0.2)[:2]
        return float(min(np.linalg.norm(b - a) / 0.4 / 1.3, 1.2))

    def body_tracks(self, seed: int) -> dict[str, np.ndarray]:
        """Everything above the feet that needs filtering over time."""
        grid, base = self.grid, self.track(self.grid)
        brisk = smooth(np.array([self.briskness(t) for t in grid]), 0.15)
        left = np.stack([np.cos(base[:, 2]), np.sin(base[:, 2])], 1)
        ahead = np.stack([left[:, 1], -left[:, 0]], 1)
        feet = {s: [self.foot(s, t) for t in grid] for s in SIDES}
        reach = {s: np.array([f[0][:2] for f in feet[s]]) - base[:, :2] for s in SIDES}
        stride = {s: smooth((reach[s] * ahead).sum(1), 0.06) for s in SIDES}
        load = {s: smooth(np.array([float(f[3]) for f in feet[s]]), 0.09) for s in SIDES}
        idle = 1 - np.clip(brisk * 2.5, 0, 1)
        sway = 0.028 * (load["L"] - load["R"]) + idle * 0.028 * wander(grid, 5.3, seed)
        sits, seats = np.array([self.seating(t) for t in grid]).T
        sway, upright = sway * (1 - sits), 1 - 0.7 * sits
        back = 0.0 if self.role.rides else self.thigh() * sits
        xy = base[:, :2] + left * sway[:, None] - ahead * np.reshape(back, (-1, 1))
        swing = stride["L"] - stride["R"]
        tilt = (0.07 * (load["L"] - load["R"]) + idle * 0.03 * wander(grid, 5.3, seed)) * (1 - sits)
        yaw = base[:, 2] + (0.10 * swing + idle * 0.04 * wander(grid, 7.1, seed + 1)) * upright
        seated_root = seats + HIP_OVER_SEAT + self.root()[2] - self.hip("L")[2]
        if self.role.rides:
            brisk, idle, swing, stride = brisk * 0, idle * 0 + 1, swing * 0, dict.fromkeys(SIDES, brisk * 0)
            height = seated_root
        else:
            height = self.pelvis_height(base[:, :2] + left * sway[:, None], yaw, feet)
            height = height + (np.minimum(seated_root, height) - height) * sits
        return {
            "x": xy[:, 0], "y": xy[:, 1], "z": height, "yaw": yaw, "roll": tilt,
            "brisk": brisk, "idle": idle, "sits": sits,
            "lean": RISING_LEAN * np.sin(np.pi * sits) + LEANING_BACK * sits,
            "armL": smooth(-0.765 * stride["L"], 0.05), "armR": smooth(-0.765 * stride["R"], 0.05),
            "chest": base[:, 2] - 0.13 * swing + idle * 0.05 * wander(grid, 8.3, seed + 2),
            "look": idle * 0.16 * wander(grid, 4.7, seed + 3), "nod": 0.05 * wander(grid, 3.9, seed + 4),
            "breath": np.sin(2 * np.pi * grid / 3.7), "fidget": wander(grid, 2.9, seed + 5),
        }  # fmt: skip

    def pelvis_height(self, xy: np.ndarray, yaw: np.ndarray, feet: dict[str, list]) -> np.ndarray:
        """As high as the standing legs reach, filtered."""
        limits = []
        for i, (x, y) in enumerate(xy):
            heights = [self.root()[2]]
            for side in SIDES:
                ankle, pitch, _, stands = feet[side][i]
                if not stands or pitch > 0.25:
                    continue
                hip = turn("z", yaw[i]) @ (self.hip(side) - self.root())
                flat = np.linalg.norm(ankle[:2] - np.array([x, y]) - hip[:2])
                heights.append(ankle[2] - hip[2] + np.sqrt(max((self.leg(side) * LEG_SLACK) ** 2 - flat**2, 0.2)))
            limits.append(min(heights))
        limits = np.array(limits) - 0.004
        return np.minimum(smooth(limits, 0.07), limits + 0.01)

    def root(self) -> np.ndarray:
        """The pelvis at rest."""
        return self.skeleton.head("root")

    def hip(self, side: str) -> np.ndarray:
        """A hip joint at rest."""
        return self.skeleton.head(f"upperleg01.{side}")

    def leg(self, side: str) -> float:
        """Length of the stretched leg."""
        knee = self.skeleton.head(f"lowerleg01.{side}")
        return float(np.linalg.norm(knee - self.hip(side)) + np.linalg.norm(self.sole[side] - knee))

    def pose(self, time: float) -> np.ndarray:
        """World transforms (bones, 3, 4) of all bones."""
        now = {name: float(np.interp(time, self.grid, row)) for name, row in self.tracks.items()}
        pelvis = turn("z", now["yaw"]) @ turn("y", -now["roll"])
        root = np.array([now["x"], now["y"], now["z"]])
        turns = {"root": pelvis}
        for side in SIDES:
            turns |= self.leg_turns(side, time, root, pelvis)
        lean = turn("x", 0.02 + 0.05 * now["brisk"] + 0.008 * now["breath"] + now["lean"])
        middle = (now["yaw"] + now["chest"]) / 2
        turns["spine05"] = turn("z", middle) @ turn("y", -now["roll"] * 0.3) @ lean
        turns["spine03"] = chest = turn("z", now["chest"]) @ turn("y", now["roll"] * 0.15) @ lean
        bow = 0.38 * self.postures.share(time, "reading")
        turns["neck01"] = turn("z", now["chest"] + 0.5 * now["look"]) @ turn("x", 0.03 + 0.4 * bow)
        turns["head"] = turn("z", now["chest"] + now["look"]) @ turn("x", 0.02 + now["nod"] + bow)
        grip = {}
        for side in SIDES:
            arm = calm = self.arm_turns(side, time, chest, now)
            goals = self.postures.goals(time, side)
            if goals:
                calm = self.arm_turns(side, time, chest, now | {f"arm{side}": 0.0, "brisk": 0.0, "fidget": 0.0})
            for share, goal in goals:
                reached = self.reach_turns(side, time, chest, goal)
                arm = calm = {bone: through(bone, side, arm, calm, to, share) for bone, to in reached.items()}
                grip[side] = grip.get(side, 1.0) + (goal.curl - grip.get(side, 1.0)) * share
            turns |= arm
            turns[f"clavicle.{side}"] = chest @ turn("y", SIDES[side] * (0.05 + 0.01 * now["breath"]))
        return self.skeleton.transforms(root, turns, grip)

    def leg_turns(self, side: str, time: float, root: np.ndarray, pelvis: np.ndarray) -> dict[str, np.ndarray]:
        """Two-bone reach from hip to ankle, the knee over the toes."""
        ankle, pitch, heading, _ = self.foot(side, time)
        hip, knee = self.hip(side), self.skeleton.head(f"lowerleg01.{side}")
        start = root + pelvis @ (hip - self.root())
        upper, lower = np.linalg.norm(knee - hip), np.linalg.norm(self.sole[side] - knee)
        span = ankle - start
        distance = min(np.linalg.norm(span), (upper + lower) * 0.9995)
        bend = np.arccos(np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1))
        toes = turn("z", heading + SIDES[side] * 0.06) @ np.array([0, -1.0, 0])
        axes = frame(span, toes + pelvis @ np.array([0, -1.0, 0]))
        thigh = axes @ np.array([np.cos(bend), np.sin(bend), 0])
        shin = start + axes[:, 0] * distance - (start + thigh * upper)
        forward = np.array([0, -1.0, 0])
        flat = turn("z", heading)
        return {
            f"upperleg01.{side}": frame(thigh, axes[:, 1]) @ frame(knee - hip, forward).T,
            f"lowerleg01.{side}": frame(shin, axes[:, 1]) @ frame(self.sole[side] - knee, forward).T,
            f"foot.{side}": flat @ turn("x", pitch),
            **{f"toe{k}-1.{side}": flat @ turn("x", min(pitch, 0.12 * pitch)) for k in range(1, 6)},
        }

    def arm_turns(self, side: str, time: float, chest: np.ndarray, now: dict[str, float]) -> dict[str, np.ndarray]:
        """Arms hang, swing against the legs, and one of them makes the gesture."""
        sign = SIDES[side]
        shoulder, elbow = self.skeleton.head(f"upperarm01.{side}"), self.skeleton.head(f"lowerarm01.{side}")
        wrist = self.skeleton.head(f"wrist.{side}")
        swing = now[f"arm{side}"] + now["idle"] * 0.05 * now["fidget"]
        bend = 0.22 + 0.35 * now["brisk"] * max(swing + 0.25, 0) + 0.04 * now["fidget"] * sign
        lift = self.gesture(time) if side == "R" else 0.0
        out = 0.10 + 0.03 * now["idle"] + 0.05 * lift
        hang = np.array([sign * np.sin(out), -np.sin(swing + 0.35 * lift), -np.cos(swing + 0.35 * lift)])
        inward = np.array([-sign * (0.25 + 0.9 * lift), -1.0, 0.0])
        upper = frame(hang, inward)
        bend += 1.75 * lift
        fore = upper @ np.array([np.cos(bend), np.sin(bend), 0])
        rest = frame(elbow - shoulder, np.array([0, -1.0, 0]))
        low = frame(wrist - elbow, np.array([0, -1.0, 0]))
        forearm = chest @ frame(fore, upper @ np.array([-np.sin(bend), np.cos(bend), 0])) @ low.T
        return {f"upperarm01.{side}": chest @ upper @ rest.T, f"lowerarm01.{side}": forearm}

    def reach_turns(self, side: str, time: float, chest: np.ndarray, goal: Reach) -> dict[str, np.ndarray]:
        """Two-bone reach from the shoulder to a goal; the forearm turns over its length to bring the thumb round."""
        mirror = np.array([SIDES[side], 1, 1])
        shoulder, elbow = self.skeleton.head(f"upperarm01.{side}"), self.skeleton.head(f"lowerarm01.{side}")
        wrist, knuckle = self.skeleton.head(f"wrist.{side}"), self.skeleton.head(f"finger3-1.{side}")
        swing = goal.waving * np.sin(2 * np.pi * 1.6 * time)
        span = mirror * (goal.wrist + np.array([swing, 0, -abs(swing) * 0.3])) - shoulder
        upper, lower = np.linalg.norm(elbow - shoulder), np.linalg.norm(wrist - elbow)
        distance = min(np.linalg.norm(span), (upper + lower) * 0.999)
        bend = np.arccos(np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1))
        axes = frame(span, mirror * goal.elbow)
        arm = axes @ np.array([np.cos(bend), np.sin(bend), 0])
        fore = axes[:, 0] * distance - arm * upper
        front = np.array([0, -1.0, 0])
        low = frame(wrist - elbow, front)
        natural = frame(fore, -axes[:, 1])
        turned = frame(fore, mirror * goal.thumb)
        palm = turned if goal.hand is None else frame(mirror * goal.hand, mirror * goal.thumb)
        return {
            f"upperarm01.{side}": chest @ frame(arm, -axes[:, 1]) @ frame(elbow - shoulder, front).T,
            f"lowerarm01.{side}": chest @ slerp(natural @ low.T, turned @ low.T, 0.5),
            f"lowerarm02.{side}": chest @ turned @ low.T,
            f"wrist.{side}": chest @ palm @ frame(knuckle - wrist, front).T,
        }

    def gesture(self, time: float) -> float:
        """0 at rest, 1 with the hand up."""
        if self.role.gesture is None:
            return 0.0
        start, end = self.role.gesture
        return smooth_step((time - start) / 0.9) * smooth_step((end - time) / 0.9)
