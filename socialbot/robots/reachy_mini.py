"""Reachy Mini: head, antennas and their gestures, voice and camera by the REST interface of its daemon."""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from socialbot.core.clock import SECOND, WallClock, nanoseconds
from socialbot.core.errors import DeviceError, ParameterError, SocialbotError, suggestion
from socialbot.core.messages import HeadCommand, Utterance
from socialbot.graph.node import Context, Timer
from socialbot.graph.ports import Input, Parameter
from socialbot.robots.daemon_client import UPLOAD_TIMEOUT_S, DaemonClient, TargetStream
from socialbot.robots.head import RobotHead
from socialbot.robots.limits import JointMotion
from socialbot.speech.playback import AudioPlayer, OnEnd
from socialbot.speech.speaker import Speaker
from socialbot.speech.synthesis import Sound
from socialbot.vision.camera_node import Camera, is_device

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


URL = "http://127.0.0.1:8000"

PAN, TILT = "yaw", "pitch"
"""Names of the joints in targets: both in the head pose of the daemon, positive to the left and up here."""

ROLL_RAD, RISE_M, ANTENNA_RAD = 0.35, 0.02, 1.5
"""Limits of the head's roll, of its height, and of the antennas to either side."""

_SPEEDS = {"roll": 1.0, "z": 0.05, "left": 4.0, "right": 4.0}  # rad/s and m/s; pan and tilt have those of the profile
_STILL = 1e-4  # smaller changes are not sent
_FARTHEST = 10.0  # rad or m: no head is so far from its rest
_REPEAT_S = 1.0  # a resting head is sent again after this time


