"""Reachy Mini: head, antennas, voice and camera by the REST interface of its daemon."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from socialbot.core.clock import SECOND, WallClock, nanoseconds
from socialbot.core.errors import DeviceError, ParameterError, SocialbotError, suggestion
from socialbot.core.messages import HeadCommand, Utterance
from socialbot.graph.node import Context, Timer
from socialbot.graph.ports import Input, Parameter
from socialbot.robots.daemon_client import UPLOAD_TIMEOUT_S, DaemonClient, TargetStream
from socialbot.robots.gestures import (
    CHANNELS,
    GESTURES,
    PEAK_OF_MINIMUM_JERK,
    REST,
    GesturePlayer,
    minimum_jerk,
    stepped,
)
from socialbot.robots.head import RobotHead
from socialbot.robots.limits import JointMotion
from socialbot.speech.playback import AudioPlayer, OnEnd
from socialbot.speech.speaker import Speaker
from socialbot.speech.synthesis import Sound
from socialbot.vision.camera_node import Camera, is_device

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
