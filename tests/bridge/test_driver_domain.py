"""Commands for drivers that cannot verify seals."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from socialbot.bags.codec import encode
from socialbot.bridge.driver_domain import driver_domain
from socialbot.bridge.environment import DRIVERS_VARIABLE, KEYS_VARIABLE, spinning_node
from socialbot.bridge.keys import new_key
from socialbot.bridge.transport import RclpyTypes, open_transport
from socialbot.core.errors import GraphError, ParameterError
from socialbot.graph.calls import CallResult
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionClient, Client
from tests.bridge.hosting import foreign_process, has_receivers, node_hosts, spinning_nodes
from tests.bridge.test_strangers_standard import CASES, Intruder, nodes_of
from tests.runtime.deployments import deployment
from tests.system.running import eventually, next_line
from tests.system.two_hosts import CLOSED, ROBOT, WORKSTATION, open_to, script, two_hosts

TOPIC = "/head_controller/joint_trajectory"


@contextmanager
def driver_node(domain: int) -> Iterator[Any]:
    """An rclpy node in ``domain``, spun by the caller's process."""
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions

    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("driver", context=context, start_parameter_services=False)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.ros
def test_a_driver_receives_commands_of_the_guarded_node_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other_domain: int
) -> None:
    from rclpy.executors import SingleThreadedExecutor

    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))
    monkeypatch.setenv(DRIVERS_VARIABLE, f"{other_domain}:/standard")
    case = CASES["trajectory"]
    ros_class = open_transport().message_class(case.kind)
    with driver_node(other_domain) as driver, node_hosts(nodes_of(case)) as host, ExitStack() as stack:
        received: list[float] = []
        driver.create_subscription(ros_class, "/standard", lambda one: received.append(one.points[0].positions[0]), 10)
        executor = SingleThreadedExecutor(context=driver.context)
        executor.add_node(driver)
        stack.callback(executor.shutdown)

        def soon(state) -> bool:
            return eventually(lambda: executor.spin_once(timeout_sec=0.05) or state(), 20.0)

        source, sink = host("source"), host("sink")
        stranger = Intruder(stack.enter_context(spinning_node("intruder")), "/standard", ros_class)
        assert soon(lambda: source._senders["out"].drivers.publisher.get_subscription_count() == 1)
        assert soon(stranger.is_connected)
        assert soon(lambda: has_receivers(source, "out", 2))
        stranger.messages.publish(encode(case.make(2), RclpyTypes()))
        source.node.context.call_soon(lambda: source.node.out.publish(case.make(1)))
        assert soon(lambda: received == [1.0] and sink.node.got == [1])
        source.clean_up()
        assert soon(lambda: driver.count_publishers("/standard") == 0)


class Caller(Node):
    """Calls a service and an action of drivers."""

    light = Client("std_srvs/srv/SetBool", "/light", deadline_s=30.0)
    count = ActionClient("test_msgs/action/Fibonacci", "/count")
    results: tuple[CallResult, ...] = ()

    def on_result(self, result: CallResult) -> None:
        self.results += (result,)


