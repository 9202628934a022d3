"""Missions of the hospital benchmark as CSV with the columns of the paper's authors.

Both of their forms have one file per cell, with their file names. The earlier form has a column for replanning, the
later one also for BDI; the earlier one is therefore split into ``plain`` and ``bdi``. ``Runtime (s)`` is the process
time from first start to last exit over ROS, and the mission time in simulated time.

Some columns of the later form have no counterpart in the paper's ward: ``Batery Failures`` (their spelling) and ``ICU
Failures`` are 0, and ``Total Missions`` is 1. ``Dirty Failures`` counts dirty rooms met. ``Total Actions`` counts
executed or attempted actions; theirs may count planned ones.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from evaluation.hospital_record import MissionRecord
from evaluation.hospital_tables import WITH, Cell, Experiments

MISSION = "disinfect"
EARLIER = ("Run Number", "Problem Rate", "Replan", "Runtime (s)", "Had Failure", "Successful Termination")
LATER = (
    "Run Number", "Problem Rate", "Can Replan", "Have BDI", "Runtime (s)", "Batery Failures", "Dirty Failures",
    "ICU Failures", "Total Actions", "Total Plans Made", "Total Missions", "Completed Missions",
    "Successful Termination",
)  # fmt: skip


def write_csv(folder: Path, experiments: Experiments) -> None:
    """Write a file of each form for each cell and runner below ``folder``.

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
