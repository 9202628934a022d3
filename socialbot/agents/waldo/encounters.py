"""What frames with people tell of them: their paths, whether they attend to the robot, and who talks to whom."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import msgspec

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import PersonDetection, PersonDetections

_FACES_RAD, _AWAY_RAD = 1.0, 1.75  # facing: at most the first towards the robot, from the second on away from it
_WALKS_MPS, _STRIDES_MPS = 0.3, 0.6  # slower people stand; of faster ones the path counts, and not the face
_STANDS_M = 3.2  # With face detection, people who stand farther away must face the robot to engage.
_REACH_M = 1.2  # the path of a person who walks up to the robot passes it at most this far away,
_PAST_M = 1.8  # and that of one who walks past it after all farther than this: paths of a moment are not exact
PATH_S, _SURE_S = 0.3, 0.55  # least time to measure a path, and to be sure of it where a face may tell more
_VIEW_EDGE_RAD = 0.12  # people this near to the edge of the view may be cut off
_TOGETHER_M = 1.9  # people who talk to each other stand at most this far apart,
_STILL_M, _STILL = 0.35, 0.07  # move less than this and this share of their distance in the time that is looked at,
_TURNED_RAD = 0.7  # and face each other within this angle
_SIDE_RAD = 0.5  # a face this far from the direction to the robot may be hidden
_TALK_S = 0.8  # least time to find a conversation
_SILENT_S, _HIDDEN_S = 2.0, 12.0  # a conversation is over after this time without one; while one of the two is hidden
_LEFT_M = 0.9  # who moves farther has left a conversation


class View(NamedTuple):
    """View of a camera that turns: the direction of its middle from the robot's base, and half of its width."""

    yaw_rad: float
    half_rad: float

    @property
    def clear_rad(self) -> float:
        """Half of the width in which people are not cut off by the edge."""
        return max(0.0, self.half_rad - _VIEW_EDGE_RAD)

    def shows(self, bearing_rad: float) -> bool:
        """Whether people in the direction ``bearing_rad`` from the robot's base are in the view, and not cut off."""
        return abs(math.remainder(bearing_rad - self.yaw_rad, math.tau)) < self.clear_rad


def view_of(detections: PersonDetections) -> View | None:
    """Return the view of the camera; None if it does not turn, or is not known by transforms."""
    if detections.camera_yaw_rad is None or detections.camera_hfov_rad is None:
        return None
    return View(detections.camera_yaw_rad, detections.camera_hfov_rad / 2)


class Frame(NamedTuple):
    """Persons within range in one frame by track id, with its stamp (ns); of people without an id, the nearest.

    Without a ``view``, the camera does not turn.
    """

    stamp: int
    near: Mapping[str, PersonDetection]
    persons: int
    view: View | None = None

    def could_show(self, bearing_rad: float | None) -> bool:
        """Whether the view contains the direction ``bearing_rad`` from the robot's base."""
        return bearing_rad is None or self.view is None or self.view.shows(bearing_rad)


def in_base(person: PersonDetection, camera_yaw_rad: float | None) -> PersonDetection:
    """The person with the bearing from the robot's base, which does not turn with the head."""
    if person.bearing_rad is None or not camera_yaw_rad:
        return person
    return msgspec.structs.replace(person, bearing_rad=person.bearing_rad + camera_yaw_rad)


class Path(NamedTuple):
    """How a person walks.

    Attributes:
        seconds: Time in which it was measured.
        speed_mps: Speed.
        approach_mps: Its part towards the robot.
        passes_m: Distance at which the line of the path passes the robot.
    """

    seconds: float
    speed_mps: float
    approach_mps: float
    passes_m: float

    @property
    def is_walk(self) -> bool:
        """Whether the person walks rather than stands."""
        return self.speed_mps >= _WALKS_MPS

    def is_towards_robot(self, *, before: bool = False) -> bool:
        """Whether the path comes nearer, and passes the robot closely, or not far off if it did so ``before``."""
        return self.approach_mps > 0 and self.passes_m <= (_PAST_M if before else _REACH_M)


def path_of(frames: Sequence[Frame], person: str) -> Path | None:
    """Return the path of ``person`` in ``frames``; None if they show too little of it."""
    looks = [
        (frame.stamp, look.distance_m, look.bearing_rad)
        for frame in frames
        if (look := frame.near.get(person)) and look.distance_m is not None and look.bearing_rad is not None
    ]
    if not looks or looks[-1][0] - looks[0][0] < nanoseconds(PATH_S) * 0.9:
        return None
    (begin, first_m, first_rad), (end, last_m, last_rad) = looks[0], looks[-1]
    seconds = (end - begin) / SECOND
    turn = math.remainder(last_rad - first_rad, math.tau)
    # In the frame of the last position: ahead towards the robot, and sideways.
    ahead, sideways = (first_m * math.cos(turn) - last_m) / seconds, first_m * math.sin(turn) / seconds
    speed = math.hypot(ahead, sideways)
    return Path(seconds, speed, ahead, last_m * abs(sideways) / speed if speed else 0.0)


