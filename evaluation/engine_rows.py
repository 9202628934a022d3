"""Rows of the benchmark table, and workloads that consist of such rows.

A `Row` does one job with the engine and with a hand-written loop. `measurement` runs several rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from evaluation.engine_workloads import Figures, Pass, Scale, compared, take_turns


@dataclass(frozen=True)
class Line:
    """Table line: the compared figure, its requirement, and the rates behind it.

    ``required`` and ``aim`` are lower limits or, with ``at_most``, upper limits. ``rate`` and ``hand`` are the keys of
    the rates of the engine and of the hand-written loop.
    """

    workload: str
    key: str
    text: str
    required: float | None = None
    aim: float | None = None
    at_most: bool = False
    rate: str | None = None
    hand: str | None = None

    def verdict(self, value: object) -> str:
        """Return ``ok`` if the requirement is met, ``aim`` if the aim is met, else ``below`` or ``above``."""
        if self.required is None or not isinstance(value, (int, float)):
            return ""
        if not self._reached(value, self.required):
            return "above" if self.at_most else "below"
        return "aim" if self.aim is not None and self._reached(value, self.aim) else "ok"

    def _reached(self, value: float, limit: float) -> bool:
        return value <= limit if self.at_most else value >= limit


def ratio_line(workload: str, text: str, name: object, required: float | None = None, aim: float | None = None) -> Line:
    """Return the line of a ratio to the hand-written loop."""
    return Line(workload, f"ratio_{name}", text, required, aim, rate=f"engine_rate_{name}", hand=f"hand_rate_{name}")


@dataclass(frozen=True)
class Job:
    """Job of ``units`` of work as a pass of the engine and a pass of the hand-written loop; both check their result."""

    units: int
    engine: Pass
    hand: Pass


@dataclass(frozen=True)
class Row:
    """Table row of a job: the rate of the engine as a ratio to that of the hand-written loop.

    With ``flat``, the name of another row, the engine must also reach ``least_share`` of its rate in that row.
    """

    name: str
    text: str
    job: Callable[[Scale], Job]
    required: float | None = None
    aim: float | None = None
    flat: str | None = None
    least_share: float = 0.8


def measurement(rows: Sequence[Row]) -> Callable[[Scale], Figures]:
    """Return the measurement of several rows."""

    def measure(scale: Scale) -> Figures:
        figures: Figures = {}
        for row in rows:
            job = row.job(scale)
            contenders = {f"engine_{row.name}": job.engine, f"hand_{row.name}": job.hand}
            figures |= compared(take_turns(contenders, job.units, scale.passes), row.name)
        for row in rows:
            if row.flat is not None:
                few = figures[f"engine_rate_{row.flat}"]
                many = figures[f"engine_rate_{row.name}"]
                assert isinstance(few, float)
                assert isinstance(many, float)
                figures[f"share_{row.name}"] = many / few
        return figures

    return measure


def row_lines(name: str, rows: Sequence[Row]) -> list[Line]:
    """Return the lines of a workload that consists of rows."""
    lines: list[Line] = []
    texts = {row.name: row.text for row in rows}
    for row in rows:
        lines.append(ratio_line(name, row.text, row.name, row.required, row.aim))
        if row.flat is not None:
            text = f"rate as a share of that with {texts[row.flat]}"
            lines.append(Line(name, f"share_{row.name}", text, row.least_share))
    return lines
