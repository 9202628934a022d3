"""Recorded run, loaded from its folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from socialbot.core.bounded_log import is_whole, parts
from socialbot.core.errors import RunError, SocialbotError
from socialbot.core.messages import Health, Message, TraceRecord
from socialbot.core.registry import WorldView, phrases_of, world_view_of
from socialbot.graph.files import parse_graph
from socialbot.graph.node import Graph
from socialbot.graph.status import NodeStatus
from socialbot.runs.history import History
from socialbot.runs.narration import Wording
from socialbot.runs.plan_trees import PlanTree, trees_at
from socialbot.runs.record import DIAGNOSTICS, SCORED, SEEN, TRACE, NodeReport
from socialbot.runs.run import GraphView, ImageSource, NodeHistory, Picture, graph_view
from socialbot.runs.state import StateIndex
from socialbot.runs.timeline import Timeline, timeline_of
from socialbot.vision.metrics.scores import ScoredFrame

T = TypeVar("T")
RUNS = Path("runs")
"""Default folder of runs."""


class RecordedRun:
    """Run in a folder. ``damage`` lists unreadable parts.

    Raises:
        RunError: The folder holds no run.
    """

    live = False

    def __init__(self, folder: Path, pictures: ImageSource | None = None) -> None:
        self.folder = folder
        self.damage: list[str] = []
        self.results: Mapping[str, Any] = self._results()
        self._graph = self._load_graph()
        self._pictures = pictures
        start = self.results.get("bag", {}).get("start")
        self.history = History(self._records(folder / TRACE), start=start if isinstance(start, int) else None)
        self.wording = wording_of(self._graph)
        self._world: WorldView | None = None if self._graph is None else world_view_of(self._graph)
        self._nodes = NodeHistory([each.name for each in self._graph.placements] if self._graph else [])
        self._read_seen()
        path = folder / SCORED
        self.scored: list[ScoredFrame] = list(self._lines(path, ScoredFrame)) if path.is_file() else []
        """Results of each frame with ground truth."""

    @property
    def title(self) -> str:
        """Name of the graph, and of the bag or folder."""
        bag = self.results.get("bag", {}).get("path")
        graph = str(self.results.get("graph") or (self._graph.name if self._graph else ""))
        return ": ".join(filter(None, (graph.capitalize(), Path(bag).name if bag else self.folder.resolve().name)))

    @property
    def end(self) -> int:
        return self.history.end

    @property
    def described(self) -> Graph | None:
        return self._graph

    @property
    def stage(self) -> WorldView | None:
        """World view of the run, if it has one."""
        return self._world

    @property
    def health(self) -> list[tuple[float, Health]]:
        """Changes of node health with their times (s)."""
        return self._nodes.health

    @property
    def told(self) -> Mapping[str, Sequence[tuple[float, NodeReport]]]:
        """Diagnostics of each node with their times (s)."""
        return self._nodes.told

    @property
    def sees(self) -> bool:
        return self._pictures is not None

    @property
    def course(self) -> StateIndex:
        return self._course

    @cached_property
    def _course(self) -> StateIndex:
        course = StateIndex(self.history, self.wording)
        course.prepare()
        return course

    @property
    def timeline(self) -> Timeline:
        return self._timeline

    @cached_property
    def _timeline(self) -> Timeline:
        return timeline_of(self.history, self.wording)

    def picture(self, stamp: int) -> Picture | None:
        return None if self._pictures is None else self._pictures.at(stamp)

    def world(self, stamp: int) -> str | None:
        return self._world.picture(stamp, "") if self._world else None

    def trees(self, stamp: int) -> tuple[PlanTree, ...]:
        return trees_at(self.history, stamp, self.wording)

    def nodes(self, stamp: int) -> tuple[NodeStatus, ...]:
        fates: Mapping[str, Any] = self.results.get("nodes", {})
        return () if self._graph is None else self._nodes.at(self.history.seconds(stamp), fates)

    def graph(self) -> GraphView:
        return GraphView() if self._graph is None else graph_view(self._graph, self._nodes.machines)

    # Reading

    def _results(self) -> Mapping[str, Any]:
        path = self.folder / "results.json"
        if not path.exists():
            self.damage.append("results.json is missing: the run has not ended, or was broken off")
            return {}
        try:
            return msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        except (OSError, msgspec.MsgspecError) as error:
            self.damage.append(f"results.json cannot be read: {error}")
            return {}

    def _load_graph(self) -> Graph | None:
        path = self.folder / "graph.yaml"
        if not path.exists():
            return None
        try:
            return parse_graph(path.read_text("utf-8"), where=str(path))
        except (OSError, UnicodeDecodeError, SocialbotError) as error:
            self.damage.append(f"graph.yaml cannot be used: {error}")
            return None

    def _records(self, path: Path) -> list[TraceRecord]:
        if not path.is_file():
            remedy = "give a folder with a trace.jsonl, such as runs/TIME, which every run leaves"
            raise RunError("there is no run", where=str(self.folder), remedy=remedy)
        if not is_whole(path):
            self.damage.append(f"{path.name}: the beginning is gone: of a long run the newest is kept (up --keep)")
        return list(self._lines(path, TraceRecord))

    def _read_seen(self) -> None:
        path = self.folder / SEEN
        if self._graph is None or not path.is_file():
            return
        kinds = {**self._graph.topics(), DIAGNOSTICS: NodeReport}
        for line in self._lines(path, _Line):
            kind = kinds.get(line.topic)
            if kind is not None:
                self._see(msgspec.json.decode(line.message, type=kind))

    def _see(self, message: Message | NodeReport) -> None:
        if isinstance(message, NodeReport | Health):
            self._nodes.take(self.history.seconds(message.stamp), message)
        elif self._world is not None:
            self._world.take(message)

    def _lines(self, path: Path, kind: type[T]) -> Iterator[T]:
        """Yield the lines of a file and its older parts; note unreadable ones, except for a truncated last line."""
        decoder = msgspec.json.Decoder(kind)
        for part in parts(path):
            try:
                lines = part.read_bytes().split(b"\n")
            except OSError as error:
                raise RunError(f"cannot be read: {error.strerror}", where=str(part)) from error
            for number, line in enumerate(lines, 1):
                try:
                    if line:
                        yield decoder.decode(line)
                except msgspec.MsgspecError as error:
                    if number < len(lines):
                        self.damage.append(f"{part.name}:{number}: {error}")


class _Line(msgspec.Struct):
    topic: str
    message: msgspec.Raw


def wording_of(graph: Graph | None) -> Wording:
    """Return the names and phrases for a graph; nodes that share a display name keep their own."""
    placements = graph.placements if graph is not None else ()
    called = {each.name: each.type.display_name for each in placements}
    count = Counter(called.values())
    names = {name: people_say for name, people_say in called.items() if people_say and count[people_say] == 1}
    return Wording(names, phrases_of(graph))


def open_run(folder: Path, pictures: ImageSource | None = None) -> RecordedRun:
    """Open the run in ``folder``; unreadable parts are skipped and listed in ``damage``.

    Raises:
        RunError: The folder holds no run.
    """
    return RecordedRun(folder, pictures)


def newest_run(folder: Path = RUNS) -> Path:
    """Return the folder of the latest run below ``folder``.

    Raises:
        RunError: There is no run.
    """
    found = list(folder.glob(f"*/{TRACE}"))
    if not found:
        raise RunError("there is no run yet", where=str(folder), remedy="give the folder of a run")
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path)).parent
