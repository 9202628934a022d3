"""Results of a sweep: many settings of a graph on the same bags, with their decisions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import fmean

import msgspec

from socialbot.runs.difference import decision_digest
from socialbot.runs.folder import RecordedRun
from socialbot.runs.visits import RANGE_M, visits_of

MEASURES: Mapping[str, str] = {
    "missed": "visitors who engaged and were not addressed",
    "late": "visitors who were addressed late",
    "said": "sentences",
    "actions": "actions",
    "first_said_s": "time of the first sentence, s",
}
"""Figures of a run by name. Visits count up to the same distance in all settings. Less is better."""


class Axis(msgspec.Struct, frozen=True):
    """Parameter of a sweep: its name and values as on the command line, in order."""

    name: str
    values: tuple[str, ...]


class SweepVerdict(msgspec.Struct, frozen=True):
    """Result of one expectation on one run."""

    name: str
    passed: bool
    reason: str = ""


class BagResult(msgspec.Struct, frozen=True, kw_only=True):
    """Run of one setting on one bag. ``digest`` is equal for equal decisions at equal times."""

    bag: str
    digest: str = ""
    measures: dict[str, float | None] = {}
    verdicts: tuple[SweepVerdict, ...] = ()
    error: str = ""

    @property
    def passed(self) -> bool:
        return not self.error and all(verdict.passed for verdict in self.verdicts)


class SweepCell(msgspec.Struct, frozen=True):
    """Setting with its results by bag, in the order of the bags. ``values`` are those of the axes."""

    number: int
    values: tuple[str, ...]
    results: tuple[BagResult, ...]

    @property
    def passed(self) -> bool:
        return all(result.passed for result in self.results)

    @property
    def digests(self) -> tuple[str, ...]:
        return tuple(result.digest for result in self.results)

    def share(self) -> float:
        """Share of the expectations that hold; of the runs without an error, if there are no expectations."""
        held = [verdict.passed for result in self.results for verdict in result.verdicts]
        held += [False for result in self.results if result.error]
        return fmean(held) if held else 1.0

    def failures(self) -> list[str]:
        """Names of the expectations that fail, with the bag."""
        failed = [f"{one.bag}: {each.name}" for one in self.results for each in one.verdicts if not each.passed]
        return failed + [f"{one.bag}: {one.error}" for one in self.results if one.error]

    def measure(self, name: str) -> float | None:
        """Sum over the bags; the mean of times, without bags that have none."""
        found = [value for one in self.results if (value := one.measures.get(name)) is not None]
        if not found:
            return None
        return fmean(found) if name.endswith("_s") else sum(found)


class Threshold(msgspec.Struct, frozen=True):
    """Values between which the outcome flips, for the other ``values``; None if it does not flip."""

    values: tuple[str, ...]
    below: str | None
    above: str | None
    outcome_below: str = ""
    outcome_above: str = ""


class Sweep(msgspec.Struct, frozen=True, kw_only=True):
    """All results of a sweep."""

    graph: str
    bags: tuple[str, ...]
    axes: tuple[Axis, ...]
    expectations: str = ""
    cells: tuple[SweepCell, ...] = ()
    thresholds: tuple[Threshold, ...] = ()

    @property
    def varied(self) -> tuple[int, ...]:
        """Indices of the axes with several values."""
        return tuple(
            number for number in range(len(self.axes)) if len({cell.values[number] for cell in self.cells}) > 1
        )

    @property
    def fixed(self) -> dict[str, str]:
        """Values of the axes with one value, by name."""
        return {axis.name: axis.values[0] for number, axis in enumerate(self.axes) if number not in self.varied}

    def changes(self, cell: SweepCell) -> list[str]:
        """The changes of a cell as for ``--set``."""
        return [f"{axis.name}={value}" for axis, value in zip(self.axes, cell.values, strict=True)]

    def label(self, cell: SweepCell) -> str:
        """The varied values of a cell."""
        varied = self.varied or range(len(self.axes))
        return ", ".join(f"{self.axes[number].name.rpartition('.')[2]}={cell.values[number]}" for number in varied)

    def pareto(self, measures: Sequence[str]) -> list[SweepCell]:
        """Cells that pass and are not worse than another passing cell in all ``measures``, less being better."""
        good = [cell for cell in self.cells if cell.passed]
        points = {cell.number: _point(cell, measures) for cell in good}
        return [
            cell
            for cell in good
            if not any(_dominates(points[other.number], points[cell.number]) for other in good if other is not cell)
        ]

    def pair(self) -> tuple[SweepCell, SweepCell] | None:
        """Two neighbours to compare: one passes and one fails, or else they decide differently; None if all agree."""
        for differ in (lambda a, b: a.passed != b.passed, lambda a, b: a.digests != b.digests):
            pairs = [(a, b) for a in self.cells for b in self.cells if a.number < b.number and differ(a, b)]
            if pairs:
                return min(pairs, key=lambda pair: (self._steps(*pair), pair[0].number, pair[1].number))
        return None

    def _steps(self, one: SweepCell, other: SweepCell) -> int:
        """Distance of two cells in steps of the axes."""
        total = 0
        for number in range(len(self.axes)):
            order = sorted({cell.values[number] for cell in self.cells}, key=in_order)
            total += abs(order.index(one.values[number]) - order.index(other.values[number]))
        return total


def in_order(value: str) -> tuple[int, float, str]:
    """Sort key of values: numbers by size, then texts."""
    try:
        return 0, float(value), ""
    except ValueError:
        return 1, 0.0, value


def measured(run: RecordedRun, bag: str, verdicts: Iterable[SweepVerdict] = ()) -> BagResult:
    """Return the result of a recorded run."""
    said = [record for record in run.history if record.kind == "utterance"]
    visits, _ = visits_of(run, RANGE_M)
    outcomes = [visit.outcome for visit in visits]
    figures: dict[str, float | None] = {
        "missed": outcomes.count("missed"),
        "late": outcomes.count("late"),
        "said": len(said),
        "actions": sum(record.kind == "action" for record in run.history),
        "first_said_s": round(run.history.seconds(said[0].stamp), 3) if said else None,
    }
    return BagResult(bag=bag, digest=decision_digest(run), measures=figures, verdicts=tuple(verdicts))


def _point(cell: SweepCell, measures: Sequence[str]) -> tuple[float, ...]:
    values = (cell.measure(name) for name in measures)
    return tuple(float("inf") if value is None else value for value in values)


def _dominates(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))


def summary_rows(sweep: Sweep) -> Iterator[tuple[SweepCell, list[str]]]:
    """Yield each cell with its texts for a table: values, outcome and measures."""
    for cell in sweep.cells:
        outcome = "passes" if cell.passed else f"{len(cell.failures())} fail"
        figures = [cell.measure(name) for name in MEASURES]
        texts = ["" if each is None else f"{each:.2f}".rstrip("0").rstrip(".") for each in figures]
        yield cell, [*(cell.values[number] for number in sweep.varied), outcome, *texts]
