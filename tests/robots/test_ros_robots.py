"""Robots over DDS: heads, speech and bases against a robot of plain rclpy that speaks the real interfaces."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.core.messages import JointTrajectory, Utterance
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionClient
from socialbot.robots.head import NaoqiHead, TrajectoryActionHead, TrajectoryHead
from socialbot.robots.people import RobotPeople
from socialbot.robots.speech import SaySkillSpeaker, TopicSpeaker, TtsSpeaker
from tests.bridge.hosting import foreign_process, node_hosts
from tests.robots.test_asking import Host, serve
from tests.robots.test_joints import Waver, pose
from tests.robots.usher import Usher, go_home
from tests.system.running import eventually, socialbot_here

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("control_msgs") is None, reason="needs make robot-interfaces, or a full ROS"),
]

PARAMETERS = {
    "pan_joint": "head_1_joint", "pan_lower_rad": -1.2, "pan_upper_rad": 1.2, "pan_speed_rad_s": 1.0,
    "tilt_joint": "head_2_joint", "tilt_lower_rad": -0.9, "tilt_upper_rad": 0.7, "tilt_speed_rad_s": 0.5,
}  # fmt: skip
OUTSIDE = frozenset(
    {"/head_controller/follow_joint_trajectory", "/tts_engine/tts", "/skill/say", "/skill/ask", "/navigate_to_pose"}
)


class HomeUsher(Usher):
    """Drives home when it is told to."""

    keeps_mind = False

    def set_home_goal(self) -> None:
        self.engine.achieve(go_home())


class Robot:
    """The robot in another process, and what it has got."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.got: list[dict[str, Any]] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.got.append(json.loads(line))

    def has(self, **fields: Any) -> bool:
        return any(all(each.get(key) == value for key, value in fields.items()) for each in self.got)


@contextmanager
def robot(mode: str = "good") -> Iterator[Robot]:
    with foreign_process("tests.robots.robot_servers", mode) as process:
        yield Robot(process)


@contextmanager
def hosted(kind: type[Node], **parameters: Any) -> Iterator[Any]:
    config = NodeConfig("part", kind, parameters)
    inputs = frozenset(topic for topic, _ in config.subscriptions)
    with node_hosts(Graph("robot", (config,), inputs=inputs, services=OUTSIDE)) as host:
        made = host("part")
        assert eventually(lambda: made.active_thread is not None)
        yield made


def call(node: Any, method: str, *arguments: Any) -> None:
    done = threading.Event()
    node.active_thread.queue.call_soon(lambda: (getattr(node.node, method)(*arguments), done.set()))
    assert eventually(done.is_set)


def look(node: Any, pan: float, tilt: float) -> None:
    target = JointTrajectory(
        stamp=node.node.clock.now(),
        joint_names=("head_1_joint", "head_2_joint"),
        positions=(pan, tilt),
        velocities=(0.0, 0.0),
        duration_s=0.1,
    )
    call(node, "on_target", target)


def health(node: Any) -> str:
    return str(vars(node.node.context.health_monitor))


