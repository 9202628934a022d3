from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge._callback_queue import GRACE_S, MAX_WAITING, CallbackQueue, InputQueue
from socialbot.core.clock import SECOND, Clock, ManualClock, WallClock, nanoseconds
from socialbot.core.messages import Utterance
from socialbot.graph.health import HealthMonitor
from socialbot.graph.node import Delivery, Input, NodeConfig
from socialbot.graph.node import Node as GraphNode


def port(name: str, delivery: Delivery = Delivery.EVERY) -> Input[Utterance]:
    made = Input(Utterance, f"/{name}", delivery)
    made.name = name
    return made


EVERY, OTHER = port("every"), port("other")
STREAM, STATE = port("stream", Delivery.NEWEST), port("state", Delivery.LATCHED)


def frame(number: int, period_s: float = 0.1) -> Utterance:
    return Utterance(stamp=nanoseconds(number * period_s), id=str(number), text=str(number))


class Node:
    """An inbox in simulated time, and what is taken from it."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.inbox = CallbackQueue(self.clock.now, simulated=True)

    def put(self, port: Input[Any], *numbers: int) -> None:
        for number in numbers:
            self.inbox.put(port, frame(number))

    def take(self) -> Any:
        """The next message's number; a call is made and its result given."""
        item = self.inbox.take()
        assert item is not None
        return item() if callable(item) else int(item[1].id)  # type: ignore[attr-defined]

    def take_line(self) -> tuple[InputQueue, Any]:
        item = self.inbox.take()
        assert isinstance(item, tuple)
        return item


def test_commands_come_all_and_in_order():
    node = Node()
    node.put(EVERY, *range(100))
    assert [node.take() for _ in range(100)] == list(range(100))


def test_inputs_take_turns():
    node = Node()
    node.put(EVERY, 1, 2, 3)
    node.put(OTHER, 10, 20)
    assert [node.take() for _ in range(5)] == [1, 10, 2, 20, 3]


def test_a_new_input_comes_before_the_second_of_a_busy_one():
    node = Node()
    node.put(EVERY, 1, 2)
    assert node.take() == 1
    node.put(OTHER, 10)
    assert [node.take(), node.take()] == [2, 10]


def test_calls_go_before_messages_in_their_order():
    node = Node()
    node.put(EVERY, 1)
    node.inbox.call_soon(lambda: "first")  # type: ignore[arg-type, return-value]
    node.inbox.call_soon(lambda: "second")  # type: ignore[arg-type, return-value]
    assert [node.take() for _ in range(3)] == ["first", "second", 1]


def test_of_a_stream_that_is_too_fast_the_newest_is_taken():
    node = Node()
    node.put(STREAM, 0)
    line, _ = node.take_line()
    line.record_cost(0.35)
    node.put(STREAM, 1, 2, 3)
    assert node.take() == 3
    assert (line.received, line.skipped, len(line.waiting)) == (4, 2, 0)


def test_of_a_stream_that_is_slow_enough_nothing_is_lost_after_a_hold_up():
    node = Node()
    node.put(STREAM, 0)
    line, _ = node.take_line()
    line.record_cost(0.09)
    node.put(STREAM, *range(1, 11))
    assert [node.take() for _ in range(10)] == list(range(1, 11))
    assert line.skipped == 0


@pytest.mark.parametrize("first", [1000, -1000], ids=["a pause", "a bag that begins anew"])
def test_a_node_that_is_too_slow_is_so_after_a_jump_of_the_stamps_as_well(first):
    node = Node()
    for number in range(10):
        node.put(STREAM, number)
        line, _ = node.take_line()
        line.record_cost(0.35)
    node.put(STREAM, first, first + 1, first + 2)
    assert node.take() == first + 2


def test_one_call_that_was_held_up_makes_no_node_slow():
    node, line = Node(), InputQueue(STREAM)
    for number in range(10):
        node.put(STREAM, number)
        line, _ = node.take_line()
        line.record_cost(0.02)
    line.record_cost(0.4)
    node.put(STREAM, 10, 11, 12, 13)
    assert [node.take() for _ in range(4)] == [10, 11, 12, 13]


