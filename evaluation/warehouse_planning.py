"""Times for planning in the warehouse, and for choosing among many desires."""

from __future__ import annotations

import random
import resource
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Event
from typing import Any
from unittest import mock

from evaluation.warehouse_runs import Story, play
from socialbot.agents.base import deliberating
from socialbot.agents.warehouse.demo import scenario_with
from socialbot.agents.warehouse.scenario import GRIPPER, GRIPPER_DOMAIN, gripper_beliefs, gripper_desires
from socialbot.bdi import Engine
from socialbot.core.clock import ManualClock
from socialbot.deliberation.deliberator import Deliberator
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import Desire, Dnf, Fact, FactCondition, FactConjunction
from socialbot.deliberation.sensing import instance
from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import Planner, PlannerAnswer, PlannerLimits, PlannerVerdict

PLANNER = "kairos"
GRIPPER_DOMAIN_NAME = "gripper-domain"

THINGS = """
(define (domain things)
  (:requirements :strips :typing :durative-actions)
  (:types thing - object)
  (:predicates (ready ?t - thing) (done ?t - thing) (calm))
  (:durative-action finish
    :parameters (?t - thing)
    :duration (= ?duration 5)
    :condition (at start (ready ?t))
    :effect (at end (done ?t))))
"""


@dataclass(frozen=True)
class Question:
    """Planning problem."""

    domain: PddlDomain
    problem: PddlProblem
    limits: PlannerLimits


@dataclass
class Planning:
    """Durations of each planning: wall s, and processor s including the planner's process."""

    steps: int = 0
    makespan_s: float = 0.0
    walls: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)

    @property
    def best_s(self) -> float:
        return round(min(self.walls), 4)

    @property
    def median_s(self) -> float:
        return round(statistics.median(self.walls), 4)

    @property
    def processor_s(self) -> float:
        return round(min(self.processor), 4)


def plan_by_turns(questions: Mapping[str, Question], times: int) -> dict[str, Planning]:
    """Plan each question ``times`` times by turns, each in its own process, as agents do.

    Raises:
        ValueError: There is no plan.
    """
    planner = make_planner(PLANNER)
    found = {name: Planning() for name in questions}
    for _ in range(times):
        for name, question in questions.items():
            begun, spent = time.perf_counter(), _processor_s()
            answer = planner.solve(question.domain, question.problem, question.limits)
            found[name].walls.append(time.perf_counter() - begun)
            found[name].processor.append(_processor_s() - spent)
            if answer.plan is None:
                raise ValueError(f"no plan for {name}: {answer.verdict.value}: {answer.message}")
            found[name].steps, found[name].makespan_s = len(answer.plan.steps), answer.plan.makespan_s
    return found


def first_question(boxes: int) -> Question:
    """Return the gripper's first problem with ``boxes`` boxes."""
    domain = read_domain(GRIPPER_DOMAIN.read_text("utf-8"), where=str(GRIPPER_DOMAIN))
    cast = scenario_with(boxes)
    facts = FactBase(Engine(GRIPPER, ManualClock()), domain)
    for fact in gripper_beliefs(cast):
        facts.add(fact)
    (desire,) = gripper_desires(cast)
    return Question(domain, facts.problem(facts.goal(desire.wanted)), PlannerLimits(makespan_s=desire.deadline))


def second_question() -> Question:
    """Return the problem of the gripper's new plan in run 2, after it finds a carrier missing."""
    listener = _Listener(make_planner(PLANNER))
    with mock.patch.object(deliberating, "make_planner", return_value=listener):
        play(Story(run=2))
    return [question for question in listener.solved if question.domain.name == GRIPPER_DOMAIN_NAME][1]


@dataclass
class _Listener:
    planner: Planner
    name: str = "listener"
    solved: list[Question] = field(default_factory=list)

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: Event | None = None
    ) -> PlannerAnswer:
        answer = self.planner.solve(domain, problem, limits, cancelled)
        if answer.plan is not None:
            self.solved.append(Question(domain, problem, limits))
        return answer


@dataclass(frozen=True)
class Deciding:
    """Processor ms of a decision: median and maximum."""

    median_ms: float
    worst_ms: float


def decisions(desires: int, times: int) -> dict[str, Deciding]:
    """Measure the time of an agent from a belief change to its choice of a desire.

    The belief is part of the precondition of ``one`` desire, or of ``all``.
    """
    deliberator = _undecided(desires)
    chance = random.Random("decisions")
    return {
        "one": _decide(deliberator, times, lambda: predicate_of(chance.randrange(desires))),
        "all": _decide(deliberator, times, lambda: Fact(name="calm")),
    }


def predicate_of(number: int) -> Fact:
    """Return the belief that enables one of the desires."""
    return Fact(name="ready", params=(f"t{number}",))


def _decide(deliberator: Deliberator, times: int, change: Callable[[], Fact]) -> Deciding:
    engine, facts, found = deliberator.engine, deliberator.facts, []
    for _ in range(times):
        fact = change()
        begun = time.process_time_ns()
        if facts.current(fact) is None:
            facts.add(fact)
        else:
            facts.remove(fact)
        engine.run_until_idle()
        found.append((time.process_time_ns() - begun) / 1e6)
    return Deciding(round(statistics.median(found), 3), round(max(found), 3))


def _undecided(desires: int) -> Deliberator:
    """Return a deliberator with ``desires`` desires, half of them possible; its planner never answers."""
    engine = Engine("decider", ManualClock())
    deliberator = Deliberator(engine, read_domain(THINGS, where="things"), _Silent(), _never)
    chance = random.Random("desires")
    for number in range(desires):
        deliberator.facts.add(instance(f"t{number}", "thing"))
        if number % 2:
            deliberator.facts.add(predicate_of(number))
    for number in range(desires):
        needed = (
            FactCondition(condition_to_check=predicate_of(number)),
            FactCondition(condition_to_check=Fact(name="calm")),
        )
        desire = Desire(
            name=f"d{number}",
            value=(Fact(name="done", params=(f"t{number}",)),),
            priority=round(chance.random(), 3),
            deadline=round(chance.uniform(10.0, 100.0), 1),
            precondition=Dnf(clauses=(FactConjunction(literals=needed),)),
        )
        deliberator.desire(desire)
    engine.run_until_idle()
    return deliberator


class _Silent:
    name = "silent"

    def solve(
        self, domain: PddlDomain, problem: PddlProblem, limits: PlannerLimits, cancelled: Event | None = None
    ) -> PlannerAnswer:
        return PlannerAnswer(PlannerVerdict.CANCELLED)


def _never(work: Callable[[], Any], then: Callable[[Any], None]) -> None:
    """Discard the work."""


def _processor_s() -> float:
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime
