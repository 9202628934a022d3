"""Images of a bag by time as JPEG, and as an annotated video."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from socialbot.bags.image_files import decode_image, open_video
from socialbot.bags.reader import Bag, MessageLocation, open_bag
from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_json
from socialbot.core.errors import BagError, ImageError
from socialbot.core.messages import CompressedImage, Image, Message, TraceRecord
from socialbot.core.paths import CHECK_DISK
from socialbot.core.reading import read_bytes
from socialbot.runs.record import TRACE, RunRecord
from socialbot.runs.run import ImageSource, Picture
from socialbot.vision.annotate import NEAR_NS, PeopleFinder, blurred, draw
from socialbot.vision.images import QUALITY, as_jpeg, bgr_from_compressed, bgr_from_image, encode_jpeg
from socialbot.vision.metrics.truth import GroundTruth

KEPT = 300

PATIENCE_S = 20.0


class BagPictures:
    """Images of a topic of a bag.

    A thread indexes the bag; requests for images that are not indexed yet wait. Only one thread may call `at`.

    Raises:
        BagError: The bag or topic does not exist.
    """

    def __init__(self, path: Path, topic: str) -> None:
        self._path = path
        self._topic = topic
        self._bag = open_bag(path)
        self._bag.topic(topic)
        self._places: list[MessageLocation] = []
        self._stamps: list[int] = []
        self._done = False
        self._closed = False
        self._found = threading.Condition()
        self._jpeg = lru_cache(KEPT)(self._read)
        threading.Thread(target=self._look_up, name="pictures", daemon=True).start()

    def at(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp`` (ns), unless it is damaged."""
        with self._found:
            self._found.wait_for(lambda: self._done or (self._stamps and self._stamps[-1] > stamp), PATIENCE_S)
            count = bisect_right(self._stamps, stamp)
            place = self._places[count - 1] if count else None
        if place is None:
            return None
        jpeg = self._jpeg(place)
        return None if jpeg is None else Picture(place.stamp, jpeg)

    def close(self) -> None:
        self._closed = True
        self._bag.close()

    def _read(self, place: MessageLocation) -> bytes | None:
        message = self._bag.message_at(place)
        if not isinstance(message, (Image, CompressedImage)):
            return None
        try:
            return as_jpeg(message)
        except ImageError:
            return None

    def _look_up(self) -> None:
        try:
            with open_bag(self._path) as bag:
                for place in bag.locations(self._topic):
                    if self._closed:
                        return
                    with self._found:
                        self._places.append(place)
                        self._stamps.append(place.stamp)
                        self._found.notify_all()
        except BagError:
            pass  # show the intact part before the damage
        finally:
            with self._found:
                self._done = True
                self._found.notify_all()


@contextmanager
def pictures_of(path: Path, topics: Collection[str]) -> Iterator[BagPictures | None]:
    """Open the images of the first of ``topics`` with any.

    Raises:
        BagError: The bag cannot be opened.
    """
    with open_bag(path) as bag:
        found = next((topic.name for topic in bag.image_topics if topic.name in topics), None)
    pictures = None if found is None else BagPictures(path, found)
    try:
        yield pictures
    finally:
        if pictures is not None:
            pictures.close()


