import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from socialbot.agents.waldo.head import CENTRE, Head, Motion, Pose
from socialbot.core.clock import SECOND
from socialbot.core.messages import (
    HeadCommand,
    JointTrajectory,
    PersonDetection,
    PersonDetections,
    VoiceActivity,
)
from socialbot.graph.node import Graph, NodeConfig
from tests.inline import InlineRun

COMMAND, DETECTIONS, VOICES = "/head/command", "/humans/bodies/detections", "/humans/voices/activity"


def person(
    bearing: float | None, distance: float | None = 2.0, elevation: float | None = 0.0, track: str = ""
) -> PersonDetection:
    return PersonDetection(
        x=0, y=0, w=1, h=1, score=1.0, track_id=track, distance_m=distance, bearing_rad=bearing, elevation_rad=elevation
    )


class Stage(InlineRun):
    """A head in the inline runner, and the trajectories it sends."""

    def __init__(self, **parameters: object) -> None:
        graph = Graph("test", (NodeConfig("head", Head, parameters),), inputs=frozenset({COMMAND, DETECTIONS, VOICES}))
        super().__init__(graph)

    @property
    def sent(self) -> list[JointTrajectory]:
        return self.of(JointTrajectory)

    def see(self, at: float, *persons: PersonDetection, arrives: float | None = None) -> None:
        message = PersonDetections(stamp=round(at * SECOND), frame_id="camera", width=640, height=480, persons=persons)
        self.runner.feed(DETECTIONS, message, time=None if arrives is None else round(arrives * SECOND))

    def order(self, at: float, mode, pan: float = 0.0, tilt: float = 0.0) -> None:
        self.runner.feed(COMMAND, HeadCommand(stamp=round(at * SECOND), mode=mode, pan_rad=pan, tilt_rad=tilt))

    def hear(self, at: float, active: bool = True, track: str = "", bearing: float | None = None) -> None:
        voice = VoiceActivity(stamp=round(at * SECOND), active=active, voice="v", person=track, bearing_rad=bearing)
        self.runner.feed(VOICES, voice)

    @property
    def positions(self) -> list[tuple[float, ...]]:
        return [tuple(round(value, 6) for value in message.positions) for message in self.sent]

    @property
    def stamps_s(self) -> list[float]:
        return [message.stamp / SECOND for message in self.sent]


def test_trajectory_has_joints_target_and_duration():
    stage = Stage(pan_joint="neck_yaw", tilt_joint="neck_pitch", max_speed_rad_s=0.5)
    stage.order(1.0, "look", 0.8, -0.2)
    (message,) = stage.sent
    assert message.joint_names == ("neck_yaw", "neck_pitch")
    assert message.positions == (0.8, -0.2)
    assert message.velocities == (0.0, 0.0)
    assert message.duration_s == pytest.approx(1.6)
    assert message.stamp == SECOND


def test_new_motion_starts_from_the_present_pose():
    stage = Stage()
    stage.order(1.0, "look", 1.0)
    stage.order(1.5, "look", -1.0)
    assert stage.sent[-1].duration_s == pytest.approx(1.5)
    stage.order(10.0, "look", 0.0)
    assert stage.sent[-1].duration_s == pytest.approx(1.0)


def test_targets_stay_within_limits():
    stage = Stage()
    stage.order(1.0, "look", 9.0, -9.0)
    stage.order(2.0, "look", -9.0, 9.0)
    assert stage.positions == [(1.2, -0.5), (-1.2, 0.5)]
    stage.order(9.0, "look", math.nan, 0.0)
    assert len(stage.sent) == 2


def test_narrower_limits_turn_the_head_back():
    stage = Stage()
    stage.order(1.0, "look", 1.0)
    stage.until(5.0)
    stage.runner.nodes["head"].set_parameter("pan_limit_rad", 0.5)
    stage.until(6.0)
    assert stage.positions[-1] == (0.5, 0.0)


