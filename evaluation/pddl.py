"""Problems of others: share of the plans of Kairos that socialbot accepts, and its verdicts against those of VAL.

``python -m evaluation.pddl FOLDER --val PATH`` finds the PDDL problems below a folder. Kairos alone plans each of them,
and the planner of socialbot plans it in the same time. Both validators judge the plan of Kairos and its mutants, from
which a step is dropped, shifted, shortened and so on. The domains are split in two halves by the hash of their name:
``--side dev`` and ``--side held``. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

import hashlib
import math
import random
import re
import subprocess
import tempfile
import threading
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from evaluation.report import JobsOption, JsonOption, Report, Value, run, run_all
from socialbot.core.errors import ParameterError, PlanningError
from socialbot.planning.pddl import (
    PddlDomain,
    PddlPlan,
    PddlProblem,
    PlanStep,
    read_domain,
    read_problem,
    validate_plan,
)
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.planners.engines import Kairos, kairos_plans, make_planner
from socialbot.planning.planners.planner import PlannerLimits
from socialbot.planning.planners.planner import run as run_child

MEMORY_MB = 2048
VAL_TOLERANCE = 0.001
"""Option ``-t`` of VAL: planners separate events by as much."""
VAL_S = 20.0
MUTATED_STEPS = 150
"""Largest number of steps of a plan that is mutated."""
SHIFT_S = 0.5

UNSUPPORTED = "not supported by socialbot: "

Side = Literal["dev", "held"]
Judgement = Literal["valid", "invalid", "unclear"]

_DEFINED = re.compile(r"\(\s*define\s*\(\s*(domain|problem)\s+([^\s()]+)\s*\)", re.IGNORECASE)
_OF_DOMAIN = re.compile(r"\(\s*:domain\s+([^\s()]+)\s*\)", re.IGNORECASE)
_NUMBERS = re.compile(r"\d+")


@dataclass(frozen=True, order=True)
class Task:
    """Problem file with the file and name of its domain."""

    name: str
    domain: Path
    problem: Path

    @property
    def side(self) -> Side:
        """Half of the domains that the task belongs to, by the hash of the domain's name."""
        return "held" if hashlib.sha1(self.name.encode()).digest()[-1] % 2 else "dev"


def tasks(folder: Path, *, each: int, most: int) -> list[Task]:
    """Return the problems below a folder without copies of the same text.

    Args:
        each: Largest number of problems of a folder and domain file; the smallest files.
        most: Largest number of problems of a domain, of as many folders as possible.
    """
    domains: dict[Path, dict[Path, str]] = defaultdict(dict)
    problems: dict[Path, str] = {}
    for path in sorted(path for path in folder.rglob("*.pddl") if path.is_file()):
        text = _without_comments(path)
        kind = _DEFINED.search(text)
        if kind is not None and kind[1].lower() == "domain":
            domains[path.parent][path] = kind[2].lower()
        elif kind is not None and (of := _OF_DOMAIN.search(text)) is not None:
            problems[path] = of[1].lower()
    alike: dict[tuple[Path, Path], list[Task]] = defaultdict(list)
    for path, name in problems.items():
        domain = _domain_of(path, name, domains)
        if domain is not None:
            alike[path.parent, domain.parent if _number(domain) else domain].append(Task(name, domain, path))
    ranked = sorted(
        (rank, task)
        for some in alike.values()
        for rank, task in enumerate(sorted(some, key=lambda one: (one.problem.stat().st_size, one))[:each])
    )
    found: dict[str, dict[bytes, Task]] = defaultdict(dict)
    for _, task in ranked:
        if len(found[task.name]) < most:
            text = b"".join(path.read_bytes() for path in (task.domain, task.problem))
            found[task.name].setdefault(hashlib.sha1(text).digest(), task)
    return sorted(task for some in found.values() for task in some.values())


def _without_comments(path: Path) -> str:
    return "\n".join(line.partition(";")[0] for line in path.read_text("utf-8", errors="replace").splitlines())


