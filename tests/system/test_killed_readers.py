"""A killed subscriber does not block its publishers; with shared memory it does, once in twenty kills."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.running import eventually

pytestmark = [pytest.mark.ros, pytest.mark.slow]

KILLS = 40
RECEIVING_S = 1.0
"""Time (s) for which a subscriber receives before it is killed, at least."""

SPEAKER = """
import time
from rclpy.event_handler import PublisherEventCallbacks
from std_msgs.msg import String
from socialbot.bridge._node_thread import Stopwatch
from socialbot.bridge.environment import spinning_node
longest = 0.0
def matched(info):
    print("heard by", info.total_count, flush=True)
with spinning_node("speaker") as ros:
    events = PublisherEventCallbacks(matched=matched)
    publisher = ros.create_publisher(String, "/said", 10, event_callbacks=events)
    while True:
        watch = Stopwatch()
        publisher.publish(String(data="x" * 150))
        blocked_s = watch.seconds()[1]  # without the time for which it waited for a processor
        if blocked_s > longest:
            longest = blocked_s
            print("blocked", longest, flush=True)
        time.sleep(0.004)
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


def test_killed_subscribers_do_not_block_publishers(tmp_path: Path) -> None:
    logs = [tmp_path / f"speaker{number}" for number in range(3)]
    with ExitStack() as ends:
        for log in logs:
            speaker = subprocess.Popen([sys.executable, "-c", SPEAKER], stdout=ends.enter_context(log.open("w")))
            ends.callback(speaker.wait)
            ends.callback(speaker.kill)
        for number in range(KILLS):
            listener = subprocess.Popen([sys.executable, "-c", LISTENER], stderr=subprocess.PIPE)
            ends.callback(listener.kill)

            is_heard = f"heard by {number + 1}\n"
            assert eventually(lambda is_heard=is_heard: all(is_heard in log.read_text() for log in logs))
            time.sleep(RECEIVING_S + 0.003 * number)
            assert listener.poll() is None, listener.communicate()[1].decode()
            listener.kill()
            listener.communicate()
        longest = [float(log.read_text().rpartition("blocked ")[2].split()[0]) for log in logs]
    assert max(longest) < 0.6
