"""Subscriptions of observers that fit their publishers, without DDS."""

from __future__ import annotations

import logging
import time
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge.adaptive_subscriptions import ADAPT_PERIOD_S, AdaptiveSubscription
from socialbot.bridge.qos import profile
from socialbot.bridge.stream_watch import FOREIGN_PAUSE_S, MAX_PAUSE_S, StreamWatch

pytestmark = pytest.mark.ros
HOUR_S = 3600
RELIABLE, BEST_EFFORT, LATCHED = profile(1), profile(1, reliable=False), profile(1, latched=True)


class Ros:
    """Keeps the publishers and the subscriptions of a topic, and the time (s)."""

    def __init__(self) -> None:
        self.now = 100.0
        self.offers = [RELIABLE]
        self.made: list[Any] = []
        self.present: list[Any] = []

    def get_name(self) -> str:
        return "observer"

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        return [SimpleNamespace(node_name="other", qos_profile=offer) for offer in self.offers]

    def create_subscription(self, kind: Any, name: str, take: Any, qos: Any, **_: Any) -> Any:
        count = lambda: len(self.offers)  # noqa: E731
        self.made.append(qos)
        self.present.append(SimpleNamespace(topic_name=name, get_publisher_count=count))
        return self.present[-1]

    def destroy_subscription(self, subscription: Any) -> None:
        self.present.remove(subscription)


@pytest.fixture
def ros() -> Ros:
    return Ros()


def subscribed(ros: Ros, watch: StreamWatch | None = None) -> AdaptiveSubscription:
    return AdaptiveSubscription(ros, "/said", None, lambda _: None, raw=True, watch=watch, clock=lambda: ros.now)


def passes(ros: Ros, subscription: AdaptiveSubscription, seconds: float) -> None:
    for _ in range(round(seconds / ADAPT_PERIOD_S)):
        ros.now += ADAPT_PERIOD_S
        subscription.adapt()


def test_fits_the_weakest_publisher_at_once(ros: Ros) -> None:
    subscription = subscribed(ros)
    ros.offers = [LATCHED]
    subscription.adapt()
    assert subscription.latched
    for offer in (RELIABLE, BEST_EFFORT):
        ros.offers = [LATCHED, offer]
        passes(ros, subscription, ADAPT_PERIOD_S)
        assert ros.made[-1].reliability == offer.reliability
        assert not subscription.latched
    ros.offers = [LATCHED]
    passes(ros, subscription, ADAPT_PERIOD_S)
    assert subscription.latched
    assert len(ros.made) == 4
    assert len(ros.present) == 1


def test_publishers_without_end_take_a_limited_share_of_the_time(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger announced them. A look that takes 0.1 s comes once a second."""
    looks = []

    def look(name: str) -> list[Any]:
        looks.append(ros.now)
        end_s = time.thread_time() + 0.1
        while time.thread_time() < end_s:
            pass
        return []

    monkeypatch.setattr(ros, "get_publishers_info_by_topic", look)
    passes(ros, subscribed(ros), 10.0)
    assert 2 <= len(looks) <= 10


@pytest.mark.parametrize("has_keys", [False, True])
@pytest.mark.parametrize(
    "period_s", [1, 150, *(pytest.param(period, marks=pytest.mark.slow) for period in (5, 13, 40))]
)
def test_a_stranger_of_another_quality_who_comes_and_goes_is_seldom_followed(
    ros: Ros, has_keys: bool, period_s: int
) -> None:
    watch = StreamWatch(has_foreign=True, clock=lambda: ros.now) if has_keys else None
    subscription = subscribed(ros, watch)
    subscription.adapt()
    for second in range(HOUR_S):
        ros.offers = [RELIABLE, BEST_EFFORT] if second // period_s % 2 else [RELIABLE]
        if watch is not None:
            watch.note(("robot", "1"), second, is_beacon=False)
        passes(ros, subscription, 1.0)
    assert len(ros.made) <= 2 * (7 + HOUR_S / FOREIGN_PAUSE_S)


def test_the_log_names_few_of_many_replacements(ros: Ros, caplog: pytest.LogCaptureFixture) -> None:
    watch = StreamWatch(clock=lambda: ros.now)
    subscription = subscribed(ros, watch)
    subscription.adapt()
    watch.note(("robot", "1"), 1, is_beacon=False)
    with caplog.at_level(logging.WARNING):
        passes(ros, subscription, 10.5 * MAX_PAUSE_S)
    assert [record.getMessage() for record in caplog.records] == [
        "/said: subscribed again (1): 1 of 1 publishers are silent",
        "/said: subscribed again (10): 1 of 1 publishers are silent",
    ]
