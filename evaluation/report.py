"""Evaluation results: figures with their requirements, as a table, JSON and HTML."""

from __future__ import annotations

import itertools
import logging
import os
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from socialbot.core.errors import SocialbotError
from socialbot.core.paths import writing
from socialbot.runs.pages import Cell, Page, Section, Table, series_charts, settings
from socialbot.runs.record import versions

JsonOption = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write the figures to FILE and an HTML page to FILE.html."),
]
QuickOption = Annotated[bool, typer.Option("--quick", help="A shorter run: under a minute.")]
JobsOption = Annotated[int | None, typer.Option(min=1, help="Number of parallel runs; default: one per core.")]
DomainOption = Annotated[
    int | None,
    typer.Option(min=0, max=101, help="ROS domain, unused by others; default: ROS_DOMAIN_ID, or a free one."),
]

R = TypeVar("R")
T = TypeVar("T")

PAGE_WIDTH = 140
UNMET_EXIT = 1
"""Exit code if a requirement is not met."""

Value = float | int | bool | str | None


@dataclass(frozen=True)
class Figure:
    """Figure with its ``key`` in the JSON. ``required`` is its upper limit or truth value.

    ``others`` is the value of a paper or another program.
    """

    key: str
    text: str
    value: Value
    required: float | bool | None = None
    others: str = ""

    @property
    def ok(self) -> bool | None:
        """Whether the requirement is met; None without one."""
        if self.required is None:
            return None
        if isinstance(self.required, bool):
            return self.value is self.required
        return isinstance(self.value, (int, float)) and self.value <= self.required


@dataclass(frozen=True)
class Machine:
    """Machine of the measurement, with its load (processes, one-minute mean) before."""

    processor: str
    cores: int
    system: str
    load_before: float
    versions: dict[str, str] = field(default_factory=dict)

    @classmethod
    def here(cls) -> Machine:
        cores = len(os.sched_getaffinity(0))
        system = f"{platform.system()} {platform.release()}"
        return cls(_processor(), cores, system, round(os.getloadavg()[0], 2), versions())

    def show(self, console: Console) -> None:
        console.print(
            f"{self.processor}, {self.cores} cores, {self.system}, Python {self.versions['python']}; "
            f"load before: {self.load_before}",
            style="dim",
            soft_wrap=True,
        )


@dataclass
class Report:
    """Figures of one evaluation; ``tables`` map titles to rows by node or other name."""

    title: str
    quick: bool
    machine: Machine = field(default_factory=Machine.here)
    figures: list[Figure] = field(default_factory=list)
    tables: dict[str, dict[str, dict[str, Value]]] = field(default_factory=dict)

    def add(self, key: str, text: str, value: Value, required: float | bool | None = None, *, others: str = "") -> None:
        self.figures.append(Figure(key, text, value, required, others))

    @property
    def unmet(self) -> list[str]:
        return [figure.key for figure in self.figures if figure.ok is False]

    def content(self) -> dict[str, Any]:
        return {
            "evaluation": self.title,
            "quick": self.quick,
            "machine": msgspec.to_builtins(self.machine),
            **{figure.key: figure.value for figure in self.figures},
            "required": {figure.key: figure.required for figure in self.figures if figure.required is not None},
            **({"others": others} if (others := {one.key: one.others for one in self.figures if one.others}) else {}),
            "unmet": self.unmet,
            **self.tables,
        }

    def check(self) -> None:
        """Exit with `UNMET_EXIT` if a requirement is not met."""
        if self.unmet:
            sys.exit(UNMET_EXIT)

    def finish(self, file: Path | None) -> None:
        """Print the report and, if ``file`` is given, `write` it.

        Raises:
            SocialbotError: The file cannot be written.
        """
        if file is not None:
            write(self.content(), self.page(), file)
        self.show(Console(highlight=False, width=None if sys.stdout.isatty() else PAGE_WIDTH))

    def page(self) -> Page:
        required = [figure for figure in self.figures if figure.ok is not None]
        missed = f"; not met: {', '.join(self.unmet)}" if self.unmet else ""
        return Page(
            title=f"{self.title}{' (quick)' if self.quick else ''}",
            lead=f"{len(required) - len(self.unmet)} of {len(required)} requirements are met{missed}."
            if required
            else "",
            verdict="" if not required else "requirements not met" if self.unmet else "requirements met",
            good=not self.unmet,
            sections=[
                Section("Figures", self._figures().html()),
                *(Section(name, series_charts(rows) + _table(rows).html()) for name, rows in self.tables.items()),
                setting(self.machine),
            ],
        )

    def _figures(self) -> Table:
        others = any(figure.others for figure in self.figures)
        rows: list[list[Cell]] = [
            [
                figure.text,
                (_plain(figure.value), "r"),
                (_limit(figure.required), "r"),
                {None: "", True: ("ok", "good"), False: ("no", "bad")}[figure.ok],
                *([figure.others] if others else []),
            ]
            for figure in self.figures
        ]
        return Table(("figure", "value", "required", "ok", *(["others"] if others else [])), rows)

    def show(self, console: Console) -> None:
        console.print(f"[bold]{self.title}[/]{' (quick)' if self.quick else ''}")
        self.machine.show(console)
        console.print(self._figures().terminal())
        for name, rows in self.tables.items():
            console.print(name, style="italic", markup=False)
            console.print(_table(rows).terminal())