class ReachyHead(RobotHead):
    """Head and antennas of a Reachy Mini: follows head targets with easing, and gestures beside them.

    The daemon gets at most ``rate_hz`` targets a second, each within the limits of position and speed, and none after
    the end of the node or while it does not answer. A daemon that is back continues from the pose that it reports. In
    simulated time no target is sent, unless ``in_simulated_time``: a replay must not move a robot.

    An utterance whose key is in ``gestures`` begins that gesture. A head command to follow people begins "listening",
    one to face forward "idle".
    """

    command = Input(HeadCommand, "/head/command", optional=True)
    say = Input(Utterance, "/speech/say", optional=True)

    url = Parameter(URL, "address of the daemon", fixed=True)
    rate_hz = Parameter(30.0, "most targets a second", minimum=1.0, maximum=50.0, fixed=True)
    gestures = Parameter(
        "greeting=greeting, greeting_several=greeting, offer=greeting, goodbye=goodbye",
        "gesture by the key of an utterance: KEY=GESTURE, separated by commas; empty: none",
    )
    idle = Parameter(True, "whether the antennas move a little while nothing happens")
    in_simulated_time = Parameter(False, "whether the robot moves in replays and simulations, too", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        if (self.pan_joint, self.tilt_joint) != (PAN, TILT):
            remedy = f"call them {PAN} and {TILT} in the profile"
            raise ParameterError(f"no joints {self.pan_joint!r} and {self.tilt_joint!r}", where=name, remedy=remedy)
        DaemonClient(self.url)  # checks the address
        self._player = GesturePlayer()
        self._gestures: Mapping[str, str] = {}
        self.on_parameter("gestures")
        self._stream: TargetStream | None = None
        self._present: dict[str, float] | None = None
        self._sent: tuple[dict[str, float], int] | None = None
        self._ticked = self.clock.now()
        self._tick_timer: Timer | None = None

    def on_parameter(self, name: str) -> None:
        """Read the gestures. Raises ParameterError for an unknown one."""
        if name == "gestures":
            self._gestures = gestures_of(self.gestures, where=f"{self.name}.gestures")
        elif name == "idle" and not self.idle and self._player.name == "idle":
            self._play("none")

    def start(self) -> None:
        if not (self.in_simulated_time or isinstance(self.clock, WallClock)):
            self.report_health("ok", "the robot does not move in simulated time")
            return
        self.report_health("waiting", f"no answer from the daemon at {self.url} yet")
        self._stream = TargetStream(
            self.url,
            lambda state: self.context.call_soon(functools.partial(self._on_up, state)),
            lambda reason: self.context.call_soon(functools.partial(self._on_down, reason)),
        )

    def stop(self) -> None:
        super().stop()
        if self._tick_timer is not None:
            self._tick_timer.cancel()
        if self._stream is not None:
            self._stream.close()

    def halt(self) -> None:
        """The daemon holds its last target, which is at most one step ahead."""

    def pose(self) -> dict[str, float] | None:
        if self._motion is None:
            return None if self._present is None else {PAN: self._present[PAN], TILT: self._present[TILT]}
        return _eased(self._motion, self.clock.now())

    def send(self, positions: Mapping[str, float], duration_s: float) -> None:
        """Stretch the motion: with easing, its highest speed is above the mean."""
        motion = self._motion
        assert motion is not None
        self._motion = JointMotion(motion.start, motion.target, motion.begin, duration_s * PEAK_OF_MINIMUM_JERK)

    @command
    def on_command(self, command: HeadCommand) -> None:
        if command.mode == "track":
            self._play("listening")
        else:
            self._play("idle" if self.idle else "none")

    @say
    def on_say(self, utterance: Utterance) -> None:
        gesture = self._gestures.get(utterance.key)
        if gesture is not None:
            self._play(gesture)

    def _play(self, gesture: str) -> None:
        self._player.play(gesture, self.clock.now() / SECOND)

    def _on_up(self, state: dict[str, Any]) -> None:
        """Continue from the pose of the robot."""
        try:
            self._present = present_pose(state)
        except (KeyError, TypeError, ValueError, OverflowError):
            self.report_health("degraded", f"the daemon at {self.url} reports no pose: is its version known?")
            return
        self._motion = None if self._motion is None else self._motion_from(self._present)
        self._sent = None
        self._ticked = self.clock.now()
        self.report_health("ok")
        if self.idle and self._player.name == "none":
            self._play("idle")
        if self._tick_timer is None:
            self._tick()

    def _motion_from(self, present: Mapping[str, float]) -> JointMotion:
        """The motion to the last target, from another pose."""
        assert self._motion is not None
        start = {joint: present[joint] for joint in self._motion.target}
        way = max(abs(self._motion.target[joint] - start[joint]) / self._limits[joint].speed for joint in start)
        duration_s = max(way * PEAK_OF_MINIMUM_JERK, self.period_s)
        return JointMotion(start, self._motion.target, self.clock.now(), duration_s)

    def _on_down(self, reason: str) -> None:
        self._present = None
        self.report_health("degraded", reason)

    def _tick(self) -> None:
        """Take one step towards the pose of now, and send it if it differs from the last."""
        now = self.clock.now()
        self._tick_timer = self.context.call_at(now + nanoseconds(1.0 / self.rate_hz), self._tick)
        elapsed_s, self._ticked = min((now - self._ticked) / SECOND, 2.0 / self.rate_hz), now
        if self._present is None or self._stream is None or self._stopped:
            return
        self._present = self._step(self._present, now, elapsed_s)
        sent = self._sent
        moved = sent is None or any(abs(self._present[each] - sent[0][each]) > _STILL for each in CHANNELS)
        if moved or (sent is not None and now - sent[1] >= nanoseconds(_REPEAT_S)):
            self._sent = dict(self._present), now
            self._stream.send(daemon_target(self._present))

    def _step(self, present: Mapping[str, float], now: int, elapsed_s: float) -> dict[str, float]:
        gesture = self._player.at(now / SECOND)
        base = {**REST, **(_eased(self._motion, now) if self._motion else {})}
        speeds = {**_SPEEDS, **{joint: limits.speed for joint, limits in self._limits.items()}}
        bounds = {"roll": ROLL_RAD, "z": RISE_M, "left": ANTENNA_RAD, "right": ANTENNA_RAD}
        step: dict[str, float] = {}
        for channel in CHANNELS:
            aim = base[channel] + gesture[channel]
            if channel in self._limits:
                aim = self._limits[channel].clamp(aim)
            else:
                aim = min(max(aim, -bounds[channel]), bounds[channel])
            step[channel] = stepped(present[channel], aim, speeds[channel], elapsed_s)
        return step


def _eased(motion: JointMotion, time: int) -> dict[str, float]:
    share = minimum_jerk(min(max((time - motion.begin) / SECOND / motion.duration_s, 0.0), 1.0))
    return {joint: start + share * (motion.target[joint] - start) for joint, start in motion.start.items()}


def gestures_of(text: str, *, where: str) -> dict[str, str]:
    """Parse gestures by key, such as ``greeting=greeting, bye=goodbye``. Raises ParameterError."""
    found = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        key, equals, gesture = (word.strip() for word in part.partition("="))
        if not (key and equals) or gesture not in GESTURES:
            remedy = f"write KEY=GESTURE; {suggestion(gesture, GESTURES)}"
            raise ParameterError(f"cannot read {part!r}", where=where, remedy=remedy)
        found[key] = gesture
    return found


def present_pose(state: Mapping[str, Any]) -> dict[str, float]:
    """Return the channels of the reported pose. Raises KeyError, TypeError, ValueError or OverflowError."""
    head = state["head_pose"]
    right, left = state["antennas_position"]
    pose = {
        "yaw": float(head["yaw"]),
        "pitch": -float(head["pitch"]),
        "roll": float(head["roll"]),
        "z": float(head["z"]),
        "left": float(left),
        "right": float(right),
    }
    if not all(abs(value) <= _FARTHEST for value in pose.values()):
        raise ValueError(f"no pose of a head: {pose}")
    return pose


def daemon_target(pose: Mapping[str, float]) -> dict[str, Any]:
    """Return the target of the daemon for a pose; its pitch is positive down (REP-103)."""
    head = {"x": 0.0, "y": 0.0, "z": pose["z"], "roll": pose["roll"], "pitch": -pose["pitch"], "yaw": pose["yaw"]}
    return {
        "target_head_pose": {key: round(value, 5) + 0.0 for key, value in head.items()},
        "target_antennas": [round(pose["right"], 5), round(pose["left"], 5)],
        "target_body_yaw": 0.0,
    }


class DaemonPlayer:
    """An `AudioPlayer` on the robot's own loudspeaker."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._timer: threading.Timer | None = None
        self._lock = threading.Lock()

    def play(self, sound: Sound, on_end: OnEnd) -> None:
        """Send ``sound`` to the daemon in another thread, and call ``on_end`` when it is over."""
        self.stop()
        threading.Thread(target=self._play, args=(sound, on_end), name="socialbot-reachy-sound", daemon=True).start()

    def stop(self) -> None:
        """Stop the sound; a daemon that does not answer is ignored."""
        with self._lock:
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
            with suppress(DeviceError):
                DaemonClient(self._url).stop_sound()

    def _play(self, sound: Sound, on_end: OnEnd) -> None:
        try:
            client = DaemonClient(self._url, timeout_s=UPLOAD_TIMEOUT_S)
            client.upload_sound(SOUND_NAME, sound.wav())
            client.play_sound(SOUND_NAME)
            client.close()
        except SocialbotError as error:
            on_end(f"{error.what} ({error.remedy})")
            return
        timer = threading.Timer(sound.duration_s, on_end, (None,))
        timer.daemon = True
        with self._lock:
            self._timer = timer
        timer.start()


SOUND_NAME = "socialbot.wav"


class ReachySpeaker(Speaker):
    """Speaker on the loudspeaker of a Reachy Mini, if its daemon has sound; else on that of this computer."""

    url = Parameter(URL, "address of the daemon", fixed=True)

    def find_player(self) -> AudioPlayer | None:
        if isinstance(self.clock, WallClock):
            try:
                if DaemonClient(self.url).media_available():
                    return DaemonPlayer(self.url)
            except DeviceError as error:
                self.log.info("speaks on this computer: %s", error.what)
        return super().find_player()


class ReachyCamera(Camera):
    """Camera of a Reachy Mini Lite: asks the daemon to release it, and opens it.

    The REST interface of the daemon has no pictures. While a camera is open here, the daemon has neither camera nor
    sound; it gets both back at the end.
    """

    url = Parameter(URL, "address of the daemon", fixed=True)

    def start(self) -> None:
        self._ask(DaemonClient.release_media)
        try:
            super().start()
        except SocialbotError:
            self._ask(DaemonClient.acquire_media)
            raise

    def stop(self) -> None:
        super().stop()
        self._ask(DaemonClient.acquire_media)

    def _ask(self, request: Callable[[DaemonClient], None]) -> None:
        if not is_device(self.source):
            return
        try:
            request(DaemonClient(self.url))
        except DeviceError as error:
            self.log.warning("the camera may be in use by the daemon: %s", error.what)
