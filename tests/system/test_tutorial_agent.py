"""The tutorial on building an agent, followed word by word in an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.following import Block, Terminal, blocks, follow, has_its_place, save
from tests.system.running import eventually

PAGE = "tutorial-agent.md"


def is_live(block: Block) -> bool:
    return block.text.startswith("socialbot up")


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    """In an empty folder, to which the first commands of the tutorial lead."""
    assert blocks(PAGE)[0].text.splitlines() == [". .venv/bin/activate", "mkdir garden", "cd garden"]
    (tmp_path / "garden").mkdir()
    return Terminal(tmp_path / "garden")


def test_every_block_of_the_tutorial_is_a_file_a_command_or_what_that_prints():
    told = blocks(PAGE)
    for before, block in zip([None, *told], told, strict=False):
        assert has_its_place(block, before), block.text


def test_every_command_of_the_tutorial_prints_what_it_says(terminal: Terminal) -> None:
    told = blocks(PAGE)[1:]
    live = next(number for number, block in enumerate(told) if is_live(block))
    assert all(block.shows is not None for block in told[:live] if block.language == "sh")
    assert follow(told[:live], terminal) > 5


def test_the_robot_of_the_tutorial_can_be_watched_and_told_what_to_do_while_it_runs(terminal: Terminal) -> None:
    told = blocks(PAGE)
    number = next(number for number, block in enumerate(told) if is_live(block))
    save(told[1:number], terminal.folder)
    trace = terminal.folder / "live" / "trace.jsonl"
    with terminal.running(told[number].text):
        assert eventually(lambda: trace.exists() and "water_roses" in trace.read_text("utf-8"), 60.0)
        for command in told[number + 1].text.splitlines():
            code, printed = terminal.type(command)
            assert code == 0, printed
            assert "gina" in printed or "pub" in command, printed
        assert eventually(lambda: "visit" in trace.read_text("utf-8"), 20.0)
    assert [block.language for block in told[number + 1 :]] == ["sh"]
