# ruff: noqa: N803 - functions name the variables they look at

import inspect
import math

import pytest

from socialbot.bdi import Action, LongAction, Sensor, Sleep, atomic, compute, fail, wait
from socialbot.bdi.steps import PlanFailed
from tests.bdi.lab import Lab, X, Y, crash, deep, do, go, p, q, sub


def line_of(function):
    return inspect.getsourcelines(function)[1]


def failures(lab):
    return [(record.what, record.detail["reason"]) for record in lab.trace if record.kind == "failure"]


@pytest.mark.parametrize(
    ("step", "what", "reason"),
    [
        (crash("oh"), 'crash("oh")', "exception"),
        (fail("too late"), 'fail("too late")', "action_failed"),
        (deep(), "deep()", "no_relevant"),
        (do(X / 0), "do(X / 0)", "exception"),
        (+p(X + "a"), '+p(X + "a")', "exception"),
    ],
    ids=["exception", "fail", "no plan", "argument", "belief"],
)
def test_the_failure_plan_replaces_any_failed_step(step, what, reason):
    lab = Lab(
        go(X) >> [do("try"), step, do("never")],
        -go(X) >> [do("sorry", X), do("bye")],
    )
    lab.tell(go(1))
    assert lab.done == ["try", ("sorry", 1), "bye"]
    assert failures(lab) == [(what, reason)]
    assert lab.kinds("dropped") == lab.kinds("achieved") == []


def test_after_its_failure_plan_a_goal_counts_for_the_parent_as_dealt_with():
    lab = Lab(go() >> [sub(1), do("on")], sub(X) >> [crash()], -sub(X) >> [do("instead", X)])
    lab.tell(go())
    assert lab.done == [("instead", 1), "on"]
    assert lab.kinds("achieved") == ["go()"]


def test_a_goal_without_any_plan_has_its_failure_plan_too():
    lab = Lab(go() >> [sub(), do("on")], -sub() >> [do("instead")])
    lab.tell(go())
    assert lab.done == ["instead", "on"]


def test_an_adopted_goal_without_any_plan_has_its_failure_plan_too():
    lab = Lab(-go(X) >> [do("sorry", X)])
    lab.tell(go(1))
    assert lab.done == [("sorry", 1)]


def test_a_failure_without_failure_plan_fails_the_goal_above():
    lab = Lab(
        go() >> [sub(), do("never")],
        -go() >> [do("at the top")],
        sub() >> [deep(), do("never")],
        deep() >> [crash(), do("never")],
    )
    lab.tell(go())
    assert lab.done == ["at the top"]


def test_unhandled_failure_drops_the_intention():
    lab = Lab(+p(X) >> [sub(), do("never")], sub() >> [crash()], +q(X) >> [do("alive")])
    lab.tell(+p(1), +q(1))
    assert lab.done == ["alive"]
    assert lab.kinds("dropped") == ["intention"]
    assert lab.engine.mind().intentions == ()


def test_a_failure_in_a_failure_plan_goes_on_to_the_goal_above():
    lab = Lab(
        go() >> [sub(), do("never")],
        -go() >> [do("above")],
        sub() >> [fail()],
        -sub() >> [do("instead"), crash(), do("never")],
    )
    lab.tell(go())
    assert lab.done == ["instead", "above"]


def test_a_goal_pursued_in_a_failure_plan_may_fail_and_recover():
    lab = Lab(go() >> [fail()], -go() >> [sub(), do("on")], sub() >> [fail()], -sub() >> [do("sub")])
    lab.tell(go())
    assert lab.done == ["sub", "on"]


def test_failure_plans_have_conditions():
    lab = Lab(go(X) >> [fail()], -go(X) / p(X) >> [do("p")], -go(X) / (q(Y) & (Y > X)) >> [do(Y)])
    lab.tell(+p(1), go(1), +q(3), go(2), go(5))
    assert lab.done == ["p", 3]
    assert len(lab.kinds("dropped")) == 1


