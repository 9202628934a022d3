"""Sweeps: replay bags with many settings in parallel, and find where the outcome flips."""

from __future__ import annotations

import hashlib
import itertools
import logging
import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from socialbot import __version__
from socialbot.bags.reader import open_bag
from socialbot.core.decoding import from_json
from socialbot.core.errors import GraphError, InstallationError, ParameterError, RunError, SocialbotError
from socialbot.core.installation import extra_command
from socialbot.core.messages import NO_JSON
from socialbot.core.paths import expect_inside, read_text, temporary_folder, writing
from socialbot.core.reading import read_bytes
from socialbot.graph.files import dump_graph, load_graph, with_changes
from socialbot.graph.node import Graph
from socialbot.runs.expectations import Verdict, evaluate, load_behaviours
from socialbot.runs.expectations.checking import behaviours_path
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.sweeps import Axis, BagResult, Sweep, SweepCell, SweepVerdict, Threshold, in_order, measured
from socialbot.runtime.bag_source import graph_of, replay
from socialbot.runtime.perception_cache import bag_digest
from socialbot.vision.metrics.workers import run_in_processes, run_on_dask

Method = Literal["grid", "random", "sobol", "bisect"]

JOURNAL = "results.jsonl"
"""File with a line for each finished run, in the folder of a sweep."""

MAX_CELLS = 100_000
MAX_MOMENTS = 3
_TOLERANCE = 1 / 64  # Default width of a threshold: share of the range.


@dataclass(frozen=True)
class Span:
    """Range of a number from ``low`` to ``high``; ``step`` is 0 if none is given."""

    low: float
    high: float
    step: float = 0.0


@dataclass(frozen=True)
class Variation:
    """Parameter and its values: listed texts, or a range."""

    name: str
    values: tuple[str, ...] = ()
    span: Span | None = None

    def listed(self) -> tuple[str, ...]:
        """All values. Raises ParameterError for a range without a step, or with more than `MAX_CELLS` steps."""
        if self.span is None:
            return self.values
        if not self.span.step:
            raise ParameterError(
                "a grid needs the step of a range", where=f"--set {self.name}", remedy="write LOW:HIGH:STEP"
            )
        steps = (self.span.high - self.span.low) / self.span.step + 1e-9
        if not steps < MAX_CELLS:
            raise _too_many(f"--set {self.name}", "use larger steps")
        return tuple(number_text(self.span.low + index * self.span.step) for index in range(math.floor(steps) + 1))

    def at(self, share: float) -> str:
        """The value at a ``share`` of the range, from 0 to 1."""
        if self.span is None or self.span.step:
            values = self.listed()
            return values[min(int(share * len(values)), len(values) - 1)]
        return number_text(self.span.low + share * (self.span.high - self.span.low))


def _too_many(where: str, remedy: str) -> ParameterError:
    return ParameterError(f"more than {MAX_CELLS} settings", where=where, remedy=remedy)


def parse_variation(text: str) -> Variation:
    """Parse ``NODE.PARAMETER=VALUE``, ``=A,B,C``, ``=LOW:HIGH:STEP`` or ``=LOW:HIGH``. Raises ParameterError."""
    name, equals, value = text.partition("=")
    if not equals or "." not in name or not value:
        remedy = "write NODE.PARAMETER=2,4,8 or NODE.PARAMETER=LOW:HIGH:STEP"
        raise ParameterError(f"cannot read {text!r}", where="--set", remedy=remedy)
    parts = value.split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        return Variation(name, tuple(dict.fromkeys(value.split(","))))
    low, high, step = (*numbers, 0.0)[:3]
    if not (low < high and step >= 0 and all(map(math.isfinite, numbers))) or (len(numbers) == 3 and not step):
        raise ParameterError(
            f"no range: {value!r}", where=f"--set {name}", remedy="LOW must be below HIGH and STEP positive"
        )
    return Variation(name, span=Span(low, high, step))


def number_text(value: float) -> str:
    """Format a number without rounding noise; whole ones without a point."""
    text = f"{value:.10g}"
    return text if "e" not in text else repr(value)


