"""The tools that look into a graph and speak there, with keys: bags hold what was said, not what was on the wire."""

from __future__ import annotations

import threading
import time

import pytest
from typer.testing import CliRunner

from socialbot.bags.reader import open_bag
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.graph_observer import observe_graph
from socialbot.bridge.recorder import Recording, record
from socialbot.bridge.security import new_key
from socialbot.bridge.topics import observer_node, publish_once
from socialbot.cli.topic import topic
from socialbot.core.messages import Message, Utterance
from tests.system.running import eventually

pytestmark = pytest.mark.ros

TOPIC = "/speech/heard"


@pytest.fixture(autouse=True)
def keys(tmp_path, monkeypatch):
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))


def word(text: str) -> Utterance:
    return Utterance(stamp=7, id="u1", text=text)


def test_what_one_tool_says_the_observer_hears_and_no_stranger(caplog):
    from std_msgs.msg import String

    heard: list[Message] = []
    with observe_graph({TOPIC: Utterance}, lambda _, message: heard.append(message), lambda *_: None) as watch:
        stranger = watch.ros.create_publisher(String, TOPIC, 10)
        assert eventually(lambda: stranger.get_subscription_count() == 1)
        for _ in range(12):
            stranger.publish(String(data="I am a stranger"))
        result = CliRunner().invoke(
            topic, ["pub", TOPIC, "Utterance", "{id: u1, text: genuine}"], catch_exceptions=False
        )
        assert result.exit_code == 0
        assert eventually(lambda: len(heard) == 1)
    assert [message.text for message in heard if isinstance(message, Utterance)] == ["genuine"]
    assert sum("unsealed" in one.getMessage() for one in caplog.records) == 2  # of 12: the first and the tenth


def test_a_bag_holds_what_was_said_and_nothing_of_a_stranger(tmp_path):
    from std_msgs.msg import String

    done = threading.Event()
    made: list[Recording] = []
    thread = threading.Thread(target=lambda: made.append(record(tmp_path / "bag", topics=[TOPIC], stopped=done.is_set)))
    with observer_node() as ros:
        # A publisher from the start, so that the recorder finds the topic.
        stranger = ros.create_publisher(String, TOPIC, 10)
        thread.start()
        assert eventually(lambda: stranger.get_subscription_count() == 1)
        stranger.publish(String(data="I am a stranger"))
        publish_once(ros, TOPIC, word("genuine"), timeout_s=5.0)
        time.sleep(0.5)
        done.set()
        thread.join()
    (recording,) = made
    assert (recording.counts, recording.refused) == ({TOPIC: 1}, {TOPIC: "1 unsealed"})
    with open_bag(tmp_path / "bag") as bag:
        said = [message for _, message in bag.messages({TOPIC: TOPIC}, {TOPIC: Utterance})]
    assert said == [word("genuine")]


def test_echo_shows_what_was_said_and_tells_of_strangers():
    from std_msgs.msg import String

    from socialbot.bridge.environment import spinning_node

    ended = threading.Event()

    def talk() -> None:
        with spinning_node("talker") as ros:
            stranger = ros.create_publisher(String, TOPIC, 10)
            while not ended.is_set():
                stranger.publish(String(data="I am a stranger"))
                if stranger.get_subscription_count():
                    publish_once(ros, TOPIC, word("genuine"), timeout_s=5.0)
                time.sleep(0.05)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        result = CliRunner().invoke(topic, ["echo", TOPIC, "--count", "1"], catch_exceptions=False)
    finally:
        ended.set()
        thread.join()
    assert "text: genuine" in result.stdout
    assert "signature" not in result.stdout
    assert "stranger" not in result.stdout
    assert "refused, unsealed" in result.stderr
