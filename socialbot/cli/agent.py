"""The commands ``socialbot agent``: single agents without a robot."""

from __future__ import annotations

import importlib
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    from socialbot.bdi import Engine
    from socialbot.cli._agent_shell import Shell
    from socialbot.core.clock import Clock

agent = typer.Typer(help="Runs an agent by itself, to try it out.", no_args_is_help=True)


@agent.callback()
def root() -> None:
    """Runs an agent by itself, to try it out."""


@agent.command()
def shell(
    files: Annotated[list[Path] | None, typer.Argument(metavar="[FILE.asl]...", help="AgentSpeak to load.")] = None,
    load: Annotated[
        str | None,
        typer.Option(metavar="MODULE:FUNCTION", help="An agent in Python: a function that makes an Engine of a clock."),
    ] = None,
    name: Annotated[str, typer.Option(help="The agent's name.")] = "agent",
    clock: Annotated[
        Literal["simulated", "wall"], typer.Option(help="simulated: time passes when you say so; wall: by itself.")
    ] = "simulated",
) -> None:
    """Open an interactive shell for an agent: beliefs, goals, queries, plans and time. Type help for its commands."""
    from socialbot.cli._agent_shell import Shell
    from socialbot.core.clock import ManualClock, WallClock

    logging.getLogger("socialbot.bdi").addHandler(logging.NullHandler())  # the shell shows failures itself
    engine = _engine(load, name, ManualClock() if clock == "simulated" else WallClock())
    opened = Shell(engine, write_line=typer.echo)
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
    try:
        import readline
    except ImportError:
        pass
    else:
        readline.set_completer_delims(" ,()&|")
        readline.set_completer(lambda text, state: dict(enumerate(opened.completions(text))).get(state))
        readline.parse_and_bind("tab: complete")
    typer.echo(f"Agent {opened.engine.name}; help lists what you can type, Ctrl-D ends.")
    while True:
        try:
            yield input(opened.prompt)
        except KeyboardInterrupt:
            typer.echo()
            opened.text = ""
        except EOFError:
            typer.echo()
            return
