"""The committed missions of the hospital, replayed over DDS without the ward, and its demo over DDS."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.running import results, socialbot

pytestmark = [pytest.mark.ros, pytest.mark.slow]

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


@pytest.mark.parametrize("mission", ["plain", "replanned"])
def test_over_dds_agents_decide_as_recorded(mission: str, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    bag = BAGS / f"hospital_{mission}"
    done = socialbot("replay", bag, "--runner", "ros", "--rate", 100, "--out", folder, timeout_s=300.0)
    assert done.returncode == 0, done.stderr
    assert results(folder)["decisions"]["difference"] == ""
    assert {fate["failures"] for fate in results(folder)["nodes"].values()} == {0}


def test_the_demo_runs_over_dds_and_its_bag_gives_the_same_decisions_inline(tmp_path: Path) -> None:
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
