"""The tutorial on building an agent, followed word by word in an empty folder."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from tests.system.running import eventually

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial-agent.md"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVE = re.compile(r"Save this as `([\w.]+)`")
VARIES = "..."
"""Stands for what differs from run to run: a part of a line, or some lines when it is one of its own."""


@dataclass(frozen=True)
class Block:
    """A file to save (with its name), a command to type, or what that prints; ``before`` is the text above it."""

    language: str
    text: str
    before: str

    @property
    def file(self) -> str:
        """The name under which it is to be saved; empty for commands and what they print."""
        named = SAVE.findall(self.before)
        return named[-1] if named and self.language not in ("sh", "text") else ""


def blocks() -> list[Block]:
    text, found, end = TUTORIAL.read_text("utf-8"), [], 0
    for match in BLOCK.finditer(text):
        found.append(Block(match[1], match[2], text[end : match.start()]))
        end = match.end()
    return found


class Terminal:
    """Types commands where somebody reads along, in a folder, with the virtual environment of the tests."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        scripts = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        self.environment = {**os.environ, "PATH": scripts, "TERM": "dumb", "COLUMNS": "200", "LINES": "50"}

    def type(self, command: str) -> tuple[int, str]:
        """The exit code of a command, and what it prints."""
        screen, keyboard = pty.openpty()
        with self._begun(command, keyboard) as process:
            os.close(keyboard)
            printed = b""
            with contextlib.suppress(OSError):  # Linux says so when the other end is closed
                while some := os.read(screen, 65536):
                    printed += some
            os.close(screen)
        return process.returncode, printed.decode("utf-8").replace("\r\n", "\n")

    @contextlib.contextmanager
    def running(self, command: str) -> Iterator[None]:
        """A command that goes on until Ctrl-C."""
        with self._begun(f"exec {command}", subprocess.DEVNULL) as process:
            try:
                yield
            finally:
                process.send_signal(signal.SIGINT)

    def _begun(self, command: str, output: int) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            ["bash", "-euc", command],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )


def same(printed: str, expected: str) -> bool:
    """Whether lines are as the tutorial shows them."""
    lines = (
        "(?s:.*)" if line == VARIES else ".*".join(map(re.escape, line.split(VARIES)))
        for line in expected.strip("\n").splitlines()
    )
    pattern = "\n".join(lines)
    return re.fullmatch(pattern, "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())) is not None


def is_live(block: Block) -> bool:
    return block.text.startswith("socialbot up")


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    """In an empty folder, to which the first commands of the tutorial lead."""
    assert blocks()[0].text.splitlines() == [". .venv/bin/activate", "mkdir garden", "cd garden"]
    (tmp_path / "garden").mkdir()
    return Terminal(tmp_path / "garden")


def save(blocks: Iterable[Block], folder: Path) -> None:
    for block in blocks:
        if block.file:
            assert not (folder / block.file).exists(), block.file
            (folder / block.file).write_text(block.text, "utf-8")


def test_every_block_of_the_tutorial_is_a_file_a_command_or_what_that_prints():
    for before, block in pairwise(blocks()):
        assert block.file or block.language == "sh" or before.language == "sh", block.text


def test_every_command_of_the_tutorial_prints_what_it_says(terminal: Terminal) -> None:
    compared, told = 0, blocks()[1:]
    for block, after in pairwise(told):
        save([block], terminal.folder)
        if is_live(block):
            break
        if block.language == "sh":
            code, printed = terminal.type(block.text)
            assert after.language == "text", block.text
            assert same(printed, after.text), f"{block.text}\nprints\n{printed}"
            assert code == (4 if "error" in after.text else 0)
            compared += 1
    assert compared > 5


def test_the_robot_of_the_tutorial_can_be_watched_and_told_what_to_do_while_it_runs(terminal: Terminal) -> None:
    told = blocks()
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
