"""Tables of the hospital benchmark: results by cell, Figures 7 to 11 and Table 3 in numbers.

A table maps each row name to its values, for `evaluation.report`.
"""

from __future__ import annotations

import csv
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from evaluation.hospital_paper import PREDECESSOR, RUNS, TABLE_3, PastCell
from evaluation.hospital_record import CONFIGURATIONS, Configuration, MissionRecord, Share
from evaluation.hospital_statistics import Interval, Line, binomial, fit, mean_interval, weighted, wilson
from evaluation.report import Value, percentile

Rows = dict[str, dict[str, Value]]

WITHOUT: Configuration = "bdi"
WITH: Configuration = "bdi+recovery"
RECOVERY: tuple[tuple[Configuration, str], ...] = ((WITH, "with"), (WITHOUT, "without"))
"""With BDI, with and without recovery."""


@dataclass(frozen=True)
class Cell:
    """Missions of one configuration and rate on one runner; at least one."""

    configuration: Configuration
    rate: float
    runner: str
    records: tuple[MissionRecord, ...]

    @property
    def runs(self) -> int:
        return len(self.records)

    @cached_property
    def drawn(self) -> int:
        """Number of missions with a drawn problem."""
        return sum(record.drawn for record in self.records)

    @cached_property
    def met(self) -> int:
        """Number of missions with a reported problem."""
        return sum(record.met for record in self.records)

    @cached_property
    def completed(self) -> int:
        return sum(record.completed for record in self.records)

    @cached_property
    def seconds(self) -> tuple[float, ...]:
        """Duration of each mission, s."""
        return tuple(record.mission_s for record in self.records)

    @cached_property
    def mean_s(self) -> float:
        """Mean duration, s."""
        return statistics.fmean(self.seconds)


def cells(records: Iterable[MissionRecord]) -> list[Cell]:
    """Group the missions by runner, configuration and rate, in this order."""
    found: dict[tuple[str, int, float], list[MissionRecord]] = {}
    for record in records:
        key = (record.runner, CONFIGURATIONS.index(record.configuration), record.rate)
        found.setdefault(key, []).append(record)
    return [
        Cell(CONFIGURATIONS[number], rate, runner, tuple(some))
        for (runner, number, rate), some in sorted(found.items(), key=lambda each: each[0])
    ]


class Experiments:
    """All missions by cell."""

    def __init__(self, records: Iterable[MissionRecord]) -> None:
        self.cells = cells(records)

    def of(self, runner: str, configuration: Configuration | None = None) -> list[Cell]:
        """Return the cells of a runner and, if given, of a configuration, by rate."""
        return [
            cell
            for cell in self.cells
            if cell.runner == runner and (configuration is None or cell.configuration == configuration)
        ]

    def at(self, runner: str, configuration: Configuration, rate: float) -> Cell | None:
        return next((cell for cell in self.of(runner, configuration) if cell.rate == rate), None)

    def records(self, runner: str, configuration: Configuration) -> list[MissionRecord]:
        return [record for cell in self.of(runner, configuration) for record in cell.records]

    def drawn_share(self, rate: float) -> float:
        """Return the share of simulated missions with a drawn problem; the rate without any."""
        cell = self.at("inline", WITH, rate)
        return cell.drawn / cell.runs if cell is not None else rate / 100.0

    def ros_s(self, configuration: Configuration, rate: float) -> float | None:
        """Return the expected duration over ROS, s, weighted by the share of missions with a problem.

        None if the few missions of a cell over ROS lack either kind.
        """
        records = self.records("ros", configuration)
        with_ = [record.mission_s for record in records if record.met]
        without = [record.mission_s for record in records if not record.met]
        return weighted(without, with_, self.drawn_share(rate)) if with_ and without else None

    @property
    def rates(self) -> list[float]:
        return sorted({cell.rate for cell in self.cells})


def percent(count: float, of: int) -> float:
    """Return a share in %."""
    return round(100.0 * count / of, 1)


def _range(interval: Interval | None, scale: float = 1.0, digits: int = 1) -> str | None:
    if interval is None:
        return None
    return f"{interval.low * scale:.{digits}f} to {interval.high * scale:.{digits}f}"


