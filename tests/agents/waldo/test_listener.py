from __future__ import annotations

import pytest

from socialbot.agents.waldo.nodes import Listener
from socialbot.core.clock import SECOND
from socialbot.core.messages import ActionRequest, HeadCommand, Message, Utterance
from socialbot.graph.node import Graph, NodeConfig
from tests.inline import InlineRun


class Stage(InlineRun):
    """A listener and what it sends to the actuators."""

    def __init__(self) -> None:
        super().__init__(Graph("test", (NodeConfig("listener", Listener),), inputs=frozenset({"/waldo/actions"})))

    def act(self, name: str, *arguments: str | int | float | bool) -> list[Message]:
        before = len(self.said)
        action = ActionRequest(stamp=3 * SECOND, id="waldo-9", agent="waldo", name=name, arguments=arguments)
        self.send("/waldo/actions", action)
        return [message for topic, message in self.said[before:] if topic in ("/speech/say", "/head/command")]


def test_speak_publishes_utterance_and_tracking_command():
    assert Stage().act("speak", "greeting", "Hello!") == [
        HeadCommand(stamp=3 * SECOND, mode="track", cause="waldo-9"),
        Utterance(stamp=3 * SECOND, id="say-waldo-9", text="Hello!", key="greeting", cause="waldo-9"),
    ]


def test_stay_idle_centres_the_head():
    assert Stage().act("stayIdle") == [HeadCommand(stamp=3 * SECOND, mode="centre", cause="waldo-9")]


@pytest.mark.parametrize(
    "action",
    [
        ("dance",),
        ("speak",),
        ("speak", "greeting"),
        ("speak", "greeting", 3),
        ("speak", "a", "b", "c"),
        ("stayIdle", 1),
    ],
)
def test_unknown_action_is_counted_as_fault(action):
    stage = Stage()
    assert stage.act(*action) == []
    faults = stage.runner.faults["listener"]
    assert faults.failures == 1
    assert f"unknown action {action[0]}" in faults.first
    assert "speak(situation, sentence)" in faults.first
    assert len(stage.act("speak", "greeting", "Hello!")) == 2
