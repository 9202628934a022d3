"""Recorded run, loaded from its folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from socialbot.core import paths
from socialbot.core.bounded_log import is_whole, parts
from socialbot.core.decoding import from_json, json_decoder
from socialbot.core.errors import RunError, SocialbotError
from socialbot.core.limits import DATA_BYTES
from socialbot.core.messages import NO_JSON, Health, Message, Stamp, TraceRecord
from socialbot.core.reading import check_size, open_file, read_bytes
from socialbot.graph.files import parse_recorded
from socialbot.graph.node import Graph
from socialbot.runs.history import History
from socialbot.runs.record import DIAGNOSTICS, ENDED_WELL, SCORED, SEEN, SOUNDS, STOPPED, TRACE, NodeReport
from socialbot.runs.run import ImageSource, RunView
from socialbot.vision.metrics.scores import ScoredFrame

T = TypeVar("T")

_SOUND = re.compile(r"[\w-]+\.wav")
RUNS = Path("runs")

NAMED_LINES = 20
"""Unreadable lines of a file that are named one by one; further ones are counted."""


class RecordedRun(RunView):
    """Run in a folder. ``damage`` lists unreadable parts.

    Raises:
        RunError: The folder holds no run.
    """

    def __init__(self, folder: Path, images: ImageSource | None = None) -> None:
        self.folder = folder
        self.damage: list[str] = []
        results, graph = self._results(), self._load_graph()
        start = results.get("bag", {}).get("start")
        history = History(self._records(folder / TRACE), start=start if isinstance(start, int) else None)
        super().__init__(graph, history, images)
        self.results = results
        self._read_seen()
        path = folder / SCORED
        self.scored: list[ScoredFrame] = list(self._lines(path, ScoredFrame)) if path.is_file() else []
        """Results of each frame with ground truth."""

    @property
    def problems(self) -> Sequence[str]:
        """The reason of a failed or stopped run, and the damaged parts of its record."""
        ended, until = self.results.get("ended", ""), f"after {self.history.duration_s:.1f} s"
        stopped = [f"This run was stopped {until}, before its end."] if ended == STOPPED else []
        failed = [f"This run failed {until}: {ended}"] if ended not in (*ENDED_WELL, STOPPED) else []
        return [*stopped, *failed, *self.damage]

    @property
    def lasted_s(self) -> float:
        """How long the run lasted (s), by its results; its last record may be earlier."""
        told = self.results.get("bag", {}).get("duration_s") or self.results.get("seconds")
        return max(self.history.duration_s, told) if isinstance(told, (int, float)) else self.history.duration_s

    @property
    def title(self) -> str:
        """Name of the graph, and of the bag or folder."""
        bag = self.results.get("bag", {}).get("path")
        graph = str(self.results.get("graph") or "").capitalize() or super().title
        return ": ".join(filter(None, (graph, Path(bag).name if bag else self.folder.resolve().name)))

    def sound(self, name: str) -> bytes | None:
        path = self.folder / SOUNDS / name
        if not _SOUND.fullmatch(name) or not path.is_file():
            return None
        if not paths.leads_inside(self.folder, path):
            return None
        return read_bytes(path)

    # Reading

    def _results(self) -> Mapping[str, Any]:
        path = self.folder / "results.json"
        if not path.exists():
            self.damage.append("results.json is missing: the run has not ended, or was broken off")
            return {}
        try:
            data = read_bytes(path)
            from_json(data, _Results)
            return from_json(data, dict[str, Any])
        except (OSError, *NO_JSON) as error:
            self.damage.append(f"results.json cannot be read: {error}")
            return {}

    def _load_graph(self) -> Graph | None:
        path = self.folder / "graph.yaml"
        if not path.exists():
            return None
        try:
            return parse_recorded(paths.read_text(path, RunError), where=str(path), folder=self.folder)
        except (OSError, UnicodeDecodeError, SocialbotError) as error:
            self.damage.append(f"graph.yaml cannot be used: {error}")
            return None

    def _records(self, path: Path) -> Iterator[TraceRecord]:
        if not path.is_file():
            remedy = "give a folder with a trace.jsonl, such as runs/TIME, which every run leaves"
            raise RunError("there is no run", where=str(self.folder), remedy=remedy)
        if not is_whole(path):
            self.damage.append(f"{path.name}: the beginning is gone: of a long run the newest is kept (up --keep)")
        return self._lines(path, TraceRecord)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, Message]]:
        """Yield the recorded messages of simulators on ``topics``, in order."""
        kinds = {} if self.graph is None else self.graph.topics()
        for topic, message in self._seen({topic: kinds[topic] for topic in topics if topic in kinds}):
            if isinstance(message, Message):
                yield topic, message

    def _read_seen(self) -> None:
        if self.graph is None:
            return
        for _, message in self._seen({**self.graph.topics(), DIAGNOSTICS: NodeReport}):
            if isinstance(message, NodeReport | Health):
                self.node_history.take(self.history.seconds(message.stamp), message)
            elif self.world_view is not None:
                self.world_view.take(message)

    def _seen(self, kinds: Mapping[str, type[Message | NodeReport]]) -> Iterator[tuple[str, Message | NodeReport]]:
        """Yield the messages of seen.jsonl on topics with these types."""
        lines, path = json_decoder(_Line), self.folder / SEEN

        def decode(text: bytes) -> tuple[str, Message | NodeReport | None]:
            line = lines.decode(text)
            kind = kinds.get(line.topic)
            return line.topic, None if kind is None else from_json(line.message, kind)

        if path.is_file():
            yield from ((topic, message) for topic, message in self._decoded(path, decode) if message is not None)

    def _lines(self, path: Path, kind: type[T]) -> Iterator[T]:
        return self._decoded(path, json_decoder(kind).decode)

    def _decoded(self, path: Path, decode: Callable[[bytes], T]) -> Iterator[T]:
        """Yield the lines of a file and its older parts; note unreadable ones, except for a truncated last line."""
        skipped = 0
        for part in parts(path):
            try:
                check_size(part, DATA_BYTES)
                with open_file(part) as lines:
                    for number, line in enumerate(lines, 1):
                        try:
                            if line != b"\n":
                                yield decode(line)
                        except NO_JSON as error:
                            if not line.endswith(b"\n"):
                                continue
                            skipped += 1
                            if skipped <= NAMED_LINES:
                                self.damage.append(f"{part.name}:{number}: {error}: the line is skipped")
            except OSError as error:
                raise RunError(f"cannot be read: {error.strerror}", where=str(part)) from error
        if skipped > NAMED_LINES:
            self.damage.append(f"{path.name}: {skipped} lines are skipped; the first {NAMED_LINES} are named above")


class _Bag(msgspec.Struct, frozen=True):
    path: Annotated[str, msgspec.Meta(pattern=r"^[^\x00]*$")] = ""
    start: Stamp | None = None
    duration_s: float | None = None


class _Totals(msgspec.Struct):
    calls: int | None = None
    failures: int | None = None
    skipped: int | None = None
    cpu_s: float | None = None
    peak_rss_mb: float | None = None
    first_failure: str | None = None


class _Band(msgspec.Struct):
    tp: int
    fp: int
    fn: int
    precision: float | None
    recall: float | None
    f1: float | None


class _Scores(msgspec.Struct):
    frames: int = 0
    bands: dict[str, _Band] = {}


class _Results(msgspec.Struct):
    """Types of the values in results.json that are read; others may have any type."""

    graph: str | None = None
    ended: str = ""
    privacy: str = "none"
    bag: _Bag = _Bag()
    nodes: dict[str, _Totals] = {}
    parameters: dict[str, dict[str, Any]] = {}
    labels: dict[str, str] = {}
    versions: dict[str, Any] = {}
    scores: _Scores | None = None
    wall_s: float = 0.0
    seconds: float | None = None
    simulated_s: float = 0.0


class _Line(msgspec.Struct):
    topic: str
    message: msgspec.Raw


def open_run(folder: Path | str, images: ImageSource | None = None) -> RecordedRun:
    """Open the run in ``folder``; unreadable parts are skipped and listed in ``damage``.

    Raises:
        RunError: The folder holds no run.
    """
    return RecordedRun(Path(folder), images)


def newest_run(folder: Path = RUNS) -> Path:
    """Return the folder of the latest run below ``folder``.

    Raises:
        RunError: There is no run.
    """
    found = list(folder.glob(f"*/{TRACE}"))
    if not found:
        raise RunError("there is no run yet", where=str(folder), remedy="give the folder of a run")
    return max(found, key=lambda path: (path.stat().st_mtime_ns, path)).parent