def cell_rows(found: Sequence[Cell]) -> Rows:
    """Return the results of each cell."""
    return {f"{cell.configuration} {cell.rate:g} %": _cell_row(cell) for cell in found}


def _cell_row(cell: Cell) -> dict[str, Value]:
    done = wilson(cell.completed, cell.runs)
    return {
        "runs": cell.runs,
        "drawn": cell.drawn,
        "met": cell.met,
        "completed": cell.completed,
        "Wilson %": _range(done, 100.0),
        "mission s": round(cell.mean_s, 3),
        "95 %": _range(mean_interval(cell.seconds), digits=2),
        "wall s": round(statistics.fmean(record.wall_s for record in cell.records), 3),
        "recoveries": sum(record.recoveries for record in cell.records),
        "plans": sum(record.plans for record in cell.records),
        "actions": sum(record.actions for record in cell.records),
    }


def figure_7(experiments: Experiments) -> Rows:
    """Share of missions with a problem, %."""
    rows: Rows = {}
    for cell in experiments.of("inline", WITH):
        expected = binomial(cell.rate / 100.0, cell.runs)
        rows[f"{cell.rate:g} %"] = {
            "met %": percent(cell.met, cell.runs),
            "Wilson 95 %": _range(wilson(cell.met, cell.runs), 100.0),
            "met": cell.met,
            "to be expected": f"{expected.low} to {expected.high}",
            **_paper(cell.rate, "paper, Table 3 %", lambda rate: percent(TABLE_3[rate].problems, RUNS)),
            **_both(cell.rate, "no BDI, replan %", lambda cell: percent(cell.replan.problems, RUNS)),
            **_both(cell.rate, "no BDI, no replan %", lambda cell: percent(cell.plain.problems, RUNS)),
        }
    return rows


def figure_8(experiments: Experiments) -> Rows:
    """Share of completed missions with BDI, with and without recovery, %."""
    rows: Rows = {}
    for rate in [cell.rate for cell in experiments.of("inline", WITH)]:
        rows[f"{rate:g} %"] = {
            **_share("with recovery", experiments.at("inline", WITH, rate)),
            **_share("without", experiments.at("inline", WITHOUT, rate)),
            "paper, with %": 100.0 if rate in TABLE_3 else None,
            "paper, without %": 100.0 - rate if rate in TABLE_3 else None,
        }
    return rows


def figure_9(experiments: Experiments) -> Rows:
    """Share of completed missions of all configurations and of the predecessor, %."""
    rows: Rows = {}
    for rate in [cell.rate for cell in experiments.of("inline", WITH)]:
        row: dict[str, Value] = {}
        for configuration in CONFIGURATIONS:
            row |= _share(configuration, experiments.at("inline", configuration, rate))
        rows[f"{rate:g} %"] = row | _both(rate, "no BDI, recounted %", lambda cell: percent(cell.plain.completed, RUNS))
    return rows


def _share(name: str, cell: Cell | None) -> dict[str, Value]:
    if cell is None:
        return {}
    known = _range(wilson(cell.completed, cell.runs), 100.0)
    return {f"{name} %": percent(cell.completed, cell.runs), f"{name} 95 %": known}


def figure_10(experiments: Experiments) -> Rows:
    """Mission duration, s, with and without recovery, in simulated time and over ROS (`ros_s`)."""
    rows: Rows = {}
    for rate in experiments.rates:
        row: dict[str, Value] = {}
        for configuration, name in RECOVERY:
            cell = experiments.at("inline", configuration, rate)
            row[f"inline, {name}"] = None if cell is None else round(cell.mean_s, 3)
        for configuration, name in RECOVERY:
            seconds = experiments.ros_s(configuration, rate)
            row[f"ros, {name}"] = None if seconds is None else round(seconds, 3)
        row |= _paper(rate, "paper, with", lambda rate: TABLE_3[rate].seconds)
        row |= _both(rate, "no BDI, replan", lambda cell: cell.replan.seconds)
        rows[f"{rate:g} %"] = row | _both(rate, "no BDI, no replan", lambda cell: cell.plain.seconds)
    return rows


