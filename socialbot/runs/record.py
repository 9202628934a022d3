"""Record of a run: trace, results and, from agents without a trace, derived records."""

from __future__ import annotations

import contextlib
import logging
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import msgspec
from msgspec.structs import replace

from socialbot import __version__
from socialbot.core import paths
from socialbot.core.bounded_log import BoundedLog, LossyLog
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    Health,
    HeardSpeech,
    JointTrajectory,
    Message,
    PersonDetections,
    SpeechStatus,
    Structured,
    TraceRecord,
    Utterance,
)
from socialbot.core.registry import event_log_of, world_view_of
from socialbot.graph.files import dump_graph
from socialbot.graph.node import Graph

if TYPE_CHECKING:
    from socialbot.vision.metrics.scores import ScoredFrame

T = TypeVar("T", bound="RunTrace")

RECORDED: tuple[type[Message], ...] = (
    PersonDetections, TraceRecord, ActionRequest, HeardSpeech, Utterance, SpeechStatus, HeadCommand, JointTrajectory,
)  # fmt: skip
"""Message types of a run."""

WELL = "well"
NOTHING_WANTED = "nobody wants anything more"
NOTHING_SHOWN = "there is nothing more to see"
TIME_UP = "the time was up"
ENDED_WELL = ("", WELL, NOTHING_WANTED, NOTHING_SHOWN, TIME_UP)
STOPPED = "stopped by a signal"
"""Values of ``reason`` in results.json for the end of a run; a failed run has its error there."""

TRACE, SEEN, RESULTS = "trace.jsonl", "seen.jsonl", "results.json"

SOUNDS = "speech"
"""Folder of sound files of utterances in the folder of a run."""

LOGS, MINDS = "log", "minds"
"""Folders of logs of processes, and of saved states of agents, in the folder of a run."""

VIDEO = "annotated.mp4"

SCORED = "scored.jsonl"
"""File with found, missed and false detections by frame with ground truth."""

DIAGNOSTICS = "/diagnostics"
GRAPH = "graph.yaml"

log = logging.getLogger("socialbot.record")


class SeenLine(msgspec.Struct, frozen=True):
    """Line of seen.jsonl: a message of a topic."""

    topic: str
    message: Any


class NodeReport(msgspec.Struct, frozen=True):
    """Report of a node on /diagnostics at ``stamp`` (ns)."""

    stamp: int
    name: str
    values: Mapping[str, str]


class RunListener(Protocol):
    """Observer of a run while it is recorded."""

    def observe(self, topic: str, message: Message) -> None: ...

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None: ...

    def note_problem(self, text: str) -> None:
        """Note why the record cannot be written; empty when it can."""


Privacy = Literal["none", "blur", "no-images"]
"""Pictures in a record: as they are, with people blurred, or left out."""


