"""Export a run as an .mcap file for Foxglove: images with boxes, persons, minds, log, head and diagnostics.

All topics are ROS 2 messages with embedded definitions, so other bag tools read the file, too.
"""

from __future__ import annotations

import heapq
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from socialbot.bags.reader import Bag, BagWriter, RosbagsTypes
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import BagError
from socialbot.core.messages import CompressedImage, Image, Message, PersonDetections
from socialbot.core.paths import writing
from socialbot.graph.status import NodeStatus
from socialbot.runs._streams import EventSentence, beats, detections_of, minds_of, poses_of, sentences_of
from socialbot.runs.folder import RecordedRun
from socialbot.runs.run import RunView
from socialbot.runs.standard_messages import (
    AHEAD,
    HEAD_HZ,
    HeadCourse,
    HeadPose,
    Mounting,
    Neck,
    StandardMessages,
    mounting_of,
    neck_of,
)

ANNOTATIONS = "/humans/bodies/image_annotations"
DETECTIONS = "/humans/bodies/detections"
MARKERS = "/humans/bodies/markers"
JOINTS = "/joint_states"
USUAL_NECK = Neck("head_pan_joint", "head_tilt_joint")
DIAGNOSTICS_EVERY = SECOND
_LINE_LOOP = 2
_INFO, _WARN = 20, 30
_OK, _WARNING, _ERROR = 0, 1, 2
_LEVELS = {"ok": _OK, "": _OK, "paused": _WARNING, "waiting": _WARNING, "degraded": _WARNING, "ended": _WARNING}

Item = tuple[int, str, Any]


def export_foxglove(run: RecordedRun, bag: Bag | None, out: Path) -> dict[str, int]:
    """Write a run and the images of its bag to a new file.

    Returns:
        The numbers of messages by topic.

    Raises:
        BagError: The file exists or cannot be written, or the bag is damaged.
    """
    if out.exists():
        raise BagError("already exists", where=str(out), remedy="give another name, or remove it first")
    show = FoxgloveMessages(run, "" if bag is None else picture_frame(bag))
    with writing(out, BagError):
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.parent) as folder:
            writer = BagWriter(Path(folder) / "bag", shown=out)
            with writer:
                for time, topic, message in stream_of(show, bag):
                    if isinstance(message, Message):
                        writer.write(topic, message, time, "typed")
                    else:
                        data = show.types.serialize(message)
                        writer.write_raw(topic, message.__msgtype__, data, time, latched=topic == "/tf_static")
            next(writer.path.glob("*.mcap")).replace(out)
    return writer.counts


def stream_of(show: FoxgloveMessages, bag: Bag | None) -> Iterator[Item]:
    """Yield all messages of a run and its bag in order of time: time (ns), topic and message."""
    streams = [
        sorted(stream, key=itemgetter(0))
        for stream in (show.people(), show.log(), show.minds(), show.head(), show.diagnostics())
    ]
    pictures = _pictures(bag) if bag is not None else iter(())
    return heapq.merge(*streams, pictures, key=itemgetter(0))


def _pictures(bag: Bag) -> Iterator[Item]:
    topics = {topic.name: topic.name for topic in bag.image_topics}
    infos = [bag.camera_info_topic_for(name) for name in topics]
    topics |= {info.name: info.name for info in infos if info is not None}
    for topic, message in bag.messages(topics):
        yield message.stamp, topic, message


def picture_frame(bag: Bag) -> str:
    """Return the frame of the first image of a bag."""
    (topic, *_) = bag.image_topics
    for _, picture in bag.messages({topic.name: topic.name}):
        assert isinstance(picture, CompressedImage | Image)
        return picture.frame_id
    return ""


