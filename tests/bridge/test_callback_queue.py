from __future__ import annotations

import array
import itertools
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from socialbot.bridge import _callback_queue
from socialbot.bridge._callback_queue import GRACE_S, MAX_WAITING, CallbackQueue, IdleState, InputQueue
from socialbot.core.clock import SECOND, Clock, ManualClock, WallClock, nanoseconds
from socialbot.core.messages import CompressedImage, Message, RosMessage, Utterance
from socialbot.graph.health import HealthMonitor
from socialbot.graph.node import Node, NodeConfig
from socialbot.graph.ports import Delivery, Input


def port(name: str, delivery: Delivery = Delivery.EVERY) -> Input[Utterance]:
    made = Input(Utterance, f"/{name}", delivery)
    made.name = name
    return made


EVERY, OTHER = port("every"), port("other")
STREAM, STATE = port("stream", Delivery.NEWEST), port("state", Delivery.LATCHED)


def frame(number: int, period_s: float = 0.1) -> Utterance:
    return Utterance(stamp=nanoseconds(number * period_s), id=str(number), text=str(number))


def returns(value: object) -> Any:
    """A callback that returns ``value``."""
    return lambda: value


def result(item: Any) -> Any:
    """The result of a callback, the number of a message, or None of a closed queue."""
    if item is None:
        return None
    return item() if callable(item) else int(item[1].id)


class SimulatedQueue(CallbackQueue):
    """A queue in simulated time."""

    reports = False

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.states: list[IdleState] = []
        super().__init__(self.clock.now, simulated=True, on_idle=self.states.append if self.reports else None)

    def add(self, port: Input[Any], *numbers: int) -> None:
        for number in numbers:
            self.put(port, frame(number))

    def results(self, count: int) -> list[Any]:
        return [result(self.take()) for _ in range(count)]

    def take_input(self) -> InputQueue:
        item = self.take()
        assert isinstance(item, tuple)
        return item[0]


class ReportingQueue(SimulatedQueue):
    """A queue in simulated time that notes its idle states."""

    reports = True

    def idle_state(self) -> IdleState:
        before = len(self.states)
        assert result(self.take()) is None
        (state,) = self.states[before:]
        return state


@pytest.fixture
def queue() -> SimulatedQueue:
    return SimulatedQueue()


@pytest.fixture
def reporting() -> ReportingQueue:
    return ReportingQueue()


@pytest.mark.parametrize(
    ("port", "numbers"),
    [(EVERY, range(100)), (EVERY, (3, 2, 1)), (STREAM, (1, 2)), (STREAM, (100, 101, 1, 2))],
    ids=["all commands", "commands that overtake", "a stream of unknown cost", "a stream whose time was reset"],
)
def test_keeps_the_order(queue, port, numbers):
    queue.add(port, *numbers)
    assert queue.results(len(numbers)) == list(numbers)


def test_inputs_take_turns(queue):
    queue.add(EVERY, 1, 2, 3)
    queue.add(OTHER, 10, 20)
    assert queue.results(5) == [1, 10, 2, 20, 3]


def test_a_new_input_precedes_the_second_message_of_a_busy_one(queue):
    queue.add(EVERY, 1, 2)
    assert queue.results(1) == [1]
    queue.add(OTHER, 10)
    assert queue.results(2) == [2, 10]


def test_calls_precede_messages(queue):
    queue.add(EVERY, 1)
    queue.call_soon(returns("first"))
    queue.call_soon(returns("second"))
    assert queue.results(3) == ["first", "second", 1]


def test_a_slow_node_skips_to_the_newest_message_of_a_stream(queue):
    queue.add(STREAM, 0)
    stream = queue.take_input()
    stream.record_cost(0.35)
    queue.add(STREAM, 1, 2, 3)
    assert queue.results(1) == [3]
    assert (stream.received, stream.skipped, len(stream.waiting)) == (4, 2, 0)


def test_a_fast_node_catches_up_after_a_delay(queue):
    queue.add(STREAM, 0)
    stream = queue.take_input()
    stream.record_cost(0.09)
    queue.add(STREAM, *range(1, 11))
    assert queue.results(10) == list(range(1, 11))
    assert stream.skipped == 0


@pytest.mark.parametrize("first", [1000, -1000], ids=["pause", "reset"])
def test_a_slow_node_stays_slow_after_a_jump_of_the_stamps(queue, first):
    for number in range(10):
        queue.add(STREAM, number)
        queue.take_input().record_cost(0.35)
    queue.add(STREAM, first, first + 1, first + 2)
    assert queue.results(1) == [first + 2]


