"""Warehouse benchmark: goal achievement under faults, and times for planning and deciding.

``python -m evaluation.warehouse`` runs the two demonstration scenarios in simulated time under many seeds of execution
noise. It also runs them with faults and killed agents, and one with 24 boxes. It measures planning and deciding, and
prints the figures with their requirements and those of ROS2-BDI. An independent check (`evaluation.trace_check`)
verifies each step of each agent. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.console import Console

from evaluation.report import JobsOption, JsonOption, QuickOption, Report, Value, run, run_kinds
from evaluation.warehouse_planning import decisions, first_question, plan_by_turns, second_question
from evaluation.warehouse_runs import Result, Story, play, troubled

PLAN_S = {6: 0.3, 12: 0.5, 24: 1.0}
REPLAN_S = 0.3
DECISION_MS = 5.0
DESIRES = 1000
MAKESPAN_S = 107.1
STEPS = 28
REQUESTS = 4
"""Requirements of the figures."""

NOMINAL, HASTY, TROUBLED, LARGE = "run 1", "run 2", "faults", "24 boxes"

SeedsOption = Annotated[int | None, typer.Option(min=1, help="Seeds of execution noise for each run; default: 50.")]


@dataclass(frozen=True)
class Scale:
    """Repetition counts; ``times`` is the number of repetitions of each plan."""

    seeds: int = 50
    troubled: int = 100
    large: int = 5
    times: int = 25
    decisions: int = 200


QUICK = Scale(seeds=3, troubled=4, large=1, times=5, decisions=50)


def stories(scale: Scale) -> dict[str, list[Story]]:
    """Return all runs by kind."""
    return {
        NOMINAL: [Story(seed) for seed in range(scale.seeds)],
        HASTY: [Story(seed, run=2) for seed in range(scale.seeds)],
        TROUBLED: [troubled(seed) for seed in range(scale.troubled)],
        LARGE: [Story(seed, boxes=24) for seed in range(scale.large)],
    }


# Results


def add_runs(report: Report, results: dict[str, list[Result]]) -> None:
    """Add the figures of all runs."""
    _add_nominal(report, results[NOMINAL])
    _add_hasty(report, results[HASTY])
    _add_troubled(report, results[TROUBLED])
    _add_large(report, results[LARGE])
    _add_checks(report, results)
    for kind, some in results.items():
        report.tables[kind] = {name: _spread(values) for name, values in _measures(some)}


def _add_nominal(report: Report, results: Sequence[Result]) -> None:
    add = report.add
    steps = max(one.first_steps for one in results)
    add("run1_steps", "run 1: planned actions, maximum", steps, STEPS, others="28 by arithmetic")
    makespan = max(one.first_makespan_s for one in results)
    others = "107 s by arithmetic; POPF 107.007 s; deadline 116 s"
    add("run1_makespan_s", "run 1: planned makespan, s", makespan, MAKESPAN_S, others=others)
    add("run1_runs", "run 1: runs with different seeds", len(results))
    add("run1_missed", "run 1: runs that miss the goal", _missed(results), 0, others="one run was shown")
    add("run1_aborts", "run 1: plans aborted", sum(one.aborts for one in results), 0)
    unloaded = _count(one.unloads < len(one.story.cast.carriers) for one in results)
    add("run1_not_unloaded", "run 1: runs in which a carrier does not unload", unloaded, 0)
    add("run1_median_s", "run 1: completion time, median, s", _median(results), others="about 130 s expected")


def _add_hasty(report: Report, results: Sequence[Result]) -> None:
    add = report.add
    add("run2_runs", "run 2: runs with different seeds", len(results))
    add("run2_missed", "run 2: runs that miss the goal", _missed(results), 0, others="one run was shown")
    smooth = _count(one.aborts < 1 or one.plans < 2 for one in results)
    add("run2_without_replan", "run 2: runs without an abort and a replan", smooth, 0, others="1 of each")
    other = _count(one.requests != REQUESTS for one in results)
    add("run2_other_requests", f"run 2: runs with other than {REQUESTS} requests in all", other, 0, others="4 requests")
    add("run2_median_s", "run 2: completion time, median, s", _median(results))


def _add_troubled(report: Report, results: Sequence[Result]) -> None:
    add = report.add
    add("faults_runs", "faults: runs with random faults", len(results))
    killed = _count(one.story.kills for one in results)
    add("faults_killed", "faults: runs with agent crashes and restarts", killed)
    add("faults_reached", "faults: runs that reach the goal", _count(one.reached for one in results))
    dropped = _count(one.settled and not one.reached for one in results)
    add("faults_dropped", "faults: runs with a dropped desire and a reason", dropped)
    hung = _count(not one.settled for one in results)
    add("faults_unsettled", "faults: runs without a result", hung, 0)


def _add_large(report: Report, results: Sequence[Result]) -> None:
    report.add("large_runs", "24 boxes, 6 carriers: runs", len(results))
    report.add("large_missed", "24 boxes: runs that miss the goal", _missed(results), 0)


def _add_checks(report: Report, results: dict[str, list[Result]]) -> None:
    everything = [one for some in results.values() for one in some]
    violations = sum(len(one.violations) for one in everything)
    report.add("steps", "started steps, all verified by the independent checker", sum(one.steps for one in everything))
    report.add("violations", "violations, such as steps with a false condition", violations, 0)
    report.add("failures", "nodes with exceptions", sum(len(one.failures) for one in everything), 0)


def _measures(results: Sequence[Result]) -> Iterator[tuple[str, list[float]]]:
    """Yield the measures of one kind of runs by name; times are those of successful runs."""
    yield "s until the goal", [one.ended_s for one in results if one.reached]
    yield "aborts", [one.aborts for one in results]
    yield "requests", [one.requests for one in results]
    yield "steps", [one.steps for one in results]
    yield "processor s", [one.processor_s for one in results]


def _spread(values: Sequence[float]) -> dict[str, Value]:
    if not values:
        return {"least": None, "median": None, "most": None}
    return {"least": min(values), "median": round(statistics.median(values), 3), "most": max(values)}


def _count(flags: Iterator[object] | Sequence[object]) -> int:
    return sum(map(bool, flags))


def _missed(results: Sequence[Result]) -> int:
    return _count(not one.reached for one in results)


def _median(results: Sequence[Result]) -> float | None:
    found = [one.ended_s for one in results if one.reached]
    return round(statistics.median(found), 2) if found else None


def add_planning(report: Report, scale: Scale) -> None:
    """Measure planning and deciding, and add the figures."""
    questions = {f"plan{boxes}": first_question(boxes) for boxes in PLAN_S} | {"replan": second_question()}
    texts = {f"plan{boxes}": f"first plan for {boxes} boxes" for boxes in PLAN_S} | {"replan": "new plan in run 2"}
    limits = {f"plan{boxes}": limit for boxes, limit in PLAN_S.items()} | {"replan": REPLAN_S}
    others = {"plan6": "POPF 0.45 s (0.20 s processor)", "replan": "POPF 0.035 s"}
    for key, found in plan_by_turns(questions, scale.times).items():
        text = texts[key]
        report.add(f"{key}_s", f"{text}: wall s, best of {scale.times}", found.best_s, others=others.get(key, ""))
        report.add(f"{key}_median_s", f"{text}: wall s, median", found.median_s)
        report.add(f"{key}_processor_s", f"{text}: processor s with the child's", found.processor_s, limits[key])
        report.add(f"{key}_steps", f"{text}: actions", found.steps)
    for changed, decision in decisions(DESIRES, scale.decisions).items():
        text = f"{DESIRES} desires, {changed} need what changes"
        key = f"decision_{changed}"
        report.add(f"{key}_ms", f"{text}: processor ms, median", decision.median_ms, DECISION_MS)
        report.add(f"{key}_worst_ms", f"{text}: worst of {scale.decisions}", decision.worst_ms)


def tell_what_went_wrong(results: dict[str, list[Result]], console: Console) -> None:
    """Print each failed run with the command to repeat it."""
    for kind, some in results.items():
        for one in some:
            fine = one.settled if kind == TROUBLED else one.reached
            if not fine or one.violations or one.failures:
                what = [one.end or "no end", *one.violations[:3], *one.failures[:3]]
                console.print(f"{kind}, {one.story}: {'; '.join(what)}", style="red", soft_wrap=True, markup=False)


def main(
    json: JsonOption = None, quick: QuickOption = False, jobs: JobsOption = None, seeds: SeedsOption = None
) -> None:
    """Run the warehouse many times, and measure planning and deciding."""
    scale = QUICK if quick else Scale()
    scale = scale if seeds is None else Scale(seeds, scale.troubled, scale.large, scale.times, scale.decisions)
    report = Report("warehouse", quick)
    add_planning(report, scale)
    results = run_kinds(play, stories(scale), jobs)
    add_runs(report, results)
    report.finish(json)
    tell_what_went_wrong(results, Console(highlight=False))
    report.check()


if __name__ == "__main__":
    run(main)
