import pytest

from socialbot.bdi import Sensor
from socialbot.bdi._hold_timers import HoldTimer
from socialbot.core.clock import SECOND
from tests.bdi.lab import Lab, X, _, do, go, mood, p, q


class Eyes(Sensor):
    def sense(self, percept):
        return p(percept)


def test_it_fires_once_at_the_exact_moment():
    lab = Lab(+p(X).held_for(2.5) >> [do(X)], start=10)
    lab.tell(+p(1))
    assert lab.engine.next_wakeup() == round(12.5 * SECOND)
    lab.until(60)
    assert lab.timeline == [(12.5, 1)]


def test_it_does_not_fire_a_nanosecond_early():
    lab = Lab(+p(X).held_for(1) >> [do(X)])
    lab.tell(+p(1))
    lab.clock.set(SECOND - 1)
    lab.engine.run_until_idle()
    assert lab.done == []


@pytest.mark.parametrize(
    ("script", "timeline"),
    [
        pytest.param([(+p(1), +p(2)), 1.9, -p(1)], [(2, 2)], id="one belief is removed before"),
        pytest.param([+p(1), 1, (-p(1), +p(1))], [(3, 1)], id="the belief is removed and added"),
        pytest.param([+p(1), 1, +p(1)], [(2, 1)], id="the belief is added twice"),
        pytest.param([+p(1), 5, (-p(1), +p(1))], [(2, 1), (7, 1)], id="the belief is held twice"),
        pytest.param([+mood("sad"), 1, +mood("glad")], [(3, "glad")], id="the singleton changes"),
        pytest.param([(+p(1, 5), +p(1, 6), +q(6))], [(2, 6)], id="the condition holds for one belief"),
        pytest.param([(+p(0, 1), +q(1)), 1, -q(1)], [], id="the condition holds only before"),
    ],
)
def test_event_occurs_when_the_belief_was_held_for_the_duration(script, timeline):
    lab = Lab(+p(X).held_for(2) >> [do(X)], +mood(X).held_for(2) >> [do(X)], +p(_, X).held_for(2) / q(X) >> [do(X)])
    for item in script:
        if isinstance(item, (int, float)):
            lab.until(item)
        else:
            lab.tell(*item if isinstance(item, tuple) else (item,))
    lab.until(20)
    assert lab.timeline == timeline


def test_it_counts_from_the_time_that_the_percept_speaks_of():
    lab = Lab(+p(X).held_for(2) >> [do(X)], start=10)
    lab.engine.perceive(Eyes(), 1, since=9 * SECOND)
    lab.engine.perceive(Eyes(), 2, since=3 * SECOND)
    lab.engine.run_until_idle()
    lab.until(20)
    assert lab.timeline == [(10, 2), (11, 1)]


def test_a_rule_added_later_counts_from_the_same_beginning():
    lab = Lab()
    lab.tell(+p(1))
    lab.until(1)
    lab.engine.add_rules(+p(X).held_for(3) >> [do(X)], +p(X).held_for(0.5) >> [do("long since")])
    lab.until(9)
    assert lab.timeline == [(1, "long since"), (3, 1)]


def test_each_duration_fires_on_its_own():
    lab = Lab(+p(X).held_for(2) >> [do("two")], +p(X).held_for(1) >> [do("one")], +p(X).held_for(2) >> [do("too")])
    lab.tell(+p(1))
    lab.until(9)
    assert lab.timeline == [(1, "one"), (2, "two"), (2, "too")]


def test_many_beliefs_share_a_timer_and_fire_each_at_its_time():
    lab = Lab(+p(X).held_for(5) >> [do("p", X)], +q(X, _).held_for(5) >> [do("q", X)], +p(X).held_for(2) >> [do(X)])
    engine = lab.engine
    for second in range(4):
        engine.believe(p(second))
        engine.believe(q(second, 0))
        engine.run_until_idle()
        lab.until(second + 1)
    assert len(engine.timers.heap) == 3
    engine.forget(p(3))
    engine.believe(p(3))
    engine.believe(p(9), since=SECOND)
    engine.believe(p(1), source="other")
    lab.until(20)
    assert lab.timeline == [
        (2, 0), (3, 1), (4, 2), (4, 9), (5, ("p", 0)), (5, ("q", 0)), (6, ("p", 1)), (6, ("q", 1)), (6, 3),
        (6, ("p", 9)), (7, ("p", 2)), (7, ("q", 2)), (8, ("q", 3)), (9, ("p", 3)),
    ]  # fmt: skip
    assert not engine.timers.heap


def test_a_belief_that_begins_again_in_the_same_instant_fires_once():
    lab = Lab(+p(X).held_for(5) >> [do(X)])
    for _again in range(3):
        lab.tell(+p(1), +p(2))
        lab.tell(-p(1))
    lab.tell(+p(1))
    lab.until(10)
    assert sorted(lab.done) == [1, 2]


def test_a_timer_forgets_beliefs_that_end_before_it():
    lab = Lab(+p(X).held_for(1000) >> [do(X)])
    for second in range(500):
        lab.tell(+p(second))
        lab.tell(-p(second - 1))
        lab.until(second + 1)
    ((_, _, timer, _),) = lab.engine.timers.heap
    assert isinstance(timer, HoldTimer)
    assert sum(1 for _ in timer.waiting()) == 1
    assert len(timer._args) < 200
    lab.until(2000)
    assert lab.done == [499]


def test_a_duration_of_nothing_fires_at_once():
    lab = Lab(+p(X).held_for(0) >> [do("held")], +p(X) >> [do("came")])
    lab.tell(+p(1))
    assert sorted(lab.done) == ["came", "held"]


def test_the_function_is_asked_when_the_waiting_begins():
    asked = []
    lab = Lab(+p(X).held_for(lambda: asked.append(lab.clock.now()) or len(asked)) >> [do("held")])
    lab.tell(+p(1))
    lab.until(1)
    lab.tell(-p(1), +p(1))
    lab.until(9)
    assert asked == [0, SECOND]
    assert lab.timeline == [(1, "held"), (3, "held")]


def test_patterns_and_conditions_choose_what_is_waited_for():
    lab = Lab(+p(1).held_for(1) >> [do("one")], +p(_, X).held_for(1) / q(X) >> [do(X)])
    lab.tell(+p(2), +p(1, 5), +p(1, 6), +q(6))
    lab.until(9)
    assert lab.done == [6]


def test_no_longer_held_at_the_very_moment_is_not_held():
    lab = Lab(+p(1).held_for(2) >> [do("held")])
    lab.tell(+p(1))
    lab.clock.set(2 * SECOND)
    lab.tell(-p(1))
    assert lab.done == []


def test_a_plan_may_begin_the_waiting():
    lab = Lab(go() >> [+p(1)], +p(1).held_for(1) >> [-p(1), go()], -p(1) >> [do("again")])
    lab.tell(go())
    lab.until(3.5)
    assert lab.timeline == [(1, "again"), (2, "again"), (3, "again")]