def table_3(experiments: Experiments) -> Rows:
    """Growth of problems and time from 10 % on, with recovery; cells of `RUNS` runs."""
    rows: Rows = {}
    found = [cell for cell in experiments.of("inline", WITH) if cell.rate > 0]
    for cell in found:
        row: dict[str, Value] = {
            "problems": cell.met,
            "of": cell.runs,
            "time s": round(cell.mean_s, 3),
            "time +%": _more(cell.mean_s, found[0].mean_s, 2),
            "problems +%": _more(cell.met, found[0].met),
        }
        if cell.rate in TABLE_3:
            paper, first = TABLE_3[int(cell.rate)], TABLE_3[10]
            row |= {
                "paper: problems": paper.problems,
                "time": paper.seconds,
                "+%": _more(paper.seconds, first.seconds, 2),
                "problems + %": _more(paper.problems, first.problems),
            }
        rows[f"{cell.rate:g} %"] = row
    return rows


def _more(value: float, first: float, digits: int = 0) -> Value:
    return round(100.0 * (value / first - 1.0), digits) if first else None


def problem_line(records: Iterable[MissionRecord]) -> Line | None:
    """Fit mission time (s) over problem (0 or 1): the slope is the cost of a problem."""
    return fit([(float(record.met), record.mission_s) for record in records])


def paper_line() -> Line:
    """Fit the mean time (s) over the share of missions with a problem in Table 3."""
    line = fit([(row.problems / RUNS, row.seconds) for row in TABLE_3.values()])
    assert line is not None
    return line


def figure_11(experiments: Experiments) -> Rows:
    """Least-squares line of time over problems, with recovery."""
    lines = {
        "inline": problem_line(experiments.records("inline", WITH)),
        "ros": problem_line(experiments.records("ros", WITH)),
        "paper, Table 3": paper_line(),
    }
    return {
        name: {
            "without a problem s": round(line.start, 3),
            "a problem costs s": round(line.slope, 3),
            "95 %": _range(line.interval, digits=3),
            "that is +%": round(100.0 * line.slope / line.start, 1),
        }
        for name, line in lines.items()
        if line is not None
    }


PARTS = ("reasoning_s", "planning_s", "communication_s", "acting_s")


def split_rows(experiments: Experiments) -> Rows:
    """Mean time shares of a mission, ms, by configuration and problem."""
    rows: Rows = {}
    for runner in ("inline", "ros"):
        for configuration in CONFIGURATIONS:
            for met in (False, True):
                some = [record for record in experiments.records(runner, configuration) if record.met is met]
                if some:
                    name = f"{runner}, {configuration}, {'with' if met else 'without'} a problem"
                    rows[name] = {"missions": len(some), **_means(record.share for record in some)}
    return rows


def _means(shares: Iterable[Share]) -> dict[str, Value]:
    some = list(shares)
    return {
        f"{part.removesuffix('_s')} ms": round(1000.0 * statistics.fmean(getattr(share, part) for share in some), 2)
        for part in PARTS
    }


def recovered_ms(records: Iterable[MissionRecord]) -> list[float]:
    """Duration of each recovery without acting, ms."""
    return [
        1000.0 * (share.reasoning_s + share.planning_s + share.communication_s)
        for record in records
        for share in record.recovered
    ]


def recovery_rows(experiments: Experiments) -> Rows:
    """Time shares of a recovery, ms, from the failure to the first action of the new plan."""
    rows: Rows = {}
    for runner in ("inline", "ros"):
        records = experiments.records(runner, WITH)
        shares = [share for record in records for share in record.recovered]
        if shares:
            whole = recovered_ms(records)
            rows[runner] = {
                "recoveries": len(shares),
                **_means(shares),
                "all but acting ms": round(statistics.fmean(whole), 2),
                "p95 ms": round(percentile(whole, 0.95) or 0.0, 2),
            }
    return rows


