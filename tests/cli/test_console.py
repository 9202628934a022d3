"""Texts of strangers on a terminal: in runs, files, names and messages."""

from __future__ import annotations

import ast
import io
import json
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, Writer
from rich.live import Live
from rich.table import Table
from rich.text import Text

import socialbot.cli
from socialbot.cli._console import Console
from socialbot.core.terminal import TerminalFormatter, without_controls
from tests.system.running import socialbot_here

RUN = Path(__file__).parents[1] / "data" / "run_0_1"
HOSTILE = "\x1b]52;c;eA==\x07\x1b[2J\x9b2J\r\u202egnp.exe\u2066\u2028"
"""Sequences that write the clipboard, clear the screen, and exchange the order of a line."""


def hostile(value: object) -> object:
    """The value with `HOSTILE` at the end of all texts below it."""
    if isinstance(value, dict):
        return {name: hostile(part) for name, part in value.items()}
    if isinstance(value, list):
        return [hostile(part) for part in value]
    return value + HOSTILE if isinstance(value, str) else value


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile") / "run"
    shutil.copytree(RUN, folder)
    with (folder / "trace.jsonl").open("w", encoding="utf-8") as file:
        for line in (RUN / "trace.jsonl").read_text("utf-8").splitlines():
            record = json.loads(line)
            record["what"] += HOSTILE
            record["detail"] = hostile(record["detail"])
            file.write(json.dumps(record) + "\n")
    return folder


def controls(text: str) -> list[str]:
    return [letter for letter in text if not letter.isprintable() and letter not in "\n\t"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("ask", "{run}", "What did you believe?"),
        ("ask", "{run}", f"Why did you greet {HOSTILE}?"),
        ("ask", "{run}", "--json", "What did you believe?"),
        ("why", "{run}"),
        ("diff", "{run}", str(RUN)),
        ("ask", f"{{run}}/{HOSTILE}", "Why?"),
        ("bag", "info", HOSTILE),
        ("graph", HOSTILE),
    ],
)
def test_commands_print_no_control_characters(arguments: tuple[str, ...], run: Path) -> None:
    done = socialbot_here(*(each.replace("{run}", str(run)) for each in arguments))
    assert done.stdout or done.stderr
    assert controls(done.stdout + done.stderr) == []


def test_json_keeps_its_values(run: Path) -> None:
    found = json.loads(socialbot_here("ask", run, "--json", f"Why did you greet {HOSTILE}?").stdout)
    assert "\x9b2J" in json.dumps(found, ensure_ascii=False)


def test_a_terminal_gets_only_the_sequences_of_the_console() -> None:
    def printed(text: str) -> str:
        file = io.StringIO()
        console = Console(file=file, force_terminal=True, width=60)
        table = Table("a header wider than the texts")
        table.add_row(Text(text, "bold red"))
        console.print(table, f"[red]{text}[/]", Text(text))
        with Live(Text(text), console=console):
            pass
        return file.getvalue()

    assert "\x1b[" in printed("plain")
    assert printed("a\x1bb\x9bc\u202ed") == printed("a?b?c?d")


@pytest.mark.parametrize("text", ["[/]", "[/b]", "[link=https://evil.example]x[/link]", "[bold"])
def test_markup_in_texts_neither_fails_nor_links(text: str) -> None:
    file = io.StringIO()
    console = Console(file=file, force_terminal=True)
    table = Table("name")
    table.add_row(text)
    console.print(table, f"[red]from[/] {text}")
    assert "x" in file.getvalue() or text in file.getvalue()
    assert "evil.example" not in file.getvalue().replace(text, "")


def test_names_in_a_bag_are_printed_as_they_are(tmp_path: Path) -> None:
    """The type of a topic is any text."""
    with (tmp_path / "bag.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        schema = writer.register_schema("[/][red]pkg/msg/Kind", "ros2msg", b"")
        channel = writer.register_channel("/topic", "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00", 1)
        writer.finish()
    done = socialbot_here("bag", "info", tmp_path / "bag.mcap")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert "[/][red]pkg/Kind" in done.stdout


def test_log_records_have_no_control_characters() -> None:
    record = logging.LogRecord("socialbot", logging.WARNING, "", 0, "from %s", (HOSTILE,), None)
    assert controls(TerminalFormatter().format(record)) == []
    assert without_controls("Ärger\t日本\u200d\n") == "Ärger\t日本\u200d\n"


def test_commands_print_by_this_console_only() -> None:
    def others(tree: Any) -> list[str]:
        names = (ast.unparse(node) for node in ast.walk(tree) if isinstance(node, (ast.Attribute, ast.ImportFrom)))
        return [name for name in names if name == "typer.echo" or "rich.console import Console" in name]

    for path in Path(socialbot.cli.__file__).parent.glob("*.py"):
        if path.name != "_console.py":
            assert others(ast.parse(path.read_text("utf-8"))) == [], path.name


def test_lines_for_a_file_or_pipe_are_not_folded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.delenv("LINES", raising=False)
    name = "/camera/depth/image_raw/compressedDepth" * 3
    table = Table(box=None, show_header=False)
    for _ in range(3):
        table.add_column(overflow="fold")
    table.add_row(name, name, name)

    def lines() -> int:
        pipe = io.StringIO()
        Console(file=pipe).print(table)
        return len(pipe.getvalue().splitlines())

    assert lines() == 1
    monkeypatch.setenv("COLUMNS", "80")
    assert lines() == 5
    monkeypatch.setenv("LINES", "24")  # with both, as readline exports them, it is the size of a terminal
    assert lines() == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_lossy_console_goes_on_without_its_output(monkeypatch: pytest.MonkeyPatch) -> None:
    with open("/dev/full", "w", encoding="utf-8", buffering=1) as full:
        monkeypatch.setattr(sys, "stdout", full)
        console = Console(lossy=True)
        for _ in range(3):
            console.print(10_000 * "lost ")
        with pytest.raises(OSError, match="No space left"):
            Console().print("lost")
        monkeypatch.undo()
        os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("command", ["--version", "graph waldo"])
def test_an_output_on_a_full_disk_is_one_message(command: str) -> None:
    """A short text stays in a buffer until the end."""
    run = [sys.executable, "-m", "socialbot", *command.split()]
    with open("/dev/full", "w", encoding="utf-8") as full:
        ended = subprocess.run(run, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.stderr == (
        "error: standard output: cannot be written: No space left on device\n"
        "  remedy: free some space, or write to another place\n"
    )
    assert ended.returncode == 4


@pytest.mark.parametrize("terminal", [True, False])
def test_only_a_terminal_gets_the_token_of_an_address(terminal: bool) -> None:
    """The output of a service is kept in a journal, which others may read."""
    output = io.StringIO()
    console = Console(file=output, force_terminal=terminal)
    console.print_address("Inspector", "http://127.0.0.1:8765/?token=secret-token")
    assert ("secret-token" in output.getvalue()) == terminal
    assert "http://127.0.0.1:8765/" in output.getvalue()
