"""How well people were seen in the course of a run: curves, and the frames in which most went wrong."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import PersonDetection
from socialbot.runs.folder import RecordedRun
from socialbot.runs.report_curves import Curve, Plot
from socialbot.runs.report_frames import Box, figure
from socialbot.runs.report_lanes import Mark
from socialbot.runs.report_page import Section
from socialbot.vision.metrics.scores import Score, ScoredFrame
from socialbot.vision.metrics.truth import TruthPerson

WINDOW_S = 3.0
"""Rates are those of the frames that lie within so many seconds, half of them before and half after."""
WORST = 4
"""So many frames are shown, at most."""
APART_S, APART = 1.5, 0.05
"""They are apart by as many seconds, and by such a share of the run: those between show the same error."""

NOTE = (
    "The frames with the most errors, marked in the chart above. Green: found; yellow, dashed: missed; red: a box that "
    "fits nobody."
)


@dataclass(frozen=True)
class Sight:
    """What became of the people in the frames of ``run``, by the truth."""

    run: RecordedRun

    @cached_property
    def frames(self) -> list[ScoredFrame]:
        """The frames by time; none where the truth is not known."""
        return sorted(self.run.scored, key=lambda frame: frame.stamp)

    @cached_property
    def times_s(self) -> list[float]:
        """When they were taken, from the start."""
        return [self.run.history.seconds(frame.stamp) for frame in self.frames]

    def plots(self) -> list[Plot]:
        """How many people there were and how many were found; precision, recall and F1 over a sliding window."""
        if not self.frames:
            return []
        counts = [frame.score for frame in self.frames]
        people = [
            Curve("there", "there", self._timed([score.tp + score.fn for score in counts])),
            Curve("found", "found", self._timed([score.tp for score in counts])),
            Curve("false alarms", "false", self._timed([score.fp for score in counts])),
        ]
        rates = [
            Curve("precision", "precision", self._timed([score.precision for score in self._windows])),
            Curve("recall", "recall", self._timed([score.recall for score in self._windows])),
            Curve("F1", "f1", self._timed([score.f1 for score in self._windows])),
        ]
        most = max(1, *(max(score.tp + score.fn, score.fp) for score in counts))
        return [Plot("people", people, most), Plot(f"within {WINDOW_S:g} s", rates, 1.0)]

    def marks(self) -> list[Mark]:
        """The worst frames, as marks in a chart."""
        return [Mark(self.run.history.seconds(frame.stamp), self._caption(frame)) for frame in self.worst]

    def section(self) -> Section:
        """The worst frames, as far as there are pictures of them."""
        shown = []
        for frame in self.worst:
            picture = self.run.picture(frame.stamp)
            if picture is not None:
                shown.append(figure(picture, _boxes(frame), self._caption(frame)))
        content = f'<div class="frames">{"".join(shown)}</div>' if any(shown) else ""
        return Section("Where seeing went wrong", content, NOTE)

    @cached_property
    def worst(self) -> list[ScoredFrame]:
        """The frames with the most errors, no two of them close together, by time."""
        around = [score.fp + score.fn for score in self._windows]
        ranked = sorted(
            (number for number, frame in enumerate(self.frames) if frame.errors),
            key=lambda number: (-self.frames[number].errors, -around[number], number),
        )
        apart_s = max(APART_S, APART * self.run.history.duration_s)
        chosen: list[int] = []
        for number in ranked:
            near = (abs(self.times_s[number] - self.times_s[other]) < apart_s for other in chosen)
            if len(chosen) < WORST and not any(near):
                chosen.append(number)
        return [self.frames[number] for number in sorted(chosen)]

    @cached_property
    def _windows(self) -> list[Score]:
        """For each frame the counts of those around it."""
        sums = [*accumulate((frame.score for frame in self.frames), initial=Score())]
        stamps = [frame.stamp for frame in self.frames]
        half = nanoseconds(WINDOW_S / 2)
        windows = []
        for stamp in stamps:
            first = sums[bisect_left(stamps, stamp - half)]
            last = sums[bisect_right(stamps, stamp + half)]
            windows.append(Score(last.tp - first.tp, last.fp - first.fp, last.fn - first.fn))
        return windows

    def _timed(self, values: Sequence[float | None]) -> list[tuple[float, float | None]]:
        return list(zip(self.times_s, values, strict=True))

    def _caption(self, frame: ScoredFrame) -> str:
        missed = ", ".join(f"{person.distance_m:.1f} m" for person in frame.missed)
        told = [
            f"{len(frame.found)} found" if frame.found else "",
            f"{len(frame.missed)} missed ({missed})" if missed else "",
            f"{len(frame.false)} false" if frame.false else "",
        ]
        return f"{self.run.history.seconds(frame.stamp):.2f} s: {', '.join(filter(None, told))}"


def _boxes(frame: ScoredFrame) -> list[Box]:
    people = [(person, "seen") for person in frame.found] + [(person, "missed") for person in frame.missed]
    return [_box(person, kind) for person, kind in (*people, *((each, "false") for each in frame.false))]


def _box(person: TruthPerson | PersonDetection, kind: str) -> Box:
    distance = "" if person.distance_m is None else f"{person.distance_m:.1f} m"
    return Box(person.x, person.y, person.w, person.h, distance, kind)
