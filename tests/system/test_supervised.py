"""Waldo's graph under supervision: restarts of crashed and hung nodes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

from socialbot.graph.files import load_graph
from socialbot.runtime._processes import RestartPolicy
from socialbot.runtime.machine import with_state_files
from tests.system.running import PATIENCE_S, eventually, running

pytestmark = pytest.mark.ros

PATIENT = RestartPolicy(hung_s=30.0)
BACK_S = 10.0
"""Two seconds are enough, unless the machine has much else to do."""


@contextmanager
def supervised(pictures: Path, folder: Path) -> Iterator[tuple[Any, Callable[[Callable[[], bool], float], float]]]:
    """Waldo's graph, and a way to attend to it until something holds; that returns how long it took (s)."""
    from socialbot.runtime.launch import Supervisor

    graph = load_graph("waldo").with_parameters(
        {"camera": {"source": str(pictures), "loop": True}, "speech": {"playback": "off"}}
    )
    with Supervisor(with_state_files(graph, folder / "minds"), folder, policy=PATIENT) as supervisor:

        def until(holds: Callable[[], bool], timeout_s: float) -> float:
            begun = monotonic()
            while not holds():
                assert monotonic() < begun + timeout_s
                supervisor.attend(0.02)
            return monotonic() - begun

        until(lambda: all(one.state == "active" for one in supervisor.members.values()), 30.0)
        yield supervisor, until


@pytest.mark.slow
def test_restarts_each_killed_node_alone(pictures: Path, tmp_path: Path) -> None:
    with supervised(pictures, tmp_path) as (supervisor, until):
        for member in supervisor.members.values():
            before = supervisor.pids
            os.kill(before[member.name], signal.SIGKILL)
            until(lambda member=member: member.is_down, 5.0)
            took_s = until(lambda member=member: member.state == "active", 30.0)
            assert took_s < BACK_S
            after = supervisor.pids
            assert {name for name in before if before[name] != after[name]} == {member.name}


@pytest.mark.slow
def test_restarts_a_suspended_node(pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.system.test_supervised.PATIENT", RestartPolicy(hung_s=3.0))
    with supervised(pictures, tmp_path) as (supervisor, until):
        head = supervisor.members["head"]
        os.kill(supervisor.pids["head"], signal.SIGSTOP)
        until(lambda: head.is_down, 10.0)
        assert head.last_error == "hung (head sent no report)"
        until(lambda: head.state == "active", 30.0)


@pytest.mark.slow
def test_restarts_crashed_nodes_and_publishes_their_status(pictures: Path, tmp_path: Path) -> None:
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.graph_observer import await_graph

    told: list[tuple[str, dict[str, str]]] = []

    def pid(node: str) -> int:
        return int(next(values["pid"] for name, values in reversed(told) if name == node and "pid" in values))

    def latest(node: str) -> dict[str, str]:
        return next((values for name, values in reversed(told) if name == node), {})

    with spinning_node("onlooker") as ros:
        from diagnostic_msgs.msg import DiagnosticArray

        def note(array: DiagnosticArray) -> None:
            told.extend((status.name, {pair.key: pair.value for pair in status.values}) for status in array.status)

        ros.create_subscription(DiagnosticArray, "/diagnostics", note, 100)
        with running("up", "--camera", pictures, "--out", tmp_path / "run", "--set", "camera.loop=true") as process:
            assert not await_graph(ros, load_graph("waldo"), timeout_s=PATIENCE_S)
            assert eventually(lambda: bool(latest("bdi_engine")))
            first = pid("bdi_engine")
            os.kill(first, signal.SIGKILL)
            assert eventually(lambda: latest("bdi_engine")["restarts"] == "1" and pid("bdi_engine") != first)
            assert latest("bdi_engine")["last_error"] == "was ended by signal 9"
            assert latest("bdi_engine")["machine"]
            assert eventually(lambda: latest("bdi_engine")["state"] == "active")
            assert any(values["state"] == "waiting" for name, values in told if name == "bdi_engine")
            assert eventually((tmp_path / "run" / "minds" / "bdi_engine.json").exists)
            process.send_signal(signal.SIGINT)
            assert process.wait(180) == 0
