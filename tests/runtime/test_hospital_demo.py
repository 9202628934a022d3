"""The demo of the hospital, its page and its bags, inline."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.graph.files import load_graph
from socialbot.runs.report import write_report
from socialbot.runtime.bag_source import replay
from socialbot.runtime.run import RunResult
from socialbot.runtime.simulated_source import replay_topics
from tests.agents.hospital.runs import HospitalRun, carried_out, paper_run
from tests.runs.pages import read, unfrozen
from tests.system.running import results, socialbot_here

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


def page_of(run: HospitalRun) -> str:
    return run.report.write(run.folder, "The hospital").read_text("utf-8")


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Output and folder of the demo command."""
    folder = tmp_path_factory.mktemp("demo") / "run"
    done = socialbot_here("demo", "hospital", "--problems", 50, "--out", folder)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout, folder


def test_prints_ward_tasks_actions_failures_and_the_new_plan(shown):
    text = re.sub(r" +", " ", shown[0])
    in_order = [
        "room1 closed dirty ✓ nurse1",
        "plans disinfect room1: 9 steps",
        "· m_patrol_and_disinfect(spotrobot1, uvdrobot1, nurse_disinfected1) infected",
        "spotrobot1 · goes to room1",
        "✗ patrols room1: failed: dirty room",
        "gives up plan 1 for disinfect room1",
        "✗ a_patrol_room(spotrobot1, room1)",
        "makes a new plan for disinfect room1: 8 steps",
        "✚ a_adapt_room(nurse_disinfected1, room1)",
        "has reached disinfect room1",
        "1 room1 9 13 1 dirty room yes finished",
    ]
    places = [text.find(told) for told in in_order]
    assert places == sorted(places), dict(zip(in_order, places, strict=True))
    assert -1 not in places


def test_writes_trace_results_page_and_ward(shown):
    folder = shown[1]
    assert {path.name for path in folder.iterdir()} == {
        *("trace.jsonl", "seen.jsonl", "graph.yaml", "results.json", "report.html", "ward.svg"),
    }
    found = results(folder)
    assert found["ended"] == "nobody wants anything more"
    [mission] = found["missions"]
    assert (mission["status"], mission["problems"], mission["recoveries"]) == ("finished", ["dirty room"], 1)
    assert found["infected"] == []


def test_the_page_is_written_again_with_the_same_figures(shown):
    folder = shown[1]
    first = figures_of(folder / "report.html")
    assert ("1 of 1", "missions done") in first
    assert figures_of(write_report(folder)) == first


def figures_of(page: Path) -> list[tuple[str, str]]:
    return re.findall(r"<b>([^<]*)</b><span>([^<]*)</span>", page.read_text("utf-8"))


def test_the_page_contains_the_whole_run():
    page = page_of(paper_run(100.0))
    words = read(page)
    assert "1 of 1" in words
    assert "dirty room" in words
    assert "inform Problem" in words
    data = unfrozen(page)
    assert "a_adapt_room(nurse_disinfected1, room1)" in str(data["trees"])
    bars = [bar for lane in data["timeline"]["lanes"] for bar in lane["bars"]]
    assert [bar["outcome"] for bar in bars if bar["kind"] == "plan"] == ["failed", "succeeded"]
    assert [bar["outcome"] for bar in bars if bar["kind"] == "desire"] == ["fulfilled"]


def test_the_film_shows_rooms_and_robots():
    film = unfrozen(page_of(paper_run(100.0)))["film"]
    assert set(film["moves"]) == {"spotrobot1", "uvdrobot1", "nurse_disinfected1"}
    looks = [film["drawings"][int(face)] for _, face in film["contents"]["room1"]]
    assert any("door closed, dirty" in look for look in looks)
    assert any("door open, dirty, to be disinfected" in look for look in looks)
    assert "door open, tidy, disinfected" in looks[-1]


def test_an_abandoned_mission_is_not_reached():
    run = paper_run(100.0, "none")
    story = run.report.story()
    assert not story.reached
    assert story.results()["infected"] == ["room1"]
    assert [mission["problems"] for mission in story.results()["missions"]] == [["dirty room"]]
    assert run.ran.ended == "nobody wants anything more"


def test_the_graph_file_runs_with_the_page_too():
    run = carried_out(load_graph("hospital"))
    assert run.report.story().reached
    assert unfrozen(page_of(run))["trees"]


def replayed(bag: Path, folder: Path, **changes: object) -> RunResult:
    graph = load_graph(str(bag / "graph.yaml")).with_parameters({"coordinator": changes})
    return replay(bag, graph, folder)


def test_a_replay_without_the_simulator_gives_the_same_decisions(tmp_path):
    graph = paper_run(100.0).graph
    run = carried_out(graph, bag=tmp_path / "bag")
    outcome = replayed(tmp_path / "bag", tmp_path / "run")
    assert outcome.decisions is not None
    assert outcome.decisions.exact
    assert outcome.decisions.recorded > 100
    told = (tmp_path / "run" / "trace.jsonl").read_text("utf-8").splitlines()
    assert len(told) == len(run.records)


def test_a_bag_has_states_commands_and_messages(tmp_path):
    topics = replay_topics(paper_run(0.0).graph)
    assert {f"/hospital/{name}" for name in ("state", "results", "commands", "messages", "missions")} <= set(topics)
    assert "/spotrobot1/mind" not in topics


def test_other_parameters_give_other_decisions(tmp_path):
    outcome = replayed(BAGS / "hospital_replanned", tmp_path / "run", policy="none")
    assert outcome.decisions is not None
    assert outcome.decisions.difference.startswith("coordinator")


@pytest.mark.parametrize("mission", ["plain", "replanned"])
def test_the_committed_bags_give_their_recorded_decisions(mission, tmp_path):
    outcome = replayed(BAGS / f"hospital_{mission}", tmp_path / "run")
    assert outcome.decisions is not None
    assert outcome.decisions.difference == ""
    assert outcome.decisions.recorded > 100


@pytest.mark.parametrize(("mission", "plans"), [("plain", 1), ("replanned", 2)])
def test_the_committed_bags_are_small_and_have_one_mission_each(mission, plans):
    bag = BAGS / f"hospital_{mission}"
    assert sum(file.stat().st_size for file in bag.iterdir()) < 500_000
    with open_bag(bag) as opened:
        views: list[Message] = [
            message
            for _, message in opened.messages(
                {"/hospital/missions": "/hospital/missions"}, load_graph(str(bag / "graph.yaml")).topics()
            )
        ]
        assert opened.start == SECOND
    labels = {view.label for message in views for view in getattr(message, "missions", ())}
    assert len(labels) == plans
