"""Help of the command line: panels, examples, and one meaning per option."""

from __future__ import annotations

import shlex
from typing import Any

import pytest
from typer.testing import CliRunner

from socialbot.cli.main import PANELS, app, command

NAMES = tuple(command().commands)


def examples(name: str) -> list[str]:
    _, *lines = (command().commands[name].epilog or "").split("\n\n")
    return lines


def test_the_help_lists_every_command_in_its_panel():
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "100"}).output
    assert [panel for panel in PANELS if f"─ {panel} ─" in shown] == list(PANELS)
    assert [name for name in NAMES if f"│ {name} " not in shown] == []
    places = [shown.index(f"─ {panel} ─") for panel in PANELS]
    assert places == sorted(places)


@pytest.mark.parametrize("name", NAMES)
def test_examples_can_be_parsed(name: str):
    assert examples(name)
    for line in examples(name):
        parts = [part for part in line.split(" && ") if part.startswith("socialbot ")]
        assert parts[0].split()[1] == name
        for part in parts:
            parse(command(), shlex.split(part)[1:])


def parse(found: Any, words: list[str]) -> None:
    """Parse the words of a command without running it. Raises the usage errors of Typer."""
    while hasattr(found, "commands"):
        found, words = found.commands[words[0]], words[1:]
    found.make_context(found.name, list(words))


def test_a_wrong_example_is_noticed():
    with pytest.raises(Exception, match="No such option: --runer"):
        parse(command(), ["replay", "bag", "--runer", "ros"])


@pytest.mark.parametrize(("option", "begin"), [("--rate", "Speed"), ("--limit", "Limit of"), ("--only", "Run only")])
def test_an_option_has_one_meaning(option: str, begin: str):
    texts = [parameter.help for found in leaves(command()) for parameter in found.params if option in parameter.opts]
    assert texts
    assert [text for text in texts if not text.startswith(begin)] == []


def leaves(found: Any) -> list[Any]:
    """Return all commands without subcommands."""
    return (
        [leaf for each in found.commands.values() for leaf in leaves(each)] if hasattr(found, "commands") else [found]
    )