@pytest.mark.ros
def test_services_and_actions_of_drivers_are_called_in_their_domain_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other_domain: int
) -> None:
    """A stranger in the domain of the graph offers the same, and gets no request and no goal."""
    new_key("robot", tmp_path / "keys")
    own = os.environ["ROS_DOMAIN_ID"]
    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))
    with foreign_process("tests.bridge.foreign_servers") as driver:
        monkeypatch.setenv("ROS_DOMAIN_ID", own)
        with foreign_process("tests.bridge.foreign_servers"):
            monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))
            monkeypatch.setenv(DRIVERS_VARIABLE, f"{other_domain}:/light:/count")
            services = frozenset({"/light", "/count"})
            graph = Graph("calls", (NodeConfig("caller", Caller),), services=services)
            with node_hosts(graph) as host, spinning_nodes("onlooker") as (onlooker,):
                hosted = host("caller")
                assert eventually(lambda: hosted.active_thread is not None)
                call_soon, node = hosted.active_thread.queue.call_soon, hosted.node
                assert eventually(lambda: onlooker.count_services("/light") == 1)
                assert onlooker.count_clients("/light") == 0
                call_soon(lambda: node.light.call({"data": True}, node.on_result))
                assert eventually(lambda: len(node.results) == 1)
                call_soon(lambda: node.count.send_goal({"order": 2}, node.on_result))
                assert eventually(lambda: len(node.results) == 2)
                light, count = node.results
                assert (light.outcome, light.message.success, light.message.message) == ("succeeded", True, "")
                assert (count.outcome, list(count.message.sequence)) == ("succeeded", [2, 1])

                kept = []
                call_soon(lambda: kept.append(node.count.send_goal({"order": 100}, node.on_result)))
                assert eventually(lambda: kept and kept[0].accepted)
                hosted.transition_to("inactive")
                assert next_line(driver) == "cancelled\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/a", "not another ROS domain"),
        ("233:/a", "not another ROS domain"),
        ("7:/a", "not another ROS domain"),
        ("²:/a", "not another ROS domain"),
        ("9" * 5000 + ":/a", "not another ROS domain"),
        ("43", "no topics"),
        ("43:head", "not a full topic name"),
    ],
)
def test_wrong_domains_and_topics_are_refused(text: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        driver_domain({DRIVERS_VARIABLE: text, "ROS_DOMAIN_ID": "7"})


def test_a_deployment_names_the_domain_of_drivers() -> None:
    from socialbot.runtime.machine import enter

    read = deployment(("{keys: keys}", f"{{keys: keys, drivers: {{domain: 43, topics: [{TOPIC}]}}}}"))
    variables: dict[str, str] = {}
    enter(read, "robot", variables)
    found = driver_domain(variables)
    assert found is not None
    assert (found.domain, found.topics) == (43, {TOPIC})


@pytest.mark.parametrize(
    ("drivers", "message"),
    [
        ("{domain: 43}", "'topics' is missing"),
        (f"{{domain: 42, topics: [{TOPIC}]}}", "42 is the domain of the graph"),
        ("{domain: 43, topics: [/head/command]}", "not a topic of a standard type"),
        ("{domain: 43, topics: [/camera/image_raw, /nowhere]}", "not a topic of a standard type"),
        ("{domain: 43, topics: []}", "no topics"),
    ],
)
def test_mistakes_in_a_deployment_are_named(drivers: str, message: str) -> None:
    with pytest.raises(GraphError, match=message):
        deployment(("{keys: keys}", f"{{keys: keys, drivers: {drivers}}}"))


COMMAND = """
import sys, time
from trajectory_msgs.msg import JointTrajectory
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import open_transport
from socialbot.core.messages import JointTrajectory as Command
with spinning_node(sys.argv[1]) as ros:
    sender = open_transport().advertise(ros, "/joints", Command)
    while True:
        sender.publish(Command(stamp=1, joint_names=(sys.argv[1],), positions=(0.0,), velocities=(), duration_s=1.0))
        time.sleep(0.02)
"""
DRIVER = """
import time
from trajectory_msgs.msg import JointTrajectory
from socialbot.bridge.environment import spinning_node
with spinning_node("driver") as ros:
    ros.create_subscription(JointTrajectory, "/joints", lambda one: print(one.joint_names[0], flush=True), 10)
    time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.ros
def test_a_stranger_on_the_network_does_not_reach_a_driver(tmp_path: Path, other_domain: int) -> None:
    """An open subscriber in the same domain receives the stranger, which proves that the messages were sent."""
    driver, opened = tmp_path / "driver.log", tmp_path / "open.log"
    graph = {DRIVERS_VARIABLE: f"{other_domain}:/joints"}
    drivers = {"ROS_DOMAIN_ID": str(other_domain)}
    with two_hosts() as hosts, ExitStack() as scripts:
        for host, text, log, variables, *arguments in (
            (hosts.robot, DRIVER, driver, CLOSED | drivers),
            (hosts.robot, DRIVER, opened, open_to(WORKSTATION) | drivers),
            (hosts.robot, COMMAND, tmp_path / "robot.log", open_to(WORKSTATION) | graph, "robot"),
            (hosts.workstation, COMMAND, tmp_path / "stranger.log", open_to(ROBOT) | drivers, "stranger"),
        ):
            scripts.enter_context(script(host, text, log, variables, *arguments))
        assert eventually(lambda: opened.read_text().count("stranger") > 100), opened.read_text()
        assert eventually(lambda: driver.read_text().count("robot") > 100), driver.read_text()
        assert "stranger" not in driver.read_text()