def write(content: Mapping[str, Any], page: Page, file: Path) -> None:
    """Write figures as JSON to ``file``, and their page beside it (.html).

    Raises:
        SocialbotError: A file cannot be written.
    """
    with writing(file):
        file.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
    page.write(file.with_suffix(".html"))


def setting(machine: Machine) -> Section:
    """Return the page section on machine and setup."""
    told = {
        "command": " ".join(["python", "-m", _module(), *sys.argv[1:]]),
        "processor": f"{machine.processor}, {machine.cores} cores",
        "system": machine.system,
        "load before": machine.load_before,
        **machine.versions,
    }
    return Section("Measurement conditions", settings(told))


def run(command: Callable[..., None]) -> None:
    """Run ``command`` with the command-line options; print user errors as one message."""
    app = typer.Typer(
        add_completion=False, pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]}
    )
    app.command()(command)
    try:
        app()
    except SocialbotError as error:
        Console(stderr=True, highlight=False).print(f"[bold red]error[/] {escape(str(error))}", soft_wrap=True)
        sys.exit(error.exit_code)


def percentile(values: Sequence[float], share: float) -> float | None:
    """Return the smallest value not exceeded by ``share`` of all; None for an empty list."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else None


def _table(rows: Mapping[str, Mapping[str, Value]]) -> Table:
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    texts = {column for column in columns if any(isinstance(row.get(column), str) for row in rows.values())}
    cells: list[list[Cell]] = [
        [name, *((_plain(row.get(column)), "" if column in texts else "r") for column in columns)]
        for name, row in rows.items()
    ]
    return Table(("", *columns), cells)


def _module() -> str:
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return Path(sys.argv[0]).stem if spec is None else spec.name.removesuffix(".__main__")


def _limit(required: float | bool | None) -> str:
    return "" if required is None else "yes" if required is True else f"at most {_plain(required)}"


def _plain(value: Value) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4g}" if abs(value) < 100 else f"{value:.6g}"
        case _:
            return str(value)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


class Bar:
    """Progress bar for ``total`` runs, on stderr while it is entered."""

    def __init__(self, text: str, total: int) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )
        self._task = self._progress.add_task(text, total=total)

    def __enter__(self) -> Bar:
        self._progress.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._progress.stop()

    def advance(self, number: int = 0, result: object = None) -> None:
        self._progress.advance(self._task)


def hush() -> None:
    """Silence the logs of intended failures."""
    logging.disable(logging.CRITICAL)


def run_all(
    function: Callable[..., T], arguments: Sequence[tuple[Any, ...]], jobs: int | None, text: str = "runs"
) -> list[T]:
    """Call ``function`` for all ``arguments`` in ``jobs`` processes, by default one per core, with a progress bar.

    Results and their order do not depend on ``jobs``. Processes do not log.
    """
    from socialbot.vision.metrics.workers import run_in_processes

    with Bar(text, len(arguments)) as bar:
        cores = len(os.sched_getaffinity(0))
        return run_in_processes(function, arguments, jobs or cores, initializer=hush, done=bar.advance)


def run_kinds(function: Callable[[R], T], kinds: Mapping[str, Sequence[R]], jobs: int | None) -> dict[str, list[T]]:
    """Call ``function`` for all arguments in ``jobs`` processes, and return the results by kind; see `run_all`."""
    results = iter(run_all(function, [(one,) for some in kinds.values() for one in some], jobs))
    return {kind: list(itertools.islice(results, len(some))) for kind, some in kinds.items()}