class RunTrace:
    """Trace of a run: writes each message as a TraceRecord to disk before the next one is processed.

    Args:
        folder: Folder of the run; nodes may keep files there.
        max_bytes: Size limit of the trace, and of seen.jsonl; the newest lines are kept.
        labels: Labels of the run for results.json, such as its participant and condition in a study.
        lossy: Go on without a record while it cannot be written, for live runs. Otherwise this ends the run.

    Raises:
        SocialbotError: The folder cannot be created or written, holds a run, or a link that leads out of it.
    """

    def __init__(
        self,
        folder: Path,
        *,
        max_bytes: int | None = None,
        labels: Mapping[str, str] | None = None,
        lossy: bool = False,
    ) -> None:
        self.folder = folder
        self._lossy = lossy
        self.labels = dict(labels or {})
        self.privacy: Privacy = "none"
        self._max_bytes = max_bytes
        for name in (GRAPH, SEEN, RESULTS, SCORED, VIDEO):
            paths.expect_inside(folder, folder / name)
        for name in (SOUNDS, LOGS, MINDS):
            paths.expect_all_inside(folder / name)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._trace = LossyLog(BoundedLog(folder / TRACE, max_bytes))
        except FileExistsError as error:
            raise _unusable("holds a run already", folder, "give another folder with --out") from error
        except OSError as error:
            raise _unusable(f"cannot be written: {error.strerror}", folder, "give another --out") from error
        paths.allow(folder)
        self._encoder = msgspec.json.Encoder()
        self._seen: LossyLog | None = None
        self._graph = ""
        self._told = ""
        self._world_topics: frozenset[str] = frozenset()
        self._world_kinds: tuple[type[Message], ...] = ()
        self._last: dict[tuple[str, str], Message] = {}
        self._listeners: tuple[RunListener, ...] = ()

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for file in self._files():
            file.close()
        if error is not None:
            self._discard_unstarted()

    def _discard_unstarted(self) -> None:
        """Remove the files of a run that was refused before it started, so that its folder can be used."""
        logs = [self.folder / name for name in (TRACE, SEEN)]
        with contextlib.suppress(OSError):
            if not (self.folder / RESULTS).exists() and not any(log.exists() and log.stat().st_size for log in logs):
                for file in (*logs, self.folder / GRAPH):
                    file.unlink(missing_ok=True)
                for folder in (*(each for each in self.folder.iterdir() if each.is_dir()), self.folder):
                    folder.rmdir()  # unless it holds files

    @property
    def size(self) -> int:
        """Size of the trace (bytes)."""
        return self._trace.size

    def add_listener(self, listener: RunListener) -> None:
        self._listeners = (*self._listeners, listener)

    def describe(self, graph: Graph) -> None:
        """Write graph.yaml, and record what the world view needs, and node health, in seen.jsonl from now on.

        Raises:
            ParameterError: A parameter of a node does not fit the world view.
            SocialbotError: The folder cannot be written.
        """
        view = world_view_of(graph)
        self._world_kinds = () if view is None else view.kinds
        worlds = (config for config in graph.nodes if config.type.is_simulator)
        self._world_topics = frozenset(topic for world in worlds for topic, _ in world.publications)
        try:
            self._seen = LossyLog(BoundedLog(self.folder / SEEN, self._max_bytes, self._latest_lines))
            self._graph = dump_graph(graph)
            (self.folder / GRAPH).write_text(self._graph, encoding="utf-8")
        except OSError as error:
            raise _unusable(f"cannot be written: {error.strerror}", self.folder, "give another --out") from error

    @property
    def lost(self) -> int:
        """Number of lines that could not be written."""
        return sum(file.lost for file in self._files())

    def check(self) -> str:
        """Return why the record cannot be written at present; empty if it can. Listeners learn of a change.

        Files that were removed are made again.
        """
        for file in self._files():
            file.restore()
        problem = next((file.problem for file in self._files() if file.problem), "")
        with contextlib.suppress(OSError):
            graph = self.folder / GRAPH
            if self._graph and not problem and not graph.exists():  # the folder was removed, and is there again
                paths.replace_file(graph, self._graph.encode())
        text = f"the record cannot be written ({problem}): {self.lost} lines are lost" if problem else ""
        if bool(text) != bool(self._told):
            log.warning("%s", text or f"the record is written again; {self.lost} lines are lost")
        if text != self._told:
            self._told = text
            for listener in self._listeners:
                listener.note_problem(text)
        return problem

    def _files(self) -> Iterator[LossyLog]:
        yield self._trace
        if self._seen is not None:
            yield self._seen

    def observe(self, topic: str, message: Message) -> None:
        for listener in self._listeners:
            listener.observe(topic, message)
        record = trace_record(topic, message)
        if record is not None:
            self._write(self._trace, self._encoder.encode(record))
        elif isinstance(message, Structured) and (
            topic in self._world_topics or isinstance(message, (Health, *self._world_kinds))
        ):
            self._see(topic, message)

    def write_results(self, results: dict[str, Any]) -> Path:
        self.check()
        path = self.folder / RESULTS
        try:
            paths.replace_file(path, msgspec.json.format(msgspec.json.encode(results), indent=2) + b"\n")
        except OSError as error:
            if not self._lossy:
                raise _unusable(f"cannot be written: {error.strerror}", self.folder, "free some space") from error
            log.warning("%s cannot be written: %s", path, error.strerror)
        return path

    def write_scored(self, frames: Iterable[ScoredFrame]) -> None:
        """Write scored.jsonl: one line per frame with ground truth. Raises SocialbotError if it cannot be written."""
        try:
            paths.replace_file(self.folder / SCORED, self._encoder.encode_lines(frames))
        except OSError as error:
            raise _unusable(f"cannot be written: {error.strerror}", self.folder, "free some space") from error

    def note_node(self, stamp: int, name: str, values: Mapping[str, str]) -> None:
        """Record a report of a node on /diagnostics."""
        for listener in self._listeners:
            listener.note_node(stamp, name, values)
        self._write_seen(DIAGNOSTICS, NodeReport(stamp, name, values))

    def _see(self, topic: str, message: Message) -> None:
        """Write a message that differs from the last one of its topic and sender."""
        sender = message.node if isinstance(message, Health) else ""
        last = self._last.get((topic, sender))
        if last is None or replace(last, stamp=message.stamp) != message:
            self._last[topic, sender] = message
            self._write_seen(topic, message)

    def _latest_lines(self) -> Iterator[bytes]:
        last = list(self._last.items())  # another thread may record meanwhile
        return (self._encoder.encode(SeenLine(topic, message)) for (topic, _), message in last)

    def _write_seen(self, topic: str, message: Message | NodeReport) -> None:
        if self._seen is not None:
            self._write(self._seen, self._encoder.encode(SeenLine(topic, message)))

    def _write(self, file: LossyLog, line: bytes) -> None:
        file.write(line)
        if file.problem and not self._lossy:
            raise _unusable(f"cannot be written: {file.problem}", self.folder, "free some space, or give another --out")


