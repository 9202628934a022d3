from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from socialbot.graph.files import load_graph
from socialbot.runs.console import Display
from socialbot.runtime.launch import Supervisor
from socialbot.runtime.machine import restarted, with_state_files
from tests.runs.deliberating_runs import record


def test_state_files_are_in_the_folder_of_the_run(tmp_path):
    graph = with_state_files(load_graph("waldo"), tmp_path / "minds")
    assert graph.node("bdi_engine").parameters["mind_file"] == str(tmp_path / "minds" / "bdi_engine.json")
    assert (tmp_path / "minds").is_dir()
    assert "mind_file" not in graph.node("head").parameters


def test_only_the_coordinator_of_the_hospital_saves_its_state(tmp_path):
    kept = {one.name: one.parameters for one in with_state_files(load_graph("hospital"), tmp_path).nodes}
    assert not [name for name, parameters in kept.items() if "mind_file" in parameters]
    assert kept["coordinator"]["memory_file"] == str(tmp_path / "coordinator.json")


def test_keeps_a_configured_state_file(tmp_path):
    graph = load_graph("waldo").with_parameters({"bdi_engine": {"mind_file": "here.json"}})
    assert with_state_files(graph, tmp_path).node("bdi_engine").parameters["mind_file"] == "here.json"


@pytest.mark.parametrize(
    ("missed", "begun", "restarts_all", "renewed"),
    [
        (None, 3.0, False, []),
        ((2.0, 5.0), 1.0, False, [(2.0, 5.0)]),
        ((2.0, 5.0), 2.0, True, []),
        ((2.0, 5.0), 6.0, False, [(2.0, 5.0)]),
    ],
)
def test_restarts_all_processes_only_if_their_parent_missed_a_service(
    missed, begun, restarts_all, renewed, monkeypatch
):
    times: list[tuple[float, float]] = []
    monkeypatch.setattr(Supervisor, "renew", lambda self, begin, end: times.append((begin, end)))
    assert restarted(Supervisor(load_graph("waldo"), Path()), begun, missed) is restarts_all
    assert times == renewed


def test_a_desire_that_an_agent_refuses_is_shown():
    out = io.StringIO()
    with Display(Console(file=out, width=100), load_graph("cleaner").without_sources()) as display:
        display.show("/trace", record(0.0, "cleaner", "desire_refused", "fly", "add_desire", reason="no wings"))
    assert out.getvalue().split() == ["0.00", "s", "cleaner", "✗", "does", "not", "take", "up", "fly:", "no", "wings"]
