"""`socialbot test --live` beside a running graph: it prints violations and publishes them on /diagnostics."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from socialbot.bridge.diagnostics import DiagnosticsSubscriber
from socialbot.bridge.environment import spinning_node
from socialbot.cli.new import write_project
from tests.system.running import PATIENCE_S, eventually, running

pytestmark = [pytest.mark.ros, pytest.mark.slow]

BEHAVIOURS = """
from socialbot.testing import expect, never, person, said

greets = expect(said("Hello*")).within(2).after(person(nearer_than=3))
says_no_goodbye = never(said("Goodbye*"))
"""


def test_violations_are_printed_and_published(tmp_path: Path) -> None:
    project = write_project("watched_robot", "python", tmp_path)
    behaviours = tmp_path / "expected.py"
    behaviours.write_text(BEHAVIOURS, "utf-8")
    statuses: dict[str, list[dict[str, str]]] = {}
    graph = project / "graph.yaml"
    with spinning_node("listener") as ros:
        DiagnosticsSubscriber(ros, lambda name, values: statuses.setdefault(name, []).append(values))
        with running("test", behaviours, "--live", graph) as monitor:
            assert eventually(lambda: "until Ctrl-C" in monitor.output())
            with running("up", graph, "--out", tmp_path / "up", "--set", "visitors.visits=100"):
                assert eventually(lambda: "violated says_no_goodbye" in monitor.output())
                violated = "behaviour: says_no_goodbye"
                assert eventually(lambda: any(each["violations"] != "0" for each in statuses.get(violated, ())))
            monitor.send_signal(signal.SIGINT)
            monitor.wait(PATIENCE_S)
            output = monitor.output()
    assert "because it no longer believed visitor" in output
    assert "greets: not violated" in output
    assert monitor.returncode == 1
    assert statuses["behaviour: greets"][-1]["violations"] == "0"
