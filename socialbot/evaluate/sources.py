"""Sources: footage whose truth is known, and what is true in each frame of it.

A bag with a truth file beside it or the truth as a topic, or a folder of labelled pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from socialbot.bridge.bag_types import RosbagsTypes
from socialbot.bridge.bags import Bag, open_bag
from socialbot.clock import SECOND, nanoseconds
from socialbot.errors import ImageError, TruthError
from socialbot.evaluate.footage import PICTURE_NS, BagFootage, Footage, PictureFootage
from socialbot.evaluate.pictures import PICTURES_FILE, LabelledPicture, load_pictures
from socialbot.replay import bag_name, truth_beside
from socialbot.vision.boxes import clip
from socialbot.vision.scoring import LEAST_VISIBLE
from socialbot.vision.truth import TRUTH_TOPIC, Split, Truth, TruthObject, load_truth, truth_from_messages

__all__ = ["BLOCK_S", "Box", "Frame", "Person", "Source", "bag_source", "picture_sources"]

BLOCK_S = 3.0
"""Frames of so long belong together when intervals are reckoned: they show nearly the same."""

_STRING = "std_msgs/msg/String"

Box = tuple[float, float, float, float]
"""x, y, w, h in pixels."""


@dataclass(frozen=True)
class Person:
    """Somebody who is there: box, distance (m) where it is known, visible share (0 to 1), and who it is."""

    box: Box
    distance_m: float | None = None
    visible: float = 1.0
    id: str = ""

    @property
    def counts(self) -> bool:
        """Whether a detector is asked to find this person."""
        return self.visible >= LEAST_VISIBLE


@dataclass(frozen=True)
class Frame:
    """What is true in one picture.

    ``stamp`` (ns) is the picture's and ``name`` what people call it. In a frame that is not ``complete`` there may be
    more people than ``persons``. ``ranged`` is whether distances mean anything here. Frames of one ``block`` belong
    together when intervals are reckoned.
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

    def clipped(self, width: int, height: int) -> Frame:
        """This frame without what of its people lies beyond a picture of ``width`` x ``height`` pixels."""
        if not self.persons:
            return self
        boxes = clip(np.array([person.box for person in self.persons]), width, height).tolist()
        people = tuple(replace(person, box=tuple(box)) for person, box in zip(self.persons, boxes, strict=True))
        return replace(self, persons=people)


@dataclass(frozen=True)
class Source:
    """Footage and its truth: the ``frames`` by rising stamps. ``split`` is what it may be used for."""

    name: str
    scene: str
    split: Split
    footage: Footage
    frames: tuple[Frame, ...]


def bag_source(path: Path) -> Source:
    """The bag at ``path`` with the truth that lies beside it, or else in it.

    Raises BagError for a bag that cannot be read and TruthError where there is no truth, or it does not fit the bag.
    """
    with open_bag(path) as bag:
        truth = _truth_of(bag)
        topic = bag.choose_image_topic(truth.image_topic).name
    name = bag_name(path)
    start = truth.frames[0].stamp if truth.frames else 0
    frames = tuple(
        Frame(
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
    return Source(name, truth.scene or name, truth.split, BagFootage(str(path), topic), frames)


def _truth_of(bag: Bag) -> Truth:
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


def picture_sources(folder: Path, truth: Path | None = None) -> list[Source]:
    """The labelled pictures below ``folder``, a source for each scene they name.

    ``truth``, a path from here or from the folder, is by default its persons.json. Raises TruthError for labels that
    do not fit and ImageError for images that are missing.
    """
    path = truth or folder / PICTURES_FILE
    if not path.exists() and (folder / path).exists():
        path = folder / path
    pictures = load_pictures(path)
    missing = [picture.image for picture in pictures if not (folder / picture.image).is_file()]
    if missing:
        raise ImageError(
            f"{len(missing)} of {len(pictures)} images of {path} are not there; the first: {missing[0]}",
            where=str(folder),
            remedy="give the folder that the paths in the list start from by --images",
        )
    own = folder.resolve().name
    scenes: dict[str, list[LabelledPicture]] = {}
    for picture in pictures:
        scenes.setdefault(picture.scene or own, []).append(picture)
    return [_picture_source(folder, scene, listed) for scene, listed in scenes.items()]


def _picture_source(folder: Path, scene: str, pictures: Sequence[LabelledPicture]) -> Source:
    ranged = any(box.distance_m is not None for picture in pictures for box in picture.boxes)
    frames = tuple(
        Frame(
            stamp=number * PICTURE_NS,
            name=picture.image,
            block=number,
            persons=tuple(
                Person((box.x, box.y, box.w, box.h), box.distance_m, id=f"{number}.{index}")
                for index, box in enumerate(picture.boxes)
            ),
            ignore=tuple((box.x, box.y, box.w, box.h) for box in picture.ignore),
            complete=picture.complete,
            # The camera of a picture in which nobody's distance is known is not known either.
            ranged=ranged and (not picture.boxes or any(box.distance_m is not None for box in picture.boxes)),
        )
        for number, picture in enumerate(pictures)
    )
    footage = PictureFootage(str(folder), tuple(picture.image for picture in pictures))
    return Source(scene, scene, "", footage, frames)
