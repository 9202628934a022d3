"""``socialbot new``: create a runnable project with a robot."""

from __future__ import annotations

import importlib.util
import keyword
import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.text import Text

from socialbot.cli._console import Console
from socialbot.cli._options import RobotOption
from socialbot.core.errors import GraphError, ParameterError, SocialbotError
from socialbot.core.installation import pip_command
from socialbot.core.paths import read_text, writing

PANEL = "Start here"
EXAMPLES = (
    "socialbot new greeter && cd greeter && socialbot run graph.yaml",
    "socialbot new rover --template planning",
    "socialbot new host --robot reachy_mini",
)
Language = Literal["python", "asl"]
Template = Literal["greeter", "planning"]

PLACEHOLDER = "my_robot"
PROFILE = "ROBOT_PROFILE"
PROFILES = "profiles"
"""Folder of a project with the files of other profiles that its own one changes."""
LIKE = re.compile(r"^like: *(\S+)", re.MULTILINE)
SUFFIX = ".template"
AFTER_ROBOT = "Next, in the documentation"
"""Text of a README that follows the commands for a robot."""

TEMPLATES = Path(__file__).with_name("templates")
"""Templates: ``common`` for greeters, ``python`` and ``asl`` for their language, ``planning`` for planning robots."""

HIDDEN = {"gitignore": ".gitignore"}  # target names of templates that would take effect in this repository

NAME = re.compile(r"[a-z][a-z0-9_]*")
TAKEN = frozenset({"tests", "launch", "socialbot", PROFILES})  # reserved names in a project

NEXT: Mapping[str, str] = {
    "cd {project}": "",
    "socialbot run graph.yaml": "run with simulated people, without a camera",
    "socialbot why": "explain its last action",
    "socialbot inspect": "show the run in the browser",
    "socialbot test behaviours.py graph.yaml": "check that it behaves as expected",
    "python -m pytest": "run its tests",
    "socialbot up camera.yaml --camera 0": "run with a camera, until Ctrl-C",
}
NEXT_ROBOT: Mapping[str, str] = {
    "socialbot doctor --robot robot.yaml": "check that the robot answers",
    "socialbot up robot_graph.yaml": "run on the robot, until Ctrl-C",
}
NEXT_PLANNING: Mapping[str, str] = {
    "cd {project}": "",
    "socialbot run graph.yaml --limit 60": "run in simulated time",
    "socialbot why": "explain its last action",
    "socialbot inspect": "show the run in the browser",
    "socialbot test behaviours.py graph.yaml": "check that it behaves as expected",
    "python -m pytest": "run its tests",
}


def new(
    name: Annotated[str, typer.Argument(help="Project and Python package: lower-case letters, digits and _.")],
    language: Annotated[Language, typer.Option(help="Language of the agent; asl: AgentSpeak.")] = "python",
    out: Annotated[Path, typer.Option(help="Folder for the new project.")] = Path("."),
    template: Annotated[
        Template, typer.Option(help="greeter: greets people; planning: plans its actions with a PDDL domain.")
    ] = "greeter",
    robot: RobotOption = None,
) -> None:
    """Create a small project with a robot: an agent, its graph and tests. It runs without changes.

    With --robot, the project has a profile and a graph for this robot, too.
    """
    if template == "planning" and language == "asl":
        raise ParameterError("is written in Python", where="--template planning", remedy="omit --language asl")
    if template == "planning" and robot is not None:
        raise ParameterError("has no camera and no head", where="--template planning", remedy="omit --robot")
    project = write_project(name, language, out, template, robot)
    console = Console()
    rules = f"{name}/agent.{'asl' if language == 'asl' else 'py'}"
    what = f"a robot that greets people who come near. Its rules are in {rules}."
    if template == "planning":
        what = f"a robot that plans. Its actions are in {name}/domain.pddl and {rules}."
    console.print(f"{project}: {what}\n", soft_wrap=True)
    following = NEXT_PLANNING if template == "planning" else {**NEXT, **(NEXT_ROBOT if robot else {})}
    commands = {command.format(project=project): meaning for command, meaning in following.items()}
    if importlib.util.find_spec("pytest") is None:
        commands["python -m pytest"] += f"; before them: {pip_command('install', 'pytest')}"
    width = max(map(len, commands))
    for command, meaning in commands.items():
        console.print(Text.assemble(f"  {command:<{width}}   ", (meaning, "dim")), soft_wrap=True)


def write_project(
    name: str, language: Language, folder: Path, template: Template = "greeter", robot: str | None = None
) -> Path:
    """Create the project ``name`` in a new subfolder of ``folder``, and return that subfolder.

    Raises:
        ParameterError: The name is invalid, the subfolder exists, or the files cannot be written.
        GraphError: The ``robot`` is unknown, or its profile is invalid.
    """
    project = folder / name
    if project.exists() or project.is_symlink():
        remedy = "give another name, or another place with --out; nothing is overwritten"
        raise ParameterError("exists already", where=str(project), remedy=remedy)
    check_name(name)
    try:
        with writing(project, remedy="give another place with --out"):
            for path, text in project_files(name, language, template, robot).items():
                (project / path).parent.mkdir(parents=True, exist_ok=True)
                (project / path).write_text(text, encoding="utf-8")
    except SocialbotError:
        shutil.rmtree(project, ignore_errors=True)  # nothing is overwritten, also at the next try
        raise
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


def project_files(
    name: str, language: Language, template: Template = "greeter", robot: str | None = None
) -> dict[str, str]:
    """Return the files of a project by their relative paths. Raises GraphError for an unknown ``robot``."""
    if template == "planning":
        return {".gitignore": _files_of("common", name)[".gitignore"], **_files_of("planning", name)}
    files = _files_of("common", name) | _files_of(language, name)
    if robot is None:
        return files
    added = _robot_files(name, robot)
    before, following, after = files["README.md"].partition(AFTER_ROBOT)
    return {**files, **added, "README.md": f"{before}{added['README.md']}{following}{after}"}


def _robot_files(name: str, robot: str) -> dict[str, str]:
    from socialbot.core.registry import robot_files
    from socialbot.robots.profile import load_profile

    load_profile(robot)
    own = {} if robot in robot_files() else _profiles_like(Path(robot), frozenset(robot_files()))
    named = next(iter(own), robot)
    return own | {path: text.replace(PROFILE, named) for path, text in _files_of("robot", name).items()}


def _profiles_like(file: Path, registered: frozenset[str]) -> dict[str, str]:
    """The text of a profile, and of the files that it changes by ``like``, by their paths in the project."""
    text = read_text(file, GraphError)
    found = LIKE.search(text)
    if found is None or (like := found[1].strip("\"'")) in registered:
        return {f"{PROFILES}/{file.name}": text}
    moved = text[: found.start(1)] + Path(like).name + text[found.end(1) :]
    return {f"{PROFILES}/{file.name}": moved, **_profiles_like(file.parent / like, registered)}


def _files_of(part: str, name: str) -> dict[str, str]:
    files = {}
    for template in sorted((TEMPLATES / part).rglob(f"*{SUFFIX}")):
        path = template.relative_to(TEMPLATES / part).as_posix().removesuffix(SUFFIX).replace(PLACEHOLDER, name)
        files[HIDDEN.get(path, path)] = template.read_text("utf-8").replace(PLACEHOLDER, name)
    return files
