from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from socialbot.graph.files import load_graph
from socialbot.runs.console import Display
from socialbot.runtime._supervisor import Supervisor
from socialbot.runtime.live_source import RunServices, restarted, with_state_files
from tests.runs.deliberating_runs import record


def test_agents_keep_their_minds_below_the_folder_of_the_run(tmp_path):
    graph = with_state_files(load_graph("waldo"), tmp_path / "minds")
    assert graph.placement("bdi_engine").parameters["mind_file"] == str(tmp_path / "minds" / "bdi_engine.json")
    assert (tmp_path / "minds").is_dir()
    assert "mind_file" not in graph.placement("head").parameters


def test_agents_whose_plans_come_by_messages_keep_no_mind_but_who_sends_them_remembers(tmp_path):
    kept = {one.name: one.parameters for one in with_state_files(load_graph("hospital"), tmp_path).placements}
    assert not [name for name, parameters in kept.items() if "mind_file" in parameters]
    assert kept["coordinator"]["memory_file"] == str(tmp_path / "coordinator.json")


def test_an_agent_that_keeps_its_mind_elsewhere_goes_on_doing_so(tmp_path):
    graph = load_graph("waldo").with_parameters({"bdi_engine": {"mind_file": "here.json"}})
    assert with_state_files(graph, tmp_path).placement("bdi_engine").parameters["mind_file"] == "here.json"


class Come(RunServices):
    """Something has come that those have missed who started from 2 s to 5 s."""

    def missed(self) -> tuple[float, float]:
        return 2.0, 5.0


@pytest.mark.parametrize(
    ("around", "begun", "all_again", "asked"),
    [
        (RunServices(), 3.0, False, []),
        (Come(), 1.0, False, [(2.0, 5.0)]),
        (Come(), 2.0, True, []),
        (Come(), 6.0, False, [(2.0, 5.0)]),
    ],
)
def test_all_is_started_again_only_where_the_one_who_starts_it_has_missed_something(around, begun, all_again, asked):
    told: list[tuple[float, float]] = []

    class Told(Supervisor):
        def renew(self, begin: float, end: float) -> None:
            told.append((begin, end))

    supervisor = Told(load_graph("waldo"), Path())
    assert restarted(supervisor, begun, around) is all_again
    assert told == asked


def test_a_desire_that_an_agent_refuses_is_shown():
    out = io.StringIO()
    with Display(Console(file=out, width=100), load_graph("cleaner").without_sources()) as display:
        display.show("/trace", record(0.0, "cleaner", "desire_refused", "fly", "add_desire", reason="no wings"))
    assert out.getvalue().split() == ["0.00", "s", "cleaner", "✗", "does", "not", "take", "up", "fly:", "no", "wings"]