def test_a_stream_of_unknown_cost_is_taken_in_order():
    node = Node()
    node.put(STREAM, 1, 2)
    assert [node.take(), node.take()] == [1, 2]


def test_commands_are_never_skipped_however_slow_the_node_is():
    node = Node()
    node.put(EVERY, 0)
    line, _ = node.take_line()
    line.record_cost(9.0)
    node.put(EVERY, *range(1, 50))
    assert [node.take() for _ in range(49)] == list(range(1, 50))


def test_the_backlog_of_a_stream_is_bounded():
    node = Node()
    node.put(STREAM, *range(MAX_WAITING + 5))
    line, message = node.take_line()
    assert message.id == "5"
    assert line.skipped == 5
    assert len(line.waiting) == MAX_WAITING - 1


def test_of_a_state_only_the_last_is_kept():
    node = Node()
    node.put(STATE, 1, 2, 3)
    line, message = node.take_line()
    assert message.id == "3"
    assert (line.received, line.skipped) == (3, 2)
    assert not line.waiting


def test_the_cost_follows_within_a_few_messages():
    line = InputQueue(STREAM)
    line.record_cost(0.1)
    assert line.cost_s == 0.1
    for _ in range(20):
        line.record_cost(0.5)
    assert line.cost_s == pytest.approx(0.5, rel=0.1)


def test_the_lines_tell_what_became_of_each_input():
    node = Node()
    node.put(EVERY, 1, 2)
    node.put(STATE, 1, 2)
    assert {line.port.name: (line.received, line.skipped) for line in node.inbox.inputs} == {
        "every": (2, 0), "state": (2, 1),
    }  # fmt: skip


# Alarms


def test_an_alarm_of_the_present_goes_before_messages():
    node = Node()
    node.put(EVERY, 1)
    node.inbox.call_at(0, lambda: "alarm")  # type: ignore[arg-type, return-value]
    assert [node.take(), node.take()] == ["alarm", 1]


def test_an_alarm_of_the_future_lets_messages_pass():
    node = Node()
    node.inbox.call_at(SECOND, lambda: "alarm")  # type: ignore[arg-type, return-value]
    node.put(EVERY, 1, 2)
    assert node.take() == 1
    node.clock.set(SECOND)
    assert [node.take(), node.take()] == ["alarm", 2]


def test_alarms_go_off_by_time_and_those_of_one_moment_in_their_order():
    node = Node()
    for name, at in (("c", 3), ("a", 1), ("a2", 1), ("b", 2)):
        node.inbox.call_at(at * SECOND, lambda name=name: name)  # type: ignore[misc]
    node.clock.set(3 * SECOND)
    assert [node.take() for _ in range(4)] == ["a", "a2", "b", "c"]


def test_a_cancelled_alarm_does_not_go_off():
    node = Node()
    alarm = node.inbox.call_at(SECOND, lambda: "cancelled")  # type: ignore[arg-type, return-value]
    node.inbox.call_at(SECOND, lambda: "kept")  # type: ignore[arg-type, return-value]
    alarm.cancel()
    node.clock.set(SECOND)
    node.put(EVERY, 1)
    assert [node.take(), node.take()] == ["kept", 1]


class Taker:
    """A thread that takes one item."""

    def __init__(self, inbox: CallbackQueue) -> None:
        self.taken: list[Any] = []
        self.thread = threading.Thread(target=lambda: self.taken.append(inbox.take()), daemon=True)
        self.thread.start()
        time.sleep(0.03)
        assert self.taken == []

    def result(self) -> Any:
        self.thread.join(5)
        assert self.taken, "still waiting"
        item = self.taken[0]
        return item() if callable(item) else item


def test_a_simulated_alarm_goes_off_when_time_has_moved_and_not_by_the_wall():
    node = Node()
    node.inbox.call_at(nanoseconds(0.01), lambda: "alarm")  # type: ignore[arg-type, return-value]
    taker = Taker(node.inbox)
    node.clock.set(nanoseconds(0.005))
    node.inbox.time_changed()
    time.sleep(0.03)
    assert taker.taken == []
    node.clock.set(nanoseconds(0.01))
    node.inbox.time_changed()
    assert taker.result() == "alarm"


