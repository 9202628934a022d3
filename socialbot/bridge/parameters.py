"""Parameters of running nodes, of a graph or of others, by their parameter services."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.bridge._node_client import NodeClient, full_name, observer
from socialbot.bridge.environment import has_keys
from socialbot.core.errors import ParameterError, suggestion
from socialbot.core.yaml import load_yaml

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
        """The parameters of a node by name."""
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


@contextmanager
def parameter_client(*, timeout_s: float = 5.0) -> Iterator[ParameterClient]:
    """Open a client for the parameters of running nodes. Raises InstallationError without ROS."""
    with observer("_param") as (ros, executor):
        yield ParameterClient(ros, executor, timeout_s)


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
