"""Gestures of a head with antennas: key frames with easing, and a player that blends from one to the next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

CHANNELS = ("yaw", "pitch", "roll", "z", "left", "right")
"""What a gesture moves: the head (rad; yaw to the left, pitch up, roll to the right), its height z (m), antennas."""

Offsets = Mapping[str, float]
"""Offset of each channel from the pose without a gesture."""

BLEND_S = 0.4
"""Time of the transition between two gestures."""


def minimum_jerk(share: float) -> float:
    """The smoothest way between two points at rest; its highest speed is 1.875 times the mean."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def overshoot(share: float) -> float:
    """Swing a tenth beyond the end, and back to it; at rest at both ends and at the turn."""
    turn = 0.7
    if share < turn:
        return 1.1 * minimum_jerk(share / turn)
    return 1.1 - 0.1 * minimum_jerk((share - turn) / (1.0 - turn))


PEAK_OF_MINIMUM_JERK = 1.875
"""Highest speed of `minimum_jerk` as a multiple of the mean."""


@dataclass(frozen=True)
class KeyFrame:
    """Offsets that a gesture has reached at ``at_s``; channels that are not named are 0."""

    at_s: float
    offsets: Offsets
    easing: Callable[[float], float] = minimum_jerk


@dataclass(frozen=True)
class Gesture:
    """Sequence of key frames from no offset; after the last one, the gesture repeats, stays, or is over."""

    name: str
    frames: Sequence[KeyFrame]
    after: str = "end"
    """``end``: no offset afterwards; ``hold``: stay at the last frame; ``repeat``: go on after the first frame."""

    @property
    def duration_s(self) -> float:
        """Time of the last key frame."""
        return self.frames[-1].at_s

    def is_over(self, seconds: float) -> bool:
        """Whether a gesture that does not hold or repeat has ended."""
        return self.after == "end" and seconds >= self.duration_s

    def at(self, seconds: float) -> dict[str, float]:
        """The offsets ``seconds`` after the begin."""
        if self.after == "repeat" and seconds > self.duration_s:
            first = self.frames[0].at_s
            seconds = first + (seconds - first) % (self.duration_s - first)
        before = KeyFrame(0.0, {})
        for frame in self.frames:
            if seconds < frame.at_s:
                share = (seconds - before.at_s) / (frame.at_s - before.at_s)
                eased = frame.easing(min(max(share, 0.0), 1.0))
                return {
                    channel: before.offsets.get(channel, 0.0)
                    + eased * (frame.offsets.get(channel, 0.0) - before.offsets.get(channel, 0.0))
                    for channel in CHANNELS
                }
            before = frame
        last = {} if self.after == "end" else before.offsets
        return {channel: last.get(channel, 0.0) for channel in CHANNELS}


REST: dict[str, float] = dict.fromkeys(CHANNELS, 0.0)

NONE = Gesture("none", (KeyFrame(0.1, {}),))

GESTURES: Mapping[str, Gesture] = {
    gesture.name: gesture
    for gesture in (
        NONE,
        Gesture(
            "greeting",
            (
                KeyFrame(0.50, {"left": 0.65, "right": -0.65, "z": 0.008, "pitch": 0.10}, overshoot),
                KeyFrame(0.90, {"left": 0.2, "right": -0.2, "pitch": -0.18}),
                KeyFrame(1.30, {"left": 0.65, "right": -0.65, "pitch": 0.05}),
                KeyFrame(1.90, {}),
            ),
        ),
        Gesture(
            "goodbye",
            (
                KeyFrame(0.60, {"left": 0.8, "roll": 0.12}, overshoot),
                KeyFrame(1.00, {"left": 0.1, "roll": 0.12}),
                KeyFrame(1.40, {"left": 0.8, "roll": 0.12}),
                KeyFrame(1.80, {"left": 0.1, "pitch": -0.15}),
                KeyFrame(2.40, {}),
            ),
        ),
        Gesture(
            "listening",
            (KeyFrame(0.50, {"left": 0.35, "right": -0.35, "roll": 0.10, "pitch": 0.05, "z": 0.004}),),
            after="hold",
        ),
        Gesture(
            "idle",
            (
                KeyFrame(1.5, {"z": 0.0, "left": 0.0, "right": 0.0}),
                KeyFrame(3.5, {"z": 0.003, "left": 0.12, "right": -0.06}),
                KeyFrame(5.5, {"z": 0.0, "left": 0.0, "right": 0.0}),
                KeyFrame(7.5, {"z": 0.003, "left": 0.06, "right": -0.12}),
                KeyFrame(9.5, {"z": 0.0, "left": 0.0, "right": 0.0}),
            ),
            after="repeat",
        ),
    )
}
"""The gestures by name. ``left`` and ``right`` are the antennas: 0 points up, opposite values are mirror images."""


class GesturePlayer:
    """Plays one gesture at a time. A new one begins from the present offsets, within `BLEND_S`.

    When a gesture is over, the last one that holds or repeats goes on. Times are in seconds of one clock.
    """

    def __init__(self) -> None:
        self._gesture, self._lasting = NONE, NONE
        self._begin = 0.0
        self._from: Offsets = REST

    @property
    def name(self) -> str:
        """Name of the present gesture."""
        return self._gesture.name

    def play(self, name: str, now: float) -> None:
        """Begin the gesture ``name``. Raises KeyError for an unknown one. One that lasts does not begin again."""
        gesture = GESTURES[name]
        if gesture.after != "end" or gesture is NONE:
            self._lasting = gesture
            if (
                self._gesture.after == "end"
                and self._gesture is not NONE
                and not self._gesture.is_over(now - self._begin)
            ):
                return  # it follows
            if gesture is self._gesture:
                return
        self._start(gesture, now)

    def at(self, now: float) -> dict[str, float]:
        """The offsets at ``now``."""
        if self._gesture is not self._lasting and self._gesture.is_over(now - self._begin):
            self._start(self._lasting, now)
        return self._offsets(now)

    def _start(self, gesture: Gesture, now: float) -> None:
        self._from, self._gesture, self._begin = self._offsets(now), gesture, now

    def _offsets(self, now: float) -> dict[str, float]:
        elapsed = now - self._begin
        aim = self._gesture.at(elapsed)
        share = minimum_jerk(min(max(elapsed / BLEND_S, 0.0), 1.0))
        return {channel: (1.0 - share) * self._from[channel] + share * aim[channel] for channel in CHANNELS}


def stepped(present: float, aim: float, speed: float, seconds: float) -> float:
    """Return the next value on the way from ``present`` to ``aim``, at most ``speed`` times ``seconds`` away."""
    if not math.isfinite(aim):
        return present
    most = speed * max(seconds, 0.0)
    return present + min(max(aim - present, -most), most)
