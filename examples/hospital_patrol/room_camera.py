"""The camera of a room: while somebody patrols the room, it shows recorded clips of what happens there."""

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
"""The bags with the clips."""
PATROL = "a_patrol_room"

_REMEDY = "write scenes as: 0 scene2_tune 9-23; 120 scene2_tune 0-3.4 (s of the run, clip, s of the clip)"


def frame_of(room: str) -> str:
    """The name of the frame of pictures of a room."""
    return f"{room}_camera"


@dataclass(frozen=True, slots=True)
class Scene:
    """From ``start_s`` of the run on a room looks as the ``clip`` does from ``begin_s`` to ``end_s``, to and fro."""

    start_s: float
    clip: str
    begin_s: float
    end_s: float

    def moment_s(self, seconds: float) -> float:
        """The moment of the clip that is shown at ``seconds`` of the run."""
        length = self.end_s - self.begin_s
        if not length:
            return self.begin_s
        gone = (seconds - self.start_s) % (2 * length)
        return self.begin_s + min(gone, 2 * length - gone)


def parse_scenes(text: str) -> tuple[Scene, ...]:
    """The scenes that ``text`` lists, by their beginning. Raises ParameterError."""
    scenes = tuple(sorted(map(_scene, filter(str.strip, text.split(";"))), key=lambda scene: scene.start_s))
    if not scenes or scenes[0].start_s:
        raise ParameterError("nothing says how the room looks at first", where="scenes", remedy=_REMEDY)
    return scenes


def _scene(text: str) -> Scene:
    try:
        start, clip, span = text.split()
        begin, end = span.split("-")
        scene = Scene(float(start), clip, float(begin), float(end))
    except ValueError as error:
        raise ParameterError(f"no scene: {text.strip()!r}", where="scenes", remedy=_REMEDY) from error
    if not (scene.start_s >= 0.0 and 0.0 <= scene.begin_s <= scene.end_s):
        raise ParameterError(f"ends before it begins: {text.strip()!r}", where="scenes", remedy=_REMEDY)
    return scene


@dataclass(frozen=True)
class Clip:
    """The pictures of a bag, in order, and the camera that took them."""

    pictures: tuple[CompressedImage, ...]
    camera: CameraInfo

    def at(self, seconds: float) -> CompressedImage:
        """The picture that was the latest at ``seconds`` of the clip."""
        stamp = self.pictures[0].stamp + nanoseconds(seconds)
        return self.pictures[max(bisect_right(self.pictures, stamp, key=lambda picture: picture.stamp), 1) - 1]


def load_clip(path: Path) -> Clip:
    """The clip in the bag at ``path``. Raises BagError, or ParameterError for a bag without pictures of a camera."""
    with open_bag(path) as bag:
        images = bag.choose_image_topic().name
        cameras = bag.camera_info_topic_for(images)
        topics = {images: images, **({cameras.name: cameras.name} if cameras else {})}
        messages = [message for _, message in bag.messages(topics)]
    pictures = tuple(message for message in messages if isinstance(message, CompressedImage))
    camera = next((message for message in messages if isinstance(message, CameraInfo)), None)
    if not pictures or camera is None:
        raise ParameterError("no compressed pictures of a known camera", where=str(path), remedy="name another clip")
    return Clip(pictures, camera)


class RoomCamera(Node):
    """Hangs in one room. It is on for ``learn_s`` at first, and while a robot patrols there."""

    state = Input(WardState, STATE, Delivery.LATCHED)
    image_color = Output(Image, "/camera/image_color", Delivery.NEWEST)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)

    room = Parameter("room1", "the room that it shows", fixed=True)
    scenes = Parameter("0 scene1_tune 0-2.5", "what goes on there: s of the run, clip, s of the clip; ...", fixed=True)
    folder = Parameter(str(CLIPS), "where the clips are", fixed=True)
    rate_hz = Parameter(2.0, "pictures a second", minimum=0.1, maximum=30.0)
    learn_s = Parameter(
        0.0, "s from the start to show the room, so that its objects are known", minimum=0.0, fixed=True
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises ParameterError for scenes that cannot be, BagError for clips that cannot be read."""
        super().__init__(name, context, parameters)
        self._scenes = parse_scenes(self.scenes)
        self._clips = {clip: load_clip(Path(self.folder) / clip) for clip in {scene.clip for scene in self._scenes}}
        self._begin: int | None = None
        self._timer: Timer | None = None

    @state
    def on_state(self, message: WardState) -> None:
        """Goes on when the run or a patrol of the room begins, and off when the patrol ends."""
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
        """By this who gets a picture knows the room."""
        return frame_of(self.room)

    def scene_at(self, time: int) -> Scene:
        """What goes on in the room at ``time`` (ns)."""
        return next(scene for scene in reversed(self._scenes) if scene.start_s <= self._seconds(time))

    def picture_at(self, time: int) -> CompressedImage:
        """What the room looks like at ``time`` (ns): a picture as it was recorded, with its own stamp."""
        scene = self.scene_at(time)
        return self._clips[scene.clip].at(scene.moment_s(self._seconds(time)))

    def _seconds(self, time: int) -> float:
        return max(time - (self._begin or 0), 0) / SECOND

    def _film(self) -> None:
        now = self.clock.now()
        self._timer = self.call_after(1 / self.rate_hz, self._film)
        pixels = bgr_from_compressed(self.picture_at(now))
        self.image_color.publish(Image.from_bgr(pixels, stamp=now, frame_id=self.frame_id))
