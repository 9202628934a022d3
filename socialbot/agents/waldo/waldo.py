"""Waldo, an agent that greets people and offers help unasked.

The module follows the six steps of Algorithm 1 in the paper, with its names of beliefs, desires and intentions.
"""
# ruff: noqa: N801 - beliefs, goals and actions have the names of the paper

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median_low
from typing import NamedTuple

import msgspec

# 1. Import the parts of an agent
from socialbot.bdi import (
    Action,
    Belief,
    Engine,
    Goal,
    Reactor,
    Sensed,
    Sensor,
    SingletonBelief,
    atomic,
    for_each,
    variables,
    when,
)
from socialbot.bdi.literals import Event
from socialbot.core.clock import SECOND, Clock, nanoseconds
from socialbot.core.messages import PersonDetection, PersonDetections


# 2. Define beliefs and goals
class personDetected(SingletonBelief):
    """Presence of people: "Yes", "No", "Next" (a person stays) or "Unknown" (no detections arrive)."""


class present(Belief):
    """A person is present; the argument is their track id, or `SOMEBODY`."""


class stays(Belief):
    """This person has been present for at least ``help_after_s``."""


class engages(Belief):
    """This person is present and faces the robot, walks up to it, or stands before it; who only passes does not."""


class greeted(Belief):
    """This person has been greeted."""


class offered(Belief):
    """This person has been offered help."""


class people(SingletonBelief):
    """Number of people in view when the first of them arrived."""


class gone(Belief):
    """This person has left, less than ``forget_after_s`` ago."""


class ungreeted(Belief):
    """This person engages and has not been greeted."""


class unoffered(Belief):
    """This person stays, engages, and has not been offered help."""


class several(Belief):
    """More than one person waits for a greeting."""


class forgotten(Reactor):
    """This person left so long ago that they are greeted anew."""


class returned(Reactor):
    """A person arrived after a loss of detections, and counts as this one, who was present before it."""


class silent(SingletonBelief):
    """Source of missing detections: a silent node, an external camera topic, or the link to a machine."""


class DoNothing(Goal):
    """Stay idle."""


class GreetPeople(Goal):
    """Greet the people who engage and have not been greeted."""


class OfferHelp(Goal):
    """Offer help to the people who stay and have had no offer."""


@dataclass
class WaldoConfig:
    """Configuration that may change at run time: distances in m, durations in s (see docs/waldo.md)."""

    range_m: float = 6.0
    appear_s: float = 0.5
    vanish_s: float = 2.5
    help_after_s: float = 8.0
    regreet_after_s: float = 5.0
    forget_after_s: float = 60.0


# 3. Define actions (and the sensor of people)
class speak(Action):
    """Speak the sentence for a situation."""

    def execute(self, situation: str) -> None:
        robot = self.engine.robot
        robot.act(self, situation, robot.sentence(situation))


class stayIdle(Action):
    """Say nothing and centre the head."""

    def execute(self) -> None:
        self.engine.robot.act(self)


class attend(Action):
    """Say nothing and follow people with the head."""

    def execute(self) -> None:
        self.engine.robot.act(self)


OVERTAKEN_S = 1.0
"""Tolerance of stamps: frames older by no more are late or duplicate; older ones mean that the clock was reset."""

SOMEBODY = "somebody"  # track id of all people without one

_FACES_RAD, _AWAY_RAD = 1.0, 1.75  # facing: at most the first towards the robot, from the second on away from it
_WALKS_MPS = 0.3  # slower people stand
_REACH_M = 1.2  # the path of a person who walks up to the robot passes it at most this far away
_PATH_S = 0.3  # least time to measure a path
_DECIDE_S = 1.0  # a person who has been present for this long engages even if no path was measured


class Frame(NamedTuple):
    """Persons within range in one frame by track id, with its stamp (ns); of people without an id, the nearest."""

    stamp: int
    near: Mapping[str, PersonDetection]
    persons: int


