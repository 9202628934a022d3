"""The record of a run: a folder with trace.jsonl, written as things happen, and results.json at the end."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec

from socialbot.errors import SocialbotError
from socialbot.messages import (
    ActionRequest,
    HeadCommand,
    JointTrajectory,
    Message,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
    Utterance,
)

RECORDED: tuple[type[Message], ...] = (
    PersonDetections, TraceRecord, ActionRequest, Utterance, SpeechStatus, HeadCommand, JointTrajectory,
)  # fmt: skip
"""The messages that a run is made of."""


class RunRecord:
    """Takes the messages of a run in order; each line of the trace is a TraceRecord as JSON.

    Every line is on disk before the next message is looked at, so that nothing is lost when a run breaks off.
    """

    def __init__(self, folder: Path) -> None:
        """Raises SocialbotError when the folder cannot be made, or holds a run already."""
        self.folder = folder
        self.detections: list[PersonDetections] = []
        self.actions: list[ActionRequest] = []
        self.utterances: list[Utterance] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._trace = (folder / "trace.jsonl").open("xb")
        except FileExistsError as error:
            raise _unusable("holds a run already", folder, "give another folder with --out") from error
        except OSError as error:
            raise _unusable(f"cannot be written: {error.strerror}", folder, "give another --out") from error
        self._encoder = msgspec.json.Encoder()

    def __enter__(self) -> RunRecord:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._trace.close()

    def observe(self, topic: str, message: Message) -> None:
        """Takes one message."""
        if isinstance(message, PersonDetections):
            self.detections.append(message)
        elif isinstance(message, ActionRequest):
            self.actions.append(message)
        elif isinstance(message, Utterance):
            self.utterances.append(message)
        record = trace_record(topic, message)
        if record is not None:
            self._trace.write(self._encoder.encode(record) + b"\n")
            self._trace.flush()

    def write_results(self, results: dict[str, Any]) -> Path:
        """Writes results.json."""
        path = self.folder / "results.json"
        path.write_bytes(msgspec.json.format(msgspec.json.encode(results), indent=2) + b"\n")
        return path


def trace_record(topic: str, message: Message) -> TraceRecord | None:
    """``message`` as a record of the trace; None when the trace tells it already, or it is no step of a run."""
    match message:
        case TraceRecord():
            return message
        case PersonDetections():
            persons = message.persons
            return TraceRecord(
                stamp=message.stamp,
                id=message.id,
                source=topic,
                kind="detection",
                what=f"{len(persons)} {'person' if len(persons) == 1 else 'persons'}",
                cause=f"frame-{message.stamp}",
                detail={"persons": msgspec.to_builtins(persons)} if persons else {},
            )
        case Utterance():
            return TraceRecord(
                stamp=message.stamp,
                id=message.id,
                source=topic,
                kind="utterance",
                what=message.text,
                cause=message.cause,
            )
        case SpeechStatus():
            return TraceRecord(
                stamp=message.stamp,
                id=f"{message.utterance_id}-{message.state}",
                source=topic,
                kind="speech",
                what=message.state,
                cause=message.utterance_id,
                detail={"detail": message.detail} if message.detail else {},
            )
        case HeadCommand():
            return TraceRecord(
                stamp=message.stamp,
                id=f"head-{message.cause}" if message.cause else f"head-{message.stamp}",
                source=topic,
                kind="head",
                what=message.mode,
                cause=message.cause,
            )
        case JointTrajectory():
            return TraceRecord(
                stamp=message.stamp,
                id=f"motion-{message.stamp}",
                source=topic,
                kind="motion",
                what=", ".join(
                    f"{name} {position:.3f} rad"
                    for name, position in zip(message.joint_names, message.positions, strict=True)
                ),
                detail={"duration_s": message.duration_s},
            )
    return None


def _unusable(what: str, folder: Path, remedy: str) -> SocialbotError:
    error = SocialbotError(f"the folder of the run {what}", where=str(folder), remedy=remedy)
    error.exit_code = 4
    return error
