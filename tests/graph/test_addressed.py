"""Inputs for addressed messages: only the receiver handles them."""

from __future__ import annotations

import dataclasses
import gc
import time
from pathlib import Path

import pytest

from socialbot.core.messages import Structured
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import EVERYBODY, Input, Output


class Letter(Structured, frozen=True, kw_only=True):
    """A message with a receiver."""

    receiver: str


class Mailbox(Node):
    letters = Input(Letter, "/letters", addressed_by="receiver")

    def start(self) -> None:
        self.got: list[str] = []

    @letters
    def on_letter(self, message: Letter) -> None:
        self.got.append(message.receiver)


class Censor(Node):
    letters = Input(Letter, "/letters")

    def start(self) -> None:
        self.got: list[str] = []

    @letters
    def on_letter(self, message: Letter) -> None:
        self.got.append(message.receiver)


class LoudMailbox(Mailbox):
    letters = Input(Letter, "/letters")


GRAPH = Graph(
    "post",
    (NodeConfig("ann", Mailbox), NodeConfig("bob", Mailbox), NodeConfig("censor", Censor)),
    inputs=frozenset({"/letters"}),
)


@pytest.mark.parametrize(
    ("receiver", "readers"),
    [("ann", {"ann", "censor"}), (EVERYBODY, {"ann", "bob", "censor"}), ("nobody", {"censor"}), ("", {"censor"})],
)
def test_only_the_receiver_and_unaddressed_inputs_get_a_message(receiver: str, readers: set[str]):
    runner = InlineRunner(GRAPH)
    runner.start()
    runner.feed("/letters", Letter(stamp=1, receiver=receiver))
    assert {name for name, node in runner.nodes.items() if node.got} == readers  # type: ignore[attr-defined]


def test_port_drops_messages_for_others_under_every_runner():
    runner = InlineRunner(GRAPH)
    runner.start()
    ann = runner.nodes["ann"]
    ann.inputs()["letters"].deliver(ann, Letter(stamp=1, receiver="bob"))
    assert ann.got == []  # type: ignore[attr-defined]


class Postman(Node):
    """Publishes each letter on the topic of its receiver."""

    sent = Input(Letter, "/sent")
    letters = Output(Letter, "/{receiver}/letters")

    @sent
    def on_sent(self, message: Letter) -> None:
        self.letters.publish(message)


class Home(Mailbox):
    letters = Input(Letter, "~/letters")


POST = Graph(
    "post",
    (NodeConfig("postman", Postman), NodeConfig("ann", Home), NodeConfig("bob", Home)),
    inputs=frozenset({"/sent"}),
)


def test_output_with_one_topic_per_receiver_publishes_on_those_of_the_graph():
    assert [topic for topic, _ in POST.node("postman").publications] == ["/ann/letters", "/bob/letters"]
    assert set(POST.topics()) == {"/sent", "/ann/letters", "/bob/letters"}


def test_receivers_are_known_after_nodes_are_replaced():
    homes = (NodeConfig("bob", Home), NodeConfig("cat", Home))
    graph = dataclasses.replace(POST, nodes=(POST.node("postman"), *homes))
    assert {"/bob/letters", "/cat/letters"} <= {topic for topic, _ in graph.node("postman").publications}


@pytest.mark.parametrize(("receiver", "readers"), [("ann", {"ann"}), ("nobody", set()), (EVERYBODY, set())])
def test_message_on_the_topic_of_its_receiver_reaches_nobody_else(receiver: str, readers: set[str]):
    runner = InlineRunner(POST)
    seen: list[str] = []
    runner.tap(f"/{receiver}/letters", lambda topic, _: seen.append(topic))
    runner.start()
    runner.feed("/sent", Letter(stamp=1, receiver=receiver))
    assert {name for name in ("ann", "bob") if runner.nodes[name].got} == readers  # type: ignore[attr-defined]
    assert seen == [f"/{receiver}/letters"]


@pytest.mark.parametrize("receiver", ["", "a/b", "../ann", "1", "ann\n"])
def test_receiver_that_is_no_name_is_refused(receiver: str):
    runner = InlineRunner(POST)
    runner.start()
    runner.feed("/sent", Letter(stamp=1, receiver=receiver))
    line = next(n for n, text in enumerate(Path(__file__).read_text().splitlines(), 1) if "letters.publish" in text)
    assert runner.faults["postman"].first == (
        f"MessageError: /{{receiver}}/letters: receiver {receiver!r} is no name of a node (test_addressed.py:{line})"
    )


def test_input_that_replaces_one_of_a_base_class_keeps_its_handler():
    runner = InlineRunner(Graph("post", (NodeConfig("ann", LoudMailbox),), inputs=frozenset({"/letters"})))
    runner.start()
    runner.feed("/letters", Letter(stamp=1, receiver="bob"))
    assert runner.nodes["ann"].got == ["bob"]  # type: ignore[attr-defined]


def _start_s(count: int) -> float:
    """Processor time to build a graph of mailboxes and its runner, s."""
    gc.collect()
    gc.disable()  # it looks at all objects of the tests
    try:
        begin = time.process_time()
        nodes = tuple(NodeConfig(f"home{number}", Mailbox) for number in range(count))
        InlineRunner(Graph("post", nodes, inputs=frozenset({"/letters"})))
        return time.process_time() - begin
    finally:
        gc.enable()


def test_start_of_a_large_graph_costs_no_more_a_node():
    both = [(_start_s(200), _start_s(2000)) for _ in range(3)]  # in turn: a busy computer slows down both
    few, many = (min(took_s) for took_s in zip(*both, strict=True))
    assert many / few < 20  # 10 in proportion; 100 if each node looked at all others
