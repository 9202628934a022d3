from __future__ import annotations

import re
import threading

import pytest

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import DeviceError
from socialbot.core.messages import Message, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output, Parameter


def word(text: str, at: float = 0.0) -> Utterance:
    return Utterance(stamp=nanoseconds(at), id=text, text=text)


def text_of(message: Message) -> str:
    assert isinstance(message, Utterance)
    return message.text


class Relay(Node):
    """Republish each text with its own name appended."""

    heard = Input(Utterance, "/in")
    said = Output(Utterance, "/out")
    copies = Parameter(1, "how often")

    @heard
    def on_heard(self, message: Utterance) -> None:
        for _ in range(self.copies):
            self.said.publish(word(f"{message.text}-{self.name}", self.clock.now() / SECOND))


class Herald(Node):
    """Publish its state at start and at stop."""

    state = Output(Utterance, "/in", Delivery.LATCHED)

    def start(self) -> None:
        self.state.publish(word("up"))

    def stop(self) -> None:
        self.log.warning("%s is down", self.name)


class Ticker(Node):
    """Publish a message some time ``after`` each input."""

    heard = Input(Utterance, "/in")
    said = Output(Utterance, "/out")
    after = Parameter(1.0, "s")

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.timer = self.call_after(self.after, lambda: self.said.publish(word(message.text)))


class Moody(Relay):
    """Fails at what it does not like."""

    def on_heard(self, message: Utterance) -> None:
        if message.text == "bad":
            raise ValueError("I do not like that")
        if message.text == "later":
            self.call_after(1.0, self.on_time)
        super().on_heard(message)

    def on_time(self) -> None:
        raise KeyError("out of time")


class Stage:
    """A graph in the inline runner, with all that went over /in and /out and the seconds at which."""

    def __init__(self, *configs: NodeConfig, start: float = 0.0) -> None:
        graph = Graph("test", configs, inputs=frozenset({"/in"}))
        self.runner = InlineRunner(graph, start=nanoseconds(start))
        self.seen: list[tuple[float, str, str]] = []
        for topic in ("/in", "/out"):
            self.runner.tap(topic, lambda topic, m: self.seen.append((self.now, topic, m.text)))  # type: ignore[attr-defined]
        self.runner.start()

    @property
    def now(self) -> float:
        return self.runner.clock.now() / SECOND

    @property
    def said(self) -> list[tuple[float, str]]:
        return [(at, text) for at, topic, text in self.seen if topic == "/out"]

    def hear(self, text: str, at: float) -> None:
        self.runner.feed("/in", word(text, at))


def chain(*names: str) -> list[NodeConfig]:
    """Relays in a row from /in to /out."""
    topics = ["/in", *(f"/t{number}" for number in range(1, len(names))), "/out"]
    return [
        NodeConfig(name, Relay, {}, {"heard": topics[number], "said": topics[number + 1]})
        for number, name in enumerate(names)
    ]


def test_a_message_passes_all_nodes_before_the_next_one():
    stage = Stage(*chain("a", "b", "c"))
    stage.runner.run([("/in", word("x", 1.0)), ("/in", word("y", 1.5))])
    assert stage.seen == [
        (1.0, "/in", "x"), (1.0, "/out", "x-a-b-c"), (1.5, "/in", "y"), (1.5, "/out", "y-a-b-c"),
    ]  # fmt: skip


def test_listeners_of_a_topic_are_served_in_the_order_of_the_graph():
    stage = Stage(NodeConfig("b", Relay), NodeConfig("a", Relay, {"copies": 2}))
    stage.hear("x", 1.0)
    assert [text for _, text in stage.said] == ["x-b", "x-a", "x-a"]


def test_time_is_the_stamp_of_the_message_and_never_decreases():
    stage = Stage(NodeConfig("a", Relay), start=5.0)
    assert stage.now == 5.0
    stage.hear("late", 3.0)
    assert stage.said == [(5.0, "late-a")]
    stage.runner.feed("/in", word("x", 6.0), time=nanoseconds(7.0))
    assert stage.said[-1] == (7.0, "x-a")


