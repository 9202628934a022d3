"""The missions of the hospital's experiments as CSV, with the columns that the paper's authors write.

Both of their forms, a file for each cell, named as theirs. The earlier one knows whether a mission can be planned anew,
the later one whether there is BDI, too; as the earlier one does not, it has folders ``plain`` and ``bdi``.
``Runtime (s)`` of missions over ROS is as theirs, from before the first process starts until the last has ended; of
missions in simulated time it is the mission's.

In the later form some columns have no counterpart, as the paper's ward has nothing of the kind: batteries never run
low (``Batery Failures``, their spelling, is 0), there is no intensive care (``ICU Failures`` is 0), and there is one
mission a run (``Total Missions`` is 1). ``Dirty Failures`` counts missions that met a dirty room, as often as that
was. ``Total Actions`` are those done or tried; it is not known whether theirs are those planned.
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
    """Writes a file of each form for each cell, below ``folder``; a runner has a folder of its own.

    Raises OSError where that cannot be.
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
