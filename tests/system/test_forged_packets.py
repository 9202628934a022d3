"""A stranger in the network who sends false RTPS packets in the name of publishers."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from evaluation.switch import Quality
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.keys import new_key
from tests.system.running import eventually
from tests.system.two_hosts import ROBOT, SECOND_ROBOT, WORKSTATION, Host, open_to, script, switched_hosts, two_hosts

TOPICS = ("/busy", "/idle", "/joints", "/joints/_seal", "/latched")
TALK = """
import sys, time
from pathlib import Path
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import JointTrajectory, Utterance
from socialbot.graph.ports import Delivery
def said(text):
    return Utterance(stamp=time.time_ns(), id=text, text="word")
def moved(number):
    return JointTrajectory(stamp=number, joint_names=("a",), positions=(0.0,), velocities=(), duration_s=1.0)
with spinning_node("talker") as ros:
    transport = open_transport()
    busy, idle = (transport.advertise(ros, topic, Utterance) for topic in ("/busy", "/idle"))
    latched = transport.advertise(ros, "/latched", Utterance, Delivery.LATCHED)
    joints = transport.advertise(ros, "/joints", JointTrajectory)
    number, done = 0, set()
    while True:
        number += 1
        busy.publish(said(str(number)))
        joints.publish(moved(number))
        for command in Path(sys.argv[1]).glob("*.command"):
            if command.name not in done:
                done.add(command.name)
                idle.publish(said(command.stem))
                latched.publish(said(command.stem))
        time.sleep(0.05)
"""
HEAR = """
import logging, time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.qos import subscription_qos
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import JointTrajectory, Utterance
from socialbot.graph.ports import Delivery
logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(message)s")
with spinning_node("hearer") as ros:
    transport, undemanding = open_transport(), subscription_qos(Delivery.NEWEST, outside=True)
    def hear(topic, kind, **options):
        take = lambda one: print(topic, getattr(one, "id", one.__class__.__name__), flush=True)
        return transport.subscribe(ros, topic, kind, take, **options)
    kept = [hear("/busy", Utterance), hear("/idle", Utterance), hear("/joints", JointTrajectory, qos=undemanding)]
    kept += [hear("/latched", Utterance, qos=subscription_qos(Delivery.LATCHED), latched=True)]
    time.sleep(3600)
"""


def attack(
    host: Host, name: str, log: Path, seconds: float, variables: dict[str, str], topics: tuple[str, ...] = TOPICS
) -> None:
    """Send forged packets from ``host`` to the robot for ``seconds``."""
    command = [sys.executable, "-m", "evaluation.rtps_attack", name, ROBOT, ",".join(topics), str(seconds)]
    root = str(Path(__file__).parents[2])
    with log.open("w") as output:
        process = host.start(
            *command, variables={**variables, "PYTHONPATH": root}, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        process.wait(120)
    finally:
        process.kill()
        process.wait()
    assert log.read_text().split()[-1].isdecimal(), log.read_text()


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["heartbeats", "gaps", "samples", "freed_messages"])
def test_messages_arrive_again_after_false_packets_end(name: str, tmp_path: Path) -> None:
    """Messages of all kinds, each once, also on topics that are seldom used."""
    new_key("robot", tmp_path / "keys")
    heard = tmp_path / "hearer.log"
    own = {**open_to(WORKSTATION), KEYS_VARIABLE: str(tmp_path / "keys")}

    def count(line: str) -> int:
        return heard.read_text().split("\n").count(line)

    def arrive(command: str) -> bool:
        (tmp_path / f"{command}.command").touch()
        return eventually(lambda: count(f"/idle {command}") and count(f"/latched {command}"))

    with two_hosts() as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, TALK, tmp_path / "talker.log", own, str(tmp_path)))
        scripts.enter_context(script(hosts.robot, HEAR, heard, own))
        assert eventually(lambda: heard.read_text().count("/busy") > 20), heard.read_text()
        assert eventually(lambda: count("/joints JointTrajectory") > 20), heard.read_text()
        assert arrive("before"), heard.read_text()

        attack(hosts.workstation, name, tmp_path / "attack.log", 5.0, open_to(ROBOT))
        assert eventually(lambda: "are subscribed again" in heard.read_text()), heard.read_text()
        busy, joints = heard.read_text().count("/busy "), count("/joints JointTrajectory")
        assert eventually(lambda: heard.read_text().count("/busy ") > busy + 20), heard.read_text()
        assert eventually(lambda: count("/joints JointTrajectory") > joints + 20), heard.read_text()
        assert arrive("after"), heard.read_text()
        lines = [line for line in heard.read_text().splitlines() if line.startswith(("/busy ", "/idle ", "/latched "))]
        assert len(lines) == len(set(lines)), "a message arrived twice"
        replayed = [line for line in heard.read_text().splitlines() if "replayed" in line]
        assert not replayed, replayed


@pytest.mark.ros
@pytest.mark.slow
def test_lost_messages_are_sent_again_after_false_answers_end(tmp_path: Path) -> None:
    """A stranger answers in the name of the subscription, on a network that loses a tenth of the packets."""
    new_key("robot", tmp_path / "keys")
    heard = tmp_path / "hearer.log"
    own = {**open_to(f"{ROBOT};{WORKSTATION}"), KEYS_VARIABLE: str(tmp_path / "keys")}

    def numbers() -> list[int]:
        lines = heard.read_text().split("\n")[:-1]
        return [int(line.split()[1]) for line in lines if line.startswith("/busy ")]

    def missing(begin: int) -> int:
        found = set(numbers())
        return sum(number not in found for number in range(begin, max(found)))

    with switched_hosts(ROBOT, WORKSTATION, SECOND_ROBOT) as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, TALK, tmp_path / "talker.log", own, str(tmp_path)))
        scripts.enter_context(script(hosts.workstation, HEAR, heard, own))
        assert eventually(lambda: len(numbers()) > 20), heard.read_text()
        hosts.set(Quality(loss=0.1))
        begin = numbers()[-1]
        assert eventually(lambda: numbers()[-1] > begin + 100), heard.read_text()
        assert not missing(begin)

        attack(hosts.hosts[2], "acknacks", tmp_path / "attack.log", 3.0, open_to(f"{ROBOT};{WORKSTATION}"), ("/busy",))
        assert eventually(lambda: missing(begin) > 5), "the attack does what it should"
        assert eventually(lambda: "are subscribed again" in heard.read_text()), heard.read_text()
        again = numbers()[-1]

        def arrive_one_by_one() -> bool:
            last = numbers()[-200:]
            return last[0] > again and last == list(range(last[0], last[0] + 200))

        assert eventually(arrive_one_by_one), heard.read_text()


SAY = """
import time
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import Utterance
with spinning_node("talker") as ros:
    sender = open_transport().advertise(ros, "/speech/say", Utterance)
    while True:
        stamp = time.time_ns()
        sender.publish(Utterance(stamp=stamp, id=str(stamp), text="word"))
        time.sleep(1.0)
