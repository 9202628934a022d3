"""Quality of service of publishers and subscriptions."""

from __future__ import annotations

import threading
from time import sleep
from typing import Any

import pytest
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from std_msgs.msg import String

from socialbot.bridge.environment import ros_context, spinning_node
from socialbot.bridge.qos import profile, publisher_qos
from socialbot.bridge.wait_sets import POLL_PERIOD_S, POLL_S, OneThreadExecutor, PollingGroup, PollingNode
from socialbot.graph.ports import FRESH_S, Delivery
from tests.system.running import eventually


@pytest.mark.ros
def test_only_fresh_messages_are_given_up():
    lifespans = {delivery: publisher_qos(delivery).lifespan.nanoseconds for delivery in Delivery}
    assert lifespans.pop(Delivery.FRESH) == FRESH_S * 1e9
    assert all(one == 0 or one > 1e18 for one in lifespans.values()), "no limit"


pytestmark = pytest.mark.ros


@pytest.fixture
def handlers() -> Any:
    with ros_context() as context:
        node = PollingNode("owner", context=context)
        subscription: Any = node.create_subscription(String, "/said", lambda one: None, 10)
        yield subscription.event_handlers
        node.destroy_node()


def test_event_handlers_wait_for_the_next_poll(handlers):
    now = 100.0
    group = PollingGroup(lambda: now)
    assert handlers
    assert all(group.can_execute(each) for each in handlers)
    now += 0.9 * POLL_S
    assert all(group.can_execute(each) for each in handlers)
    now += 0.2 * POLL_S
    assert not any(group.can_execute(each) for each in handlers)
    now = 100.0 + POLL_PERIOD_S
    assert all(group.can_execute(each) for each in handlers)
    now += 1.1 * POLL_S
    assert not any(group.can_execute(each) for each in handlers)


def test_other_entities_never_wait():
    now = 100.0
    group = PollingGroup(lambda: now)
    for _ in range(3):
        assert group.can_execute(object())
        now += POLL_S


def test_both_sides_of_an_incompatible_connection_learn_of_it():
    """The polls of an rclpy executor find the events, also while messages keep it busy."""
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


def test_most_wait_sets_hold_no_event_handlers():
    with ros_context() as context:
        node = PollingNode("owner", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        node.create_publisher(String, "/said", 10)
        assert (waitables := list(node.waitables))
        executor.spin_once(timeout_sec=0.0)
        assert eventually(lambda: not any(map(executor.can_execute, waitables)))
        assert all(map(executor.can_execute, node.services))
        executor.shutdown()
        node.destroy_node()


def test_a_message_costs_one_wait_set(monkeypatch: pytest.MonkeyPatch):
    made = []
    wait_set = _rclpy.WaitSet
    monkeypatch.setattr(_rclpy, "WaitSet", lambda *sizes: made.append(sizes) or wait_set(*sizes))
    with ros_context() as context:
        node = PollingNode("owner", context=context, enable_rosout=False, start_parameter_services=False)
        executor = OneThreadExecutor(context=context)
        executor.add_node(node)
        said = node.create_publisher(String, "/said", 10)
        heard: list[str] = []

        def take(message: Any) -> None:
            heard.append(message.data)

        node.create_subscription(String, "/said", take, 10)

        def is_heard(word: str) -> bool:
            executor.spin_once(timeout_sec=1.0)
            return heard[-1:] == [word]

        def first_is_heard() -> bool:
            said.publish(String(data="first"))
            return is_heard("first")

        assert eventually(first_is_heard)
        made.clear()

        def talk() -> None:
            for number in range(20):
                said.publish(String(data=str(number)))
                eventually(lambda number=number: heard[-1] == str(number))
                sleep(0.02)  # the executor waits again

        talking = threading.Thread(target=talk)
        talking.start()
        assert eventually(lambda: is_heard("19"))
        talking.join()
        assert len(made) <= 30  # of 20 messages, and of a few other events
        executor.shutdown()
        node.destroy_node()


def test_other_threads_wake_a_spinning_executor():
    with ros_context() as context:
        executor = OneThreadExecutor(context=context)
        done = threading.Event()
        spinning = threading.Thread(target=executor.spin_once, args=(60.0,), daemon=True)
        spinning.start()
        sleep(0.2)
        executor.create_task(done.set)
        spinning.join(30.0)
        assert done.is_set()
        executor.shutdown()
