from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.warehouse._robots import Drive
from socialbot.agents.warehouse.messages import Point
from socialbot.core.clock import SECOND

HERE, THERE = Point(0.0, 0.0, 0.0), Point(3.2, 0.0, 0.0)


def going(target: Point = THERE) -> Drive:
    drive = Drive(HERE)
    drive.go(0, target, speed=0.72, acceleration=0.72)
    return drive


def x(drive: Drive, seconds: float) -> float:
    return drive.position(round(seconds * SECOND)).x


def test_drive_accelerates_cruises_and_stops_at_target():
    drive = going()
    assert drive.arrival / SECOND == pytest.approx(3.2 / 0.72 + 1.0)
    assert [x(drive, 0.0), x(drive, 1.0), x(drive, 2.0)] == pytest.approx([0.0, 0.36, 1.08])
    assert x(drive, drive.arrival / SECOND - 1.0) == pytest.approx(3.2 - 0.36)
    assert drive.position(drive.arrival) == THERE


def test_short_path_stays_below_top_speed():
    drive = going(Point(0.18, 0.0, 0.0))
    assert drive.arrival / SECOND == pytest.approx(1.0)
    assert x(drive, 0.5) == pytest.approx(0.09)


def test_pause_delays_only_later_motion():
    drive, paused = going(), going()
    paused.pause(2 * SECOND, 1.5)
    assert x(paused, 2.0) == x(paused, 3.0) == x(paused, 3.5) == x(drive, 2.0)
    assert x(paused, 4.0) == pytest.approx(x(drive, 2.5))
    assert paused.arrival == drive.arrival + 1.5 * SECOND


def test_overlapping_pauses_count_once():
    drive = going()
    before = drive.arrival
    drive.pause(2 * SECOND, 1.0)
    drive.pause(2 * SECOND + SECOND // 2, 1.0)
    assert drive.arrival == before + 1.5 * SECOND


def test_reversal_brakes_first():
    drive = going()
    drive.go(2 * SECOND, HERE, speed=0.72, acceleration=0.72)
    assert x(drive, 3.0) == pytest.approx(1.08 + 0.36)
    assert x(drive, 2.9) < x(drive, 3.0) > x(drive, 3.1)
    assert drive.position(drive.arrival) == HERE


def test_motion_can_start_later():
    drive = Drive(HERE)
    drive.go(0, THERE, speed=1.0, acceleration=1.0, begin=2 * SECOND)
    assert x(drive, 2.0) == 0.0 < x(drive, 2.1)


times = st.integers(0, 8 * SECOND)
points = st.builds(Point, st.floats(-3, 3), st.floats(-3, 3), st.just(0.0))
orders = st.lists(st.tuples(times, points | st.floats(0.1, 3.0)), max_size=8)


@given(orders=orders, probes=st.lists(times, max_size=20))
def test_motion_is_continuous_for_any_commands(orders, probes):
    drive = Drive(HERE)
    queue = sorted(
        [*((time, what) for time, what in orders), *((time, None) for time in probes)], key=lambda one: one[0]
    )
    last, before = HERE, 0
    for time, what in queue:
        now = drive.position(time)
        moved = ((now.x - last.x) ** 2 + (now.y - last.y) ** 2) ** 0.5
        assert moved <= 1.0 * (time - before) / SECOND + 1e-6
        if isinstance(what, Point):
            drive.go(time, what, speed=1.0, acceleration=0.7)
        elif what is not None:
            drive.pause(time, what)
        after = drive.position(time)
        assert [after.x, after.y] == pytest.approx([now.x, now.y], abs=1e-6)
        last, before = now, time
    assert drive.position(drive.arrival) == drive.target
