"""A subscription that is replaced while the publisher cannot learn of its successor."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from socialbot.bridge.environment import KEYS_VARIABLE, ros_domain
from socialbot.bridge.keys import new_key
from tests.system.running import eventually
from tests.system.two_hosts import ROBOT, WORKSTATION, open_to, script, two_hosts

TALK = """
import itertools, time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import JointTrajectory, Utterance
with spinning_node("talker") as ros:
    transport = open_transport()
    said, moved = transport.advertise(ros, "/said", Utterance), transport.advertise(ros, "/moved", JointTrajectory)
    for number in itertools.count():
        said.publish(Utterance(stamp=time.time_ns(), id=str(number), text="word"))
        joints = {"joint_names": ("a",), "positions": (0.0,), "velocities": (), "duration_s": 1.0}
        moved.publish(JointTrajectory(stamp=number, **joints))
        time.sleep(0.05)
"""
HEAR = """
import sys, time
from pathlib import Path
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import JointTrajectory, Utterance
again = Path(sys.argv[1])
with spinning_node("hearer") as ros:
    transport = open_transport()
    said = transport.subscribe(ros, "/said", Utterance, lambda one: print("said", one.id, flush=True))
    moved = transport.subscribe(ros, "/moved", JointTrajectory, lambda one: print("moved", one.stamp, flush=True))
    before = len(list(ros.subscriptions))
    endpoints = [said.endpoint, moved.endpoint, moved.listener.seals]
    was_alone = True
    def check():
        global was_alone
        if again.exists():
            again.unlink()
            for each in endpoints:
                each.replace()
        is_alone = len(list(ros.subscriptions)) == before
        if is_alone != was_alone:
            print("alone" if is_alone else "together", flush=True)
        was_alone = is_alone
    ros.create_timer(0.1, check)
    time.sleep(3600)
"""
NO_ANNOUNCEMENTS = """
add table netdev announcements
add chain netdev announcements arriving {{ type filter hook ingress device {device} priority 0; }}
add rule netdev announcements arriving udp dport {{ {ports} }} drop
"""
"""Drops packets of discovery to the first participant of a host; messages and their acknowledgements pass."""


@pytest.mark.ros
@pytest.mark.slow
def test_no_message_is_lost_while_the_publisher_does_not_find_the_new_subscription(tmp_path: Path) -> None:
    new_key("robot", tmp_path / "keys")
    log, again = tmp_path / "hearer.log", tmp_path / "again"
    own = {**open_to(f"{ROBOT};{WORKSTATION}"), KEYS_VARIABLE: str(tmp_path / "keys")}
    ports = ", ".join(str(7400 + 250 * ros_domain() + offset) for offset in (0, 10))

    def numbers(topic: str) -> list[int]:
        return [int(line.split()[1]) for line in log.read_text().split("\n")[:-1] if line.startswith(topic)]

    def is_complete(topic: str) -> bool:
        found = numbers(topic)
        return found == list(range(found[0], found[-1] + 1))

    with two_hosts() as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, TALK, tmp_path / "talker.log", own))
        scripts.enter_context(script(hosts.workstation, HEAR, log, own, str(again)))
        topics = ("said", "moved")
        assert eventually(lambda: all(len(numbers(topic)) > 20 for topic in topics)), log.read_text()
        hosts.robot.run("nft", NO_ANNOUNCEMENTS.format(device=hosts.robot.device, ports=ports))
        again.touch()
        assert eventually(lambda: "together" in log.read_text()), log.read_text()
        # It takes 10 s until these have arrived: longer than publishers are waited for.
        last = {topic: numbers(topic)[-1] for topic in topics}
        assert eventually(lambda: all(numbers(topic)[-1] > last[topic] + 200 for topic in topics)), log.read_text()
        assert "alone" not in log.read_text()
        hosts.robot.run("nft", "flush", "ruleset")
        assert eventually(lambda: "alone" in log.read_text()), log.read_text()
        last = {topic: numbers(topic)[-1] for topic in topics}
        assert eventually(lambda: all(numbers(topic)[-1] > last[topic] + 20 for topic in topics)), log.read_text()
        assert all(is_complete(topic) for topic in topics), log.read_text()
        assert "refused" not in log.read_text()
