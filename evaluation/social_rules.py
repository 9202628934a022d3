"""Rules by which `evaluation.social` scores a robot from the ground truth, independent of the robot's beliefs.

A visitor is a person who comes for the robot (aim ``visit`` or ``help``). The visit begins when they are inside and
within `NEAR_M` on their way to the robot, and ends when they turn to leave. A conversation is two people who talk to
each other. An audience are the people in front of the robot who could take a sentence for themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from socialbot.robots.simulation.people import Crowd, Episode, Motion

NEAR_M = 5.0
IN_TIME_S = 2.0
"""A greeting is in time until so long after the arrival at the robot."""
HEARD_M, HEARD_RAD = 5.0, 1.2
"""People hear the robot up to this distance, and this far from where its head points."""
STARE_RAD, STARE_S = 0.17, 3.0
"""The robot stares at a person without interest in it after looking there for so long."""
LONGEST_S, MOST_JERK = 20.0, 60.0
"""Time to offer, and jerk of the head (rad/s^3), that count as 0 points."""


class Said(NamedTuple):
    """A sentence: time (s), its key, and where the head pointed (rad)."""

    time: float
    key: str
    pan_rad: float


@dataclass(frozen=True)
class Visit:
    """A visit to the robot: times (s) of its begin, of the arrival and of the end."""

    person: str
    begin: float
    arrival: float
    end: float
    wants_help: bool


@dataclass
class Score:
    """Counts of one or many schedules."""

    visits: int = 0
    in_time: int = 0
    twice: int = 0
    missed: int = 0
    conversations: int = 0
    interrupted: int = 0
    stared_s: float = 0.0
    idle_s: float = 0.0
    passers: int = 0
    helped_passers: int = 0
    to_nobody: int = 0
    offers_s: list[float] = field(default_factory=list)
    jerks: list[float] = field(default_factory=list)

    def add(self, other: Score) -> None:
        """Add the counts of another schedule."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def criteria(self) -> dict[str, float]:
        """Return the eight criteria; the first is better when higher, all others when lower.

        Shares are in % of visits, conversations, time without visitors, and people who walk past.
        """

        def percent(part: float, whole: float) -> float:
            return 100.0 * part / whole if whole else 0.0

        return {
            "greeted in time, %": percent(self.in_time, self.visits),
            "greeted twice, %": percent(self.twice, self.visits),
            "interrupted, %": percent(self.interrupted, self.conversations),
            "stared, % of time": percent(self.stared_s, self.idle_s),
            "missed, %": percent(self.missed, self.visits),
            "helped a passer-by, %": percent(self.helped_passers, self.passers),
            "time to offer, s": float(np.mean(self.offers_s)) if self.offers_s else 0.0,
            "head jerk, rad/s3": float(np.sqrt(np.mean(np.square(self.jerks)))) if self.jerks else 0.0,
        }

    def points(self) -> float:
        """Return the overall score: the mean of the eight criteria, each from 0 (worst) to 100."""
        greeted, *shares, offer, jerk = self.criteria().values()
        points = [greeted, *(max(100.0 - share, 0.0) for share in shares)]
        points += [100.0 * max(1 - offer / LONGEST_S, 0.0), 100.0 * max(1 - jerk / MOST_JERK, 0.0)]
        return sum(points) / len(points)


def visits_of(crowd: Crowd, until: float) -> list[Visit]:
    """Return the visits that begin well before ``until`` (s)."""
    found = []
    for name, motion in crowd.motions.items():
        coming = next((one for one in motion.episodes if one.activity == "walk" and one.aim in ("visit", "help")), None)
        if coming is None:
            continue
        staying = next(one for one in motion.episodes if one.begin >= coming.end and one.activity == "stand")
        begin = next((t for t in _times(coming.begin, staying.end) if _distance(motion, t) <= NEAR_M), staying.begin)
        end = min(staying.end, until)
        if begin < until - 5.0 and end > begin:
            found.append(Visit(name, max(begin, 0.0), staying.begin, end, coming.aim == "help"))
    return [visit for visit in found if visit.arrival + IN_TIME_S < until]


