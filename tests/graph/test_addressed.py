"""Inputs for addressed messages: only the receiver handles them."""

from __future__ import annotations

import pytest

from socialbot.core.messages import Structured
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import EVERYBODY, Input


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


def test_input_that_replaces_one_of_a_base_class_keeps_its_handler():
    runner = InlineRunner(Graph("post", (NodeConfig("ann", LoudMailbox),), inputs=frozenset({"/letters"})))
    runner.start()
    runner.feed("/letters", Letter(stamp=1, receiver="bob"))
    assert runner.nodes["ann"].got == ["bob"]  # type: ignore[attr-defined]
