"""Processes that stand still for a while are heard again, such as stopped ones, or all on a busy machine."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.running import eventually

STOPPED_S = 21.0, 40.0
"""Longer than DDS waits for an announcement by default, 20 s."""
BEGIN_S = 15.0
PEERS = 8

PEER = """
import signal, sys, time
from std_msgs.msg import String
from socialbot.bridge.environment import prepare, spinning_node
prepare()
signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # killed, it would leave its shared memory behind
name, path = sys.argv[1:]
heard = {}
with spinning_node(name) as ros:
    publisher = ros.create_publisher(String, "/known", 100)
    others = [ros.create_publisher(String, f"/{name}/n{number}", 1) for number in range(30)]  # as nodes have
    ros.create_subscription(String, "/known", lambda one: heard.update({one.data: time.monotonic()}), 100)
    while True:
        publisher.publish(String(data=name))
        with open(path, "w") as file:
            file.write(" ".join(sorted(who for who, at in heard.items() if at > time.monotonic() - 2.0)) + " .")
        time.sleep(0.2)
"""


@pytest.mark.ros
@pytest.mark.slow
def test_processes_that_stood_still_hear_each_other_again(tmp_path: Path) -> None:
    """Each stands still at other times, so some would forget others that remember them. DDS takes minutes for that."""
    names = [f"peer{number}" for number in range(PEERS)]
    everybody = " ".join(names) + " ."

    def are_complete() -> bool:
        texts = [(tmp_path / name).read_text() for name in names if (tmp_path / name).exists()]
        return texts == [everybody] * PEERS

    with ExitStack() as stack:
        peers = []
        for name in names:
            peers.append(subprocess.Popen([sys.executable, "-c", PEER, name, tmp_path / name]))
            stack.callback(peers[-1].wait)
            stack.callback(peers[-1].terminate)
            stack.callback(peers[-1].send_signal, signal.SIGCONT)
        assert eventually(are_complete)
        chance = random.Random(1)
        signals = []
        for number in range(PEERS - 1):
            at, during = chance.uniform(0.0, BEGIN_S), chance.uniform(*STOPPED_S)
            signals += [(at, number, signal.SIGSTOP), (at + during, number, signal.SIGCONT)]
        begun = time.monotonic()
        for at, number, kind in sorted(signals):
            time.sleep(max(0.0, begun + at - time.monotonic()))
            peers[number].send_signal(kind)
        for name in names:
            (tmp_path / name).unlink()
        assert eventually(are_complete), [(tmp_path / name).read_text() for name in names]
