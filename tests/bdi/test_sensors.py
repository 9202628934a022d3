"""Sensors: pushed, asked in periods, once, suspended and resumed, in threads of their own."""

from __future__ import annotations

import queue
import threading

import pytest

from socialbot.bdi import Engine, Sensed, Sensor, ThreadSensor, Trace
from socialbot.bdi.sensors import changes
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, do, p


class Clockwork(Sensor):
    """Sensor that returns its number of calls."""

    period_s = 1.0
    asked = 0

    def sense(self, percept) -> Sensed:
        self.asked += 1
        return +p(self.asked)


class Ears(Sensor):
    def sense(self, percept):
        return None if percept == "noise" else +p(percept)


def timers(lab: Lab) -> int:
    return len(lab.engine.timers.heap)


class TestPeriods:
    def test_it_is_asked_at_once_and_then_in_each_period(self):
        lab = Lab(+p(X) >> [do(X)])
        lab.engine.add_sensor(Clockwork())
        lab.until(2.5)
        assert lab.timeline == [(0, 1), (1, 2), (2, 3)]

    def test_a_suspended_one_keeps_no_timer_and_is_not_asked(self):
        lab = Lab(+p(X) >> [do(X)])
        sensor = Clockwork()
        lab.engine.add_sensor(sensor)
        lab.until(1)
        sensor.suspend()
        lab.engine.run_until_idle()
        assert lab.engine.next_wakeup() is None
        lab.until(10)
        assert sensor.asked == 2

    def test_it_is_resumed_with_one_timer_however_often_that_is_said(self):
        lab = Lab()
        sensor = Clockwork()
        lab.engine.add_sensor(sensor)
        lab.until(0.5)
        for _ in range(3):
            sensor.suspend()
            sensor.resume()
            sensor.resume()
        lab.engine.run_until_idle()
        assert (sensor.asked, timers(lab)) == (2, 1)
        lab.until(3)
        assert sensor.asked == 4

    def test_adding_it_twice_asks_it_once_in_each_period(self):
        lab = Lab()
        sensor = Clockwork()
        lab.engine.add_sensor(sensor)
        lab.engine.run_until_idle()
        lab.engine.add_sensor(sensor)
        lab.until(2)
        assert (sensor.asked, timers(lab)) == (3, 1)

    def test_it_may_stop_itself_while_it_is_asked(self):
        class Shy(Clockwork):
            def sense(self, percept):
                self.stop()
                return super().sense(percept)

        lab = Lab()
        sensor = Shy()
        lab.engine.add_sensor(sensor)
        lab.until(5)
        assert (sensor.asked, sensor.running, timers(lab)) == (1, False, 0)

    def test_once_ends_with_the_first_percept_that_has_a_result(self):
        class Patient(Clockwork):
            once = True

            def sense(self, percept):
                found = super().sense(percept)
                return found if self.asked == 3 else None

        lab = Lab()
        sensor = Patient()
        lab.engine.add_sensor(sensor)
        lab.until(10)
        assert (sensor.asked, sensor.running, timers(lab)) == (3, False, 0)
        assert lab.beliefs == ["p(3)"]

    def test_restarts_after_stop(self):
        lab = Lab()
        sensor = Clockwork()
        lab.engine.add_sensor(sensor)
        lab.until(1)
        sensor.stop()
        lab.until(5)
        sensor.start()
        lab.until(6)
        assert sensor.asked == 4


class TestPushing:
    def test_once_uses_the_first_percept_that_has_a_result(self):
        lab = Lab()
        ears = Ears()
        ears.once = True
        lab.engine.add_sensor(ears)
        for percept in ("noise", "one", "two"):
            ears.push(percept)
        lab.engine.run_until_idle()
        assert lab.beliefs == ['p("one")']
        assert not ears.running

    def test_suspended_sensor_discards_percepts(self):
        lab = Lab()
        ears = Ears()
        lab.engine.add_sensor(ears)
        ears.suspend()
        ears.push("one")
        lab.engine.run_until_idle()
        ears.resume()
        ears.push("two", cause="frame-2", since=-5)
        lab.engine.run_until_idle()
        (held,) = lab.engine.beliefs
        assert (str(held.belief), held.source, held.since) == ('p("two")', "percept", -5)

    def test_push_without_an_engine_is_an_error(self):
        with pytest.raises(RuleError, match="add_sensor"):
            Ears().push("one")

    def test_it_belongs_to_one_engine(self):
        ears = Ears()
        Engine("a", ManualClock()).add_sensor(ears)
        with pytest.raises(RuleError, match="belongs to a"):
            Engine("b", ManualClock()).add_sensor(ears)

    def test_threads_add_push_and_suspend_while_the_engine_runs(self):
        lab = Lab()
        posted = threading.Event()
        lab.engine.wake = posted.set

        def work(number: int) -> None:
            ears, clockwork = Ears(), Clockwork()
            clockwork.period_s = 1000.0
            lab.engine.add_sensor(ears)
            lab.engine.add_sensor(clockwork)
            lab.engine.call(lambda: lab.engine.add_rules(+p(str(number)) >> [do(number)]))
            ears.push(str(number))
            clockwork.suspend()
            clockwork.resume()

        threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads) or lab.engine.interpreter.inbox:
            lab.engine.run_until_idle()
            posted.wait(0.001)
        lab.engine.run_until_idle()
        assert sorted(lab.done) == list(range(8))
        assert timers(lab) == 8
        assert lab.kinds("failure") == []