def test_timers_fire_at_their_own_moments_on_the_way():
    stage = Stage(NodeConfig("long", Ticker, {"after": 2.0}), NodeConfig("short", Ticker, {"after": 0.25}))
    stage.hear("x", 1.0)
    stage.hear("y", 9.0)
    assert stage.seen == [(1.0, "/in", "x"), (1.25, "/out", "x"), (3.0, "/out", "x"), (9.0, "/in", "y")]


def test_a_due_timer_runs_before_the_message():
    stage = Stage(NodeConfig("a", Ticker))
    stage.hear("x", 1.0)
    stage.hear("y", 2.0)
    assert stage.seen == [(1.0, "/in", "x"), (2.0, "/out", "x"), (2.0, "/in", "y")]


def test_timers_of_one_moment_fire_in_order_of_creation():
    stage = Stage(NodeConfig("b", Ticker), NodeConfig("a", Ticker))
    stage.hear("x", 1.0)
    fired = []
    for number in range(3):
        stage.runner.call_at(nanoseconds(2.0), lambda number=number: fired.append(number))
    stage.runner.advance(nanoseconds(2.0))
    assert fired == [0, 1, 2]
    assert [text for _, text in stage.said] == ["x", "x"]


def test_a_timer_may_set_another_that_is_due_on_the_same_way():
    stage = Stage(*chain("a"))
    fired = []

    def tick() -> None:
        fired.append(stage.now)
        stage.runner.call_at(stage.runner.clock.now() + SECOND, tick)

    stage.runner.call_at(SECOND, tick)
    stage.runner.advance(nanoseconds(3.5))
    assert fired == [1.0, 2.0, 3.0]
    assert stage.now == 3.5


def test_a_timer_of_the_past_fires_now():
    stage = Stage(*chain("a"), start=5.0)
    fired = []
    stage.runner.call_at(SECOND, lambda: fired.append(stage.now))
    stage.runner.advance(nanoseconds(5.0))
    assert fired == [5.0]


def test_a_cancelled_timer_does_not_fire():
    stage = Stage(NodeConfig("a", Ticker))
    stage.hear("x", 1.0)
    node = stage.runner.nodes["a"]
    assert isinstance(node, Ticker)
    node.timer.cancel()
    stage.runner.advance(nanoseconds(9.0))
    node.timer.cancel()
    assert stage.said == []


def test_run_lets_time_go_on_for_the_tail():
    stage = Stage(NodeConfig("a", Ticker))
    stage.runner.run([("/in", word("x", 1.0))], tail_s=0.5)
    assert (stage.now, stage.said) == (1.5, [])
    stage.runner.run([], tail_s=0.5)
    assert stage.said == [(2.0, "x")]


def test_a_tap_sees_a_message_before_the_nodes_do():
    stage = Stage(NodeConfig("a", Relay))
    order = []
    stage.runner.tap("/in", lambda topic, message: order.append(("tap", topic, len(stage.said))))
    stage.runner.tap("/out", lambda topic, message: order.append(("tap", topic, len(stage.said))))
    stage.hear("x", 1.0)
    assert order == [("tap", "/in", 0), ("tap", "/out", 1)]


def test_an_exception_of_a_node_is_counted_and_the_stream_continues(caplog):
    stage = Stage(NodeConfig("moody", Moody), NodeConfig("calm", Relay))
    for number, text in enumerate(["good", "bad", "later", "bad", "good"]):
        stage.hear(text, number * 2.0)
    assert [text for _, text in stage.said] == [
        "good-moody", "good-calm", "bad-calm", "later-moody", "later-calm", "bad-calm", "good-moody", "good-calm",
    ]  # fmt: skip
    moody, calm = stage.runner.faults["moody"], stage.runner.faults["calm"]
    assert (moody.calls, moody.failures) == (6, 3)
    assert re.fullmatch(r"ValueError: I do not like that \(test_inline\.py:\d+\)", moody.first)
    assert (calm.calls, calm.failures, calm.first) == (5, 0, "")
    assert "moody: ValueError: I do not like that" in caplog.text


