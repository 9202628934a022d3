"""Test bench of the plan executor: an engine in simulated time, a small domain, and scripted actions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from socialbot.bdi import Atom, Engine, LongAction, Trace
from socialbot.bdi.literals import Change, Event, literal
from socialbot.bdi.terms import Variable
from socialbot.core.clock import SECOND, ManualClock
from socialbot.deliberation._plan_executor import PlanExecutor, PlanOutcome
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import FLUENT, INSTANCE, Desire, Fact, PlanExecutionInfo
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import PddlDomain, parse_plan
from socialbot.planning.pddl.reader import read_domain

WORKSHOP = read_domain(
    """
    (define (domain workshop)
      (:requirements :typing :durative-actions :fluents :negative-preconditions)
      (:types robot place box - object)
      (:predicates (at ?r - robot ?p - place) (in ?b - box ?p - place) (holding ?r - robot ?b - box)
                   (open ?p - place) (lit) (painted ?b - box) (rung))
      (:functions (load ?r - robot) (paint))
      (:durative-action move :parameters (?r - robot ?a ?b - place) :duration (= ?duration 5)
        :condition (at start (at ?r ?a))
        :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))))
      (:durative-action pick :parameters (?r - robot ?b - box ?p - place) :duration (= ?duration 3)
        :condition (and (at start (in ?b ?p)) (at start (< (load ?r) 1)) (over all (at ?r ?p)))
        :effect (and (at start (increase (load ?r) 1)) (at end (not (in ?b ?p))) (at end (holding ?r ?b))))
      (:durative-action put :parameters (?r - robot ?b - box ?p - place) :duration (= ?duration 3)
        :condition (and (at start (holding ?r ?b)) (over all (at ?r ?p)))
        :effect (and (at end (decrease (load ?r) 1)) (at end (in ?b ?p)) (at end (not (holding ?r ?b)))))
      (:durative-action unlock :parameters (?p - place) :duration (= ?duration 2)
        :condition (at start (not (open ?p)))
        :effect (at end (open ?p)))
      (:durative-action shine :parameters () :duration (= ?duration 10)
        :condition (at start (not (lit)))
        :effect (and (at start (lit)) (at end (not (lit)))))
      (:durative-action spray :parameters (?b - box) :duration (= ?duration 4)
        :condition (and (over all (lit)) (at end (>= (paint) 1)))
        :effect (and (at end (painted ?b)) (at end (decrease (paint) 1))))
      (:action ring :parameters () :precondition (lit) :effect (rung)))
    """,
    where="workshop",
)

FACTS = """
instance r1 robot; instance r2 robot; instance home place; instance shop place; instance yard place
instance b1 box; instance b2 box; instance b3 box
at r1 home; at r2 yard; in b1 home; in b2 yard; in b3 shop
load r1 = 0; load r2 = 0; paint = 3
"""

FETCH = """
0.000: (move r1 home shop) [5]
5.001: (pick r1 b3 shop) [3]
"""
"""A plan: one robot fetches a box."""
BOTH = """
0.000: (move r1 home shop) [5]
0.000: (move r2 yard home) [5]
5.001: (pick r1 b3 shop) [3]
5.001: (pick r2 b1 home) [3]
"""
"""A plan: two robots do, side by side."""


def fact(text: str) -> Fact:
    """``at r1 home``, ``load r1 = 2``, ``instance r1 robot`` as a fact."""
    left, _, value = text.partition("=")
    name, *params = left.split()
    if name == "instance":
        return Fact(name=params[0], pddl_type=INSTANCE, type=params[1])
    if value:
        return Fact(name=name, pddl_type=FLUENT, params=tuple(params), value=float(value))
    return Fact(name=name, params=tuple(params))


def facts(text: str) -> list[Fact]:
    return [fact(part) for line in text.splitlines() for part in line.split(";") if part.strip()]


@dataclass
class Behaviour:
    """Script of an action: duration, reason of a failure at its end, and time to stop.

    With ``stop_s`` None it never stops, and never ends when it was asked to.
    """

    lasts_s: float | None = None
    fails: str = ""
    stop_s: float | None = 0.0


class Perform(LongAction):
    """Does what the stage says of it."""

    def start(self, *args: Any) -> None:
        stage: Scene = self.engine.robot
        self.stage, self.call = stage, f"({' '.join(map(str, args))})"
        self.behaviour = stage.behaviour.get(self.call, Behaviour())
        stage.log("begins", self.call)
        self.stopping = False
        lasts_s = self.behaviour.lasts_s
        if lasts_s is None:
            lasts_s = stage.lasts_s.get(str(args[0]), 1.0)
        if lasts_s == 0:
            self.end()
        else:
            self.engine.timers.after(lasts_s, self.end)

    def end(self) -> None:
        if self.stopping:
            return
        if self.behaviour.fails:
            self.failed(self.behaviour.fails)
        else:
            self.stage.log("ends", self.call)
            self.done()

    def cancel(self) -> None:
        self.stopping = True
        self.stage.log("is asked to stop", self.call)
        if self.behaviour.stop_s is not None:
            self.engine.timers.after(self.behaviour.stop_s, self.cancelled)


class Scene:
    """An agent in simulated time; ``timeline`` is what its actions did, with the seconds at which."""

    ends: Any

    def __init__(
        self, name: str, domain: PddlDomain, lasts_s: dict[str, float], clock: ManualClock | None = None
    ) -> None:
        self.clock = clock or ManualClock()
        self.trace = Trace()
        self.engine = Engine(name, self.clock, robot=self, sink=self.trace)
        self.behaviour: dict[str, Behaviour] = {}
        self.lasts_s = lasts_s
        self.timeline: list[tuple[float, str, str]] = []
        for action in domain.actions.values():
            parameters = [Variable(f"P{number}") for number in range(len(action.parameters))]
            wanted = Event(Change.WANTED, literal(action.name, tuple(parameters)))
            self.engine.add_rules(wanted >> [Perform(Atom(action.name), *parameters)])

    def log(self, what: str, call: str) -> None:
        self.timeline.append((self.now, what, call))

    @property
    def now(self) -> float:
        return self.clock.now() / SECOND

    def run(self, call: Any) -> None:
        self.engine.call(call)
        self.engine.run_until_idle()

    def until(self, seconds: float) -> Any:
        """Advance the time; return the ended actions."""
        end = round(seconds * SECOND)
        self.engine.run_until_idle()
        while (due := self.engine.next_wakeup()) is not None and due <= end:
            self.clock.set(max(due, self.clock.now()))
            self.engine.run_until_idle()
        self.clock.set(max(end, self.clock.now()))
        return self.ends


LASTS_S = {"move": 5.0, "pick": 3.0, "put": 3.0, "unlock": 2.0, "shine": 10.0, "spray": 4.0, "ring": 0.0}


class Stage(Scene):
    """A plan executor in simulated time."""

    def __init__(
        self,
        *,
        watched: set[str] | None = None,
        domain: PddlDomain = WORKSHOP,
        beliefs: str = FACTS,
        options: DeliberationOptions | None = None,
    ) -> None:
        super().__init__("stage", domain, dict(LASTS_S))
        self.facts = FactBase(self.engine, domain)
        self.domain = domain
        self.outcomes: list[PlanOutcome] = []
        self.infos: list[PlanExecutionInfo] = []
        for known in facts(beliefs):
            self.facts.add(known)
        self.plan_executor = PlanExecutor(
            self.engine,
            self.facts,
            options,
            is_sensed=lambda name, objects: name in (watched or ()),
            ended=self.outcomes.append,
            changed=lambda: self.infos.append(self.plan_executor.info),
        )

    def execute(self, plan: str, **about: Any) -> None:
        """Has a plan executed; ``wanted`` are the facts of the desire, ``about`` what else there is to it."""
        self.run(lambda: self.plan_executor.execute(parse_plan(plan), desire(**about), "desire-1"))

    def believe(self, *texts: str) -> None:
        for text in texts:
            self.run(lambda text=text: self.facts.add(fact(text), source="percept"))

    def forget(self, *texts: str) -> None:
        for text in texts:
            self.run(lambda text=text: self.facts.remove(fact(text)))

    def holds(self, text: str) -> bool:
        wanted = fact(text)
        return self.facts.current(wanted) == wanted

    def begun(self) -> dict[str, float]:
        """Return the start time of each action."""
        return {call: time for time, what, call in self.timeline if what == "begins"}

    def status(self) -> dict[str, str]:
        """Return the last reported status of the steps."""
        info = [info for info in self.infos if info.target is not None][-1]
        return {f"({' '.join((step.name, *step.args))})": step.status for step in info.actions_exec_info}

    @property
    def ends(self) -> list[tuple[str, str]]:  # type: ignore[override]
        return [(outcome.how, outcome.reason) for outcome in self.outcomes]


def desire(wanted: str = "", **more: Any) -> Desire:
    return Desire(name="goal", value=tuple(facts(wanted)), **{"deadline": 1000.0, **more})


def stage_with(plan: str, stage: Stage | None = None, *, until: float = 0.0, **about: Any) -> Stage:
    """A stage that has executed a plan for some seconds."""
    stage = stage or Stage()
    stage.execute(plan, **about)
    stage.until(until)
    return stage
