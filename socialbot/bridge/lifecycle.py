"""Lifecycle states of running managed nodes, of a graph or of others, by their lifecycle services."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from socialbot.bridge._node_client import NodeClient, full_name, observer
from socialbot.bridge.environment import has_keys
from socialbot.core.errors import NodeError, suggestion

_GET_STATE = "lifecycle_msgs/srv/GetState"


class LifecycleClient(NodeClient):
    """Client of the lifecycle services of other nodes; made by `lifecycle_client`."""

    def managed_nodes(self) -> list[str]:
        """The full names of the nodes with lifecycle services."""
        found: list[str] = []
        for node in self.nodes():
            name, space = node.rpartition("/")[2], node.rpartition("/")[0] or "/"
            services = dict(self._ros.get_service_names_and_types_by_node(name, space))
            if _GET_STATE in services.get(f"{node}/get_state", ()):
                found.append(node)
        return found

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


@contextmanager
def lifecycle_client(*, timeout_s: float = 5.0) -> Iterator[LifecycleClient]:
    """Open a client for the lifecycle of running nodes. Raises InstallationError without ROS."""
    with observer("_lifecycle") as (ros, executor):
        yield LifecycleClient(ros, executor, timeout_s)
