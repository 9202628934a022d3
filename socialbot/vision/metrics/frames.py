"""Images with ground truth, from bags and from folders of labelled images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import msgspec
import numpy as np

from socialbot.bags.reader import Bag, open_bag
from socialbot.bags.types import RosbagsTypes
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import BagError, ImageError, TruthError
from socialbot.core.messages import CameraInfo, CompressedImage, Image
from socialbot.vision.detector import clip
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.metrics.truth import (
    LEAST_VISIBLE,
    TRUTH_TOPIC,
    GroundTruth,
    Split,
    TruthObject,
    bag_name,
    load_truth,
    truth_beside,
    truth_from_messages,
)

__all__ = [
    "BLOCK_S", "BagImages", "Box", "EncodedImage", "FolderImages", "IgnoreBox", "ImageSequence", "LABELS_FILE",
    "LabelledFrame", "LabelledImage", "LabelledSource", "Person", "PersonBox", "bag_source", "dump_labels",
    "image_sources", "load_labels",
]  # fmt: skip


IMAGE_NS = SECOND
"""Distance between the stamps of independent images."""


class EncodedImage(NamedTuple):
    """Encoded image with its stamp (ns) and camera intrinsics."""

    stamp: int
    content: Image | CompressedImage | bytes
    info: CameraInfo | None = None
    name: str = ""

    def bgr(self) -> np.ndarray:
        """Decode to shape (height, width, 3), uint8, BGR. Raises ImageError for a damaged image."""
        if isinstance(self.content, Image):
            return bgr_from_image(self.content)
        if isinstance(self.content, CompressedImage):
            return bgr_from_compressed(self.content)
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(self.content, np.uint8), flags) if self.content else None
        if pixels is None:
            raise ImageError("cannot be decoded", where=self.name, remedy="remove or replace this image")
        return pixels


@dataclass(frozen=True)
class BagImages:
    """Consecutive images on one topic of a bag."""

    path: str
    image_topic: str
    consecutive = True

    def read(self) -> Iterator[EncodedImage]:
        """Read the images in order. Raises BagError for an unreadable bag."""
        info: CameraInfo | None = None
        with open_bag(self.path) as bag:
            topics = {self.image_topic: self.image_topic}
            info_topic = bag.camera_info_topic_for(self.image_topic)
            if info_topic is not None:
                topics[info_topic.name] = info_topic.name
            for _, message in bag.messages(topics):
                if isinstance(message, CameraInfo):
                    info = message
                elif isinstance(message, (Image, CompressedImage)):
                    yield EncodedImage(message.stamp, message, info)


@dataclass(frozen=True)
class FolderImages:
    """Independent images in a ``folder``, with one second between their stamps."""

    folder: str
    images: tuple[str, ...]
    consecutive = False

    def read(self) -> Iterator[EncodedImage]:
        """Read the images in order. Raises BagError for an unreadable file."""
        for number, image in enumerate(self.images):
            path = Path(self.folder) / image
            try:
                content = path.read_bytes()
            except OSError as error:
                raise BagError(
                    error.strerror or str(error), where=str(path), remedy="check the folder given by --images"
                ) from error
            yield EncodedImage(number * IMAGE_NS, content, name=str(path))


ImageSequence = BagImages | FolderImages


LABELS_FILE = "persons.json"

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
Flag = bool | int | float | None
"""Boolean or level; None is False."""

FITS = (
    'each entry needs "image" and "boxes" with x, y, w and h in pixels; "complete", "ignore", "distance_m", '
    '"truncated" and "occluded" are optional'
)


class PersonBox(msgspec.Struct, frozen=True, kw_only=True):
    """Labelled person: box in pixels, distance (m) if known, truncation and occlusion."""

    x: float
    y: float
    w: Positive
    h: Positive
    distance_m: NotNegative | None = None
    truncated: Flag = False
    occluded: Flag = False


class IgnoreBox(msgspec.Struct, frozen=True, kw_only=True):
    """Region of the image that is not scored, pixels."""

    x: float
    y: float
    w: Positive
    h: Positive


class LabelledImage(msgspec.Struct, frozen=True, kw_only=True):
    """Labels of one image: its path in the folder, its people, and whether these are all."""

    image: str
    boxes: tuple[PersonBox, ...]
    complete: bool = True
    ignore: tuple[IgnoreBox, ...] = ()
    scene: str = ""


def load_labels(path: str | Path) -> tuple[LabelledImage, ...]:
    """Load a label file. Raises TruthError, with file and entry, for the first invalid entry."""
    where = str(path)
    try:
        entries = msgspec.json.decode(Path(path).read_bytes(), type=list[msgspec.Raw])
    except OSError as error:
        raise TruthError(error.strerror or str(error), where=where, remedy="check the path") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TruthError(str(error), where=where, remedy="it must be a JSON list with one entry per image") from error
    if not entries:
        raise TruthError("no images in the list", where=where, remedy=FITS)
    pictures = [_entry(number, entry, where) for number, entry in enumerate(entries)]
    first: dict[str, int] = {}
    for number, picture in enumerate(pictures):
        if picture.image in first:
            raise TruthError(
                f"{picture.image} is listed twice, as entries {first[picture.image]} and {number}",
                where=where,
                remedy="put all its people into one entry",
            )
        first[picture.image] = number
    return tuple(pictures)


def dump_labels(pictures: Sequence[LabelledImage]) -> bytes:
    """Encode labels for `load_labels`."""
    return msgspec.json.format(msgspec.json.encode(pictures), indent=2) + b"\n"


def _entry(number: int, entry: msgspec.Raw, where: str) -> LabelledImage:
    try:
        picture = msgspec.json.decode(entry, type=LabelledImage)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TruthError(f"{error}", where=f"{where}: {_name(number, entry)}", remedy=FITS) from error
    numbers = [value for box in (*picture.boxes, *picture.ignore) for value in (box.x, box.y, box.w, box.h)]
    if numbers and max(numbers) <= 1.0:
        raise TruthError(
            "all numbers of the boxes are at most 1",
            where=f"{where}: {_name(number, entry)}",
            remedy="give pixels, not shares of the image",
        )
    for box in (*picture.boxes, *picture.ignore):
        if box.x + box.w <= 0 or box.y + box.h <= 0:
            raise TruthError(
                f"the box at {box.x:g}, {box.y:g} lies outside the image",
                where=f"{where}: {_name(number, entry)}",
                remedy="x and y are those of the upper left corner of the box",
            )
    if not picture.image:
        raise TruthError("the name of the image is empty", where=f"{where}: {_name(number, entry)}", remedy=FITS)
    return picture


def _name(number: int, entry: msgspec.Raw) -> str:
    """Number and, if readable, image of an entry."""
    try:
        image = msgspec.json.decode(entry, type=dict).get("image", "")
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        image = ""
    return f"entry {number} ({image})" if image else f"entry {number}"


BLOCK_S = 3.0
"""Length of the blocks for the bootstrap, since consecutive frames are similar."""

_STRING = "std_msgs/msg/String"

Box = tuple[float, float, float, float]
"""x, y, w, h in pixels."""


@dataclass(frozen=True)
class Person:
    """Ground truth person: box, distance (m) if known, visible share (0 to 1) and id."""

    box: Box
    distance_m: float | None = None
    visible: float = 1.0
    id: str = ""

    @property
    def counts(self) -> bool:
        """Whether this person is scored."""
        return self.visible >= LEAST_VISIBLE


@dataclass(frozen=True)
class LabelledFrame:
    """Ground truth of one image.

    Args:
        stamp: Stamp of the image, ns.
        name: Display name.
        block: Block of the bootstrap.
        persons: People in the image.
        objects: Objects that may be taken for a person.
        ignore: Regions that are not scored.
        complete: Whether ``persons`` are all people in the image.
        ranged: Whether distances are meaningful.
        light: State of the lighting.
    """

    stamp: int
    name: str
    block: int
    persons: tuple[Person, ...] = ()
    objects: tuple[TruthObject, ...] = ()
    ignore: tuple[Box, ...] = ()
    complete: bool = True
    ranged: bool = True
    light: str = ""

    def clipped(self, width: int, height: int) -> LabelledFrame:
        """Clip the boxes of people to an image of ``width`` x ``height`` pixels."""
        if not self.persons:
            return self
        boxes = clip(np.array([person.box for person in self.persons]), width, height).tolist()
        people = tuple(replace(person, box=tuple(box)) for person, box in zip(self.persons, boxes, strict=True))
        return replace(self, persons=people)


@dataclass(frozen=True)
class LabelledSource:
    """Images and their ground truth ``frames`` in order of stamps; ``split`` is their intended use."""

    name: str
    scene: str
    split: Split
    images: ImageSequence
    frames: tuple[LabelledFrame, ...]


def bag_source(path: Path) -> LabelledSource:
    """Open a bag with the ground truth beside it, or else in it.

    Raises:
        BagError: The bag cannot be read.
        TruthError: There is no ground truth, or it does not match the bag.
    """
    with open_bag(path) as bag:
        truth = _truth_of(bag)
        topic = bag.choose_image_topic(truth.image_topic).name
    name = bag_name(path)
    start = truth.frames[0].stamp if truth.frames else 0
    frames = tuple(
        LabelledFrame(
            stamp=frame.stamp,
            name=f"{(frame.stamp - start) / SECOND:.1f} s",
            block=(frame.stamp - start) // nanoseconds(BLOCK_S),
            persons=tuple(
                Person((each.x, each.y, each.w, each.h), each.distance_m, each.visible, each.id)
                for each in frame.persons
            ),
            objects=(*truth.objects, *frame.objects),
            light=frame.light,
        )
        for frame in truth.frames
    )
    return LabelledSource(name, truth.scene or name, truth.split, BagImages(str(path), topic), frames)


def _truth_of(bag: Bag) -> GroundTruth:
    beside = truth_beside(bag.path)
    if beside.exists():
        return load_truth(beside)
    if TRUTH_TOPIC not in [topic.name for topic in bag.topics]:
        raise TruthError(
            "no ground truth for this bag",
            where=str(bag.path),
            remedy=f"put {beside.name} beside it, or record {TRUTH_TOPIC}",
        )
    topic = bag.topic(TRUTH_TOPIC)
    if topic.type != _STRING:
        raise TruthError(f"{TRUTH_TOPIC} is {topic.type}", where=str(bag.path), remedy=f"it must be {_STRING}")
    types = RosbagsTypes()
    messages = bag.raw_messages({TRUTH_TOPIC: TRUTH_TOPIC})
    return truth_from_messages((types.deserialize(cdr, _STRING).data for _, _, _, cdr in messages), str(bag.path))


def image_sources(folder: Path, truth: Path | None = None) -> list[LabelledSource]:
    """Open a folder of labelled images; one source for each scene.

    Args:
        folder: Folder of the images.
        truth: Label file, relative to the working directory or to ``folder``; default: persons.json.

    Raises:
        TruthError: The labels are invalid.
        ImageError: Images are missing.
    """
    path = truth or folder / LABELS_FILE
    if not path.exists() and (folder / path).exists():
        path = folder / path
    pictures = load_labels(path)
    missing = [picture.image for picture in pictures if not (folder / picture.image).is_file()]
    if missing:
        raise ImageError(
            f"{len(missing)} of {len(pictures)} images of {path} are missing; the first: {missing[0]}",
            where=str(folder),
            remedy="give the folder that the paths in the list start from by --images",
        )
    own = folder.resolve().name
    scenes: dict[str, list[LabelledImage]] = {}
    for picture in pictures:
        scenes.setdefault(picture.scene or own, []).append(picture)
    return [_picture_source(folder, scene, listed) for scene, listed in scenes.items()]


def _picture_source(folder: Path, scene: str, pictures: Sequence[LabelledImage]) -> LabelledSource:
    ranged = any(box.distance_m is not None for picture in pictures for box in picture.boxes)
    frames = tuple(
        LabelledFrame(
            stamp=number * IMAGE_NS,
            name=picture.image,
            block=number,
            persons=tuple(
                Person((box.x, box.y, box.w, box.h), box.distance_m, id=f"{number}.{index}")
                for index, box in enumerate(picture.boxes)
            ),
            ignore=tuple((box.x, box.y, box.w, box.h) for box in picture.ignore),
            complete=picture.complete,
            # Without any distance the camera is unknown as well.
            ranged=ranged and (not picture.boxes or any(box.distance_m is not None for box in picture.boxes)),
        )
        for number, picture in enumerate(pictures)
    )
    images = FolderImages(str(folder), tuple(picture.image for picture in pictures))
    return LabelledSource(scene, scene, "", images, frames)
