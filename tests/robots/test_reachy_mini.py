"""Reachy Mini: what its daemon gets, with a server of the test; the slow tests run the real daemon."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.core.errors import DeviceError, NodeError, ParameterError
from socialbot.core.messages import HeadCommand, JointTrajectory, Utterance
from socialbot.robots.daemon_client import DaemonClient
from socialbot.robots.head import TARGET
from socialbot.robots.reachy_mini import ANTENNA_RAD, DaemonPlayer, ReachyCamera, ReachyHead, ReachySpeaker
from socialbot.speech.synthesis import Sound
from socialbot.testing import GraphTester
from tests.robots.daemon_server import DaemonServer, running_daemon
from tests.system.running import PATIENCE_S, eventually

RATE_HZ = 30.0
LIMITS = {
    "pan_joint": "yaw", "pan_lower_rad": -1.0, "pan_upper_rad": 1.0, "pan_speed_rad_s": 1.5,
    "tilt_joint": "pitch", "tilt_lower_rad": -0.5, "tilt_upper_rad": 0.5, "tilt_speed_rad_s": 1.0,
}  # fmt: skip


@pytest.fixture
def daemon() -> Iterator[DaemonServer]:
    with running_daemon() as server:
        yield server


@contextmanager
def reachy_head(url: str, **parameters: Any) -> Iterator[GraphTester]:
    """A head in simulated time that answers to the test step by step."""
    values = {**LIMITS, "url": url, "rate_hz": RATE_HZ, "in_simulated_time": True, "idle": False, **parameters}
    with GraphTester(ReachyHead, parameters=values) as graph:
        yield graph


def connected(graph: GraphTester) -> bool:
    graph.run(0.0)
    return graph.node()._present is not None


def play(graph: GraphTester, daemon: DaemonServer, seconds: float) -> list[dict[str, Any]]:
    """Let time pass, one target after the other, and return the targets."""
    first = len(daemon.targets)
    for _ in range(round(seconds * RATE_HZ)):
        count, sent = len(daemon.targets), graph.node()._sent
        graph.run(1.0 / RATE_HZ)
        if graph.node()._sent is not sent:
            with daemon.arrived:
                assert daemon.arrived.wait_for(lambda count=count: len(daemon.targets) > count, PATIENCE_S)
    return daemon.targets[first:]


def aim(graph: GraphTester, yaw: float, pitch: float, duration_s: float = 0.1, **fields: Any) -> None:
    values = {
        "joint_names": ("yaw", "pitch"), "positions": (yaw, pitch), "velocities": (0.0, 0.0), "duration_s": duration_s,
    }  # fmt: skip
    graph.send(TARGET, JointTrajectory(stamp=graph.clock.now(), **{**values, **fields}))


def test_the_head_follows_a_target_within_its_speed(daemon):
    with reachy_head(daemon.url) as graph:
        eventually(lambda: connected(graph))
        aim(graph, 0.8, 0.3)
        heads = [target["target_head_pose"] for target in play(graph, daemon, 2.0)]
    assert heads[-1]["yaw"] == pytest.approx(0.8, abs=1e-3)
    assert heads[-1]["pitch"] == pytest.approx(-0.3, abs=1e-3)  # the daemon's pitch is positive down
    steps = [abs(b["yaw"] - a["yaw"]) for a, b in pairwise(heads)]
    assert max(steps) <= 1.5 / RATE_HZ + 1e-4
    assert max(steps[:3]) < max(steps) / 2  # it starts gently


def test_a_target_beyond_the_limits_is_clamped(daemon):
    with reachy_head(daemon.url) as graph:
        eventually(lambda: connected(graph))
        aim(graph, 3.0, -2.0)
        targets = play(graph, daemon, 4.0)
    last = targets[-1]["target_head_pose"]
    assert (last["yaw"], last["pitch"]) == pytest.approx((1.0, 0.5), abs=1e-3)
    assert all(abs(target["target_head_pose"]["yaw"]) <= 1.0 for target in targets)


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"positions": (math.nan, 0.0)}, "position nan of joint 'yaw'"),
        ({"positions": (0.0, math.inf)}, "position inf of joint 'pitch'"),
        ({"joint_names": ("yaw", "nod")}, "unknown joint 'nod'"),
        ({"positions": (0.1,)}, "1 positions for 2 joints"),
        ({"duration_s": math.nan}, "duration nan s"),
        ({"duration_s": -1.0}, "duration -1.0 s"),
    ],
)
def test_an_invalid_target_is_refused_and_not_sent(daemon, fields, what):
    def refuse() -> None:
        with reachy_head(daemon.url) as graph:
            eventually(lambda: connected(graph))
            play(graph, daemon, 0.2)
            count = len(daemon.targets)
            aim(graph, 0.5, 0.0, **fields)
            play(graph, daemon, 0.5)
            assert len(daemon.targets) == count

    with pytest.raises(NodeError, match=what):
        refuse()


def test_a_flood_of_targets_is_limited_to_the_rate(daemon):
    with reachy_head(daemon.url, rate_hz=10.0) as graph:
        eventually(lambda: connected(graph))
        for step in range(200):
            aim(graph, 0.5 * (-1) ** step, 0.0)
            graph.run(0.005)
        graph.run(0.0)
    assert len(daemon.targets) <= 11


def test_an_utterance_begins_its_gesture_and_a_command_the_posture(daemon):
    with reachy_head(daemon.url, idle=True) as graph:
        eventually(lambda: connected(graph))
        graph.send("/head/command", HeadCommand(stamp=graph.clock.now(), mode="track"))
        graph.send("/speech/say", Utterance(stamp=graph.clock.now(), id="u1", text="Hello!", key="greeting"))
        targets = play(graph, daemon, 3.0)
        left = [target["target_antennas"][1] for target in targets]
        assert 0.5 < max(left) <= ANTENNA_RAD
        assert left[-1] == pytest.approx(0.35, abs=0.01)
        assert graph.node()._player.name == "listening"
        graph.send("/head/command", HeadCommand(stamp=graph.clock.now(), mode="centre"))
        last = play(graph, daemon, 2.0)[-1]
        assert abs(last["target_antennas"][1]) < 0.15
        assert graph.node()._player.name == "idle"


def test_no_request_leaves_after_the_end(daemon):
    with reachy_head(daemon.url) as graph:
        eventually(lambda: connected(graph))
        aim(graph, 0.8, 0.0, duration_s=5.0)
        play(graph, daemon, 0.5)
        yaw = daemon.head["yaw"]
    count = len(daemon.requests)
    assert 0.0 < yaw < 0.8
    assert not [thread for thread in threading.enumerate() if thread.name == "socialbot-reachy-mini"]
    graph.run(2.0)
    assert (len(daemon.requests), daemon.head["yaw"]) == (count, yaw)


def test_a_replay_does_not_move_the_robot(daemon):
    with reachy_head(daemon.url, in_simulated_time=False) as graph:
        aim(graph, 0.5, 0.0)
        graph.run(2.0)
    assert daemon.requests == []


def test_a_killed_daemon_is_survived_and_the_head_goes_on_from_its_pose():
    with running_daemon() as daemon:
        port = daemon.server_address[1]
        with reachy_head(daemon.url) as graph:
            eventually(lambda: connected(graph))
            aim(graph, 0.6, 0.0)
            play(graph, daemon, 1.5)
            daemon.shutdown()
            daemon.server_close()
            eventually(lambda: not connected(graph))
            health = graph.node().context.health_monitor
            assert "does not answer" in str(health.__dict__)
            graph.run(1.0)
            with running_daemon(port) as again:
                again.head["yaw"] = -0.4
                eventually(lambda: connected(graph))
                yaws = [target["target_head_pose"]["yaw"] for target in play(graph, again, 3.0)]
    assert yaws[0] == pytest.approx(-0.4, abs=1.5 / RATE_HZ + 1e-3)
    assert yaws[-1] == pytest.approx(0.6, abs=1e-3)
    assert max(b - a for a, b in pairwise(yaws)) <= 1.5 / RATE_HZ + 1e-4


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"mode": "disabled"}, "the motors are disabled"),
        ({"state": "stopped"}, "the robot cannot move: it is stopped"),
    ],
)
def test_a_robot_that_cannot_move_is_reported(daemon, change, reason):
    vars(daemon).update(change)
    with reachy_head(daemon.url) as graph:
        eventually(lambda: graph.run(0.0) is None and reason in str(vars(graph.node().context.health_monitor)))
        aim(graph, 0.5, 0.0)
        graph.run(1.0)
    assert daemon.targets == []


def test_wrong_parameters_are_refused():
    with pytest.raises(ParameterError, match="no joints 'pan' and 'pitch'"):
        GraphTester(ReachyHead, parameters={**LIMITS, "pan_joint": "pan"}).__enter__()
    for url in ("https://robot:8000", "robot", "http://", "http://robot:port", "http://robot/api"):
        with pytest.raises(ParameterError, match="not the address of a daemon"):
            GraphTester(ReachyHead, parameters={**LIMITS, "url": url}).__enter__()
    with pytest.raises(ParameterError, match="cannot read 'greeting=greet'") as caught:
        GraphTester(ReachyHead, parameters={**LIMITS, "gestures": "greeting=greet"}).__enter__()
    assert "greeting" in (caught.value.remedy or "")


class TestTheVoice:
    def test_speaks_on_the_robot(self, daemon):
        ended: list[str | None] = []
        player = DaemonPlayer(daemon.url)
        player.play(Sound(np.zeros(1600, np.int16), 16000), ended.append)
        eventually(lambda: ended == [None])
        assert daemon.played == ["socialbot.wav"]
        assert daemon.sounds["socialbot.wav"][:4] == b"RIFF"
        assert len(daemon.sounds["socialbot.wav"]) == 44 + 3200

    def test_a_daemon_that_is_away_fails_the_utterance(self):
        ended: list[str | None] = []
        DaemonPlayer("http://127.0.0.1:9").play(Sound(np.zeros(16, np.int16), 16000), ended.append)
        eventually(lambda: bool(ended))
        assert "does not answer" in (ended[0] or "")

    def test_a_replay_does_not_speak_on_the_robot(self, daemon):
        with GraphTester(ReachySpeaker, parameters={"url": daemon.url, "playback": "auto"}) as graph:
            graph.send("/speech/say", Utterance(stamp=0, id="u1", text="Hello!"))
            graph.run(3.0)
        assert daemon.requests == []


def test_the_daemon_gets_its_camera_back_at_the_end_if_it_cannot_be_opened(daemon):
    with GraphTester(ReachyCamera, parameters={"url": daemon.url, "source": "97"}):
        assert daemon.requests == ["POST /api/media/release"]
    assert daemon.requests == ["POST /api/media/release", "POST /api/media/acquire"]


def test_a_video_needs_no_camera_of_the_daemon(daemon, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cv2.imwrite(str(tmp_path / "1.png"), np.zeros((8, 8, 3), np.uint8))
    with GraphTester(ReachyCamera, parameters={"url": daemon.url, "source": str(tmp_path)}) as graph:
        graph.run(0.2)
        assert graph.messages("/camera/image_raw")
    assert daemon.requests == []


class TestTheClient:
    def test_a_refused_request_names_the_reason(self, daemon):
        with pytest.raises(DeviceError, match="refused with 422: Input should be a valid number"):
            DaemonClient(daemon.url).set_target({"target_head_pose": {"yaw": "left"}})
        with pytest.raises(DeviceError, match="refused with 400: Unsupported or invalid audio file"):
            DaemonClient(daemon.url).upload_sound("a.wav", b"no sound")

    def test_numbers_that_are_not_finite_never_leave(self, daemon):
        with pytest.raises(ValueError, match="Out of range float"):
            DaemonClient(daemon.url).set_target({"target_body_yaw": math.nan})
        assert daemon.requests == []

    def test_a_connection_is_kept_open(self, daemon):
        client = DaemonClient(daemon.url)
        for _ in range(5):
            client.status()
        assert len(daemon._connections) == 1
