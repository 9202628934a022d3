"""Clients of the services that other ROS nodes offer, of a graph or not: for their parameters and lifecycle states."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.bridge.discovery import readable
from socialbot.bridge.environment import executor_of, has_keys, ros_domain
from socialbot.bridge.topics import observer_node, settled
from socialbot.core.errors import GraphError, NodeError, ParameterError, suggestion
from socialbot.core.yaml import load_yaml
from socialbot.graph.ports import TOPIC_NAME

T = TypeVar("T")
C = TypeVar("C", bound="NodeClient")

SETTLE_S = 1.0  # time without news of nodes, after which their list is complete


class NodeClient:
    """Client of other nodes through the rclpy node ``ros``; made by `_client`.

    Its methods wait ``timeout_s`` at most for a node and for each answer. They raise GraphError for an unknown node,
    and NodeError for one without an answer.
    """

    def __init__(self, ros: Any, executor: Any, timeout_s: float) -> None:
        self._ros = ros
        self._executor = executor
        self._timeout_s = timeout_s

    def nodes(self) -> list[str]:
        """The full names of the other nodes, without hidden ones, once no new ones appear."""
        return self._settled(self._nodes, bool)

    def _settled(self, look: Callable[[], T], is_complete: Callable[[T], bool]) -> T:
        """What ``look`` finds once it changes no more and ``is_complete``, or when the time is over."""
        return settled(look, is_complete, SETTLE_S, max(self._timeout_s, SETTLE_S), pause=self._spin)

    def _spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.05)

    def _nodes(self) -> list[str]:
        pairs = readable(self._ros.get_node_names_and_namespaces)
        if pairs is None:
            remedy = "find the program that announces it, and end it"
            raise NodeError("the name of a node is no text", where=f"domain {ros_domain()}", remedy=remedy)
        names = sorted({f"{space.rstrip('/')}/{name}" for name, space in pairs if not name.startswith("_")})
        return [name for name in names if name.rpartition("/")[2] != self._ros.get_name()]

    def _expect_services(self, node: str, are_ready: Callable[[], bool], what: str, remedy: str) -> None:
        """Wait for the services of a node. Raises GraphError or NodeError that it has no ``what``."""
        if self._spin_until(are_ready):
            return
        known = self._nodes()
        if node not in known:
            start = "start it, or use its ROS_DOMAIN_ID"
            remedy = suggestion(node, known) if known else start
            raise GraphError(f"no node {node}", where=f"domain {ros_domain()}", remedy=remedy)
        raise NodeError(f"the node has no {what} services", where=node, remedy=remedy)

    def _answer(self, future: Any, node: str) -> Any:
        if not self._spin_until(future.done):
            remedy = "see the log of the node, or give it more time by --timeout"
            raise NodeError(f"no answer within {self._timeout_s:g} s", where=node, remedy=remedy)
        return future.result()

    def _spin_until(self, holds: Callable[[], bool]) -> bool:
        end = time.monotonic() + self._timeout_s
        while not (held := holds()) and time.monotonic() < end:
            self._spin()
        return held


def full_name(node: str) -> str:
    """The full name of a node, which may be given without its slash. Raises GraphError for an invalid name."""
    full = node if node.startswith("/") else f"/{node}"
    if not TOPIC_NAME.fullmatch(full):
        remedy = "socialbot param list and socialbot lifecycle list show the nodes"
        raise GraphError(f"no valid name of a node: {node!r}", remedy=remedy)
    return full


@contextmanager
def _client(kind: type[C], name: str, timeout_s: float) -> Iterator[C]:
    """Open a client through a hidden rclpy node ``name``. Raises InstallationError without ROS."""
    with observer_node(name) as ros, executor_of(ros) as executor:
        yield kind(ros, executor, timeout_s)


Value = Any
"""Value of a ROS parameter: bool, int, float, str, bytes, a list of one of them, or None."""


@dataclass(frozen=True)
class ParameterInfo:
    """Name, value and description of a parameter of a node, and whether it can be changed."""

    name: str
    value: Value
    doc: str
    fixed: bool


class ParameterClient(NodeClient):
    """Client of the parameter services of other nodes; made by `parameter_client`."""

    def describe(self, node: str) -> list[ParameterInfo]:
        client = self._client(node)
        names = sorted(self._answer(client.list_parameters([], 0), node).result.names)
        return self._read(client, node, names)

    def get(self, node: str, name: str) -> ParameterInfo:
        """One parameter of a node. Raises ParameterError if there is none of this name."""
        client = self._client(node)
        names = self._answer(client.list_parameters([], 0), node).result.names
        if name not in names:
            raise ParameterError(f"no parameter {name!r}", where=node, remedy=suggestion(name, names))
        return self._read(client, node, [name])[0]

    def set(self, node: str, name: str, text: str) -> Value:
        """Set a parameter to the value written in ``text`` (YAML) and return it.

        Raises:
            ParameterError: There is no such parameter, the value has another type, or the node refuses it.
        """
        from rclpy.parameter import Parameter as RosParameter

        before = self.get(node, name)
        value = parse_value(text, before.value, where=f"{node}.{name}")
        client = self._client(node)
        made = RosParameter(name, value=value)
        (result,) = self._answer(client.set_parameters([made]), node).results
        if not result.successful:
            fixed = "set it before the node starts: in the graph file, or by --set"
            remedy = fixed if before.fixed else before.doc or "see the log of the node"
            raise ParameterError(result.reason or "the node refuses it", where=f"{node}.{name}", remedy=remedy)
        return value

    def _client(self, node: str) -> Any:
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(self._ros, full_name(node))
        keys = "with keys, nodes of socialbot have none: set them in the graph file, or by --set"
        remedy = keys if has_keys() else "only ROS 2 nodes with parameter services can be asked"
        self._expect_services(full_name(node), client.services_are_ready, "parameter", remedy)
        return client

    def _read(self, client: Any, node: str, names: Sequence[str]) -> list[ParameterInfo]:
        from rclpy.parameter import parameter_value_to_python

        if not names:
            return []
        values = self._answer(client.get_parameters(list(names)), node).values
        described = self._answer(client.describe_parameters(list(names)), node).descriptors
        return [
            ParameterInfo(name, _python(parameter_value_to_python(value)), each.description, each.read_only)
            for name, value, each in zip(names, values, described, strict=True)
        ]


def parameter_client(*, timeout_s: float = 5.0) -> AbstractContextManager[ParameterClient]:
    """Open a client for the parameters of running nodes. Raises InstallationError without ROS."""
    return _client(ParameterClient, "_param", timeout_s)


def set_parameter(node: str, name: str, value: Value) -> Value:
    """Set a parameter of a running node and return its value. Raises what `ParameterClient` does."""
    text = value if isinstance(value, str) else json.dumps(value)
    with parameter_client() as client:
        return client.set(node, name, text)


def _python(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def parse_value(text: str, before: Any, *, where: str) -> Any:
    """Read a value of the type of ``before`` from YAML; a text is taken as it is.

    Raises:
        ParameterError: The value has another type.
    """
    if isinstance(before, str):
        return text
    try:
        value: Any = load_yaml(YAML(typ="safe", pure=True), text)
    except YAMLError as error:
        raise ParameterError(f"{text!r} is not valid YAML", where=where) from error
    if isinstance(before, float) and type(value) is int:
        value = float(value)
    several = isinstance(before, Sequence) and not isinstance(before, bytes)
    if several and isinstance(value, list):
        present: list[Any] = list(cast("Sequence[Any]", before))
        decimal = any(isinstance(each, float) for each in present)
        items = [float(each) if decimal and type(each) is int else each for each in value]
        if len({type(each) for each in (*items, *present)}) <= 1:
            return items
    elif before is None or type(value) is type(before):
        return value
    kind = "a list of one type" if several else f"of type {type(before).__name__}"
    raise ParameterError(f"{text!r} is not {kind}", where=where, remedy=f"its present value is {before!r}")


_GET_STATE = "lifecycle_msgs/srv/GetState"


class LifecycleClient(NodeClient):
    """Client of the lifecycle services of other nodes; made by `lifecycle_client`."""

    def managed_nodes(self) -> list[str]:
        """The full names of the nodes with lifecycle services."""

        def are_known(offered: dict[str, dict[str, list[str]] | None]) -> bool:
            return bool(offered) and None not in offered.values()

        offered = self._settled(lambda: {node: self._services(node) for node in self._nodes()}, are_known)
        return [node for node, each in offered.items() if _GET_STATE in (each or {}).get(f"{node}/get_state", ())]

    def _services(self, node: str) -> dict[str, list[str]] | None:
        """Services of a node with their types; None while neither its services nor its topics are known."""
        space, _, name = node.rpartition("/")
        try:
            services = dict(self._ros.get_service_names_and_types_by_node(name, space or "/"))
            topics = self._ros.get_publisher_names_and_types_by_node(name, space or "/")
        except (UnicodeDecodeError, RuntimeError):  # a name is no text, or the node has ended meanwhile
            return {}
        return services if services or topics else None

    def state(self, node: str) -> str:
        """The state of a node, such as ``active``."""
        from lifecycle_msgs.srv import GetState

        return str(self._call(node, "get_state", GetState).current_state.label)

    def transitions(self, node: str) -> dict[str, str]:
        """The transitions that a node can take now, with the states they lead to."""
        from lifecycle_msgs.srv import GetAvailableTransitions

        found = self._call(node, "get_available_transitions", GetAvailableTransitions).available_transitions
        return {each.transition.label: each.goal_state.label for each in found}

    def change(self, node: str, transition: str) -> str:
        """Request a transition and return the state after it.

        Raises:
            NodeError: The transition is not possible in this state, or the node refuses it.
        """
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions

        found = self._call(node, "get_available_transitions", GetAvailableTransitions).available_transitions
        ids = {each.transition.label: each.transition.id for each in found}
        if transition not in ids:
            what = f"no transition {transition!r} from {self.state(node)}"
            raise NodeError(what, where=full_name(node), remedy=suggestion(transition, ids))
        request = ChangeState.Request(transition=Transition(id=ids[transition], label=transition))
        if not self._call(node, "change_state", ChangeState, request).success:
            what = f"the node failed to {transition}, and is {self.state(node)}"
            raise NodeError(what, where=full_name(node), remedy="see the log of the node")
        return self.state(node)

    def _call(self, node: str, service: str, kind: Any, request: Any = None) -> Any:
        full = full_name(node)
        client = self._ros.create_client(kind, f"{full}/{service}")
        try:
            keys = "with keys, nodes of socialbot have none: restart their graph"
            remedy = keys if has_keys() else "only managed nodes (ROS 2 lifecycle nodes) have states"
            self._expect_services(full, client.service_is_ready, "lifecycle", remedy)
            return self._answer(client.call_async(request or kind.Request()), full)
        finally:
            self._ros.destroy_client(client)


def lifecycle_client(*, timeout_s: float = 5.0) -> AbstractContextManager[LifecycleClient]:
    """Open a client for the lifecycle of running nodes. Raises InstallationError without ROS."""
    return _client(LifecycleClient, "_lifecycle", timeout_s)
