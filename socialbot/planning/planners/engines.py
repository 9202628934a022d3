"""Planners by name: Kairos, POPF and the engines of unified-planning."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from importlib.util import find_spec
from pathlib import Path

from socialbot.core.errors import InstallationError, ParameterError, PlanningError
from socialbot.core.installation import extra_command, pip_command
from socialbot.core.limits import TEXT_BYTES
from socialbot.core.process import python_command
from socialbot.core.reading import read_bytes
from socialbot.planning.pddl.domain import PddlPlan, PlanStep, in_time, parse_plan
from socialbot.planning.planners.planner import (
    CANCELLED,
    DOMAIN_FILE,
    PROBLEM_FILE,
    ChildExit,
    ChildPlanner,
    Planner,
    PlannerAnswer,
    PlannerLimits,
    PlannerVerdict,
    SearchJob,
    run,
)

UNHURRIED_S = 1_000_000
"""Timeout that Kairos gets. It splits its timeout among its searches by elapsed time, so that the load of the machine
would change the result; socialbot ends the process instead."""
THOROUGH_SHARE = 0.75
"""Share of its time that the default search of Kairos gets; the engine m3 gets the rest."""
VALIDATE_S = 2.0
THREAD_MB = 128
"""Address space that a thread reserves."""
PLAN_FILE = "plan.txt"

_VERDICTS = {
    2: PlannerVerdict.REFUSED,  # it cannot read the domain or the problem
    10: PlannerVerdict.IMPOSSIBLE,
    11: PlannerVerdict.GAVE_UP,  # no time left
    12: PlannerVerdict.GAVE_UP,  # no memory left
    13: PlannerVerdict.REFUSED,  # it cannot plan with what the domain uses
    14: PlannerVerdict.GAVE_UP,  # neither a plan nor a proof
}


class Kairos(ChildPlanner):
    """Temporal and numeric planner; deterministic with one thread. Raises InstallationError if it is not installed.

    If its first plan is too long, a greedy search gets half of the time to find a shorter one. The default search of
    Kairos gets three quarters of the rest. The remaining time is for the engine m3, which treats start and end of an
    action as two steps: it is slow, but finds plans with required concurrency. It also gets the time that is left after
    a search that ended without a plan or a proof.

    If its first plan is short enough, a novelty search looks for a shorter one in half of the remaining time.
    """

    name = "kairos"

    def __init__(self) -> None:
        self.command = _command()

    def search(self, search: SearchJob) -> PlannerAnswer:
        if search.target_s is None:
            return self._thorough(search, "--no-anytime")
        aim = ["--anytime", "--target-cost", str(search.target_s)]
        greedy = self._search(search.half, *aim, "--search", "ehc")
        if search.good(greedy) or greedy.verdict is PlannerVerdict.CANCELLED:
            return greedy
        return self._thorough(search.after(greedy), *aim)

    def improve(self, search: SearchJob) -> PlannerAnswer:
        return self._search(search, "--no-anytime", "--search", "eager-lama")

    def _thorough(self, search: SearchJob, *options: str) -> PlannerAnswer:
        first = replace(search, left_s=THOROUGH_SHARE * search.left_s)
        answer = self._search(first, *options)
        exhausted = answer.verdict is PlannerVerdict.GAVE_UP and answer.seconds < first.left_s
        if search.good(answer) or (answer.seconds < first.left_s and not exhausted):
            return answer
        # Its default search keeps one partial plan per state, and may leave out the only ones that can be completed.
        other_search = ("--search", "ff") if exhausted else ()
        other = self._search(search.after(answer), *options, "--engine", "m3", *other_search)
        # m3 does not support all domains, which says nothing about the problem.
        found = answer if other.verdict is PlannerVerdict.REFUSED else other
        return replace(found, seconds=answer.seconds + other.seconds)

    def _search(self, search: SearchJob, *options: str) -> PlannerAnswer:
        limits = search.limits
        words = ["--format", "json", "--timeout", str(UNHURRIED_S), "--memory", str(limits.memory_mb)]
        solve = [self.command, "solve", DOMAIN_FILE, PROBLEM_FILE, *words, "--threads", str(limits.threads), *options]
        return self.run(search, solve, 2 * limits.memory_mb + THREAD_MB * limits.threads)

    def answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        plans = kairos_plans(ended.output)
        if not plans:
            return self._failed(ended, search.limits)
        best = min(plans, key=lambda plan: plan.makespan_s)
        if search.limits.makespan_s is not None and not in_time(best, search.limits.makespan_s):
            return PlannerAnswer(PlannerVerdict.SOLVED, best)  # too long for the caller
        return self._checked(best, search)

    def _failed(self, ended: ChildExit, limits: PlannerLimits) -> PlannerAnswer:
        late = replace(ended, how="late") if ended.code == 11 else ended
        out = replace(late, errors="out of memory") if ended.code == 12 else late
        verdict = _VERDICTS.get(ended.code, PlannerVerdict.FAILED)
        message = f"kairos {ended.crash}" if verdict is PlannerVerdict.FAILED else f"kairos: {_reason(ended)}"
        return self.out_of_limits(out, limits) or PlannerAnswer(verdict, message=message)

    def _checked(self, plan: PddlPlan, search: SearchJob) -> PlannerAnswer:
        (search.folder / PLAN_FILE).write_text(str(plan), "utf-8")
        command = [self.command, "validate", DOMAIN_FILE, PROBLEM_FILE, PLAN_FILE]
        ended = run(command, search.folder, VALIDATE_S, search.cancelled)
        if ended.how == "cancelled":
            return CANCELLED
        if ended.how == "by itself" and ended.code == 0:
            return PlannerAnswer(PlannerVerdict.SOLVED, plan)
        return PlannerAnswer(PlannerVerdict.INVALID, message=f"kairos does not validate its own plan: {_reason(ended)}")


@cache
def _command() -> str:
    """Return the path of the program: in its package or on the PATH."""
    try:
        own = [file.locate() for file in files("kairos-planner") or () if file.name == "kairos"]
    except PackageNotFoundError:
        own = []
    found = str(own[0]) if own else shutil.which("kairos")
    if found is None:
        install = pip_command("install", "kairos-planner>=1.0.6,<2")
        remedy = f"{install} (Linux on x86-64 or ARM), or use --planner popf"
        raise InstallationError("the planner kairos is not installed", remedy=remedy)
    return found


def kairos_plans(output: str) -> list[PddlPlan]:
    """Return the plans in the output of Kairos: complete lines of JSON."""
    written = [json.loads(line) for line in output.splitlines() if line.startswith("{") and line.endswith("}")]
    return [_plan((one["time"], *_called(one["action"]), one["duration"]) for one in plan["steps"]) for plan in written]


def _called(action: str) -> tuple[str, list[str]]:
    name, *args = action.strip("()").split()
    return name, args


def _plan(steps: Iterable[tuple[float | None, str, list[str], float | None]]) -> PddlPlan:
    """Return a plan of start times (s), names, objects and durations (s)."""
    found = (
        PlanStep(float(start or 0), name.lower(), tuple(map(str.lower, args)), float(duration or 0))
        for start, name, args, duration in steps
    )
    return PddlPlan(tuple(sorted(found, key=lambda step: step.start_s)))


def _reason(ended: ChildExit) -> str:
    """Return the first error or note without its code."""
    lines = [line.strip() for line in (ended.errors + ended.output).splitlines()]
    found = next((line for line in lines if re.search(r"\b(error|note):", line)), None)
    return re.sub(r"\s*\[[a-z_.]+\]$", "", found) if found else ended.crash


_SOLUTION = re.compile(r"^;+ *Solution Found", re.MULTILINE | re.IGNORECASE)
_STEP = re.compile(r"\s*[0-9.]+\s*:\s*\(")


class Popf(ChildPlanner):
    """POPF on the PATH, or at ``path``. Raises InstallationError if it is missing.

    It supports neither negative conditions nor derived predicates. It calls some solvable problems unsolvable, so this
    counts as no proof.
    """

    name = "popf"

    def __init__(self, path: str = "popf") -> None:
        found = shutil.which(path)
        if found is None:
            raise InstallationError(
                f"there is no program {path!r}",
                where="planner popf",
                remedy="put popf on the PATH, give its path as popf:/path/to/popf, or use the planner kairos",
            )
        self.command = str(Path(found).absolute())

    def search(self, search: SearchJob) -> PlannerAnswer:
        improve = [] if search.target_s is None else ["-n"]
        command = [self.command, *improve, DOMAIN_FILE, PROBLEM_FILE]
        return self.run(search, command, search.limits.memory_mb)

    def answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        plan = _last_plan(ended.output, whole=ended.how == "by itself")
        if plan is not None:
            return PlannerAnswer(PlannerVerdict.SOLVED, plan)
        if ended.how != "late" and "unsolvable" in ended.output.lower():
            return PlannerAnswer(
                PlannerVerdict.GAVE_UP, message="popf reports that there is no plan, which is no proof"
            )
        failed = PlannerAnswer(PlannerVerdict.FAILED, message=f"popf {ended.crash}")
        return self.out_of_limits(ended, search.limits) or failed


def _last_plan(output: str, *, whole: bool) -> PddlPlan | None:
    """Return the last plan, which is the best; after a timeout, the last complete one."""
    parts = _SOLUTION.split(output)[1:]
    for part in reversed(parts if whole else parts[:-1]):
        lines = [line for line in part.splitlines() if _STEP.match(line)]
        try:
            return parse_plan("\n".join(lines), where="popf")
        except PlanningError:
            continue
    return None


ANSWER_FILE = "answer.json"
GRACE_S = 0.5
LIBRARIES_MB = 4000
"""Address space (MB) that the library reserves beside the memory of the engine."""


class Unified(ChildPlanner):
    """Engine of unified-planning by name. Raises InstallationError without the library.

    Its start takes one or two seconds of the timeout, and engines measure elapsed time. Its reader supports less of
    PDDL. It makes one plan and does not search for a shorter one.
    """

    def __init__(self, engine: str) -> None:
        if find_spec("unified_planning") is None:
            raise InstallationError(
                "unified-planning is not installed",
                where=f"planner up:{engine}",
                remedy=f"{extra_command('up')}, or use the planner kairos",
            )
        self.engine = engine
        self.name = f"up:{engine}"

    def search(self, search: SearchJob) -> PlannerAnswer:
        if search.target_s is not None:
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} does not search for shorter plans")
        worker = python_command("-m", "socialbot.planning.planners._unified_worker", self.engine)
        command = [*worker, DOMAIN_FILE, PROBLEM_FILE, f"{search.left_s:.3f}", ANSWER_FILE]
        return self.run(search, command, search.limits.memory_mb + LIBRARIES_MB, GRACE_S)

    def answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        out = self.out_of_limits(ended, search.limits)
        if out is not None:
            return out
        if ended.code != 0:
            return PlannerAnswer(PlannerVerdict.FAILED, message=f"{self.name} {ended.crash}")
        written = json.loads(read_bytes(search.folder / ANSWER_FILE, TEXT_BYTES))
        verdict = PlannerVerdict(written["verdict"])
        if verdict is not PlannerVerdict.SOLVED:
            return PlannerAnswer(verdict, message=f"{self.name}: {written['message']}")
        return PlannerAnswer(verdict, _plan(written["steps"]))


DEFAULT = "kairos"


def make_planner(name: str = DEFAULT) -> Planner:
    """Return the planner ``kairos``, ``popf``, ``popf:/path/to/popf``, or ``up:ENGINE`` of unified-planning.

    Raises:
        ParameterError: The name is unknown.
        InstallationError: The planner is not installed.
    """
    kind, _, detail = name.partition(":")
    if name == "kairos":
        return Kairos()
    if kind == "popf":
        return Popf(detail or "popf")
    if kind == "up" and detail:
        return Unified(detail)
    raise ParameterError(f"there is no planner {name!r}", remedy="there are kairos, popf, popf:PATH and up:ENGINE")