class TestTheHead:
    def test_a_topic_gets_clamped_positions_and_slow_motions_and_a_stop(self):
        with robot() as tiago:
            with hosted(TrajectoryHead, **PARAMETERS) as head:
                assert eventually(lambda: head._senders["trajectory"].publisher.get_subscription_count() > 0)
                assert eventually(lambda: head.node.pose() is not None)
                look(head, 3.0, -2.0)
                assert eventually(lambda: len(tiago.got) == 1)
                first = tiago.got[0]
                assert first["positions"] == [1.2, -0.9]
                assert first["joints"] == ["head_1_joint", "head_2_joint"]
                assert first["seconds"] == pytest.approx(0.65 / 0.5)  # from .5, -.25
            assert eventually(lambda: len(tiago.got) == 2)
            stop = tiago.got[1]
            assert stop["positions"] == [0.5, -0.25]  # where it is, not where it should go
            assert 0.0 < stop["seconds"] <= 0.1

    def test_from_an_unknown_pose_the_head_is_slow_and_is_not_stopped_by_a_guess(self):
        with robot("silent") as tiago:
            with hosted(TrajectoryHead, **PARAMETERS) as head:
                assert eventually(lambda: head._senders["trajectory"].publisher.get_subscription_count() > 0)
                look(head, 1.2, 0.0)
                assert eventually(lambda: len(tiago.got) == 1)
                assert tiago.got[0]["seconds"] == pytest.approx(2.4)  # the longest way
            tiago.process.stdin.close()  # type: ignore[union-attr]
            tiago.process.wait()
            assert len(tiago.got) == 1

    def test_an_action_gives_feedback_and_a_result(self):
        with robot() as tiago, hosted(TrajectoryActionHead, **PARAMETERS) as head:
            look(head, 0.4, 0.1)
            assert eventually(lambda: tiago.has(way="action", positions=[0.4, 0.1]))
            assert eventually(lambda: head.node.error == {"head_1_joint": 0.25, "head_2_joint": 0.25})
            assert eventually(lambda: head.node._goal.result is not None)
            assert head.node._goal.result.ok

    @pytest.mark.parametrize(("mode", "reason"), [("reject", "rejected the goal"), ("abort", "the head is blocked")])
    def test_a_goal_that_fails_is_reported_and_the_next_is_sent(self, mode, reason):
        with robot(mode) as tiago, hosted(TrajectoryActionHead, **PARAMETERS) as head:
            look(head, 0.4, 0.1)
            assert eventually(lambda: reason in health(head))
            if mode == "abort":
                look(head, -0.4, 0.0)
                assert eventually(lambda: tiago.has(positions=[-0.4, 0.0]))

    def test_a_goal_that_takes_too_long_is_cancelled(self):
        with robot("slow") as tiago, hosted(TrajectoryActionHead, **PARAMETERS, late_s=0.2) as head:
            look(head, 0.1, 0.0)
            assert eventually(lambda: tiago.has(cancelled="FollowJointTrajectory_Result"))
            assert eventually(lambda: "gave no result within" in health(head))

    def test_the_end_of_the_node_stops_the_head(self):
        with robot("slow") as tiago:
            with hosted(TrajectoryActionHead, **PARAMETERS) as head:
                look(head, 1.0, 0.0)
                assert eventually(lambda: tiago.has(way="action", positions=[1.0, 0.0]))
            assert eventually(lambda: tiago.has(cancelled="FollowJointTrajectory_Result"))

    def test_a_controller_that_restarts_is_used_again(self):
        with hosted(TrajectoryActionHead, **PARAMETERS) as head:
            with robot() as tiago:
                look(head, 0.4, 0.0)
                assert eventually(lambda: tiago.has(positions=[0.4, 0.0]))
            assert eventually(lambda: "no action server" in health(head))
            with robot() as tiago:
                look(head, -0.4, 0.0)
                assert eventually(lambda: tiago.has(positions=[-0.4, 0.0]))
                assert eventually(lambda: "no action server" not in health(head))

    def test_naoqi_gets_a_share_of_its_full_speed(self):
        parameters = {**PARAMETERS, "full_speed_rad_s": 8.0}
        with robot() as nao, hosted(NaoqiHead, **parameters) as head:
            assert eventually(lambda: head._senders["angles"].publisher.get_subscription_count() > 0)
            look(head, 0.0, 0.0)
            assert eventually(lambda: len(nao.got) == 1)
            look(head, 0.8, 0.0)
            assert eventually(lambda: len(nao.got) == 2)
            assert nao.got[1]["angles"] == pytest.approx([0.8, 0.0])
            assert nao.got[1]["relative"] == 0
            assert 0.0 < nao.got[1]["speed"] <= 1.0 / 8.0 + 1e-6