class PersonSensor(Sensor):
    """Sensor of arrivals, departures and attention, which filters flickering detections.

    A person arrives when at least half of the frames of the last ``appear_s`` show them within ``range_m``. A person
    leaves when fewer than a quarter of the frames of the last ``vanish_s`` do. A person present for ``help_after_s``
    stays. A person engages from the moment in which they are attentive in at least half of the last frames, until
    fewer than a quarter of them.
    """

    def __init__(self, config: WaldoConfig) -> None:
        self._config = config
        self._frames: deque[Frame] = deque()
        self._there: dict[str, int | None] = {}  # time (ns) from which a person counts as staying; None if they stay
        self._changed: dict[str, int] = {}  # time (ns) of the last arrival or departure
        self._engaged: set[str] = set()
        self._gone: dict[str, int] = {}  # time (ns) at which each of them left
        self._lost: tuple[str, ...] = ()  # those present at the last loss of detections
        self._alone: bool | None = None  # None at first, and after a loss of detections
        self._lost_at = 0

    def sense(self, percept: PersonDetections | None) -> Sensed:
        """Return the belief changes of these detections; None means that no more arrive."""
        if percept is None:
            return self._lose_sight()
        if self._frames and 0 <= self._frames[-1].stamp - percept.stamp <= nanoseconds(OVERTAKEN_S):
            return None
        self._look(percept)
        changes = [*self._leave(percept.stamp), *self._forget(percept.stamp), *self._come(percept.stamp)]
        if self._there and self._alone is not False:
            number = self._company()
            counted = f"a median of {number} in range in the frames of the last {self._config.appear_s:g} s with people"
            somebody = f"{', '.join(self._there)} {'is' if len(self._there) == 1 else 'are'} present"
            changes += [(+people(number)).because(counted), (+personDetected("Yes")).because(somebody)]
            self._alone = False
        elif not self._there and (
            self._alone is False or (self._alone is None and self._share(self._config.vanish_s) < 0.25)
        ):
            changes += [(+personDetected("No")).because(f"nobody is present: {self._shown('', self._config.vanish_s)}")]
            self._alone = True
            self._frames = deque([self._frames[-1]])  # a new arrival needs new frames
        changes += [*self._attend(), *self._stay(percept.stamp)]
        return changes or None

    def recall(self, engine: Engine) -> None:
        """Restore present and staying people from the beliefs of an earlier run."""
        self._lost_at = engine.clock.now()
        staying = {one.belief.args[0] for one in engine.beliefs if isinstance(one.belief, stays)}
        self._engaged = {str(one.belief.args[0]) for one in engine.beliefs if isinstance(one.belief, engages)}
        for one in engine.beliefs:
            if isinstance(one.belief, present):
                person = str(one.belief.args[0])
                due = one.since + nanoseconds(self._config.help_after_s)
                self._there[person] = None if person in staying else due
                self._changed[person] = self._lost_at
            elif isinstance(one.belief, gone):
                self._gone[str(one.belief.args[0])] = one.since
        if self._there:
            self._alone = False
        elif personDetected("No") in [one.belief for one in engine.beliefs]:
            self._alone = True

    def _lose_sight(self) -> Sensed:
        """Reset the sensor. People who are present afterwards count as the same."""
        if self._frames:
            self._lost_at = self._frames[-1].stamp
        somebody = self._alone is False
        if somebody:
            self._alone = None
        self._lost = tuple(self._there) or self._lost
        self._gone |= dict.fromkeys(self._there, self._lost_at)
        changes = [(+gone(person)).because("no more detections arrive") for person in self._there]
        for memory in (self._frames, self._there, self._changed, self._engaged):
            memory.clear()
        return [*changes, (+personDetected("Unknown")).because("no more detections arrive")] if somebody else None

    def _leave(self, now: int) -> Iterator[Event]:
        for person in [person for person in self._there if self._share(self._config.vanish_s, person) < 0.25]:
            why = self._shown(person, self._config.vanish_s)
            if self._there.pop(person) is None:
                yield (-stays(person)).because(why)
            if person in self._engaged:
                self._engaged.remove(person)
                yield (-engages(person)).because(why)
            self._changed[person] = self._gone[person] = now
            yield from ((-present(person)).because(why), (+gone(person)).because(why))

    def _stay(self, now: int) -> Iterator[Event]:
        for person, due in self._there.items():
            if due is not None and now >= due and self._share(self._config.appear_s, person) > 0:
                self._there[person] = None
                yield (+stays(person)).because(f"{person} has been present for {self._config.help_after_s:g} s")

    def _forget(self, now: int) -> Iterator[Event]:
        for person, left in list(self._gone.items()):
            # Without ids nobody can be recognized, so a shorter absence counts.
            absence_s = self._config.regreet_after_s if person == SOMEBODY else self._config.forget_after_s
            if not 0 <= now - left < nanoseconds(absence_s):
                del self._gone[person]
                why = f"{person} left at least {absence_s:g} s ago"
                yield from ((-gone(person)).because(why), (+forgotten(person)).because(why))

    def _come(self, now: int) -> Iterator[Event]:
        lost = [one for one in self._lost if one in self._gone] if self._alone is None else []
        for person in dict.fromkeys(person for frame in self._frames for person in frame.near):
            if person not in self._there and self._share(self._config.appear_s, person) >= 0.5:
                self._there[person] = now + nanoseconds(self._config.help_after_s)
                why = self._shown(person, self._config.appear_s)
                self._changed[person] = now
                yield (+present(person)).because(why)
                if self._gone.pop(person, None) is not None:
                    yield (-gone(person)).because(why)
                else:
                    same = f"{person} is the first in sight since detections arrive again; {{}} was there before"
                    yield from ((+returned(person, one)).because(same.format(one)) for one in lost)

    def _attend(self) -> Iterator[Event]:
        frames = self._recent(max(self._config.appear_s, _PATH_S))
        for person in self._there:
            looks = [look for frame in frames if (look := frame.near.get(person))]
            engaged, path = person in self._engaged, _path(frames, person)
            since = self._frames[-1].stamp - self._changed.get(person, 0)
            if not looks or (path is None and _has_path(looks[-1]) and since < nanoseconds(_DECIDE_S)):
                continue
            share = fmean(_is_attentive(look, path) for look in looks)
            why = f"{person} {_attention(looks[-1], path)} ({share:.0%} of {len(looks)} frames)".replace("%", " %")
            if not engaged and share >= 0.5:
                self._engaged.add(person)
                yield (+engages(person)).because(why)
            elif engaged and share < 0.25:
                self._engaged.remove(person)
                yield (-engages(person)).because(why)

    def _look(self, percept: PersonDetections) -> None:
        if self._frames and percept.stamp < self._frames[-1].stamp:
            # The clock was reset: another recording, or a changed system time.
            self._frames.clear()
            self._changed.clear()
            due = percept.stamp + nanoseconds(self._config.help_after_s)
            self._there = {person: until and due for person, until in self._there.items()}
        persons = [_in_base(person, percept.camera_yaw_rad) for person in percept.persons]
        near = [p for p in persons if p.distance_m is None or p.distance_m <= self._config.range_m]
        near.sort(key=lambda p: p.distance_m or math.inf, reverse=True)
        self._frames.append(Frame(percept.stamp, {p.track_id or SOMEBODY: p for p in near}, len(near)))
        oldest = percept.stamp - nanoseconds(max(self._config.vanish_s, self._config.appear_s))
        while len(self._frames) > 1 and self._frames[1].stamp <= oldest:
            self._frames.popleft()
        self._changed = {person: at for person, at in self._changed.items() if person in self._there or at >= oldest}

    def _recent(self, seconds: float) -> list[Frame]:
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        return [frame for frame in self._frames if frame.stamp >= begin]

    def _share(self, seconds: float, person: str = "") -> float:
        """The share of frames of the last ``seconds`` that show ``person`` (or anybody).

        NaN until the frames cover that time since ``person`` arrived or left.
        """
        begin = self._frames[-1].stamp - nanoseconds(seconds)
        if max(self._frames[0].stamp, self._changed.get(person, begin)) > begin:
            return math.nan
        return fmean(person in frame.near if person else bool(frame.near) for frame in self._recent(seconds))

    def _shown(self, person: str, seconds: float) -> str:
        """Describe the share of frames of the last ``seconds`` that show ``person`` (or anybody) within range."""
        recent = self._recent(seconds)
        count = sum(person in frame.near if person else bool(frame.near) for frame in recent)
        shown = f"{count} of {len(recent)} frames of the last {seconds:g} s"
        return f"{person or 'somebody'} was within {self._config.range_m:g} m in {shown}"

    def _company(self) -> int:
        """Return the median number of people in the recent frames with people."""
        return median_low(frame.persons for frame in self._recent(self._config.appear_s) if frame.persons)


