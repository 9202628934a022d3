"""``socialbot new``: create a runnable project with a robot."""

from __future__ import annotations

import importlib.util
import keyword
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.text import Text

from socialbot.core.errors import ParameterError, SocialbotError

AgentKind = Literal["python", "asl"]

PLACEHOLDER = "my_robot"
SUFFIX = ".template"

TEMPLATES = Path(__file__).with_name("templates")
"""Templates: ``common`` for all projects, ``python`` and ``asl`` for the language of the agent."""

HIDDEN = {"gitignore": ".gitignore"}  # target names of templates that would take effect in this repository

NAME = re.compile(r"[a-z][a-z0-9_]*")
TAKEN = frozenset({"tests", "launch", "socialbot"})  # reserved names in a project

NEXT: Mapping[str, str] = {
    "cd {project}": "",
    "socialbot run graph.yaml": "run with simulated people, without a camera",
    "socialbot why": "explain its last action",
    "socialbot inspect": "show the run in the browser",
    "python -m pytest": "run its tests; pip install pytest, if missing",
    "socialbot up camera.yaml --camera 0": "run with a camera, until Ctrl-C",
}


def new(
    name: Annotated[str, typer.Argument(help="Project and Python package: lower-case letters, digits and _.")],
    agent: Annotated[AgentKind, typer.Option(help="Language of the agent; asl: AgentSpeak.")] = "python",
    folder: Annotated[Path, typer.Option(help="Folder for the new project.")] = Path("."),
) -> None:
    """Create a small project with a robot: an agent, its graph and tests. It runs without changes."""
    project = write_project(name, agent, folder)
    console = Console(highlight=False)
    rules = f"{name}/agent.{'asl' if agent == 'asl' else 'py'}"
    console.print(f"{project}: a robot that greets people who come near. Its rules are in {rules}.\n", soft_wrap=True)
    commands = {command.format(project=project): meaning for command, meaning in NEXT.items()}
    width = max(map(len, commands))
    for command, meaning in commands.items():
        console.print(Text.assemble(f"  {command:<{width}}   ", (meaning, "dim")), soft_wrap=True)


def write_project(name: str, agent: AgentKind, folder: Path) -> Path:
    """Create the project ``name`` in a new subfolder of ``folder``, and return that subfolder.

    Raises:
        ParameterError: The name is invalid, or the subfolder exists.
        SocialbotError: The files cannot be written.
    """
    project = folder / name
    if project.exists() or project.is_symlink():
        remedy = "give another name, or another place with --folder; nothing is overwritten"
        raise ParameterError("exists already", where=str(project), remedy=remedy)
    check_name(name)
    try:
        for path, text in project_files(name, agent).items():
            (project / path).parent.mkdir(parents=True, exist_ok=True)
            (project / path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SocialbotError(f"cannot be written: {error.strerror}", where=str(project), remedy="--folder") from error
    return project


def check_name(name: str) -> None:
    """Raise ParameterError unless ``name`` is a valid and unused name of a Python package."""
    if not NAME.fullmatch(name) or keyword.iskeyword(name):
        remedy = "use lower-case letters, digits and _, beginning with a letter: my_robot"
        raise ParameterError(f"{name!r} is not a name for a Python package", where="NAME", remedy=remedy)
    installed = importlib.util.find_spec(name)
    if name in TAKEN or name in sys.stdlib_module_names or (installed is not None and installed.origin is not None):
        what = f"a Python module {name!r} exists already"
        raise ParameterError(what, where="NAME", remedy=f"give another name: {name}_robot")


def project_files(name: str, agent: AgentKind) -> dict[str, str]:
    """Return the files of a project by their relative paths."""
    files = {}
    for part in (TEMPLATES / "common", TEMPLATES / agent):
        for template in sorted(part.rglob(f"*{SUFFIX}")):
            path = template.relative_to(part).as_posix().removesuffix(SUFFIX).replace(PLACEHOLDER, name)
            files[HIDDEN.get(path, path)] = template.read_text("utf-8").replace(PLACEHOLDER, name)
    return files
