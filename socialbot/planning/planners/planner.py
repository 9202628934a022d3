"""Interface of planners, the check of problems before planning, and planners in child processes."""

from __future__ import annotations

import enum
import logging
import math
import os
import selectors
import signal
import subprocess
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

from socialbot.core.errors import PlanningError
from socialbot.core.process import proc_stat, with_parent
from socialbot.planning.pddl.causal_order import contributing, without_detours
from socialbot.planning.pddl.domain import SEPARATION_S, PddlDomain, PddlPlan, PddlProblem, in_time, problem_text
from socialbot.planning.pddl.formulas import Formula
from socialbot.planning.pddl.reachability import unreachable_goals
from socialbot.planning.pddl.reader import planner_text, read_problem
from socialbot.planning.pddl.restriction import KEPT_OPTIONS, with_fewer_options
from socialbot.planning.pddl.validation import PlanFault, validate_plan

POLL_S = 0.02
MAX_OUTPUT = 16_000_000
"""Bytes of output that are kept, from its end."""
RUNNABLE = "R"
"""State of a process that runs or waits for a processor."""
TICKS = os.sysconf("SC_CLK_TCK")
"""Clock ticks per second in the processor times of Linux."""


@dataclass(frozen=True, slots=True)
class ChildExit:
    """Result of a child process.

    Attributes:
        code: Exit code, or minus the number of the signal that killed it.
        seconds: Time that it has used.
    """

    how: Literal["by itself", "late", "cancelled"]
    code: int
    output: str
    errors: str
    seconds: float

    @property
    def crash(self) -> str:
        """Description of a crash, with the last lines of the error output."""
        tail = " / ".join(line.strip() for line in self.errors.splitlines()[-5:] if line.strip())[-600:]
        return f"{self._code()}: {tail}" if tail else self._code()

    def _code(self) -> str:
        if self.code >= 0:
            return f"ended with code {self.code}"
        try:
            return f"was killed by {signal.Signals(-self.code).name}"
        except ValueError:
            return f"was killed by signal {-self.code}"


def run(command: Sequence[str], folder: Path, timeout_s: float, cancelled: threading.Event) -> ChildExit:
    """Run a command until it ends, has used ``timeout_s``, or ``cancelled`` is set; then kill its process group.

    Raises OSError if it cannot be started.
    """
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        bufsize=0,
    )
    output, errors = bytearray(), bytearray()
    used = ProcessTime(process.pid)
    with process:
        try:
            how = _communicate(process, {process.stdout: output, process.stderr: errors}, used, timeout_s, cancelled)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    texts = (buffers.decode("utf-8", "replace") for buffers in (output, errors))
    return ChildExit(how, process.returncode, *texts, seconds=used.seconds)


class ProcessTime:
    """Time that a process has used, running or sleeping; elapsed time where /proc is missing."""

    def __init__(self, pid: int) -> None:
        self._process = Path(f"/proc/{pid}")
        self._looked = time.monotonic()
        self._worked = self._slept = 0.0

    @property
    def seconds(self) -> float:
        """Time (s) at the last `update`."""
        return self._worked + self._slept

    def update(self) -> float:
        now, worked = time.monotonic(), self._worked
        with suppress(OSError):  # it has just ended, or this is not Linux
            worked = sum(map(int, proc_stat(self._process)[11:13])) / TICKS
        if worked == self._worked and not self._is_runnable():
            self._slept += now - self._looked
        self._looked, self._worked = now, worked
        return self.seconds

    def _is_runnable(self) -> bool:
        try:
            return any(proc_stat(thread)[0] == RUNNABLE for thread in (self._process / "task").iterdir())
        except OSError:
            return False