def test_one_slow_call_makes_no_slow_node(queue):
    for number in range(10):
        queue.add(STREAM, number)
        queue.take_input().record_cost(0.4 if number == 9 else 0.02)
    queue.add(STREAM, 10, 11, 12, 13)
    assert queue.results(4) == [10, 11, 12, 13]


def test_a_slow_node_skips_no_commands(queue):
    queue.add(EVERY, 0)
    queue.take_input().record_cost(9.0)
    queue.add(EVERY, *range(1, 50))
    assert queue.results(49) == list(range(1, 50))


def test_a_node_far_behind_loses_the_oldest_commands(queue, monkeypatch, caplog):
    monkeypatch.setattr(_callback_queue, "MAX_COMMANDS", 3)
    queue.add(EVERY, *range(13))
    (commands,) = queue.inputs
    assert (commands.received, commands.dropped, commands.skipped) == (13, 10, 0)
    assert queue.results(3) == [10, 11, 12]
    assert [record.getMessage() for record in caplog.records] == [
        f"input every: dropped {count} messages, since they arrive faster than the node handles them"
        for count in (1, 10)
    ]


@pytest.mark.parametrize("kind", ["image", "ros array", "ros text"])
def test_a_node_far_behind_keeps_a_limited_size_of_data(queue, monkeypatch, kind):
    monkeypatch.setattr(_callback_queue, "MAX_DATA_BYTES", 300)
    every = Input(Message, "/large")
    every.name = "large"

    def large(size: int) -> Any:
        if kind == "image":
            return CompressedImage(stamp=1, frame_id="", format="jpeg", data=np.zeros(size, np.uint8))
        data: Any = "x" * size if kind == "ros text" else array.array("H", bytes(size))
        return RosMessage(stamp=1, ros=SimpleNamespace(data=data))

    for _ in range(5):
        queue.put(every, large(100))
    (images,) = queue.inputs
    assert (len(images.waiting), images.dropped) == (3, 2)
    queue.take_input()
    queue.put(every, large(100))
    assert (len(images.waiting), images.dropped) == (3, 2)
    queue.put(every, large(1000))
    assert (len(images.waiting), images.dropped) == (1, 5)


def test_limits_the_waiting_messages_of_a_stream(queue):
    queue.add(STREAM, *range(MAX_WAITING + 5))
    assert queue.results(1) == [5]
    (stream,) = queue.inputs
    assert (stream.skipped, len(stream.waiting)) == (5, MAX_WAITING - 1)


def test_keeps_only_the_last_message_of_a_latched_topic(queue):
    queue.add(STATE, 1, 2, 3)
    assert queue.results(1) == [3]
    (state,) = queue.inputs
    assert (state.received, state.skipped, len(state.waiting)) == (3, 2, 0)


def test_drops_overtaken_messages_of_a_stream(queue):
    queue.add(STREAM, 1, 3, 2, 4, 4)
    assert queue.results(4) == [1, 3, 4, 4]
    (stream,) = queue.inputs
    assert (stream.received, stream.skipped) == (5, 1)
    queue.add(STREAM, 3)
    queue.call_soon(returns("nothing else waits"))
    assert queue.results(1) == ["nothing else waits"]
    queue.close()
    assert queue.take() is None


SEEN = Input(Utterance, "/seen", deadline_s=0.3)
SEEN.name = "seen"


@pytest.fixture
def live(monkeypatch) -> SimpleNamespace:
    """Return a queue on a clock that ``wait`` moves; `take` gives the numbers of all messages that wait."""
    clock = ManualClock(100 * SECOND)
    steady = [0.0]
    monkeypatch.setattr(_callback_queue.time, "monotonic", lambda: steady[0])
    queue = CallbackQueue(clock.now, simulated=False)

    def wait(seconds: float) -> None:
        clock.advance(seconds)
        steady[0] += seconds

    def add(*ages_s: float, port: Input[Any] = SEEN) -> None:
        for age_s in ages_s:
            queue.put(port, Utterance(stamp=clock.now() - nanoseconds(age_s), id=f"{age_s:.1f}", text=""))

    def take() -> list[str]:
        found: list[str] = []
        while True:
            queue.put(OTHER, Utterance(stamp=clock.now(), id="end", text=""))  # so that it never waits
            while (id := queue.take()[1].id) != "end":  # type: ignore[index]
                found.append(id)
            if not any(each.waiting for each in queue.inputs):
                return found

    return SimpleNamespace(clock=clock, queue=queue, wait=wait, add=add, take=take)