class TestSpeech:
    def said(self, speaker: Any, text: str) -> list[str]:
        """Say something, and return the states of the utterance."""
        states: list[str] = []
        status = speaker.node.status
        publish = status.publish
        vars(speaker.node)["status"] = type("Tap", (), {"publish": lambda _, m: (states.append(m.state), publish(m))})()
        call(speaker, "on_say", Utterance(stamp=0, id="u1", text=text))
        return states

    @pytest.mark.parametrize(("kind", "field"), [(TtsSpeaker, "tts"), (SaySkillSpeaker, "say")])
    def test_an_utterance_is_a_goal(self, kind, field):
        with robot() as tiago, hosted(kind) as speaker:
            states = self.said(speaker, "Hello!")
            assert eventually(lambda: states == ["started", "finished"])
            assert eventually(lambda: tiago.has(**{field: "Hello!"}))

    @pytest.mark.parametrize("kind", [TtsSpeaker, SaySkillSpeaker])
    @pytest.mark.parametrize("mode", ["reject", "abort", "error"])
    def test_an_utterance_fails_with_its_goal(self, kind, mode):
        with robot(mode), hosted(kind) as speaker:
            states = self.said(speaker, "Hello!")
            assert eventually(lambda: states == ["started", "failed"])

    def test_an_utterance_that_takes_too_long_fails_and_the_robot_stops(self):
        with robot("slow") as tiago, hosted(TtsSpeaker, limit_s=1.0) as speaker:
            assert eventually(lambda: speaker._services._channels["speak"].has_server())  # else no goal is sent
            states = self.said(speaker, "Hello!")
            assert eventually(lambda: states == ["started", "failed"])
            assert eventually(lambda: tiago.has(cancelled="TTS_Result"))

    def test_the_end_of_the_node_stops_the_speech(self):
        with robot("slow") as tiago:
            with hosted(TtsSpeaker) as speaker:
                self.said(speaker, "A long story.")
                assert eventually(lambda: tiago.has(tts="A long story."))
            assert eventually(lambda: tiago.has(cancelled="TTS_Result"))

    def test_a_killed_tts_fails_the_utterance_and_the_next_one_is_spoken(self):
        with hosted(TtsSpeaker) as speaker:
            with robot("slow") as tiago:
                states = self.said(speaker, "One.")
                assert eventually(lambda: tiago.has(tts="One."))
            assert eventually(lambda: states == ["started", "failed"])
            with robot() as tiago:
                states = self.said(speaker, "Two.")
                assert eventually(lambda: states[-1:] == ["finished"])
                assert eventually(lambda: tiago.has(tts="Two."))

    def test_an_utterance_for_a_killed_tts_is_spoken_by_its_successor(self):
        with hosted(TtsSpeaker) as speaker:
            with robot():
                states = self.said(speaker, "One.")
                assert eventually(lambda: states == ["started", "finished"])
            states = self.said(speaker, "Two.")  # the killed one is still discovered
            with robot() as tiago:
                assert eventually(lambda: states == ["started", "finished"])
                assert eventually(lambda: tiago.has(tts="Two."))

    def test_a_topic_gets_the_text(self):
        with robot() as nao, hosted(TopicSpeaker, rate_wpm=450) as speaker:
            assert eventually(lambda: speaker._senders["text"].publisher.get_subscription_count() > 0)
            states = self.said(speaker, "Hello!")
            assert eventually(lambda: states == ["started", "finished"])
            assert eventually(lambda: nao.has(speech="Hello!"))


class TestTheBase:
    def drive_home(self, usher: Any) -> None:
        call(usher, "set_home_goal")

    def believes(self, usher: Any, text: str) -> bool:
        return any(str(held.belief) == text for held in list(usher.node.engine.beliefs))

    def test_home_is_a_goal_with_feedback(self):
        with robot() as turtlebot, hosted(HomeUsher, home="1.5 -0.5 0.5") as usher:
            self.drive_home(usher)
            assert eventually(lambda: self.believes(usher, 'met("home")'))
            assert eventually(lambda: any("navigate" in each for each in turtlebot.got))
            (goal,) = [each for each in turtlebot.got if "navigate" in each]
            assert goal["navigate"] == pytest.approx([1.5, -0.5, 0.5])
            assert goal["frame"] == "map"
            assert eventually(lambda: self.believes(usher, "distance_left(1.5)"))

    @pytest.mark.parametrize(("mode", "why"), [("reject", "rejected"), ("abort", "aborted")])
    def test_a_goal_that_fails_fails_the_goal_of_the_agent(self, mode, why):
        with robot(mode), hosted(HomeUsher) as usher:
            self.drive_home(usher)
            assert eventually(lambda: self.believes(usher, f'failed("{why}")'))

    def test_the_time_limit_cancels_the_goal(self):
        with robot("slow") as turtlebot, hosted(HomeUsher) as usher:
            self.drive_home(usher)
            assert eventually(lambda: turtlebot.has(cancelled="NavigateToPose_Result"))
            assert eventually(lambda: self.believes(usher, 'failed("timeout")'))

    def test_the_end_of_the_agent_stops_the_base(self):
        with robot("slow") as turtlebot:
            with hosted(HomeUsher) as usher:
                self.drive_home(usher)
                assert eventually(lambda: any("navigate" in each for each in turtlebot.got))
            assert eventually(lambda: turtlebot.has(cancelled="NavigateToPose_Result"))

    def test_a_killed_nav2_fails_the_goal_and_the_next_one_is_driven(self):
        with hosted(HomeUsher) as usher:
            with robot("slow") as turtlebot:
                self.drive_home(usher)
                assert eventually(lambda: any("navigate" in each for each in turtlebot.got))
                turtlebot.process.kill()
                # A killed process stays discovered for up to 20 s, longer than the time limit of the step.
                assert eventually(lambda: any(self.believes(usher, f'failed("{why}")') for why in ("timeout", "lost")))
            with robot():
                self.drive_home(usher)
                assert eventually(lambda: self.believes(usher, 'met("home")'))


