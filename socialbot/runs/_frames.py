"""Frames for the report: turning points of a run, the worst frames, and scores over time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, islice
from typing import Any

from markupsafe import Markup

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import TraceRecord
from socialbot.runs.folder import RecordedRun
from socialbot.runs.pages import Chart, LabelledBox, Series, Still, part, spread, thumbnail
from socialbot.runs.run import RunView
from socialbot.vision.metrics.scores import Score, ScoredFrame

MAX_FRAMES = 8
MAX_SPEECH_FRAMES = 6
FRAMES_APART_S = 0.5
LOOKBACK_RECORDS = 500
WINDOW_S = 3.0
MAX_WORST = 4
WORST_APART_S, WORST_APART_SHARE = 1.5, 0.05
"""Least distance between two of the worst frames: seconds, and share of the run."""


@dataclass(frozen=True)
class Shot:
    """Detection record of a frame and the reason to show it."""

    detection: TraceRecord
    why: str


def turning_points(run: RunView) -> list[Shot]:
    """Return the frames that led to speech, and those with the first, the most and the last persons, by time."""
    candidates = (*islice(_before_speech(run), MAX_SPEECH_FRAMES), *_first_most_last(run))

    def are_near(one: Shot, other: Shot) -> bool:
        return abs(one.detection.stamp - other.detection.stamp) < FRAMES_APART_S * SECOND

    return sorted(spread(candidates, MAX_FRAMES, are_near), key=lambda shot: shot.detection.stamp)


def shot_at(run: RunView, stamp: int, why: str) -> list[Shot]:
    """Return the newest frame at ``stamp`` (ns), if there is one."""
    detection = _last_detection(run, stamp)
    return [] if detection is None else [Shot(detection, why)]


def stills(run: RunView, shots: Sequence[Shot]) -> Markup:
    """Return the images of ``shots`` with the detected persons; those without an image are left out."""
    return part("frames", [still for shot in shots if (still := _still(run, shot)) is not None])


@dataclass(frozen=True)
class Perception:
    """Detections of a run compared with the ground truth."""

    run: RecordedRun

    @cached_property
    def frames(self) -> list[ScoredFrame]:
        """Scored frames by time; none without ground truth."""
        return sorted(self.run.scored, key=lambda frame: frame.stamp)

    @cached_property
    def times_s(self) -> list[float]:
        return [self.run.history.seconds(frame.stamp) for frame in self.frames]

    def charts(self) -> list[Chart]:
        """Return charts of persons present and found, and of precision, recall and F1 over a sliding window."""
        if not self.frames:
            return []
        scores = [frame.score for frame in self.frames]
        marks = [(self.run.history.seconds(frame.stamp), self._caption(frame)) for frame in self.worst]
        people = (
            Series("present", self._timed([score.tp + score.fn for score in scores]), "soft"),
            Series("found", self._timed([score.tp for score in scores]), "good"),
            Series("false", self._timed([score.fp for score in scores]), "bad"),
        )
        rates = (
            Series("precision", self._timed([score.precision for score in self._windows]), 0),
            Series("recall", self._timed([score.recall for score in self._windows]), 1),
            Series("F1", self._timed([score.f1 for score in self._windows]), 2),
        )
        title = f"Precision, recall and F1 within {WINDOW_S:g} s"
        return [
            Chart("Persons present and found", people, marks=marks),
            Chart(title, rates, y_range=(0.0, 1.02), marks=marks),
        ]

    def worst_stills(self) -> Markup:
        """Return the images of the worst frames with persons found and missed and false detections."""
        found = [_still_of(self.run, frame.stamp, _scored(frame), self._caption(frame)) for frame in self.worst]
        return part("frames", [still for still in found if still is not None])

    @cached_property
    def worst(self) -> list[ScoredFrame]:
        """Frames with the most errors, apart from each other, by time."""
        around = [score.fp + score.fn for score in self._windows]
        ranked = sorted(
            (number for number, frame in enumerate(self.frames) if frame.errors),
            key=lambda number: (-self.frames[number].errors, -around[number], number),
        )
        apart_s = max(WORST_APART_S, WORST_APART_SHARE * self.run.history.duration_s)
        times_s = self.times_s
        chosen = spread(ranked, MAX_WORST, lambda one, other: abs(times_s[one] - times_s[other]) < apart_s)
        return [self.frames[number] for number in sorted(chosen)]

    @cached_property
    def _windows(self) -> list[Score]:
        sums = [*accumulate((frame.score for frame in self.frames), initial=Score())]
        stamps = [frame.stamp for frame in self.frames]
        half = nanoseconds(WINDOW_S / 2)
        windows = []
        for stamp in stamps:
            first, last = sums[bisect_left(stamps, stamp - half)], sums[bisect_right(stamps, stamp + half)]
            windows.append(Score(last.tp - first.tp, last.fp - first.fp, last.fn - first.fn))
        return windows

    def _timed(self, values: Sequence[float | None]) -> list[tuple[float, float | None]]:
        return list(zip(self.times_s, values, strict=True))

    def _caption(self, frame: ScoredFrame) -> str:
        missed = ", ".join(
            "?" if person.distance_m is None else f"{person.distance_m:.1f} m" for person in frame.missed
        )
        parts = [
            f"{len(frame.found)} found" if frame.found else "",
            f"{len(frame.missed)} missed ({missed})" if missed else "",
            f"{len(frame.false)} false" if frame.false else "",
        ]
        return f"{self.run.history.seconds(frame.stamp):.2f} s: {', '.join(filter(None, parts))}"


def _still(run: RunView, shot: Shot) -> Still | None:
    stamp = shot.detection.stamp
    boxes = [_detected(person) for person in shot.detection.detail.get("persons", ())]
    return _still_of(run, stamp, boxes, f"{run.history.seconds(stamp):.2f} s: {shot.why}")


def _still_of(run: RunView, stamp: int, boxes: Sequence[LabelledBox], caption: str) -> Still | None:
    picture = run.picture(stamp)
    return None if picture is None else thumbnail(picture.jpeg, boxes, caption)


def _first_most_last(run: RunView) -> Iterator[Shot]:
    seen = [record for record in run.history if record.kind == "detection" and record.detail.get("persons")]
    if seen:
        most = max(seen, key=lambda record: len(record.detail["persons"]))
        yield Shot(seen[0], "first person in view")
        if len(most.detail["persons"]) > 1:
            yield Shot(most, f"{len(most.detail['persons'])} persons, the most at once")
        yield Shot(seen[-1], "last person in view")


def _before_speech(run: RunView) -> Iterator[Shot]:
    for record in run.history:
        if record.kind == "utterance":
            frame = next((each for each in run.history.chain(record) if each.kind == "detection"), None)
            frame = frame or _last_detection(run, record.stamp)
            if frame is not None:
                yield Shot(frame, f"leads to “{record.what}”")


def _last_detection(run: RunView, stamp: int) -> TraceRecord | None:
    until = run.history.until(stamp)
    before = reversed(run.history.part(max(until - LOOKBACK_RECORDS, 0), until))
    return next((record for record in before if record.kind == "detection"), None)


def _detected(person: dict[str, Any]) -> LabelledBox:
    text = " ".join(filter(None, (str(person.get("track_id") or ""), _metres(person.get("distance_m")))))
    x, y, w, h = (float(person[side]) for side in "xywh")
    return LabelledBox(x, y, w, h, text)


def _scored(frame: ScoredFrame) -> list[LabelledBox]:
    return [
        LabelledBox(each.x, each.y, each.w, each.h, _metres(each.distance_m), kind)
        for people, kind in ((frame.found, "seen"), (frame.missed, "missed"), (frame.false, "false"))
        for each in people
    ]


def _metres(distance_m: float | None) -> str:
    return "" if distance_m is None else f"{distance_m:.1f} m"
