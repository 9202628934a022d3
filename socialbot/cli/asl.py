"""The commands ``socialbot asl``: run and check agents written in AgentSpeak."""

from __future__ import annotations

import itertools
import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import many
from socialbot.core.clock import SECOND, WallClock
from socialbot.core.errors import ParameterError, RuleError, SocialbotError
from socialbot.core.paths import writing
from socialbot.core.process import ENDING_SIGNALS, Ending
from socialbot.core.terminal import TerminalFormatter
from socialbot.runs.junit import TestCase, write_junit

if TYPE_CHECKING:
    from socialbot.bdi.agentspeak import IncludePaths, Program
    from socialbot.bdi.agentspeak.projects import Project
    from socialbot.bdi.agentspeak.unit_tests import TestResult
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.library import Library
    from socialbot.bdi.society import Society
    from socialbot.bdi.trace import Record

PANEL = "Write agents and graphs"
EXAMPLES = (
    "socialbot asl run greeter.asl",
    "socialbot asl check greeter.asl",
    "socialbot asl test tests.asl",
)
asl = typer.Typer(add_completion=False, help="Run and check agents written in AgentSpeak.", no_args_is_help=True)

FilesArgument = Annotated[
    list[Path], typer.Argument(metavar="FILE.asl", help="AgentSpeak programs, or one project (.mas2j).")
]

ActionsOption = Annotated[
    list[str] | None, typer.Option(metavar="MODULE", help="Python module or file with actions; can be repeated.")
]
IncludeOption = Annotated[
    list[Path] | None,
    typer.Option(metavar="FOLDER", help="Folder of included files, searched after that of the program; repeatable."),
]
RootOption = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=FOLDER", help="Folder of the included files whose names begin with $NAME; repeatable."),
]

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
    actions: ActionsOption = None,
    environment: Annotated[
        str | None, typer.Option(metavar="MODULE:CLASS", help="Environment in Python, with percepts and actions.")
    ] = None,
    include: IncludeOption = None,
    root: RootOption = None,
) -> None:
    """Run agents together until they are idle, or until Ctrl-C. By default an agent has the name of its file.

    A project file (.mas2j) names the agents and their programs.
    """
    from socialbot.bdi.agentspeak import read_program
    from socialbot.bdi.agentspeak.loading import begin, library_of
    from socialbot.bdi.agentspeak.projects import environment_of
    from socialbot.bdi.engine import Engine
    from socialbot.bdi.environment import load_environment
    from socialbot.bdi.society import Society
    from socialbot.bdi.stdlib.environment import RawOutput
    from socialbot.cli._agent_shell import EchoActions

    _import_actions(actions)
    paths = _include_paths(include, root)
    arguments: tuple[Any, ...] = ()
    folder = None
    raw: set[str] = set()
    if any(file.suffix == ".mas2j" for file in files):
        project = _project(files, agents)
        paths = replace(paths, folders=(*project.folders, *paths.folders))
        names, programs = _of_project(project, paths)
        raw = {name for agent in project.agents if agent.raw for name in agent.names}
        if environment is None and not (echo and project.environment):
            environment, arguments, folder = environment_of(project), project.arguments, files[0].parent
    else:
        names = _names(files, agents)
        programs = [_checked(read_program(file, paths), file) for file in files]
        if len(files) == 1:
            programs *= len(names)
    libraries = {id(program): library_of(program) for program in programs}
    clock = WallClock()
    society = Society(clock)
    world = None if environment is None else load_environment(environment, arguments, folder)
    if world is not None:
        world.attach(society)
    console, errors = Console(), Console(stderr=True)
    with _tracing(trace) as sink, _warnings():
        colors = itertools.cycle(COLORS)
        loaded: dict[Path, tuple[Program, Library]] = {}

        def made(name: str, library: Library | None) -> Engine:
            engine = Engine(name, clock, sink=sink, library=library)
            engine.out = RawOutput() if name in raw else _printer(console, name, next(colors))
            if echo:
                engine.actions = EchoActions()
            return engine

        def start(name: str, file: str | None, creator: Engine) -> Engine:
            """Make an agent of `.create_agent`."""
            if file is None:
                return made(name, None)
            place = paths.find(file, files[0])
            if place not in loaded:
                program = _checked(read_program(place, paths), place)
                loaded[place] = program, library_of(program)
            program, library = loaded[place]
            engine = made(name, library)
            begin(engine, program)
            return engine

        society.starter = start
        society.include_paths = replace(paths, folders=(files[0].parent, *paths.folders))
        for name, program in zip(names, programs, strict=True):
            engine = society.add(made(name, libraries[id(program)]))
            begin(engine, program)
        with Ending().on_signals():
            for number in ENDING_SIGNALS:
                signal.signal(number, lambda *_: society.stop())
            if steps is not None:
                _run_steps(society, steps, until)
                stopped = True
            else:
                stopped = society.run(linger=world is not None and world.lingers, seconds=until)
    if world is not None:
        world.stop()
    if until is None and not stopped:
        for engine in society.agents.values():
            for intention in list(engine.intentions)[:3]:
                errors.print_plain(f"{engine.name} still waits: {intention}", style="dim")


