"""Runs to check expectations on: a recorded run, the replay of a bag, or the simulation of a graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.bags.reader import open_bag
from socialbot.core.errors import ParameterError, RunError
from socialbot.graph.files import load_graph, with_changes
from socialbot.graph.node import Graph
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import TRACE, RunRecord
from socialbot.runtime.bag_source import BagSource, find_truth, graph_of
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
    def name(self) -> str:
        """Short name for reports and folders."""
        return Path(self.source).stem or "run"

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
