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
"""The name of the project in the templates."""

SUFFIX = ".template"
"""The suffix of templates, which keeps tools from treating them as code."""

TEMPLATES = Path(__file__).with_name("templates")
"""Templates: ``common`` for all projects, ``python`` and ``asl`` for the language of the agent."""

HIDDEN = {"gitignore": ".gitignore"}
"""Target names of templates that would take effect in this repository."""

NAME = re.compile(r"[a-z][a-z0-9_]*")
TAKEN = frozenset({"tests", "launch", "socialbot"})
"""Reserved names in a project."""

NEXT: Mapping[str, str] = {
    "cd {project}": "",
    "socialbot run graph.yaml": "among people that are made up: no camera is needed",
    "socialbot why": "why it did what it did last",
    "socialbot inspect": "the same on a page, from what it saw to what it did",
    "python -m pytest": "its tests; pip install pytest, if there is none",
    "socialbot up camera.yaml --camera 0": "with a camera, until Ctrl-C",
}
"""The next commands for the user, each with its purpose."""


def new(
    name: Annotated[str, typer.Argument(help="Of the project and its Python package: small letters, digits and _.")],
    agent: Annotated[
        AgentKind, typer.Option(help="What the robot's rules are written in: Python, or AgentSpeak (asl).")
    ] = "python",
    folder: Annotated[Path, typer.Option(help="Where the project's folder is made.")] = Path("."),
) -> None:
    """Create a small project with a robot: an agent, its graph and tests. It runs without changes."""
    project = write_project(name, agent, folder)
    console = Console(highlight=False)
    rules = f"{name}/agent.{'asl' if agent == 'asl' else 'py'}"
    console.print(f"{project}: a robot that greets who comes near. What it does stands in {rules}.\n", soft_wrap=True)
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
        what = f"{name!r} is no name for a Python package"
        raise ParameterError(what, where="NAME", remedy="use small letters, digits and _, a letter first: my_robot")
    if name in TAKEN or name in sys.stdlib_module_names or _is_installed(name):
        what = f"there is a Python module {name!r} already, which would take its place"
        raise ParameterError(what, where="NAME", remedy=f"give another name: {name}_robot")


def project_files(name: str, agent: AgentKind) -> dict[str, str]:
    """Return the files of a project by their relative paths."""
    files = {}
    for part in (TEMPLATES / "common", TEMPLATES / agent):
        for template in sorted(part.rglob(f"*{SUFFIX}")):
            path = template.relative_to(part).as_posix().removesuffix(SUFFIX).replace(PLACEHOLDER, name)
            files[HIDDEN.get(path, path)] = template.read_text("utf-8").replace(PLACEHOLDER, name)
    return files


def _is_installed(name: str) -> bool:
    """Whether a package of this name is importable, other than as a mere folder."""
    found = importlib.util.find_spec(name)
    return found is not None and found.origin is not None
