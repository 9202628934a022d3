"""Follows a page of the documentation word by word: saves and changes its files, types its commands, reads along.

A fenced block is what the text above it says: "Save this as `file`" a file; in ``diff`` a change "In `file`"; ``sh`` is
typed, and a ``text`` that follows is what that prints. Indented blocks are not followed.
"""

from __future__ import annotations

import contextlib
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVE = re.compile(r"Save this as `([\w./-]+)`")
CHANGE = re.compile(r"In `([\w./-]+)`")
VARIES = "..."
"""Stands for what differs from run to run: a part of a line, or some lines when it is one of its own."""


@dataclass(frozen=True)
class Block:
    """A file to save or to change (with its name), a command to type, or what that prints.

    ``before`` is the text above it, ``shows`` what it is said to print.
    """

    language: str
    text: str
    before: str
    shows: str | None = None

    @property
    def file(self) -> str:
        """The name under which it is to be saved, or which it changes; empty for commands and what they print."""
        if self.language in ("sh", "text"):
            return ""
        named = (CHANGE if self.language == "diff" else SAVE).findall(self.before)
        return named[-1] if named else ""


def blocks(page: str) -> list[Block]:
    """Return the code blocks of a docs page; `Block.shows` is the expected output of a command."""
    text, found, end = (DOCS / page).read_text("utf-8"), [], 0
    for match in BLOCK.finditer(text):
        found.append(Block(match[1], match[2], text[end : match.start()]))
        end = match.end()
    shown = [after.text if after.language == "text" else None for after in found[1:]]
    return [
        Block(block.language, block.text, block.before, shows if block.language == "sh" else None)
        for block, shows in zip(found, [*shown, None][: len(found)], strict=True)
    ]


def has_its_place(block: Block, before: Block | None) -> bool:
    """Whether a block is a file, a command, or what the block before it prints."""
    return bool(block.file) or block.language == "sh" or (before is not None and before.language == "sh")


def save(told: Iterable[Block], folder: Path) -> None:
    """Saves and changes files as blocks say."""
    for block in told:
        path = folder / block.file
        if not block.file:
            continue
        if block.language == "diff":
            path.write_text(changed(path.read_text("utf-8"), block.text), "utf-8")
        else:
            assert not path.exists(), block.file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, "utf-8")


def changed(text: str, diff: str) -> str:
    """A text with lines taken out (-) and put in (+), between others that stand there once. Fails if they do not."""
    lines = diff.splitlines(keepends=True)
    old = "".join(line[1:] for line in lines if line[0] in " -\n")
    new = "".join(line[1:] for line in lines if line[0] in " +\n")
    assert text.count(old) == 1, f"{text.count(old)} times there: {old}"
    return text.replace(old, new)


class Terminal:
    """Types commands where somebody reads along, in a folder, with the virtual environment of the tests.

    ``prefix`` is a command line that runs others elsewhere, ``variables`` are added to the environment.
    """

    def __init__(self, folder: Path, prefix: Sequence[str] = (), **variables: str) -> None:
        self.folder = folder
        self.prefix = prefix
        scripts = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        self.environment = {
            **os.environ, "PATH": scripts, "TERM": "dumb", "COLUMNS": "200", "LINES": "50", **variables,
        }  # fmt: skip

    def type(self, command: str) -> tuple[int, str]:
        """The exit code of a command, and what it prints. Where it leads (``cd``), the next ones are typed."""
        screen, keyboard = pty.openpty()
        with self._begun(command, keyboard) as process:
            os.close(keyboard)
            printed = b""
            with contextlib.suppress(OSError):  # Linux says so when the other end is closed
                while some := os.read(screen, 65536):
                    printed += some
            os.close(screen)
        for line in command.splitlines():
            if line.startswith("cd "):
                self.folder /= line.removeprefix("cd ")
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
            [*self.prefix, "bash", "-euc", f"cd {shlex.quote(str(self.folder))}\n{command}"],
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )


def same(printed: str, expected: str) -> bool:
    """Whether lines are as a page shows them."""
    lines = (
        "(?s:.*)" if line == VARIES else ".*".join(map(re.escape, line.split(VARIES)))
        for line in expected.strip("\n").splitlines()
    )
    pattern = "\n".join(lines)
    return re.fullmatch(pattern, "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())) is not None


def due_codes(block: Block) -> tuple[int, ...]:
    """The exit codes that a command may have: of mistakes, of runs that differ, of failed expectations, or 0."""
    if block.shows is not None and "error:" in block.shows:
        return (3, 4, 5)
    if block.text.startswith("socialbot diff") or (block.shows is not None and " FAILED " in block.shows):
        return (1,)
    return (0,)


def follow(told: Iterable[Block], terminal: Terminal) -> int:
    """Does what blocks say; fails where something else is printed. Returns how many times it was compared."""
    compared = 0
    for block in told:
        save([block], terminal.folder)
        if block.language == "sh":
            code, printed = terminal.type(block.text)
            assert code in due_codes(block), f"{block.text}\nends with {code}\n{printed}"
            if block.shows is not None:
                assert same(printed, block.shows), f"{block.text}\nprints\n{printed}"
                compared += 1
    return compared
