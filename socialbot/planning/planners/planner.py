"""The planner interface, the problems that planners cannot take, and planners that run in child processes."""

from __future__ import annotations

import enum
import logging
import math
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, Signature, in_time, problem_text
from socialbot.planning.pddl.formulas import (
    And,
    Arithmetic,
    Equality,
    Expression,
    Fluent,
    Formula,
    Not,
    NumericComparison,
    Or,
    Predicate,
    Quantified,
)
from socialbot.planning.pddl.validation import validate_plan


class PlannerVerdict(enum.Enum):
    """What came of planning."""

    SOLVED = "solved"
    """There is a plan, and it was validated."""
    IMPOSSIBLE = "impossible"
    """It is proved that there is no plan."""
    GAVE_UP = "gave up"
    """No plan was found within the limits of time and memory; there may be one."""
    INVALID = "invalid"
    """The planner made a plan that does not do what is asked for."""
    REFUSED = "refused"
    """The problem cannot be asked: it has no goal, an unknown object, a predicate that the domain does not have."""
    FAILED = "failed"
    """The planner died, or said something that makes no sense."""
    CANCELLED = "cancelled"
    """Nobody wants to know any more."""


@dataclass(frozen=True, slots=True)
class PlannerLimits:
    """How much a planner may use. ``makespan_s`` is how long the plan may last; longer ones are no use.

    ``timeout_s`` is how long it may work, all threads together, or sleep. While others have the processor no time
    passes, so that the same problem gets the same answer however busy the machine is.
    """

    timeout_s: float = 5.0
    memory_mb: int = 512
    threads: int = 1
    makespan_s: float | None = None


@dataclass(frozen=True, slots=True)
class PlannerAnswer:
    """What came of planning: the plan if it is `PlannerVerdict.SOLVED`, else why not, and the seconds it took."""

    verdict: PlannerVerdict
    plan: PddlPlan | None = None
    message: str = ""
    seconds: float = 0.0


class Planner(Protocol):
    """Finds plans. Every plan it returns has been validated; it raises nothing: what goes wrong is in the answer."""

    name: str

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event | None = None
    ) -> PlannerAnswer:
        """Blocks until there is an answer; setting ``cancelled`` (from another thread) ends that within 0.1 s."""
        ...


Types = tuple[str, ...]


def unsupported_feature(domain: PddlDomain, problem: PddlProblem) -> str | None:
    """The first thing that is wrong with ``problem``: no goal, or a name that does not fit the domain; else None."""
    return next(_Asked(domain, problem).mistakes(), None)


class _Asked:
    def __init__(self, domain: PddlDomain, problem: PddlProblem) -> None:
        self.domain = domain
        self.problem = problem
        self.objects: Mapping[str, Types] = {**domain.constants, **problem.objects}

    def mistakes(self) -> Iterator[str]:
        if not self.domain.text:
            yield f"the domain {self.domain.name} has no text to give to a planner"
        if self.problem.goal is None:
            yield "the problem has no goal"
            return
        if self.problem.domain != self.domain.name:
            yield f"the problem is for the domain {self.problem.domain!r}, not for {self.domain.name!r}"
        for name, types in self.problem.objects.items():
            yield from (f"{name} is of an unknown type {kind!r}" for kind in types if kind not in self.domain.types)
        for predicate in sorted(self.problem.facts, key=str):
            yield from self._atom("predicate", self.domain.predicates, predicate.name, predicate.terms, {})
        for fluent, value in self.problem.values.items():
            yield from self._atom("function", self.domain.functions, fluent.function, fluent.terms, {})
            if not math.isfinite(value):
                yield f"{_spelled(fluent.function, fluent.terms)} is {value}"
        yield from (f"in the goal: {mistake}" for mistake in self._formula(self.problem.goal, {}))

    def _formula(self, formula: Formula, variables: Mapping[str, Types]) -> Iterator[str]:
        match formula:
            case Predicate(name, terms):
                known = {**self.domain.predicates, **self._derived()}
                yield from self._atom("predicate", known, name, terms, variables)
            case Equality(left, right):
                for term in (left, right):
                    if self._types(term, variables) is None:
                        yield f"unknown object {term!r}"
            case NumericComparison(_, left, right):
                for side in (left, right):
                    yield from self._expression(side, variables)
            case Not(part):
                yield from self._formula(part, variables)
            case And(parts) | Or(parts):
                for part in parts:
                    yield from self._formula(part, variables)
            case Quantified(_, bound, part):
                for typed in bound:
                    yield from (f"unknown type {kind!r}" for kind in typed.types if kind not in self.domain.types)
                yield from self._formula(part, {**variables, **{typed.name: typed.types for typed in bound}})

    def _expression(self, expression: Expression, variables: Mapping[str, Types]) -> Iterator[str]:
        match expression:
            case Fluent(function, terms):
                yield from self._atom("function", self.domain.functions, function, terms, variables)
            case Arithmetic(_, parts):
                for part in parts:
                    yield from self._expression(part, variables)

    def _derived(self) -> dict[str, Signature]:
        return {name: Signature(name, parameters) for name, (parameters, _) in self.domain.derived.items()}

    def _atom(
        self, kind: str, known: Mapping[str, Signature], name: str, terms: Types, variables: Mapping[str, Types]
    ) -> Iterator[str]:
        if name not in known:
            yield f"the domain {self.domain.name} has no {kind} {name!r}"
            return
        spelled = _spelled(name, terms)
        parameters = known[name].parameters
        if len(terms) != len(parameters):
            yield f"{spelled} has {len(terms)} arguments, not {len(parameters)}"
            return
        for term, parameter in zip(terms, parameters, strict=True):
            types = self._types(term, variables)
            if types is None:
                yield f"{spelled}: unknown object {term!r}"
            elif not self._fits(types, parameter.types):
                yield f"{spelled}: {term} is a {'|'.join(types)}, not a {'|'.join(parameter.types)}"

    def _types(self, term: str, variables: Mapping[str, Types]) -> Types | None:
        return variables.get(term) if term.startswith("?") else self.objects.get(term)

    def _fits(self, types: Types, wanted: Types) -> bool:
        return all(any(self.domain.is_a(kind, of) for of in wanted) for kind in types)