def test_messages_at_start_arrive_for_any_start_order():
    for names in (["herald", "a"], ["a", "herald"]):
        kinds = {"herald": Herald, "a": Relay}
        stage = Stage(*(NodeConfig(name, kinds[name]) for name in names))
        assert stage.said == [(0.0, "up-a")]


def test_an_error_at_the_start_is_not_held_back():
    class Deaf(Relay):
        """Has no ears."""

        def start(self) -> None:
            raise DeviceError("no microphone")

    with pytest.raises(DeviceError, match="no microphone"):
        Stage(NodeConfig("deaf", Deaf))


def test_closing_stops_every_node(caplog):
    stage = Stage(NodeConfig("one", Herald), NodeConfig("two", Herald))
    stage.runner.close()
    assert "one is down" in caplog.text
    assert "two is down" in caplog.text


def test_a_call_from_another_thread_comes_through_with_the_next_step():
    stage = Stage(NodeConfig("a", Relay))
    node = stage.runner.nodes["a"]
    assert isinstance(node, Relay)
    inside = []

    def call() -> None:
        inside.append(threading.current_thread())
        node.said.publish(word("called"))

    thread = threading.Thread(target=node.context.call_soon, args=(call,))
    thread.start()
    thread.join()
    assert stage.said == []
    stage.runner.advance(SECOND)
    assert stage.said == [(0.0, "called")]
    assert inside == [threading.main_thread()]


