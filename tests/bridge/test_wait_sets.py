"""The executor with a kept wait set: it hears all that one of rclpy hears, and makes fewer wait sets."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Iterator
from time import sleep
from typing import Any

import pytest
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, ShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from rclpy.utilities import try_shutdown
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from evaluation.rtps_attack import freed, ports
from socialbot.bridge.environment import ros_context
from socialbot.bridge.qos import profile
from socialbot.bridge.wait_sets import POLL_PERIOD_S, OneThreadExecutor, _WaitSet
from tests.system.running import eventually

pytestmark = pytest.mark.ros


class _Spun:
    """A node with its executor, which the test spins, and a clock (s) of its polls that the test sets."""

    def __init__(self, context: Any) -> None:
        self.now_s = 100.0
        self.node = Node("owner", context=context, enable_rosout=False, start_parameter_services=False)
        self.executor = OneThreadExecutor(context=context, clock=lambda: self.now_s)
        self.executor.add_node(self.node)
        self.heard: list[str] = []
        self.said = self.node.create_publisher(String, "/said", 100)

    def take(self, message: Any) -> None:
        self.heard.append(message.data)

    def until(self, done: Callable[[], Any]) -> bool:
        def is_done() -> bool:
            self.executor.spin_once(timeout_sec=0.02)
            return bool(done())

        return eventually(is_done)

    def is_hearing(self, word: str) -> bool:
        """Whether ``word`` is heard, which is said again and again until its subscription is matched."""

        def says() -> bool:
            self.said.publish(String(data=word))
            return word in self.heard

        return self.until(says)

    def settle(self, times: int = 20) -> None:
        for _ in range(times):
            self.executor.spin_once(timeout_sec=0.01)


@pytest.fixture
def spun() -> Iterator[_Spun]:
    with ros_context() as context:
        one = _Spun(context)
        yield one
        one.executor.shutdown()
        one.node.destroy_node()


def test_messages_need_no_new_wait_set(spun: _Spun, monkeypatch: pytest.MonkeyPatch):
    spun.node.create_subscription(String, "/said", spun.take, 100)
    assert spun.is_hearing("first")
    made: list[Any] = []
    wait_set = _rclpy.WaitSet
    monkeypatch.setattr(_rclpy, "WaitSet", lambda *sizes: made.append(sizes) or wait_set(*sizes))
    for number in range(20):
        spun.said.publish(String(data=str(number)))
    assert spun.until(lambda: spun.heard[-1] == "19")
    assert [each for each in spun.heard if each != "first"] == [str(each) for each in range(20)]
    assert not made
    other = spun.node.create_subscription(String, "/said", spun.take, 100)
    spun.settle(2)
    assert len(made) == 2  # for the entities, and for the QoS events
    spun.node.destroy_subscription(other)
    spun.settle(2)
    assert len(made) == 4


def test_a_callback_that_ends_its_subscription_hears_nothing_more(spun: _Spun):
    others = [spun.node.create_subscription(String, "/said", spun.take, 100) for _ in range(3)]

    def end(message: Any) -> None:
        spun.heard.append(f"end {message.data}")
        for each in [first, *others]:
            spun.node.destroy_subscription(each)

    first: Any = spun.node.create_subscription(String, "/said", end, 100)
    assert spun.is_hearing("word")
    assert spun.until(lambda: any(each.startswith("end") for each in spun.heard))
    heard = len(spun.heard)
    spun.said.publish(String(data="later"))
    spun.settle()
    assert len(spun.heard) == heard


def test_a_topic_may_change_its_type(spun: _Spun):
    """DDS refuses a second type while the first subscription exists."""
    old = spun.node.create_subscription(Bool, "/either", spun.take, 100)
    spun.settle(3)
    spun.node.destroy_subscription(old)
    spun.node.create_subscription(String, "/either", spun.take, 100)


@pytest.mark.parametrize("raw", [False, True])
def test_a_message_that_dds_has_freed_in_its_queue_stops_nothing(spun: _Spun, raw: bool, caplog: Any):
    """Fast DDS reads it again and again, without end, or returns it as an empty message."""
    sizes: list[int] = []

    def take(message: Any) -> None:
        sizes.append(len(message))
        spun.take(deserialize_message(message, String))

    subscription = spun.node.create_subscription(String, "/said", take if raw else spun.take, 100, raw=raw)
    assert spun.is_hearing("first")
    damaged, publisher = subscription.handle, bytes(spun.node.get_publishers_info_by_topic("/said")[0].endpoint_gid)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for port in ports(int(os.environ["ROS_DOMAIN_ID"])):
            sender.sendto(freed(publisher, 100), ("127.0.0.1", port))
    assert spun.until(lambda: spun.said.publish(String(data="lost")) or subscription.handle is not damaged)
    assert spun.is_hearing("after")
    assert 0 not in sizes
    assert "/said" in caplog.text
    assert len(list(spun.node.subscriptions)) == 1
    spun.node.destroy_subscription(subscription)
    assert not list(spun.node.subscriptions)


def test_a_latched_message_comes_once_also_if_its_subscription_is_made_again(spun: _Spun):
    latched = profile(10, latched=True)
    publisher = spun.node.create_publisher(String, "/kept", latched)
    subscription = spun.node.create_subscription(String, "/kept", spun.take, latched)
    publisher.publish(String(data="once"))
    assert spun.until(lambda: spun.heard == ["once"])
    damaged, writer = subscription.handle, bytes(spun.node.get_publishers_info_by_topic("/kept")[0].endpoint_gid)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for port in ports(int(os.environ["ROS_DOMAIN_ID"])):
            sender.sendto(freed(writer, 1000), ("127.0.0.1", port))
    assert spun.until(lambda: subscription.handle is not damaged)
    publisher.publish(String(data="twice"))
    assert spun.until(lambda: "twice" in spun.heard)
    assert spun.heard == ["once", "twice"]


def test_subscriptions_that_are_damaged_at_the_same_time_are_all_made_again(spun: _Spun):
    topics = ["/said", "/second", "/third"]
    said = [spun.said, *(spun.node.create_publisher(String, topic, 100) for topic in topics[1:])]
    subscriptions = [spun.node.create_subscription(String, topic, spun.take, 100) for topic in topics]

    def say(words: list[str]) -> None:
        for publisher, word in zip(said, words, strict=True):
            publisher.publish(String(data=word))

    def all_hear(kind: str) -> bool:
        words = [f"{kind} {topic}" for topic in topics]
        return spun.until(lambda: say(words) or set(words) <= set(spun.heard))

    assert all_hear("first")
    damaged = [each.handle for each in subscriptions]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for topic in topics:
            publisher = bytes(spun.node.get_publishers_info_by_topic(topic)[0].endpoint_gid)
            for port in ports(int(os.environ["ROS_DOMAIN_ID"])):
                sender.sendto(freed(publisher, 1000), ("127.0.0.1", port))

    def are_made_again() -> bool:
        say(["lost"] * 3)
        return all(one.handle is not handle for one, handle in zip(subscriptions, damaged, strict=True))

    assert spun.until(are_made_again)
    assert all_hear("after")


@pytest.mark.parametrize("content", [b"", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\xff"])
def test_messages_that_are_none_of_the_type_are_dropped(spun: _Spun, content: bytes):
    subscription = spun.node.create_subscription(String, "/said", spun.take, 100)
    assert spun.is_hearing("first")
    for _ in range(3):
        spun.said.publish(content)
    heard, handle = len(spun.heard), subscription.handle
    assert spun.is_hearing("second")
    assert set(spun.heard[heard:]) <= {"first", "second"}
    assert subscription.handle is handle


def test_entities_of_a_callback_are_heard(spun: _Spun):
    def begin() -> None:
        timer.cancel()
        spun.node.create_subscription(String, "/said", spun.take, 100)

    timer = spun.node.create_timer(0.01, begin)
    assert spun.is_hearing("word")
    ticks: list[int] = []
    spun.node.create_timer(0.01, lambda: ticks.append(1))
    assert spun.until(lambda: len(ticks) >= 3)


def test_entities_of_another_thread_are_heard_without_a_timeout(spun: _Spun):
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            spun.executor.spin_once()

    spinning = threading.Thread(target=spin, daemon=True)
    spinning.start()
    sleep(0.1)
    spun.node.create_subscription(String, "/said", spun.take, 100)

    def is_heard() -> bool:
        spun.said.publish(String(data="word"))
        return "word" in spun.heard

    assert eventually(is_heard)
    ended.set()
    spun.executor.create_task(lambda: None)
    spinning.join(30.0)
    assert not spinning.is_alive()


def test_a_cancelled_timer_is_not_called(spun: _Spun):
    called: list[str] = []

    def first() -> None:
        called.append("first")
        second.cancel()
        timer.cancel()

    timer = spun.node.create_timer(0.01, first)
    second = spun.node.create_timer(0.01, lambda: called.append("second"))
    sleep(0.05)  # both are due at once
    assert spun.until(lambda: called)
    spun.settle()
    assert called in (["first"], ["second", "first"])


def test_services_and_clients_answer(spun: _Spun):
    def serve(request: Any, response: Any) -> Any:
        response.success = request.data
        return response

    spun.node.create_service(SetBool, "/switch", serve)
    client = spun.node.create_client(SetBool, "/switch")
    assert spun.until(client.service_is_ready)
    answer = client.call_async(SetBool.Request(data=True))
    spun.executor.spin_until_future_complete(answer, timeout_sec=30.0)
    response: Any = answer.result()
    assert response.success


def test_guard_conditions_call_back(spun: _Spun):
    called: list[int] = []
    guard = spun.node.create_guard_condition(lambda: called.append(1))
    spun.settle(3)
    guard.trigger()
    assert spun.until(lambda: called == [1])
    spun.settle()
    assert called == [1]


def test_a_guard_condition_survives_a_change_before_its_callback(spun: _Spun):
    called: list[int] = []

    def change() -> None:
        called.append(1)
        spun.node.create_subscription(String, "/said", spun.take, 100)

    first = spun.node.create_guard_condition(change)
    second = spun.node.create_guard_condition(lambda: called.append(2))
    spun.settle(3)
    first.trigger()
    second.trigger()
    assert spun.until(lambda: sorted(called) == [1, 2])


def test_coroutines_are_run(spun: _Spun):
    async def note(message: Any) -> None:
        spun.heard.append(message.data)

    take: Any = note
    spun.node.create_subscription(String, "/said", take, 100)
    assert spun.is_hearing("word")


def test_callbacks_may_ask_for_information_on_a_message(spun: _Spun):
    stamps: list[Any] = []

    def note(message: Any, info: Any) -> None:
        stamps.append(info["received_timestamp"])
        spun.take(message)

    take: Any = note
    spun.node.create_subscription(String, "/said", take, 100)
    assert spun.is_hearing("word")
    assert stamps[0] > 0


@pytest.mark.parametrize("kind", ["subscription", "timer", "task"])
def test_an_exception_leaves_the_spin_and_ends_nothing(spun: _Spun, kind: str):
    def fail(*_: Any) -> None:
        spun.node.destroy_timer(timer)
        for each in list(spun.node.subscriptions):
            spun.node.destroy_subscription(each)
        raise LookupError(kind)

    timer = spun.node.create_timer(0.02 if kind == "timer" else 1e6, fail)
    failing = spun.node.create_publisher(String, "/failing", 10)
    if kind == "subscription":
        spun.node.create_subscription(String, "/failing", fail, 100)
    if kind == "task":
        spun.executor.create_task(fail)

    def is_failed() -> bool:
        failing.publish(String(data="word"))
        try:
            spun.executor.spin_once(timeout_sec=0.02)
        except LookupError as error:
            return error.args == (kind,)
        return False

    assert eventually(is_failed)
    spun.node.create_timer(0.02, lambda: spun.heard.append("word"))
    assert spun.until(lambda: spun.heard)


def test_qos_events_are_looked_for_once_a_second(spun: _Spun):
    found: list[Any] = []
    spun.node.create_subscription(
        String,
        "/kept",
        spun.take,
        profile(10, latched=True),
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=found.append),
    )
    spun.settle()  # the first look
    spun.node.create_publisher(String, "/kept", profile(10))
    spun.settle(50)
    assert not found
    spun.now_s += POLL_PERIOD_S
    assert spun.until(lambda: found)


@pytest.mark.parametrize("is_suspended", [False, True])
def test_an_event_that_waits_for_its_look_keeps_no_core_busy(
    is_suspended: bool, spun: _Spun, monkeypatch: pytest.MonkeyPatch
):
    """One packet of a stranger a second announces a publisher with another quality of service."""

    async def await_without_end() -> None:
        await Future()

    if is_suspended:
        spun.executor.create_task(await_without_end)
    spun.node.create_subscription(String, "/said", spun.take, profile(1))
    spun.settle()
    with ros_context() as context:
        other = Node("other", context=context)
        other.create_publisher(String, "/said", profile(1, reliable=False))
        assert spun.until(lambda: spun.node.count_publishers("/said") == 2)
        waits: list[int] = []
        wait = _WaitSet.wait
        monkeypatch.setattr(_WaitSet, "wait", lambda one, timeout_ns: waits.append(timeout_ns) or wait(one, timeout_ns))
        spun.executor.spin_once(timeout_sec=0.5)
        assert len(waits) < 150
        other.destroy_node()


def test_other_threads_wake_a_spinning_executor(spun: _Spun):
    done = threading.Event()
    spinning = threading.Thread(target=spun.executor.spin_once, args=(60.0,), daemon=True)
    spinning.start()
    sleep(0.2)
    spun.executor.create_task(done.set)
    spinning.join(30.0)
    assert done.is_set()


def test_another_thread_shuts_a_waiting_executor_down(spun: _Spun):
    subscription: Any = spun.node.create_subscription(String, "/said", spun.take, 100)
    ends: list[str] = []

    def spin() -> None:
        try:
            while True:
                spun.executor.spin_once()
                if spun.executor._is_shutdown:
                    ends.append("shut down")
                    return
        except (ExternalShutdownException, ShutdownException) as error:
            ends.append(type(error).__name__)

    spinning = threading.Thread(target=spin, daemon=True)
    spinning.start()
    sleep(0.1)
    spun.executor.shutdown()
    spinning.join(30.0)
    assert ends == ["shut down"]
    # Its entities are free again: a handle in use cannot be destroyed.
    spun.node.destroy_subscription(subscription)
    with pytest.raises(_rclpy.InvalidHandle), subscription.handle:
        pass


def test_the_end_of_the_context_ends_a_spin(spun: _Spun):
    ends: list[str] = []

    def spin() -> None:
        try:
            while True:
                spun.executor.spin_once()
        except ExternalShutdownException:
            ends.append("ended")

    spinning = threading.Thread(target=spin, daemon=True)
    spinning.start()
    sleep(0.1)
    try_shutdown(context=spun.node.context)
    spinning.join(30.0)
    assert ends == ["ended"]


def test_a_node_may_leave(spun: _Spun):
    other = Node("other", context=spun.node.context, enable_rosout=False, start_parameter_services=False)
    other.create_subscription(String, "/said", spun.take, 100)
    spun.executor.add_node(other)
    assert spun.is_hearing("word")
    spun.executor.remove_node(other)
    spun.settle(3)
    heard = len(spun.heard)
    spun.said.publish(String(data="later"))
    spun.settle()
    assert len(spun.heard) == heard
    other.destroy_node()
