from __future__ import annotations

import pytest

from socialbot.core.errors import PlanningError
from socialbot.deliberation.sensing import FactSensor, fits, fluent, instance, predicate, sensed_by
from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.planners.engines import Kairos
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import i, n, p
from tests.deliberation.office import Office, Watcher, job
from tests.deliberation.stage import Behaviour


class Levels(FactSensor):
    """Sensor of levels and lights; a percept is a list of facts, or None."""

    prototypes = (fluent("level", "*"), predicate("lit"), instance("j*", "job"))

    def tell(self, percept):
        if isinstance(percept, Exception):
            raise percept
        return percept


class Eye(Levels):
    deadline_s = 1.0


class Ear(FactSensor):
    prototypes = (predicate("quiet"),)
    deadline_s = 1.0

    def tell(self, percept):
        return percept


def join(office: Office, *sensors: FactSensor) -> None:
    for sensor in sensors:
        office.run(lambda sensor=sensor: sensor.join(office.deliberator))


def show(office: Office, sensor: FactSensor, *facts) -> None:
    sensor.push(list(facts))
    office.engine.run_until_idle()


def keep_showing(office: Office, sensor: FactSensor, end: float, *facts) -> None:
    while office.now < end:
        show(office, sensor, *facts)
        office.until(min(end, office.now + 0.5))


def test_a_percept_is_complete_for_its_kind():
    office, sensor = Office(), Levels()
    join(office, sensor)
    office.believe("level a = 1; level b = 2; quiet")
    show(office, sensor, n("level", "a", value=7), p("lit"))
    held = office.facts.facts()
    assert n("level", "a", value=7) in held
    assert office.facts.current(n("level", "b")) is None
    assert p("quiet") in held
    show(office, sensor)
    assert office.facts.current(p("lit")) is None


def test_a_percept_ends_all_facts_that_its_prototypes_fit():
    class FewLevels(Levels):
        prototypes = (fluent("level", "[ab]"),)

    office, sensor = Office(), FewLevels()
    join(office, sensor)
    show(office, sensor, n("level", "a", value=1), n("level", "b", value=2))
    office.believe("level c = 3")
    show(office, sensor, n("level", "b", value=2))
    held = [name for name in "abc" if office.facts.current(n("level", name)) is not None]
    assert held == ["b", "c"]


def test_an_empty_percept_changes_no_facts():
    office, sensor = Office(), Levels()
    join(office, sensor)
    office.believe("lit")
    sensor.push(None)
    office.engine.run_until_idle()
    assert office.facts.current(p("lit"))


def test_a_repeated_percept_changes_beliefs_only_after_external_changes():
    office, sensor = Office(), Levels()
    join(office, sensor)
    show(office, sensor, p("lit"), n("level", "a", value=1))
    records = len(office.trace)
    show(office, sensor, p("lit"), n("level", "a", value=1))
    assert len(office.trace) == records
    office.forget("lit")
    show(office, sensor, p("lit"), n("level", "a", value=1))
    assert office.facts.current(p("lit"))


def test_facts_without_prototype_or_misfits_are_ignored_and_recorded_once():
    office, sensor = Office(), Levels()
    join(office, sensor)
    for _ in range(3):
        show(office, sensor, p("quiet"), n("level", "Not a name", value=1), p("lit"))
    assert office.facts.current(p("lit"))
    assert office.facts.current(p("quiet")) is None
    messages = [record.detail["message"] for record in office.found("failure")]
    assert len(messages) == 2
    assert "it has no prototype for (quiet)" in messages[0]
    assert "is no name" in messages[1]


def test_an_exception_in_a_sensor_does_not_stop_the_agent():
    office, sensor = Office(), Levels()
    join(office, sensor)
    sensor.push(ValueError("dust"))
    office.engine.run_until_idle()
    show(office, sensor, p("lit"))
    assert office.facts.current(p("lit"))
    assert [record.detail["message"] for record in office.found("failure")] == ["dust"]