class Line(ThreadSensor):
    """Sensor that reads a queue; None ends it."""

    retry_s = 0.0

    def __init__(self) -> None:
        self.line: queue.SimpleQueue[object] = queue.SimpleQueue()
        self.ended = threading.Event()

    def read(self):
        item = self.line.get(timeout=60)
        if isinstance(item, Exception):
            raise item
        return item

    def sense(self, percept):
        return +p(percept)

    def _watch(self, ending):
        try:
            super()._watch(ending)
        finally:
            self.ended.set()


class TestThreads:
    def lab(self) -> tuple[Lab, Line, threading.Event]:
        lab, line, posted = Lab(+p(X) >> [do(X)]), Line(), threading.Event()
        lab.engine.wake = posted.set
        lab.engine.add_sensor(line)
        return lab, line, posted

    def settle(self, lab: Lab, posted: threading.Event, so) -> None:
        while True:
            posted.clear()
            lab.engine.run_until_idle()
            if so():
                return
            assert posted.wait(60)

    def test_senses_percepts_in_the_thread_of_the_engine(self):
        lab, line, posted = self.lab()
        for item in (1, None, 2, EOFError()):
            line.line.put(item)
        self.settle(lab, posted, lambda: lab.done == [1, 2])
        assert line.ended.wait(60)

    def test_an_exception_is_on_the_trace_and_it_reads_on(self):
        lab, line, posted = self.lab()
        for item in (OSError("unplugged"), 2, EOFError()):
            line.line.put(item)
        self.settle(lab, posted, lambda: lab.done == [2])
        assert lab.kinds("failure") == ["Line"]

    def test_ends_with_stop_and_restarts(self):
        lab, line, posted = self.lab()
        line.stop()
        line.line.put(1)
        assert line.ended.wait(60)
        line.start()
        line.line.put(2)
        self.settle(lab, posted, lambda: lab.done == [2])
        line.line.put(EOFError())

    def test_ends_without_an_override_of_read(self):
        lab, posted = Lab(), threading.Event()
        lab.engine.add_sensor(ThreadSensor())
        lab.engine.run_until_idle()
        assert not posted.is_set()
        assert lab.beliefs == []


def test_the_time_of_a_percept_is_given_or_now():
    lab = Lab(start=3)
    ears = Ears()
    lab.engine.add_sensor(ears)
    ears.push("one")
    lab.engine.run_until_idle()
    assert [held.since for held in lab.engine.beliefs] == [3 * SECOND]


class Blind(Sensor):
    def sense(self, percept: object) -> None:
        raise ValueError(f"no light at {percept}")


def test_repeated_failures_of_a_sensor_are_logged_at_powers_of_ten(caplog: pytest.LogCaptureFixture) -> None:
    trace = Trace()
    engine = Engine("owl", ManualClock(), sink=trace)
    blind = Blind()
    engine.add_sensor(blind)
    for number in range(120):
        blind.push(number)
    engine.run_until_idle()
    assert len(trace.find("failure", "Blind")) == 120
    told = [record.getMessage().partition(" (")[0] for record in caplog.records]
    assert told == [
        "owl: Blind: no light at 0",
        "owl: Blind 10 times: no light at 9",
        "owl: Blind 100 times: no light at 99",
    ]


async def later() -> None: ...


@pytest.mark.parametrize(
    ("sensed", "what", "remedy"),
    [
        (p, "a sensor returned the class p", "return p()"),
        ([p], "a sensor returned the class p", "return p()"),
        (3, "a sensor returned 3", "return beliefs"),
        ("here", "a sensor returned 'here'", "return beliefs"),
        (later(), "sense() of a sensor is a coroutine", "write def"),
    ],
)
def test_a_sensor_that_returns_something_else_is_told_what(sensed: object, what: str, remedy: str) -> None:
    with pytest.raises(RuleError) as caught:
        changes(sensed)  # type: ignore[arg-type]
    assert caught.value.what == what
    assert str(caught.value.remedy).startswith(remedy)