def test_no_call_of_many_threads_is_lost():
    stage = Stage(NodeConfig("a", Relay))
    context, calls = stage.runner.nodes["a"].context, []
    threads = [
        threading.Thread(target=lambda: [context.call_soon(lambda: calls.append(1)) for _ in range(100)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    stage.runner.advance(SECOND)
    assert len(calls) == 400


def test_a_call_that_fails_is_counted():
    stage = Stage(NodeConfig("a", Relay))
    stage.runner.nodes["a"].context.call_soon(lambda: 1 / 0)  # type: ignore[arg-type]
    stage.runner.advance(SECOND)
    assert stage.runner.faults["a"].failures == 1


def test_time_cannot_go_back():
    stage = Stage(*chain("a"), start=5.0)
    with pytest.raises(ValueError, match="back"):
        stage.runner.advance(SECOND)


def test_two_runs_are_the_same():
    runs = []
    for _ in range(2):
        stage = Stage(NodeConfig("t", Ticker), NodeConfig("m", Moody), NodeConfig("r", Relay), start=1.0)
        stage.runner.run([("/in", word(text, at)) for at, text in enumerate(["a", "bad", "later", "b"])], tail_s=9.0)
        runs.append(stage.seen)
    assert runs[0] == runs[1]


def test_background_work_takes_no_simulated_time():
    stage = Stage(NodeConfig("a", Relay))
    context, told = stage.runner.nodes["a"].context, []
    context.run_in_background(lambda: 6 * 7, lambda found: told.append((found, stage.runner.clock.now())))
    assert told == []
    stage.runner.advance(5)
    assert told == [(42, 0)]


def test_failed_background_work_reports_the_exception():
    stage = Stage(NodeConfig("a", Relay))
    told = []
    stage.runner.nodes["a"].context.run_in_background(lambda: 1 / 0, told.append)
    stage.runner.advance(5)
    assert [type(found) for found in told] == [ZeroDivisionError]


class Own(Node):
    """Speaks in its own namespace."""

    said = Output(Utterance, "~/said")

    def start(self) -> None:
        self.said.publish(word("hello"))


def test_a_topic_of_the_node_s_own_namespace_bears_its_name():
    graph = Graph("own", (NodeConfig("a", Own), NodeConfig("b", Own), NodeConfig("c", Own, remap={"said": "~/x/y"})))
    assert set(graph.topics()) == {"/a/said", "/b/said", "/c/x/y"}
    runner, heard = InlineRunner(graph), []
    for topic in graph.topics():
        runner.tap(topic, lambda topic, message: heard.append(topic))
    runner.start()
    assert heard == ["/a/said", "/b/said", "/c/x/y"]


class Counter(Node):
    """Publish a counter every second, and once the received state."""

    state = Input(Utterance, "/state", Delivery.LATCHED)
    heard = Input(Utterance, "/in")
    said = Output(Utterance, "/out")

    def start(self) -> None:
        self.count = 0
        self.call_after(1.0, self.tick)

    def tick(self) -> None:
        self.count += 1
        self.said.publish(word(f"{self.name} {self.count}"))
        self.call_after(1.0, self.tick)

    @state
    def on_state(self, message: Utterance) -> None:
        self.said.publish(word(f"{self.name} knows {message.text}"))

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.said.publish(word(f"{self.name} hears {message.text}"))


def test_a_killed_node_stops_and_restarts_as_a_new_one():
    herald = NodeConfig("herald", Herald, {}, {"state": "/state"})
    stage = Stage(NodeConfig("a", Counter), NodeConfig("b", Counter), herald)
    stage.hear("x", 1.5)
    stage.runner.kill("a")
    stage.hear("y", 2.5)
    stage.runner.restart("a")
    stage.hear("z", 4.0)
    assert [(at, text) for at, text in stage.said if text.startswith("a")] == [
        (0.0, "a knows up"), (1.0, "a 1"), (1.5, "a hears x"),
        (2.5, "a knows up"), (3.5, "a 1"), (4.0, "a hears z"),
    ]  # fmt: skip
    assert [text for at, text in stage.said if text.startswith("b")] == [
        "b knows up", "b 1", "b hears x", "b 2", "b hears y", "b 3", "b 4", "b hears z",
    ]  # fmt: skip


def test_posted_calls_and_messages_of_a_killed_node_are_dropped():
    stage = Stage(NodeConfig("a", Counter), NodeConfig("herald", Herald, {}, {"state": "/state"}))
    old, called = stage.runner.nodes["a"].context, []
    old.run_in_background(lambda: 1, called.append)
    old.call_soon(lambda: called.append(2))
    stage.runner.kill("a")
    stage.runner.restart("a")
    old.publish(Counter.outputs()["said"], word("from beyond"))
    stage.runner.advance(nanoseconds(0.5))
    assert called == []
    assert stage.said == [(0.0, "a knows up"), (0.0, "a knows up")]


class Clockwork(Node):
    """Publish its name every second, from two timers."""

    said = Output(Utterance, "/ticks")

    def start(self) -> None:
        self.context.call_at(self.clock.now() + SECOND, self.tick)

    def tick(self) -> None:
        self.context.call_at(self.clock.now() + SECOND, self.tick)
        for number in (1, 2):
            self.said.publish(word(f"{self.name}{number}", self.clock.now() / SECOND))


class Hall(Clockwork):
    """A world that does the same."""

    is_simulator = True


def ticks(*configs: NodeConfig) -> list[str]:
    runner = InlineRunner(Graph("clocks", configs))
    heard: list[str] = []
    runner.tap("/ticks", lambda _, message: heard.append(text_of(message)))
    runner.start()
    runner.advance(2 * SECOND)
    return heard


def test_at_each_moment_the_world_comes_last():
    expected = ["node1", "node2", "hall1", "hall2"] * 2
    assert ticks(NodeConfig("hall", Hall), NodeConfig("node", Clockwork)) == expected
    assert ticks(NodeConfig("node", Clockwork), NodeConfig("hall", Hall)) == expected


def test_messages_of_one_moment_are_fed_at_once():
    relay, tail = NodeConfig("a", Relay), NodeConfig("b", Relay, {}, {"heard": "/out", "said": "/end"})
    runner = InlineRunner(Graph("chain", (relay, tail), inputs=frozenset({"/in"})))
    heard: list[str] = []
    for topic in ("/in", "/out", "/end"):
        runner.tap(topic, lambda _, message: heard.append(text_of(message)))
    runner.start()
    runner.run([("/in", word("x", 1.0)), ("/in", word("y", 1.0)), ("/in", word("z", 2.0))])
    assert heard == ["x", "y", "x-a", "y-a", "x-a-b", "y-a-b", "z", "z-a", "z-a-b"]
