"""The committed runs of the warehouse, replayed over DDS without the world, and a demo over DDS."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.running import results, socialbot

pytestmark = pytest.mark.ros

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


@pytest.mark.slow
@pytest.mark.parametrize("run", [1, 2])
def test_over_dds_agents_decide_as_recorded(run: int, tmp_path: Path) -> None:
    bag, folder = BAGS / f"warehouse_run{run}", tmp_path / "run"
    done = socialbot("replay", bag, "--runner", "ros", "--rate", 100, "--out", folder, timeout_s=580.0)
    assert done.returncode == 0, done.stderr
    assert results(folder)["decisions"]["difference"] == ""
    assert {fate["failures"] for fate in results(folder)["nodes"].values()} == {0}


def test_the_demo_runs_over_dds_with_the_same_page_and_bag(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = socialbot("demo", "cleaner-sweeper", "--runner", "ros", "--bag", "--out", folder, timeout_s=200.0)
    assert done.returncode == 0, done.stderr + done.stdout
    assert results(folder)["reached"]
    assert (folder / "report.html").exists()
    assert {path.name for path in (folder / "bag").iterdir()} == {"bag.mcap", "graph.yaml", "metadata.yaml"}