def test_goal_without_applicable_plan_fails_with_the_names_of_plans():
    lab = Lab(go(1) >> [], go(X) / p(X) >> [], go(X) / (X > 5) >> [])
    lab.tell(go(2))
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    assert failure.detail["rejected"] == [
        {"plan": "go(X) / (p(X)) >> []", "because": "p(2) does not hold"},
        {"plan": "go(X) / (X > 5) >> []", "because": "(2 > 5) does not hold"},
    ]


def test_a_goal_may_wait_in_its_failure_plan():
    lab = Lab(go() >> [sub(), do("on")], sub() >> [fail()], -sub() >> [wait(2), do("instead")])
    lab.tell(go())
    lab.until(3)
    assert lab.timeline == [(2, "instead"), (2, "on")]


def test_an_action_may_fail_its_goal_by_itself():
    class Pick(Action):
        def execute(self, thing):
            raise PlanFailed(f"no {thing}")

    lab = Lab(go() >> [Pick("cup")])
    lab.tell(go())
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    assert failure.detail == {"reason": "action_failed", "message": "no cup"}


def test_action_without_execute_fails_with_a_remedy():
    class Nothing(Action): ...

    lab = Lab(go() >> [Nothing()])
    lab.tell(go())
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    assert "override execute()" in str(failure.detail["message"])


# Exceptions in what people write never stop the agent.


def broken(*_):
    raise KeyError("mine")


def still_alive(lab):
    lab.engine.add_rules(go("alive?") >> [do("alive")])
    lab.tell(go("alive?"))
    return "alive" in lab.done


def test_an_exception_in_a_condition_rejects_the_rule_and_is_on_the_trace():
    lab = Lab(+p(X) / (lambda X: broken(X)) >> [do("never")], +p(X) >> [do("next")])
    lab.tell(+p(1))
    assert lab.done == ["next"]
    assert failures(lab) == [('+p(X) / (<lambda>(X)) >> [do("never")]', "KeyError")]
    plan = next(record for record in lab.trace if record.kind == "plan")
    assert plan.detail["rejected"] == [
        {"plan": '+p(X) / (<lambda>(X)) >> [do("never")]', "because": "<lambda>(X) raises KeyError: 'mine'"}
    ]


def test_invalid_comparison_rejects_the_plan():
    lab = Lab(+p(X) / (X > 1) >> [do("never")], +p(X) >> [do("next")])
    lab.tell(+p("a"))
    assert lab.done == ["next"]
    assert failures(lab)[0][1] == "TypeError"


def test_an_exception_in_the_condition_of_a_failure_plan_drops_the_intention():
    lab = Lab(go() >> [fail()], -go() / (lambda: broken()) >> [do("never")])
    lab.tell(go())
    assert lab.done == []
    assert lab.kinds("dropped") == ["intention"]
    assert still_alive(lab)


def test_an_exception_in_a_sensor_is_on_the_trace():
    class Broken(Sensor):
        def sense(self, percept):
            broken()

    class HalfBroken(Sensor):
        def sense(self, percept):
            yield p(1)
            broken()

    lab = Lab()
    for sensor in (Broken(), HalfBroken(), Sensor()):
        lab.engine.perceive(sensor, "x", cause="frame-1")
    lab.engine.run_until_idle()
    assert failures(lab) == [("Broken", "KeyError"), ("HalfBroken", "KeyError"), ("Sensor", "RuleError")]
    assert {record.cause for record in lab.trace} == {"frame-1"}
    assert still_alive(lab)


def test_a_polled_sensor_that_fails_is_asked_again():
    class Moody(Sensor):
        period_s = 1.0
        calls = 0

        def sense(self, percept):
            self.calls += 1
            if self.calls < 3:
                broken()
            return p(self.calls)

    lab = Lab()
    lab.engine.add_sensor(Moody())
    lab.until(2)
    assert lab.beliefs == ["p(3)"]
    assert len(failures(lab)) == 2


