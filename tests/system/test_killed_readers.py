"""A killed subscriber does not block its publishers; with shared memory it does, once in twenty kills."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.slow]

KILLS = 40

SPEAKER = """
import sys, time
from std_msgs.msg import String
from socialbot.bridge.environment import spinning_node
longest = 0.0
with spinning_node("speaker") as ros:
    publisher = ros.create_publisher(String, "/said", 10)
    end = time.monotonic() + float(sys.argv[1])
    heard = 0
    while time.monotonic() < end:
        begin = time.monotonic()
        publisher.publish(String(data="x" * 150))
        longest = max(longest, time.monotonic() - begin)
        heard += bool(publisher.get_subscription_count())
        time.sleep(0.004)
print(longest, heard)
"""

LISTENER = """
import os
from socialbot.bridge.process import run_nodes
from socialbot.graph.node import Graph, Input, Node, NodeConfig
from socialbot.core.messages import Utterance

class Listener(Node):
    said = Input(Utterance, "/said")

    @said
    def on_said(self, message):
        pass

graph = Graph("listening", (NodeConfig("listener", Listener),), inputs=frozenset({"/said"}))
run_nodes(graph, ["listener"], sim_time=False, parent=os.getppid())
"""


def test_killed_subscribers_do_not_block_publishers() -> None:
    life_s = 2.5
    speakers = [
        subprocess.Popen(
            [sys.executable, "-c", SPEAKER, str(KILLS * (life_s + 0.2))], stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    for number in range(KILLS):
        listener = subprocess.Popen([sys.executable, "-c", LISTENER], stderr=subprocess.PIPE)
        time.sleep(life_s + 0.003 * number)
        assert listener.poll() is None, listener.communicate()[1].decode()
        listener.kill()
        listener.communicate()
    told = [speaker.communicate()[0].split() for speaker in speakers]
    assert all(int(heard) > 1000 for _, heard in told), "they were listened to"
    assert max(float(longest) for longest, _ in told) < 0.6
