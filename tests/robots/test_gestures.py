"""Gestures: their ways are smooth, within limits, and end where they should."""

from __future__ import annotations

import pytest

from socialbot.robots.reachy_mini import (
    ANTENNA_RAD,
    CHANNELS,
    GESTURES,
    REST,
    RISE_M,
    ROLL_RAD,
    GesturePlayer,
    minimum_jerk,
    overshoot,
    stepped,
)

FASTEST = {"yaw": 1.0, "pitch": 1.5, "roll": 1.0, "z": 0.05, "left": 4.0, "right": 4.0}
"""Highest speed of a gesture, 1/s."""


@pytest.mark.parametrize("easing", [minimum_jerk, overshoot])
def test_easings_begin_at_0_and_end_at_1(easing):
    assert easing(0.0) == pytest.approx(0.0, abs=1e-4)
    assert easing(1.0) == pytest.approx(1.0)


@pytest.mark.parametrize("name", GESTURES)
def test_a_gesture_is_continuous_and_within_the_limits_of_the_robot(name):
    gesture, step_s = GESTURES[name], 0.01
    before = gesture.at(0.0)
    assert before == pytest.approx(REST, abs=1e-6)
    for hundredth in range(1, round((2 * gesture.duration_s + 1.0) / step_s)):
        now = gesture.at(hundredth * step_s)
        for channel in CHANNELS:
            assert abs(now[channel] - before[channel]) <= FASTEST[channel] * step_s, (channel, hundredth * step_s)
        assert abs(now["roll"]) <= ROLL_RAD
        assert abs(now["z"]) <= RISE_M
        assert max(abs(now["left"]), abs(now["right"])) <= ANTENNA_RAD
        before = now
    assert (before == pytest.approx(REST)) or gesture.after != "end"


def test_a_gesture_that_ends_is_followed_by_the_one_that_lasts():
    player = GesturePlayer()
    player.play("idle", 0.0)
    player.play("greeting", 2.0)
    player.at(2.5)
    player.play("listening", 3.0)
    assert player.name == "greeting"  # it is not cut short
    player.at(4.0)
    assert player.name == "listening"
    assert player.at(6.0)["left"] == pytest.approx(0.35)
    player.play("listening", 7.0)
    assert player.at(7.0)["left"] == pytest.approx(0.35)  # it does not begin again


def test_a_change_of_gestures_has_no_jump():
    player = GesturePlayer()
    player.play("listening", 0.0)
    before = player.at(2.0)
    player.play("goodbye", 2.0)
    assert player.at(2.0) == pytest.approx(before)
    for hundredth in range(1, 500):
        now = player.at(2.0 + hundredth / 100)
        assert all(abs(now[each] - before[each]) <= 2 * FASTEST[each] / 100 for each in CHANNELS)
        before = now


def test_a_step_is_never_longer_than_the_speed_allows():
    assert stepped(0.0, 1.0, 2.0, 0.1) == pytest.approx(0.2)
    assert stepped(0.0, -1.0, 2.0, 0.1) == pytest.approx(-0.2)
    assert stepped(0.0, 0.05, 2.0, 0.1) == pytest.approx(0.05)
    assert stepped(0.3, float("nan"), 2.0, 0.1) == 0.3
    assert stepped(0.3, 1.0, 2.0, -1.0) == 0.3


def test_a_gesture_that_repeats_goes_on_after_its_first_frame():
    idle = GESTURES["idle"]
    assert idle.at(2.5)["z"] == pytest.approx(0.0015, abs=0.0005)
    assert idle.at(10.5) == pytest.approx(idle.at(2.5))  # the first frame is at 1.5 s, the last one at 9.5 s
