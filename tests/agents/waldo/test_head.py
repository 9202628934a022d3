import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.waldo.head import CENTRE, Head, Motion, Pose
from socialbot.core.clock import SECOND
from socialbot.core.messages import HeadCommand, JointTrajectory, Message, PersonDetection, PersonDetections
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig

COMMAND, DETECTIONS = "/head/command", "/humans/bodies/detections"


def person(
    bearing: float | None, distance: float | None = 2.0, elevation: float | None = 0.0, track: str = ""
) -> PersonDetection:
    return PersonDetection(
        x=0, y=0, w=1, h=1, score=1.0, track_id=track, distance_m=distance, bearing_rad=bearing, elevation_rad=elevation
    )


class Stage:
    """A head in the inline runner, and the trajectories it sends."""

    def __init__(self, **parameters: object) -> None:
        placement = NodeConfig("head", Head, parameters)
        self.runner = InlineRunner(Graph("test", (placement,), inputs=frozenset({COMMAND, DETECTIONS})))
        self.sent: list[JointTrajectory] = []
        self.runner.tap("/head_controller/joint_trajectory", self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        assert isinstance(message, JointTrajectory)
        self.sent.append(message)

    def see(self, at: float, *persons: PersonDetection, arrives: float | None = None) -> None:
        message = PersonDetections(stamp=round(at * SECOND), frame_id="camera", width=640, height=480, persons=persons)
        self.runner.feed(DETECTIONS, message, time=None if arrives is None else round(arrives * SECOND))

    def order(self, at: float, mode, pan: float = 0.0, tilt: float = 0.0) -> None:
        self.runner.feed(COMMAND, HeadCommand(stamp=round(at * SECOND), mode=mode, pan_rad=pan, tilt_rad=tilt))

    def until(self, seconds: float) -> None:
        self.runner.advance(round(seconds * SECOND))

    @property
    def positions(self) -> list[tuple[float, ...]]:
        return [tuple(round(value, 6) for value in message.positions) for message in self.sent]

    @property
    def times(self) -> list[float]:
        return [message.stamp / SECOND for message in self.sent]


def test_a_trajectory_names_joints_target_and_time_at_the_speed_limit():
    stage = Stage(pan_joint="neck_yaw", tilt_joint="neck_pitch", max_speed_rad_s=0.5)
    stage.order(1.0, "look", 0.8, -0.2)
    (message,) = stage.sent
    assert message.joint_names == ("neck_yaw", "neck_pitch")
    assert message.positions == (0.8, -0.2)
    assert message.velocities == (0.0, 0.0)
    assert message.duration_s == pytest.approx(1.6)
    assert message.stamp == SECOND


def test_a_new_turn_starts_from_where_the_head_is_by_now():
    stage = Stage()
    stage.order(1.0, "look", 1.0)
    stage.order(1.5, "look", -1.0)
    assert stage.sent[-1].duration_s == pytest.approx(1.5)
    stage.order(10.0, "look", 0.0)
    assert stage.sent[-1].duration_s == pytest.approx(1.0)


def test_targets_are_kept_within_the_limits():
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


def test_tracking_turns_to_the_nearest_person_and_unknown_distances_count_as_far():
    stage = Stage()
    stage.see(1.0, person(0.9, None), person(-0.4, 3.0, 0.1), person(0.2, 5.0), person(None, 0.5))
    assert stage.positions == [(-0.4, 0.1)]


def test_a_distance_that_is_no_number_counts_as_far():
    stage = Stage()
    stage.see(1.0, person(0.4, math.nan), person(0.2, 3.0))
    assert stage.positions == [(0.2, 0.0)]


def test_of_people_at_unknown_distances_the_one_straight_ahead_is_chosen():
    stage = Stage()
    stage.see(1.0, person(-0.9, None), person(0.2, None), person(0.4, math.nan))
    assert stage.positions == [(0.2, 0.0)]


def test_an_unknown_elevation_leaves_the_tilt():
    stage = Stage()
    stage.order(0.5, "look", 0.0, 0.3)
    stage.order(2.0, "track")
    stage.see(2.0, person(0.5, elevation=None))
    assert stage.positions[-1] == (0.5, 0.3)


def test_a_standing_person_causes_no_stream_of_commands():
    stage = Stage()
    for frame in range(100):
        stage.see(1.0 + frame / 30, person(0.5 + 0.014 * math.sin(frame), elevation=0.014 * math.cos(frame)))
    assert len(stage.sent) == 1
    stage.see(5.0, person(0.56))
    assert len(stage.sent) == 2


def test_a_walking_person_is_followed_with_one_command_a_period():
    stage = Stage()
    for frame in range(91):
        stage.see(1.0 + frame / 30, person(-0.6 + 0.4 * frame / 30))
    gaps = [later - earlier for earlier, later in zip(stage.times, stage.times[1:], strict=False)]
    assert min(gaps) >= 0.1 - 1e-9
    assert 15 < len(stage.sent) <= 31
    stage.until(5.0)
    assert stage.positions[-1][0] == pytest.approx(0.6, abs=0.031)


def test_an_order_within_the_period_is_carried_out_when_it_is_over():
    stage = Stage()
    stage.order(1.0, "look", 0.5)
    stage.order(1.02, "look", 0.6)
    stage.order(1.04, "look", 0.7)
    stage.until(2.0)
    assert stage.positions == [(0.5, 0.0), (0.7, 0.0)]
    assert stage.times == [1.0, 1.1]


def test_somebody_slightly_nearer_does_not_take_over_but_somebody_much_nearer_does():
    stage = Stage()
    stage.see(1.0, person(0.5, 2.0))
    stage.see(2.0, person(0.5, 2.0), person(-0.5, 1.6))
    assert stage.positions == [(0.5, 0.0)]
    stage.see(3.0, person(0.55, 2.0), person(-0.5, 1.4))
    assert stage.positions[-1] == (-0.5, 0.0)
    stage.see(4.0, person(0.55, 1.3), person(-0.5, 1.4))
    assert stage.positions[-1] == (-0.5, 0.0)


def test_a_person_of_unknown_distance_is_kept_until_one_of_known_distance_comes():
    stage = Stage()
    stage.see(1.0, person(0.5, None))
    stage.see(2.0, person(0.5, None), person(-0.1, None))
    assert stage.positions == [(0.5, 0.0)]
    stage.see(3.0, person(0.5, None), person(-0.1, 9.0))
    assert stage.positions[-1] == (-0.1, 0.0)


def test_when_the_followed_person_is_gone_the_nearest_of_the_others_is_next():
    stage = Stage()
    stage.see(1.0, person(0.8, 1.0), person(0.0, 3.0), person(-0.8, 2.5))
    stage.see(2.0, person(0.0, 3.0), person(-0.8, 2.5))
    assert stage.positions == [(0.8, 0.0), (-0.8, 0.0)]


def test_a_track_is_followed_past_somebody_else():
    stage = Stage()
    stage.see(1.0, person(0.3, 3.0, track="t1"), person(0.9, 3.2, track="t2"))
    stage.see(2.0, person(0.6, 3.0, track="t1"), person(0.3, 3.2, track="t2"))
    stage.see(3.0, person(0.9, 3.0, track="t1"), person(0.6, 3.2, track="t2"))
    assert stage.positions == [(0.3, 0.0), (0.6, 0.0), (0.9, 0.0)]


def test_a_track_is_followed_however_far_it_went_unseen():
    stage = Stage(same_person_rad=0.2)
    stage.see(1.0, person(-0.5, 3.0, track="t1"), person(0.0, 3.2, track="t2"))
    stage.see(1.5, person(0.0, 3.2, track="t2"), person(0.7, 3.0, track="t1"))
    assert stage.positions[-1] == (0.7, 0.0)


def test_who_is_much_nearer_takes_over_from_a_track():
    stage = Stage()
    stage.see(1.0, person(0.3, 3.0, track="t1"))
    stage.see(2.0, person(0.3, 3.0, track="t1"), person(-0.3, 2.6, track="t2"))
    stage.see(3.0, person(0.3, 3.0, track="t1"), person(-0.3, 2.4, track="t2"))
    assert stage.positions == [(0.3, 0.0), (-0.3, 0.0)]


def test_a_track_that_got_a_new_id_is_known_by_its_direction():
    stage = Stage()
    stage.see(1.0, person(0.3, 3.0, track="t1"))
    stage.see(2.0, person(0.35, 3.0, track="t3"), person(-0.3, 2.8, track="t2"))
    assert stage.positions == [(0.3, 0.0), (0.35, 0.0)]


@pytest.mark.parametrize("frames", [True, False], ids=["empty frames", "no frames"])
def test_with_nobody_there_the_head_holds_and_then_centres(frames):
    stage = Stage()
    stage.see(1.0, person(0.5))
    stage.see(2.9, person(0.5))
    if frames:
        for frame in range(90):
            stage.see(3.0 + frame / 30)
    else:
        stage.until(6.0)
    assert stage.positions == [(0.5, 0.0), (0.0, 0.0)]
    assert stage.times[-1] == pytest.approx(4.9)


def test_somebody_who_comes_back_in_time_keeps_the_head():
    stage = Stage()
    for second in (1.0, 2.9, 4.8, 6.7):
        stage.see(second, person(0.5))
    assert stage.positions == [(0.5, 0.0)]
    stage.until(20.0)
    assert stage.times[1:] == [pytest.approx(8.7)]


def test_after_centring_the_nearest_is_chosen_afresh():
    stage = Stage()
    stage.see(1.0, person(0.5, 2.0))
    stage.see(10.0, person(0.5, 2.0), person(-0.5, 1.9))
    assert stage.positions == [(0.5, 0.0), (0.0, 0.0), (-0.5, 0.0)]


def test_told_to_track_again_the_nearest_is_chosen_afresh():
    stage = Stage()
    stage.see(1.0, person(0.5, 2.0))
    stage.order(2.0, "track")
    stage.see(3.0, person(0.5, 2.0), person(-0.5, 1.9))
    assert stage.positions == [(0.5, 0.0), (-0.5, 0.0)]


def test_centre_and_look_ignore_people_until_told_to_track():
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


def test_told_to_track_with_nobody_there_the_head_holds_and_then_centres():
    stage = Stage()
    stage.order(1.0, "look", 0.7)
    stage.order(5.0, "track")
    stage.until(20.0)
    assert stage.positions == [(0.7, 0.0), (0.0, 0.0)]
    assert stage.times[-1] == pytest.approx(7.0)


def test_looking_somewhere_is_not_undone_by_the_wait_for_people():
    stage = Stage()
    stage.see(1.0, person(0.5))
    stage.order(2.0, "look", -0.9)
    stage.until(20.0)
    assert stage.positions == [(0.5, 0.0), (-0.9, 0.0)]


def test_bearings_of_a_camera_on_the_head_are_added_to_the_pose_at_the_frame():
    stage = Stage(camera_on_head=True)
    stage.see(1.0, person(0.6, elevation=0.2))
    # The head has turned half the way: a person who stands still at 0.6 is now seen at 0.3.
    stage.see(1.3, person(0.3, elevation=0.1), arrives=1.9)
    stage.see(3.0, person(0.0, elevation=0.0))
    assert stage.positions == [(0.6, 0.2)]
    stage.see(4.0, person(-0.2, elevation=0.1))
    assert stage.positions[-1] == (0.4, 0.3)


def test_a_camera_on_the_head_settles_on_a_standing_person_whatever_the_delay():
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
def test_limits_and_speed_are_kept_whatever_comes(steps, on_head, speed):
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
