"""Quality of service: what `Delivery` means in DDS."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from socialbot.graph.node import Delivery

DEPTH = {Delivery.EVERY: 100, Delivery.NEWEST: 10, Delivery.LATCHED: 1}
"""Messages that a writer keeps for a slow reader, and a reader for a slow node."""

ONLOOKER_DEPTH = 2000
"""Messages of a topic that are kept for who only records: it has many topics to hear, and may be late for a while."""


def publisher_qos(delivery: Delivery) -> Any:
    """Reliable always, so that readers of both kinds match; late joiners get the last of a latched topic."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    latched = delivery is Delivery.LATCHED
    return QoSProfile(
        depth=DEPTH[delivery],
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def subscription_qos(delivery: Delivery, *, outside: bool) -> Any:
    """The same as the publisher's within the graph.

    What comes from ``outside`` may come from any driver, and many publish streams best effort and
    volatile; a reader that asks for more would get nothing at all.
    """
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    undemanding = outside and delivery is not Delivery.EVERY
    latched = delivery is Delivery.LATCHED and not undemanding
    return QoSProfile(
        depth=DEPTH[delivery],
        reliability=ReliabilityPolicy.BEST_EFFORT if undemanding else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def onlooker_qos(*, latched: bool) -> Any:
    """What a reader asks for that records a topic of the graph; of those that are ``latched`` the last, too."""
    qos = subscription_qos(Delivery.LATCHED if latched else Delivery.EVERY, outside=False)
    qos.depth = ONLOOKER_DEPTH
    return qos


def matching_qos(publishers: Collection[Any], depth: int) -> Any:
    """As much as all ``publishers`` offer: who asks for more gets nothing."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = reliable and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