def _in_base(person: PersonDetection, camera_yaw_rad: float | None) -> PersonDetection:
    """The person with the bearing from the robot's base, which does not turn with the head."""
    if person.bearing_rad is None or not camera_yaw_rad:
        return person
    return msgspec.structs.replace(person, bearing_rad=person.bearing_rad + camera_yaw_rad)


class _Path(NamedTuple):
    """How a person walks: speed, its part towards the robot, and the distance at which the path passes the robot."""

    speed_mps: float
    approach_mps: float
    passes_m: float


def _path(frames: Sequence[Frame], person: str) -> _Path | None:
    """Return the path of ``person`` in ``frames``; None if they show too little of it."""
    looks = [
        (frame.stamp, look.distance_m, look.bearing_rad)
        for frame in frames
        if (look := frame.near.get(person)) and look.distance_m is not None and look.bearing_rad is not None
    ]
    if not looks or looks[-1][0] - looks[0][0] < nanoseconds(_PATH_S) * 0.9:
        return None
    (begin, first_m, first_rad), (end, last_m, last_rad) = looks[0], looks[-1]
    seconds = (end - begin) / SECOND
    turn = math.remainder(last_rad - first_rad, math.tau)
    # In the frame of the last position: ahead towards the robot, and sideways.
    ahead, sideways = (first_m * math.cos(turn) - last_m) / seconds, first_m * math.sin(turn) / seconds
    speed = math.hypot(ahead, sideways)
    return _Path(speed, ahead, last_m * abs(sideways) / speed if speed else 0.0)