class RunRecord(RunTrace):
    """Trace of a finite run that also keeps detections, actions and utterances."""

    def __init__(self, folder: Path, *, labels: Mapping[str, str] | None = None) -> None:
        super().__init__(folder, labels=labels)
        self.detections: list[PersonDetections] = []
        self.actions: list[ActionRequest] = []
        self.utterances: list[Utterance] = []

    def observe(self, topic: str, message: Message) -> None:
        if isinstance(message, PersonDetections):
            self.detections.append(message)
        elif isinstance(message, ActionRequest):
            self.actions.append(message)
        elif isinstance(message, Utterance):
            self.utterances.append(message)
        super().observe(topic, message)


def log_bytes(megabytes: float) -> int:
    """Return the size limit (bytes) of each of the two logs of a run with ``megabytes`` in total."""
    return round(megabytes * 1_000_000 / 2)


def trace_record(topic: str, message: Message) -> TraceRecord | None:
    """Return ``message`` as a trace record, unless it is recorded otherwise."""
    cause, detail = "", {}
    match message:
        case TraceRecord():
            return message
        case PersonDetections(id=id, known=persons):
            kind, what = "detection", f"{len(persons)} {'person' if len(persons) == 1 else 'persons'}"
            cause = f"frame-{message.stamp}"
            if persons:
                detail = {"persons": msgspec.to_builtins(persons), "width": message.width, "height": message.height}
        case HeardSpeech(id=id, text=what):
            kind = "hearing"
            names = ("person", "language", "voice", "alternatives")
            detail = {name: getattr(message, name) for name in names if getattr(message, name)}
            detail |= {"confidence": message.confidence, "start": message.start}
        case Utterance(id=id, text=what, cause=cause):
            kind = "utterance"
        case SpeechStatus(utterance_id=cause, state=what):
            kind, id = "speech", f"{cause}-{what}"
            detail = {"detail": message.detail} if message.detail else {}
        case HeadCommand(mode=what, cause=cause):
            kind, id = "head", f"head-{cause or message.stamp}"
        case JointTrajectory():
            kind, id = "motion", f"motion-{message.stamp}"
            targets = zip(message.joint_names, message.positions, strict=True)
            what = ", ".join(f"{name} {position:.3f} rad" for name, position in targets)
            detail = {"duration_s": message.duration_s}
        case _:
            return None
    return TraceRecord(stamp=message.stamp, id=id, source=topic, kind=kind, what=what, cause=cause, detail=detail)


def _unusable(what: str, folder: Path, remedy: str) -> SocialbotError:
    error = SocialbotError(f"the folder of the run {what}", where=str(folder), remedy=remedy)
    error.exit_code = 4
    return error


RECORDED_PACKAGES = (
    "numpy",
    "opencv-python-headless",
    "rosbags",
    "msgspec",
    "kairos-planner",
    "ros-jazzy-rclpy",
    "faster-whisper",
    "onnxruntime",
)


def versions() -> dict[str, str]:
    """Return the versions of Python, socialbot and its main dependencies."""
    found = {"python": platform.python_version(), "socialbot": __version__}
    for package in RECORDED_PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


MessageObserver = Callable[[str, Message], None]

EVENT_LOG_TOPIC = "told"
"""Source of derived records; not a topic of the graph."""


def event_log_topics(graph: Graph) -> dict[str, type[Message]]:
    """Return the topics that the event log of ``graph`` reads, with their types."""
    log = event_log_of(graph)
    return {} if log is None else {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, log.kinds)}


def world_view_topics(graph: Graph) -> dict[str, type[Message]]:
    """Return the topics that the world view of ``graph`` reads, with their types."""
    view = world_view_of(graph)
    kinds = () if view is None else tuple(view.kinds)
    return {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, kinds)}


def with_event_log(graph: Graph, observe: MessageObserver) -> MessageObserver:
    """Return ``observe`` extended by the records that the event log of ``graph`` derives."""
    log = event_log_of(graph)
    if log is None:
        return observe

    def observe_all(topic: str, message: Message) -> None:
        observe(topic, message)
        for record in log.take(message):
            observe(EVENT_LOG_TOPIC, record)

    return observe_all