def test_a_prototype_unknown_to_the_domain_is_refused():
    class Wrong(Levels):
        prototypes = (predicate("lit", "*"),)

    with pytest.raises(PlanningError, match=r"sensor Wrong.*\(lit \*\)"):
        Wrong().join(Office().deliberator)

    class Kind(Levels):
        prototypes = (instance("*", "robot"),)

    with pytest.raises(PlanningError, match="no type 'robot'"):
        Kind().join(Office().deliberator)


def test_two_sensors_with_deadlines_need_two_names():
    office = Office()
    Eye().join(office.deliberator)
    with pytest.raises(PlanningError, match="another sensor of this name"):
        Eye().join(office.deliberator)


def test_prototypes_define_the_sensed_facts():
    class Stacks(Levels):
        prototypes = (predicate("clear", "base_[0-9]*"), predicate("in", "*", "*"), instance("*", "box"))

    watched = sensed_by([Stacks()])
    assert watched("clear", ("base_1",))
    assert not watched("clear", ("base_a",))
    assert not watched("in", ("a",))
    assert not watched("box_a", ())
    assert fits(i("box_a", "box"), instance("box_*", "box"))
    assert not fits(i("box_a", "base"), instance("box_*", "box"))
    assert not fits(n("in", "a", "b"), predicate("in", "*", "*"))


# Silence


def test_no_step_starts_before_the_first_percept_of_each_sensor():
    watcher = Watcher()
    office, eye, ear = Office(observer=watcher), Eye(), Ear()
    join(office, eye, ear)
    office.want(job("a"))
    show(office, eye, p("lit"))
    assert office.pursued is None
    assert watcher.statuses[-1] == ("BOOTING", "sensor Ear is silent")
    ear.push(None)
    office.engine.run_until_idle()
    assert office.pursued is None, "it has told nothing"
    show(office, ear)
    assert office.pursued == "a"
    assert office.found("silent") == []
    assert watcher.statuses[-1][0] == "EXECUTING"


def test_a_sensor_that_is_late_from_the_start_is_stated_too():
    watcher = Watcher()
    office, eye = Office(observer=watcher), Eye()
    join(office, eye)
    office.until(1.5)
    assert [record.what for record in office.found("silent")] == ["Eye"]
    assert watcher.statuses[-1] == ("BOOTING", "sensor Eye is silent")
    show(office, eye)
    assert [record.what for record in office.found("heard")] == ["Eye"]
    assert watcher.statuses[-1] == ("SCHEDULING", "")


def test_a_sensor_timeout_holds_new_steps_but_not_running_ones():
    watcher = Watcher()
    office, eye = Office(observer=watcher), Eye()
    join(office, eye)
    show(office, eye)
    office.clerk.script = lambda problem: PlannerAnswer(
        PlannerVerdict.SOLVED, parse_plan("0: (do a) [6]\n6.001: (report a) [1]")
    )
    office.want(job("x", value=(p("told"),)))
    office.until(10)
    assert office.begun() == [(0.0, "(do a)")]
    assert (6.0, "ends", "(do a)") in office.timeline
    assert [(record.kind, record.time / 1e9) for record in office.trace if record.kind in ("silent", "hold")] == [
        ("silent", 1.05),
        ("hold", 1.05),
    ]
    assert watcher.statuses[-1] == ("PAUSED", "sensor Eye is silent")
    keep_showing(office, eye, 13)
    assert office.begun()[1:] == [(10.0, "(report a)")]
    assert office.ends == [("x", "fulfilled", "")]


def test_a_percept_that_waits_behind_the_timer_of_its_deadline_is_not_late():
    """Time moves in steps of half the deadline; each percept comes after the timers of the next step."""
    office, eye = Office(), Eye()
    join(office, eye)
    for _ in range(20):
        office.until(office.now + 0.5)
        show(office, eye)
    assert office.found("silent") == []
    office.clock.advance(3.0)  # a node that was busy or suspended runs its timers before its waiting messages
    office.engine.run_until_idle()
    show(office, eye)
    office.until(office.now + 0.5)
    assert office.found("silent") == []
    office.until(office.now + 1.0)
    assert [record.what for record in office.found("silent")] == ["Eye"]