def _has_path(person: PersonDetection) -> bool:
    """Whether more frames will tell if a person comes nearer, which is not known otherwise."""
    return person.facing_rad is None and person.distance_m is not None and person.bearing_rad is not None


def _is_attentive(person: PersonDetection, path: _Path | None) -> bool:
    """Whether a person faces the robot, walks up to it, or stands before it without turning away."""
    if person.facing_rad is not None and not _FACES_RAD < person.facing_rad < _AWAY_RAD:
        return person.facing_rad <= _FACES_RAD
    if path is None:
        return person.approach_mps is None or person.approach_mps > -_WALKS_MPS
    if path.speed_mps < _WALKS_MPS:
        return True
    return path.approach_mps > 0 and path.passes_m <= _REACH_M


def _attention(person: PersonDetection, path: _Path | None) -> str:
    """Describe what `_is_attentive` judges by."""
    if person.facing_rad is not None and not _FACES_RAD < person.facing_rad < _AWAY_RAD:
        return "faces the robot" if person.facing_rad <= _FACES_RAD else "faces away from the robot"
    if path is None:
        known = person.approach_mps is not None
        return f"approaches at {person.approach_mps:.1f} m/s" if known else "does not turn away"
    if path.speed_mps < _WALKS_MPS:
        return "stands before the robot"
    walks = f"walks past the robot at {path.passes_m:.1f} m" if path.approach_mps > 0 else "walks away from the robot"
    return "walks up to the robot" if path.approach_mps > 0 and path.passes_m <= _REACH_M else walks


def waldo(name: str, clock: Clock, config: WaldoConfig, **connections: object) -> Engine:
    """Return the engine of Waldo; ``connections`` are its robot, trace sink and wake-up (see `Engine`)."""
    # 4. Start the engine
    engine = Engine(name, clock, **connections)  # type: ignore[arg-type]

    # 5. Define rules: event / condition >> [steps]
    Who, Other, N, _ = variables("Who Other N _")  # noqa: N806
    engine.add_rules(
        # Beliefs cause desires ...
        +personDetected("No") >> [DoNothing()],
        atomic(
            +engages(Who) / ungreeted(Who) >> [GreetPeople(), when(unoffered(Who), [OfferHelp()])],
            +engages(Who) / unoffered(Who) >> [OfferHelp()],
            +stays(Who) / (personDetected("Next") & unoffered(Who)) >> [OfferHelp()],
            +stays(Who) / personDetected("Yes") >> [+personDetected("Next")],
            +personDetected("Next") / unoffered(_) >> [OfferHelp()],
        ),
        ungreeted(Who) << (engages(Who) & ~greeted(Who)),
        unoffered(Who) << (engages(Who) & stays(Who) & ~offered(Who)),
        several() << (ungreeted(Who) & ungreeted(Other) & (Who != Other)),
        several() << (ungreeted(SOMEBODY) & people(N) & (N > 1)),
        # ... desires cause intentions ...
        DoNothing() >> [stayIdle()],
        GreetPeople() / several() >> [speak("greeting_several"), for_each(ungreeted(Who), [+greeted(Who)])],
        GreetPeople() >> [speak("greeting"), for_each(ungreeted(Who), [+greeted(Who)])],
        OfferHelp() >> [speak("offer"), for_each(present(Who) & ~offered(Who), [+offered(Who)])],
        # ... and a failed intention is not retried.
        -GreetPeople() >> [stayIdle()],
        -OfferHelp() >> [stayIdle()],
        # People who return after a while are greeted again.
        atomic(+forgotten(Who) >> [-greeted(Who), -offered(Who)]),
        # After a loss of detections Waldo waits. People present afterwards count as those present before.
        +personDetected("Unknown") >> [-stays(_), -engages(_), -present(_), -people(_), DoNothing()],
        atomic(+returned(Who, Other) >> [when(greeted(Other), [+greeted(Who)]), when(offered(Other), [+offered(Who)])]),
        personDetected("Yes").changed("Unknown") / greeted(_) >> [attend()],
        +personDetected("Unknown").held_for(lambda: config.forget_after_s) >> [-gone(_), -greeted(_), -offered(_)],
    )
    return engine


# 6. Run the engine: `nodes.WaldoNode` does in a graph, `engine.run()` in a separate program.