@asl.command()
def check(
    files: FilesArgument, actions: ActionsOption = None, include: IncludeOption = None, root: RootOption = None
) -> None:
    """Check programs without running them, or all of a project. Exit code 4: there are errors."""
    from socialbot.bdi.agentspeak import AgentSpeakError, read_program
    from socialbot.bdi.agentspeak.loading import needs_of, problems_of, warnings_of

    _import_actions(actions)
    console, errors = Console(), Console(stderr=True)
    paths = _include_paths(include, root)
    if any(file.suffix == ".mas2j" for file in files):
        project = _project(files, None)
        paths = replace(paths, folders=(*project.folders, *paths.folders))
        files = list(dict.fromkeys(agent.file for agent in project.agents))
    failed, warned = False, set[str]()
    for file in files:
        program, problems = None, []
        try:
            program = read_program(file, paths)
            problems = problems_of(program)
        except AgentSpeakError as problem:
            problems = [problem]
        for problem in problems:
            errors.print(Text.assemble(("error: ", "bold red"), str(problem)), soft_wrap=True)
        failed = failed or bool(problems)
        if program is not None and not problems:
            name = f"{file}: " if len(files) > 1 else ""
            console.print_plain(f"{name}ok: {_summary(program)}")
            if needs := needs_of(program):
                console.print_plain(f"{name}needs actions in Python: {', '.join(needs)}")
            warnings = dict.fromkeys(map(str, warnings_of(program)))
            for warning in [each for each in warnings if each not in warned]:  # several may include one file
                errors.print(Text.assemble(("warning: ", "yellow"), warning), soft_wrap=True)
            warned |= warnings.keys()
    if failed:
        raise typer.Exit(AgentSpeakError.exit_code)


@asl.command("test")
def run_tests(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE.asl|FOLDER", help="Programs, or folders with programs.")],
    include: IncludeOption = None,
    root: RootOption = None,
    actions: ActionsOption = None,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Run only tests with this text in their name.")] = "",
    limit: Annotated[float, typer.Option(min=0.0, metavar="SECONDS", help="Limit of simulated time of a test.")] = 60.0,
    output: Annotated[bool, typer.Option("--output", help="Show what passed tests print, too.")] = False,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the results as JUnit XML.")] = None,
) -> None:
    """Run the plans with the annotation `test`, each in simulated time. Exit code 1: one failed, or there is none."""
    from socialbot.bdi.agentspeak.unit_tests import programs_in

    _import_actions(actions)
    found, places = programs_in(paths), _include_paths(include, root)
    with _warnings(logging.ERROR):
        passed = report_tests(found, places, names=only, seconds=limit, shows=output, junit=junit)
    if not passed:
        raise typer.Exit(1)


def _project(files: list[Path], agents: str | None) -> Project:
    """Read a project file. Raises RuleError if it is not alone."""
    from socialbot.bdi.agentspeak.projects import read_project

    if len(files) > 1 or agents is not None:
        raise RuleError("a project names its agents itself", where=str(files[0]), remedy="give the project file alone")
    project = read_project(files[0])
    errors = Console(stderr=True)
    for note in project.notes:
        errors.print_plain(f"note: {files[0]}: {note}", style="dim")
    return project


def _of_project(project: Project, paths: IncludePaths) -> tuple[list[str], list[Program]]:
    """Return the names and programs of the agents of a project."""
    from socialbot.bdi.agentspeak.projects import program_of

    names, programs = [], []
    for agent in project.agents:
        names += agent.names
        programs += [_checked(program_of(agent, paths), agent.file)] * len(agent.names)
    return names, programs


