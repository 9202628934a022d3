"""Visits of a run: who came, how near, what was said to them, and whether anybody was left without a word.

The people come from the ground truth of the bag where there is one, else from the tracks of the detector. The rule is
independent of the agents: a visitor who engages (`socialbot.vision.metrics.behaviour`) is due to be addressed. They are
addressed ``in time`` up to `ADDRESS_S` before or after that, then ``late`` until `RECENT_S` after the visit, or
``missed``. A sentence from longer before counts only if no other one follows: it may have been for somebody else.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import msgspec

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.distances import ranges_of
from socialbot.runs.folder import RecordedRun
from socialbot.runs.history import History
from socialbot.runs.pages import Cell, Table
from socialbot.runs.record import WELL
from socialbot.runs.state import persons_of
from socialbot.vision.metrics.behaviour import FACES_RAD, RECENT_S, PersonVisit, answer_to, visits
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.truth import GroundTruth, Person, TruthPerson, load_truth, truth_beside

ADDRESS_S = 2.0
"""Time within which a visitor is addressed: an answer later than 2 s is felt as a pause (human-robot dialogue)."""
GAP_S = 3.0
"""A shorter absence does not end a visit."""
RANGE_M = 3.7
"""Outer limit of social distance (Hall, 1966), for runs whose agents state no ``range_m``."""

SOURCES = {"truth": "the ground truth of the bag", "tracks": "the tracks of the detector"}
"""Sources of the people, in words."""

Outcome = Literal["in time", "late", "missed", "not due"]

_STYLES = {"in time": "good", "late": "bad", "missed": "bad"}


class Said(msgspec.Struct, frozen=True):
    """Sentence to the people present at ``at_s``, in seconds of the run, and the action that asked for it, if known."""

    at_s: float
    text: str
    action: str = ""


class Visit(msgspec.Struct, frozen=True, kw_only=True):
    """Visit of a person within the range; times in seconds of the run, frames counted from 1.

    ``faced_s`` is the first time at which they faced the robot, where faces are known. ``engaged_s`` is the begin of
    facing the robot, standing before it or walking up to it. None if they never did.
    ``delay_s`` is the time from then to the sentence that answers them.
    """

    person: str
    came_s: float
    came_frame: int
    left_s: float
    left_frame: int
    nearest_m: float | None
    nearest_s: float | None
    faced_s: float | None = None
    engaged_s: float | None
    said: tuple[Said, ...]
    outcome: Outcome
    delay_s: float | None = None


def visits_of(run: RecordedRun, range_m: float | None = None) -> tuple[list[Visit], Literal["truth", "tracks"]]:
    """Return the visits of a run in order of arrival, and the source of the people.

    Args:
        run: The recorded run.
        range_m: Distance up to which a person visits; by default the smallest ``range_m`` of an agent, or `RANGE_M`.

    Raises:
        TruthError: The ground truth beside the bag is unreadable.
    """
    truth = _truth(run)
    frames = _tracked(run.history) if truth is None else _true(truth, _end(run))
    limit_m = min((each.range_m for each in ranges_of(run)), default=RANGE_M) if range_m is None else range_m
    spoken = [record for record in run.history if record.kind == "utterance"]
    found = [_visit(each, frames, spoken, run.history) for each in visits(frames, limit_m, GAP_S)]
    return found, "tracks" if truth is None else "truth"


def visit_table(found: Sequence[Visit]) -> Table:
    """Return visits as a table, with times, distances, sentences and outcomes."""
    rows: list[list[Cell]] = [
        [
            visit.person,
            (f"{visit.came_s:.1f} s, frame {visit.came_frame}", "r"),
            ("" if visit.nearest_m is None else f"{visit.nearest_m:.1f} m at {visit.nearest_s:.1f} s", "r"),
            ("" if visit.faced_s is None else f"{visit.faced_s:.1f} s", "r"),
            ("" if visit.engaged_s is None else f"{visit.engaged_s:.1f} s", "r"),
            "; ".join(f"{said.at_s:.1f} s “{said.text}”" for said in visit.said),
            (f"{visit.left_s:.1f} s, frame {visit.left_frame}", "r"),
            (
                visit.outcome if visit.delay_s is None else f"{visit.outcome}, after {visit.delay_s:.1f} s",
                _STYLES.get(visit.outcome, ""),
            ),
        ]
        for visit in found
    ]
    return Table(("visitor", "came", "nearest", "faced", "engaged", "heard", "left", "addressed"), rows)


def _truth(run: RecordedRun) -> GroundTruth | None:
    path = run.results.get("bag", {}).get("path")
    found = truth_beside(Path(path)) if path else None
    return load_truth(found) if found is not None and os.path.isfile(found) else None


def _true(truth: GroundTruth, end: float) -> list[LabelledFrame]:
    return [LabelledFrame(frame.stamp, "", 0, frame.persons) for frame in truth.frames if frame.stamp <= end]


def _end(run: RecordedRun) -> float:
    """Stamp (ns) of the end of a run that ended before its bag did."""
    return math.inf if (run.results.get("ended") or WELL) == WELL else run.history.end


def _tracked(history: History) -> list[LabelledFrame]:
    detections = (record for record in history if record.kind == "detection")
    return [LabelledFrame(each.stamp, "", 0, tuple(_people(each))) for each in detections]


def _people(record: TraceRecord) -> Iterator[Person]:
    """Yield the tracked people of a frame; predicted boxes count as seen."""
    for person in persons_of(record):
        if person.track_id:
            yield TruthPerson(
                id=person.track_id, x=person.x, y=person.y, w=person.w, h=person.h,
                distance_m=None if person.distance_m is None else max(person.distance_m, 0.0),
                facing_rad=None if person.facing_rad is None else min(person.facing_rad, 3.15),
            )  # fmt: skip


def _visit(
    visit: PersonVisit, frames: Sequence[LabelledFrame], spoken: Sequence[TraceRecord], history: History
) -> Visit:
    stamps = [frame.stamp for frame in frames]
    looks = [
        (person, frame.stamp)
        for frame in frames
        if visit.begin <= frame.stamp <= visit.end
        for person in frame.persons
        if person.id == visit.person
    ]
    distances = [(person.distance_m, stamp) for person, stamp in looks if person.distance_m is not None]
    nearest_m, nearest = min(distances, default=(None, None))
    faced = next((stamp for person, stamp in looks if _faces(person)), None)
    heard = [each for each in spoken if visit.begin <= each.stamp <= visit.end + nanoseconds(RECENT_S)]
    outcome, delay_s = _outcome(visit, [each.stamp for each in heard])
    return Visit(
        person=visit.person,
        came_s=history.seconds(visit.begin),
        came_frame=stamps.index(visit.begin) + 1,
        left_s=history.seconds(visit.end),
        left_frame=stamps.index(visit.end) + 1,
        nearest_m=nearest_m,
        nearest_s=None if nearest is None else history.seconds(nearest),
        faced_s=None if faced is None else history.seconds(faced),
        engaged_s=None if visit.engages is None else history.seconds(visit.engages),
        said=tuple(Said(history.seconds(each.stamp), each.what, _action(history, each)) for each in heard),
        outcome=outcome,
        delay_s=delay_s,
    )


def _faces(person: Person) -> bool:
    facing_rad = person.facing_rad if isinstance(person, TruthPerson) else None
    return facing_rad is not None and facing_rad <= FACES_RAD


def _action(history: History, sentence: TraceRecord) -> str:
    return next((each.what for each in history.before(sentence) if each.kind in ("action", "step")), "")


def _outcome(visit: PersonVisit, heard: Sequence[int]) -> tuple[Outcome, float | None]:
    if visit.engages is None:
        return "not due", None
    answer = answer_to(visit.engages, heard, ADDRESS_S)
    if answer is None:
        return "missed", None
    delay_s = max(0.0, (answer - visit.engages) / SECOND)
    return ("in time" if delay_s <= ADDRESS_S else "late"), delay_s