def test_while_simulated_time_stands_still_nobody_looks_at_the_clock():
    looks = []
    inbox = CallbackQueue(lambda: looks.append(1) or 0, simulated=True)
    inbox.call_at(nanoseconds(0.001), lambda: None)
    Taker(inbox)
    assert len(looks) <= 2
    inbox.close()


def test_an_alarm_by_the_wall_goes_off_by_itself_and_not_early():
    clock = WallClock()
    inbox = CallbackQueue(clock.now, simulated=False)
    due = clock.now() + nanoseconds(0.08)
    inbox.call_at(due, lambda: clock.now())  # type: ignore[arg-type, return-value]
    assert due <= Taker(inbox).result() < due + 2 * SECOND


def test_an_earlier_alarm_wakes_the_taker_in_time():
    clock = WallClock()
    inbox = CallbackQueue(clock.now, simulated=False)
    inbox.call_at(clock.now() + 60 * SECOND, lambda: "late")  # type: ignore[arg-type, return-value]
    taker = Taker(inbox)
    inbox.call_at(clock.now(), lambda: "early")  # type: ignore[arg-type, return-value]
    assert taker.result() == "early"


# Threads


@pytest.mark.parametrize("wake", ["put", "call_soon", "close"])
def test_whatever_comes_wakes_the_taker(wake):
    node = Node()
    taker = Taker(node.inbox)
    if wake == "put":
        node.put(EVERY, 7)
        assert taker.result()[1].id == "7"
    elif wake == "call_soon":
        node.inbox.call_soon(lambda: "called")  # type: ignore[arg-type, return-value]
        assert taker.result() == "called"
    else:
        node.inbox.close()
        assert taker.result() is None


def test_a_closed_inbox_hands_out_nothing():
    node = Node()
    node.put(EVERY, 1)
    assert not node.inbox.closed
    node.inbox.close()
    assert node.inbox.closed
    assert node.inbox.take() is None


def test_nothing_that_many_threads_put_is_lost():
    node = Node()
    ports = [port(f"p{number}") for number in range(4)]
    threads = [threading.Thread(target=node.put, args=(each, *range(250))) for each in ports]
    for thread in threads:
        thread.start()
    taken: dict[str, list[int]] = {each.name: [] for each in ports}
    for _ in range(1000):
        line, message = node.take_line()
        taken[line.port.name].append(int(message.id))
    assert all(numbers == list(range(250)) for numbers in taken.values())
    for thread in threads:
        thread.join()


class TestACallWhenIdle:
    def test_comes_after_everything_that_waits_or_is_due(self):
        node = Node()
        node.inbox.call_when_idle(lambda: "idle")  # type: ignore[arg-type, return-value]
        node.put(EVERY, 1)
        node.inbox.call_at(SECOND, lambda: "timer")  # type: ignore[arg-type, return-value]
        node.inbox.call_soon(lambda: "call")  # type: ignore[arg-type, return-value]
        node.clock.set(SECOND)
        assert [node.take() for _ in range(4)] == ["call", "timer", 1, "idle"]

    def test_does_not_wait_for_timers_that_are_to_come(self):
        node = Node()
        node.inbox.call_at(SECOND, lambda: None)
        node.inbox.call_when_idle(lambda: "idle")  # type: ignore[arg-type, return-value]
        assert node.take() == "idle"

    def test_takes_the_place_of_the_one_before(self):
        node = Node()
        node.inbox.call_when_idle(lambda: "old")  # type: ignore[arg-type, return-value]
        node.inbox.call_when_idle(lambda: "new")  # type: ignore[arg-type, return-value]
        assert node.take() == "new"
        node.put(EVERY, 1)
        assert node.take() == 1

    def test_waits_for_calls_that_are_expected(self):
        node = Node()
        node.inbox.expect()
        node.inbox.call_when_idle(lambda: "idle")  # type: ignore[arg-type, return-value]
        later = threading.Timer(0.1, lambda: node.inbox.call_expected(lambda: "worked out"))  # type: ignore[arg-type, return-value]
        later.start()
        assert [node.take(), node.take()] == ["worked out", "idle"]
        later.join()


