"""Problems of others: share of the plans of Kairos that socialbot accepts, and its verdicts against those of VAL.

``python -m evaluation.pddl FOLDER --val PATH`` finds the PDDL problems below a folder. Kairos alone plans each of them,
and the planner of socialbot plans it in the same time. Both validators judge the plan of Kairos and its mutants, from
which a step is dropped, shifted, shortened and so on. The domains are split in two halves by the hash of their name:
``--side dev`` and ``--side held``. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from evaluation.pddl_runs import Mutant, Outcome, Side, judge, tasks
from evaluation.report import JobsOption, JsonOption, Report, Value, run, run_all
from socialbot.core.errors import ParameterError

UNSOLVED_PERCENT = 5.0

FolderArgument = Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Folder of PDDL files.")]
ValOption = Annotated[Path, typer.Option(exists=True, dir_okay=False, help="VAL's program Validate.")]
SideOption = Annotated[Side | None, typer.Option(help="Half of the domains; default: all.")]
EachOption = Annotated[int, typer.Option(min=1, help="Largest number of problems of a folder; the smallest files.")]
MostOption = Annotated[int, typer.Option(min=1, help="Largest number of problems of a domain.")]
SecondsOption = Annotated[float, typer.Option(min=0.1, help="Time (s) for a plan.")]
MutantsOption = Annotated[int, typer.Option(min=0, help="Mutants of each kind for a plan.")]


def add_figures(report: Report, outcomes: Sequence[Outcome]) -> None:
    """Add the figures of all problems, and tables by domain and by kind of mutant."""
    report.add("domains", "domains", len({one.task.name for one in outcomes}))
    report.add("problems", "problems", len(outcomes))
    refused = [one for one in outcomes if one.refusal and not one.unsupported]
    report.add("refused", "problems that the reader refuses as wrong", len(refused))
    beyond = [one for one in outcomes if one.unsupported]
    report.add("unsupported", "problems beyond PDDL 2.1, with features that it does not support", len(beyond))
    report.add("kairos", "problems that Kairos alone solves", sum(one.kairos for one in outcomes))
    solved = [one for one in outcomes if one.kairos and not one.unsupported]
    report.add("kairos_supported", "of these without such features", len(solved))
    unplanned = _percent([not one.solved for one in solved])
    report.add("unplanned_percent", "of these not solved by the planner of socialbot, %", unplanned, UNSOLVED_PERCENT)
    judged = [one.plan for one in solved if one.plan is not None and one.plan.val != "unclear"]
    rejected = [one.ours != "valid" for one in judged if one.val == "valid"]
    report.add("accepted_by_val", "plans of Kairos that VAL accepts", len(rejected))
    report.add("rejected_percent", "of these rejected, or not read, %", _percent(rejected), UNSOLVED_PERCENT)
    everything = [*judged, *(mutant for one in solved for mutant in one.mutants)]
    compared = [one for one in everything if "unclear" not in (one.ours, one.val)]
    report.add("verdicts", "plans and mutants that both judge", len(compared))
    report.add("valid", "of these valid for VAL", sum(one.val == "valid" for one in compared))
    report.add("wrongly_rejected", "valid plans rejected", _different(compared, "invalid"), 0)
    report.add("wrongly_accepted", "invalid plans accepted", _different(compared, "valid"), 0)
    unclear = sum(one.plan is not None and one.plan.val == "unclear" for one in solved)
    report.add("unclear", "plans of Kairos that VAL cannot judge", unclear)
    features = Counter(one.unsupported for one in beyond)
    report.tables["features that are not supported"] = {name: {"problems": features[name]} for name in sorted(features)}
    names = sorted({one.task.name for one in outcomes})
    report.tables["by domain"] = {name: _domain([one for one in outcomes if one.task.name == name]) for name in names}
    kinds = dict.fromkeys(one.kind for one in compared)
    report.tables["by change"] = {kind: _kind([one for one in compared if one.kind == kind]) for kind in kinds}


def _percent(bad: Sequence[bool]) -> float | None:
    return round(100.0 * sum(bad) / len(bad), 2) if bad else None


def _different(compared: Sequence[Mutant], ours: str) -> int:
    return sum(one.ours == ours and one.val != ours for one in compared)


def _domain(some: Sequence[Outcome]) -> dict[str, Value]:
    mutants = [mutant for one in some for mutant in one.mutants]
    return {
        "problems": len(some),
        "read": sum(not one.refusal for one in some),
        "Kairos": sum(one.kairos for one in some),
        "planned": sum(one.solved for one in some),
        "valid for VAL": sum(one.plan is not None and one.plan.val == "valid" for one in some),
        "accepted": sum(one.plan is not None and one.plan.ours == one.plan.val == "valid" for one in some),
        "mutants": len(mutants),
        "other verdicts": sum("unclear" != one.val != one.ours for one in mutants),
    }


def _kind(some: Sequence[Mutant]) -> dict[str, Value]:
    verdicts = Counter((one.ours, one.val) for one in some)
    return {
        "plans": len(some),
        "both accept": verdicts["valid", "valid"],
        "both reject": verdicts["invalid", "invalid"],
        "only VAL accepts": verdicts["invalid", "valid"],
        "only socialbot accepts": verdicts["valid", "invalid"],
    }


def tell_differences(outcomes: Sequence[Outcome], console: Console) -> None:
    """Print each refused problem, each plan that is not found, and each different verdict."""
    for one in outcomes:
        if one.refusal:
            console.print(f"{one.task.problem}: {one.refusal}", soft_wrap=True, markup=False)
        elif one.kairos and not one.solved:
            console.print(f"{one.task.problem}: no plan: {one.message}", soft_wrap=True, markup=False)
        for mutant in (*((one.plan,) if one.plan else ()), *one.mutants):
            if not one.refusal and mutant.ours != mutant.val:
                verdicts = f"{mutant.kind}: {mutant.ours}, {mutant.val} for VAL"
                why = "; ".join(filter(None, mutant.faults))
                console.print(f"{one.task.problem}: {verdicts}: {why}", soft_wrap=True, markup=False)


def main(
    folder: FolderArgument,
    val: ValOption,
    side: SideOption = None,
    each: EachOption = 2,
    most: MostOption = 6,
    seconds: SecondsOption = 10.0,
    mutants: MutantsOption = 1,
    jobs: JobsOption = None,
    json: JsonOption = None,
) -> None:
    """PDDL problems of a folder: reader, planner and validator against Kairos alone and VAL."""
    some = [one for one in tasks(folder, each=each, most=most) if side in (None, one.side)]
    if not some:
        raise ParameterError("there is no PDDL problem with its domain", where=str(folder))
    outcomes = run_all(judge, [(one, val.absolute(), seconds, mutants) for one in some], jobs, "problems")
    report = Report("PDDL", quick=False)
    add_figures(report, outcomes)
    report.finish(json)
    tell_differences(outcomes, Console(stderr=True, highlight=False))
    report.check()


if __name__ == "__main__":
    run(main)
