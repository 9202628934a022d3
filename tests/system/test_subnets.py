"""Machines in two subnets find each other by their addresses, without multicast."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from evaluation import hosts
from socialbot.bridge.environment import Across, prepare
from tests.system.running import eventually
from tests.system.two_hosts import ROBOT, script

MEET = """
import sys, threading, time
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String
kept = []
for number in range(8):
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node(f"{sys.argv[1]}_{number}", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    if sys.argv[1] == "talker":
        publisher = node.create_publisher(String, f"/topic_{number}", 10)
        node.create_timer(0.2, lambda publisher=publisher: publisher.publish(String(data="word")))
    else:
        hear = lambda _, number=number: print(number, flush=True)
        kept.append(node.create_subscription(String, f"/topic_{number}", hear, 10))
    threading.Thread(target=executor.spin, daemon=True).start()
    kept += [context, executor]
time.sleep(3600)
"""


@pytest.mark.ros
@pytest.mark.slow
def test_many_processes_find_each_other_through_a_router(tmp_path: Path) -> None:
    if reason := hosts.obstacle():
        pytest.skip(f"no hosts: {reason}")
    heard = tmp_path / "hearer.log"

    def variables(peer: str) -> dict[str, str]:
        made: dict[str, str] = {}
        prepare(made, domain=0, log_folder=tmp_path, across=Across(peers=(peer,)))
        return made

    with hosts.routed_hosts() as both, ExitStack() as scripts:
        talker = variables(hosts.FAR_WORKSTATION)
        scripts.enter_context(script(both.robot, MEET, tmp_path / "talker.log", talker, "talker"))
        scripts.enter_context(script(both.workstation, MEET, heard, variables(ROBOT), "hearer"))
        assert eventually(lambda: {str(number) for number in range(8)} <= set(heard.read_text().split())), (
            heard.read_text()[-500:]
        )
