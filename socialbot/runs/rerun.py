"""Export a run as an .rrd file for Rerun (needs the extra ``rerun``)."""

from __future__ import annotations

import importlib
import math
import os
import shutil
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any, BinaryIO

from socialbot.bags.reader import Bag
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import BagError, InstallationError
from socialbot.core.installation import extra_command
from socialbot.core.messages import CameraInfo, CompressedImage, Image, Mind, PersonDetection, PersonDetections
from socialbot.core.paths import writing
from socialbot.runs._streams import beats, detections_of, minds_of, poses_of, sentences_of
from socialbot.runs.folder import RecordedRun
from socialbot.runs.standard_messages import AHEAD, HEAD_HZ, HeadCourse, HeadPose, Mounting, mounting_of, place_of
from socialbot.vision.images import as_jpeg

WORLD = "base_link"
CAMERA = f"{WORLD}/camera"
PICTURE = f"{CAMERA}/picture"
PEOPLE = f"{WORLD}/people"
DISTANCES, HEAD, LOG, MINDS = "distance_m", "head", "log", "minds"
"""Entity paths. Those below `WORLD` are in the base frame: x forward, y left, z up."""

BEHIND_M, AHEAD_M = (-5.0, 3.0, 5.0), (4.0, 0.0, 0.8)


def layout(run: RecordedRun, views: Any) -> Any:
    """Return the views of a run, made with ``rerun.blueprint``."""
    kinds = {record.kind for record in run.history}
    # The subject comes first in a sentence.
    columns = views.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    log = views.TextLogView(origin=LOG, name="What happened, and why", columns=columns)
    minds = views.Tabs(
        *(
            views.TextDocumentView(origin=f"{MINDS}/{agent}", name=f"Mind of {run.wording.name(agent)}")
            for agent in run.history.agents
        )
    )
    shown = views.Horizontal(log, minds, column_shares=[3, 2])
    if "detection" in kinds:
        curves = [views.TimeSeriesView(origin=DISTANCES, name="Distances of people, m")]
        if "motion" in kinds:
            curves.append(views.TimeSeriesView(origin=HEAD, name="Head direction, rad"))
        eye = views.EyeControls3D(position=BEHIND_M, look_target=AHEAD_M)
        camera = views.Spatial2DView(origin=PICTURE, name="Camera")
        world = views.Spatial3DView(origin=WORLD, name="Around the robot", eye_controls=eye)
        shown = views.Horizontal(
            views.Vertical(camera, world, row_shares=[3, 2]),
            views.Vertical(log, minds, *curves, row_shares=[3, 2, *(2 for _ in curves)]),
            column_shares=[1, 1],
        )
    return views.Blueprint(
        shown,
        views.BlueprintPanel(state="collapsed"),
        views.SelectionPanel(state="collapsed"),
        views.TimePanel(state="collapsed", timeline="run"),
    )


RUN, STAMP = "run", "stamp"
WIDEST = 65_535
"""Largest width of a JPEG, so that images keep their size."""

_CHUNK = 65_536

Colour = tuple[int, int, int]

COLOURS: tuple[Colour, ...] = (
    (76, 195, 138), (245, 166, 35), (91, 157, 255), (229, 100, 155), (181, 140, 255), (43, 196, 196), (255, 122, 89),
)  # fmt: skip
GREY: Colour = (154, 160, 166)
GAZE: Colour = (255, 213, 74)

BODY_M, SHOULDERS_M = 1.7, 0.22


def export_rerun(run: RecordedRun, bag: Bag | None, out: Path) -> None:
    """Write a run and the images of its bag to a new file.

    Raises:
        InstallationError: Rerun is not installed.
        BagError: The file exists or cannot be written.
    """
    if out.exists():
        raise BagError("already exists", where=str(out), remedy="give another name, or remove it first")
    try:
        rerun: Any = importlib.import_module("rerun")
    except ImportError as error:
        raise InstallationError("Rerun is not installed", remedy=extra_command("rerun")) from error
    recording = rerun.RecordingStream("socialbot")
    piped = _PipedFile(out)
    try:
        with closing(piped):
            recording.save(piped.path)
            try:
                recording.send_blueprint(layout(run, importlib.import_module("rerun.blueprint")))
                recording.send_recording_name(run.title)
                show = _RerunExport(rerun, recording, run, piped)
                if bag is not None:
                    show.pictures(bag)
                for part in (show.people, show.head, show.log, show.minds):
                    part()
            finally:
                recording.disconnect()
    except BaseException:
        out.unlink(missing_ok=True)  # the next export would refuse to write over it
        raise


