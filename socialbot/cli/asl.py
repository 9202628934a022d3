"""The commands ``socialbot asl``: run and check agents written in AgentSpeak."""

from __future__ import annotations

import json
import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.text import Text

from socialbot.cli._options import many
from socialbot.core.clock import SECOND, WallClock
from socialbot.core.errors import ParameterError, RuleError
from socialbot.core.paths import read_text
from socialbot.core.process import ENDING_SIGNALS, Ending

if TYPE_CHECKING:
    from socialbot.bdi.agentspeak import Program
    from socialbot.bdi.society import Society
    from socialbot.bdi.trace import Record

asl = typer.Typer(help="Run and check agents written in AgentSpeak.", no_args_is_help=True)

FilesArgument = Annotated[list[Path], typer.Argument(metavar="FILE.asl", help="AgentSpeak programs.")]

COLORS = ("cyan", "green", "magenta", "yellow", "blue", "bright_red", "bright_cyan", "bright_green")


@asl.command()
def run(
    files: FilesArgument,
    agents: Annotated[
        str | None, typer.Option(help="Names separated by commas: one per file, or several agents of one file.")
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Limit of reasoning cycles, of all agents together.")] = None,
    until: Annotated[float | None, typer.Option(min=0.0, metavar="SECONDS", help="Time limit.")] = None,
    trace: Annotated[Path | None, typer.Option(help="Write the trace of all agents as JSON lines.")] = None,
    echo: Annotated[bool, typer.Option("--echo", help="Print unknown actions instead of failing.")] = False,
) -> None:
    """Run agents together until they are idle, or until Ctrl-C. By default an agent has the name of its file."""
    from socialbot.bdi.agentspeak.loading import begin, library_of
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.society import Society
    from socialbot.cli._agent_shell import EchoActions

    names = _names(files, agents)
    programs = [_program(read_text(file, RuleError), str(file)) for file in files]
    if len(files) == 1:
        programs *= len(names)
    libraries = {id(program): library_of(program) for program in programs}
    clock = WallClock()
    society = Society(clock)
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    with _tracing(trace) as sink, _warnings():
        for number, (name, program) in enumerate(zip(names, programs, strict=True)):
            engine = Engine(name, clock, sink=sink, library=libraries[id(program)])
            engine.out = _printer(console, name, COLORS[number % len(COLORS)])
            if echo:
                engine.actions = EchoActions()
            society.add(engine)
            begin(engine, program)
        with Ending().on_signals():
            for number in ENDING_SIGNALS:
                signal.signal(number, lambda *_: society.stop())
            if steps is not None:
                _run_steps(society, steps, until)
            else:
                society.run(linger=False, seconds=until)
    if steps is None and until is None and not society.stopping:
        for engine in society.agents.values():
            for intention in list(engine.intentions)[:3]:
                errors.print(f"{engine.name} still waits: {intention}", style="dim", soft_wrap=True, markup=False)


@asl.command()
def check(files: FilesArgument) -> None:
    """Check programs without running them. Exit code 4: there are errors."""
    from socialbot.bdi.agentspeak import AgentSpeakError, parse
    from socialbot.bdi.agentspeak.loading import check as problems_in

    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)
    failed = False
    for file in files:
        text = read_text(file, RuleError)
        problems = problems_in(text, str(file))
        for problem in problems:
            errors.print(Text.assemble(("error: ", "bold red"), str(problem)), soft_wrap=True)
        failed = failed or bool(problems)
        if not problems:
            name = f"{file}: " if len(files) > 1 else ""
            console.print(f"{name}ok: {_summary(parse(text, str(file)))}", soft_wrap=True, markup=False)
    if failed:
        raise typer.Exit(AgentSpeakError.exit_code)


def _program(text: str, file: str) -> Program:
    """Parse and check a program. Raises AgentSpeakError with the first error, and the number of the others."""
    from socialbot.bdi.agentspeak import parse
    from socialbot.bdi.agentspeak.loading import problems_of

    program = parse(text, file)
    problems = problems_of(program, text, file)
    if problems:
        first = problems[0]
        if len(problems) > 1:
            first.remedy = f"{first.remedy or ''}\n  and {len(problems) - 1} more: socialbot asl check {file}".lstrip()
        raise first
    return program


def _names(files: list[Path], agents: str | None) -> list[str]:
    """Return the names of the agents. Raises RuleError if their number differs from that of the files."""
    names = [file.stem for file in files] if agents is None else [name.strip() for name in agents.split(",")]
    if agents is not None and len(files) > 1 and len(names) != len(files):
        raise RuleError(
            f"{len(names)} names for {len(files)} files", where="--agents", remedy="give as many names as files"
        )
    if "" in names:
        raise RuleError("a name is missing", where="--agents", remedy="write the names with single commas: a,b")
    return names


def _summary(program: Program) -> str:
    counts = {"plan": program.plans, "rule": program.inferences, "belief": program.beliefs, "goal": program.goals}
    return ", ".join(many(len(found), noun) for noun, found in counts.items() if found or noun != "rule")


def _run_steps(society: Society, steps: int, until: float | None) -> None:
    """Run at most ``steps`` reasoning cycles in total; sleep while all agents wait."""
    end = None if until is None else society.clock.now() + round(until * SECOND)
    while steps > 0 and not society.stopping and (end is None or society.clock.now() < end):
        if society.run_until_idle(1, turns=1):
            steps -= 1
            continue
        due = society.next_wakeup()
        if due is None:
            return
        wake = due if end is None else min(due, end)
        time.sleep(min(0.1, max(0.0, (wake - society.clock.now()) / SECOND)))


def _printer(console: Console, name: str, color: str) -> Callable[[str], None]:
    if not console.is_terminal:
        return lambda text: print(f"[{name}] {text}", flush=True)
    return lambda text: console.print(Text.assemble((f"[{name}]", color), f" {text}"), soft_wrap=True)


@contextmanager
def _tracing(file: Path | None) -> Iterator[Callable[[Record], None] | None]:
    if file is None:
        yield None
        return
    from socialbot.bdi.agentspeak.printer import agentspeak

    try:
        lines = file.open("w", encoding="utf-8")
    except OSError as problem:
        raise ParameterError(f"cannot be written: {problem.strerror}", where=str(file)) from problem
    with lines:
        yield lambda record: print(json.dumps(asdict(record), default=agentspeak), file=lines)


@contextmanager
def _warnings() -> Iterator[None]:
    """Show warnings of agents on stderr."""
    log, handler = logging.getLogger("socialbot.bdi"), logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    handler.setFormatter(logging.Formatter("warning: %(message)s"))
    propagate, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = propagate
