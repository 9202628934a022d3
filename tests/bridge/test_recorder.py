"""Recorder in a domain with many topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from socialbot.bridge import adaptive_subscriptions, recorder
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.recorder import record

pytestmark = pytest.mark.ros

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
        awaited = [ros.create_subscription(String, f"/awaited_{number}", print, 10) for number in range(MANY)]
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
