"""Quality of service of publishers and subscriptions."""

from __future__ import annotations

import copy
from collections.abc import Collection
from typing import Any

from socialbot.core.clock import nanoseconds
from socialbot.graph.ports import FRESH_S, Delivery

QUEUE_DEPTH = {Delivery.EVERY: 100, Delivery.NEWEST: 10, Delivery.FRESH: 10, Delivery.LATCHED: 1}
"""History depth of publishers, and of subscriptions, which have at least `LEAST_DEPTH`."""

LEAST_DEPTH = 10
"""Least history depth of a subscription. With less, messages of several publishers or of one moment are lost."""

SEALED_DEPTH = 1000
"""History depth of subscriptions to sealed texts: invalid messages of strangers push no valid one out for a moment."""

OBSERVER_DEPTH = 2000  # history depth of an observer, which may fall behind on many topics


def publisher_qos(delivery: Delivery) -> Any:
    """Profile of publishers: reliable, to match all subscriptions; transient local for latched topics."""
    made = profile(QUEUE_DEPTH[delivery], latched=delivery is Delivery.LATCHED)
    if delivery is Delivery.FRESH:
        from rclpy.duration import Duration

        made.lifespan = Duration(nanoseconds=nanoseconds(FRESH_S))
    return made


def subscription_qos(delivery: Delivery, *, outside: bool = False) -> Any:
    """Profile of subscriptions: that of the publisher within the graph.

    Drivers ``outside`` the graph may publish best effort and volatile. A stricter subscription would not match them, so
    this one requests the least.
    """
    undemanding = outside and delivery is not Delivery.EVERY
    latched = delivery is Delivery.LATCHED and not undemanding
    return profile(max(LEAST_DEPTH, QUEUE_DEPTH[delivery]), reliable=not undemanding, latched=latched)


def sealed_qos(qos: Any) -> Any:
    """Return a profile of a subscription with the depth for sealed texts."""
    made = copy.copy(qos)
    made.depth = max(SEALED_DEPTH, qos.depth)
    return made


def observer_qos(*, latched: bool) -> Any:
    """Profile of an observer that records a topic of the graph."""
    return profile(OBSERVER_DEPTH, latched=latched)


def matching_qos(publishers: Collection[Any], depth: int) -> Any:
    """Strictest profile that matches all ``publishers``."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = reliable and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return profile(depth, reliable=reliable, latched=latched)


def profile(depth: int, *, reliable: bool = True, latched: bool = False) -> Any:
    """Profile that keeps the last ``depth`` messages; transient local if ``latched``."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
