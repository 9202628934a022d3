"""Observers, recorder and topic commands with keys."""

from __future__ import annotations

import threading
import time

import pytest
from typer.testing import CliRunner

from socialbot.bags.reader import open_bag
from socialbot.bridge.adaptive_subscriptions import DEPTH
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.graph_observer import observe_graph
from socialbot.bridge.keys import new_key
from socialbot.bridge.recorder import Recording, record
from socialbot.bridge.topics import observer_node, publish_once
from socialbot.bridge.transport import MAX_WINDOW_S, WINDOW_VARIABLE
from socialbot.cli.topic import topic
from socialbot.core.messages import Message, TraceRecord, Utterance
from tests.system.running import eventually

pytestmark = pytest.mark.ros

TOPIC = "/speech/heard"


@pytest.fixture(autouse=True)
def keys(tmp_path, monkeypatch):
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))


def word(text: str) -> Utterance:
    return Utterance(stamp=7, id="u1", text=text)


def test_an_observer_receives_only_sealed_messages(caplog):
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


def test_a_bag_holds_only_payloads_of_sealed_messages(tmp_path):
    from std_msgs.msg import String

    done = threading.Event()
    made: list[Recording] = []
    thread = threading.Thread(target=lambda: made.append(record(tmp_path / "bag", topics=[TOPIC], stopped=done.is_set)))
    with observer_node() as ros:
        # A publisher from the start, so that the recorder finds the topic.
        stranger = ros.create_publisher(String, TOPIC, 10)
        thread.start()
        try:
            assert eventually(lambda: stranger.get_subscription_count() == 1)
            stranger.publish(String(data="I am a stranger"))
            publish_once(ros, TOPIC, word("genuine"), timeout_s=5.0)
            assert stranger.wait_for_all_acked()
        finally:
            done.set()
            thread.join()
    (recording,) = made
    assert (recording.counts, recording.refused) == ({TOPIC: 1}, {TOPIC: "1 unsealed"})
    with open_bag(tmp_path / "bag") as bag:
        said = [message for _, message in bag.messages({TOPIC: TOPIC}, {TOPIC: Utterance})]
    assert said == [word("genuine")]


def test_a_recording_holds_all_messages_that_arrived_before_its_end(tmp_path):
    from socialbot.bridge.transport import open_transport

    topics = ["/speech/heard", "/speech/say", "/speech/thought"]
    with observer_node() as ros:
        transport = open_transport()
        senders = [transport.advertise(ros, name, Utterance) for name in topics]

        def stopped() -> bool:
            """Publish everything once the recorder is connected, while it takes no messages."""
            if not all(sender.publisher.get_subscription_count() for sender in senders):
                return False
            for sender in senders:
                for number in range(DEPTH):
                    sender.publish(word(str(number)))
                assert sender.publisher.wait_for_all_acked()
            return True

        recording = record(tmp_path / "bag", topics=topics, stopped=stopped)
    assert (recording.counts, recording.refused) == (dict.fromkeys(topics, DEPTH), {})


def test_echo_prints_payloads_and_reports_unsealed_messages():
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


def test_a_slow_observer_loses_no_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WINDOW_VARIABLE, str(MAX_WINDOW_S))
    from rclpy.duration import Duration

    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.transport import open_transport

    received: list[str] = []
    free = threading.Event()

    def observe(topic: str, message: Message) -> None:
        assert isinstance(message, TraceRecord)
        received.append(message.id)
        free.wait(60)

    with (
        observe_graph({"/agent/trace": TraceRecord}, observe, lambda name, values: None),
        spinning_node("agent") as ros,
    ):
        sender = open_transport().advertise(ros, "/agent/trace", TraceRecord)
        assert eventually(lambda: sender.publisher.get_subscription_count() == 1)
        for number in range(1500):
            sender.publish(TraceRecord(stamp=number, id=f"agent-{number}", source="agent", kind="belief", what="b"))
            if number % 50 == 0:  # the publisher keeps 100
                assert sender.publisher.wait_for_all_acked(Duration(seconds=20))
        free.set()
        assert eventually(lambda: len(received) == 1500)
    assert received == [f"agent-{number}" for number in range(1500)]
