"""``socialbot param`` on nodes of a graph and on foreign nodes."""

from __future__ import annotations

from typing import Any

import pytest
from typer.testing import CliRunner

from socialbot.bridge.node_services import lifecycle_client, parameter_client, parse_value
from socialbot.cli.param import param
from socialbot.core.errors import GraphError, NodeError, ParameterError
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Parameter
from tests.bridge.hosting import node_hosts
from tests.bridge.test_services import foreign_servers
from tests.system.running import eventually


class Guard(Node):
    """A node with parameters."""

    share = Parameter(0.5, "share that counts", minimum=0.0, maximum=1.0)
    name_of = Parameter("anna", "whom to guard")
    device = Parameter(3, "number of the device", fixed=True)


GRAPH = Graph("guard", (NodeConfig("guard", Guard),))


def socialbot_param(*arguments: str) -> str:
    result = CliRunner().invoke(param, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def test_parameters_of_a_graph_are_listed_and_set():
    with node_hosts(GRAPH) as host:
        hosted = host("guard")
        assert eventually(lambda: hosted.active_thread is not None)
        assert "/guard" in socialbot_param("list").split()
        listed = socialbot_param("list", "guard")
        assert "share" in listed
        assert "share that counts" in listed
        assert "number of the device (fixed)" in listed
        assert socialbot_param("set", "guard", "share", "1") == "1.0\n"
        assert hosted.node.share == 1.0
        assert socialbot_param("set", "/guard", "name_of", "12") == "12\n"
        assert socialbot_param("get", "guard", "name_of") == "12\n"
        with parameter_client() as client:
            with pytest.raises(ParameterError, match=r"guard.share"):
                client.set("guard", "share", "1.5")
            with pytest.raises(ParameterError, match=r"guard.share: 'much' is not of type float"):
                client.set("guard", "share", "much")
            with pytest.raises(ParameterError, match="set it before the node starts"):
                client.set("guard", "device", "4")
            with pytest.raises(ParameterError, match="no parameter 'shar'"):
                client.get("guard", "shar")
        assert hosted.node.share == 1.0


def test_parameters_of_a_foreign_node_are_set():
    with foreign_servers(), parameter_client() as client:
        assert client.get("servers", "gains").value == [1.0, 2.0]
        client.set("servers", "gains", "[1, 3.5, 2]")
        client.set("servers", "mode", "false")
        assert client.get("servers", "gains").value == [1.0, 3.5, 2.0]
        assert client.get("servers", "mode").value is False


@pytest.mark.parametrize("name", ["a b", "", "/", "a//b", "~", "{x}", "1a", "a\n", "a" * 300])
def test_names_that_no_node_can_have_are_refused(name):
    with parameter_client(timeout_s=1.0) as client, pytest.raises(GraphError, match="no valid name of a node: "):
        client.describe(name)
    with lifecycle_client(timeout_s=1.0) as client, pytest.raises(GraphError, match="no valid name of a node: "):
        client.state(name)


def test_missing_node_and_missing_services_are_named(monkeypatch):
    from rclpy.node import Node as RosNode

    from socialbot.bridge.environment import ros_context

    with ros_context() as context:
        mute = RosNode("mute", context=context, start_parameter_services=False)
        with parameter_client(timeout_s=1.0) as client:
            with pytest.raises(GraphError, match=r"no node /mut\n.*did you mean '/mute'"):
                client.describe("mut")
            with pytest.raises(NodeError, match="/mute: the node has no parameter services"):
                client.describe("mute")
        mute.destroy_node()


def test_a_list_of_nodes_that_always_changes_is_shown():
    """A stranger announces ever other names."""
    names = iter(str(number) for number in range(100))
    with parameter_client(timeout_s=0.2) as client:
        assert client._settled(lambda: next(names), bool)


@pytest.mark.parametrize(
    ("text", "before", "value"),
    [
        ("3", 1.0, 3.0),
        ("on", "off", "on"),
        ("true", False, True),
        ("[a, b]", ["c"], ["a", "b"]),
        ("[1, 2]", [0.5], [1.0, 2.0]),
        ("7", None, 7),
    ],
)
def test_value_gets_the_type_of_the_present_one(text, before, value):
    found: Any = parse_value(text, before, where="node.name")
    assert (found, repr(found)) == (value, repr(value))


@pytest.mark.parametrize(
    ("text", "before"), [("1", True), ("1.5", 3), ("a", 1.0), ("[a, 1]", ["a"]), ("3", [1]), ("[", 1)]
)
def test_value_of_another_type_is_refused(text, before):
    with pytest.raises(ParameterError, match=r"node\.name: "):
        parse_value(text, before, where="node.name")
