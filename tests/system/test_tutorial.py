"""The tutorials on a first rule and on sensors and actuators, followed word by word in an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.following import Block, Terminal, blocks, follow, has_its_place
from tests.system.running import actions, cut, socialbot

BEGIN = [". .venv/bin/activate", "socialbot new my_robot", "cd my_robot"]
"""The first commands, which lead to the project."""


def project(told: list[Block], folder: Path) -> Terminal:
    """A terminal where the first commands lead."""
    assert told[0].text.splitlines() == BEGIN
    terminal = Terminal(folder)
    code, printed = terminal.type(BEGIN[1])
    assert code == 0, printed
    terminal.folder = folder / "my_robot"
    return terminal


@pytest.mark.parametrize("page", ["tutorial.md", "tutorial-devices.md"])
def test_every_block_is_a_file_a_command_or_what_that_prints(page: str) -> None:
    told = blocks(page)
    for before, block in zip([None, *told], told, strict=False):
        assert has_its_place(block, before), block.text


def test_the_first_rule_does_what_the_tutorial_says(tmp_path: Path) -> None:
    told = blocks("tutorial.md")
    assert follow(told[1:], project(told, tmp_path)) > 5


@pytest.mark.slow
def test_the_sensor_and_the_actuator_do_what_the_tutorial_says(tmp_path: Path) -> None:
    told = blocks("tutorial-devices.md")
    assert follow(told[1:], project(told, tmp_path)) > 5


def polite(folder: Path) -> Path:
    """The graph of the polite Waldo, with the module beside it."""
    for block in blocks("tutorial.md"):
        if block.file.startswith("polite"):
            (folder / block.file).write_text(block.text, "utf-8")
    return folder / "polite.yaml"


def test_the_polite_waldo_says_goodbye(corridor: Path, tmp_path: Path) -> None:
    graph = polite(tmp_path)
    bag = cut(corridor, tmp_path / "visit", 12.0, 29.0)
    done = socialbot(
        "replay", bag, "--graph", graph, "--runner", "inline", "--out", tmp_path / "run", "--no-video",
        "--set", "bdi_engine.farewell=See you!", "--set", "bdi_engine.help_after_s=3",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert ("farewell", "See you!") in [arguments for _, name, arguments in actions(tmp_path / "run")]


def test_the_graph_command_shows_the_parameters_of_ones_own_node(tmp_path: Path) -> None:
    done = socialbot("graph", polite(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "bdi_engine.farewell = 'Goodbye!'" in done.stdout
