"""Who looks on hears everything, however late it comes to it."""

from __future__ import annotations

import threading

import pytest

from socialbot.bridge.graph_observer import observe_graph
from socialbot.core.messages import Message, TraceRecord
from tests.system.running import eventually

pytestmark = pytest.mark.ros

TRACE = "/agent/trace"
RECORDS = 1500


def test_nothing_is_lost_while_an_onlooker_is_held_up() -> None:
    from rclpy.duration import Duration

    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.transport import open_transport, publisher_qos
    from socialbot.graph.node import Delivery

    heard: list[str] = []
    free = threading.Event()

    def observe(topic: str, message: Message) -> None:
        assert isinstance(message, TraceRecord)
        heard.append(message.id)
        free.wait(60)

    own = open_transport()
    with observe_graph({TRACE: TraceRecord}, observe, lambda name, values: None), spinning_node("agent") as ros:
        publisher = ros.create_publisher(own.message_class(TraceRecord), TRACE, publisher_qos(Delivery.EVERY))
        sender = own.sender(publisher)
        assert eventually(lambda: publisher.get_subscription_count() == 1, 20)
        for number in range(RECORDS):
            sender.publish(TraceRecord(stamp=number, id=f"agent-{number}", source="agent", kind="belief", what="b"))
            if number % 50 == 0:  # so that the writer, who keeps 100, is not what loses some
                assert publisher.wait_for_all_acked(Duration(seconds=20))
        free.set()
        assert eventually(lambda: len(heard) == RECORDS, 20)
    assert heard == [f"agent-{number}" for number in range(RECORDS)]