def usual(live, offset_s: float = 0.0, count: int = 10) -> None:
    for _ in range(count):
        live.wait(0.1)
        live.add(offset_s + 0.1)
        assert live.take() == [f"{offset_s + 0.1:.1f}"]


@pytest.mark.parametrize("offset_s", [0.0, 3600.0, -3600.0])
def test_observations_of_before_an_outage_are_skipped(live, offset_s):
    usual(live, offset_s)
    live.wait(5.0)
    live.add(*(offset_s + age_s for age_s in (4.5, 3.5, 2.5, 1.5, 0.5)))
    assert live.take() == [f"{offset_s + 1.5:.1f}", f"{offset_s + 0.5:.1f}"]
    assert [each.skipped for each in live.queue.inputs if each.port is SEEN] == [3]


def test_observations_of_before_an_outage_are_skipped_one_by_one_too(live):
    usual(live)
    live.wait(5.0)
    for age_s in (4.5, 3.5, 2.5):
        live.add(age_s)
        assert live.take() == []
        live.wait(0.01)
    usual(live)


def test_observations_that_stay_late_count_after_a_second(live):
    usual(live)
    live.wait(5.0)
    live.clock.advance(30.0)  # the clock of this machine was set, or the sender is slow from now on
    taken = 0
    for _ in range(15):
        live.wait(0.1)
        live.add(30.0)
        taken += len(live.take())
    assert 3 <= taken <= 5
    usual(live, 30.0)


def test_a_clock_that_is_set_costs_no_observation(live):
    usual(live)
    live.clock.advance(3600.0)
    usual(live, 3600.0)
    live.wait(5.0)
    live.add(3604.0, 3600.5)
    assert live.take() == ["3600.5"]


def test_a_bag_that_is_played_slowly_loses_no_observation(live):
    for count in range(400):
        live.wait(0.2)
        live.add(1.0 + 0.1 * count)
        assert live.take() == [f"{1.0 + 0.1 * count:.1f}"]


def test_stamps_that_stand_still_tell_no_delay(live):
    for count in range(5, 100, 5):
        live.wait(5.0)
        live.add(float(count))
        assert live.take() == [f"{count:.1f}"]


def test_stamps_that_go_back_are_no_delay(live):
    usual(live)
    live.wait(5.0)
    live.add(60.0)
    assert live.take() == ["60.0"]
    usual(live, 59.0)


@pytest.mark.parametrize("each", [EVERY, STREAM, STATE])
def test_commands_and_states_are_never_too_late(live, each):
    live.add(0.1, port=each)
    assert live.take() == ["0.1"]
    live.wait(5.0)
    live.add(4.0, port=each)
    assert live.take() == ["4.0"]


def test_simulated_time_knows_no_delay(queue):
    queue.add(SEEN, 1, 2, 3)
    queue.clock.advance(100.0)
    assert [result(queue.take()) for _ in range(3)] == [1, 2, 3]


def test_counts_the_messages_of_each_input(queue):
    queue.add(EVERY, 1, 2)
    queue.add(STATE, 1, 2)
    counts = {each.port.name: (each.received, each.skipped) for each in queue.inputs}
    assert counts == {"every": (2, 0), "state": (2, 1)}


def test_the_cost_follows_within_a_few_messages():
    stream = InputQueue(STREAM)
    stream.record_cost(0.1)
    assert stream.cost_s == 0.1
    for _ in range(20):
        stream.record_cost(0.5)
    assert stream.cost_s == pytest.approx(0.5, rel=0.1)