@dataclass(frozen=True)
class SweepPlan:
    """Settings of a sweep.

    Args:
        bags: Paths of the bags.
        variations: Parameters to vary, or to set.
        graph: Name or file of the graph; by default that of each bag.
        expectations: File with expectations, or the name of an agent package that has one; None for no expectations.
        method: "grid" for all combinations, "random" or "sobol" for ``samples`` of them, "bisect" for the threshold of
            the only range.
        seed: Seed of the samples.
        jobs: Parallel processes.
        scheduler: Address of a Dask scheduler, instead of processes.
    """

    bags: Sequence[Path]
    variations: Sequence[Variation]
    graph: str | None = None
    expectations: Path | None = None
    method: Method = "grid"
    samples: int = 64
    seed: int = 0
    jobs: int = 1
    scheduler: str | None = None

    def cells(self) -> list[tuple[str, ...]]:
        """The settings to run, one text for each variation. Raises ParameterError."""
        if self.method == "grid":
            axes = [variation.listed() for variation in self.variations]
            if math.prod(map(len, axes)) > MAX_CELLS:
                raise _too_many("--set", "use larger steps, or --method sobol")
            return list(itertools.product(*axes))
        shares = _shares(self.method, len(self.variations), self.samples, self.seed)
        rows = [tuple(one.at(share) for one, share in zip(self.variations, row, strict=True)) for row in shares]
        return list(dict.fromkeys(rows))


def _shares(method: str, dimensions: int, samples: int, seed: int) -> list[Sequence[float]]:
    if method == "random":
        numbers = random.Random(seed)
        return [[numbers.random() for _ in range(dimensions)] for _ in range(samples)]
    try:
        from scipy.stats import qmc
    except ImportError as error:
        raise InstallationError(
            "the package 'scipy' is not installed",
            where="--method sobol",
            remedy=f"{extra_command('evaluation')}, or use --method random",
        ) from error
    # The whole net of a power of two is balanced; its beginning serves for other numbers.
    net = qmc.Sobol(dimensions, rng=seed).random_base2(max(0, math.ceil(math.log2(samples))))
    return net[:samples].tolist()


class SweepJob(msgspec.Struct, frozen=True):
    """One run: a bag with changes of its graph."""

    bag: str
    changes: tuple[str, ...]
    graph: str | None
    expectations: str | None


def graph_for(bag: Path, name: str | None, changes: Iterable[str] = ()) -> Graph:
    """Return the graph of a bag, or the named one, with changes. Raises GraphError or ParameterError."""
    return with_changes(load_graph(name) if name else graph_of(bag), list(changes))


def run_job(job: SweepJob) -> BagResult:
    """Replay a bag, and return the decisions and the verdicts of the expectations."""
    logging.getLogger("socialbot").setLevel(logging.ERROR)
    bag = Path(job.bag)
    try:
        with temporary_folder("socialbot-sweep-") as folder:
            replay(bag, graph_for(bag, job.graph, job.changes), Path(folder) / "run").check()
            run = open_run(Path(folder) / "run")
            return measured(run, bag.name, _verdicts(job, run))
    except SocialbotError as error:
        return BagResult(bag=bag.name, error=str(error))


def _verdicts(job: SweepJob, run: RecordedRun) -> list[SweepVerdict]:
    found = evaluate(Path(job.expectations), run) if job.expectations else []
    return [SweepVerdict(each.name, each.passed, _moments(each)) for each in found]


def _moments(verdict: Verdict) -> str:
    """Where an expectation fails: the first moments and the values of its variables."""
    failures = [f"{each.at_s:.2f} s{f' ({each.text})' if each.text else ''}" for each in verdict.failures]
    more = f" and {len(failures) - MAX_MOMENTS} more" if len(failures) > MAX_MOMENTS else ""
    return f"fails at {', '.join(failures[:MAX_MOMENTS])}{more}" if failures else ""


class _Line(msgspec.Struct):
    key: str
    result: BagResult


