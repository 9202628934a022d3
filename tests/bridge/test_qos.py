"""Quality of service of publishers and subscriptions."""

from __future__ import annotations

import pytest

from socialbot.bridge.qos import publisher_qos
from socialbot.graph.ports import FRESH_S, Delivery


@pytest.mark.ros
def test_only_fresh_messages_are_given_up():
    lifespans = {delivery: publisher_qos(delivery).lifespan.nanoseconds for delivery in Delivery}
    assert lifespans.pop(Delivery.FRESH) == FRESH_S * 1e9
    assert all(one == 0 or one > 1e18 for one in lifespans.values()), "no limit"
