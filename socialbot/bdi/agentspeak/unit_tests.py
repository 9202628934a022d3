"""Unit tests in AgentSpeak: plans with the annotation ``test``, each run by an agent of its own in simulated time.

A test passes if its goal is achieved. Programs in the style of Jason's test library, whose assertions report their
results as beliefs ``test(Plan, passed, File, Line)``, fail also if one of these says ``failed``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from socialbot.bdi.agentspeak.loading import begin, library_of, problems_of
from socialbot.bdi.agentspeak.programs import IncludePaths, Program, read_program
from socialbot.bdi.engine import Engine
from socialbot.bdi.intentions import Failure
from socialbot.bdi.literals import Change, Literal, ground
from socialbot.bdi.plans import Plan
from socialbot.bdi.society import Society
from socialbot.bdi.terms import Atom
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import RuleError

MANAGER = "test_manager"
"""Agent to which Jason's test library reports; here it ignores all messages."""

MAX_TURNS = 3_000
"""Limit of the turns of all agents without progress of time, which ends an endless test."""

RUNNERS = frozenset({"execute_test_plans", "setup_manager"})
"""Initial goals of Jason's test library that would run all tests."""


@dataclass(frozen=True)
class UnitTest:
    """Test of a file: the plan of a goal without arguments."""

    file: Path
    plan: Plan

    @property
    def name(self) -> str:
        return self.plan.event.literal.functor

    @property
    def line(self) -> int:
        return 0 if self.plan.origin is None else self.plan.origin.line


@dataclass
class TestResult:
    """Result of a test: why it failed (empty if it passed), its duration in simulated time, and its output."""

    __test__ = False

    test: UnitTest
    reasons: list[str] = field(default_factory=list)
    assertions: int = 0
    seconds: float = 0.0
    output: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        return not self.reasons


class TestFile:
    """Program with tests.

    Args:
        file: The program.
        paths: The places of included files, and of the files of agents that tests create.

    Raises:
        AgentSpeakError: The program has a mistake.
        RuleError: The file cannot be read, or a test has arguments.
    """

    __test__ = False

    def __init__(self, file: Path, paths: IncludePaths) -> None:
        self.file = file
        self.paths = paths
        self.program = load(file, paths)
        self.tests = list(self._find())

    def _find(self) -> Iterator[UnitTest]:
        known = set()
        for plan in self.program.plans:
            goal = plan.event.literal
            if Atom("test") not in plan.annotations or plan.event.change is not Change.WANTED:
                continue
            if not isinstance(goal, Literal) or not ground(goal.args) or goal.args:
                raise RuleError(
                    f"the test {plan.event} has arguments",
                    where=str(plan.origin or self.file),
                    remedy="let the test be a goal without arguments, which adopts the goal with arguments",
                )
            if goal.functor not in known:
                known.add(goal.functor)
                yield UnitTest(self.file, plan)

    def run(self, test: UnitTest, seconds: float = 60.0) -> TestResult:
        """Run one test, at most for ``seconds`` of simulated time."""
        return _Run(self, test, seconds).result


class _Run:
    """Run of a test by a fresh agent in a fresh society."""

    def __init__(self, file: TestFile, test: UnitTest, seconds: float) -> None:
        self.file = file
        self.result = TestResult(test)
        self.clock = ManualClock()
        self.society = Society(self.clock)
        self.society.starter = self._start
        self.society.include_paths = replace(file.paths, folders=(file.file.parent, *file.paths.folders))
        manager = self.society.add(Engine(MANAGER, self.clock))
        manager.messaging.accepts = lambda *_: False
        agent = self._agent(file.file.stem, file.program)
        self.society.add(agent)
        agent.beliefs.watch("test/4", self._asserted)
        self._begin(agent, file.program)
        self.society.run_until_idle(MAX_TURNS, turns=1)
        self.ended = False
        agent.call(lambda: agent.attempt(test.plan.event.literal, self._end) and None)
        self._advance(round(seconds * SECOND))
        self.result.seconds = self.clock.now() / SECOND
        if not self.ended:
            self.result.reasons.append(f"not achieved in {seconds:g} s")

    def _advance(self, end: int) -> None:
        """Run until the goal has ended and all agents are idle."""
        while not self.society.stopping:
            if self.society.run_until_idle(MAX_TURNS, turns=1) and not self.ended:
                self.result.reasons.append("endless: the agents never become idle")
                self.ended = True
                return
            due = self.society.next_wakeup()
            if due is None or due > end:
                self.clock.set(end if due is not None or not self.ended else self.clock.now())
                return
            self.clock.set(max(due, self.clock.now()))

    def _end(self, failure: Failure | None) -> None:
        self.ended = True
        if failure is not None:
            printed = [line for line in self.result.output if "FAILED" in line]
            message = printed[-1] if printed else failure.message
            if failure.reason == "no_relevant" and "assert" in failure.step:
                message += "; include the library with the assertions, or write a comparison as a step, such as X == 3"
            self.result.reasons.append(f"{message}{f' ({failure.where})' if failure.where else ''}")

    def _asserted(self, args: tuple[Any, ...], held: bool, cause: Any) -> None:
        """Count an assertion of Jason's test library, and tell the line that it printed if it has failed."""
        if held:
            self.result.assertions += 1
            if args[1] is Atom("failed"):
                lines = [line for line in self.result.output if "FAILED" in line]
                self.result.reasons.append(lines[-1] if lines else "an assertion failed")

    # Agents

    def _agent(self, name: str, program: Program | None) -> Engine:
        engine = Engine(name, self.clock, library=None if program is None else library_of(program))
        engine.out = self.result.output.append
        return engine

    def _begin(self, engine: Engine, program: Program) -> None:
        goals = tuple(goal for goal in program.goals if goal.functor not in RUNNERS)
        begin(engine, replace(program, goals=goals))

    def _start(self, name: str, file: str | None, creator: Engine) -> Engine:
        """Make an agent of `.create_agent`."""
        if file is None:
            return self._agent(name, None)
        program = load(self.file.paths.find(file, self.file.file), self.file.paths)
        engine = self._agent(name, program)
        self._begin(engine, program)
        return engine


def load(file: Path, paths: IncludePaths) -> Program:
    """Read and check a program. Raises AgentSpeakError for its first mistake."""
    program = read_program(file, paths)
    problems = problems_of(program)
    if problems:
        raise problems[0]
    return program


def programs_in(paths: list[Path]) -> list[Path]:
    """Programs among files and folders. Raises RuleError for a path that does not exist."""
    found: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            found.update(dict.fromkeys(sorted(path.rglob("*.asl"))))
        elif path.is_file():
            found[path] = None
        else:
            raise RuleError(f"{path} does not exist", remedy="name a program, or a folder with programs")
    return list(found)