def _checked(program: Program, file: Path) -> Program:
    """Check a program. Raises AgentSpeakError with the first error, and the number of the others."""
    from socialbot.bdi.agentspeak.loading import problems_of

    problems = problems_of(program)
    if problems:
        first = problems[0]
        if len(problems) > 1:
            first.remedy = f"{first.remedy or ''}\n  and {len(problems) - 1} more: socialbot asl check {file}".lstrip()
        raise first
    return program


def _import_actions(modules: list[str] | None) -> None:
    from socialbot.bdi.stdlib.actions import import_module

    for module in modules or ():
        import_module(module)


def _include_paths(folders: list[Path] | None, roots: list[str] | None) -> IncludePaths:
    """Return the places of included files. Raises RuleError for a root without a folder."""
    from socialbot.bdi.agentspeak import IncludePaths

    found = {}
    for root in roots or ():
        name, _, folder = root.removeprefix("$").partition("=")
        if not name or not folder or not Path(folder).is_dir():
            raise RuleError(
                f"{root!r} names no folder", where="--root", remedy="write NAME=FOLDER, such as jacamoJar=lib"
            )
        found[name] = Path(folder)
    return IncludePaths(tuple(folders or ()), found)


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
        return lambda text: print_line(f"[{name}] {text}")
    return lambda text: console.print(Text.assemble((f"[{name}]", color), f" {text}"), soft_wrap=True)


def _tracing(file: Path | None) -> AbstractContextManager[Callable[[Record], None] | None]:
    from socialbot.bdi.agentspeak.printer import agentspeak
    from socialbot.bdi.trace import JsonLines

    if file is None:
        return nullcontext()
    with writing(file, ParameterError):
        return JsonLines(file, text=agentspeak)


@contextmanager
def _warnings(level: int = logging.WARNING) -> Iterator[None]:
    """Show warnings of agents on stderr."""
    log, handler = logging.getLogger("socialbot.bdi"), logging.StreamHandler()
    handler.setLevel(level)
    handler.setFormatter(TerminalFormatter("warning: %(message)s"))
    propagate, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = propagate


def report_tests(
    files: list[Path], paths: IncludePaths, *, names: str, seconds: float, shows: bool, junit: Path | None
) -> bool:
    """Run the tests of programs and report them; return whether all passed."""
    from socialbot.bdi.agentspeak.unit_tests import TestFile

    console = Console(soft_wrap=True)
    results: list[TestResult] = []
    broken: list[tuple[Path, str]] = []
    for file in files:
        try:
            program = TestFile(file, paths)
        except SocialbotError as problem:
            broken.append((file, str(problem)))
            console.print(Text(str(file)))
            console.print(Text.assemble(("  error ", "bold red"), str(problem)))
            continue
        tests = [test for test in program.tests if names in test.name]
        if tests:
            console.print(Text(str(file)))
        for test in tests:
            result = program.run(test, seconds)
            results.append(result)
            _print_result(console, result, shows=shows)
    failed = sum(not result.passed for result in results)
    counts = [f"{len(results) - failed} passed", f"{failed} failed"]
    if broken:
        counts.append(f"{many(len(broken), 'file')} not run")
    console.print(f"{many(len(results), 'test')}: {', '.join(counts)}")
    if junit is not None:
        write_junit(junit, {"socialbot asl test": _cases(results, broken)})
    return not failed and not broken and bool(results)


def _print_result(console: Console, result: TestResult, *, shows: bool) -> None:
    word = ("  ok    ", "green") if result.passed else ("  FAIL  ", "bold red")
    console.print(Text.assemble(word, f"{result.test.name}"))
    for reason in result.reasons:
        console.print(Text(f"        {reason}"))
    if shows or not result.passed:
        for line in result.output:
            console.print(Text(f"        | {line}", style="dim"))


def _cases(results: list[TestResult], broken: list[tuple[Path, str]]) -> list[TestCase]:
    cases = [
        TestCase(
            str(result.test.file),
            result.test.name,
            result.seconds,
            result.test.line,
            failure=() if result.passed else result.reasons,
            output=result.output,
        )
        for result in results
    ]
    return [*cases, *(TestCase(str(path), "load", error=problem) for path, problem in broken)]