def _domain_of(problem: Path, name: str, domains: dict[Path, dict[Path, str]]) -> Path | None:
    """Return the domain file of a problem: of this name, near, and of the same number if there are several."""
    for folder in list(problem.parents)[:3]:
        near = [folder, *(other for other in (folder / "domains", folder / "domain") if other in domains)]
        fitting = [path for each in near for path, known in domains.get(each, {}).items() if known == name]
        if fitting:
            same = [path for path in fitting if _number(path) == _number(problem)]
            return (same or fitting)[0]
    return None


def _number(path: Path) -> int | None:
    numbers = _NUMBERS.findall(path.stem)
    return int(numbers[-1]) if numbers else None


@dataclass(frozen=True)
class Mutant:
    """Changed plan with the verdicts of both validators; ``faults`` are reasons."""

    kind: str
    plan: PddlPlan
    ours: Judgement
    val: Judgement
    faults: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Outcome:
    """Result of a problem.

    Attributes:
        refusal: Error of the reader; empty if it reads the files.
        kairos: Whether Kairos alone finds a plan for the original files.
        plan: The verdicts on this plan.
        solved: Whether the planner of socialbot finds a plan in the same time, and its message.
    """

    task: Task
    refusal: str = ""
    kairos: bool = False
    plan: Mutant | None = None
    solved: bool = False
    message: str = ""
    mutants: tuple[Mutant, ...] = field(default=())

    @property
    def unsupported(self) -> str:
        """Feature that the reader refuses on purpose; empty if there is none."""
        return self.refusal.partition(UNSUPPORTED)[2].partition(":")[0].partition(" (")[0]


def judge(task: Task, val: Path, timeout_s: float, mutants: int) -> Outcome:
    """Read, plan and validate one problem."""
    texts = [path.read_text("utf-8", errors="replace") for path in (task.domain, task.problem)]
    refusal = ""
    domain: PddlDomain | None = None
    problem: PddlProblem | None = None
    try:
        domain = read_domain(texts[0])
        problem = read_problem(texts[1], domain)
    except PlanningError as error:
        refusal = str(error)
    with tempfile.TemporaryDirectory(prefix="socialbot-pddl-") as name:
        folder = Path(name)
        (folder / "domain.pddl").write_text(texts[0], "utf-8")
        (folder / "problem.pddl").write_text(texts[1], "utf-8")
        plan = _alone(folder, timeout_s)
        if plan is None:
            return Outcome(task, refusal)
        referee = _Val(
            val, folder, {one.lower() for one in re.findall(r":durative-action\s+([^\s()]+)", texts[0], re.I)}
        )
        if domain is None or problem is None:
            judged, why = referee.judge(plan)
            return Outcome(task, refusal, True, Mutant("none", plan, "unclear", judged, (refusal, why)))
        original = _compared("none", plan, domain, problem, referee)
        answer = make_planner("kairos").solve(domain, problem, PlannerLimits(timeout_s, MEMORY_MB))
        changed: list[Mutant] = []
        if original.val == "valid" and len(plan.steps) <= MUTATED_STEPS:
            for kind, other in _mutated(plan, domain, problem, random.Random(str(task.problem.name)), mutants):
                changed.append(_compared(kind, other, domain, problem, referee))
        return Outcome(task, "", True, original, answer.plan is not None, answer.message, tuple(changed))


def _alone(folder: Path, timeout_s: float) -> PddlPlan | None:
    words = ["--no-anytime", "--format", "json", "--timeout", "1000000", "--threads", "1", "--memory", str(MEMORY_MB)]
    command = [Kairos().command, "solve", "domain.pddl", "problem.pddl", *words]
    plans = kairos_plans(run_child(command, folder, timeout_s, threading.Event()).output)
    return plans[0] if plans else None


def _compared(kind: str, plan: PddlPlan, domain: PddlDomain, problem: PddlProblem, val: _Val) -> Mutant:
    faults = validate_plan(domain, problem, plan)
    judged, why = val.judge(plan)
    return Mutant(kind, plan, "invalid" if faults else "valid", judged, (str(faults[0]) if faults else "", why))