class _PipedFile:
    """New file behind a pipe, since Rerun waits for its thread without end if that cannot write.

    Raises:
        BagError: The file cannot be made.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._failed: OSError | None = None
        with writing(out, BagError):
            out.parent.mkdir(parents=True, exist_ok=True)
            file = out.open("xb")
        reading, self._writing = os.pipe()
        self.path = Path(f"/dev/fd/{self._writing}")
        self._thread = Thread(target=self._copy, args=(reading, file), name="rerun-file", daemon=True)
        self._thread.start()

    def _copy(self, reading: int, file: BinaryIO) -> None:
        with os.fdopen(reading, "rb") as pipe:
            try:
                with file:
                    shutil.copyfileobj(pipe, file)
            except OSError as error:
                self._failed = error
                while pipe.read(_CHUNK):
                    pass

    def check(self) -> None:
        """Raise BagError if the file could not be written."""
        with writing(self._out, BagError):
            if self._failed is not None:
                raise self._failed

    def close(self) -> None:
        """Wait until the file is complete. Raises BagError if it could not be written."""
        os.close(self._writing)
        self._thread.join()
        self.check()


@dataclass
class _RerunExport:
    rerun: Any
    recording: Any
    run: RecordedRun
    file: _PipedFile

    def __post_init__(self) -> None:
        self._mounting = mounting_of(self.run.graph) if self.run.graph else Mounting()
        self._poses = list(poses_of(self.run))
        self._course = HeadCourse(self._poses)
        self._colours: dict[str, Colour] = {}

    def pictures(self, bag: Bag) -> None:
        (image, *_) = bag.image_topics
        info = bag.camera_info_topic_for(image.name)
        self._place_camera(AHEAD, static=True)
        for _, message in bag.messages({topic.name: topic.name for topic in (image, info) if topic is not None}):
            if isinstance(message, CameraInfo):
                self._lens(message)
            elif isinstance(message, CompressedImage | Image):
                self._at(message.stamp)
                jpeg = as_jpeg(message, WIDEST)
                self._log(PICTURE, self.rerun.EncodedImage(contents=jpeg, media_type="image/jpeg"))

    def people(self) -> None:
        for found in detections_of(self.run):
            self._at(found.stamp)
            self._boxes(found)
            self._bodies(found)
            for person in found.persons:
                if person.track_id and person.distance_m is not None:
                    self._log(f"{DISTANCES}/{person.track_id}", self.rerun.Scalars(person.distance_m))
        for track, colour in self._colours.items():
            line = self.rerun.SeriesLines(names=track, colors=colour)
            self._log(f"{DISTANCES}/{track}", line, static=True)

    def head(self) -> None:
        if not self._poses:
            return
        for joint in HeadPose._fields:
            self._log(f"{HEAD}/{joint}", self.rerun.SeriesLines(names=f"{joint}, rad"), static=True)
        for stamp in beats(self.run, nanoseconds(1 / HEAD_HZ)):
            pose = self._course.at(stamp)
            self._at(stamp)
            for joint, angle in zip(pose._fields, pose, strict=True):
                self._log(f"{HEAD}/{joint}", self.rerun.Scalars(angle))
            self._log(f"{WORLD}/head", self._gaze(pose))
            if self._mounting.on_head:
                self._place_camera(pose)

    def log(self) -> None:
        for sentence in sentences_of(self.run):
            self._at(sentence.stamp)
            level = self.rerun.TextLogLevel.WARN if sentence.is_failure else self.rerun.TextLogLevel.INFO
            self._log(f"{LOG}/{sentence.source.strip('/')}", self.rerun.TextLog(sentence.text, level=level))

    def minds(self) -> None:
        for mind in minds_of(self.run):
            self._at(mind.stamp)
            self._log(f"{MINDS}/{mind.agent}", self.rerun.TextDocument(_document(mind), media_type="text/markdown"))

    def _at(self, stamp: int) -> None:
        self.recording.set_time(RUN, duration=self.run.history.seconds(stamp))
        self.recording.set_time(STAMP, timestamp=stamp / 1e9)

    def _log(self, entity: str, what: Any, *, static: bool = False) -> None:
        self.file.check()
        self.recording.log(entity, what, static=static)

    def _place_camera(self, head: HeadPose, *, static: bool = False) -> None:
        """Log the camera pose; a camera on the head follows it and looks along x."""
        tilt, pan = (head.tilt, head.pan) if self._mounting.on_head else (0.0, 0.0)
        turned = _turned(pan, tilt - self._mounting.pitch_rad)
        place = self.rerun.Transform3D(translation=(0.0, 0.0, self._mounting.height_m), quaternion=turned)
        self._log(CAMERA, place, static=static and not self._mounting.on_head)

    def _lens(self, info: CameraInfo) -> None:
        matrix = [info.k[row : row + 3] for row in (0, 3, 6)]
        lens = self.rerun.Pinhole(
            image_from_camera=matrix,
            resolution=(info.width, info.height),
            camera_xyz=self.rerun.ViewCoordinates.FLU,
            image_plane_distance=1.0,
        )
        self._log(PICTURE, lens, static=True)

    def _boxes(self, found: PersonDetections) -> None:
        boxes = self.rerun.Boxes2D(
            array=[(person.x, person.y, person.w, person.h) for person in found.persons],
            array_format=self.rerun.Box2DFormat.XYWH,
            labels=[_label(person) for person in found.persons],
            colors=[self._colour(person) for person in found.persons],
        )
        self._log(f"{PICTURE}/people", boxes)

    def _bodies(self, found: PersonDetections) -> None:
        head = self._course.at(found.stamp) if self._mounting.on_head else AHEAD
        standing = [(person, place) for person in found.persons if (place := place_of(person, head)) is not None]
        bodies = self.rerun.Capsules3D(
            translations=[(x, y, SHOULDERS_M) for _, (x, y, _) in standing],
            lengths=[BODY_M - 2 * SHOULDERS_M] * len(standing),
            radii=[SHOULDERS_M] * len(standing),
            labels=[_label(person) for person, _ in standing],
            colors=[self._colour(person) for person, _ in standing],
        )
        self._log(PEOPLE, bodies)

    def _gaze(self, pose: HeadPose) -> Any:
        level = math.cos(pose.tilt)
        ahead = (level * math.cos(pose.pan), level * math.sin(pose.pan), math.sin(pose.tilt))
        return self.rerun.Arrows3D(origins=[(0.0, 0.0, self._mounting.height_m)], vectors=[ahead], colors=[GAZE])

    def _colour(self, person: PersonDetection) -> Colour:
        if not person.track_id:
            return GREY
        return self._colours.setdefault(person.track_id, COLOURS[len(self._colours) % len(COLOURS)])


def _turned(pan: float, tilt: float) -> Any:
    (sin_z, cos_z), (sin_y, cos_y) = ((math.sin(angle / 2), math.cos(angle / 2)) for angle in (pan, -tilt))
    return (-sin_z * sin_y, cos_z * sin_y, sin_z * cos_y, cos_z * cos_y)


def _label(person: PersonDetection) -> str:
    away = "" if person.distance_m is None else f"{person.distance_m:.1f} m"
    return f"{person.track_id} {away}".strip()


def _document(mind: Mind) -> str:
    parts = {
        "Beliefs": [f"{belief.text} *({belief.source})*" for belief in mind.beliefs],
        "Desires": mind.desires,
        "Intentions": mind.intentions,
    }
    return "\n\n".join("\n".join((f"**{name}**\n", *(f"- {text}" for text in texts))) for name, texts in parts.items())
