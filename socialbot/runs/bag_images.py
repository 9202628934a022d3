"""Pictures of a bag by time, as JPEG."""

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
"""So many pictures that were asked for last are kept."""

PATIENCE_S = 20.0
"""So long a picture is waited for whose place in the bag is still looked for."""


class BagPictures:
    """The pictures of the topic ``topic`` of the bag at ``path``.

    Where they are in the bag is looked up by a thread, from the first on; whoever wants one that has not been come
    upon yet waits. One thread may ask at a time.
    """

    def __init__(self, path: Path, topic: str) -> None:
        """Raises BagError when there is no such bag or topic."""
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
        """The newest picture that is not later than ``stamp`` (ns); None when there is none, or it is damaged."""
        with self._found:
            self._found.wait_for(lambda: self._done or (self._stamps and self._stamps[-1] > stamp), PATIENCE_S)
            count = bisect_right(self._stamps, stamp)
            place = self._places[count - 1] if count else None
        if place is None:
            return None
        jpeg = self._jpeg(place)
        return None if jpeg is None else Picture(place.stamp, jpeg)

    def close(self) -> None:
        """Closes the bag."""
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
        """Goes through the bag once, in a bag of its own: files are read at one place at a time."""
        try:
            with open_bag(self._path) as bag:
                for place in bag.places(self._topic):
                    if self._closed:
                        return
                    with self._found:
                        self._places.append(place)
                        self._stamps.append(place.stamp)
                        self._found.notify_all()
        except BagError:
            # What is whole before the break is shown.
            pass
        finally:
            with self._found:
                self._done = True
                self._found.notify_all()


@contextmanager
def pictures_of(path: Path, topics: Collection[str]) -> Iterator[BagPictures | None]:
    """The pictures of a bag as long as the block lasts: those of one of ``topics``; None when none has any.

    Raises BagError.
    """
    with open_bag(path) as bag:
        found = next((topic.name for topic in bag.image_topics if topic.name in topics), None)
    pictures = None if found is None else BagPictures(path, found)
    try:
        yield pictures
    finally:
        if pictures is not None:
            pictures.close()