@dataclass
class Journal:
    """Finished runs in a file: ``results`` by a hash of all that they depend on."""

    path: Path
    results: dict[str, BagResult] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Read the file. Raises RunError if it cannot be made, or leads out of its folder."""
        expect_inside(self.path.parent, self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            lines = read_bytes(self.path).split(b"\n") if self.path.exists() else []
        except OSError as error:
            remedy = "give another folder with --out"
            raise RunError(f"cannot be used: {error.strerror}", where=str(self.path), remedy=remedy) from error
        for line in lines:
            try:
                found = from_json(line, _Line)
            except NO_JSON:  # the line that an interrupted sweep was writing
                continue
            self.results[found.key] = found.result

    def add(self, key: str, result: BagResult) -> None:
        """Write a result. Raises RunError if it cannot be written."""
        self.results[key] = result
        with writing(self.path, RunError), self.path.open("ab") as file:
            file.write(b"\n" + msgspec.json.encode(_Line(key, result)) + b"\n")


class SweepRunner:
    """Runner of a sweep that keeps finished runs in a folder, so that it continues after an interruption.

    Args:
        plan: Settings of the sweep.
        folder: Folder of the sweep.
        progress: Called with the numbers of finished and of all runs.
    """

    def __init__(self, plan: SweepPlan, folder: Path, progress: Callable[[int, int], None]) -> None:
        """Check the plan. Raises SocialbotError."""
        self.plan = plan
        self.reused = 0
        self._progress = progress
        self._journal = Journal(folder / JOURNAL)
        for bag in plan.bags:
            open_bag(bag).close()
        self._bags = {str(bag): bag_digest(bag) for bag in plan.bags}
        self._texts = {str(bag): dump_graph(graph_for(bag, plan.graph)) for bag in plan.bags}
        self._behaviours = None if plan.expectations is None else behaviours_path(plan.expectations).resolve()
        self._expected = "" if self._behaviours is None else read_text(self._behaviours, GraphError)
        if self._behaviours is not None:
            load_behaviours(self._behaviours)
        self._done = 0

    def run(self) -> Sweep:
        """Run all settings. Raises SocialbotError, or SystemExit at a signal."""
        if self.plan.method == "bisect":
            return self._bisect()
        return self._sweep(self._cells(self.plan.cells()))

    def _sweep(self, cells: Sequence[SweepCell], thresholds: Sequence[Threshold] = ()) -> Sweep:
        plan = self.plan
        axes = tuple(
            Axis(one.name, tuple(sorted({cell.values[number] for cell in cells}, key=in_order)))
            for number, one in enumerate(plan.variations)
        )
        name = load_graph(plan.graph).name if plan.graph else graph_of(plan.bags[0]).name
        return Sweep(
            graph=name,
            bags=tuple(bag.resolve().name for bag in plan.bags),
            axes=axes,
            expectations=str(plan.expectations or ""),
            cells=tuple(cells),
            thresholds=tuple(thresholds),
        )

    def _cells(self, settings: Sequence[tuple[str, ...]], first: int = 1) -> list[SweepCell]:
        """Run ``settings`` on all bags."""
        jobs = [self._job(bag, values) for values in settings for bag in self.plan.bags]
        self._check(settings)
        results = self._results(jobs)
        count = len(self.plan.bags)
        return [
            SweepCell(first + number, values, tuple(results[number * count : (number + 1) * count]))
            for number, values in enumerate(settings)
        ]

    def _job(self, bag: Path, values: Sequence[str]) -> SweepJob:
        changes = tuple(f"{one.name}={value}" for one, value in zip(self.plan.variations, values, strict=True))
        expected = None if self._behaviours is None else str(self._behaviours)
        return SweepJob(str(bag.resolve()), changes, self.plan.graph, expected)

    def _check(self, settings: Sequence[tuple[str, ...]]) -> None:
        """Raise the error of an impossible value before anything runs; each value of a parameter once."""
        seen: set[str] = set()
        for values in settings:
            changes = [f"{one.name}={value}" for one, value in zip(self.plan.variations, values, strict=True)]
            new = [change for change in changes if change not in seen]
            seen.update(new)
            if new:
                for bag in self.plan.bags:
                    graph_for(bag, self.plan.graph, changes)

    def _results(self, jobs: Sequence[SweepJob]) -> list[BagResult]:
        keys = [self._key(job) for job in jobs]
        missing = {key: job for key, job in zip(keys, jobs, strict=True) if key not in self._journal.results}
        self.reused += len(set(keys)) - len(missing)
        total = self._done + len(missing)
        self._progress(self._done, total)
        # One run of each bag comes first: it fills the cache for the others.
        first = {job.bag: key for key, job in reversed(missing.items())}
        for part in ([*first.values()], [key for key in missing if key not in first.values()]):
            self._carry_out([missing[key] for key in part], part, total)
        return [self._journal.results[key] for key in keys]

    def _carry_out(self, jobs: Sequence[SweepJob], keys: Sequence[str], total: int) -> None:
        if not jobs:
            return

        def done(number: int, result: BagResult) -> None:
            self._journal.add(keys[number], result)
            self._done += 1
            self._progress(self._done, total)

        arguments = [(job,) for job in jobs]
        if self.plan.scheduler is not None:
            names = [f"{Path(job.bag).name}: {', '.join(job.changes)}" for job in jobs]
            run_on_dask(run_job, arguments, self.plan.scheduler, done=done, names=names)
        elif self.plan.jobs == 1 or len(jobs) == 1:
            for number, job in enumerate(jobs):
                done(number, run_job(job))
        else:
            run_in_processes(run_job, arguments, min(self.plan.jobs, len(jobs)), done=done)

    def _key(self, job: SweepJob) -> str:
        known = {str(bag.resolve()): str(bag) for bag in self.plan.bags}[job.bag]
        parts = [__version__, self._bags[known], self._texts[known], sorted(job.changes), self._expected]
        return hashlib.sha256(msgspec.msgpack.encode(parts)).hexdigest()

    # Bisection

    def _bisect(self) -> Sweep:
        """Find where the outcome flips along the only range, for each combination of the other parameters."""
        ranges = [number for number, one in enumerate(self.plan.variations) if one.span is not None]
        if len(ranges) != 1:
            remedy = "give one parameter as LOW:HIGH, and the others as lists"
            raise ParameterError(
                f"{len(ranges)} parameters have a range, not one", where="--method bisect", remedy=remedy
            )
        axis = ranges[0]
        span = self.plan.variations[axis].span
        assert span is not None
        tolerance = span.step or (span.high - span.low) * _TOLERANCE
        others = [one.values if number != axis else ("",) for number, one in enumerate(self.plan.variations)]
        lines = list(itertools.product(*others))
        known: dict[tuple[str, ...], SweepCell] = {}

        def outcomes(points: Mapping[tuple[str, ...], float]) -> dict[tuple[str, ...], SweepCell]:
            settings = {line: (*line[:axis], number_text(at), *line[axis + 1 :]) for line, at in points.items()}
            new = [values for values in settings.values() if values not in known]
            for cell in self._cells(new, len(known) + 1):
                known[cell.values] = cell
            return {line: known[values] for line, values in settings.items()}

        low, high = dict.fromkeys(lines, span.low), dict.fromkeys(lines, span.high)
        at_low, at_high = outcomes(low), outcomes(high)
        flips = {line for line in lines if self._outcome(at_low[line]) != self._outcome(at_high[line])}
        while any(high[line] - low[line] > tolerance * (1 + 1e-9) for line in flips):
            middle = {line: (low[line] + high[line]) / 2 for line in flips}
            for line, cell in outcomes(middle).items():
                if self._outcome(cell) == self._outcome(at_low[line]):
                    low[line], at_low[line] = middle[line], cell
                else:
                    high[line], at_high[line] = middle[line], cell
        thresholds = [
            Threshold(
                line,
                number_text(low[line]) if line in flips else None,
                number_text(high[line]) if line in flips else None,
                self._named(at_low[line]),
                self._named(at_high[line]) if line in flips else "",
            )
            for line in lines
        ]
        return self._sweep(sorted(known.values(), key=lambda cell: cell.number), thresholds)

    def _outcome(self, cell: SweepCell) -> object:
        return cell.passed if self.plan.expectations else (cell.digests, [one.error for one in cell.results])

    def _named(self, cell: SweepCell) -> str:
        if self.plan.expectations:
            return "passes" if cell.passed else "fails"
        return f"as in cell {cell.number}"
