"""Teams under random schedules: members die for good, hang, join late, or are silent, and things vanish.

``python -m evaluation.teams`` draws 200 schedules by seed for the hospital, the library example (with both planners)
and the warehouse, and runs them in simulated time. An independent check of the simulated worlds counts rooms that are
disinfected, and books and boxes that are delivered. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.console import Console

from evaluation.report import JobsOption, JsonOption, QuickOption, Report, Value, run, run_all
from evaluation.teams_runs import KINDS, Outcome, play, schedules

SCHEDULES, QUICK_SCHEDULES = 200, 10
DONE_PERCENT = 99.0

CountOption = Annotated[int | None, typer.Option(min=1, help="Number of schedules; default: 200.")]


def add_figures(report: Report, outcomes: Sequence[Outcome]) -> None:
    """Add the figures of all runs, and tables by world and by kind of trouble."""
    possible = sum(len(one.possible) for one in outcomes)
    missed = sum(len(one.missed) for one in outcomes)
    report.add("schedules", "random schedules", len(outcomes))
    report.add("possible", "targets that could still be done", possible)
    share = 100.0 * missed / possible if possible else 0.0
    report.add("missed_percent", "of these not done, %", round(share, 2), 100.0 - DONE_PERCENT)
    for scene in dict.fromkeys(one.schedule.scene for one in outcomes):
        some = [one for one in outcomes if one.schedule.scene == scene]
        those = sum(len(one.possible) for one in some)
        lost = 100.0 * sum(len(one.missed) for one in some) / those if those else 0.0
        report.add(f"missed_{scene}_percent", f"the same, {scene}, %", round(lost, 2), 100.0 - DONE_PERCENT)
    impossible = sum(len(one.wanted - one.possible - one.done) for one in outcomes)
    report.add("impossible", "targets that nobody could do, and nobody did", impossible)
    unexplained = sum(len(one.unexplained) for one in outcomes)
    report.add("unexplained", "targets not done, without a reason", unexplained, 0)
    report.add("failures", "runs with an exception of a node", sum(bool(one.failures) for one in outcomes), 0)
    seconds = sum(one.processor_s for one in outcomes)
    report.add("processor_s", "processor time of all runs, s", round(seconds, 1))
    scenes = dict.fromkeys(one.schedule.scene for one in outcomes)
    report.tables["by world"] = {
        scene: _row([one for one in outcomes if one.schedule.scene == scene]) for scene in scenes
    }
    report.tables["by kind of trouble in the schedule"] = {
        kind: _row([one for one in outcomes if any(each.kind == kind for each in one.schedule.troubles)])
        for kind in KINDS
    }


def _row(some: Sequence[Outcome]) -> dict[str, Value]:
    return {
        "schedules": len(some),
        "targets": sum(len(one.wanted) for one in some),
        "possible": sum(len(one.possible) for one in some),
        "done": sum(len(one.done) for one in some),
        "missed": sum(len(one.missed) for one in some),
        "unexplained": sum(len(one.unexplained) for one in some),
    }


def main(
    quick: QuickOption = False, json: JsonOption = None, jobs: JobsOption = None, count: CountOption = None
) -> None:
    """Teams with lost, stuck, late and blind members: everything that can still be done is done."""
    some = schedules(count or (QUICK_SCHEDULES if quick else SCHEDULES))
    outcomes = run_all(play, [(schedule,) for schedule in some], jobs, "schedules")
    report = Report("Teams", quick)
    add_figures(report, outcomes)
    report.finish(json)
    console = Console(stderr=True, highlight=False)
    for one in outcomes:
        for target in sorted(one.missed | one.unexplained):
            console.print(f"{one.schedule}: {target}: {one.reasons.get(target, 'no reason')}", soft_wrap=True)
    report.check()


if __name__ == "__main__":
    run(main)
