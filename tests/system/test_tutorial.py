"""What the tutorial tells people to type works."""

from __future__ import annotations

import re
from pathlib import Path

from tests.system.running import actions, cut, socialbot

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"


def block(language: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", TUTORIAL.read_text(), re.DOTALL)
    assert len(found) == 1
    return found[0]


def test_the_polite_waldo_says_goodbye(corridor: Path, tmp_path: Path) -> None:
    (tmp_path / "polite.py").write_text(block("python"))
    graph = tmp_path / "polite.yaml"
    graph.write_text(block("yaml"))
    bag = cut(corridor, tmp_path / "visit", 12.0, 29.0)
    done = socialbot(
        "replay", bag, "--graph", graph, "--runner", "inline", "--out", tmp_path / "run", "--no-video",
        "--set", "bdi_engine.farewell=See you!", "--set", "bdi_engine.help_after_s=3",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert ("farewell", "See you!") in [arguments for _, name, arguments in actions(tmp_path / "run")]


def test_the_graph_command_shows_the_parameters_of_ones_own_node(tmp_path: Path) -> None:
    (tmp_path / "polite.py").write_text(block("python"))
    (tmp_path / "polite.yaml").write_text(block("yaml"))
    done = socialbot("graph", tmp_path / "polite.yaml")
    assert done.returncode == 0, done.stderr
    assert "bdi_engine.farewell = 'Goodbye!'" in done.stdout
