"""A stranger who records the packets of a graph on two machines, and sends them again."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest

from socialbot.bridge.environment import KEYS_VARIABLE, PROFILE_VARIABLE
from socialbot.bridge.keys import new_key
from tests.system.running import eventually, next_line
from tests.system.two_hosts import ROBOT, WORKSTATION, open_to, script, two_hosts

SEND = """
import time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import Health, HeadCommand, JointTrajectory, PersonDetections, Utterance
with spinning_node("sender") as ros:
    transport = open_transport()
    kinds = {"/speech/say": Utterance, "/head/command": HeadCommand, "/seen": PersonDetections, "/healths": Health,
             "/joints": JointTrajectory}
    senders = {topic: transport.advertise(ros, topic, kind) for topic, kind in kinds.items()}
    number = 0
    while True:
        number += 1
        stamp = time.time_ns()
        fields = {
            Utterance: dict(id=str(number), text=f"word {number}"),
            HeadCommand: dict(mode="look", pan_rad=number / 1000, cause=str(number)),
            PersonDetections: dict(frame_id=str(number), width=1, height=1, persons=()),
            Health: dict(node="camera", state="ok", reason=str(number)),
            JointTrajectory: dict(joint_names=(str(number),), positions=(0.0,), velocities=(), duration_s=1.0),
        }
        for topic, kind in kinds.items():
            if kind is not Utterance or number % 8 == 0:  # so that each word is said
                senders[topic].publish(kind(stamp=stamp, **fields[kind]))
        time.sleep(0.25)
"""
RUN = "from socialbot.__main__ import run; run()"
GRAPH = """
name: receiving
inputs: [/speech/say, /head/command, /seen, /healths, /joints, /humans/bodies/detections]
nodes:
  speech: {{type: speaker, parameters: {{playback: 'off'}}}}
  head: {{type: head}}
  hearer: {{type: 'tests.system.nodes:Hearer', parameters: {{record: {record}}}}}
"""
TOPICS: tuple[str, ...] = ("/speech/say", "/head/command", "/seen", "/healths", "/joints")
EFFECTS: tuple[str, ...] = ("/speech/status", "/head_controller/joint_trajectory")
"""Topics that tell what the robot does: it has begun to speak, and it moves the head."""
RECORDED = {topic for topic in TOPICS if topic != "/healths"}
"""Topics whose refusals `up` tells."""
REFUSED = re.compile(r"(/\S+): refused")


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("with_keys", [False, True], ids=["open", "keys"])
def test_recorded_packets_have_no_effect(with_keys: bool, tmp_path: Path) -> None:
    """The graph without keys shows that the packets do what they should. The window of a minute covers the test."""
    new_key("robot", tmp_path / "keys")
    record = tmp_path / "record"
    record.touch()
    (tmp_path / "graph.yaml").write_text(GRAPH.format(record=record))
    common = {"XDG_STATE_HOME": str(tmp_path / "state"), "SOCIALBOT_KEYS_WINDOW_S": "60"}
    if with_keys:
        common[KEYS_VARIABLE] = str(tmp_path / "keys")
    robot, workstation = common | open_to(WORKSTATION), common | open_to(ROBOT)
    logs: list[Path] = []

    def heard() -> list[str]:
        return record.read_text().splitlines()

    def newest() -> dict[str, float]:
        """The highest number of each topic."""
        found = dict.fromkeys((*TOPICS, *EFFECTS), 0.0)
        for topic, number in (line.split() for line in heard()):
            found[topic] = max(found[topic], float(number))
        return found

    def hears_more() -> bool:
        """Whether newer messages of all topics arrive, and the robot speaks and moves."""
        before = newest()
        return eventually(lambda: all(number > before[topic] for topic, number in newest().items()), 60.0)

    def forged() -> dict[str, int]:
        """Messages that have arrived more than once, or after a later one; by topic."""
        found: Counter[str] = Counter()
        for topic in (*TOPICS, *EFFECTS):
            highest = 0.0
            for number in (float(line.split()[1]) for line in heard() if line.startswith(f"{topic} ")):
                found[topic] += number <= highest
                highest = max(highest, number)
        return {topic: count for topic, count in found.items() if count}

    with two_hosts() as hosts, ExitStack() as scripts:

        def start_robot() -> subprocess.Popen[bytes]:
            logs.append(tmp_path / f"robot{len(logs)}.log")
            arguments = ("up", str(tmp_path / "graph.yaml"), "--out", str(tmp_path / logs[-1].stem))
            return scripts.enter_context(script(hosts.robot, RUN, logs[-1], robot, *arguments))

        stranger = hosts.workstation.start(
            *(sys.executable, "-m", "evaluation.rtps_replay", ROBOT, os.environ["ROS_DOMAIN_ID"]),
            hosts.workstation.device,
            variables={"PYTHONPATH": str(Path(__file__).parents[2]), PROFILE_VARIABLE: ""},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        scripts.callback(stranger.communicate)
        assert stranger.stdin is not None
        stdin = stranger.stdin
        assert next_line(stranger) == "ready\n"

        def send(what: str) -> int:
            stdin.write(f"{what}\n".encode())
            stdin.flush()
            return int(next_line(stranger))

        def send_later() -> None:
            """Send later packets until they all have an effect; with keys until they are all refused."""
            before = Counter(forged())

            def arrive() -> bool:
                assert send("later") > 1000
                if with_keys:
                    return eventually(lambda: set(REFUSED.findall(logs[-1].read_text())) >= RECORDED, 3.0)
                return eventually(lambda: {*TOPICS, *EFFECTS} <= (Counter(forged()) - before).keys(), 3.0)

            assert eventually(arrive, 60.0), forged()

        def stop(process: subprocess.Popen[bytes]) -> None:
            process.terminate()
            process.wait(60)

        first = start_robot()
        sender = scripts.enter_context(script(hosts.workstation, SEND, tmp_path / "sender.log", workstation))
        assert hears_more(), heard()
        assert send("same") > 100
        assert hears_more()
        assert not forged(), "DDS drops packets that it has received"
        send_later()

        stop(first)
        second = start_robot()
        assert hears_more()
        send("same")
        send_later()

        stop(sender)
        send_later()

        stop(second)
        start_robot()
        count = len(heard())
        send("same")
        send_later()
        if with_keys:
            assert not forged(), forged()
            assert len(heard()) == count, "a robot that has just started believes what it has never heard"
            assert "replayed" in logs[1].read_text()
            assert "replayed" in logs[2].read_text()