class RecentPictures:
    """The newest compressed images of a run in simulated time, from its messages."""

    def __init__(self) -> None:
        self._pictures: deque[Picture] = deque(maxlen=KEPT)
        self._lock = threading.Lock()

    def take(self, message: Message) -> None:
        """Keep an image; other messages are ignored."""
        if isinstance(message, CompressedImage):
            with self._lock:
                self._pictures.append(Picture(message.stamp, message.data.tobytes()))

    def at(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp`` (ns), if it is kept."""
        with self._lock:
            return next((one for one in reversed(self._pictures) if one.stamp <= stamp), None)


class BlurredPictures:
    """Images of a run with people blurred: those that a detector finds, and those that the run has seen around then."""

    def __init__(self, images: ImageSource | None, seen: BoxesNear) -> None:
        self._images = images
        self._seen = seen
        self._finder: PeopleFinder | None = None

    def at(self, stamp: int) -> Picture | None:
        """Return the newest image up to ``stamp`` (ns), blurred; None if it cannot be decoded."""
        picture = None if self._images is None else self._images.at(stamp)
        if picture is None:
            return None
        try:
            pixels = decode_image(picture.jpeg, where="image")
        except ImageError:
            return None
        return Picture(picture.stamp, encode_jpeg(self.blur(pixels, picture.stamp), QUALITY).tobytes())

    def blur(self, pixels: np.ndarray, stamp: int) -> np.ndarray:
        """Return BGR ``pixels`` of the image at ``stamp`` (ns) with people blurred."""
        self._finder = self._finder or PeopleFinder()
        return blurred(pixels, np.vstack([self._finder.find(pixels), self._seen(stamp)]))


BoxesNear = Callable[[int], np.ndarray]
"""Boxes of people around a time (ns), (n, 4)."""


def boxes_of(detections: Iterable[tuple[int, Sequence[tuple[float, float, float, float]]]]) -> BoxesNear:
    """Return the boxes of ``detections`` by stamp (ns), in order, as a function of time."""
    found = [(stamp, list(boxes)) for stamp, boxes in detections]
    stamps = [stamp for stamp, _ in found]

    def near(stamp: int) -> np.ndarray:
        part = found[bisect_left(stamps, stamp - NEAR_NS) : bisect_right(stamps, stamp + NEAR_NS)]
        return np.array([box for _, boxes in part for box in boxes], np.float64).reshape(-1, 4)

    return near


# Video

SPOKEN_FOR_NS = 3 * SECOND

DEFAULT_RATE_HZ = 10.0
MOST_HZ = 60.0


def write_video(
    bag: Bag,
    image_topic: str,
    record: RunRecord,
    truth: GroundTruth | None,
    path: Path,
    advance: Callable[[int], None] = lambda done: None,
    *,
    blur: bool = False,
) -> Path:
    """Write the images of ``image_topic`` with detections, beliefs and speech as .mp4, with the times of the run.

    Each image is shown until the next one, and black before the first. Damaged images are skipped, and those that come
    faster than the video has images. ``blur`` blurs people.

    Raises:
        BagError: There is no image, or the video cannot be written.
    """
    detections = {message.stamp: message for message in record.detections}
    people = {frame.stamp: frame.persons for frame in truth.frames} if truth else {}
    captions = _Captions(record, bag.start)
    boxes = ((each.stamp, [(one.x, one.y, one.w, one.h) for one in each.persons]) for each in record.detections)
    blurrer = BlurredPictures(None, boxes_of(boxes)) if blur else None
    writer: cv2.VideoWriter | None = None
    rate = _video_rate_hz(bag.rate_hz(bag.topic(image_topic)) or 0.0, sorted(detections))
    written, shown = 0, np.zeros((0, 0, 3), np.uint8)
    for number, (_, message) in enumerate(bag.messages({image_topic: image_topic})):
        advance(number)
        assert isinstance(message, (Image, CompressedImage))
        try:
            pixels = bgr_from_image(message) if isinstance(message, Image) else bgr_from_compressed(message)
        except ImageError:
            continue
        stamp = message.stamp
        pixels = pixels if blurrer is None else blurrer.blur(pixels, stamp)
        frame = draw(pixels, detections.get(stamp), people.get(stamp, ()), captions.at(stamp))
        if writer is None:
            writer, shown = _open_writer(path, frame, rate), np.zeros_like(frame)
        due = round((stamp - bag.start) / SECOND * rate)
        for _ in range(written, due):
            writer.write(shown)
        shown = frame if frame.shape == shown.shape else cv2.resize(frame, shown.shape[1::-1])
        if written <= due:
            writer.write(shown)
        written = max(written, due + 1)
    if writer is None:
        raise BagError("the bag has no image for a video", where=str(bag.path))
    writer.release()
    if _image_count(path) < written:  # OpenCV reports no error of the disk
        path.unlink(missing_ok=True)
        raise BagError("the video cannot be written", where=str(path), remedy=f"{CHECK_DISK}, or give --no-video")
    return path


def _video_rate_hz(mean_hz: float, seen: Sequence[int]) -> float:
    """Rate that shows each image of a camera that pauses or begins late, from stamps (ns) of detections."""
    usual_hz = SECOND / median(second - first for first, second in pairwise(seen)) if len(seen) > 1 else 0.0
    return min(max(mean_hz, usual_hz), MOST_HZ) or DEFAULT_RATE_HZ


def _image_count(path: Path) -> int:
    try:
        video = open_video(path)
    except ImageError:
        return 0
    try:
        return int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    finally:
        video.release()


class _Captions:
    def __init__(self, record: RunRecord, start: int) -> None:
        self._start = start
        lines = read_bytes(record.folder / TRACE).splitlines()
        records = (from_json(line, TraceRecord) for line in lines)
        self._beliefs = [each for each in records if each.kind == "belief" and each.what.startswith("personD")]
        self._utterances = record.utterances

    def at(self, stamp: int) -> list[str]:
        count = bisect_right(self._beliefs, stamp, key=lambda belief: belief.stamp)
        belief = f"believes {self._beliefs[count - 1].what}" if count else ""
        spoken = [f'says: "{each.text}"' for each in self._utterances if 0 <= stamp - each.stamp < SPOKEN_FOR_NS]
        return [f"{(stamp - self._start) / SECOND:6.1f} s   {belief}", *spoken[-1:]]


def _open_writer(path: Path, frame: np.ndarray, rate_hz: float) -> cv2.VideoWriter:
    height, width = frame.shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (width, height))
    if not writer.isOpened():
        raise BagError("the video cannot be written", where=str(path), remedy="leave it out with --no-video")
    return writer