class FoxgloveMessages:
    """Conversion of a run to ROS messages, with images in ``frame`` (empty: as in the graph)."""

    def __init__(self, run: RunView, frame: str = "") -> None:
        self.types = RosbagsTypes()
        self._standard = StandardMessages(self.types)
        self._run = run
        mounting = mounting_of(run.graph) if run.graph else Mounting()
        self._mounting = replace(mounting, optical=frame or mounting.optical)
        poses = list(poses_of(run))
        self._course = HeadCourse(poses)
        self._neck = neck_of(run.graph) if run.graph else USUAL_NECK if poses else None

    def people(self) -> Iterator[Item]:
        for found in detections_of(self._run, self._mounting.optical):
            yield from self.of_detections(found, self._course.at(found.stamp))

    def of_detections(self, found: PersonDetections, pose: HeadPose) -> Iterator[Item]:
        """Yield the messages about the people of one image, seen with the head in ``pose``."""
        head = pose if self._mounting.on_head else AHEAD
        yield found.stamp, DETECTIONS, found
        yield found.stamp, ANNOTATIONS, self._annotations(found)
        yield found.stamp, MARKERS, self._standard.markers(found, head)
        if found.persons:
            yield found.stamp, "/tf", self._standard.bodies(found, head)

    def log(self) -> Iterator[Item]:
        for record in self._run.history:
            yield record.stamp, "/trace", record
        for sentence in sentences_of(self._run):
            yield self.of_sentence(sentence)

    def of_sentence(self, sentence: EventSentence) -> Item:
        """Return the log message of an event."""
        return sentence.stamp, "/rosout", self._log(sentence)

    def minds(self) -> Iterator[Item]:
        for mind in minds_of(self._run):
            yield mind.stamp, f"/{mind.agent}/mind", mind

    def head(self) -> Iterator[Item]:
        start = self._run.history.start
        yield self.camera_at(start)
        if self._neck is None:
            return
        for stamp in beats(self._run, nanoseconds(1 / HEAD_HZ)):
            yield from self.head_at(stamp, self._course.at(stamp))

    def camera_at(self, stamp: int) -> Item:
        """Return the static transforms of the camera."""
        return stamp, "/tf_static", self._standard.camera(stamp, self._mounting)

    def head_at(self, stamp: int, pose: HeadPose) -> Iterator[Item]:
        """Yield the messages about the pose of the head; none for a robot without a neck."""
        if self._neck is not None:
            yield stamp, "/tf", self._standard.head(stamp, pose, self._mounting.height_m)
            yield stamp, JOINTS, self._standard.joints(stamp, (self._neck.pan, self._neck.tilt), pose)

    def diagnostics(self) -> Iterator[Item]:
        for stamp in beats(self._run, DIAGNOSTICS_EVERY):
            yield from self.diagnostics_at(stamp)

    def diagnostics_at(self, stamp: int) -> Iterator[Item]:
        """Yield the state of all nodes, if it is known."""
        if nodes := self._run.nodes(stamp):
            values = ((stamp,), [_status(node) for node in nodes])
            yield stamp, "/diagnostics", self._standard.make("diagnostic_msgs/msg/DiagnosticArray", values)

    def _annotations(self, found: PersonDetections) -> Any:
        boxes, texts = [], []
        for person in found.persons:
            right, bottom = person.x + person.w, person.y + person.h
            boxes.append(
                {
                    "timestamp": found.stamp,
                    "type": _LINE_LOOP,
                    "points": [(person.x, person.y), (right, person.y), (right, bottom), (person.x, bottom)],
                    "outline_color": (0.1, 0.8, 0.3, 1.0),
                    "thickness": 2.0,
                }
            )
            away = "" if person.distance_m is None else f" {person.distance_m:.1f} m"
            texts.append(
                {
                    "timestamp": found.stamp,
                    "position": (person.x, person.y),
                    "text": f"{person.track_id or 'person'}{away}",
                    "font_size": 14.0,
                    "text_color": (1.0, 1.0, 1.0, 1.0),
                    "background_color": (0.05, 0.4, 0.15, 0.8),
                }
            )
        # The stamp identifies an image without persons.
        values = {"timestamp": found.stamp, "points": boxes, "texts": texts}
        return self._standard.make("foxglove_msgs/msg/ImageAnnotations", values)

    def _log(self, sentence: EventSentence) -> Any:
        level = _WARN if sentence.is_failure else _INFO
        values = (sentence.stamp, level, sentence.source.strip("/"), sentence.text)
        return self._standard.make("rcl_interfaces/msg/Log", values)


def _status(node: NodeStatus) -> tuple[Any, ...]:
    figures = {"machine": node.machine, "state": node.state, "handled_hz": node.handled_hz, "pid": node.pid}
    figures |= {"cpu_percent": node.cpu_percent, "memory_mb": node.memory_mb, "restarts": node.restarts}
    values = [(key, str(value)) for key, value in figures.items() if value not in (None, "")]
    message = node.reason or node.health or node.state
    return _LEVELS.get(node.health, _ERROR), node.name, message, node.machine, values
