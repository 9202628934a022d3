"""A run as an .rrd file, which Rerun shows; needs the extra ``rerun``."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from socialbot.errors import BagError, InstallationError
from socialbot.inspect.run import Picture, Run
from socialbot.inspect.streams import detections_of, minds_of, poses_of, sentences_of
from socialbot.messages import Mind

TIMELINE = "run"


def export_rerun(run: Run, pictures: Iterator[Picture], out: Path) -> None:
    """Writes ``run`` with its ``pictures`` to the new file ``out``; times are seconds from the start of the run.

    Raises InstallationError when Rerun is not installed, BagError when the file exists or cannot be written.
    """
    if out.exists():
        raise BagError("already exists", where=str(out), remedy="give another name, or remove it first")
    try:
        rerun: Any = importlib.import_module("rerun")
    except ImportError as error:
        raise InstallationError("Rerun is not installed", remedy="pip install 'socialbot[rerun]'") from error
    recording = rerun.RecordingStream(f"socialbot: {run.title}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        recording.save(out)
    except (OSError, RuntimeError) as error:
        raise BagError(f"cannot be written: {error}", where=str(out)) from error
    _log(rerun, recording, run, pictures)
    recording.flush()
    recording.disconnect()


def _log(rerun: Any, recording: Any, run: Run, pictures: Iterator[Picture]) -> None:
    def at(stamp: int) -> None:
        recording.set_time(TIMELINE, duration=run.history.seconds(stamp))

    for picture in pictures:
        at(picture.stamp)
        recording.log("camera", rerun.EncodedImage(contents=picture.jpeg, media_type="image/jpeg"))
    for found in detections_of(run):
        at(found.stamp)
        boxes = [(person.x, person.y, person.w, person.h) for person in found.persons]
        away = [f"{person.distance_m:.1f} m" if person.distance_m is not None else "" for person in found.persons]
        labels = [f"{person.track_id} {text}".strip() for person, text in zip(found.persons, away, strict=True)]
        recording.log("camera/people", rerun.Boxes2D(array=boxes, array_format=rerun.Box2DFormat.XYWH, labels=labels))
        for person in found.persons:
            if person.track_id and person.distance_m is not None:
                recording.log(f"people/{person.track_id}/distance_m", rerun.Scalars(person.distance_m))
    for sentence in sentences_of(run):
        at(sentence.stamp)
        level = rerun.TextLogLevel.WARN if sentence.is_failure else rerun.TextLogLevel.INFO
        recording.log(f"log/{sentence.source.strip('/')}", rerun.TextLog(sentence.text, level=level))
    for mind in minds_of(run):
        at(mind.stamp)
        recording.log(f"minds/{mind.agent}", rerun.TextDocument(_document(mind), media_type="text/markdown"))
    for pose in poses_of(run):
        at(pose.stamp)
        recording.log("head/pan_rad", rerun.Scalars(pose.pan))
        recording.log("head/tilt_rad", rerun.Scalars(pose.tilt))


def _document(mind: Mind) -> str:
    parts = {
        "Beliefs": [f"{belief.text} *({belief.source})*" for belief in mind.beliefs],
        "Desires": mind.desires,
        "Intentions": mind.intentions,
    }
    return "\n\n".join("\n".join((f"## {name}", *(f"- {text}" for text in texts))) for name, texts in parts.items())
