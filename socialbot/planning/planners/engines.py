"""The planners by name: Kairos, POPF and the engines of unified-planning."""

from __future__ import annotations

import json
import re
import shutil
import sys
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from importlib.util import find_spec
from pathlib import Path

from socialbot.core.errors import InstallationError, ParameterError, PlanningError
from socialbot.planning.pddl.domain import PddlPlan, PlanStep, in_time, parse_plan
from socialbot.planning.planners.child_process import ChildExit, guarded, run
from socialbot.planning.planners.planner import (
    DOMAIN_FILE,
    PROBLEM_FILE,
    ChildPlanner,
    Planner,
    PlannerAnswer,
    PlannerLimits,
    PlannerVerdict,
    SearchJob,
)

UNHURRIED_S = 1_000_000
"""The time that Kairos is told it has. It gives each of its searches a share by the clock on the wall, so that which of
them finds a plan would hang on how busy the machine is. We end it when it has used the time that there is."""
VALIDATE_S = 2.0
"""To check a plan takes milliseconds."""
THREAD_MB = 128
"""Address space that a thread takes without using it."""
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
    """Temporal and numeric; fast where steps are many. The same problem gets the same plan with one thread.

    Where its first plan is too long, a greedy search has half of the time to find a shorter one; it is the quickest
    at that, but blind for some. Kairos' own choice of a search has half of what is left then; if it comes to no end,
    the rest is for the search that takes begin and end of an action for two steps: slow, but it finds plans in which
    actions have to overlap.

    Raises InstallationError when Kairos is not installed.
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

    def _thorough(self, search: SearchJob, *options: str) -> PlannerAnswer:
        answer = self._search(search.half, *options)
        if search.good(answer) or answer.seconds < search.half.left_s:
            return answer
        other = self._search(search.after(answer), *options, "--engine", "m3")
        # That it has no use for what the domain uses says nothing of the problem.
        found = answer if other.verdict is PlannerVerdict.REFUSED else other
        return replace(found, seconds=answer.seconds + other.seconds)

    def _search(self, search: SearchJob, *options: str) -> PlannerAnswer:
        left_s, limits = search.left_s, search.limits
        words = ["--format", "json", "--timeout", str(UNHURRIED_S), "--memory", str(limits.memory_mb)]
        solve = [self.command, "solve", DOMAIN_FILE, PROBLEM_FILE, *words, "--threads", str(limits.threads), *options]
        command = guarded(solve, 2 * limits.memory_mb + THREAD_MB * limits.threads, left_s * limits.threads + 2.0)
        ended = run(command, search.folder, left_s, search.cancelled)
        return replace(self._answer(ended, search), seconds=ended.seconds)

    def _answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        """What a search came to."""
        if ended.how == "cancelled":
            return PlannerAnswer(PlannerVerdict.CANCELLED, message="cancelled")
        plans = _plans(ended.output)
        if not plans:
            return _without(ended, search.limits)
        best = min(plans, key=lambda plan: plan.makespan_s)
        if search.limits.makespan_s is not None and not in_time(best, search.limits.makespan_s):
            return PlannerAnswer(PlannerVerdict.SOLVED, best)  # nobody will use it
        return self._checked(best, search)

    def _checked(self, plan: PddlPlan, search: SearchJob) -> PlannerAnswer:
        """``plan``, when the validator of Kairos agrees too."""
        (search.folder / PLAN_FILE).write_text(str(plan), "utf-8")
        command = [self.command, "validate", DOMAIN_FILE, PROBLEM_FILE, PLAN_FILE]
        ended = run(command, search.folder, VALIDATE_S, search.cancelled)
        if ended.how == "cancelled":
            return PlannerAnswer(PlannerVerdict.CANCELLED, message="cancelled")
        if ended.how == "by itself" and ended.code == 0:
            return PlannerAnswer(PlannerVerdict.SOLVED, plan)
        return PlannerAnswer(PlannerVerdict.INVALID, message=f"kairos does not validate its own plan: {_reason(ended)}")


@cache
def _command() -> str:
    """Where it lies: with its package, wherever that was installed, or on the PATH. Raises InstallationError."""
    try:
        own = [file.locate() for file in files("kairos-planner") or () if file.name == "kairos"]
    except PackageNotFoundError:
        own = []
    found = str(own[0]) if own else shutil.which("kairos")
    if found is None:
        raise InstallationError(
            "the planner kairos is not installed",
            remedy="pip install 'kairos-planner>=1.0.6,<2' (Linux on x86-64 or ARM), or use --planner popf",
        )
    return found


def _plans(output: str) -> list[PddlPlan]:
    """The plans that it has written, one a line; what is no whole line is none."""
    return [_plan(json.loads(line)) for line in output.splitlines() if line.startswith("{") and line.endswith("}")]


def _plan(written: dict) -> PddlPlan:
    steps = []
    for step in written["steps"]:
        name, *args = step["action"].strip("()").lower().split()
        steps.append(PlanStep(_seconds(step["time"]), name, tuple(args), _seconds(step["duration"])))
    return PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))


def _seconds(number: float | None) -> float:
    """A time without the noise of its last digits."""
    return round(float(number or 0.0), 6)


def _without(ended: ChildExit, limits: PlannerLimits) -> PlannerAnswer:
    """What it means that there is no plan."""
    if ended.how == "late" or ended.code == 11:
        return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"kairos found no plan in {limits.timeout_s:g} s")
    if ended.code == 12 or "bad_alloc" in ended.errors:
        return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"kairos found no plan in {limits.memory_mb} MB")
    verdict = _VERDICTS.get(ended.code, PlannerVerdict.FAILED)
    if verdict is PlannerVerdict.FAILED:
        return PlannerAnswer(verdict, message=f"kairos {ended.death}")
    return PlannerAnswer(verdict, message=f"kairos: {_reason(ended)}")


def _reason(ended: ChildExit) -> str:
    """The first error or note that it wrote, without the code at its end."""
    lines = [line.strip() for line in (ended.errors + ended.output).splitlines()]
    found = next((line for line in lines if re.search(r"\b(error|note):", line)), None)
    return re.sub(r"\s*\[[a-z_.]+\]$", "", found) if found else ended.death


_SOLUTION = re.compile(r"^;+ *Solution Found", re.MULTILINE | re.IGNORECASE)
_STEP = re.compile(r"\s*[0-9.]+\s*:\s*\(")


class Popf(ChildPlanner):
    """Runs ``popf``, or the program at ``path``. Raises InstallationError when there is none.

    It knows no negative conditions and no derived predicates. That it calls a problem unsolvable is no proof:
    it says so of some that can be solved.
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
        left_s, limits = search.left_s, search.limits
        command = guarded(
            [self.command, *improve, DOMAIN_FILE, PROBLEM_FILE],
            limits.memory_mb,
            left_s * limits.threads + 2.0,
        )
        ended = run(command, search.folder, left_s, search.cancelled)
        return replace(self._answer(ended, search.limits), seconds=ended.seconds)

    def _answer(self, ended: ChildExit, limits: PlannerLimits) -> PlannerAnswer:
        """What a search came to."""
        if ended.how == "cancelled":
            return PlannerAnswer(PlannerVerdict.CANCELLED, message="cancelled")
        plan = _last_plan(ended.output, whole=ended.how == "by itself")
        if plan is not None:
            return PlannerAnswer(PlannerVerdict.SOLVED, plan)
        if ended.how == "late":
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"popf found no plan in {limits.timeout_s:g} s")
        if "unsolvable" in ended.output.lower():
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message="popf says that there is no plan, which is no proof")
        if "bad_alloc" in ended.errors or "out of memory" in ended.errors.lower():
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"popf found no plan in {limits.memory_mb} MB")
        return PlannerAnswer(PlannerVerdict.FAILED, message=f"popf {ended.death}")


