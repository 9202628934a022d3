"""Camera of a room: plays recorded clips while a robot patrols the room."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from socialbot import (
    SECOND,
    CameraInfo,
    CompressedImage,
    Context,
    Delivery,
    Image,
    Input,
    Node,
    Output,
    Parameter,
    ParameterError,
    Timer,
    nanoseconds,
    open_bag,
)
from socialbot.agents.hospital import STATE, WardState
from socialbot.vision.images import bgr_from_compressed

CLIPS = Path(__file__).resolve().parents[2] / "data" / "synthetic"
"""Folder of the bags with the clips."""
PATROL = "a_patrol_room"

_REMEDY = "write scenes as: 0 scene2_tune 9-23; 120 scene2_tune 0-3.4 (s of the run, clip, s of the clip)"


def frame_of(room: str) -> str:
    """Return the frame id of the images of a room."""
    return f"{room}_camera"


@dataclass(frozen=True, slots=True)
class Scene:
    """From ``start_s`` of the run on, play a ``clip`` from ``begin_s`` to ``end_s``, forwards and backwards."""

    start_s: float
    clip: str
    begin_s: float
    end_s: float

    def moment_s(self, seconds: float) -> float:
        """Return the time in the clip (s) for a time of the run (s)."""
        length = self.end_s - self.begin_s
        if not length:
            return self.begin_s
        gone = (seconds - self.start_s) % (2 * length)
        return self.begin_s + min(gone, 2 * length - gone)


def parse_scenes(text: str) -> tuple[Scene, ...]:
    """Parse a list of scenes; returns them by start time. Raises ParameterError."""
    scenes = tuple(sorted(map(_scene, filter(str.strip, text.split(";"))), key=lambda scene: scene.start_s))
    if not scenes or scenes[0].start_s:
        raise ParameterError("no scene starts at 0 s", where="scenes", remedy=_REMEDY)
    return scenes


def _scene(text: str) -> Scene:
    try:
        start, clip, span = text.split()
        begin, end = span.split("-")
        scene = Scene(float(start), clip, float(begin), float(end))
    except ValueError as error:
        raise ParameterError(f"not a scene: {text.strip()!r}", where="scenes", remedy=_REMEDY) from error
    if not (scene.start_s >= 0.0 and 0.0 <= scene.begin_s <= scene.end_s):
        raise ParameterError(f"scene ends before it begins: {text.strip()!r}", where="scenes", remedy=_REMEDY)
    return scene


@dataclass(frozen=True)
class Clip:
    """Images of a bag in order, with their camera."""

    pictures: tuple[CompressedImage, ...]
    camera: CameraInfo

    def at(self, seconds: float) -> CompressedImage:
        """Return the latest image at ``seconds`` of the clip."""
        stamp = self.pictures[0].stamp + nanoseconds(seconds)
        return self.pictures[max(bisect_right(self.pictures, stamp, key=lambda picture: picture.stamp), 1) - 1]


def load_clip(path: Path) -> Clip:
    """Read the clip in the bag at ``path``. Raises BagError, or ParameterError for a bag without camera images."""
    with open_bag(path) as bag:
        images = bag.choose_image_topic().name
        cameras = bag.camera_info_topic_for(images)
        topics = {images: images, **({cameras.name: cameras.name} if cameras else {})}
        messages = [message for _, message in bag.messages(topics)]
    pictures = tuple(message for message in messages if isinstance(message, CompressedImage))
    camera = next((message for message in messages if isinstance(message, CameraInfo)), None)
    if not pictures or camera is None:
        raise ParameterError("no compressed images with camera_info", where=str(path), remedy="name another clip")
    return Clip(pictures, camera)


class RoomCamera(Node):
    """Camera in one room. It is on for ``learn_s`` at the start, and during each patrol of the room."""

    state = Input(WardState, STATE, Delivery.LATCHED)
    image_color = Output(Image, "/camera/image_color", Delivery.NEWEST)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)

    room = Parameter("room1", "room in view", fixed=True)
    scenes = Parameter("0 scene1_tune 0-2.5", "start (s of the run), clip, range (s of the clip); ...", fixed=True)
    folder = Parameter(str(CLIPS), "folder of the clips", fixed=True)
    rate_hz = Parameter(2.0, "image rate", minimum=0.1, maximum=30.0)
    learn_s = Parameter(
        0.0, "seconds at the start in which the detector learns the static objects", minimum=0.0, fixed=True
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for invalid scenes, BagError for unreadable clips."""
        super().__init__(name, context, parameters)
        self._scenes = parse_scenes(self.scenes)
        self._clips = {clip: load_clip(Path(self.folder) / clip) for clip in {scene.clip for scene in self._scenes}}
        self._begin: int | None = None
        self._timer: Timer | None = None

    @state
    def on_state(self, message: WardState) -> None:
        """Switch on at the start of the run or of a patrol, and off at its end."""
        if self._begin is None:
            self._begin = message.stamp
        patrolled = any(agent.busy == f"{PATROL}({agent.name}, {self.room})" for agent in message.agents)
        learns = self._seconds(message.stamp) < self.learn_s
        if (patrolled or learns) and self._timer is None:
            first = self._clips[self.scene_at(message.stamp).clip].camera
            self.camera_info.publish(msgspec.structs.replace(first, stamp=self.clock.now(), frame_id=self.frame_id))
            self._film()
        elif not (patrolled or learns) and self._timer is not None:
            self._timer.cancel()
            self._timer = None

    @property
    def frame_id(self) -> str:
        """Frame id of the images; it names the room."""
        return frame_of(self.room)

    def scene_at(self, time: int) -> Scene:
        """Return the scene at ``time`` (ns)."""
        return next(scene for scene in reversed(self._scenes) if scene.start_s <= self._seconds(time))

    def picture_at(self, time: int) -> CompressedImage:
        """Return the recorded image at ``time`` (ns), with its own stamp."""
        scene = self.scene_at(time)
        return self._clips[scene.clip].at(scene.moment_s(self._seconds(time)))

    def _seconds(self, time: int) -> float:
        return max(time - (self._begin or 0), 0) / SECOND

    def _film(self) -> None:
        now = self.clock.now()
        self._timer = self.call_after(1 / self.rate_hz, self._film)
        pixels = bgr_from_compressed(self.picture_at(now))
        self.image_color.publish(Image.from_bgr(pixels, stamp=now, frame_id=self.frame_id))
