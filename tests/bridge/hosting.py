"""Hosts of nodes in the process of the tests."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from socialbot.bridge.environment import PROFILE_VARIABLE
from socialbot.graph.node import Graph
from tests.system.running import next_line

REPOSITORY = Path(__file__).parents[2]


@contextmanager
def node_hosts(graph: Graph, *ros_args: str, **options: Any) -> Iterator[Callable[[str], Any]]:
    """A function that hosts and starts a node of ``graph`` by its name; ``options`` are those of `NodeHost`."""
    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context, spin
    from socialbot.bridge.wait_sets import OneThreadExecutor

    hosts: list[NodeHost] = []
    with ros_context(["--ros-args", *ros_args] if ros_args else None) as context:
        executor = OneThreadExecutor(context=context)

        def host(name: str) -> NodeHost:
            hosts.append(NodeHost(graph, graph.node(name), ros_context=context, **{"sim_time": False, **options}))
            executor.add_node(hosts[-1].ros_node)
            hosts[-1].start()
            return hosts[-1]

        thread = threading.Thread(target=spin, args=(executor,), daemon=True)
        thread.start()
        try:
            yield host
        finally:
            executor.shutdown()
            thread.join(2.0)
            for each in hosts:
                each.stop()


def has_receivers(host: Any, output: str, count: int) -> bool:
    """Whether ``count`` subscriptions or more receive what an output of a hosted node publishes, with its seals."""
    sender = host._senders[output]
    publishers = (each for each in (sender.publisher, sender.seals) if each is not None)
    return all(each.get_subscription_count() >= count for each in publishers)


@contextmanager
def foreign_process(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run the plain rclpy nodes of a module of tests in another process, which is killed at the end of the block."""
    command = [sys.executable, "-m", module, *arguments]
    foreign = {name: value for name, value in os.environ.items() if name != PROFILE_VARIABLE}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, env=foreign
    )
    try:
        assert next_line(process) == "ready\n"
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def spinning_nodes(*names: str) -> Iterator[list[Any]]:
    """Plain rclpy nodes, each in its own context."""
    from socialbot.bridge.environment import spinning_node

    with ExitStack() as stack:
        yield [stack.enter_context(spinning_node(name)) for name in names]
