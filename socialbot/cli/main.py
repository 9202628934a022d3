"""The ``socialbot`` command line: one module of this package per command.

A module without a leading underscore is the command of its name. It defines a function, or a `typer.Typer` group, of
that name, its panel of ``socialbot --help`` as ``PANEL``, and command lines for its own help as ``EXAMPLES``. Modules
are imported when their command is used. Errors of the user print one message and set an exit code
(`socialbot.core.errors`).
"""

from __future__ import annotations

import errno
import importlib
import io
import logging
import os
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Annotated, Any, NoReturn, TextIO, cast

import typer
from rich.markup import escape
from typer.core import TyperGroup

from socialbot import __version__
from socialbot.cli._console import LOST, STDOUT, Console, Output, print_line
from socialbot.core.errors import GraphError, InstallationError, ParameterError, SocialbotError, suggestion
from socialbot.core.process import allow_deep_recursion
from socialbot.core.terminal import TerminalFormatter

TAKES_ROS_ARGUMENTS = ("node", "translate")
PANELS = (
    "Start here",
    "Run a graph",
    "Test behaviours",
    "Look into a run",
    "Write agents and graphs",
    "Bags, cameras and scores",
    "Join a running graph",
)
"""Panels of ``socialbot --help``, in order."""
RENAMED: Mapping[str, Mapping[str, str]] = {
    "evaluate": {"--raw": "--no-tracking", "--json": "--figures"},
    "new": {"--agent": "--language", "--folder": "--out"},
}
"""Old names of options by command; they work for one release."""
CONTEXT = {"help_option_names": ["-h", "--help"]}


class Commands(Mapping[str, Any]):
    """All commands by name; access imports the command."""

    def __init__(self) -> None:
        modules = pkgutil.iter_modules([str(Path(__file__).parent)])
        self._names = sorted(one.name for one in modules if not one.name.startswith("_") and one.name != "main")

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise KeyError(name)
        return _load(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@cache
def _load(name: str) -> Any:
    module = importlib.import_module(f"socialbot.cli.{name}")
    if missing := [each for each in (name, "PANEL", "EXAMPLES") if not hasattr(module, each)]:
        remedy = f"define the function {name}, PANEL and EXAMPLES, as docs/howto/extending.md shows"
        raise InstallationError(f"has no {missing[0]}", where=module.__name__, remedy=remedy)
    if module.PANEL not in PANELS:
        raise InstallationError(
            f"unknown PANEL {module.PANEL!r}", where=module.__name__, remedy=suggestion(module.PANEL, PANELS)
        )
    if isinstance(module.EXAMPLES, str):
        raise InstallationError("EXAMPLES is no tuple", where=module.__name__, remedy="write a tuple of command lines")
    found = getattr(module, name)
    if not isinstance(found, typer.Typer):
        function, found = found, typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        found.command(name)(function)
    command = typer.main.get_command(found)
    command.name = name
    command.epilog = "\n\n".join(["Examples:", *(escape(line) for line in module.EXAMPLES)])
    command.rich_help_panel = module.PANEL  # type: ignore[attr-defined]
    return command


class CommandGroup(TyperGroup):
    """The group of all commands."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{**settings, "commands": Commands()})

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names by panel, in the order of `PANELS`."""
        return sorted(self.commands, key=lambda name: (PANELS.index(_load(name).rich_help_panel), name))


app = typer.Typer(
    name="socialbot",
    cls=CommandGroup,
    help="A robot that notices people and acts without being asked.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=CONTEXT,
)


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """A robot that notices people and acts without being asked."""
    if version:
        print_line(f"socialbot {__version__}")
        raise typer.Exit


def main() -> None:
    """The entry point of the ``socialbot`` command."""
    allow_deep_recursion()
    if logging.lastResort is not None:  # prints warnings where no handler does
        logging.lastResort.setFormatter(TerminalFormatter())
    arguments, ros_args = sys.argv[1:], []
    if arguments[:1] and arguments[0] in TAKES_ROS_ARGUMENTS:
        from socialbot.bridge.environment import split_ros_args

        arguments, ros_args = split_ros_args(arguments)
    arguments = with_new_names(arguments)
    try:
        with _named_output():
            command()(arguments, obj=ros_args)
    except SocialbotError as error:
        _end_with(error)
    except OSError as error:
        if error.filename == STDOUT and error.errno in LOST:
            remedy = "free some space, or write to another place"
            _end_with(ParameterError(f"cannot be written: {error.strerror}", where=STDOUT, remedy=remedy))
        if error.errno not in _UNUSABLE or error.filename is None:
            raise
        _end_with(GraphError(f"cannot be used: {error.strerror}", where=os.fsdecode(error.filename)))


@contextmanager
def _named_output() -> Iterator[None]:
    """Name stdout in errors of writing to it, in the block and when its buffer is written at the end."""
    if not isinstance(sys.stdout, io.TextIOWrapper):  # closed, or replaced by a caller
        yield
        return
    before = sys.stdout
    sys.stdout = output = cast(TextIO, Output(before))
    try:
        try:
            yield
        finally:
            output.flush()
    except OSError as error:
        if error.filename == STDOUT and error.errno in LOST:
            null = os.open(os.devnull, os.O_WRONLY)  # for the rest, which Python tries to write at its end
            os.dup2(null, before.fileno())
            os.close(null)
        raise
    finally:
        sys.stdout = before


_UNUSABLE = (errno.EACCES, errno.ELOOP, errno.ENAMETOOLONG, errno.EPERM)
"""Errors of paths that nobody can use, for which `Path.exists` and others raise OSError."""


def _end_with(error: SocialbotError) -> NoReturn:
    Console(stderr=True).print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True)
    sys.exit(error.exit_code)


def with_new_names(arguments: list[str]) -> list[str]:
    """Return the arguments with the new names of `RENAMED` options; print a warning for each old one."""
    if not arguments:
        return arguments
    names, console = RENAMED.get(arguments[0], {}), Console(stderr=True)
    words = arguments.copy()
    for place, word in enumerate(words):
        if word == "--":
            break
        name, equals, value = word.partition("=")
        if name in names:
            words[place] = f"{names[name]}{equals}{value}"
            text = f"{name} of {arguments[0]} is now {names[name]}; the old name will be removed in the next release"
            console.print(f"[yellow]warning[/] {text}", soft_wrap=True)
    return words


@cache
def command() -> TyperGroup:
    """Return the whole command line."""
    return cast(TyperGroup, typer.main.get_command(app))
