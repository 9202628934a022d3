from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from socialbot.cli.run import NOT_REACHED
from tests.runs.pages import unfrozen
from tests.system.running import results, socialbot, socialbot_here

pytest.importorskip("kairos", reason="kairos-planner is not installed")

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


@pytest.fixture(scope="module")
def second_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Run 2 with a bag: what it printed, and its folder."""
    folder = tmp_path_factory.mktemp("demo") / "run"
    done = socialbot("demo", "warehouse", "--run", "2", "--seed", "3", "--bag", "--out", folder)
    assert done.returncode == 0, done.stderr
    return done.stdout, folder


def test_second_run_shows_failure_and_new_plan(second_run):
    lines = second_run[0].splitlines()
    events = [line[11:].strip() for line in lines if " s  " in line[:12]]
    assert any("gives up plan 1 for sort_boxes" in line for line in events)
    assert any("makes a new plan for sort_boxes" in line for line in events)
    assert sum("for gripper_a_cometo_base" in line and "→ asks" in line for line in events) == 4
    assert any(line.startswith("gripper_a: sort_boxes fulfilled after") for line in lines)
    assert "deposit_c: box_c1, box_c2" in lines


def test_its_folder_has_trace_results_page_and_floor(second_run):
    _, folder = second_run
    assert {"trace.jsonl", "results.json", "report.html", "floor.svg", "bag"} <= {
        path.name for path in folder.iterdir()
    }
    found = results(folder)
    assert found["requests_for_desires"] == 4
    assert found["agents"]["gripper_a"]["given_up"] == 1
    assert set(found["boxes"].values()) == {"deposit_a", "deposit_b", "deposit_c"}
    assert ElementTree.parse(folder / "floor.svg").getroot().tag.endswith("svg")


def test_its_page_has_the_film_and_the_plans(second_run):
    page = (second_run[1] / "report.html").read_text("utf-8")
    assert "<title>The warehouse, run 2</title>" in page
    data = unfrozen(page)
    moves = data["film"]["moves"]
    flat = {name for name, track in moves.items() if len(track[0]) == 3}
    assert flat == {"gripper_a", "bridge", "carrier_a", "carrier_b", "carrier_c"}
    assert len(moves.keys() - flat) == 6


@pytest.mark.slow
def test_replayed_bag_gives_the_same_decisions(second_run, tmp_path):
    _, folder = second_run
    done = socialbot_here("replay", folder / "bag", "--runner", "inline", "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    decisions = results(tmp_path / "again")["decisions"]
    assert decisions["exact"], decisions
    assert decisions["recorded"] > 200
    assert (tmp_path / "again" / "trace.jsonl").read_bytes() == (folder / "trace.jsonl").read_bytes()
    assert "those that were recorded, at the same times" in done.stdout
    assert (tmp_path / "again" / "report.html").exists()


def test_other_parameters_give_other_decisions(tmp_path):
    options = ("--runner", "inline", "--out", tmp_path / "other", "--set", "coordinator.policy=none")
    done = socialbot_here("replay", BAGS / "hospital_replanned", *options)
    assert done.returncode == 0, done.stderr
    assert not results(tmp_path / "other")["decisions"]["exact"]
    assert "Decisions differ from the recorded ones: coordinator" in done.stdout


@pytest.mark.parametrize("run", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_committed_bags_give_their_recorded_decisions(run, tmp_path):
    done = socialbot_here("replay", BAGS / f"warehouse_run{run}", "--runner", "inline", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    found = results(tmp_path / "run")["decisions"]
    assert found["difference"] == ""
    assert found["recorded"] > 200


@pytest.mark.parametrize("run", [1, 2])
def test_the_committed_bags_are_small(run):
    files = list((BAGS / f"warehouse_run{run}").iterdir())
    assert sum(file.stat().st_size for file in files) < 3_000_000
    assert {"graph.yaml", "metadata.yaml"} <= {file.name for file in files}


def test_missed_goal_has_an_exit_code(tmp_path):
    done = socialbot_here("demo", "cleaner-sweeper", "--limit", "5", "--out", tmp_path / "run")
    assert done.returncode == NOT_REACHED
    assert "still wanted" in done.stdout
    assert (tmp_path / "run" / "report.html").exists()


SPEAKS = """
from socialbot import Input, Node, Output, Structured


class Word(Structured, frozen=True, kw_only=True):
    text: str


class Speaks(Node):
    is_simulator = True
    words = Output(Word, "/words")

    def start(self):
        self.words.publish(Word(stamp=self.clock.now(), text="hello"))
        self.report_health("ended", "that was all")
"""
DEAF = f"""{SPEAKS}

class Deaf(Node):
    words = Input(Word, "/words")

    @words
    def on_word(self, word):
        raise ValueError("deaf")
"""


def test_a_node_that_failed_at_every_call_has_an_exit_code(tmp_path):
    (tmp_path / "deaf.py").write_text(DEAF, "utf-8")
    graph = tmp_path / "graph.yaml"
    nodes = '{speaks: {type: "deaf:Speaks"}, listens: {type: "deaf:Deaf"}}'
    graph.write_text(f"name: deaf\nnodes: {nodes}\n", "utf-8")
    done = socialbot("run", graph, "--out", tmp_path / "run")
    assert done.returncode == 6
    assert "error: listens: failed 1 times; first: ValueError: deaf (deaf.py:" in done.stderr
    assert (tmp_path / "run" / "report.html").exists()


def test_wrong_parameter_is_a_readable_error(tmp_path):
    done = socialbot_here("demo", "warehouse", "--faults", "30 explodes", "--out", tmp_path / "run")
    assert done.returncode == 4
    assert "30 explodes" in done.stderr
    assert "Traceback" not in done.stderr


def test_refuses_the_folder_of_another_run(tmp_path):
    (tmp_path / "trace.jsonl").write_text("mine", "utf-8")
    done = socialbot_here("demo", "cleaner", "--out", tmp_path)
    assert done.returncode == 4
    assert (tmp_path / "trace.jsonl").read_text("utf-8") == "mine"
