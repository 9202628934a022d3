"""Footage: the pictures that detectors are shown, from a bag or a folder, one after the other.

Footage is a few words that say where the pictures are, so that it can be sent to other processes and machines.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from socialbot.bridge.bags import open_bag
from socialbot.clock import SECOND
from socialbot.errors import BagError, ImageError
from socialbot.messages import CameraInfo, CompressedImage, Image
from socialbot.vision.encodings import bgr_from_compressed, bgr_from_image

__all__ = ["BagFootage", "Encoded", "Footage", "PictureFootage"]

PICTURE_NS = SECOND
"""Pictures of a folder have nothing to do with each other; their stamps lie this far apart."""


class Encoded(NamedTuple):
    """A picture as it comes from the camera or file: stamp (ns), content, and the intrinsics that hold for it."""

    stamp: int
    content: Image | CompressedImage | bytes
    info: CameraInfo | None = None
    name: str = ""

    def bgr(self) -> np.ndarray:
        """The pixels, shape (height, width, 3), uint8, blue first. Raises ImageError for a damaged picture."""
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
class BagFootage:
    """The pictures on one topic of a bag. They follow each other, so that people can be tracked."""

    path: str
    image_topic: str
    consecutive = True

    def pictures(self) -> Iterator[Encoded]:
        """The pictures in the order of the bag. Raises BagError where it cannot be read."""
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
                    yield Encoded(message.stamp, message, info)


@dataclass(frozen=True)
class PictureFootage:
    """Single pictures below a ``folder``; the stamp of each is its number times a second."""

    folder: str
    images: tuple[str, ...]
    consecutive = False

    def pictures(self) -> Iterator[Encoded]:
        """The pictures in the order of the list. Raises BagError for a file that cannot be read."""
        for number, image in enumerate(self.images):
            path = Path(self.folder) / image
            try:
                content = path.read_bytes()
            except OSError as error:
                raise BagError(
                    error.strerror or str(error), where=str(path), remedy="check the folder given by --images"
                ) from error
            yield Encoded(number * PICTURE_NS, content, name=str(path))


Footage = BagFootage | PictureFootage
