"""Recorder in a domain with many topics."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bags.writer import BagWriter
from socialbot.bridge import adaptive_subscriptions, recorder
from socialbot.bridge.environment import KEYS_VARIABLE, spinning_node
from socialbot.bridge.keys import new_key
from socialbot.bridge.recorder import Recording, record
from socialbot.bridge.transport import open_transport
from socialbot.core.clock import WallClock
from socialbot.core.messages import Utterance

pytestmark = pytest.mark.ros

SAID = "/said"
MANY = 30
AT_A_TIME = 5


def test_many_topics_are_looked_up_in_turns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A lookup takes time for each endpoint of the domain, so lookups of all topics would cost its square."""
    from rclpy.node import Node
    from std_msgs.msg import String

    monkeypatch.setattr(recorder, "DISCOVERY_PERIOD_S", 0.0)
    monkeypatch.setattr(adaptive_subscriptions, "ADAPT_PERIOD_S", 0.0)
    monkeypatch.setattr(recorder, "LOOKUPS", AT_A_TIME)
    lookups: list[str] = []
    periods: list[int] = []
    look_up, subscribe_new = Node.get_publishers_info_by_topic, recorder._TopicRecorder.subscribe_new

    def noted(self: Node, topic: str, no_mangle: bool = False) -> Any:
        lookups.append(topic)
        return look_up(self, topic, no_mangle)

    def period(self: Any) -> None:
        before = len(lookups)
        subscribe_new(self)
        periods.append(len(lookups) - before)

    monkeypatch.setattr(Node, "get_publishers_info_by_topic", noted)
    monkeypatch.setattr(recorder._TopicRecorder, "subscribe_new", period)
    with spinning_node("many") as ros:
        present = [ros.create_publisher(String, f"/present_{number}", 10) for number in range(MANY)]
        awaited = [ros.create_subscription(String, f"/awaited_{number}", lambda _: None, 10) for number in range(MANY)]
        late: list[Any] = []
        found, complete = 0, False

        def stopped() -> bool:
            """Advertise the awaited topics once all have been found, and end when all are subscribed to."""
            nonlocal found, complete
            if late:
                complete = all(each.get_subscription_count() == 2 for each in late)
                return complete
            if not found and {each.topic_name for each in (*present, *awaited)} <= set(lookups):
                found = len(periods)
            if found and len(periods) == found + 2 * MANY // AT_A_TIME:
                late.extend(ros.create_publisher(String, each.topic_name, 10) for each in awaited)
            return False

        record(tmp_path / "bag", duration_s=60.0, stopped=stopped)
    assert complete
    afterwards = periods[found : found + 2 * MANY // AT_A_TIME]
    assert afterwards == [2 * AT_A_TIME] * len(afterwards)


def recorded(folder: Path, monkeypatch: pytest.MonkeyPatch, *, is_first: bool) -> Recording:
    """Record 20 sealed sentences on a topic that a stranger also has, with another type, ``is_first`` or later."""
    from std_msgs.msg import Bool

    new_key("robot", folder / "keys")
    monkeypatch.setenv(KEYS_VARIABLE, str(folder / "keys"))
    monkeypatch.setattr(recorder, "TRIAL_S", 0.5)
    with spinning_node("sender") as ros, spinning_node("stranger") as foreign:
        stranger = foreign.create_publisher(Bool, SAID, 10) if is_first else None
        numbers = itertools.count()
        sender: Any = None
        counts: list[int] = []

        def stopped() -> bool:
            nonlocal sender, stranger
            if sender is None and (stranger is None or stranger.get_subscription_count()):
                sender = open_transport().advertise(ros, SAID, Utterance)
            if sender is not None and sender.publisher.get_subscription_count():
                if stranger is None:
                    stranger = foreign.create_publisher(Bool, SAID, 10)
                counts.append(next(numbers))
                sender.publish(Utterance(stamp=time.time_ns(), id=str(counts[-1]), text="word"))
                time.sleep(0.01)
            return len(counts) == 200

        return record(folder / "bag", duration_s=60.0, stopped=stopped)


@pytest.mark.parametrize("is_first", [True, False])
def test_a_publisher_of_another_type_does_not_hinder_a_recording(
    is_first: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = recorded(tmp_path, monkeypatch, is_first=is_first)
    assert made.counts[SAID] > 100
    assert made.refused[SAID] == "also of the type std_msgs/msg/Bool, but recorded as std_msgs/msg/String"


class Announced:
    """A node in whose domain a stranger announces ``count`` topics of a type that is not installed."""

    def __init__(self, count: int) -> None:
        self.names = [(f"/topic_{number}", ["no_msgs/msg/No"]) for number in range(count)]
        self.lookups = 0

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return self.names

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        self.lookups += 1
        return [SimpleNamespace(topic_type="no_msgs/msg/No")]


def test_topics_without_end_are_not_looked_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(recorder, "MOST_TOPICS", 500)
    node = Announced(10_000)
    with BagWriter(tmp_path / "bag") as bag:
        made = recorder._TopicRecorder(node, bag, (), WallClock())
        for _ in range(3):
            made.subscribe_new()
    assert node.lookups == len(made.refusals()) == 500
    assert [each.getMessage().rpartition("(")[2] for each in caplog.records] == [
        "1 topics)",
        "10 topics)",
        "100 topics)",
        "more than 500 topics: further ones are not recorded, unless they are named",
    ]
