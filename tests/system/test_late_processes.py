"""A process that starts beside others meets all of them soon."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.running import eventually
from tests.system.two_hosts import ROBOT, WORKSTATION, Host, open_to, script, two_hosts

FIRST_ANNOUNCEMENTS_S = 5.0
"""Time after which a process announces itself seldom."""
STEP_S = 2.5
SOON_S = 2.5
"""Half the period of announcements; 1.7 s at most was measured, and 4.7 s where answers are lost."""
LATEST_S = 6.5
"""Period of announcements, 5 s, and a second for the exchange of topics."""

TALK = """
import sys, time
from std_msgs.msg import String
from socialbot.bridge.environment import prepare, spinning_node
prepare()
with spinning_node(sys.argv[1]) as ros:
    publisher = ros.create_publisher(String, "/known", 10)
    print("up", flush=True)
    while True:
        publisher.publish(String(data=sys.argv[1]))
        time.sleep(0.05)
"""
HEAR = """
import os, sys, time
from std_msgs.msg import String
from socialbot.bridge.environment import prepare, spinning_node
prepare()

def hear(number):
    heard = set()
    with spinning_node(f"new{number}") as ros:
        made = time.monotonic()

        def take(message):
            if message.data not in heard:
                heard.add(message.data)
                print("heard", number, message.data, time.monotonic() - made, time.monotonic(), flush=True)

        ros.create_subscription(String, "/known", take, 10)
        print("up", flush=True)
        end = made + float(sys.argv[3])
        while len(heard) < int(sys.argv[2]) and time.monotonic() < end:
            time.sleep(0.02)
        os._exit(0)  # the others take it as running, as after a kill

for number in range(int(sys.argv[1])):
    if not (child := os.fork()):
        hear(number)
    os.waitpid(child, 0)
print("end", flush=True)
"""

DEAF = """
add table netdev cable
add chain netdev cable arriving {{ type filter hook ingress device {device} priority 0; }}
add rule netdev cable arriving drop
"""


def waits_s(log: Path) -> list[float]:
    """Seconds from the start of each new process to the first message of each known one."""
    return [float(line.split()[3]) for line in log.read_text().splitlines() if line.startswith("heard")]


def known(stack: ExitStack, host: Host, peer: str, folder: Path, names: list[str], step_s: float) -> None:
    """Start processes on ``host``, one after the other, until they announce themselves seldom."""
    for name in names:
        log = folder / f"{name}.log"
        stack.enter_context(script(host, TALK, log, open_to(peer), name))
        assert eventually(lambda log=log: "up" in log.read_text()), log.read_text()
        time.sleep(step_s)
    time.sleep(FIRST_ANNOUNCEMENTS_S)


@pytest.mark.ros
@pytest.mark.slow
def test_new_processes_meet_known_ones_at_once(tmp_path: Path) -> None:
    """Fast DDS answers an announcement once, which is lost if the new process does not receive yet."""
    log, new = tmp_path / "new.log", 12
    with two_hosts() as hosts, ExitStack() as stack:
        known(stack, hosts.robot, WORKSTATION, tmp_path, ["a", "b"], 0.0)
        stack.enter_context(script(hosts.robot, HEAR, log, open_to(WORKSTATION), str(new), "2", "30"))
        assert eventually(lambda: "end" in log.read_text()), log.read_text()
        waits = waits_s(log)
        assert len(waits) == 2 * new, log.read_text()
        assert max(waits) < SOON_S, [round(each, 2) for each in sorted(waits)]


@pytest.mark.ros
@pytest.mark.slow
def test_lost_answers_to_a_new_process_are_repeated_soon(tmp_path: Path) -> None:
    """Nothing arrives at the new process for a second, but all that it sends. The others announce themselves in turn.

    If they did so every 10 s, the last one would be heard 7.5 s later at the earliest.
    """
    log, names = tmp_path / "new.log", ["a", "b", "c", "d"]
    with two_hosts() as hosts, ExitStack() as stack:
        known(stack, hosts.robot, WORKSTATION, tmp_path, names, STEP_S)
        hosts.workstation.run("nft", DEAF.format(device=hosts.workstation.device))
        stack.enter_context(script(hosts.workstation, HEAR, log, open_to(ROBOT), "1", str(len(names)), "60"))
        assert eventually(lambda: "up" in log.read_text()), log.read_text()
        time.sleep(1.0)
        assert not waits_s(log)
        hosts.workstation.run("nft", "flush ruleset")
        restored = time.monotonic()
        assert eventually(lambda: "end" in log.read_text()), log.read_text()
        heard = [float(line.split()[-1]) for line in log.read_text().splitlines() if line.startswith("heard")]
        assert len(heard) == len(names), log.read_text()
        assert max(heard) - restored < LATEST_S, [at - restored for at in heard]