"""
UP = "import sys; from socialbot.__main__ import run; run()"
GRAPH = """
name: voice
inputs: [/speech/say]
nodes:
  speech: {type: speaker, parameters: {playback: 'off'}}
"""


TALKING = """
name: talking
nodes:
  talker: {type: 'tests.system.nodes:Talker'}
  speech: {type: speaker, parameters: {playback: 'off'}}
"""


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["removed_publishers", "removed_subscriptions"])
def test_processes_that_lose_a_running_publisher_are_restarted(name: str, tmp_path: Path) -> None:
    """False packets of discovery stop messages for good. `up` restarts the nodes, and observes the graph again."""
    new_key("robot", tmp_path / "keys")
    (tmp_path / "talking.yaml").write_text(TALKING)
    own = {**open_to(WORKSTATION), KEYS_VARIABLE: str(tmp_path / "keys")}
    shown = tmp_path / "up.log"
    with two_hosts() as hosts, ExitStack() as scripts:
        arguments = ("up", str(tmp_path / "talking.yaml"), "--out", str(tmp_path / "run"))
        up = scripts.enter_context(script(hosts.robot, UP, shown, own, *arguments))
        assert eventually(lambda: "says" in shown.read_text()), shown.read_text()
        attack(hosts.workstation, name, tmp_path / "attack.log", 2.0, open_to(ROBOT), ("/speech/say",))
        begun = time.monotonic()
        again = "started again with a new DDS participant", "observes the graph again"
        assert eventually(lambda: any(text in shown.read_text() for text in again)), shown.read_text()
        if name == "removed_publishers":  # for all processes
            assert eventually(lambda: all(text in shown.read_text() for text in again)), shown.read_text()
            assert eventually(lambda: "speech is back" in shown.read_text()), shown.read_text()
        said = shown.read_text().count("says")
        assert eventually(lambda: shown.read_text().count("says") > said + 2), shown.read_text()
        print(f"back after {time.monotonic() - begun:.1f} s")
        assert "no. 2" not in shown.read_text()

        up.terminate()
        assert eventually(lambda: up.poll() is not None), shown.read_text()
        assert up.returncode == 0, shown.read_text()


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["endless_gap", "distant_gap", "discovery_gap", "endless_list"])
def test_a_process_whose_dds_hangs_is_restarted(name: str, tmp_path: Path) -> None:
    """One GAP over 2^32 messages keeps Fast DDS busy for hours. `up` observes the graph again."""
    new_key("robot", tmp_path / "keys")
    (tmp_path / "voice.yaml").write_text(GRAPH)
    own = {**open_to(WORKSTATION), KEYS_VARIABLE: str(tmp_path / "keys")}
    shown = tmp_path / "up.log"
    with two_hosts() as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, SAY, tmp_path / "talker.log", own))
        arguments = ("up", str(tmp_path / "voice.yaml"), "--out", str(tmp_path / "run"))
        up = scripts.enter_context(script(hosts.robot, UP, shown, own, *arguments))
        assert eventually(lambda: "says" in shown.read_text()), shown.read_text()
        attack(hosts.workstation, name, tmp_path / "attack.log", 0.02, open_to(ROBOT), ("/speech/say",))
        if name == "discovery_gap":  # while discovery is blocked, a new subscription would block all of `up`
            attack(hosts.workstation, "heartbeats", tmp_path / "attack.log", 1.0, open_to(ROBOT), ("/speech/say",))
        assert eventually(lambda: "speech hung" in shown.read_text()), shown.read_text()
        assert eventually(lambda: "speech is back" in shown.read_text()), shown.read_text()
        assert eventually(lambda: "observes the graph again" in shown.read_text()), shown.read_text()
        said = shown.read_text().count("says")
        assert eventually(lambda: shown.read_text().count("says") > said + 2), shown.read_text()

        up.terminate()
        assert eventually(lambda: up.poll() is not None), shown.read_text()
        assert up.returncode == 0, shown.read_text()