def _communicate(
    process: subprocess.Popen[bytes], buffers: dict, used: ProcessTime, timeout_s: float, cancelled: threading.Event
) -> Literal["by itself", "late", "cancelled"]:
    with selectors.DefaultSelector() as selector:
        for pipe, buffer in buffers.items():
            selector.register(pipe, selectors.EVENT_READ, buffer)
        while True:
            over = process.poll() is not None
            read = _read(selector, 0.0 if over else POLL_S)
            if over and not read:
                return "by itself"
            if cancelled.is_set():
                return "cancelled"
            if used.update() >= timeout_s:
                return "late"
            if not selector.get_map():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)


def _read(selector: selectors.BaseSelector, wait_s: float) -> bool:
    any_read = False
    for key, _ in selector.select(wait_s) if selector.get_map() else []:
        data = os.read(key.fd, 1 << 16)
        if data:
            any_read = True
            key.data.extend(data)
            del key.data[:-MAX_OUTPUT]
        else:
            selector.unregister(key.fileobj)
    return any_read


class PlannerVerdict(enum.Enum):
    """Result of planning."""

    SOLVED = "solved"
    """There is a validated plan."""
    IMPOSSIBLE = "impossible"
    """There is a proof that no plan exists."""
    GAVE_UP = "gave up"
    """No plan was found within the limits; there may be one."""
    INVALID = "invalid"
    """The planner returned a plan that does not reach the goal."""
    REFUSED = "refused"
    """The problem is wrong: no goal, an unknown object, a predicate that the domain lacks."""
    FAILED = "failed"
    """The planner crashed, or its output is invalid."""
    CANCELLED = "cancelled"
    """The caller has cancelled the call."""


@dataclass(frozen=True, slots=True)
class PlannerLimits:
    """Limits of a planner.

    Attributes:
        timeout_s: Time that it may run (all threads together) or sleep. Waiting for a processor does not count, so
            the load of the machine does not change the answer.
        makespan_s: Maximum makespan of the plan.
    """

    timeout_s: float = 5.0
    memory_mb: int = 512
    threads: int = 1
    makespan_s: float | None = None


@dataclass(frozen=True, slots=True)
class PlannerAnswer:
    """Answer of a planner: the plan, or the reason for its absence, and the elapsed seconds.

    ``unreachable`` are the parts of the goal that nothing can make true, if that is why there is no plan.
    """

    verdict: PlannerVerdict
    plan: PddlPlan | None = None
    message: str = ""
    seconds: float = 0.0
    unreachable: tuple[Formula, ...] = ()


class Planner(Protocol):
    """Planner that returns validated plans. It raises nothing: errors are in the answer."""

    name: str

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event | None = None
    ) -> PlannerAnswer:
        """Block until there is an answer, or for 0.1 s after another thread has set ``cancelled``."""
        ...


def unsupported_feature(domain: PddlDomain, problem: PddlProblem) -> str | None:
    """Return why planners cannot take a problem: no goal, or names that do not fit the domain; else None."""
    if not domain.text:
        return f"the domain {domain.name} has no text to give to a planner"
    if problem.goal is None:
        return "the problem has no goal"
    try:
        read_problem(problem_text(problem, domain.constants), domain)
    except PlanningError as error:
        return error.what
    return None


log = logging.getLogger(__name__)

CANCELLED = PlannerAnswer(PlannerVerdict.CANCELLED, message="cancelled")

IMPROVED_STEPS = 200
"""Largest number of steps of a first plan for which a shorter one is looked for."""

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "problem.pddl"


@dataclass(frozen=True, slots=True)
class SearchJob:
    """Task of a planner process.

    Attributes:
        folder: Folder with the files of domain and problem.
        left_s: Remaining time (s).
        target_s: Makespan that ends an anytime search; None for the first plan.
    """

    folder: Path
    left_s: float
    limits: PlannerLimits
    cancelled: threading.Event
    target_s: float | None = None

    @property
    def half(self) -> SearchJob:
        """The same job with half of the time."""
        return replace(self, left_s=self.left_s / 2)

    def after(self, answer: PlannerAnswer) -> SearchJob:
        """Return the same job with the time left after an answer."""
        return replace(self, left_s=max(0.0, self.left_s - answer.seconds))

    def good(self, answer: PlannerAnswer) -> bool:
        return answer.plan is not None and (self.target_s is None or in_time(answer.plan, self.target_s))


