"""Mobile bases, in simulated time: where the robot drives to meet people, to give way and to return."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from socialbot import ActionServer, GoalHandle, Graph, Node, NodeConfig
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import PersonDetection, PersonDetections, TraceRecord, Transform, Transforms
from socialbot.robots.binding import with_robot
from socialbot.robots.navigation import PersonSpot, Pose2D, pose_aside, pose_before
from socialbot.robots.profile import load_profile
from socialbot.testing import GraphTester
from tests.robots.usher import Usher, go_home, meet, yield_to

TIAGO = load_profile("tiago")
NAVIGATE = "nav2_msgs/action/NavigateToPose"


class Navigator(Node):
    """Stands in for Nav2, and arrives after a second."""

    navigate = ActionServer(NAVIGATE, "/navigate_to_pose")
    goals: tuple[tuple[float, float, float], ...] = ()
    frames: tuple[str, ...] = ()
    stamps: tuple[int, ...] = ()

    @navigate
    def on_goal(self, goal: GoalHandle) -> None:
        pose = goal.request.pose.pose
        yaw = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        self.goals += ((pose.position.x, pose.position.y, yaw),)
        self.frames += (goal.request.pose.header.frame_id,)
        self.stamps += (goal.request.pose.header.stamp.sec,)
        for distance_m in (2.0, math.nan, math.inf):
            goal.feedback({"distance_remaining": distance_m})
        self.call_after(1.0, goal.succeed)


@contextmanager
def usher(**parameters: Any) -> Iterator[GraphTester]:
    nodes = (NodeConfig("usher", Usher, parameters), NodeConfig("nav2", Navigator))
    inputs = frozenset({"/tf", "/tf_static", "/humans/bodies/detections"})
    with GraphTester(Graph("usher", nodes, inputs=inputs)) as graph:
        yield graph


def place_robot(
    graph: GraphTester, x: float, y: float, yaw: float, frame: str = "base_link", clock_s: float = 0
) -> None:
    """Say where the robot is in the map, by two transforms as on a robot."""
    now, turn = graph.clock.now() + round(clock_s * SECOND), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    still = (0.0, 0.0, 0.0, 1.0)
    transforms = (
        Transform(stamp=now, parent="map", child="odom", translation=(1.0, 0.0, 0.0), rotation=still),
        Transform(stamp=now, parent="odom", child=frame, translation=(x - 1.0, y, 0.0), rotation=turn),
    )
    graph.runner.feed("/tf", Transforms(stamp=now, transforms=transforms), time=graph.clock.now())


def see(
    graph: GraphTester, distance_m: float, bearing_rad: float, facing_rad: float | None = 0.0, clock_s: float = 0
) -> None:
    person = PersonDetection(
        x=0, y=0, w=9, h=9, score=1.0, track_id="t1",
        distance_m=distance_m, bearing_rad=bearing_rad, facing_rad=facing_rad,
    )  # fmt: skip
    stamp = graph.clock.now() + round(clock_s * SECOND)
    message = PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=(person,))
    graph.runner.feed("/humans/bodies/detections", message, time=graph.clock.now())


def beliefs(graph: GraphTester) -> list[str]:
    return sorted(str(held.belief) for held in graph.node("usher").engine.beliefs)


def last_message(graph: GraphTester) -> str:
    ends = [
        each for each in graph.messages("/agent/trace") if isinstance(each, TraceRecord) and each.kind == "action_end"
    ]
    return str(ends[-1].detail.get("message", ""))


def test_a_person_is_approached_to_the_social_distance_and_faced():
    with usher() as graph:
        place_robot(graph, 2.0, 1.0, math.pi / 2)
        see(graph, 4.0, 0.0)  # 4 m ahead: at (2, 5)
        graph.node("usher").engine.achieve(meet("t1"))
        graph.run(0.5)
        assert "distance_left(2.0)" in beliefs(graph)
        graph.run(1.0)
        assert 'met("t1")' in beliefs(graph)
        nav2 = graph.node("nav2")
        assert nav2.goals[0] == pytest.approx((2.0, 3.8, math.pi / 2))
        assert nav2.frames == ("map",)


@pytest.mark.parametrize("clock_s", [-100.0, 100.0])
def test_a_robot_and_a_camera_with_another_clock_approach_people(clock_s):
    with usher() as graph:
        graph.run(200.0)
        for x in (0.0, 2.0):
            place_robot(graph, x, 1.0, math.pi / 2, clock_s=clock_s)
            graph.run(0.5)
        see(graph, 4.0, 0.0, clock_s=clock_s)
        graph.node("usher").engine.achieve(meet("t1"))
        graph.run(1.5)
        nav2 = graph.node("nav2")
        assert nav2.goals[0] == pytest.approx((2.0, 3.8, math.pi / 2))
        assert nav2.stamps == (0,)  # Nav2 takes the newest transforms


def test_a_robot_whose_transforms_have_stopped_does_not_drive():
    with usher() as graph:
        place_robot(graph, 2.0, 1.0, 0.0)
        graph.run(3.0)
        see(graph, 4.0, 0.0)
        graph.node("usher").engine.achieve(meet("t1"))
        graph.run(0.5)
        assert graph.node("nav2").goals == ()
        assert last_message(graph) == "no transform from map to base_link for 3.0 s"


def test_home_is_where_the_parameter_says():
    with usher(home="1 -2 1.5") as graph:
        graph.node("usher").engine.achieve(go_home())
        graph.run(2.0)
        assert graph.node("nav2").goals == (pytest.approx((1.0, -2.0, 1.5)),)
        assert beliefs(graph)[-1] == 'met("home")'


def test_the_robot_leaves_the_way_of_a_person():
    with usher() as graph:
        place_robot(graph, 0.0, 0.0, 0.0)
        see(graph, 3.0, 0.0)
        graph.node("usher").engine.achieve(yield_to("t1"))
        graph.run(2.0)
        (goal,) = graph.node("nav2").goals
    assert abs(goal[1]) == pytest.approx(1.0)
    assert goal[0] == pytest.approx(0.0)


@pytest.mark.parametrize("aside_m", [0.02, 0.0, -0.02])
def test_a_robot_right_ahead_of_a_person_steps_to_their_right(aside_m):
    person = PersonSpot(3.0, 0.0, math.pi, 0)  # faces the robot, to -x: +y is to their right
    assert pose_aside(Pose2D(0.0, aside_m, 0.0), person, 1.0).y == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("prepare", "why", "text"),
    [
        (lambda graph: None, "no_pose", "no transform from map to base_link"),
        (lambda graph: place_robot(graph, 0.0, 0.0, 0.0), "not_seen", "t1 was not seen in the last 2 s"),
    ],
)
def test_without_a_pose_or_a_person_no_goal_is_sent(prepare, why, text):
    with usher() as graph:
        prepare(graph)
        graph.node("usher").engine.achieve(meet("t1"))
        graph.run(2.0)
        assert f'failed("{why}")' in beliefs(graph)
        assert text in last_message(graph)
        assert graph.node("nav2").goals == ()


def test_a_person_seen_long_ago_is_not_approached():
    with usher() as graph:
        place_robot(graph, 0.0, 0.0, 0.0)
        see(graph, 3.0, 0.0)
        graph.run(3.0)
        graph.node("usher").engine.achieve(meet("t1"))
        graph.run(1.0)
        assert 'failed("not_seen")' in beliefs(graph)


def test_no_goal_outside_of_the_area_is_sent():
    with usher(area="-1 -1 1 1", home="5 0 0") as graph:
        graph.node("usher").engine.achieve(go_home())
        graph.run(1.0)
        assert 'failed("outside")' in beliefs(graph)
        assert graph.node("nav2").goals == ()


@pytest.mark.parametrize(
    ("parameters", "what"),
    [
        ({"home": "1 2"}, "'1 2' is not 3 numbers"),
        ({"home": "1 2 nan"}, "not 3 numbers"),
        ({"area": "0 0 1"}, "not 4 numbers"),
        ({"area": "1 0 0 1"}, "is empty"),
        ({"social_m": 0.2}, "out of range"),
    ],
)
def test_wrong_places_are_refused(parameters, what):
    with pytest.raises(ParameterError, match=what), usher(**parameters):
        pass


class TestPlaces:
    @pytest.mark.parametrize("facing", [None, *(math.pi * eighth / 8 for eighth in range(-8, 9))])
    @pytest.mark.parametrize("robot", [Pose2D(4.0, 0.0, math.pi), Pose2D(-3.0, 2.0, 0.0), Pose2D(0.5, 0.0, 0.0)])
    def test_a_person_is_met_in_view_at_the_distance_and_faced(self, robot, facing):
        person = PersonSpot(0.0, 0.0, facing, 0)
        pose = pose_before(robot, person, 1.2)
        assert math.hypot(pose.x, pose.y) == pytest.approx(1.2)
        assert math.remainder(pose.yaw - math.atan2(-pose.y, -pose.x), 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
        if facing is not None:
            seen_at = math.remainder(math.atan2(pose.y, pose.x) - facing, 2 * math.pi)
            assert abs(seen_at) <= math.pi / 3 + 1e-9
        else:
            assert math.atan2(pose.y, pose.x) == pytest.approx(math.atan2(robot.y, robot.x))

    @pytest.mark.parametrize("facing", [None, *(math.pi * eighth / 8 for eighth in range(-8, 9))])
    @pytest.mark.parametrize("robot", [Pose2D(3.0, 0.0, 0.0), Pose2D(2.0, 0.6, 0.0), Pose2D(2.0, -0.6, 0.0)])
    def test_giving_way_leaves_the_clearance_and_never_crosses_the_way(self, robot, facing):
        person = PersonSpot(0.0, 0.0, facing, 0)
        pose = pose_aside(robot, person, 1.0)
        way = facing if facing is not None else math.atan2(robot.y, robot.x)
        across = [-math.sin(way) * each.x + math.cos(way) * each.y for each in (robot, pose)]
        assert abs(across[1]) >= 1.0 - 1e-9 or abs(across[1]) >= abs(across[0]) - 1e-9
        assert across[0] * across[1] >= 0.0 or abs(across[0]) <= 0.05
        assert math.hypot(pose.x - robot.x, pose.y - robot.y) <= 1.0 + 0.05 + 1e-9


def test_the_agent_of_the_howto_meets_a_visitor_and_returns(monkeypatch, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "howto" / "robots.md").read_text("utf-8")
    program = re.search(r"Save this as `usher\.py`:\n\n```python\n(.*?)```", page, re.DOTALL)
    assert program is not None
    (tmp_path / "howto_usher.py").write_text(program[1])
    monkeypatch.syspath_prepend(tmp_path)
    shown = importlib.import_module("howto_usher").Usher
    inputs = frozenset({"/tf", "/humans/bodies/detections"})
    graph = with_robot(
        Graph("usher", (NodeConfig("usher", shown), NodeConfig("nav2", Navigator)), inputs=inputs), TIAGO
    )
    with GraphTester(graph) as tester:
        place_robot(tester, 0.0, 0.0, 0.0, frame="base_footprint")
        see(tester, 3.0, 0.0)
        tester.run(4.0)
        assert tester.node("nav2").goals == (pytest.approx((1.8, 0.0, 0.0)), pytest.approx((0.0, 0.0, 0.0)))