class Watcher(GraphNode):
    """Notes what it is told of its input."""

    eye = Input(Utterance, "/eye", deadline_s=0.3)

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.told: list[str] = []

    @eye
    def on_eye(self, message: Utterance) -> None: ...

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self.told.append("silent")

    def on_return(self, port: Input[Any]) -> None:
        self.told.append("back")


class Watched:
    """An inbox that watches the input of a node; the node has had three messages, ten a second."""

    def __init__(self, clock: Clock, *, simulated: bool) -> None:
        self.clock = clock
        self.inbox = CallbackQueue(clock.now, simulated=simulated)
        placement = NodeConfig("watcher", Watcher)
        vitals = HealthMonitor(placement, clock, lambda _: None)
        self.node = Watcher("watcher", SimpleNamespace(clock=clock, vitals=vitals))  # type: ignore[arg-type]
        vitals.begin(self.node, lambda time, beat: None)
        self.inbox.monitor_inputs(vitals)

    def put(self, number: int) -> None:
        self.inbox.put(Watcher.eye, frame(number))

    def act(self) -> None:
        """Does what is to be done next."""
        item = self.inbox.take()
        if callable(item):
            item()


@pytest.fixture
def watched() -> Watched:
    clock = ManualClock()
    watched = Watched(clock, simulated=True)
    for number in range(5):
        clock.set(frame(number).stamp)
        watched.put(number)
        watched.act()
    return watched


class TestASilence:
    def test_is_told_when_it_is_due_and_its_end_before_the_message(self, watched):
        watched.clock.set(nanoseconds(0.8))
        watched.act()
        assert watched.node.told == ["silent"]
        watched.put(8)
        watched.act()
        assert watched.node.told == ["silent", "back"]
        assert watched.inbox.take()[1].id == "8"

    def test_is_none_while_simulated_time_stands_still(self, watched):
        taker = Taker(watched.inbox)
        time.sleep(0.4)
        assert taker.taken == []
        watched.inbox.close()

    def test_is_none_when_messages_were_only_late(self, watched):
        # Simulated time was told before the messages that came with it.
        watched.clock.set(nanoseconds(0.8))
        late = threading.Timer(GRACE_S / 4, lambda: watched.put(8))
        late.start()
        item = watched.inbox.take()
        late.join()
        assert isinstance(item, tuple)
        assert watched.node.told == []

    def test_by_the_wall_comes_by_itself_and_not_early(self):
        clock = WallClock()
        watched = Watched(clock, simulated=False)
        for number in range(5):
            watched.put(number)
            watched.act()
        begun = time.monotonic()
        watched.act()
        assert watched.node.told == ["silent"]
        assert time.monotonic() - begun + 0.01 >= 0.3

    def test_that_may_come_lets_nobody_be_idle_meanwhile(self, watched):
        watched.clock.set(nanoseconds(0.8))
        watched.inbox.call_when_idle(lambda: watched.node.told.append("idle"))
        watched.act()
        watched.act()
        assert watched.node.told == ["silent", "idle"]


def test_of_a_stream_what_was_overtaken_is_left_out():
    node = Node()
    node.put(STREAM, 1, 3, 2, 4, 4)
    assert [node.take() for _ in range(4)] == [1, 3, 4, 4]
    [line] = node.inbox.inputs
    assert (line.received, line.skipped) == (5, 1)
    node.put(STREAM, 3)
    node.inbox.call_soon(lambda: "nothing else waits")  # type: ignore[arg-type, return-value]
    assert node.take() == "nothing else waits"
    node.inbox.close()
    assert node.inbox.take() is None


def test_a_stream_whose_time_begins_anew_goes_on():
    node = Node()
    node.put(STREAM, 100, 101, 1, 2)
    assert [node.take() for _ in range(4)] == [100, 101, 1, 2]


def test_commands_are_never_overtaken():
    node = Node()
    node.put(EVERY, 3, 2, 1)
    assert [node.take() for _ in range(3)] == [3, 2, 1]
