"""RTPS packets in the names of a client and a server, sent from another machine by somebody who knows all their ids."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from socialbot.bridge.environment import DRIVERS_VARIABLE, KEYS_VARIABLE, PROFILE, PROFILE_VARIABLE
from socialbot.bridge.keys import new_key
from tests.system.running import eventually, next_line
from tests.system.two_hosts import CLOSED, ROBOT, WORKSTATION, open_to, script, two_hosts

SERVER = """
import time
import rclpy
from rclpy.action.server import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci
rclpy.init()
node, group = rclpy.create_node("driver"), ReentrantCallbackGroup()
def ask(request, response):
    print("asked", request.data, flush=True)
    if request.data:  # that of the caller, who waits
        time.sleep(3600.0)
    return response
def count(goal):
    print("goal", goal.request.order, bytes(goal.goal_id.uuid).hex(), flush=True)
    while not goal.is_cancel_requested:
        time.sleep(0.05)
    print("cancelled", goal.request.order, flush=True)
    goal.canceled()
    return Fibonacci.Result()
node.create_service(SetBool, "/person", ask, callback_group=group)
ActionServer(node, Fibonacci, "/count", count, callback_group=group, cancel_callback=lambda _: CancelResponse.ACCEPT)
executor = MultiThreadedExecutor(16)
executor.add_node(node)
executor.spin()
"""

CALLER = """
import json, time
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionClient, Client
from tests.bridge.hosting import node_hosts
from tests.system.running import eventually
NAMES = ("rq/personRequest", "rr/personReply", "rq/count/_action/send_goalRequest",
         "rq/count/_action/cancel_goalRequest", "rq/count/_action/get_resultRequest",
         "rr/count/_action/get_resultReply", "rt/count/_action/feedback")
def tell(*words):
    print(*words, flush=True)
class Caller(Node):
    person = Client("std_srvs/srv/SetBool", "/person", deadline_s=3600.0)
    count = ActionClient("test_msgs/action/Fibonacci", "/count")
graph = Graph("calls", (NodeConfig("caller", Caller),), services=frozenset({"/person", "/count"}))
with node_hosts(graph) as host:
    hosted = host("caller")
    services = hosted._services
    ros = hosted.ros_node if services._driver is None else services._driver.ros
    def ids():
        found = {name: ros.get_publishers_info_by_topic(name, True) for name in NAMES}
        return {name: bytes(each[0].endpoint_gid).hex() for name, each in found.items() if each}
    assert eventually(lambda: len(ids()) == len(NAMES) and hosted.active_thread is not None)
    assert eventually(lambda: all(channel.has_server() for channel in services._channels.values()))
    node, soon = hosted.node, hosted.active_thread.queue.call_soon
    soon(lambda: node.person.call({"data": True}, lambda end: tell("answer", end.outcome, end.message)))
    ended, news = lambda end: tell("result", end.outcome, end.message), lambda news: tell("feedback", news)
    soon(lambda: node.count.send_goal({"order": 1}, ended, feedback=news))
    tell("ids", json.dumps(ids()))
    time.sleep(3600)
"""

ATTACKER = """
import itertools, json, socket, struct, sys, time
from evaluation.rtps_attack import DATA, HEADER, HEARTBEAT, ports, submessage
victim, domains, ids, goal = sys.argv[1], *map(json.loads, sys.argv[2:4]), bytes.fromhex(sys.argv[4])
ids = {name: bytes.fromhex(each) for name, each in ids.items()}
def packet(name, number, content, asked=None):
    writer, place = ids[name], struct.pack("<iI", 0, number)
    options = b""
    if asked:  # an answer to the first request of this client
        options = struct.pack("<HH", 0x800F, 24) + ids[asked] + struct.pack("<iI", 0, 1) + struct.pack("<HH", 1, 0)
    head = bytes(4) + writer[12:]
    beat = submessage(HEARTBEAT, head + place + place + struct.pack("<I", number))
    data = struct.pack("<HH", 0, 16) + head + place + options + bytes((0, 1, 0, 0)) + content
    return HEADER + writer[:12] + beat + submessage(DATA, data, flags=7 if asked else 5)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in itertools.count(1000):
    packets = [
        packet("rr/personReply", number, struct.pack("<B3xI9s", 1, 9, b"stranger"), "rq/personRequest"),
        packet("rq/personRequest", number, struct.pack("<B", 0)),
        packet("rt/count/_action/feedback", number, goal + struct.pack("<Ii", 1, 99)),
        packet("rq/count/_action/send_goalRequest", number, bytes(15) + bytes((number % 256,)) + struct.pack("<i", 2)),
    ]
    if number >= 1005:
        packets += [
            packet("rr/count/_action/get_resultReply", number, struct.pack("<b3xIi", 4, 1, 99),
                   "rq/count/_action/get_resultRequest"),
            packet("rq/count/_action/cancel_goalRequest", number, bytes(24)),
        ]
    for domain in domains:
        for port in ports(domain):
            for each in packets:
                sender.sendto(each, (victim, port))
    time.sleep(0.3)
    if number == 1010:
        print("sent", flush=True)
"""


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("guarded", [False, True], ids=["open", "drivers"])
def test_calls_of_drivers_cannot_be_forged_from_another_machine(
    guarded: bool, tmp_path: Path, other_domain: int
) -> None:
    """The open graph shows that the packets do what they should."""
    pytest.importorskip("test_msgs.action")
    new_key("robot", tmp_path / "keys")
    reach = CLOSED if guarded else open_to(WORKSTATION)
    own = dict(reach)
    domains = [int(os.environ["ROS_DOMAIN_ID"])]
    driver = dict(reach)
    if guarded:
        domains.append(other_domain)
        driver |= {PROFILE_VARIABLE: str(PROFILE), "ROS_DOMAIN_ID": str(other_domain)}
        own |= {KEYS_VARIABLE: str(tmp_path / "keys"), DRIVERS_VARIABLE: f"{other_domain}:/person:/count"}
    served, called = tmp_path / "driver.log", tmp_path / "caller.log"
    with two_hosts() as hosts, ExitStack() as scripts:
        scripts.enter_context(script(hosts.robot, SERVER, served, driver))
        scripts.enter_context(script(hosts.robot, CALLER, called, own))
        assert eventually(lambda: "ids " in called.read_text()), called.read_text()
        assert eventually(lambda: "goal 1 " in served.read_text() and "asked True" in served.read_text())
        ids = called.read_text().partition("ids ")[2].splitlines()[0]
        assert len(json.loads(ids)) == 7
        goal = served.read_text().partition("goal 1 ")[2].split()[0]
        root = {"PYTHONPATH": str(Path(__file__).parents[2])}
        attack = (sys.executable, "-c", ATTACKER, ROBOT, json.dumps(domains), ids, goal)
        attacker = hosts.workstation.start(*attack, variables=root, stdout=subprocess.PIPE)
        scripts.callback(attacker.communicate)
        scripts.callback(attacker.kill)
        assert next_line(attacker) == "sent\n"

        def forged() -> set[str]:
            answers, requests = called.read_text(), served.read_text()
            return {
                *(what for what in ("answer", "feedback", "result") if f"\n{what} " in f"\n{answers}"),
                *(what for what in ("asked False", "goal 2", "cancelled") if what in requests),
            }

        if guarded:
            assert not eventually(forged, 3.0), forged()
        else:
            everything = {"answer", "feedback", "result", "asked False", "goal 2", "cancelled"}
            assert eventually(lambda: forged() == everything), (forged(), called.read_text(), served.read_text())
            assert "stranger" in called.read_text()