class ChildPlanner(ABC):
    """Planner program with limits that reads files. If its first plan is too long, it searches for a shorter one."""

    name = ""

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event | None = None
    ) -> PlannerAnswer:
        begin = time.monotonic()
        try:
            answer = self._solve(domain, problem, limits, cancelled or threading.Event())
            if answer.plan is not None and problem.metric is None:
                answer = replace(answer, plan=without_detours(domain, problem, answer.plan))
        except Exception as error:
            log.exception("%s failed", self.name)
            answer = PlannerAnswer(PlannerVerdict.FAILED, message=f"{self.name}: {type(error).__name__}: {error}")
        return replace(answer, seconds=time.monotonic() - begin)

    @abstractmethod
    def search(self, search: SearchJob) -> PlannerAnswer:
        """Run the planner; its plan is not validated yet, and the seconds are those of the time limit."""

    def improve(self, search: SearchJob) -> PlannerAnswer | None:
        """Look for a shorter plan than the first one, which is short enough; None if the planner has no other search.

        The result must not depend on the elapsed time, unless the search takes longer than the job has.
        """
        return None

    @abstractmethod
    def answer(self, ended: ChildExit, search: SearchJob) -> PlannerAnswer:
        """Interpret the output of the program, which was not cancelled."""

    def run(self, search: SearchJob, command: list[str], memory_mb: int, grace_s: float = 0.0) -> PlannerAnswer:
        """Run the program within the limits of a search."""
        cpu_s = math.ceil(search.left_s * search.limits.threads + 2.0)
        limited = with_parent(command, limits=(memory_mb * 1_000_000, cpu_s))
        ended = run(limited, search.folder, search.left_s + grace_s, search.cancelled)
        answer = CANCELLED if ended.how == "cancelled" else self.answer(ended, search)
        return replace(answer, seconds=ended.seconds)

    def out_of_limits(self, ended: ChildExit, limits: PlannerLimits) -> PlannerAnswer | None:
        """Return the answer if the program has used up its time or memory; else None."""
        if ended.how == "late":
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} found no plan in {limits.timeout_s:g} s")
        if any(word in ended.errors.lower() for word in ("bad_alloc", "out of memory", "memoryerror")):
            return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{self.name} found no plan in {limits.memory_mb} MB")
        return None

    def _solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event
    ) -> PlannerAnswer:
        reason = unsupported_feature(domain, problem)
        if reason is not None:
            return PlannerAnswer(PlannerVerdict.REFUSED, message=reason)
        with tempfile.TemporaryDirectory(prefix="socialbot-plan-") as name:
            folder = Path(name)
            (folder / DOMAIN_FILE).write_text(planner_text(domain.text), "utf-8")
            search = SearchJob(folder, limits.timeout_s, limits, cancelled)
            answer, search = self._first(search, domain, problem)
            aimed = replace(search.after(answer), target_s=limits.makespan_s)
            if answer.verdict in (PlannerVerdict.IMPOSSIBLE, PlannerVerdict.GAVE_UP):
                return explained(answer, domain, problem)
            if answer.plan is None:
                return answer
            if aimed.good(answer):
                return self._improved(answer, aimed, domain, problem)
            # Minimize the makespan rather than the metric of the problem.
            text = problem_text(replace(problem, metric=None), domain.constants)
            (folder / PROBLEM_FILE).write_text(text, "utf-8")
            other = self._validated(self.search(aimed), domain, problem)
            direct = replace(answer, plan=without_detours(domain, problem, answer.plan))
            stopped = other.verdict in (PlannerVerdict.CANCELLED, PlannerVerdict.FAILED)
            if not stopped and not aimed.good(other) and problem.metric is None and aimed.good(direct):
                return direct
            return _shorter(answer.plan, other, aimed)

    def _first(self, search: SearchJob, domain: PddlDomain, problem: PddlProblem) -> tuple[PlannerAnswer, SearchJob]:
        """Return the first plan, with the job for the time before it. A large problem is reduced first."""
        for kept in KEPT_OPTIONS:
            reduced = with_fewer_options(domain, problem, kept)
            if reduced is None:
                break
            (search.folder / PROBLEM_FILE).write_text(problem_text(reduced, domain.constants), "utf-8")
            answer = self._validated(self.search(search.half), domain, problem)
            if answer.plan is not None or answer.verdict in (PlannerVerdict.CANCELLED, PlannerVerdict.FAILED):
                return answer, search
            search = search.after(answer)
        (search.folder / PROBLEM_FILE).write_text(problem_text(problem, domain.constants), "utf-8")
        return self._validated(self.search(search), domain, problem), search

    def _improved(
        self, answer: PlannerAnswer, search: SearchJob, domain: PddlDomain, problem: PddlProblem
    ) -> PlannerAnswer:
        """Return the answer, or that of another search if its plan is shorter."""
        plan = answer.plan
        if plan is None or search.target_s is None or problem.metric is not None or len(plan.steps) > IMPROVED_STEPS:
            return answer
        other = self.improve(search.half)
        if other is None or other.plan is None:
            return answer
        other = self._validated(other, domain, problem)
        if other.plan is None or other.plan.makespan_s >= plan.makespan_s:
            return answer
        fewer = contributing(domain, problem, other.plan)
        return other if validate_plan(domain, problem, fewer) else replace(other, plan=fewer)

    def _validated(self, answer: PlannerAnswer, domain: PddlDomain, problem: PddlProblem) -> PlannerAnswer:
        if answer.plan is None:
            return answer
        plan, faults = separated(domain, problem, answer.plan)
        if faults:
            return PlannerAnswer(PlannerVerdict.INVALID, message=f"{self.name}: {faults[0]}")
        return replace(answer, plan=plan)