@pytest.mark.parametrize(
    "seconds", [broken, lambda: None, lambda: "", lambda: math.nan], ids=["raises", "None", "text", "nan"]
)
def test_invalid_duration_is_a_failure_on_the_trace(seconds):
    lab = Lab(+p(X).held_for(seconds) >> [do("never")], +p(X) >> [do("p")])
    lab.tell(+p(1))
    assert lab.done == ["p"]
    assert len(failures(lab)) == 1
    assert still_alive(lab)


def test_an_action_rests_for_as_long_as_it_returns():
    class Rest(Action):
        def execute(self):
            Sleep(1)
            return Sleep(2)

    lab = Lab(go() >> [Rest(), wait(5), do("after")])
    lab.tell(go())
    lab.until(10)
    assert lab.timeline == [(7, "after")]
    assert still_alive(lab)


def test_an_action_that_fails_leaves_nothing_that_rests():
    class Rest(Action):
        def execute(self):
            Sleep(5)
            broken()

    lab = Lab(go(1) >> [Rest()], -go(1) >> [do("instead")], go(2) >> [Rest()])
    lab.tell(go(1), go(2))
    assert lab.engine.mind().intentions == ()
    lab.until(9)
    assert lab.timeline == [(0, "instead")]
    assert still_alive(lab)


def test_an_exception_is_recorded_with_its_kind_and_the_line_that_raised_it(caplog):
    lab = Lab(go() >> [crash("oh")])
    lab.tell(go())
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    where = f"lab.py:{line_of(crash.execute) + 1}"
    assert failure.detail == {"reason": "exception", "message": "ZeroDivisionError: oh", "where": where}
    assert caplog.messages[-1].endswith(f"raised at {where})")


def test_an_exception_that_a_running_action_reports_has_its_line_and_no_empty_message(caplog):
    class Wander(LongAction):
        def start(self) -> None:
            self.engine.timers.after(1, self.turn)

        def turn(self) -> None:
            try:
                next(iter(()))
            except StopIteration as problem:
                self.failed(problem)

    lab = Lab(go() >> [Wander()])
    lab.tell(go())
    lab.until(2)
    (failure,) = [record for record in lab.trace if record.kind == "failure"]
    where = f"test_failures.py:{line_of(Wander.turn) + 2}"
    assert failure.detail == {"reason": "exception", "message": "StopIteration", "where": where}
    assert caplog.messages[-1].endswith(f"raised at {where})")


def test_a_failure_plan_that_keeps_a_goal_lets_it_be_achieved_later():
    lab = Lab(
        +p(1) >> [go(), do("after")], go() >> [do("a"), sub()], -go() >> [do("failed")], sub() >> [wait(1), do("c")]
    )
    lab.tell(+p(1))
    lab.until(2)
    assert lab.done == ["a", "c", "after"]
    assert lab.kinds("achieved") == ["sub()", "go()"]


def test_a_failure_plan_can_be_atomic():
    lab = Lab(go() >> [fail()], atomic(-go() >> [do("f")] * 3), +p(X) >> [do("p")] * 3)
    lab.tell(+p(1), go())
    assert "fff" in "".join(lab.done)
    assert lab.done.count("p") == 3


def test_a_failed_atomic_plan_is_atomic_no_longer():
    lab = Lab(atomic(go() >> [do("a"), fail()]), -go() >> [wait(1), do("f")], +p(X) >> [do("p")])
    lab.tell(go())
    lab.tell(+p(1))
    assert lab.done == ["a", "p"]


@pytest.mark.parametrize("seconds", [None, "", math.nan, math.inf])
def test_a_wait_that_is_no_time_fails_its_goal(seconds):
    lab = Lab(go(X) >> [wait(X), do("never")], -go(X) >> [do("instead")])
    lab.tell(go(seconds))
    assert lab.done == ["instead"]


def test_a_belief_that_cannot_be_kept_fails_its_plan_and_is_not_on_the_trace():
    lab = Lab(go() >> [+p(compute(lambda: ["unhashable"])), do("never")], -go() >> [do("instead")])
    lab.tell(go())
    assert lab.done == ["instead"]
    assert lab.kinds("belief") == []
