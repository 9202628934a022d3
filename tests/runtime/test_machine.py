"""The start of `socialbot up`."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.core.clock import WallClock
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.runtime import machine
from socialbot.runtime.machine import ClockWatch, LiveSource

pytestmark = pytest.mark.ros


class Idle(Node):
    """Does nothing."""


class StartedError(Exception):
    """The observer starts."""


def test_the_modules_of_nodes_are_imported_while_the_observer_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both take a second of processor time, which is long on a busy machine."""
    graph = Graph("idle", (NodeConfig("idle", Idle),))
    execution: Any = SimpleNamespace(graph=graph, logs=tmp_path, composed=False, ending=None, observe=None)
    up = machine._NodesUp(LiveSource(), execution, ClockWatch(WallClock()), None)

    def observe(*_: object, **__: object) -> None:
        assert up.supervisor._fork_server.server_pid
        raise StartedError

    monkeypatch.setattr(machine, "observe_graph", observe)
    try:
        with pytest.raises(StartedError):
            up.attend()
    finally:
        up.close()
    assert up.supervisor._fork_server.server_pid is None