def test_an_answer_of_the_ask_skill_becomes_a_belief():
    class TellableHost(Host):
        """Asks when it is told to."""

        keeps_mind = False
        within_s = 100.0  # The middleware takes longer on a busy machine.

        def begin(self) -> None:
            self.engine.achieve(serve())

    with robot() as tiago, hosted(TellableHost) as host:
        call(host, "begin")
        expected = 'answered("drink", "tea")'
        assert eventually(lambda: any(str(held.belief) == expected for held in list(host.node.engine.beliefs)))
        assert eventually(lambda: tiago.has(ask="What would you like to drink?", schema='{"drink": "string"}'))


@pytest.mark.parametrize(
    ("mode", "belief"),
    [("good", 'done("head_1_joint")'), ("abort", 'failed("aborted")'), ("error", 'failed("refused")')],
)
def test_a_motion_of_joints_is_a_goal_of_the_engine(mode, belief):
    class TellableWaver(Waver):
        """Moves the joints of the head when it is told to."""

        follow = ActionClient(Waver.follow.interface.name, "/head_controller/follow_joint_trajectory")

        def begin(self) -> None:
            self.engine.achieve(pose("head_1_joint", 9.0, "head_2_joint", 0.1))

    limits = "head_1_joint -1 1 1, head_2_joint -1 1 1"
    with robot(mode) as tiago, hosted(TellableWaver, limits=limits) as waver:
        call(waver, "begin")
        assert eventually(lambda: any(str(held.belief) == belief for held in list(waver.node.engine.beliefs)))
        assert eventually(lambda: tiago.has(way="action", positions=[1.0, 0.1]))


class TestPeople:
    def test_bodies_and_their_frames_become_people(self):
        from geometry_msgs.msg import TransformStamped

        from socialbot.bridge.environment import spinning_node
        from socialbot.bridge.transport import message_class

        IdsList = message_class("hri_msgs/msg/IdsList")  # noqa: N806
        TFMessage = message_class("tf2_msgs/msg/TFMessage")  # noqa: N806
        with spinning_node("detector") as ros, hosted(RobotPeople) as people:
            seen: list[Any] = []
            publish = people.node.detections.publish
            vars(people.node)["detections"] = SimpleNamespace(publish=lambda m: (seen.append(m), publish(m)))
            ids, frames = (
                ros.create_publisher(IdsList, "/humans/bodies/tracked", 5),
                ros.create_publisher(TFMessage, "/tf", 5),
            )

            def tell() -> None:
                now = ros.get_clock().now().to_msg()
                frame = TransformStamped(child_frame_id="body_x1")
                frame.header.stamp, frame.header.frame_id = now, "base_link"
                frame.transform.translation.x, frame.transform.rotation.z = 2.5, 1.0
                frame.transform.rotation.w = 0.0
                frames.publish(TFMessage(transforms=[frame]))
                message = IdsList(ids=["x1"])
                message.header.stamp = now
                ids.publish(message)

            ros.create_timer(0.05, tell)
            assert eventually(lambda: any(each.persons and each.persons[0].distance_m for each in seen))
            person = next(each.persons[0] for each in seen if each.persons and each.persons[0].distance_m)
            assert (person.track_id, person.distance_m) == ("x1", pytest.approx(2.5))
            assert person.facing_rad == pytest.approx(0.0, abs=1e-6)


def test_doctor_finds_the_whole_robot(tmp_path):
    profile = tmp_path / "robby.yaml"
    profile.write_text(
        "like: tiago\nname: robby\ncamera: {info: /camera_info}\n"
        "head: {action: /head_controller/follow_joint_trajectory}\n"
    )
    with robot():
        done = socialbot_here("doctor", "--robot", profile, "--json")
    found = [(each["name"], each["state"]) for each in json.loads(done.stdout)["findings"]]
    assert ("head", "ok") in found
    assert ("speech", "ok") in found
    assert found.count(("base", "ok")) == 1
    assert ("camera", "error") in found
    assert done.returncode == 5