def test_a_sensor_gets_two_checks_each_time_it_is_late():
    office, eye = Office(), Eye()
    join(office, eye)
    for _ in range(3):
        office.until(office.now + 1.2)
        show(office, eye)
    assert [record.kind for record in office.trace if record.kind in ("silent", "heard")] == ["silent", "heard"] * 3


def test_a_new_desire_waits_until_the_sensor_is_back():
    office, eye = Office(), Eye()
    join(office, eye)
    show(office, eye)
    office.until(5)
    office.want(job("a"))
    office.until(9)
    assert office.begun() == []
    keep_showing(office, eye, 16)
    assert office.begun() == [(9.0, "(do a)")]


def test_a_plan_that_comes_while_a_sensor_is_silent_waits():
    office, eye = Office(slow=True), Eye()
    join(office, eye)
    show(office, eye)
    office.want(job("a"))
    office.until(2)
    office.answer()
    office.until(4)
    assert office.begun() == []
    keep_showing(office, eye, 5)
    assert office.begun() == [(4.0, "(do a)")]


def test_a_plan_stops_for_a_silent_sensor_and_resumes_with_it():
    office, eye = Office(planner=Kairos(), give_up_silent_s=5.0), Eye()
    office.behaviour["(light)"] = Behaviour(lasts_s=6.9)
    join(office, eye)
    keep_showing(office, eye, 1.0)
    office.want(job("a", value=(p("lit"),)))
    office.until(20)
    (ending,) = office.found("plan_end")
    assert ending.time / 1e9 == 6.55
    assert (ending.detail["outcome"], ending.detail["reason"]) == ("aborted", "sensor Eye is silent for 5 s")
    assert office.wants == ["a"]
    keep_showing(office, eye, 20.5)
    keep_showing(office, eye, 30, p("lit"))
    assert office.ends == [("a", "fulfilled", "")]


def test_a_silent_sensor_blocks_only_steps_that_need_it():
    sees = sensed_by([Eye()])
    office, eye = Office(planner=Kairos(), is_sensed=sees, give_up_silent_s=5.0, comp_plan_tries=2), Eye()
    join(office, eye)
    show(office, eye)
    office.want(job("a"), job("dark", value=(p("lit"),), priority=0.9))
    office.until(3)
    assert office.begun() == [(0.0, "(light)")]
    office.until(60)
    assert [call for _, call in office.begun()] == ["(light)", "(do a)"]
    reason = "no plan after 2 tries: without sensor Eye: nothing can make (lit) true"
    assert sorted(office.ends) == [("a", "fulfilled", ""), ("dark", "dropped", reason)]


def test_a_plan_without_the_silent_sensor_continues():
    office, eye = Office(give_up_silent_s=2.0), Eye()
    office.clerk.script = lambda problem: PlannerAnswer(
        PlannerVerdict.SOLVED, parse_plan("0: (do a) [6]\n6.001: (report a) [1]")
    )
    join(office, eye)
    show(office, eye)
    office.want(job("x", value=(p("told"),)))
    office.until(20)
    assert office.begun() == [(0.0, "(do a)"), (6.0, "(report a)")]
    assert office.ends == [("x", "fulfilled", "")]


def test_a_sensor_without_a_first_percept_does_not_stop_the_rest():
    watcher = Watcher()
    office, eye = Office(planner=Kairos(), observer=watcher, give_up_silent_s=5.0), Eye()
    join(office, eye)
    office.want(job("a"))
    office.until(4)
    assert watcher.statuses[-1] == ("BOOTING", "sensor Eye is silent")
    office.until(20)
    assert office.ends == [("a", "fulfilled", "")]


def test_a_plan_that_fails_while_a_sensor_is_silent_is_mended_when_it_is_back():
    office, eye = Office(), Eye()
    office.behaviour["(do a)"] = Behaviour(lasts_s=3.0, fails="slipped")
    join(office, eye)
    show(office, eye)
    office.want(job("a"))
    office.until(5)
    assert office.plans() == [("a", "failed")]
    assert len(office.clerk.asked) == 1
    office.behaviour.clear()
    keep_showing(office, eye, 12)
    assert office.begun() == [(0.0, "(do a)"), (5.0, "(do a)")]
    assert office.ends == [("a", "fulfilled", "")]