def strides_of(frames: Sequence[Frame], person: str) -> tuple[float, float]:
    """Return the velocity (m/s, in the robot's base) of ``person`` in ``frames``; 0 of one who does not stride."""
    path = path_of(frames, person)
    if path is None or path.speed_mps < _STRIDES_MPS:
        return 0.0, 0.0
    places = [place for frame in frames if (look := frame.near.get(person)) and (place := place_of(look))]
    (x0, y0), (x1, y1) = places[0], places[-1]
    return (x1 - x0) / path.seconds, (y1 - y0) / path.seconds


def newest_path(path: Path | None, longer: Path | None, *, before: bool) -> Path | None:
    """Return a path with the speed of the slower of two, and the line of the first, since a person may have turned.

    Errors of distances can make a standing person seem to walk for a moment. So a person who was attentive ``before``
    stays attentive while one of the two lines leads to the robot.
    """
    if path is None or longer is None:
        return path or longer
    slower = min(path, longer, key=lambda one: one.speed_mps)
    line = longer if before and longer.is_towards_robot(before=True) else path
    return slower._replace(approach_mps=line.approach_mps, passes_m=line.passes_m)


def is_undecided(person: PersonDetection, path: Path | None, *, faces: bool) -> bool:
    """Whether more frames will tell if a person attends to the robot, by a path or, with ``faces``, by a face."""
    if _is_facing_known(person) or place_of(person) is None:
        return False
    return path is None or (faces and (path.speed_mps < _WALKS_MPS or path.seconds < _SURE_S))


def place_of(person: PersonDetection) -> tuple[float, float] | None:
    """Return where a person is (m, in the robot's base); None if it is not known."""
    if person.distance_m is None or person.bearing_rad is None:
        return None
    return person.distance_m * math.cos(person.bearing_rad), person.distance_m * math.sin(person.bearing_rad)


def telling(looks: Sequence[PersonDetection]) -> Sequence[PersonDetection]:
    """Return the looks at a person that tell about attention.

    Looks of unknown direction do not, once the person is known to be turned away.
    """
    if not _is_turned_away(looks[-1]):
        return looks
    return [look for look in looks if look.facing_rad is not None]


def attention(
    person: PersonDetection, path: Path | None, within_m: float, *, faces: bool, before: bool = False
) -> tuple[bool, str]:
    """Judge whether a person within ``within_m`` walks up to the robot, faces it, or stands near it.

    Without detection of ``faces``, everybody who stands within ``within_m`` engages. A person who was attentive
    ``before`` walks past the robot only at a greater distance.

    Returns:
        Whether the person attends to the robot, and what shows it.
    """
    if person.distance_m is not None and person.distance_m > within_m:
        return False, f"is {person.distance_m:.1f} m away"
    strides = path is not None and path.speed_mps >= _STRIDES_MPS and not _is_turned_away(person)
    if _is_facing_known(person) and not strides:
        faces_robot = (person.facing_rad or 0.0) <= _FACES_RAD
        return faces_robot, "faces the robot" if faces_robot else "faces away from the robot"
    if path is None:
        if person.approach_mps is None:
            return True, "does not turn away"
        return person.approach_mps > -_WALKS_MPS, f"approaches at {person.approach_mps:.1f} m/s"
    if not path.is_walk:
        near = not faces or person.distance_m is None or person.distance_m <= _STANDS_M
        return near, "stands before the robot" if near else f"stands {person.distance_m:.1f} m away"
    if path.is_towards_robot(before=before):
        return True, "walks up to the robot"
    past = f"walks past the robot at {path.passes_m:.1f} m"
    return False, past if path.approach_mps > 0 else "walks away from the robot"


def _is_turned_away(person: PersonDetection) -> bool:
    return person.facing_rad is not None and person.facing_rad >= _AWAY_RAD


def _is_facing_known(person: PersonDetection) -> bool:
    """Whether a person clearly faces the robot or turns away from it."""
    return person.facing_rad is not None and not _FACES_RAD < person.facing_rad < _AWAY_RAD


class _Standing(NamedTuple):
    """Mean place (m, in the robot's base) and facing of a person who stands."""

    x: float
    y: float
    facing_rad: float | None

    def may_face(self, other: _Standing) -> bool:
        """Whether this person may face another one, who does not stand beside the direction of the own face."""
        to_robot = math.atan2(-self.y, -self.x)
        aside = abs(math.remainder(math.atan2(other.y - self.y, other.x - self.x) - to_robot, math.tau))
        if self.facing_rad is None:
            return aside > _SIDE_RAD
        return abs(self.facing_rad - aside) <= _TURNED_RAD