def score(crowd: Crowd, said: Sequence[Said], head: np.ndarray, until: float) -> Score:
    """Score one schedule.

    Args:
        crowd: People, and what they do.
        said: Sentences of the robot, in order.
        head: Rows of time (s), pan (rad) and speed of pan (rad/s), evenly spaced.
        until: End of the schedule, s.
    """
    result, visits = Score(), visits_of(crowd, until)
    talks = list(_conversations(crowd, until))
    result.visits, result.conversations = len(visits), len(talks)
    result.passers = sum(_is_passer(motion, until) for motion in crowd.motions.values())
    greeted: set[str] = set()
    disturbed: set[tuple[str, str]] = set()
    helped: set[str] = set()
    offered: dict[str, float] = {}
    for one in said:
        hearers = [
            visit for visit in visits if visit.begin <= one.time <= visit.end and _hears(crowd, visit.person, one)
        ]
        if one.key.startswith("greeting"):
            fresh = [visit for visit in hearers if visit.person not in greeted]
            result.twice += bool(hearers and not fresh)
            greeted.update(visit.person for visit in fresh)
            result.in_time += sum(one.time <= visit.arrival + IN_TIME_S for visit in fresh)
        else:
            for visit in hearers:
                offered.setdefault(visit.person, one.time)
        if hearers:
            continue
        pairs = {pair for begin, end, pair in talks if begin <= one.time <= end and _any_hears(crowd, pair, one)}
        disturbed |= pairs
        walkers = {
            name
            for name, motion in crowd.motions.items()
            if one.key == "offer" and _is_passing(motion.episode(one.time)) and _hears(crowd, name, one)
        }
        helped |= walkers
        result.to_nobody += not (pairs or walkers)
    result.interrupted, result.helped_passers = len(disturbed), len(helped)
    result.missed = sum(visit.person not in greeted for visit in visits)
    for visit in visits:
        if visit.wants_help:
            waited = offered.get(visit.person, visit.end) - visit.arrival
            result.offers_s.append(min(max(waited, 0.0), LONGEST_S))
    _watch(result, crowd, visits, head)
    return result


def _times(begin: float, end: float) -> Iterator[float]:
    return (begin + 0.1 * step for step in range(int((end - begin) / 0.1) + 1))


def _distance(motion: Motion, time: float) -> float:
    at = motion.where(time)
    return math.inf if at is None else math.hypot(*at)


def _hears(crowd: Crowd, person: str, one: Said) -> bool:
    at = crowd.motions[person].where(one.time)
    if at is None or math.hypot(*at) > HEARD_M:
        return False
    return abs(math.remainder(math.atan2(at[1], at[0]) - one.pan_rad, math.tau)) <= HEARD_RAD


def _any_hears(crowd: Crowd, people: Sequence[str], one: Said) -> bool:
    return any(_hears(crowd, person, one) for person in people)


def _conversations(crowd: Crowd, until: float) -> Iterator[tuple[float, float, tuple[str, str]]]:
    """Times in which two people talk to each other within earshot of the robot."""
    for name, motion in crowd.motions.items():
        for one in motion.episodes:
            other = crowd.motions.get(one.partner)
            if one.activity != "talk" or other is None or name > one.partner:
                continue
            back = next((each for each in other.episodes if each.activity == "talk" and each.partner == name), None)
            if back is None:
                continue
            begin, end = max(one.begin, back.begin, 0.0), min(one.end, back.end, until)
            if end > begin and min(_distance(motion, begin), _distance(other, begin)) <= HEARD_M:
                yield begin, end, (name, one.partner)


def _is_passing(episode: Episode | None) -> bool:
    return episode is not None and episode.aim in ("pass", "rest")


def _is_passer(motion: Motion, until: float) -> bool:
    times = (t for one in motion.episodes if _is_passing(one) for t in _times(max(one.begin, 0.0), min(one.end, until)))
    return any(_distance(motion, time) <= HEARD_M for time in times)


def _watch(result: Score, crowd: Crowd, visits: Sequence[Visit], head: np.ndarray) -> None:
    """Count the time of stares while nobody visits, and the jerk of the head."""
    if len(head) < 3:
        return
    step = float(head[1, 0] - head[0, 0])
    looked: dict[str, float] = {}
    for time, pan, _ in head:
        if any(visit.begin <= time <= visit.end for visit in visits):
            looked.clear()
            continue
        stances = crowd.at(time)
        others = {name: s for name, s in stances.items() if math.hypot(s.x, s.y) <= NEAR_M + 1.5}
        if not others:
            looked.clear()
            continue
        result.idle_s += step
        now: dict[str, float] = {}
        for name, stance in others.items():
            aside = abs(math.remainder(math.atan2(stance.y, stance.x) - pan, math.tau))
            if aside <= STARE_RAD:
                now[name] = looked.get(name, 0.0) + step
        result.stared_s += step * any(seconds > STARE_S for seconds in now.values())
        looked = now
    jerk = np.diff(head[:, 2], 2) / step**2
    result.jerks.append(float(np.sqrt(np.mean(jerk**2))))


def totals(scores: Mapping[str, Sequence[Score]]) -> dict[str, Score]:
    """Add up the scores of each policy."""
    found = {}
    for name, some in scores.items():
        found[name] = Score()
        for one in some:
            found[name].add(one)
    return found