NEAREST = {
    "nearest; unknown distances are far, unknown bearings ignored": (
        [person(0.9, None), person(-0.4, 3.0, 0.1), person(0.2, 5.0), person(None, 0.5)], (-0.4, 0.1),
    ),
    "tentative detections do not count": (
        [replace(person(0.9, 0.5), tentative=True), person(0.2, 5.0)], (0.2, 0.0),
    ),
    "NaN is far": ([person(0.4, math.nan), person(0.2, 3.0)], (0.2, 0.0)),
    "straight ahead if all distances are unknown": (
        [person(-0.9, None), person(0.2, None), person(0.4, math.nan)], (0.2, 0.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("persons", "pose"), NEAREST.values(), ids=list(NEAREST))
def test_turns_to_the_nearest_person(persons, pose):
    stage = Stage()
    stage.see(1.0, *persons)
    assert stage.positions == [pose]


def test_unknown_elevation_keeps_tilt():
    stage = Stage()
    stage.order(0.5, "look", 0.0, 0.3)
    stage.order(2.0, "track")
    stage.see(2.0, person(0.5, elevation=None))
    assert stage.positions[-1] == (0.5, 0.3)


def test_standing_person_causes_one_command():
    stage = Stage()
    for frame in range(100):
        stage.see(1.0 + frame / 30, person(0.5 + 0.014 * math.sin(frame), elevation=0.014 * math.cos(frame)))
    assert len(stage.sent) == 1
    stage.see(5.0, person(0.56))
    assert len(stage.sent) == 2


def test_walking_person_causes_one_command_per_period():
    stage = Stage()
    for frame in range(91):
        stage.see(1.0 + frame / 30, person(-0.6 + 0.4 * frame / 30))
    gaps = [later - earlier for earlier, later in zip(stage.stamps_s, stage.stamps_s[1:], strict=False)]
    assert min(gaps) >= 0.1 - 1e-9
    assert 15 < len(stage.sent) <= 31
    stage.until(5.0)
    assert stage.positions[-1][0] == pytest.approx(0.6, abs=0.031)


def test_command_within_a_period_is_delayed():
    stage = Stage()
    stage.order(1.0, "look", 0.5)
    stage.order(1.02, "look", 0.6)
    stage.order(1.04, "look", 0.7)
    stage.until(2.0)
    assert stage.positions == [(0.5, 0.0), (0.7, 0.0)]
    assert stage.stamps_s == [1.0, 1.1]


FOLLOWED = {
    "much nearer person takes over": (
        [
            [person(0.5, 2.0)],
            [person(0.5, 2.0), person(-0.5, 1.6)],
            [person(0.55, 2.0), person(-0.5, 1.4)],
            [person(0.55, 1.3), person(-0.5, 1.4)],
        ],
        [0.5, -0.5],
    ),
    "known distance takes over from unknown": (
        [[person(0.5, None)], [person(0.5, None), person(-0.1, None)], [person(0.5, None), person(-0.1, 9.0)]],
        [0.5, -0.1],
    ),
    "nearest of the others if the person is gone": (
        [[person(0.8, 1.0), person(0.0, 3.0), person(-0.8, 2.5)], [person(0.0, 3.0), person(-0.8, 2.5)]],
        [0.8, -0.8],
    ),
    "track passes another person": (
        [
            [person(0.3, 3.0, track="t1"), person(0.9, 3.2, track="t2")],
            [person(0.6, 3.0, track="t1"), person(0.3, 3.2, track="t2")],
            [person(0.9, 3.0, track="t1"), person(0.6, 3.2, track="t2")],
        ],
        [0.3, 0.6, 0.9],
    ),
    "track moves far between two frames": (
        [
            [person(-0.5, 3.0, track="t1"), person(0.0, 3.2, track="t2")],
            [person(0.0, 3.2, track="t2"), person(0.7, 3.0, track="t1")],
        ],
        [-0.5, 0.7],
    ),
    "much nearer person takes over from a track": (
        [
            [person(0.3, 3.0, track="t1")],
            [person(0.3, 3.0, track="t1"), person(-0.3, 2.6, track="t2")],
            [person(0.3, 3.0, track="t1"), person(-0.3, 2.4, track="t2")],
        ],
        [0.3, -0.3],
    ),
    "new track id in the same direction": (
        [[person(0.3, 3.0, track="t1")], [person(0.35, 3.0, track="t3"), person(-0.3, 2.8, track="t2")]],
        [0.3, 0.35],
    ),
}


@pytest.mark.parametrize(("frames", "pans"), FOLLOWED.values(), ids=list(FOLLOWED))
def test_follows_one_person(frames, pans):
    stage = Stage()
    for second, persons in enumerate(frames, 1):
        stage.see(second, *persons)
    assert stage.positions == [(pan, 0.0) for pan in pans]


@pytest.mark.parametrize("frames", [True, False], ids=["empty frames", "no frames"])
def test_head_centres_after_hold_time_without_people(frames):
    stage = Stage()
    stage.see(1.0, person(0.5))
    stage.see(2.9, person(0.5))
    if frames:
        for frame in range(90):
            stage.see(3.0 + frame / 30)
    else:
        stage.until(6.0)
    assert stage.positions == [(0.5, 0.0), (0.0, 0.0)]
    assert stage.stamps_s[-1] == pytest.approx(4.9)


def test_person_who_returns_in_time_is_still_followed():
    stage = Stage()
    for second in (1.0, 2.9, 4.8, 6.7):
        stage.see(second, person(0.5))
    assert stage.positions == [(0.5, 0.0)]
    stage.until(20.0)
    assert stage.stamps_s[1:] == [pytest.approx(8.7)]


@pytest.mark.parametrize("command", ["", "track"])
def test_selects_the_nearest_person_after_centring_or_a_track_command(command):
    stage = Stage()
    stage.see(1.0, person(0.5, 2.0))
    if command:
        stage.order(2.0, command)
    stage.see(3.0 if command else 10.0, person(0.5, 2.0), person(-0.5, 1.9))
    assert stage.positions == [(0.5, 0.0), *([] if command else [(0.0, 0.0)]), (-0.5, 0.0)]


def test_centre_and_look_ignore_people():
    stage = Stage()
    stage.order(1.0, "look", 0.7, 0.2)
    stage.see(2.0, person(-0.5))
    stage.order(3.0, "centre")
    stage.see(4.0, person(-0.5))
    stage.until(9.0)
    assert stage.positions == [(0.7, 0.2), (0.0, 0.0)]
    stage.order(10.0, "track")
    stage.see(10.5, person(-0.5))
    assert stage.positions[-1] == (-0.5, 0.0)


def test_track_command_without_people_centres_after_hold_time():
    stage = Stage()
    stage.order(1.0, "look", 0.7)
    stage.order(5.0, "track")
    stage.until(20.0)
    assert stage.positions == [(0.7, 0.0), (0.0, 0.0)]
    assert stage.stamps_s[-1] == pytest.approx(7.0)


def test_look_command_cancels_centring():
    stage = Stage()
    stage.see(1.0, person(0.5))
    stage.order(2.0, "look", -0.9)
    stage.until(20.0)
    assert stage.positions == [(0.5, 0.0), (-0.9, 0.0)]


def test_bearings_of_a_head_camera_are_relative_to_the_pose_at_the_frame():
    stage = Stage(camera_on_head=True)
    stage.see(1.0, person(0.6, elevation=0.2))
    # The head has turned half the way: a person who stands still at 0.6 is now seen at 0.3.
    stage.see(1.3, person(0.3, elevation=0.1), arrives=1.9)
    stage.see(3.0, person(0.0, elevation=0.0))
    assert stage.positions == [(0.6, 0.2)]
    stage.see(4.0, person(-0.2, elevation=0.1))
    assert stage.positions[-1] == (0.4, 0.3)


def test_head_camera_settles_on_a_standing_person():
    stage = Stage(camera_on_head=True)
    pose = Motion(CENTRE, CENTRE, 0, 1.0)
    for frame in range(60):
        stamp = 1.0 + frame / 10
        for message in stage.sent:
            if pose.begin < message.stamp <= stamp * SECOND:
                start = pose.at(message.stamp)
                pose = Motion(start, Pose(*message.positions), message.stamp, message.duration_s)
        bearing = 1.0 - pose.at(round(stamp * SECOND)).pan
        stage.see(stamp, person(bearing), arrives=stamp + 0.09)
    assert stage.positions == [(1.0, 0.0)]


angle = st.floats(-4, 4) | st.sampled_from([math.inf, -math.inf, math.nan])
people = st.builds(person, st.none() | angle, st.none() | st.floats(0, 20) | st.just(math.nan), st.none() | angle)
happening = st.one_of(
    st.lists(people, max_size=4),
    st.tuples(st.sampled_from(["track", "centre", "look"]), angle, angle),
)
steps = st.lists(st.tuples(st.floats(0, 3) | st.floats(0, 0.2), happening), max_size=40)


@settings(max_examples=150, deadline=None)
@given(steps=steps, on_head=st.booleans(), speed=st.floats(0.05, 5))
def test_any_input_keeps_limits_and_speed(steps, on_head, speed):
    stage = Stage(camera_on_head=on_head, max_speed_rad_s=speed)
    now = 0.0
    for wait, what in steps:
        now += wait
        if isinstance(what, list):
            stage.see(now, *what)
        else:
            stage.order(now, *what)
    stage.until(now + 5.0)
    assert stage.runner.faults["head"].failures == 0
    check_motion(stage.sent, speed)


def check_motion(sent: list[JointTrajectory], speed: float) -> None:
    """Follows the trajectories as a controller would, with a reckoning of its own."""
    pan, tilt, goal, began, duration = 0.0, 0.0, (0.0, 0.0), -1, 1.0
    for message in sent:
        assert began < 0 or message.stamp - began >= 0.1 * SECOND
        done = min((message.stamp - began) / SECOND / duration, 1.0)
        pan, tilt = pan + done * (goal[0] - pan), tilt + done * (goal[1] - tilt)
        goal, began, duration = message.positions, message.stamp, message.duration_s
        assert abs(goal[0]) <= 1.2
        assert abs(goal[1]) <= 0.5
        assert duration > 0
        assert abs(goal[0] - pan) <= speed * duration + 1e-6
        assert abs(goal[1] - tilt) <= speed * duration + 1e-6


def test_turns_to_the_person_who_speaks_and_back_to_the_nearest():
    stage = Stage()
    near, far = person(0.5, 1.0, track="near"), person(-0.4, 3.0, track="far")
    stage.see(1.0, near, far)
    stage.hear(1.5, track="far")
    stage.see(2.0, near, far)
    stage.hear(2.5, active=False)
    stage.see(3.0, near, far)
    stage.see(4.5, near, far)
    assert stage.positions == [(0.5, 0.0), (-0.4, 0.0), (0.5, 0.0)]


def test_unknown_speaker_changes_nothing_while_somebody_is_in_view():
    stage = Stage()
    stage.see(1.0, person(0.5, track="near"))
    stage.hear(1.2)
    stage.hear(1.3, bearing=-1.0)
    stage.see(1.5, person(0.5, track="near"))
    assert stage.positions == [(0.5, 0.0)]


def test_voice_out_of_view_is_looked_for_until_the_hold_time():
    stage = Stage(hold_s=2.0)
    stage.hear(1.0, bearing=-0.9)
    assert stage.positions == [(-0.9, 0.0)]
    stage.until(4.0)
    assert stage.positions == [(-0.9, 0.0), (0.0, 0.0)]


def test_voice_does_not_move_a_head_that_looks_elsewhere():
    stage = Stage()
    stage.order(1.0, "look", 0.3)
    stage.hear(2.0, bearing=-0.9)
    assert stage.positions == [(0.3, 0.0)]


@pytest.mark.parametrize("ahead_s", [-100.0, 100.0])
def test_the_head_stays_on_a_person_whose_camera_has_another_clock(ahead_s):
    stage = Stage(camera_on_head=True)
    stage.see(200.0 + ahead_s, person(0.5), arrives=200.0)
    for step in range(1, 4):
        stage.see(200.0 + step + ahead_s, person(0.0), arrives=200.0 + step)
    assert stage.positions == [(0.5, 0.0)]
