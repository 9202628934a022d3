"""Help of the command line: panels, examples, and one meaning per option."""

from __future__ import annotations

import os
import pkgutil
import py_compile
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import CliRunner

import socialbot
from socialbot.cli.main import PANELS, Commands, app, command, with_new_names
from socialbot.core.errors import InstallationError

NAMES = tuple(command().commands)
PACKAGE = Path(socialbot.__path__[0])
OF_COMPILED_FILES = ("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")


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


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({"PANEL": "Run a graph", "EXAMPLES": ()}, "socialbot.cli.tally: has no tally\n"),
        ({"tally": print, "EXAMPLES": ()}, "has no PANEL\n"),
        ({"tally": print, "PANEL": "Run a graph"}, "has no EXAMPLES\n"),
        ({"tally": print, "PANEL": "Run graphs", "EXAMPLES": ()}, "did you mean 'Run a graph'?"),
        ({"tally": print, "PANEL": "Run a graph", "EXAMPLES": "socialbot tally"}, "EXAMPLES is no tuple"),
    ],
)
def test_a_command_without_its_parts_is_reported(attributes, words, monkeypatch):
    module = ModuleType("socialbot.cli.tally")
    vars(module).update(attributes)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(pkgutil, "iter_modules", lambda _: [pkgutil.ModuleInfo(None, "tally", False)])  # type: ignore
    with pytest.raises(InstallationError) as caught:
        Commands()["tally"]
    assert words in str(caught.value)


def parse(found: Any, words: list[str]) -> None:
    """Parse the words of a command without running it. Raises the usage errors of Typer."""
    while hasattr(found, "commands"):
        found, words = found.commands[words[0]], words[1:]
    found.make_context(found.name, list(words))


def test_a_wrong_example_is_noticed():
    with pytest.raises(Exception, match="No such option: --runer"):
        parse(command(), ["replay", "bag", "--runer", "ros"])


MEANINGS = {
    "--actions": "Python module or file with actions",
    "--agent": "Agent to ",
    "--at": "Time ",
    "--bag": "Record a bag ",
    "--cache": "Reuse cached detections ",
    "--camera-info": "Calibration of the camera",
    "--composed": "Run all nodes in one process",
    "--domain": "ROS domain ",
    "--duration": "Time limit",
    "--faults": "Faults",
    "--folder": "Folder of keys",
    "--format": "Format ",
    "--graph": "(Built-in graph|Graph) ",
    "--host": "Address ",
    "--html": "Write a page ",
    "--image-topic": "Image topic",
    "--include": "Folder ",
    "--inspect": "Show the run in the browser",
    "--jobs": "Parallel processes",
    "--json": "Print JSON",
    "--junit": "Write the results as JUnit XML",
    "--label": "Label ",
    "--limit": "Limit of simulated time",
    "--machine": "Machine of a deployment",
    "--only": "Run only ",
    "--out": "Folder for ",
    "--pace": "Wait ",
    "--person": "Id of the person",
    "--port": "Port",
    "--privacy": "Pictures",
    "--quick": "Skip a slow check: ",
    "--rate": "Speed",
    "--robot": "Robot: name or file",
    "--root": "Folder of the included files",
    "--runner": "inline: ",
    "--scheduler": "Scheduler of a Dask cluster",
    "--seed": "Seed ",
    "--set": "Change a parameter",
    "--storage": "mcap or sqlite3",
    "--timeout": "Time limit",
    "--token": "Token that ",
    "--truth": "Ground truth",
    "--verbose": "Also print ",
    "--visitors": "Number of people of a random schedule",
    "--video": "Write the annotated video",
    "--world": "physics: MuJoCo",
}
"""Options of several commands, with the beginning of their help."""


def options_of_several_commands() -> dict[str, list[Any]]:
    """Return the visible options that more than one command has, by name."""
    found: dict[str, list[Any]] = {}
    for parameter in (parameter for leaf in leaves(command()) for parameter in leaf.params):
        if parameter.opts[0].startswith("--") and not getattr(parameter, "hidden", False):
            found.setdefault(parameter.opts[0], []).append(parameter)
    return {name: parameters for name, parameters in found.items() if len(parameters) > 1}


def test_an_option_of_several_commands_has_one_meaning():
    shared = options_of_several_commands()
    assert sorted(shared) == sorted(MEANINGS)
    for name, begin in MEANINGS.items():
        assert [each.help for each in shared[name] if not re.match(begin, each.help)] == [], name
        assert len({each.is_flag for each in shared[name]}) == 1, f"{name} takes a value in some commands only"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("evaluate bag --raw", "evaluate bag --no-tracking"),
        ("evaluate bag --json=figures.json", "evaluate bag --figures=figures.json"),
        ("new robot --agent asl --folder there", "new robot --language asl --out there"),
    ],
)
def test_old_names_of_options_work_with_a_warning(old: str, new: str, capsys: pytest.CaptureFixture[str]):
    assert with_new_names(old.split()) == new.split()
    assert "warning" in capsys.readouterr().err
    parse(command(), new.split())
    assert with_new_names(new.split()) == new.split()
    assert with_new_names(["why", "--json"]) == ["why", "--json"]
    assert with_new_names(["evaluate", "--", "--raw"]) == ["evaluate", "--", "--raw"]
    assert capsys.readouterr().err == ""


def test_damaged_compiled_modules_are_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that becomes full while Python compiles leaves a part of the file, which would end each start."""
    copied = Path(
        shutil.copytree(PACKAGE, tmp_path / "socialbot", ignore=shutil.ignore_patterns("*.pyc.*", "*.mcap", "*.onnx"))
    )
    environment = {name: value for name, value in os.environ.items() if name not in OF_COMPILED_FILES}

    def shown_graph() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "socialbot", "graph", "waldo"]  # that of the working directory
        return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=300)

    names = ("core/terminal", "cli/main", "cli/graph", "vision/person_detector")  # of the start, a command, a node type
    with monkeypatch.context() as here:
        here.setattr(sys, "pycache_prefix", None)
        files = [Path(str(py_compile.compile(str(copied / f"{name}.py"), doraise=True))) for name in names]
    whole = [file.read_bytes() for file in files]
    for file, content in zip(files, whole, strict=True):
        file.write_bytes(content[:200])
    files[0].write_bytes(whole[0][:16] + b"?" + whole[0][17:])  # no type of marshal
    healed = shown_graph()
    assert healed.returncode == 0, healed.stderr
    assert all(str(file) in healed.stderr for file in files)
    again = shown_graph()
    assert (again.returncode, again.stderr) == (0, "")
    assert [len(file.read_bytes()) for file in files] == [len(content) for content in whole]


def leaves(found: Any) -> list[Any]:
    """Return all commands without subcommands."""
    return (
        [leaf for each in found.commands.values() for leaf in leaves(each)] if hasattr(found, "commands") else [found]
    )
