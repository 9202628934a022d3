"""Head node: follows people or takes pan and tilt commands."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialbot.agents.waldo.encounters import view_of
from socialbot.agents.waldo.gaze import Gaze, Pose, Seen
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import (
    HeadCommand,
    Health,
    HeardSpeech,
    JointTrajectory,
    Message,
    PersonDetection,
    PersonDetections,
    VoiceActivity,
)
from socialbot.graph.health import BEATLESS_S, HEALTH_TOPIC
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter

CENTRE = Pose(0.0, 0.0)
_FACES_RAD, _COMES_MPS = 1.0, 0.3
_CLOCKS_S, _LATE_S = 0.2, 3.0
"""Largest lead of the stamp of a frame, and its largest age at its arrival, with one clock, s."""


@dataclass(frozen=True)
class Motion:
    """Head motion at constant speed from ``start`` to ``target``, begun at the time ``begin`` (ns)."""

    start: Pose
    target: Pose
    begin: int
    duration_s: float

    def at(self, time: int) -> Pose:
        """The pose at ``time`` (ns)."""
        share = min(max((time - self.begin) / SECOND / self.duration_s, 0.0), 1.0)
        return Pose(*(a + share * (b - a) for a, b in zip(self.start, self.target, strict=True)))


class Head(Node):
    """Head controller: follows the nearest person, centres the head, or holds a pan and tilt.

    Pan is positive to the left and tilt positive up (REP-103). The node starts in tracking mode. It estimates the head
    pose by dead reckoning from the centre, with ``max_speed_rad_s`` on the slower joint. With ``camera_on_head`` a
    bearing is relative to the head pose at the stamp of the frame; at its arrival, if the camera has another clock.

    The person who speaks has precedence, also for ``hold_s`` afterwards; a voice out of view is looked for where it is.

    The followed person keeps their track id. Without it, the person nearest in direction counts as the same, within
    ``same_person_rad``. Another person takes over when nearer by more than ``switch_margin_m``.

    An ``attentive`` head also follows people while the agent is idle: people who face the robot or come nearer before
    others, who get a glance. It looks at who speaks, where it lost a person, and around (`Gaze`). It needs a tracker.

    The head centres while the node ``engine`` publishes no heartbeats.
    """

    command = Input(HeadCommand, "/head/command")
    health = Input(Health, HEALTH_TOPIC, optional=True, deadline_s=BEATLESS_S)
    detections = Input(PersonDetections, "/humans/bodies/detections", Delivery.NEWEST)
    voices = Input(VoiceActivity, "/humans/voices/activity", optional=True)
    heard = Input(HeardSpeech, "/humans/voices/speech", optional=True)
    trajectory = Output(JointTrajectory, "/head_controller/joint_trajectory")

    pan_joint = Parameter("head_pan_joint", "joint that turns the head, positive to the left")
    tilt_joint = Parameter("head_tilt_joint", "joint that nods the head, positive up")
    pan_limit_rad = Parameter(1.2, "largest pan to either side, rad", minimum=0.0, maximum=math.pi)
    tilt_limit_rad = Parameter(0.5, "largest tilt up or down, rad", minimum=0.0, maximum=math.pi / 2)
    max_speed_rad_s = Parameter(1.0, "largest speed of each joint, rad/s", minimum=0.01, maximum=10.0)
    dead_band_rad = Parameter(0.03, "smaller movements of a person are ignored, rad", minimum=0.0)
    period_s = Parameter(0.1, "shortest time between two commands, s", minimum=0.01)
    hold_s = Parameter(2.0, "time without people until the head centres, s", minimum=0.0)
    switch_margin_m = Parameter(0.5, "another person is followed if nearer by this distance, m", minimum=0.0)
    same_person_rad = Parameter(0.35, "largest movement of a person between two frames, rad", minimum=0.0)
    engine = Parameter("", "node whose heartbeats the head requires; empty: none")
    camera_on_head = Parameter(False, "whether the camera turns with the head")
    attentive = Parameter(False, "whether the head follows and searches people by itself, unless told where to look")
    ease_s = Parameter(0.0, "shortest duration of a motion, s", minimum=0.0, maximum=5.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        now = self.clock.now()
        # Long enough to find the pose at the frame of a detection: at least three seconds.
        self._motions = deque([Motion(CENTRE, CENTRE, now, 1.0)], maxlen=32)
        self._wanted = CENTRE
        self._slack = 0.0
        self._earliest = now
        self._move_due = False
        self._tracking = self._free = True
        self._gaze = Gaze(self.switch_margin_m)
        self._led = True
        self._followed: Seen | None = None
        self._last_seen = now
        self._watching = False
        self._speaker, self._spoke = "", now
        self._other_clock = False
        """Whether a frame had a stamp of another clock."""

    def deadline_s(self, port: Input[Any]) -> float:
        return port.deadline_s if self.engine else 0.0

    def counts(self, port: Input[Any], message: Message) -> bool:
        return isinstance(message, Health) and message.node == self.engine

    @health
    def on_health(self, health: Health) -> None:
        """Only the arrival of the message matters."""

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self._led = False
        self._followed = None
        self._aim(CENTRE)

    def on_return(self, port: Input[Any]) -> None:
        self._led = True

    @command
    def on_command(self, command: HeadCommand) -> None:
        if not (math.isfinite(command.pan_rad) and math.isfinite(command.tilt_rad)):
            self.log.warning("cannot look at pan %s, tilt %s", command.pan_rad, command.tilt_rad)
            return
        self._tracking = command.mode == "track"
        self._free = command.mode != "look"
        self._followed = None
        if self.attentive and self._free:
            return
        if self._tracking:
            self._last_seen = self.clock.now()
            self._watch()
        else:
            self._aim(CENTRE if command.mode == "centre" else Pose(command.pan_rad, command.tilt_rad))

    @detections
    def on_detections(self, detections: PersonDetections) -> None:
        seen = self._seen(detections)
        if self.attentive:
            now_s, view = detections.stamp / SECOND, view_of(detections) if self.camera_on_head else None
            wanted = self._gaze.look(seen, now_s, view) if self._led and self._free else None
            if wanted is not None:
                self._aim(wanted, slack=self.dead_band_rad)
            return
        if not self._tracking or not self._led or not seen:
            return
        self._followed = self._choose(seen)
        self._last_seen = self.clock.now()
        self._watch()
        self._aim(self._followed.pose, slack=self.dead_band_rad)

    @heard
    def on_heard(self, heard: HeardSpeech) -> None:
        if heard.person:
            self._gaze.hear(heard.person, heard.stamp / SECOND)

    @voices
    def on_voice(self, voice: VoiceActivity) -> None:
        if not voice.active or not (voice.person or voice.bearing_rad is not None):
            return
        self._speaker, self._spoke = voice.person, self.clock.now()
        unseen = not voice.person and self._followed is None
        if unseen and self._tracking and self._led and voice.bearing_rad is not None:
            self._last_seen = self.clock.now()
            self._watch()
            camera = self._pose_at(self._time_of(voice.stamp)) if self.camera_on_head else CENTRE
            self._aim(Pose(camera.pan + voice.bearing_rad, self._wanted.tilt), slack=self.dead_band_rad)

    def on_parameter(self, name: str) -> None:
        """Move the head within new, narrower limits."""
        self._gaze.switch_margin_m = self.switch_margin_m
        if name in ("pan_limit_rad", "tilt_limit_rad"):
            self._aim(self._wanted, slack=self._slack)

    def _seen(self, detections: PersonDetections) -> list[Seen]:
        """Persons with a known direction."""
        camera = self._pose_at(self._time_of(detections.stamp)) if self.camera_on_head else CENTRE
        if self.camera_on_head and detections.camera_yaw_rad is not None:
            # By transforms: elevations are above the horizon then, however the camera tilts.
            camera = Pose(detections.camera_yaw_rad, 0.0)
        level = self._wanted.tilt - camera.tilt
        found = []
        for person in detections.known:
            elevation = level if person.elevation_rad is None else person.elevation_rad
            if person.bearing_rad is None or not math.isfinite(person.bearing_rad) or not math.isfinite(elevation):
                continue
            distance = math.inf if person.distance_m is None or math.isnan(person.distance_m) else person.distance_m
            pose = Pose(camera.pan + person.bearing_rad, camera.tilt + elevation)
            found.append(Seen(distance, pose, person.track_id, _is_attentive(person)))
        return found

    def _choose(self, seen: list[Seen]) -> Seen:
        if self._speaker and self.clock.now() <= self._spoke + nanoseconds(self.hold_s):
            speaking = [person for person in seen if person.track_id == self._speaker]
            if speaking:
                return speaking[0]
        nearest = min(seen, key=lambda person: (person.distance_m, abs(person.pose.pan)))
        present = self._still_there(seen)
        if present is None or nearest.distance_m < present.distance_m - self.switch_margin_m:
            return nearest
        return present

    def _still_there(self, seen: list[Seen]) -> Seen | None:
        """The person followed last, if still detected."""
        last = self._followed
        if last is None:
            return None
        if same := [person for person in seen if person.track_id and person.track_id == last.track_id]:
            return same[0]
        closest = min(seen, key=lambda person: abs(person.pose.pan - last.pose.pan))
        return closest if abs(closest.pose.pan - last.pose.pan) <= self.same_person_rad else None

    def _watch(self) -> None:
        """Schedule a check that a person is present, even without further detections."""
        if not self._watching:
            self._watching = True
            self.context.call_at(self._last_seen + nanoseconds(self.hold_s), self._check_presence)

    def _check_presence(self) -> None:
        self._watching = False
        if self._tracking and self.clock.now() < self._last_seen + nanoseconds(self.hold_s):
            self._watch()
        elif self._tracking:
            self._followed = None
            self._aim(CENTRE)

    def _aim(self, pose: Pose, slack: float = 0.0) -> None:
        """Move to ``pose`` as soon as the command rate allows it, unless the target is within ``slack`` of it."""
        self._wanted = Pose(_within(pose.pan, self.pan_limit_rad), _within(pose.tilt, self.tilt_limit_rad))
        self._slack = slack
        if self._move_due:
            return
        if self.clock.now() >= self._earliest:
            self._move()
        else:
            self._move_due = True
            self.context.call_at(self._earliest, self._move)

    def _move(self) -> None:
        self._move_due = False
        if self._wanted.distance(self._motions[-1].target) <= self._slack:
            return
        now = self.clock.now()
        start = self._pose_at(now)
        # At least one period: controllers refuse points that are due at once.
        duration_s = max(start.distance(self._wanted) / self.max_speed_rad_s, self.period_s, self.ease_s)
        self._motions.append(Motion(start, self._wanted, now, duration_s))
        self._earliest = now + nanoseconds(self.period_s)
        joints, pose, still = (self.pan_joint, self.tilt_joint), tuple(self._wanted), (0.0, 0.0)
        self.trajectory.publish(
            JointTrajectory(stamp=now, joint_names=joints, positions=pose, velocities=still, duration_s=duration_s)
        )

    def _time_of(self, stamp: int) -> int:
        """Return the time of a frame by the clock of this node: ``stamp``, or now if it is of another clock."""
        now = self.clock.now()
        if -nanoseconds(_CLOCKS_S) <= now - stamp <= nanoseconds(_LATE_S):
            return stamp
        if not self._other_clock:
            self._other_clock = True
            self.log.warning(
                "the clock of the camera is %.1f s %s: frames count as taken when they arrive; set both clocks by NTP",
                abs(now - stamp) / SECOND, "behind" if now > stamp else "ahead",
            )  # fmt: skip
        return now

    def _pose_at(self, time: int) -> Pose:
        """The estimated head pose at ``time`` (ns)."""
        motion = next((one for one in reversed(self._motions) if one.begin <= time), None)
        return self._motions[0].start if motion is None else motion.at(time)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _is_attentive(person: PersonDetection) -> bool | None:
    """Whether a person faces the robot or comes nearer; None if unknown."""
    if person.facing_rad is not None:
        return person.facing_rad <= _FACES_RAD
    return None if person.approach_mps is None else person.approach_mps >= _COMES_MPS