class TestTimers:
    def test_due_ones_precede_messages(self, queue):
        queue.add(EVERY, 1)
        queue.call_at(0, returns("timer"))
        assert queue.results(2) == ["timer", 1]

    def test_later_ones_let_messages_pass(self, queue):
        queue.call_at(SECOND, returns("timer"))
        queue.add(EVERY, 1, 2)
        assert queue.results(1) == [1]
        queue.clock.set(SECOND)
        assert queue.results(2) == ["timer", 2]

    def test_fire_by_time_and_then_by_order(self, queue):
        for name, at in (("c", 3), ("a", 1), ("a2", 1), ("b", 2)):
            queue.call_at(at * SECOND, returns(name))
        queue.clock.set(3 * SECOND)
        assert queue.results(4) == ["a", "a2", "b", "c"]

    def test_do_not_fire_when_cancelled(self, queue):
        timer = queue.call_at(SECOND, returns("cancelled"))
        queue.call_at(SECOND, returns("kept"))
        timer.cancel()
        queue.clock.set(SECOND)
        queue.add(EVERY, 1)
        assert queue.results(2) == ["kept", 1]

    def test_follow_simulated_time(self, queue):
        queue.call_at(nanoseconds(0.01), returns("timer"))
        taker = Taker(queue)
        queue.clock.set(nanoseconds(0.005))
        queue.recheck()
        assert not taker.has_result(0.03)
        queue.clock.set(nanoseconds(0.01))
        queue.recheck()
        assert taker.result() == "timer"

    def test_do_not_poll_simulated_time(self):
        looks = []
        queue = CallbackQueue(lambda: looks.append(1) or 0, simulated=True)
        queue.call_at(nanoseconds(0.001), lambda: None)
        Taker(queue)
        assert len(looks) <= 2
        queue.close()

    def test_fire_by_the_wall_clock_and_not_early(self):
        clock = WallClock()
        queue = CallbackQueue(clock.now, simulated=False)
        due = clock.now() + nanoseconds(0.08)
        queue.call_at(due, clock.now)  # type: ignore[arg-type]
        assert due <= Taker(queue).result()

    def test_an_earlier_one_wakes_the_thread(self):
        clock = WallClock()
        queue = CallbackQueue(clock.now, simulated=False)
        queue.call_at(clock.now() + 60 * SECOND, returns("late"))
        taker = Taker(queue)
        queue.call_at(clock.now(), returns("early"))
        assert taker.result() == "early"


class Taker:
    """A thread that takes one item, and waits for it at the start."""

    def __init__(self, queue: CallbackQueue) -> None:
        self.taken: list[Any] = []
        self.thread = threading.Thread(target=lambda: self.taken.append(queue.take()), daemon=True)
        self.thread.start()
        assert not self.has_result(0.03)

    def has_result(self, timeout_s: float) -> bool:
        self.thread.join(timeout_s)
        return bool(self.taken)

    def result(self) -> Any:
        assert self.has_result(5), "still waiting"
        return result(self.taken[0])


@pytest.mark.parametrize(
    ("wake", "taken"),
    [
        (lambda queue: queue.add(EVERY, 7), 7),
        (lambda queue: queue.call_soon(returns("called")), "called"),
        (lambda queue: queue.close(), None),
    ],
    ids=["put", "call_soon", "close"],
)
def test_wakes_the_waiting_thread(queue, wake: Callable[[Any], None], taken):
    taker = Taker(queue)
    wake(queue)
    assert taker.result() == taken


def test_a_closed_queue_returns_nothing(queue):
    queue.add(EVERY, 1)
    assert not queue.closed
    queue.close()
    assert queue.closed
    assert queue.take() is None


def test_loses_no_message_of_many_threads(queue):
    ports = [port(f"p{number}") for number in range(4)]
    threads = [threading.Thread(target=queue.add, args=(each, *range(250))) for each in ports]
    for thread in threads:
        thread.start()
    taken: dict[str, list[int]] = {each.name: [] for each in ports}
    for _ in range(1000):
        item = queue.take()
        taken[item[0].port.name].append(int(item[1].id))
    assert all(numbers == list(range(250)) for numbers in taken.values())
    for thread in threads:
        thread.join()


class TestOnIdle:
    def test_follows_everything_that_waits_or_is_due(self, reporting: ReportingQueue):
        reporting.add(EVERY, 1)
        reporting.call_at(SECOND, returns("timer"))
        reporting.call_soon(returns("call"))
        reporting.clock.set(SECOND)
        assert reporting.results(3) == ["call", "timer", 1]
        assert reporting.idle_state() == IdleState(SECOND, {EVERY: 1}, 0, 0, 0)

    def test_does_not_wait_for_later_timers(self, reporting: ReportingQueue):
        reporting.call_at(SECOND, lambda: None)
        assert reporting.idle_state().time == 0

    def test_is_called_once_after_each_change(self, reporting: ReportingQueue):
        reporting.idle_state()
        taker = Taker(reporting)
        reporting.recheck()
        assert taker.result() is None
        assert len(reporting.states) == 2

    def test_waits_for_expected_calls(self, reporting: ReportingQueue):
        reporting.expect()
        taker = Taker(reporting)
        reporting.call_expected(returns("done"))
        assert taker.result() == "done"
        reporting.idle_state()


