"""Problems of a folder of PDDL files: what is read and planned, and verdicts on plans and mutants against VAL's."""

from __future__ import annotations

import hashlib
import math
import random
import re
import subprocess
import tempfile
import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from socialbot.core.errors import PlanningError
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
from socialbot.planning.planners._child_process import run
from socialbot.planning.planners.engines import Kairos, kairos_plans, make_planner
from socialbot.planning.planners.planner import PlannerLimits

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
    plans = kairos_plans(run(command, folder, timeout_s, threading.Event()).output)
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