def explained(answer: PlannerAnswer, domain: PddlDomain, problem: PddlProblem) -> PlannerAnswer:
    """Return an answer without a plan that names the goals that nothing can make true, if there are any."""
    goals = unreachable_goals(domain, problem)
    if not goals:
        return answer
    unreachable = tuple(goal.goal for goal in goals)
    return replace(
        answer, verdict=PlannerVerdict.IMPOSSIBLE, message="; ".join(map(str, goals)), unreachable=unreachable
    )


def separated(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> tuple[PddlPlan, tuple[PlanFault, ...]]:
    """Return a plan in which interfering events are no longer simultaneous, and its remaining faults.

    Planners call two events of one moment independent if the conditions that both touch cannot matter in this problem;
    PDDL 2.1 forbids them. Each such step is delayed by `SEPARATION_S` with all that follow it.
    """
    faults = validate_plan(domain, problem, plan)
    for _ in plan.steps:
        if not faults or not faults[0].interference or faults[0].step is None:
            break
        late = faults[0].step
        steps = enumerate(plan.steps)
        plan = PddlPlan(
            tuple(replace(one, start_s=one.start_s + SEPARATION_S) if n >= late else one for n, one in steps)
        )
        faults = validate_plan(domain, problem, plan)
    return plan, faults


def _shorter(late: PddlPlan, answer: PlannerAnswer, search: SearchJob) -> PlannerAnswer:
    """Return the answer of the second search; its makespans are not reported, as they are not reproducible."""
    if search.good(answer) or answer.verdict in (PlannerVerdict.CANCELLED, PlannerVerdict.FAILED):
        return answer
    found = f"the plan found first lasts {late.makespan_s:g} s, longer than the {search.target_s:g} s there are"
    return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{found}; none was found that is short enough")
