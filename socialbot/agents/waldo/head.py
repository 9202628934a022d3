"""Head node: follows people or takes pan and tilt commands. An attentive head chooses by itself where it looks."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from socialbot.agents.waldo.encounters import View, view_of
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


class Pose(NamedTuple):
    """Head pose in rad: pan positive to the left, tilt positive up (REP-103); 0, 0 is straight ahead."""

    pan: float
    tilt: float

    def distance(self, other: Pose) -> float:
        """The larger of the two angles between the poses, in rad."""
        return max(abs(self.pan - other.pan), abs(self.tilt - other.tilt))


class Seen(NamedTuple):
    """Detected person: distance in m (infinite if unknown), bearing as a head pose, and track id if any.

    ``attentive`` is whether the person faces the robot or comes nearer; None if unknown.
    """

    distance_m: float
    pose: Pose
    track_id: str
    attentive: bool | None = None


_GLANCE_S = 1.5  # A person who does not attend to the robot is looked at for this long,
_REST_S = 9.0  # and not again for this long.
_ATTENTIVE_M = 2.5  # An attentive person counts as nearer by this distance.
_SPEAKER_S = 4.0  # Who speaks is looked at for this long.
_LEAD_S, _EASE_S = 0.2, 0.4  # The head leads a walker by this time; speeds are averaged over this time.
_FASTEST_RAD_S = 0.8
_LOST_S = 2.5  # The head looks where it lost a person for this long,
_BEYOND_RAD = 0.35  # farther on in the direction in which the person went.
_COAST_S = 1.2  # Somebody who walks out of view is expected to walk on for this long.
_TURNS_S = 1.5  # An attentive person out of view is looked at after this time.
_MISSED_S = 1.0  # An attentive person is forgotten after this time if their direction is in view, but not they,
_UNSEEN_S = 6.0  # or after this time out of view.
_SEARCH = ((0.0, 3.0), (0.55, 1.6), (0.0, 2.0), (-0.55, 1.6))
"""Directions (rad) in which the head looks around, and how long (s) it stays there."""


@dataclass
class _Walker:
    pan: float
    at_s: float
    speed_rad_s: float = 0.0


@dataclass
class _Member:
    """Attentive person: direction, distance, and speed of the direction, when they were seen last."""

    last_pan: float
    distance_m: float
    at_s: float
    speed_rad_s: float
    pan: float = 0.0

    def expect(self, now_s: float) -> None:
        """Set the direction that is expected now."""
        self.pan = self.last_pan + self.speed_rad_s * min(now_s - self.at_s + _LEAD_S, _COAST_S)


@dataclass
class Gaze:
    """Chooses the direction of an attentive head from the people in view, their interest, and who speaks.

    Args:
        switch_margin_m: Another person is looked at if nearer by this distance.
    """

    switch_margin_m: float = 0.5
    target: str = ""
    _group: dict[str, _Member] = field(default_factory=dict)
    _since_s: float = 0.0
    _rests: dict[str, float] = field(default_factory=dict)
    _walkers: dict[str, _Walker] = field(default_factory=dict)
    _speaker: tuple[str, float] = ("", -math.inf)
    _lost: tuple[float, float] = (0.0, -math.inf)
    _search_step: int = 0
    _search_since_s: float | None = None

    def hear(self, person: str, now_s: float) -> None:
        """Look at a person who speaks."""
        self._speaker = person, now_s + _SPEAKER_S

    def look(self, seen: Sequence[Seen], now_s: float, view: View | None = None) -> Pose | None:
        """Return where to look; None to keep the direction.

        Args:
            seen: People in view, with poses from the robot's base.
            now_s: Time of the image.
            view: What the camera sees; the head keeps all attentive people in it, if they fit.
        """
        self._measure(seen, now_s)
        if view is not None:
            self._remember(seen, now_s, view)
        chosen = self._choose(seen, now_s)
        if chosen is None:
            waiting = self._waiting(now_s, view)
            return self._search(now_s) if waiting is None else Pose(waiting, 0.0)
        self._search_since_s = None
        speed = self._walkers[chosen.track_id].speed_rad_s
        if chosen.attentive is not False:
            self._lost = chosen.pose.pan + math.copysign(_BEYOND_RAD, speed) * (abs(speed) > 0.1), now_s + _LOST_S
        pan = chosen.pose.pan + _LEAD_S * speed
        if view is not None and chosen.attentive:
            pan = self._with_group(pan, now_s, view)
        return Pose(pan, chosen.pose.tilt)

    def _remember(self, seen: Sequence[Seen], now_s: float, view: View) -> None:
        """Note who attends to the robot, also while they are out of view."""
        for person in seen:
            if person.attentive:
                speed = self._walkers[person.track_id].speed_rad_s
                self._group[person.track_id] = _Member(person.pose.pan, person.distance_m, now_s, speed)
            elif person.attentive is False:
                self._group.pop(person.track_id, None)
        for name, one in list(self._group.items()):
            one.expect(now_s)
            if now_s - one.at_s > (_MISSED_S if view.shows(one.pan) else _UNSEEN_S):
                del self._group[name]

    def _waiting(self, now_s: float, view: View | None) -> float | None:
        """Return the direction of the attentive person who left the view first; None if all are in view."""
        if view is None:
            return None
        unseen = [one for one in self._group.values() if now_s - one.at_s > _TURNS_S and not view.shows(one.pan)]
        return min(unseen, key=lambda one: one.at_s).pan if unseen else None

    def _with_group(self, pan: float, now_s: float, view: View) -> float:
        """Return the direction nearest to ``pan`` that also shows the attentive people, the nearest of them first.

        If they do not fit into the view, the head turns to those whom it has not seen for a while.
        """
        waiting = self._waiting(now_s, view)
        if waiting is not None:
            pan = waiting
        width = 2 * view.clear_rad
        low = high = pan
        for one in sorted(self._group.values(), key=lambda one: one.distance_m):
            if max(high, one.pan) - min(low, one.pan) <= width:
                low, high = min(low, one.pan), max(high, one.pan)
        return min(max(pan, high - view.clear_rad), low + view.clear_rad)

    def _measure(self, seen: Sequence[Seen], now_s: float) -> None:
        for person in seen:
            known = self._walkers.get(person.track_id)
            if known is None or not 0 < now_s - known.at_s < 1.0:
                self._walkers[person.track_id] = _Walker(person.pose.pan, now_s)
                continue
            step = now_s - known.at_s
            speed = (person.pose.pan - known.pan) / step
            share = 1 - math.exp(-step / _EASE_S)
            limited = min(max(speed, -_FASTEST_RAD_S), _FASTEST_RAD_S)
            known.speed_rad_s += share * (limited - known.speed_rad_s)
            known.pan, known.at_s = person.pose.pan, now_s
        self._walkers = {name: one for name, one in self._walkers.items() if now_s - one.at_s < 5.0}
        self._rests = {name: until for name, until in self._rests.items() if until > now_s}

    def _choose(self, seen: Sequence[Seen], now_s: float) -> Seen | None:
        speaker = self._speaker[0] if now_s < self._speaker[1] else ""
        for person in seen:
            if person.attentive or person.track_id == speaker:
                self._rests.pop(person.track_id, None)
            elif person.track_id == self.target and now_s - self._since_s > _GLANCE_S:
                self._rests[person.track_id] = now_s + _REST_S
        awake = [person for person in seen if person.track_id not in self._rests]
        if not awake:
            self.target = ""
            return None

        def cost(person: Seen) -> float:
            if person.track_id == speaker:
                return -math.inf
            bonus = _ATTENTIVE_M if person.attentive else 0.0
            kept = self.switch_margin_m if person.track_id == self.target else 0.0
            return person.distance_m - bonus - kept

        best = min(awake, key=lambda person: (cost(person), abs(person.pose.pan)))
        if best.track_id != self.target:
            self.target, self._since_s = best.track_id, now_s
        elif best.attentive:
            self._since_s = now_s
        return best

    def _search(self, now_s: float) -> Pose | None:
        """Look where the last person went, then around."""
        pan, until = self._lost
        if now_s < until:
            return Pose(pan, 0.0)
        if self._search_since_s is None:
            self._search_step, self._search_since_s = 0, now_s
        pan, stay_s = _SEARCH[self._search_step % len(_SEARCH)]
        if now_s - self._search_since_s > stay_s:
            self._search_step, self._search_since_s = self._search_step + 1, now_s
            pan, _ = _SEARCH[self._search_step % len(_SEARCH)]
        return Pose(pan, 0.0)


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
