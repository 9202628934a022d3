"""A stranger on another machine who knows the address of the robot, against a graph of one machine."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.running import eventually
from tests.system.two_hosts import CLOSED, ROBOT, WORKSTATION, open_to, script, two_hosts

pytestmark = pytest.mark.ros

TALK = """
import sys, time
from std_msgs.msg import String
from socialbot.bridge.environment import spinning_node
with spinning_node("talker") as ros:
    publisher = ros.create_publisher(String, "/said", 10)
    while True:
        publisher.publish(String(data=sys.argv[1]))
        time.sleep(0.02)
"""
HEAR = """
import time
from std_msgs.msg import String
from socialbot.bridge.environment import spinning_node
with spinning_node("hearer") as ros:
    heard = ros.create_subscription(String, "/said", lambda message: print(message.data, flush=True), 10)
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_closed_graph_receives_nothing_from_outside(tmp_path: Path) -> None:
    """An open graph next to it receives the messages, which proves that they were sent."""
    closed, opened = tmp_path / "closed.log", tmp_path / "open.log"
    with two_hosts() as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, HEAR, closed, CLOSED))
        scripts.enter_context(script(hosts.robot, HEAR, opened, open_to(WORKSTATION)))
        scripts.enter_context(script(hosts.robot, TALK, tmp_path / "friend.log", CLOSED, "friend"))
        scripts.enter_context(script(hosts.workstation, TALK, tmp_path / "stranger.log", open_to(ROBOT), "stranger"))
        assert eventually(lambda: opened.read_text().count("stranger") > 100), opened.read_text()
        assert eventually(lambda: closed.read_text().count("friend") > 100), closed.read_text()
        assert "stranger" not in closed.read_text()