class TestRelease:
    def test_held_messages_wait_for_the_next_round(self, reporting: ReportingQueue):
        reporting.put(EVERY, frame(1), (0, 1))
        assert reporting.idle_state() == IdleState(0, {EVERY: 1}, 1, 0, 0)
        reporting.release(0)
        assert reporting.idle_state().held == 1
        reporting.release(1)
        assert reporting.results(1) == [1]
        assert reporting.idle_state() == IdleState(0, {EVERY: 1}, 0, 1, 0)

    def test_messages_that_arrived_after_the_report_wait_for_a_later_round(self, reporting: ReportingQueue):
        reporting.put(EVERY, frame(1), (0, 1))
        reported = reporting.idle_state().total
        reporting.put(OTHER, frame(2), (0, 1))
        reporting.release(1, arrived=reported)
        assert reporting.results(1) == [1]
        assert reporting.idle_state() == IdleState(0, {EVERY: 1, OTHER: 1}, 1, 1, 0)
        reporting.release(2, arrived=2)
        assert reporting.results(1) == [2]

    def test_the_order_does_not_depend_on_the_arrival(self, reporting: ReportingQueue):
        waiting = [(OTHER, 20, (1, 1)), (EVERY, 5, (0, 2)), (EVERY, 7, (0, 1)), (EVERY, 6, (0, 1))]
        for round, arrived in enumerate(itertools.permutations(waiting), 1):
            for port, number, order in arrived:
                reporting.put(port, frame(number), order)
            reporting.release(round)
            taken = reporting.results(4)
            assert [number for number in taken if number != 20] == [6, 7, 5]

    def test_a_message_without_an_order_follows_those_that_are_held(self, reporting: ReportingQueue):
        reporting.put(EVERY, frame(1), (0, 1))
        reporting.add(EVERY, 2)
        assert reporting.results(2) == [1, 2]

    def test_a_request_to_repeat_calls_on_idle_again(self, reporting: ReportingQueue):
        reporting.idle_state()
        reporting.release(0, repeat=3)
        assert reporting.idle_state().repeat == 3


class Watcher(Node):
    """Record the notifications about its input."""

    eye = Input(Utterance, "/eye", deadline_s=0.3)

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.events: list[str] = []

    @eye
    def on_eye(self, message: Utterance) -> None: ...

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self.events.append("silent")

    def on_return(self, port: Input[Any]) -> None:
        self.events.append("back")


class Watched:
    """A queue that monitors the input of a node after five messages, ten a second."""

    def __init__(self, clock: Clock, *, simulated: bool, reports: bool = False) -> None:
        self.clock = clock

        def on_idle(_: IdleState) -> None:
            self.node.events.append("idle")

        self.queue = CallbackQueue(clock.now, simulated=simulated, on_idle=on_idle if reports else None)
        health = HealthMonitor(NodeConfig("watcher", Watcher), clock, lambda *_: None)
        self.node = Watcher("watcher", SimpleNamespace(clock=clock, health_monitor=health))  # type: ignore[arg-type]
        health.begin(self.node, lambda time, beat: None)
        self.queue.monitor_inputs(health)
        for number in range(5):
            if isinstance(clock, ManualClock):
                clock.set(frame(number).stamp)
            self.put(number)
            self.act()

    def put(self, number: int) -> None:
        self.queue.put(Watcher.eye, frame(number))

    def act(self) -> None:
        item = self.queue.take()
        if callable(item):
            item()


@pytest.fixture
def watched() -> Watched:
    return Watched(ManualClock(), simulated=True)


class TestDeadlines:
    def test_reports_silence_when_due_and_its_end_before_the_message(self, watched):
        watched.clock.set(nanoseconds(0.8))
        watched.act()
        assert watched.node.events == ["silent"]
        watched.put(8)
        watched.act()
        assert watched.node.events == ["silent", "back"]
        assert result(watched.queue.take()) == 8

    def test_reports_no_silence_while_simulated_time_stands_still(self, watched):
        assert not Taker(watched.queue).has_result(0.4)
        watched.queue.close()

    def test_reports_no_silence_for_messages_in_transit(self, watched):
        # Simulated time may arrive before the messages of that time.
        watched.clock.set(nanoseconds(0.8))
        late = threading.Timer(GRACE_S / 4, lambda: watched.put(8))
        late.start()
        assert result(watched.queue.take()) == 8
        late.join()
        assert watched.node.events == []

    def test_follows_the_wall_clock_and_is_not_early(self):
        watched = Watched(WallClock(), simulated=False)
        begun = time.monotonic()
        watched.act()
        assert watched.node.events == ["silent"]
        assert time.monotonic() - begun + 0.01 >= 0.3

    def test_a_possible_silence_delays_the_idle_call(self):
        clock = ManualClock()
        watched = Watched(clock, simulated=True, reports=True)
        watched.act()
        clock.set(nanoseconds(0.8))
        watched.queue.recheck()
        watched.act()
        watched.act()
        assert watched.node.events == ["idle", "silent", "idle"]
