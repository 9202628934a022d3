"""An office with jobs: a deliberator in simulated time, a small domain, and a scripted planner."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from socialbot.core.clock import ManualClock
from socialbot.deliberation._action_executor import IsSensed
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.messages import Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import And, Predicate
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerLimits, PlannerVerdict
from tests.deliberation.stage import Scene, facts

JOBS = read_domain(
    """
    (define (domain jobs)
      (:requirements :typing :durative-actions :fluents :negative-preconditions)
      (:types job - object)
      (:predicates (done ?j - job) (begun ?j - job) (ready) (quiet) (lit) (told))
      (:functions (level ?j - job))
      (:durative-action do :parameters (?j - job) :duration (= ?duration 6)
        :condition (at start (not (done ?j)))
        :effect (and (at start (begun ?j)) (at end (done ?j)) (at end (not (begun ?j)))))
      (:durative-action prepare :parameters () :duration (= ?duration 2)
        :condition (at start (not (ready))) :effect (at end (ready)))
      (:durative-action hush :parameters () :duration (= ?duration 1)
        :condition (at start (not (quiet))) :effect (at end (quiet)))
      (:durative-action light :parameters () :duration (= ?duration 1)
        :condition (at start (not (lit))) :effect (at end (lit)))
      (:durative-action report :parameters (?j - job) :duration (= ?duration 1)
        :condition (at start (done ?j)) :effect (at end (told))))
    """,
    where="jobs",
)
ACTIONS = {"done": ("do", 6.0), "ready": ("prepare", 2.0), "quiet": ("hush", 1.0), "lit": ("light", 1.0)}

Reply = PlannerAnswer | Exception | str | None
"""What a planner answers; None: it plans as it always does."""


class Clerk:
    """Plan one step per missing goal, in order. ``script`` overrides the answer to a problem."""

    name = "clerk"

    def __init__(self) -> None:
        self.script: Callable[[PddlProblem], Reply] = lambda problem: None
        self.asked: list[str] = []
        self.limits: list[PlannerLimits] = []
        self.cancelled: list[threading.Event] = []

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: threading.Event | None = None
    ) -> PlannerAnswer:
        self.asked.append(str(problem.goal))
        self.limits.append(limits)
        self.cancelled.append(cancelled or threading.Event())
        reply = self.script(problem)
        if isinstance(reply, Exception):
            raise reply
        return reply or self.plan(problem)  # type: ignore[return-value] - planners may be wrong in any way

    def plan(self, problem: PddlProblem) -> PlannerAnswer:
        assert isinstance(problem.goal, And)
        steps, time = [], 0.0
        for wanted in problem.goal.parts:
            if not isinstance(wanted, Predicate) or wanted.name not in ACTIONS:
                return PlannerAnswer(PlannerVerdict.IMPOSSIBLE, message=f"nothing brings about {wanted}")
            if wanted not in problem.facts:
                action, duration = ACTIONS[wanted.name]
                steps.append(PlanStep(round(time, 3), action, wanted.terms, duration))
                time += duration + 0.001
        return PlannerAnswer(PlannerVerdict.SOLVED, PddlPlan(tuple(steps)))


class Office(Scene):
    """Test bench of a deliberator. With ``slow`` planning, plans arrive when `answer` is called."""

    def __init__(
        self,
        *,
        beliefs: str = "instance a job; instance b job; instance c job; instance d job",
        domain: PddlDomain = JOBS,
        planner: Planner | None = None,
        slow: bool = False,
        observer: Any = None,
        is_sensed: IsSensed = lambda name, objects: False,
        clock: ManualClock | None = None,
        **options: Any,
    ) -> None:
        lasts_s = {"do": 6.0, "prepare": 2.0, "hush": 1.0, "light": 1.0, "report": 1.0}
        super().__init__("clerk", domain, lasts_s, clock)
        self.clerk = Clerk()
        self.pending: list[Callable[[], None]] = []
        self.ends: list[tuple[str, str, str]] = []
        self.deliberator = Deliberator(
            self.engine,
            domain,
            planner or self.clerk,
            self._later if slow else self._aside,
            options=DeliberationOptions(**options),
            observer=observer,
            is_sensed=is_sensed,
        )
        self.facts = self.deliberator.facts
        for known in facts(beliefs):
            self.facts.add(known)
        self.engine.run_until_idle()

    def _aside(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        try:
            then(work())
        except Exception as error:  # noqa: BLE001 - as a runner does
            then(error)

    def _later(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        self.pending.append(lambda: self._aside(work, then))

    def answer(self) -> None:
        """Lets the planner answer what it was asked first."""
        self.pending.pop(0)()
        self.engine.run_until_idle()

    def want(self, *desires: Desire, cause: str = "test") -> list[str]:
        """Adopts desires at once; returns why not."""
        replies: list[str] = []

        def adopt() -> None:
            for desire in desires:
                listener = lambda how, reason, name=desire.name: self.ends.append((name, how, reason))  # noqa: E731
                replies.append(self.deliberator.desire(desire, cause=cause, listener=listener))

        self.run(adopt)
        return replies

    def believe(self, *texts: str) -> None:
        self.run(lambda: [self.facts.add(fact, source="percept") for text in texts for fact in facts(text)])

    def forget(self, *texts: str) -> None:
        self.run(lambda: [self.facts.remove(fact) for text in texts for fact in facts(text)])

    @property
    def wants(self) -> list[str]:
        return [state.name for state in self.deliberator.desires]

    @property
    def pursued(self) -> str | None:
        state = self.deliberator.pursuit.current
        return None if state is None else state.name

    def begun(self) -> list[tuple[float, str]]:
        """Return the started actions with their times."""
        return [(time, call) for time, what, call in self.timeline if what == "begins"]

    def found(self, kind: str, what: str | None = None) -> list[Any]:
        """Records of the trace."""
        return self.trace.find(kind, what)

    def plans(self) -> list[tuple[str, str]]:
        """Return the desire and the outcome of each ended plan."""
        return [(record.what, str(record.detail["outcome"])) for record in self.found("plan_end")]


class Watcher:
    """Observer that records its notifications."""

    def __init__(self) -> None:
        self.statuses: list[tuple[str, str]] = []
        self.beliefs = 0
        self.desires = 0
        self.infos: list[PlanExecutionInfo] = []

    def beliefs_changed(self) -> None:
        self.beliefs += 1

    def desires_changed(self) -> None:
        self.desires += 1

    def plan_changed(self, info: PlanExecutionInfo) -> None:
        self.infos.append(info)

    def status_changed(self, status: str, reason: str) -> None:
        self.statuses.append((status, reason))


def job(name: str, priority: float = 0.5, deadline: float = 60.0, **more: Any) -> Desire:
    """The desire that a job is done."""
    more.setdefault("value", (Fact(name="done", params=(name,)),))
    return Desire(name=name, priority=priority, deadline=deadline, **more)


def office_for(*desires: Desire, until: float = 0.0, **options: Any) -> Office:
    """An office that has adopted desires at once, after some seconds."""
    office = Office(**options)
    office.want(*desires)
    office.until(until)
    return office