def all_tables(experiments: Experiments) -> dict[str, Rows]:
    """Return all non-empty tables by title."""
    found = {
        "cells, inline": cell_rows(experiments.of("inline")),
        "cells, ros": cell_rows(experiments.of("ros")),
        "figure 7: missions that met a problem": figure_7(experiments),
        "figure 8: completed missions": figure_8(experiments),
        "figure 9: completed missions by configuration": figure_9(experiments),
        "figure 10: time of a mission, s": figure_10(experiments),
        "table 3: growth with recovery": table_3(experiments),
        "figure 11: what a problem costs": figure_11(experiments),
        "where the time of a mission goes": split_rows(experiments),
        "where the time of a recovery goes": recovery_rows(experiments),
    }
    return {title: rows for title, rows in found.items() if rows}


def _paper(rate: float, name: str, value: Callable[[int], Value]) -> dict[str, Value]:
    return {name: value(int(rate)) if rate in TABLE_3 else None}


def _both(rate: float, name: str, value: Callable[[PastCell], float]) -> dict[str, Value]:
    known = [f"{value(some[int(rate)]):g}" for some in PREDECESSOR if rate in some]
    return {name: " / ".join(known) or None}


def markdown(tables: dict[str, Rows]) -> str:
    """Return the tables as Markdown."""
    return "\n".join(line for title, rows in tables.items() for line in _markdown(title, rows))


def _markdown(title: str, rows: Rows) -> Iterable[str]:
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    yield f"### {title[:1].upper()}{title[1:]}"
    yield ""
    yield f"| | {' | '.join(columns)} |"
    yield f"|---|{'---:|' * len(columns)}"
    for name, row in rows.items():
        values = (row.get(column) for column in columns)
        yield f"| {name} | {' | '.join('-' if value is None else str(value) for value in values)} |"
    yield ""


MISSION = "disinfect"
EARLIER = ("Run Number", "Problem Rate", "Replan", "Runtime (s)", "Had Failure", "Successful Termination")
LATER = (
    "Run Number", "Problem Rate", "Can Replan", "Have BDI", "Runtime (s)", "Batery Failures", "Dirty Failures",
    "ICU Failures", "Total Actions", "Total Plans Made", "Total Missions", "Completed Missions",
    "Successful Termination",
)  # fmt: skip


def write_csv(folder: Path, experiments: Experiments) -> None:
    """Write the missions as CSV with the columns of the paper's authors, a file of each form for each cell and runner.

    Their files have the same names. The earlier form has a column for replanning, the later one also for BDI; the
    earlier one is therefore split into ``plain`` and ``bdi``. ``Runtime (s)`` is the process time from first start to
    last exit over ROS, and the mission time in simulated time.

    Some columns of the later form have no counterpart in the paper's ward: ``Batery Failures`` (their spelling) and
    ``ICU Failures`` are 0, and ``Total Missions`` is 1. ``Dirty Failures`` counts dirty rooms met. ``Total Actions``
    counts executed or attempted actions; theirs may count planned ones.

    Raises:
        OSError: A file cannot be written.
    """
    for cell in experiments.cells:
        replan, bdi = cell.configuration == WITH, cell.configuration != "plain"
        start = f"simulation_summary_{MISSION}_{cell.rate:g}_{replan}"
        place = folder / "csv" / cell.runner
        _write(place / ("bdi" if bdi else "plain") / f"{start}.csv", EARLIER, _earlier(cell, replan))
        _write(place / "later" / f"{start}_bdi_{bdi}.csv", LATER, _later(cell, replan, bdi))


def _write(path: Path, columns: Sequence[str], rows: Iterator[tuple[object, ...]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def _earlier(cell: Cell, replan: bool) -> Iterator[tuple[object, ...]]:
    for number, one in enumerate(cell.records, start=1):
        yield number, f"{one.rate:g}", replan, _runtime(one), one.met, one.completed


def _later(cell: Cell, replan: bool, bdi: bool) -> Iterator[tuple[object, ...]]:
    for number, one in enumerate(cell.records, start=1):
        failures = max(one.recoveries, int(one.met))
        start = (number, f"{one.rate:g}", replan, bdi, _runtime(one))
        yield (*start, 0, failures, 0, one.actions, one.plans, 1, int(one.completed), one.completed)


def _runtime(one: MissionRecord) -> str:
    return f"{one.wall_s if one.runner == 'ros' else one.mission_s:.2f}"
