"""Hosts of nodes in the process of the tests."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from socialbot.graph.node import Graph


@contextmanager
def node_hosts(graph: Graph, *ros_args: str, **options: Any) -> Iterator[Callable[[str], Any]]:
    """A function that hosts and starts a node of ``graph`` by its name; ``options`` are those of `NodeHost`."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context

    hosts: list[NodeHost] = []
    ended = threading.Event()
    with ros_context(["--ros-args", *ros_args] if ros_args else None) as context:
        executor = SingleThreadedExecutor(context=context)

        def host(name: str) -> NodeHost:
            hosts.append(NodeHost(graph, graph.node(name), ros_context=context, **{"sim_time": False, **options}))
            executor.add_node(hosts[-1].ros_node)
            hosts[-1].start()
            return hosts[-1]

        def spin() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.05)

        thread = threading.Thread(target=spin, daemon=True)
        thread.start()
        try:
            yield host
        finally:
            ended.set()
            thread.join(2.0)
            executor.shutdown()
            for each in hosts:
                each.stop()


@contextmanager
def spinning_nodes(*names: str) -> Iterator[list[Any]]:
    """Plain rclpy nodes, each in its own context."""
    from socialbot.bridge.environment import spinning_node

    with ExitStack() as stack:
        yield [stack.enter_context(spinning_node(name)) for name in names]
