"""The attentive head on the simulated one: overshoot, settling and jitter, search, glances and speakers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

pytest.importorskip("mujoco")

from socialbot.agents.waldo.encounters import View
from socialbot.agents.waldo.head import Gaze, Head, Pose, Seen
from socialbot.core.clock import SECOND
from socialbot.core.messages import JointTrajectory, Message, PersonDetection, PersonDetections
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.robots.simulation.node import SimulatedHead

PERIOD_S = 0.1
PARAMETERS = {"camera_on_head": True, "attentive": True, "ease_s": 0.5, "dead_band_rad": 0.05}


def followed(bearings: Sequence[Mapping[str, float]], *, noise_rad: float = 0.008) -> np.ndarray:
    """Let the head follow people, by their directions in each image; return its pan every 20 ms."""
    rng = np.random.default_rng(0)
    topics = ("/humans/bodies/detections", "/humans/voices/speech")
    runner = InlineRunner(
        Graph("head", (NodeConfig("head", Head, PARAMETERS),), inputs=frozenset((*topics, "/head/command")))
    )
    servo, pans = SimulatedHead(), []

    def command(topic: str, message: Message) -> None:
        assert isinstance(message, JointTrajectory)
        servo.command(message, runner.clock.now())

    runner.tap("/head_controller/joint_trajectory", command)
    runner.start()
    for number, people in enumerate(bearings):
        stamp = round(number * PERIOD_S * SECOND)
        runner.advance(stamp)
        servo.advance(stamp)
        persons = tuple(
            PersonDetection(
                x=0, y=0, w=9, h=9, score=0.9, track_id=name, distance_m=2.0, facing_rad=0.1, elevation_rad=0.0,
                bearing_rad=direction - servo.pan_rad + rng.normal(0, noise_rad),
            )
            for name, direction in people.items()
            if abs(direction - servo.pan_rad) < 0.545
        )  # fmt: skip
        detections = PersonDetections(
            stamp=stamp, frame_id="camera", width=640, height=480, persons=persons,
            camera_yaw_rad=servo.pan_rad, camera_hfov_rad=1.09,
        )  # fmt: skip
        runner.feed(topics[0], detections)
        for step in range(1, 6):
            servo.advance(stamp + step * SECOND // 50)
            pans.append(servo.pan_rad)
    runner.close()
    return np.array(pans)


def test_a_step_is_followed_without_overshoot_and_settles():
    pans = followed([{"a": 0.0}] * 20 + [{"a": 0.45}] * 40, noise_rad=0.0)
    after = pans[100:]
    settled = np.flatnonzero(np.abs(after - 0.45) > 0.06)[-1] * 0.02
    assert after.max() < 0.45 * 1.12
    assert settled < 1.6
    assert after[-1] == pytest.approx(0.45, abs=0.06)


def test_the_head_is_still_before_a_person_who_stands():
    pans = followed([{"a": 0.3}] * 100)[150:]
    assert pans.std() < 0.015
    assert np.abs(np.diff(pans)).max() < 0.01


def test_a_walker_stays_in_the_middle_of_the_picture():
    ways = [0.5 * math.sin(0.5 * number * PERIOD_S) for number in range(120)]
    pans = followed([{"a": way} for way in ways])[::5]
    errors = np.abs(np.array(ways) - pans)[20:]
    assert np.quantile(errors, 0.9) < 0.15
    jerk = np.diff(pans, 3) / PERIOD_S**3
    assert np.sqrt(np.mean(jerk**2)) < 20


def test_a_person_who_left_the_picture_is_found_again():
    away = [{"a": 0.05 * number} for number in range(12)]
    pans = followed([*away, *[{"a": 0.95}] * 60])
    assert pans[-1] == pytest.approx(0.95, abs=0.1)


def seen(name: str, pan: float, *, attentive: bool | None, distance_m: float = 3.0) -> Seen:
    return Seen(distance_m, Pose(pan, 0.0), name, attentive)


def test_people_who_attend_go_first_and_others_get_a_glance():
    gaze = Gaze()
    passer = seen("p", 0.4, attentive=False, distance_m=2.5)
    assert gaze.look([passer], 0.0) == Pose(0.4, 0.0)
    assert gaze.look([passer, seen("v", -0.3, attentive=True)], 0.2) == Pose(-0.3, 0.0)
    alone = Gaze()
    looks = [alone.look([passer], 0.1 * step) for step in range(90)]
    at_passer = [look is not None and abs(look.pan - 0.4) < 0.01 for look in looks]
    assert all(at_passer[:14])
    assert not any(at_passer[50:])


def test_the_head_looks_at_who_speaks():
    gaze = Gaze()
    both = [seen("near", 0.3, attentive=True, distance_m=1.5), seen("far", -0.3, attentive=None, distance_m=4.0)]
    assert gaze.look(both, 0.0) == Pose(0.3, 0.0)
    gaze.hear("far", 0.1)
    assert gaze.look(both, 0.2) == Pose(-0.3, 0.0)
    assert gaze.look(both, 9.0) == Pose(0.3, 0.0)


def beside(last: float) -> list[dict[str, float]]:
    """Return the directions of a person who stands, and of one who comes from ahead and stops beside."""
    ways = np.linspace(0.0, last, 30)
    return [{"a": -0.3}] * 10 + [{"a": -0.3, "b": float(way)} for way in (*ways, *[last] * 60)]


def test_attentive_people_stay_in_view_while_the_nearest_is_looked_at():
    pans = followed(beside(0.5))[-150:]
    assert (0.5 - pans).max() < 0.545
    assert (pans + 0.3).max() < 0.545


def test_attentive_people_who_do_not_fit_into_the_view_are_looked_at_in_turn():
    pans = followed(beside(0.9))[-300:]
    assert pans.min() < -0.3 + 0.545
    assert pans.max() > 0.9 - 0.545


def test_the_head_does_not_wait_where_a_passer_by_was_lost():
    gaze, view = Gaze(), View(0.0, 0.545)
    assert gaze.look([seen("p", 0.5, attentive=False)], 0.0, view) == Pose(0.5, 0.0)
    assert gaze.look([], 0.2, view) == Pose(0.0, 0.0)
    assert gaze.look([seen("v", 0.5, attentive=True)], 0.4, view) == Pose(0.5, 0.0)
    assert gaze.look([], 0.6, view) == Pose(0.5, 0.0)


HALF_RAD = 0.545


def empty(gaze: Gaze, at_s: float, view: View) -> float | None:
    """Return where the head looks while nobody is seen; None if it keeps its direction."""
    pose = gaze.look([], at_s, view)
    return None if pose is None else pose.pan


def test_a_person_who_walks_out_of_view_is_expected_a_little_farther_on_and_forgotten_after_some_time():
    gaze, view = Gaze(), View(0.0, HALF_RAD)
    for step in range(11):
        gaze.look([seen("v", 0.05 * step, attentive=True)], 0.1 * step, view)
    expected = [empty(gaze, at_s, view) for at_s in (2.6, 4.0, 6.9)]
    assert expected[0] is not None
    assert 0.6 < expected[0] < 1.2
    assert expected == [expected[0]] * 3
    assert empty(gaze, 7.1, view) == 0.0


def test_a_person_who_turns_away_is_not_waited_for():
    gaze, aside = Gaze(), View(-0.5, HALF_RAD)
    for step, attentive in enumerate((True, False)):
        gaze.look([seen("v", 0.4, attentive=attentive)], 0.1 * step, View(0.0, HALF_RAD))
    assert empty(gaze, 3.0, aside) == 0.0


def test_a_person_who_is_not_where_the_view_should_show_them_is_not_waited_for():
    gaze, ahead, aside = Gaze(), View(0.0, HALF_RAD), View(-0.5, HALF_RAD)
    gaze.look([seen("v", 0.4, attentive=True)], 0.0, ahead)
    gaze.look([], 1.1, ahead)
    assert empty(gaze, 3.0, aside) == 0.0
    gaze.look([seen("v", 0.4, attentive=True)], 4.0, ahead)
    gaze.look([], 4.9, ahead)
    assert empty(gaze, 7.0, aside) == 0.4


def test_the_person_who_has_been_out_of_view_for_the_longest_time_comes_first():
    gaze = Gaze()
    gaze.look([seen("a", 0.9, attentive=True)], 0.0, View(0.6, HALF_RAD))
    gaze.look([seen("b", -0.9, attentive=True)], 1.0, View(-0.6, HALF_RAD))
    assert empty(gaze, 3.5, View(0.0, HALF_RAD)) == 0.9


def test_the_nearest_people_are_kept_in_view_if_not_all_fit():
    gaze, view = Gaze(), View(0.0, HALF_RAD)
    people = [
        seen("middle", 0.0, attentive=True, distance_m=1.5),
        seen("near", 0.4, attentive=True, distance_m=2.5),
        seen("far", -0.5, attentive=True, distance_m=4.0),
    ]
    pose = gaze.look(people, 0.0, view)
    assert pose is not None
    assert View(pose.pan, HALF_RAD + 0.01).shows(0.4)


def test_a_glance_at_a_passer_by_does_not_show_the_group():
    gaze, view = Gaze(), View(0.0, HALF_RAD)
    gaze.look([seen("v", -0.3, attentive=True)], 0.0, view)
    assert gaze.look([seen("p", 0.4, attentive=False)], 0.1, view) == Pose(0.4, 0.0)


def test_a_view_that_is_hardly_wider_than_its_edges_shows_the_chosen_person():
    people = [seen("a", 0.0, attentive=True), seen("b", 0.2, attentive=True, distance_m=4.0)]
    assert Gaze().look(people, 0.0, View(0.0, 0.05)) == Pose(0.0, 0.0)
