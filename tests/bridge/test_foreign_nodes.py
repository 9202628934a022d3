"""``socialbot lifecycle`` and the watches of ``needs`` on managed nodes of plain rclpy in a process of their own."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from time import sleep
from typing import Any

import pytest
from typer.testing import CliRunner

from socialbot.agents.base.foreign_node import ForeignNodeState
from socialbot.bridge.node_services import SETTLE_S, lifecycle_client
from socialbot.cli.lifecycle import lifecycle
from socialbot.core.errors import GraphError, NodeError
from socialbot.graph.files import parse_graph
from socialbot.graph.node import Node
from socialbot.graph.ports import Input
from tests.bridge.hosting import foreign_process, node_hosts
from tests.system.running import eventually

NODE = f"{__name__}:Agent"


class Agent(Node):
    """Keeps the states of the driver."""

    driver = Input(ForeignNodeState, "/lidar_driver_watch/state")
    seen: tuple[ForeignNodeState, ...] = ()

    @driver
    def on_driver(self, message: ForeignNodeState) -> None:
        self.seen += (message,)

    @property
    def states(self) -> list[str]:
        return [each.state for each in self.seen]


def foreign_nodes(*names: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """Nodes in another process; they end with the block."""
    return foreign_process("tests.bridge.foreign_lifecycle", *names)


@contextmanager
def watched(needs: str) -> Iterator[Any]:
    """The agent with a watch of /lidar_driver."""
    graph = parse_graph(
        f"name: robot\nnodes: {{agent: {{type: '{NODE}'}}}}\nneeds: {{/lidar_driver: {needs}}}\n", where="test"
    )
    with node_hosts(graph) as host:
        agent, watch = host("agent"), host("lidar_driver_watch")
        assert eventually(lambda: agent.active_thread is not None and watch.active_thread is not None)
        yield agent.node


def last(agent: Agent, holds: Callable[[ForeignNodeState], bool]) -> bool:
    return eventually(lambda: bool(agent.seen) and holds(agent.seen[-1]), timeout_s=20.0)


def socialbot_lifecycle(*arguments: str) -> str:
    result = CliRunner().invoke(lifecycle, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


@pytest.mark.slow
def test_states_of_a_foreign_node_are_printed_and_changed():
    with foreign_nodes("lidar_driver", "plain"):
        assert socialbot_lifecycle("get", "lidar_driver") == "unconfigured\n"
        assert socialbot_lifecycle("set", "/lidar_driver", "configure") == "inactive\n"
        listed = socialbot_lifecycle("list")
        assert [line.split() for line in listed.splitlines() if line.startswith(" ") or "/" in line] == [
            ["/lidar_driver", "inactive"]
        ]
        transitions = socialbot_lifecycle("list", "lidar_driver")
        assert "activate" in transitions
        assert "cleanup" in transitions
        assert "deactivate" not in transitions
        assert socialbot_lifecycle("set", "lidar_driver", "activate") == "active\n"


def test_a_node_that_appears_late_is_listed(other_domain: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))  # a killed node of another test stays listed for seconds
    with lifecycle_client(timeout_s=60.0) as client, ThreadPoolExecutor() as pool:
        found = pool.submit(client.managed_nodes)
        sleep(1.5 * SETTLE_S)
        with foreign_nodes():
            assert found.result() == ["/lidar_driver"]


@pytest.mark.slow
def test_refusals_name_the_node_and_a_remedy():
    # Missing services and nodes take the whole time limit. Others answer sooner, also on a busy machine.
    with foreign_nodes("broken_driver", "plain"), lifecycle_client(timeout_s=10.0) as client:
        with pytest.raises(NodeError, match="/broken_driver: the node failed to configure, and is unconfigured"):
            client.change("broken_driver", "configure")
        with pytest.raises(NodeError, match=r"no transition 'activat' from unconfigured\n.*configure"):
            client.change("broken_driver", "activat")
        with pytest.raises(NodeError, match=r"/plain: the node has no lifecycle services\n.*managed nodes"):
            client.state("plain")
        with pytest.raises(GraphError, match=r"no node /broken_drive\n.*did you mean '/broken_driver'"):
            client.state("broken_drive")


def test_node_is_brought_to_the_needed_state_and_back_to_it():
    with foreign_nodes(), watched("{state: active, manage: true}") as agent:
        assert last(agent, lambda state: state.state == "active" and state.ready)
        assert agent.states[-3:] == ["unconfigured", "inactive", "active"]
        socialbot_lifecycle("set", "lidar_driver", "deactivate")
        assert eventually(lambda: agent.states[-2:] == ["inactive", "active"])


@pytest.mark.slow
def test_needed_state_is_reported_but_not_requested_by_default():
    with foreign_nodes(), watched("{state: active}") as agent:
        assert last(agent, lambda state: state.reason == "/lidar_driver is unconfigured, not active")
        assert socialbot_lifecycle("get", "lidar_driver") == "unconfigured\n"


@pytest.mark.slow
@pytest.mark.parametrize("needs", ["{state: unconfigured}", "{}"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP, signal.SIGINT])
def test_node_that_ends_or_hangs_is_lost_and_its_successor_is_found(needs: str, end: signal.Signals):
    with watched(needs) as agent:
        with foreign_nodes() as process:
            assert last(agent, lambda state: state.ready)
            process.send_signal(end)
            assert last(agent, lambda state: state.state == "lost" and not state.ready)
            assert agent.seen[-1].reason.startswith("/lidar_driver ")
        with foreign_nodes():
            assert last(agent, lambda state: state.ready)


@pytest.mark.slow
def test_node_that_never_appears_is_lost():
    with watched("{}") as agent:
        assert last(agent, lambda state: state.state == "lost")
        assert agent.seen[-1].reason == "/lidar_driver is not running"


@pytest.mark.slow
def test_failed_transition_is_reported():
    with foreign_nodes("broken_driver"):
        text = "name: robot\nnodes: {}\nneeds: {broken_driver: {state: active, manage: true}}\n"
        with node_hosts(parse_graph(text, where="test")) as host:
            hosted = host("broken_driver_watch")
            assert eventually(lambda: hosted.active_thread is not None)
            wanted = "/broken_driver failed to configure: see its log"
            assert eventually(lambda: hosted.node._published is not None and hosted.node._published.reason == wanted)