def may_join(person: PersonDetection, others: Iterable[tuple[float, float]]) -> bool:
    """Whether a standing person may be talking to one of the ``others`` (m, in the robot's base), not to the robot.

    People before the robot may also stand in a queue, one behind the other.
    """
    place = place_of(person)
    if place is None or _is_facing_known(person):
        return False
    one, is_far = _Standing(*place, None), math.hypot(*place) > _STANDS_M
    near = (_Standing(*other, None) for other in others if math.dist(place, other) <= _TOGETHER_M)
    return any(is_far or (one.may_face(other) and other.may_face(one)) for other in near)


class _Talk(NamedTuple):
    """Conversation of a person: with whom, where (m, in the robot's base), and when it was seen last (ns)."""

    other: str
    x: float
    y: float
    last: int


class Conversations:
    """Finds out who talks to whom, and remembers it while one of the two is out of view.

    Two people talk if they stand together for `_TALK_S` at least, and both may face each other: an F-formation.
    """

    def __init__(self) -> None:
        self._talks: dict[str, _Talk] = {}

    def clear(self) -> None:
        """Forget all conversations."""
        self._talks.clear()

    def forget(self, person: str) -> bool:
        """Forget the conversation of a person who has left; whether there was one."""
        return self._talks.pop(person, None) is not None

    def look(
        self, frames: Sequence[Frame], present: Container[str], visitors: Container[str] = ()
    ) -> Iterator[tuple[str, str, bool]]:
        """Return the changes by ``frames`` for people who are ``present``: person, reason, and whether it begins.

        ``visitors`` of unknown direction face the robot.
        """
        if not frames or frames[-1].stamp - frames[0].stamp < nanoseconds(_TALK_S):
            return
        now, latest = frames[-1].stamp, frames[-1].near
        standing = {name: one for name in latest if (one := _standing(frames, name)) is not None}
        for name, one in standing.items():
            if one.facing_rad is None and name in visitors:
                standing[name] = one._replace(facing_rad=0.0)
        for name, (other, gap_m) in _pairs(standing).items():
            if name in present:
                if name not in self._talks:
                    yield name, f"{name} and {other} stand {gap_m:.1f} m apart and face each other", True
                self._talks[name] = _Talk(other, standing[name].x, standing[name].y, now)
        for name, talk in list(self._talks.items()):
            if (why := self._ended(name, talk, frames, standing)) and name in latest:
                del self._talks[name]
                yield name, why, False

    def _ended(self, name: str, talk: _Talk, frames: Sequence[Frame], standing: Mapping[str, _Standing]) -> str:
        """Why a conversation is over; empty if it may go on."""
        silent_s = (frames[-1].stamp - talk.last) / SECOND
        if silent_s < _SILENT_S:
            return ""
        person = standing.get(name)
        if person is None or math.hypot(person.x - talk.x, person.y - talk.y) > _LEFT_M:
            return f"{name} has left {talk.other}"
        if person.facing_rad is not None and person.facing_rad < _SIDE_RAD and not _in_front(person, talk, standing):
            return f"{name} has turned to the robot"
        if talk.other in standing or silent_s > _HIDDEN_S:
            return f"{name} and {talk.other} have not faced each other for {silent_s:.0f} s"
        return ""


def _in_front(person: _Standing, talk: _Talk, standing: Mapping[str, _Standing]) -> bool:
    """Whether the other one of a conversation stands between a person and the robot."""
    other = standing.get(talk.other)
    return other is not None and person.may_face(other)


def _pairs(standing: Mapping[str, _Standing]) -> dict[str, tuple[str, float]]:
    """People who may talk to each other: the nearest such one of each, and their distance (m)."""
    found: dict[str, tuple[str, float]] = {}
    for (name, one), (other, two) in combinations(standing.items(), 2):
        gap = math.hypot(one.x - two.x, one.y - two.y)
        if gap <= _TOGETHER_M and one.may_face(two) and two.may_face(one):
            for who, whom in ((name, other), (other, name)):
                if who not in found or gap < found[who][1]:
                    found[who] = whom, gap
    return found


def _standing(frames: Sequence[Frame], person: str) -> _Standing | None:
    found = [(look, place) for frame in frames if (look := frame.near.get(person)) and (place := place_of(look))]
    if len(found) < 0.6 * len(frames):
        return None
    looks, places = [look for look, _ in found], [place for _, place in found]
    half = len(places) // 2
    (x0, y0), (x1, y1) = (_mean(part) for part in (places[:half], places[half:]))
    # Between the means of both halves lies half of the time.
    if math.hypot(x1 - x0, y1 - y0) > _STILL_M + _STILL * math.hypot(x1, y1):
        return None
    known = sorted(look.facing_rad for look in looks if look.facing_rad is not None)
    facing = known[len(known) // 2] if 2 * len(known) >= len(looks) else None
    return _Standing((x0 + x1) / 2, (y0 + y1) / 2, facing)


def _mean(places: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return sum(x for x, _ in places) / len(places), sum(y for _, y in places) / len(places)