def _last_plan(output: str, *, whole: bool) -> PddlPlan | None:
    """The last of the plans it wrote, which is the best; if it was cut short, the last that is surely whole."""
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
"""Address space that the library and what it brings may take beside the memory of the engine; most is never used."""


class Unified(ChildPlanner):
    """The engine that unified-planning knows by the name ``engine``. Raises InstallationError without the library.

    Starting it takes a second or two, within the time there is, and engines go by the clock on the wall. Its reader of
    PDDL refuses some of what ours takes. It is asked for one plan: it does not search for a shorter one.
    """

    def __init__(self, engine: str) -> None:
        if find_spec("unified_planning") is None:
            raise InstallationError(
                "unified-planning is not installed",
                where=f"planner up:{engine}",
                remedy="pip install 'socialbot[up]', or use the planner kairos",
            )
        self.engine = engine
        self.name = f"up:{engine}"

    def search(self, search: SearchJob) -> PlannerAnswer:
        if search.target_s is not None:
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} does not search for shorter plans")
        left_s, limits = search.left_s, search.limits
        worker = [sys.executable, "-m", "socialbot.planning.planners.unified_worker", self.engine]
        command = guarded(
            [*worker, DOMAIN_FILE, PROBLEM_FILE, f"{left_s:.3f}", ANSWER_FILE],
            limits.memory_mb + LIBRARIES_MB,
            left_s * limits.threads + 2.0,
        )
        ended = run(command, search.folder, left_s + GRACE_S, search.cancelled)
        return replace(self._answer(ended, search), seconds=ended.seconds)

    def _answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        """What a search came to."""
        limits = search.limits
        if ended.how == "cancelled":
            return PlannerAnswer(PlannerVerdict.CANCELLED, message="cancelled")
        if ended.how == "late":
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} found no plan in {limits.timeout_s:g} s")
        if "MemoryError" in ended.errors or "bad_alloc" in ended.errors:
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} found no plan in {limits.memory_mb} MB")
        if ended.code != 0:
            return PlannerAnswer(PlannerVerdict.FAILED, message=f"{self.name} {ended.death}")
        return self._told(json.loads((search.folder / ANSWER_FILE).read_text("utf-8")))

    def _told(self, written: dict) -> PlannerAnswer:
        verdict = PlannerVerdict(written["verdict"])
        if verdict is not PlannerVerdict.SOLVED:
            return PlannerAnswer(verdict, message=f"{self.name}: {written['message']}")
        steps = [
            PlanStep(round(start, 6), name.lower(), tuple(arg.lower() for arg in args), round(duration, 6))
            for start, name, args, duration in written["steps"]
        ]
        return PlannerAnswer(verdict, PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s))))


DEFAULT = "kairos"


def make_planner(name: str = DEFAULT) -> Planner:
    """The planner called ``kairos``, ``popf``, ``popf:/path/to/popf``, or ``up:ENGINE`` for one of unified-planning.

    Raises ParameterError for another name, InstallationError when it is not installed.
    """
    kind, _, detail = name.partition(":")
    if name == "kairos":
        return Kairos()
    if kind == "popf":
        return Popf(detail or "popf")
    if kind == "up" and detail:
        return Unified(detail)
    raise ParameterError(f"there is no planner {name!r}", remedy="there are kairos, popf, popf:PATH and up:ENGINE")
