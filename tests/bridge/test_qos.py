"""Quality of service of publishers and subscriptions."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from std_msgs.msg import String

from socialbot.bridge.environment import spinning_node
from socialbot.bridge.qos import profile, publisher_qos
from socialbot.graph.ports import FRESH_S, Delivery
from tests.system.running import eventually


@pytest.mark.ros
def test_only_fresh_messages_are_given_up():
    lifespans = {delivery: publisher_qos(delivery).lifespan.nanoseconds for delivery in Delivery}
    assert lifespans.pop(Delivery.FRESH) == FRESH_S * 1e9
    assert all(one == 0 or one > 1e18 for one in lifespans.values()), "no limit"


pytestmark = pytest.mark.ros


def test_both_sides_of_an_incompatible_connection_learn_of_it():
    """The polls of an executor find the events, also while messages keep it busy."""
    found: list[str] = []
    with spinning_node("reader") as reader, spinning_node("writer") as writer:
        heard: list[Any] = []
        reader.create_subscription(String, "/busy", heard.append, 10)
        busy = writer.create_publisher(String, "/busy", 10)
        reader.create_subscription(
            String,
            "/said",
            heard.append,
            profile(10, latched=True),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda _: found.append("subscription")),
        )
        writer.create_publisher(
            String,
            "/said",
            profile(10),
            event_callbacks=PublisherEventCallbacks(incompatible_qos=lambda _: found.append("publisher")),
        )

        def is_found() -> bool:
            busy.publish(String(data="word"))
            return len(found) >= 2

        assert eventually(is_found)
        assert eventually(lambda: heard)
        assert sorted(found) == ["publisher", "subscription"]
