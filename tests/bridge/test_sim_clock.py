"""Simulated time that waits for slow, busy, late and missing nodes."""

from __future__ import annotations

import logging
import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from socialbot.bridge import sim_clock as timeclock
from socialbot.bridge._host import NodeHost
from socialbot.bridge.sim_clock import MessageBalance, SimClock, StepReport
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output
from tests.bridge.hosting import node_hosts, spinning_nodes
from tests.system.running import eventually

pytestmark = pytest.mark.ros

SLOW_S = 0.3
"""Real time that a node needs."""


class Beat(Node):
    """Publishes every second."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.beats: list[int] = []
        self.call_after(1.0, self.beat)

    def beat(self) -> None:
        self.beats.append(self.clock.now())
        self.said.publish(Utterance(stamp=self.clock.now(), id=str(len(self.beats)), text="beat"))
        self.call_after(1.0, self.beat)


class Planner(Node):
    """Works in the background on each message, and notes the times of the message and of the result."""

    said = Input(Utterance, "/said")

    def start(self) -> None:
        self.known: list[tuple[int, int]] = []

    @said
    def on_said(self, message: Utterance) -> None:
        self.context.run_in_background(
            lambda: time.sleep(SLOW_S), lambda _: self.known.append((message.stamp, self.clock.now()))
        )


class Sleeper(Beat):
    """Takes real time for each beat."""

    def beat(self) -> None:
        time.sleep(SLOW_S)
        super().beat()


class Echo(Node):
    """Answers each beat, and notes all that it gets with the time."""

    said = Input(Utterance, "/said")
    answers = Input(Utterance, "/answers")
    answer = Output(Utterance, "/answers")

    def start(self) -> None:
        self.heard: list[tuple[int, str]] = []

    @said
    def on_said(self, message: Utterance) -> None:
        self.heard.append((self.clock.now(), message.id))
        self.answer.publish(Utterance(stamp=self.clock.now(), id=message.id, text=self.name))

    @answers
    def on_answer(self, message: Utterance) -> None:
        self.heard.append((self.clock.now(), message.text))


class Minutes(Node):
    """Notes answers and beats in the order in which it gets them."""

    answers = Input(Utterance, "/answers")
    said = Input(Utterance, "/said")

    def start(self) -> None:
        self.heard: list[str] = []

    @answers
    @said
    def on_utterance(self, message: Utterance) -> None:
        self.heard.append(message.text)


@pytest.fixture
def transit(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[str], float | None]], None]:
    """A function that sets the transit time (s) of messages to a node; None loses them."""
    receive = NodeHost._receive

    def delay(transit_s: Callable[[str], float | None]) -> None:
        def delayed(self: NodeHost, *message: Any) -> None:
            if (seconds := transit_s(self.name)) is not None:
                threading.Timer(seconds, receive, (self, *message)).start()

        monkeypatch.setattr(NodeHost, "_receive", delayed)

    return delay


@contextmanager
def hosted(**nodes: type[Node]) -> Iterator[tuple[Any, dict[str, Any]]]:
    """An rclpy node for a clock, and nodes in simulated time by name."""
    from socialbot.bridge.environment import spinning_node

    graph = Graph(
        "pacing", tuple(NodeConfig(name, kind) for name, kind in nodes.items()), frozenset({"/said", "/answers"})
    )
    with spinning_node("clock") as ros, node_hosts(graph, sim_time=True) as host:
        yield ros, {name: host(name).node for name in nodes}


def test_timers_of_slow_nodes_fire_at_their_times() -> None:
    with hosted(quick=Beat, slow=Sleeper) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.25)
        clock.advance(3.1)
        first = clock.now - round(3.1 * SECOND)
        for node in nodes.values():
            assert len(node.beats) == 3
            assert [(beat - first) / SECOND for beat in node.beats] == pytest.approx([1.0, 2.0, 3.0], abs=0.26)


def test_idle_time_passes_faster_than_real_time() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.5)
        clock.advance(0.5)
        begun = time.monotonic()
        clock.advance(60.0)
        assert time.monotonic() - begun < 60.0
        assert len(nodes["quick"].beats) == 60


def test_background_work_takes_no_simulated_time() -> None:
    with hosted(quick=Beat, planner=Planner) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.1)
        clock.advance(0.1)
        assert clock.until(lambda: len(nodes["planner"].known) == 2, limit_s=5.0)
        for said, known in nodes["planner"].known:
            assert known == said


def test_time_does_not_overtake_messages(transit: Any) -> None:
    transit(lambda node: 0.1)
    with hosted(quick=Beat, echo=Echo) as (ros, nodes):
        SimClock(ros, nodes, step_s=0.25).advance(3.1)
        beats = nodes["quick"].beats
        assert len(beats) == 3
        assert [time for time, _ in nodes["echo"].heard] == [time for time in beats for _ in range(2)]


def test_results_do_not_depend_on_transit_times(transit: Any) -> None:
    heard = []
    for seed in range(3):
        random_s = random.Random(seed)
        transit(lambda node, random_s=random_s: random_s.uniform(0.0, 0.03))
        with hosted(one=Beat, two=Beat, echo=Echo, other=Echo) as (ros, nodes):
            SimClock(ros, nodes, step_s=0.25).advance(3.1)
            heard.append((nodes["echo"].heard, nodes["other"].heard))
    assert len(heard[0][0]) == 3 * (2 + 4)
    assert heard[1:] == heard[:1] * 2


def test_a_node_that_learns_of_a_round_late_gets_no_messages_of_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    start_round = NodeHost._start_round

    def delayed(self: NodeHost, *message: Any) -> None:
        threading.Timer(0.2 if self.name == "minutes" else 0.0, start_round, (self, *message)).start()

    monkeypatch.setattr(NodeHost, "_start_round", delayed)
    with hosted(quick=Beat, echo=Echo, minutes=Minutes) as (ros, nodes):
        SimClock(ros, nodes, step_s=0.5).advance(3.1)
        assert nodes["minutes"].heard == ["beat", "echo"] * 3


def test_a_lost_message_is_reported_and_time_goes_on(
    transit: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(timeclock, "DELIVERY_TIMEOUT_S", 0.3)
    lost = iter([None])
    transit(lambda node: next(lost, 0.0))
    with hosted(quick=Beat, echo=Echo) as (ros, nodes), caplog.at_level(logging.WARNING, "socialbot.sim_clock"):
        SimClock(ros, nodes, step_s=0.25).advance(4.1)
        assert [text for _, text in nodes["echo"].heard] == ["2", "echo", "3", "echo", "4", "echo"]
    assert [record.getMessage() for record in caplog.records] == ["echo: 1 messages on /said were not delivered in 0 s"]


def test_messages_from_outside_are_handled_while_time_stands_still() -> None:
    from socialbot.bridge.transport import open_transport

    with hosted(quick=Beat, echo=Echo) as (ros, nodes), spinning_nodes("outside") as (outside,):
        clock = SimClock(ros, nodes, step_s=0.25)
        clock.advance(0.5)
        sender = open_transport().advertise(outside, "/said", Utterance)
        assert eventually(lambda: sender.publisher.get_subscription_count() == 1)
        sender.publish(Utterance(stamp=clock.now, id="outside", text="beat"))
        assert eventually(lambda: nodes["echo"].heard == [(clock.now, "outside"), (clock.now, "echo")])
        begun = time.monotonic()
        clock.advance(2.6)
        assert time.monotonic() - begun < timeclock.DELIVERY_TIMEOUT_S
        assert [text for _, text in nodes["echo"].heard[2:]] == ["1", "echo", "2", "echo", "3", "echo"]


def test_a_time_that_all_nodes_have_reported_is_published_once() -> None:
    from rosgraph_msgs.msg import Clock

    with hosted(quick=Beat) as (ros, nodes), spinning_nodes("watch") as (watch,):
        times: list[float] = []
        watch.create_subscription(
            Clock, "/clock", lambda one: times.append(one.clock.sec + one.clock.nanosec / 1e9), 100
        )
        clock = SimClock(ros, nodes, start=SECOND, step_s=0.5)
        assert eventually(lambda: clock._clock.publisher.get_subscription_count() == 2)
        for _ in range(3):
            clock.advance(0.0)
            clock.advance(0.5)
        assert eventually(lambda: times and times[-1] == 2.5)
        assert sorted(set(times)) == times[-4:] == [1.0, 1.5, 2.0, 2.5]


def report(node: str, *, sent: int = 0, taken: int | None = None, instance: str = "first") -> StepReport:
    counts = {} if taken is None else {"/said": taken}
    return StepReport(node, instance, 0, {"/said": sent} if sent else {}, counts, 0, 0, 0, 0)


class TestBalance:
    @pytest.fixture
    def balance(self) -> MessageBalance:
        """One of a talker and a listener after a step."""
        balance = MessageBalance()
        balance.note(report("talker", sent=5))
        balance.note(report("listener", taken=5))
        assert self.missing(balance) == 0
        balance.close_step(["talker", "listener"])
        return balance

    def missing(self, balance: MessageBalance) -> int:
        return sum(count for _, _, count in balance.missing(["talker", "listener"]))

    def test_a_subscriber_lacks_messages_that_it_has_not_got(self, balance: MessageBalance) -> None:
        balance.note(report("talker", sent=7))
        assert list(balance.missing(["talker", "listener"])) == [("listener", "/said", 2)]

    def test_a_restarted_subscriber_lacks_no_earlier_messages(self, balance: MessageBalance) -> None:
        balance.note(report("listener", taken=0, instance="second"))
        assert self.missing(balance) == 0
        balance.note(report("talker", sent=6))
        assert self.missing(balance) == 1
        balance.note(report("listener", taken=1, instance="second"))
        assert self.missing(balance) == 0

    def test_messages_of_a_restarted_publisher_are_counted_after_the_earlier_ones(
        self, balance: MessageBalance
    ) -> None:
        balance.note(report("talker", sent=2, instance="second"))
        assert self.missing(balance) == 2
        balance.note(report("listener", taken=7))
        assert self.missing(balance) == 0

    def test_messages_from_outside_replace_none_after_two_steps(self, balance: MessageBalance) -> None:
        balance.note(report("listener", taken=8))
        for _ in range(2):
            assert self.missing(balance) == 0
            balance.close_step(["talker", "listener"])
        balance.note(report("talker", sent=6))
        assert self.missing(balance) == 1

    def test_a_subscription_that_was_given_up_counts_again_after_its_next_message(
        self, balance: MessageBalance
    ) -> None:
        balance.note(report("talker", sent=6))
        balance.give_up(["talker", "listener"], 1.0)
        balance.note(report("talker", sent=7))
        assert self.missing(balance) == 0
        balance.note(report("listener", taken=6))
        assert self.missing(balance) == 0
        balance.note(report("talker", sent=8))
        assert self.missing(balance) == 1


def test_until_returns_false_at_the_limit() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.25, start=100 * SECOND)
        assert not clock.until(lambda: False, limit_s=1.0)
        assert clock.now / SECOND == pytest.approx(101.0, abs=0.01)


def test_the_error_names_late_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeclock, "STEP_TIMEOUT_S", 0.6)
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, [*nodes, "nobody"])
        with pytest.raises(NodeError, match="is not done after") as caught:
            clock.advance(1.0)
        assert "quick" not in str(caught.value)
        clock.awaited.remove("nobody")
        clock.advance(1.0)
