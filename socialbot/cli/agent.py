"""The commands ``socialbot agent``: single agents without a robot."""

from __future__ import annotations

import importlib
import logging
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from socialbot.cli._console import print_line
from socialbot.cli._options import expect_effect
from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    from socialbot.bdi import Engine
    from socialbot.cli._agent_shell import Shell
    from socialbot.core.clock import Clock

PANEL = "Write agents and graphs"
EXAMPLES = ("socialbot agent shell greeter.asl",)
agent = typer.Typer(add_completion=False, help="Try out a single agent without a robot.", no_args_is_help=True)


@agent.callback()
def root() -> None:
    """Try out a single agent without a robot."""


@agent.command()
def shell(
    context: typer.Context,
    files: Annotated[list[Path] | None, typer.Argument(metavar="FILE.asl", help="AgentSpeak files.")] = None,
    load: Annotated[
        str | None,
        typer.Option(metavar="MODULE:FUNCTION", help="Agent in Python: a function that returns an Engine for a clock."),
    ] = None,
    name: Annotated[str, typer.Option(help="Name of the agent.")] = "agent",
    clock: Annotated[
        Literal["simulated", "wall"], typer.Option(help="simulated: commands advance the time; wall: real time.")
    ] = "simulated",
) -> None:
    """Open an interactive shell for an agent: beliefs, goals, queries, plans and time. Type help for its commands."""
    from socialbot.cli._agent_shell import Shell
    from socialbot.core.clock import ManualClock, WallClock

    if load is not None:
        expect_effect(context, ("name",), "with --load, whose agent has one")
    logging.getLogger("socialbot.bdi").addHandler(logging.NullHandler())  # the shell shows failures itself
    engine = _engine(load, name, ManualClock() if clock == "simulated" else WallClock())
    opened = Shell(engine, write_line=print_line)
    opened.start()
    for file in files or []:
        opened.handle(f"load {file}")
    if load is not None and not files:
        opened.handle("run")
    try:
        for line in _lines(opened):
            if not opened.handle(line):
                break
    finally:
        opened.close()


def _engine(load: str | None, name: str, clock: Clock) -> Engine:
    """Return an empty agent, or one made by a function."""
    from socialbot.bdi import Engine

    if load is None:
        return Engine(name, clock)
    module, colon, function = load.partition(":")
    if not colon:
        raise ParameterError(f"cannot read {load!r}", where="--load", remedy="write MODULE:FUNCTION")
    sys.path.insert(0, "")
    try:
        build = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as problem:
        raise ParameterError(str(problem), where="--load", remedy="write MODULE:FUNCTION") from problem
    engine = build(clock)
    if not isinstance(engine, Engine):
        raise ParameterError(f"{load} made {engine!r}", where="--load", remedy="have it return an Engine")
    return engine


def _lines(opened: Shell) -> Iterator[str]:
    """Yield the lines of the terminal, a file or a pipe."""
    if not sys.stdin.isatty():
        yield from sys.stdin
        return
    with suppress(ImportError):
        import readline

        readline.set_completer_delims(" ,()&|")
        readline.set_completer(lambda text, state: dict(enumerate(opened.completions(text))).get(state))
        readline.parse_and_bind("tab: complete")
    print_line(f"Agent {opened.engine.name}: help lists the commands, Ctrl-D ends.")
    while True:
        try:
            yield input(opened.prompt)
        except KeyboardInterrupt:
            print_line()
            opened.text = ""
        except EOFError:
            print_line()
            return
