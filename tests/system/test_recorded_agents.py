"""Committed runs of agents replayed over DDS without their worlds, and demos over DDS."""

from __future__ import annotations

from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from tests.cli.test_demo import SPEAKS
from tests.system.running import results, socialbot, socialbot_here

pytestmark = pytest.mark.ros

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


@pytest.mark.slow
@pytest.mark.parametrize("run", ["hospital_plain", "hospital_replanned", "warehouse_run1", "warehouse_run2"])
def test_agents_decide_as_recorded(run: str, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = socialbot("replay", BAGS / run, "--runner", "ros", "--rate", 100, "--out", folder, timeout_s=580.0)
    assert done.returncode == 0, done.stderr
    assert results(folder)["decisions"]["difference"] == ""
    assert {node["failures"] for node in results(folder)["nodes"].values()} == {0}


@pytest.mark.slow
def test_the_bag_of_a_hospital_demo_gives_the_same_decisions_inline(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = socialbot("demo", "hospital", "--runner", "ros", "--bag", "--out", folder, timeout_s=200.0)
    assert done.returncode == 0, done.stderr + done.stdout
    found = results(folder)
    assert found["reached"]
    assert found["infected"] == []
    assert [mission["problems"] for mission in found["missions"]] == [["dirty room"]]
    again = socialbot("replay", folder / "bag", "--runner", "inline", "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr
    assert results(tmp_path / "again")["decisions"]["difference"] == ""


@pytest.mark.slow
def test_a_demo_writes_its_page_and_bag(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = socialbot_here("demo", "cleaner-sweeper", "--runner", "ros", "--bag", "--out", folder)
    assert done.returncode == 0, done.stderr + done.stdout
    assert results(folder)["reached"]
    assert (folder / "report.html").exists()
    assert {path.name for path in (folder / "bag").iterdir()} == {"bag.mcap", "graph.yaml", "metadata.yaml"}


def test_a_run_over_ros_records_a_bag(tmp_path: Path) -> None:
    (tmp_path / "speaks.py").write_text(SPEAKS, "utf-8")
    graph, folder = tmp_path / "graph.yaml", tmp_path / "run"
    graph.write_text('name: speech\nnodes: {speaker: {type: "speaks:Speaks"}}\n', "utf-8")
    done = socialbot_here("run", graph, "--runner", "ros", "--composed", "--bag", "--out", folder)
    assert done.returncode == 0, done.stderr + done.stdout
    assert {path.name for path in (folder / "bag").iterdir()} == {"bag.mcap", "graph.yaml", "metadata.yaml"}
    with open_bag(folder / "bag") as bag:
        assert {topic.name: topic.count for topic in bag.topics}["/words"] == 1