class _Val:
    """VAL's program ``Validate`` for one problem."""

    def __init__(self, program: Path, folder: Path, durative: set[str]) -> None:
        self._command = [str(program), "-v", "-t", str(VAL_TOLERANCE), "domain.pddl", "problem.pddl", "plan.txt"]
        self._folder = folder
        self._durative = durative

    def judge(self, plan: PddlPlan) -> tuple[Judgement, str]:
        lines = [str(step) if step.action in self._durative else str(step).partition("[")[0] for step in plan.steps]
        (self._folder / "plan.txt").write_text("\n".join(lines) + "\n", "utf-8")
        try:
            ended = subprocess.run(
                self._command, cwd=self._folder, capture_output=True, text=True, timeout=VAL_S, errors="replace"
            )
        except subprocess.TimeoutExpired:
            return "unclear", "timeout"
        return _verdict(ended.stdout + ended.stderr)


def _verdict(output: str) -> tuple[Judgement, str]:
    told = " / ".join(line.strip() for line in output.splitlines() if line.strip())[-500:]
    if "Plan valid" in output:
        return "valid", ""
    if "Bad plan description" in output:  # VAL cannot read the plan
        return "unclear", told
    if re.search(r"Failed plans|Plan failed|Plan invalid|Goal not satisfied", output):
        return "invalid", told
    return "unclear", told


def _mutated(
    plan: PddlPlan, domain: PddlDomain, problem: PddlProblem, chance: random.Random, count: int
) -> Iterator[tuple[str, PddlPlan]]:
    """Yield changed plans, ``count`` of each kind that fits; a plan without times keeps its separations."""
    if not plan.steps:
        return
    state = PddlState.of(problem, domain)
    for _ in range(count):
        number = chance.randrange(len(plan.steps))
        step, other = plan.steps[number], plan.steps[chance.randrange(len(plan.steps))]
        yield "drop a step", _with(plan, number)
        yield "repeat a step", _with(plan, number, step, replace(step, start_s=plan.makespan_s + 1))
        late = chance.choice((SHIFT_S, 2 * SHIFT_S, 10 * SHIFT_S))
        yield "shift later", _with(plan, number, replace(step, start_s=step.start_s + late))
        yield "shift earlier", _with(plan, number, replace(step, start_s=max(0.0, step.start_s - late)))
        yield "start with another", _with(plan, number, replace(step, start_s=other.start_s))
        yield "start at an end", _with(plan, number, replace(step, start_s=other.end_s))
        near = chance.choice((-1, 1)) * chance.choice((0.2, 2.0)) * VAL_TOLERANCE
        yield "start near an end", _with(plan, number, replace(step, start_s=max(0.0, other.end_s + near)))
        if other is not step:
            swapped = [one for one in plan.steps if one is not step and one is not other]
            swapped += [replace(step, start_s=other.start_s), replace(other, start_s=step.start_s)]
            yield "swap two steps", _sorted(swapped)
        if step.duration_s > 0:
            yield "shorten", _with(plan, number, replace(step, duration_s=step.duration_s / 2))
            yield "lengthen", _with(plan, number, replace(step, duration_s=step.duration_s + SHIFT_S))
            slightly = step.duration_s * (1 + chance.choice((-0.01, 0.01)))
            if math.fabs(slightly - step.duration_s) > 2 * VAL_TOLERANCE:
                yield "change a duration by 1 %", _with(plan, number, replace(step, duration_s=slightly))
        if len(set(step.args)) > 1:
            yield "swap arguments", _with(plan, number, replace(step, args=step.args[::-1]))
        if step.args and step.action in domain.actions:
            place = chance.randrange(len(step.args))
            fitting = state.objects(domain.actions[step.action].parameters[place].types)
            args = (*step.args[:place], chance.choice(fitting), *step.args[place + 1 :])
            if args != step.args:
                yield "another object", _with(plan, number, replace(step, args=args))


def _with(plan: PddlPlan, number: int, *steps: PlanStep) -> PddlPlan:
    return _sorted((*plan.steps[:number], *steps, *plan.steps[number + 1 :]))


def _sorted(steps: Iterable[PlanStep]) -> PddlPlan:
    return PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))


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
