"""Images with ground truth, from bags and from folders of labelled images."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from socialbot.bags.cameras import is_rectified
from socialbot.bags.codec import STRING
from socialbot.bags.image_files import decode_image, decoder_limit, open_video
from socialbot.bags.reader import Bag, open_bag
from socialbot.bags.types import RosbagsTypes
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.decoding import from_json
from socialbot.core.errors import BagError, ImageError, TruthError
from socialbot.core.messages import CameraInfo, CompressedImage, Image
from socialbot.core.reading import read_bytes
from socialbot.vision.camera import USUAL_HFOV_RAD, intrinsics_problems, is_calibrated, without_lens
from socialbot.vision.depth_sensors import DepthSensors
from socialbot.vision.detector import clip
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.metrics.truth import (
    LEAST_VISIBLE,
    TRUTH_TOPIC,
    GroundTruth,
    NotNegative,
    Person,
    Region,
    Split,
    TruthObject,
    bag_name,
    load_truth,
    parse_json,
    read_json,
    truth_beside,
    truth_from_messages,
)

Key = int | float | str
"""Id of an image or a class in a data set."""

_FIRST_IMAGES = 20

IMAGE_NS = SECOND
"""Distance between the stamps of independent images."""


class EncodedImage(NamedTuple):
    """Encoded image, or pixels of a video, with its stamp (ns), camera intrinsics, and depth sensors of its bag."""

    stamp: int
    content: Image | CompressedImage | bytes | np.ndarray
    info: CameraInfo | None = None
    name: str = ""
    sensors: DepthSensors | None = None

    def bgr(self, size: tuple[int, int] | None = None) -> np.ndarray:
        """Decode to shape (height, width, 3), uint8, BGR.

        A file is turned as its EXIF orientation says, unless only the stored pixels have the labelled ``size``. Raises
        ImageError for a damaged image.
        """
        if isinstance(self.content, np.ndarray):
            return self.content
        if isinstance(self.content, Image):
            return bgr_from_image(self.content)
        if isinstance(self.content, CompressedImage):
            return bgr_from_compressed(self.content)
        pixels = decode_image(self.content, where=self.name, turned=True)
        if size is not None and size == pixels.shape[:2] != size[::-1]:
            pixels = decode_image(self.content, where=self.name)
        return pixels


@dataclass(frozen=True)
class BagImages:
    """Consecutive images on one topic of a bag; ``depth`` selects the topic with distances."""

    path: str
    image_topic: str
    depth: str | None = None
    consecutive = True

    def read(self) -> Iterator[EncodedImage]:
        """Read the images in order. Raises BagError for an unreadable bag."""
        info: CameraInfo | None = None
        with open_bag(self.path) as bag:
            info_topic = bag.camera_info_topic_for(self.image_topic)
            depth = bag.depth_sensors_for(self.image_topic, self.depth)
            depth |= bag.transforms_for(self.image_topic)
            sensors = DepthSensors() if depth else None
            rectified = is_rectified(self.image_topic)
            topics = [self.image_topic, *([info_topic.name] if info_topic else []), *depth]
            for topic, message in bag.messages(dict(zip(topics, topics, strict=True)), depth):
                if sensors is not None and topic in depth:
                    sensors.take(message)
                elif isinstance(message, CameraInfo):
                    info = without_lens(message) if rectified else message
                elif isinstance(message, (Image, CompressedImage)):
                    yield EncodedImage(message.stamp, message, info, sensors=sensors)


@dataclass(frozen=True)
class FolderImages:
    """Images in a ``folder``: independent, or ``consecutive`` images of one camera.

    ``stamps`` (ns) are one second apart by default.
    """

    folder: str
    images: tuple[str, ...]
    stamps: tuple[int, ...] = ()
    consecutive: bool = False

    def read(self) -> Iterator[EncodedImage]:
        """Read the images in order. Raises BagError for an unreadable file."""
        for number, image in enumerate(self.images):
            path = Path(self.folder) / image
            stamp = self.stamps[number] if self.stamps else number * IMAGE_NS
            try:
                content = read_bytes(path)
            except OSError as error:
                raise BagError(
                    error.strerror or str(error), where=str(path), remedy="check the folder given by --images"
                ) from error
            yield EncodedImage(stamp, content, name=str(path))


@dataclass(frozen=True)
class VideoImages:
    """Images of a video file with their ``stamps``, ns."""

    path: str
    stamps: tuple[int, ...]
    consecutive = True

    def read(self) -> Iterator[EncodedImage]:
        """Read the images in order. Raises ImageError for an unreadable file."""
        capture = open_video(self.path)
        try:
            for number, stamp in enumerate(self.stamps):
                with decoder_limit(capture):
                    good, pixels = capture.read()
                if not good:
                    break
                yield EncodedImage(stamp, pixels, name=f"{self.path}: frame {number}")
        finally:
            capture.release()


ImageSequence = BagImages | FolderImages | VideoImages


LABELS_FILE = "persons.json"

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
Flag = bool | int | float | None
"""Boolean or level; None is False."""

FITS = (
    'each entry needs "image" and "boxes" with x, y, w and h in pixels; "complete", "ignore", "distance_m", '
    '"truncated" and "occluded" are optional'
)


class IgnoreBox(Region, frozen=True, kw_only=True):
    """Region of the image that is not scored."""

    w: Positive
    h: Positive


class PersonBox(IgnoreBox, frozen=True, kw_only=True):
    """Labelled person: distance (m) if known, truncation and occlusion."""

    distance_m: NotNegative | None = None
    truncated: Flag = False
    occluded: Flag = False


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
    remedy = "it must be a JSON list with one entry per image"
    entries = parse_json(read_json(path), list[msgspec.Raw], where=where, remedy=remedy)
    if not entries:
        raise TruthError("no images in the list", where=where, remedy=FITS)
    images = [_entry(entry, f"{where}: {_name(number, entry)}") for number, entry in enumerate(entries)]
    first: dict[str, int] = {}
    for number, image in enumerate(images):
        if first.setdefault(image.image, number) != number:
            raise TruthError(
                f"{image.image} is listed twice, as entries {first[image.image]} and {number}",
                where=where,
                remedy="put all its people into one entry",
            )
    return tuple(images)


def _entry(entry: msgspec.Raw, where: str) -> LabelledImage:
    image = parse_json(entry, LabelledImage, where=where, remedy=FITS)
    regions = [*image.boxes, *image.ignore]
    if regions and max(max(region.box) for region in regions) <= 1.0:
        raise TruthError(
            "all numbers of the boxes are at most 1", where=where, remedy="give pixels, not shares of the image"
        )
    for region in regions:
        if region.x + region.w <= 0 or region.y + region.h <= 0:
            raise TruthError(
                f"the box at {region.x:g}, {region.y:g} lies outside the image",
                where=where,
                remedy="x and y are those of the upper left corner of the box",
            )
    if not image.image:
        raise TruthError("the name of the image is empty", where=where, remedy=FITS)
    return image


def _name(number: int, entry: msgspec.Raw) -> str:
    """Number and, if readable, image of an entry."""
    try:
        image = from_json(entry, dict).get("image")
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        image = ""
    return f"entry {number} ({image})" if image else f"entry {number}"


BLOCK_S = 3.0
"""Length of the blocks for the bootstrap, since consecutive frames are similar."""

Box = tuple[float, float, float, float]
"""x, y, w, h in pixels."""


@dataclass(frozen=True)
class LabelledFrame:
    """Ground truth of one image, with its ``block`` of the bootstrap.

    The regions ``ignore`` are not scored. ``complete``: ``persons`` are all people in the image; ``ranged``: distances
    are meaningful. ``number`` names the image in its data set; ``size`` is its labelled width and height, pixels.
    """

    stamp: int
    name: str
    block: int
    persons: tuple[Person, ...] = ()
    objects: tuple[TruthObject, ...] = ()
    ignore: tuple[Region, ...] = ()
    complete: bool = True
    ranged: bool = True
    light: str = ""
    number: Key | None = None
    size: tuple[int, int] | None = None

    def clipped(self, width: int, height: int) -> LabelledFrame:
        """Clip the boxes of people to an image of ``width`` x ``height`` pixels; people outside are ignored."""
        boxes = clip(np.array([person.box for person in self.persons]).reshape(-1, 4), width, height).tolist()
        people = tuple(
            msgspec.structs.replace(
                person, **dict(zip("xywh", box, strict=True)), ignore=person.ignore or not (box[2] > 0 and box[3] > 0)
            )
            for person, box in zip(self.persons, boxes, strict=True)
        )
        return replace(self, persons=people)


@dataclass(frozen=True)
class LabelledSource:
    """Images and their ground truth ``frames`` in order of stamps; ``split`` is their intended use.

    Args:
        least_visible: Visible share from which a person counts in AP and the tracking metrics.
        format: Format of the labels.
        identities: Whether the ids of people are the same in all frames.
        category: Id of the class of people, for COCO results.
        notes: What was assumed or left out when reading the labels.
        classes: Names of the classes in the labels.
    """

    name: str
    scene: str
    split: Split
    images: ImageSequence
    frames: tuple[LabelledFrame, ...]
    least_visible: float = LEAST_VISIBLE
    format: str = "socialbot"
    identities: bool = True
    category: Key = 1
    notes: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()


def with_own_names(found: Sequence[tuple[Path, LabelledSource]]) -> list[LabelledSource]:
    """Sources and the path of each; folders of the path come before names that occur more than once.

    A path that is given twice keeps its name.
    """
    above = [path.resolve().parent.parts for path, _ in found]
    names = [source.name for _, source in found]
    for depth in range(1, max(map(len, above), default=0) + 1):
        twice = {name for name in names if names.count(name) > 1}
        if not twice:
            break
        names = [
            "/".join((*parts[-depth:], source.name)) if name in twice else name
            for (_, source), parts, name in zip(found, above, names, strict=True)
        ]
    return [
        source
        if names.count(name) > 1
        else replace(source, name=name, scene=name if source.scene == source.name else source.scene)
        for (_, source), name in zip(found, names, strict=True)
    ]


def bag_source(
    path: Path, labels: Path | None = None, *, hfov_rad: float = USUAL_HFOV_RAD, calibrated: bool = False
) -> LabelledSource:
    """Open a bag with the ground truth file ``labels``, by default the one beside it, or else that in it.

    ``hfov_rad`` is the field of view of a camera without intrinsics, for the notes, unless it is ``calibrated``.

    Raises:
        BagError: The bag cannot be read.
        TruthError: There is no ground truth, or it does not match the bag.
    """
    with open_bag(path) as bag:
        truth = _truth_of(bag, labels)
        topic = bag.choose_image_topic(truth.image_topic).name
        stamps = {place.header: place.stamp for place in bag.locations(topic)}
    truth = _on_the_clock(truth, stamps)
    name = bag_name(path)
    start = truth.frames[0].stamp if truth.frames else 0
    frames = tuple(
        LabelledFrame(
            stamp=frame.stamp,
            name=f"{(frame.stamp - start) / SECOND:.1f} s",
            block=(frame.stamp - start) // nanoseconds(BLOCK_S),
            persons=frame.persons,
            objects=(*truth.objects, *frame.objects),
            light=frame.light,
        )
        for frame in truth.frames
    )
    images = BagImages(str(path), topic)
    notes = _camera_notes(images, hfov_rad, calibrated=calibrated)
    return LabelledSource(name, truth.scene or name, truth.split, images, frames, notes=notes)


def _on_the_clock(truth: GroundTruth, stamps: Mapping[int, int]) -> GroundTruth:
    """Ground truth with the corrected stamps of the images, from those by the stamps in their headers."""
    corrected = set(stamps.values())
    frames = (
        frame
        if frame.stamp in corrected
        else msgspec.structs.replace(frame, stamp=stamps.get(frame.stamp, frame.stamp))
        for frame in truth.frames
    )
    return msgspec.structs.replace(truth, frames=tuple(sorted(frames, key=lambda frame: frame.stamp)))


def _camera_notes(images: BagImages, hfov_rad: float, *, calibrated: bool) -> tuple[str, ...]:
    """What is assumed of the camera of a bag. The CameraInfo comes within its first images."""
    info, width, height = None, 0, 0
    for encoded in itertools.islice(images.read(), _FIRST_IMAGES):
        info = encoded.info or info
        try:
            height, width = encoded.bgr().shape[:2]
        except ImageError:
            continue
        if info is not None:
            break
    is_known = not width or (calibrated and (info is None or not is_calibrated(info)))
    return () if is_known else tuple(intrinsics_problems(info, width, height, hfov_rad))


def _truth_of(bag: Bag, labels: Path | None) -> GroundTruth:
    if labels is not None:
        return load_truth(labels)
    beside = truth_beside(bag.path)
    if beside.exists():
        return load_truth(beside)
    found = {topic.name: topic.type for topic in bag.topics}.get(TRUTH_TOPIC)
    where = str(bag.path)
    if found is None:
        remedy = f"put {beside.name} beside it, or record {TRUTH_TOPIC}"
        raise TruthError("no ground truth for this bag", where=where, remedy=remedy)
    if found != STRING:
        raise TruthError(f"{TRUTH_TOPIC} is {found}", where=where, remedy=f"it must be {STRING}")
    types = RosbagsTypes()
    messages = bag.raw_messages({TRUTH_TOPIC: TRUTH_TOPIC})
    return truth_from_messages((types.deserialize(cdr, STRING).data for _, _, _, cdr in messages), where)


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
    images = load_labels(path)
    missing = [image.image for image in images if not (folder / image.image).is_file()]
    if missing:
        raise ImageError(
            f"{len(missing)} of {len(images)} images of {path} are missing; the first: {missing[0]}",
            where=str(folder),
            remedy="give the folder that the paths in the list start from by --images",
        )
    scenes: dict[str, list[LabelledImage]] = {}
    for image in images:
        scenes.setdefault(image.scene or folder.resolve().name, []).append(image)
    return [_folder_source(folder, scene, listed) for scene, listed in scenes.items()]


def _folder_source(folder: Path, scene: str, images: Sequence[LabelledImage]) -> LabelledSource:
    ranged = any(box.distance_m is not None for image in images for box in image.boxes)
    frames = tuple(
        LabelledFrame(
            stamp=number * IMAGE_NS,
            name=image.image,
            block=number,
            persons=tuple(
                Person(
                    id=f"{number}.{index}", x=box.x, y=box.y, w=box.w, h=box.h, distance_m=box.distance_m, visible=1.0
                )
                for index, box in enumerate(image.boxes)
            ),
            ignore=image.ignore,
            complete=image.complete,
            # Without any distance the camera is unknown as well.
            ranged=ranged and (not image.boxes or any(box.distance_m is not None for box in image.boxes)),
        )
        for number, image in enumerate(images)
    )
    return LabelledSource(scene, scene, "", FolderImages(str(folder), tuple(image.image for image in images)), frames)
