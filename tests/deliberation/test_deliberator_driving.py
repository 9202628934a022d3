"""Urgent desires of a robot whose place is unknown while it drives."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.deliberation.messages import Desire
from socialbot.deliberation.sensing import FactSensor, predicate
from socialbot.planning.pddl.domain import PddlPlan, PlanStep
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import p
from tests.deliberation.office import Office

ROADS = read_domain(
    """
    (define (domain roads)
      (:requirements :typing :durative-actions)
      (:types place - object)
      (:predicates (at ?p - place) (visited ?p - place))
      (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 60)
        :condition (at start (at ?from))
        :effect (and (at start (not (at ?from))) (at end (at ?to)) (at end (visited ?to)))))
    """,
    where="roads",
)
PLACES = ("west", "home", "mid", "east", "far")
"""Places along a road; the robot drives from one to the next."""


class Navigator:
    """A planner for the road. It finds no plan while the place of the robot is unknown."""

    name = "navigator"

    def solve(self, domain, problem, limits, cancelled=None):
        here = [fact.terms[0] for fact in problem.facts if fact.name == "at"]
        (wanted,) = {predicate.terms[0] for predicate in problem.goal.parts}
        if not here:
            return PlannerAnswer(PlannerVerdict.IMPOSSIBLE, message="the place is unknown")
        start, end = PLACES.index(here[0]), PLACES.index(wanted)
        way = PLACES[start : end + 1] if start <= end else PLACES[end : start + 1][::-1]
        steps = (PlanStep(60.001 * number, "drive", pair, 60.0) for number, pair in enumerate(pairwise(way)))
        return PlannerAnswer(PlannerVerdict.SOLVED, PddlPlan(tuple(steps)))


class Place(FactSensor):
    """The place of the robot: none while it drives."""

    prototypes = (predicate("at", "*"),)

    def tell(self, percept):
        return percept


class Robot(Office):
    """A robot that reports its place twice a second. A stopped robot drives on to where it was sent."""

    def __init__(self, *, stops: bool, **options) -> None:
        places = "; ".join(f"instance {place} place" for place in PLACES)
        super().__init__(domain=ROADS, planner=Navigator(), beliefs=f"{places}; at home", is_sensed=_sensed, **options)
        self.lasts_s["drive"] = 60.0
        self.stops = stops
        self.place = Place()
        self.reported = "home"
        self.run(lambda: self.place.join(self.deliberator))

    def where(self) -> str:
        """Place according to the latest drive."""
        drives = [entry for entry in self.timeline if "drive" in entry[2]]
        if not drives:
            return "home"
        began = max(time for time, what, _ in drives if what == "begins")
        *_, target = next(call for time, what, call in drives if (time, what) == (began, "begins")).strip("()").split()
        stopped = any(what == "is asked to stop" and time >= began for time, what, _ in drives)
        return target if self.now >= began + 60.0 and not (stopped and self.stops) else ""

    def live(self, until: float) -> None:
        while self.now < until - 1e-6:
            self.until(min(self.now + 0.5, until))
            here = self.where()
            if here != self.reported:
                self.reported = here
                self.place.push([p("at", here)] if here else [])
                self.engine.run_until_idle()


def _sensed(name: str, objects: tuple[str, ...]) -> bool:
    return name == "at"


def visit(place: str, priority: float) -> Desire:
    return Desire(name=f"{place}_{priority}", priority=priority, deadline=1000.0, value=(p("visited", place),))


@pytest.mark.parametrize("stops", [True, False])
def test_an_urgent_desire_waits_for_the_running_step_and_no_longer(stops):
    robot = Robot(stops=stops, reschedule_policy="PREEMPT")
    robot.want(visit("far", 0.1))
    robot.live(1.0)
    robot.want(visit("west", 0.9))
    robot.live(800.0)
    calls = [call for _, call in robot.begun()]
    assert calls[:3] == ["(drive home mid)", "(drive mid home)", "(drive home west)"]
    assert [end[:2] for end in robot.ends] == [("west_0.9", "fulfilled"), ("far_0.1", "fulfilled")]


def test_plannings_from_predicted_states_do_not_count():
    robot = Robot(stops=False, reschedule_policy="PREEMPT", comp_plan_tries=2)
    robot.want(visit("mid", 0.1))
    robot.live(1.0)
    navigator = robot.deliberator.pursuit.planner
    robot.deliberator.pursuit.planner = Nothing()
    robot.want(visit("west", 0.9))
    robot.live(50.0)
    assert robot.wants == ["west_0.9", "mid_0.1"]
    robot.deliberator.pursuit.planner = navigator
    robot.live(400.0)
    assert sorted(end[:2] for end in robot.ends) == [("mid_0.1", "fulfilled"), ("west_0.9", "fulfilled")]


class Nothing:
    """A planner without a plan; it notes when it was asked."""

    name = "nothing"

    def __init__(self, office: Office | None = None) -> None:
        self.office = office
        self.asked: list[float] = []

    def solve(self, domain, problem, limits, cancelled=None):
        if self.office is not None:
            self.asked.append(self.office.now)
        return PlannerAnswer(PlannerVerdict.GAVE_UP, message="nothing found")


def test_fruitless_plannings_become_rarer():
    robot = Robot(stops=False, reschedule_policy="PREEMPT")
    robot.want(visit("mid", 0.1))
    robot.live(1.0)
    nothing = Nothing(robot)
    robot.deliberator.pursuit.planner = nothing
    robot.want(visit("west", 0.9))
    robot.live(50.0)
    assert len(dict.fromkeys(nothing.asked)) < 12, "eight and less"


def test_a_desire_that_is_dropped_while_its_steps_end_stops_them():
    robot = Robot(stops=False, reschedule_policy="PREEMPT")
    robot.want(visit("far", 0.1))
    robot.live(1.0)
    robot.want(visit("west", 0.9))
    robot.live(2.0)
    assert robot.deliberator.plan_executor.finishing_steps
    robot.run(lambda: robot.deliberator.drop("far_0.1"))
    assert not robot.deliberator.plan_executor.finishing_steps
    assert (2.0, "is asked to stop", "(drive home mid)") in robot.timeline


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(PLACES), st.sampled_from([0.1, 0.5, 0.9]), st.sampled_from([0.0, 5.0, 59.8, 61.0])),
        max_size=5,
    ),
    st.booleans(),
)
def test_preempting_fulfils_all_that_is_fulfilled_without(wishes, stops):
    def fulfilled(policy: str) -> set[str]:
        robot = Robot(stops=stops, reschedule_policy=policy)
        now = 0.0
        for place, priority, pause in wishes:
            robot.want(visit(place, priority))
            now += pause
            robot.live(now)
        end = now + 60.0 * 4 * (len(wishes) + 2)
        while robot.wants and robot.now < end:
            robot.live(robot.now + 20.0)
        return {name for name, how, _ in robot.ends if how == "fulfilled"}

    assert fulfilled("NO_PREEMPT") <= fulfilled("PREEMPT")