def _spelled(name: str, terms: Types) -> str:
    return f"({' '.join((name, *terms))})"


log = logging.getLogger(__name__)

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "problem.pddl"


@dataclass(frozen=True, slots=True)
class SearchJob:
    """What a planner is to do: the domain and the problem lie in ``folder``; it has ``left_s`` (s) for that.

    ``target_s`` is the makespan that ends a search for ever shorter plans; None asks for the first plan.
    """

    folder: Path
    left_s: float
    limits: PlannerLimits
    cancelled: threading.Event
    target_s: float | None = None

    @property
    def half(self) -> SearchJob:
        """The same with half of the time."""
        return replace(self, left_s=self.left_s / 2)

    def after(self, answer: PlannerAnswer) -> SearchJob:
        """The same with the time that a search left that came to ``answer``."""
        return replace(self, left_s=max(0.0, self.left_s - answer.seconds))

    def good(self, answer: PlannerAnswer) -> bool:
        """Whether a plan is there that ends in time."""
        return answer.plan is not None and (self.target_s is None or in_time(answer.plan, self.target_s))


class ChildPlanner(ABC):
    """A planner that is asked by files and answers with plans; see `socialbot.planning.planners.planner.Planner`.

    Its first plan is taken if it lasts no longer than it may. Else the planner searches on for a shorter one.
    """

    name = ""

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event | None = None
    ) -> PlannerAnswer:
        """Blocks until there is an answer; setting ``cancelled`` (from another thread) ends that within 0.1 s."""
        begin = time.monotonic()
        try:
            answer = self._solve(domain, problem, limits, cancelled or threading.Event())
        except Exception as error:
            log.exception("%s failed", self.name)
            answer = PlannerAnswer(PlannerVerdict.FAILED, message=f"{self.name}: {type(error).__name__}: {error}")
        return replace(answer, seconds=time.monotonic() - begin)

    @abstractmethod
    def search(self, search: SearchJob) -> PlannerAnswer:
        """Runs the planner. `PlannerVerdict.SOLVED` means here that it says so; nothing is validated or compared yet.

        The seconds of the answer are those that were used of what was left.
        """

    def _solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event
    ) -> PlannerAnswer:
        reason = unsupported_feature(domain, problem)
        if reason is not None:
            return PlannerAnswer(PlannerVerdict.REFUSED, message=reason)
        with tempfile.TemporaryDirectory(prefix="socialbot-plan-") as name:
            folder = Path(name)
            (folder / DOMAIN_FILE).write_text(domain.text, "utf-8")
            (folder / PROBLEM_FILE).write_text(problem_text(problem, domain.constants), "utf-8")
            search = SearchJob(folder, limits.timeout_s, limits, cancelled)
            answer = self._validated(self.search(search), domain, problem)
            aimed = replace(search.after(answer), target_s=limits.makespan_s)
            if answer.plan is None or aimed.good(answer):
                return answer
            # What is minimized now is the makespan, whatever the problem says.
            text = problem_text(replace(problem, metric=None), domain.constants)
            (folder / PROBLEM_FILE).write_text(text, "utf-8")
            return _shorter(answer.plan, self._validated(self.search(aimed), domain, problem), aimed)

    def _validated(self, answer: PlannerAnswer, domain: PddlDomain, problem: PddlProblem) -> PlannerAnswer:
        """``answer``, or that its plan is invalid, by our own judgement."""
        if answer.plan is None:
            return answer
        found = validate_plan(domain, problem, answer.plan)
        return PlannerAnswer(PlannerVerdict.INVALID, message=f"{self.name}: {found[0]}") if found else answer


def _shorter(late: PddlPlan, answer: PlannerAnswer, search: SearchJob) -> PlannerAnswer:
    """What the search for a plan shorter than ``late`` came to.

    It says of no other plan how long it lasts: how far a search came in its time is not the same twice.
    """
    if search.good(answer) or answer.verdict in (PlannerVerdict.CANCELLED, PlannerVerdict.FAILED):
        return answer
    found = f"the plan found first lasts {late.makespan_s:g} s, longer than the {search.target_s:g} s there are"
    return PlannerAnswer(PlannerVerdict.GAVE_UP, message=f"{found}; none was found that is short enough")
