"""Images of a bag by time, as JPEG."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from socialbot.bags.reader import MessageLocation, open_bag
from socialbot.core.errors import BagError, ImageError
from socialbot.core.messages import CompressedImage, Image
from socialbot.runs.run import Picture
from socialbot.vision.images import as_jpeg

KEPT = 300

PATIENCE_S = 20.0
"""Longest wait for the index."""


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
            # Show the intact part before the damage.
            pass
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
