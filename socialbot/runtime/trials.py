"""Runs to check expectations on: a recorded run, the replay of a bag, or the simulation of a graph."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.bags.reader import open_bag
from socialbot.core.errors import ParameterError, RunError, SocialbotError
from socialbot.core.paths import temporary_folder
from socialbot.graph.files import load_graph, with_changes
from socialbot.graph.node import Graph, check_parameters
from socialbot.runs.expectations import Expectation, Verdict, evaluate
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import TRACE, RunRecord
from socialbot.runtime.bag_source import BAG_GRAPH, BagSource, find_truth, graph_of
from socialbot.runtime.perception_cache import PerceptionCache
from socialbot.runtime.run import Runner, run
from socialbot.runtime.simulated_source import SimulatedSource

LIMIT_S = 1800.0
GRAPHS = (".yaml", ".yml")


@dataclass(frozen=True)
class Trial:
    """How to get a run from ``source``.

    Args:
        source: Folder of a run, a bag, or the file or name of a graph with a simulated world.
        graph: Graph for a bag; by default that of the bag, else Waldo's.
        changes: Parameters to change, as ``NODE.PARAMETER=VALUE``.
        runner: "inline" or "ros".
        limit_s: Limit of simulated time.
        cache: Whether an inline replay uses the perception in the user's cache, and adds to it.
    """

    source: str
    graph: str | None = None
    changes: tuple[str, ...] = ()
    runner: Runner = "inline"
    limit_s: float = LIMIT_S
    cache: bool = True

    @property
    def is_recorded(self) -> bool:
        return (Path(self.source) / TRACE).is_file()

    @property
    def is_bag(self) -> bool:
        return not self.is_recorded and not self.is_simulated

    @property
    def name(self) -> str:
        """Short name for reports and folders."""
        return Path(os.path.abspath(self.source)).stem

    def __str__(self) -> str:
        if not self.is_bag:
            return self.source
        own = "its own graph" if (Path(self.source) / BAG_GRAPH).is_file() else "the graph waldo"
        return f"{self.source}, with {self.graph or own}"

    def obtain(self, folder: Path) -> RecordedRun:
        """Return the run; a new one is recorded in ``folder``.

        Raises:
            ParameterError: A recorded run cannot have another graph or parameters.
            SocialbotError: The source cannot be used, or the run failed.
        """
        if self.is_recorded:
            if self.graph is not None or self.changes:
                remedy = "give the bag of the run instead, or leave out --graph and --set"
                raise ParameterError("a recorded run cannot be changed", where=self.source, remedy=remedy)
            return open_run(Path(self.source))
        graph = self.loaded()
        if self.is_simulated:
            with RunRecord(folder) as record:
                run(graph, SimulatedSource(0.0, self.limit_s), record, runner=self.runner).check()
        else:
            with open_bag(Path(self.source)) as bag, RunRecord(folder) as record:
                cache = PerceptionCache() if self.cache and self.runner == "inline" else None
                source = BagSource(bag, truth=find_truth(bag), cache=cache)
                run(graph, source, record, runner=self.runner).check()
        return open_run(folder)

    @property
    def is_simulated(self) -> bool:
        path = Path(self.source)
        return path.suffix in GRAPHS or not path.exists()

    def loaded(self) -> Graph:
        """Return the graph that runs, with its changes."""
        if self.is_simulated:
            if self.graph is not None:
                raise ParameterError("only bags are replayed with a graph", where="--graph", remedy="leave it out")
            if not Path(self.source).exists() and "/" in self.source:
                remedy = "give the folder of a run, a bag, or a graph"
                raise RunError("no such file or folder", where=self.source, remedy=remedy)
            return with_changes(load_graph(self.source), self.changes)
        return with_changes(load_graph(self.graph) if self.graph else graph_of(Path(self.source)), self.changes)

    def changed(self, changes: Sequence[str]) -> Trial | None:
        """Return this trial with further changed parameters; None for a recorded run whose bag or graph is gone."""
        if not self.is_recorded:
            return replace(self, changes=(*self.changes, *changes))
        bag = open_run(Path(self.source)).results.get("bag", {}).get("path")
        graph = Path(self.source) / "graph.yaml"
        if bag is None or not Path(bag).exists() or not graph.is_file():
            return None
        return replace(self, source=bag, graph=str(graph), changes=tuple(changes))


FACTORS = (1.1, 1.2, 1.3, 1.5, 1.75, 2.0, 3.0)
"""A parameter is changed by these factors, up and down, until the expectation passes."""

HALVINGS = 4
MOST_RUNS = 120


@dataclass(frozen=True)
class _Setting:
    """Numeric parameter of an agent with its value and limits."""

    node: str
    name: str
    value: float
    minimum: float
    maximum: float
    is_whole: bool

    def text(self, value: float) -> str:
        return f"{self.node}.{self.name}={round(value) if self.is_whole else round(value, 4):g}"

    def steps(self) -> Iterator[list[float]]:
        """Yield the values upwards and downwards, each in growing distance."""
        for up in (True, False):
            raw = [self.value * each if up else self.value / each for each in FACTORS]
            if not self.value:
                raw = [0.5, 1.0, 2.0, 5.0] if up else []
            kept = [min(max(each, self.minimum), self.maximum) for each in raw]
            kept = [float(round(each)) for each in kept] if self.is_whole else kept
            yield [each for each in dict.fromkeys(kept) if each != self.value]


def nearest_changes(
    expectations: Sequence[Expectation], trial: Trial, progress: Callable[[int], None] = lambda runs: None
) -> dict[str, str]:
    """Return for each failed expectation the change that passes and differs least, as ``NODE.PARAMETER=VALUE``.

    The difference is relative to the value. Only numeric parameters of agents are changed, one at a time.

    Args:
        expectations: Those that failed.
        trial: The trial that failed; it runs again for each value.
        progress: Called with the number of runs so far.
    """
    again = trial.changed(())
    if again is None:
        return {}
    with temporary_folder("socialbot-trial-") as folder:
        search = _Search(expectations, again, Path(folder), progress)
        return search.found()


class _Search:
    def __init__(
        self, expectations: Sequence[Expectation], trial: Trial, folder: Path, progress: Callable[[int], None]
    ) -> None:
        self._expectations, self._trial, self._folder, self._progress = expectations, trial, folder, progress
        self._runs = 0
        self._best: dict[str, tuple[float, str]] = {}

    def found(self) -> dict[str, str]:
        for setting in self._settings():
            for values in setting.steps():
                self._walk(setting, values)
        return {name: f"--set {text}" for name, (_, text) in self._best.items()}

    def _settings(self) -> list[_Setting]:
        found = []
        for config in self._trial.loaded().nodes:
            if not config.type.is_agent:
                continue
            values = check_parameters(config.type, config.parameters, where=config.name)
            for name, parameter in config.type.parameters().items():
                value = values[name]
                if isinstance(value, bool) or not isinstance(value, (int, float)):
                    continue
                low = -float("inf") if parameter.minimum is None else float(parameter.minimum)
                high = float("inf") if parameter.maximum is None else float(parameter.maximum)
                found.append(_Setting(config.name, name, float(value), low, high, isinstance(value, int)))
        return found

    def _walk(self, setting: _Setting, values: Sequence[float]) -> None:
        """Try values in growing distance until each expectation passes, then look closer between the last two."""
        before = setting.value
        for value in values:
            if all(self._is_beaten(each, setting, value) for each in self._expectations):
                return
            passed = self._passed(setting, value)
            for expectation in self._expectations:
                if expectation.name in passed and not self._is_beaten(expectation, setting, value):
                    self._note(expectation, setting, self._closest(expectation, setting, before, value))
            before = value

    def _closest(self, expectation: Expectation, setting: _Setting, fails: float, passes: float) -> float:
        for _ in range(HALVINGS):
            middle = (fails + passes) / 2
            middle = float(round(middle)) if setting.is_whole else middle
            if middle in (fails, passes):
                break
            if expectation.name in self._passed(setting, middle):
                passes = middle
            else:
                fails = middle
        for digits in (1, 2):  # a short number, if it passes, too
            short = round(passes, digits)
            if abs(short - setting.value) >= abs(passes - setting.value) and (
                short == passes or expectation.name in self._passed(setting, short)
            ):
                return short
        return passes

    def _is_beaten(self, expectation: Expectation, setting: _Setting, value: float) -> bool:
        best = self._best.get(expectation.name)
        return best is not None and best[0] <= _difference(setting, value)

    def _note(self, expectation: Expectation, setting: _Setting, value: float) -> None:
        if not self._is_beaten(expectation, setting, value):
            self._best[expectation.name] = _difference(setting, value), setting.text(value)

    def _passed(self, setting: _Setting, value: float) -> set[str]:
        """Return the names of the expectations that do not fail with a value, and are put to the test."""
        if self._runs >= MOST_RUNS:
            return set()
        self._runs += 1
        self._progress(self._runs)
        trial = self._trial.changed([setting.text(value)])
        assert trial is not None
        try:
            verdicts: list[Verdict] = evaluate(self._expectations, trial.obtain(self._folder / str(self._runs)))
        except SocialbotError:  # a value that the node refuses
            return set()
        return {each.name for each in verdicts if each.outcome in ("passed", "open")}


def _difference(setting: _Setting, value: float) -> float:
    return abs(value - setting.value) / (abs(setting.value) or 1.0)
