"""What a node tells about its costs."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.ros


def test_mean_and_percentiles_of_durations():
    from socialbot.bridge.diagnostics import DurationStats

    assert DurationStats.of([]) == DurationStats(0.0, 0.0, 0.0)
    stats = DurationStats.of([0.001 * number for number in range(1, 101)])
    assert stats.mean == pytest.approx(0.0505)
    assert (stats.p50, stats.p99) == pytest.approx((0.051, 0.1))


def test_rates_are_of_the_time_in_between():
    from socialbot.bridge.diagnostics import ResourceUsage

    rates = ResourceUsage(12.0, calls=50, published=7, cpu_s=1.5).rates_since(
        ResourceUsage(10.0, calls=30, published=3, cpu_s=1.0)
    )
    assert rates == {"call_hz": 10.0, "publish_hz": 2.0, "cpu_percent": 25.0}


def test_the_process_knows_its_memory():
    from socialbot.bridge.diagnostics import process_costs

    costs = process_costs()
    assert 1.0 < costs["rss_mb"] <= costs["peak_rss_mb"] + 1.0
