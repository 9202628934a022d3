"""Ground truth files: the people in each frame, with boxes and distances.

A JSON file beside its bag::

    {"schema": "socialbot/truth", "version": 1, "image_topic": "/camera/image_raw", "scene": "scene1",
     "split": "held-back", "objects": [{"kind": "poster", "x": 510.0, "y": 140.0, "w": 60.0, "h": 170.0}], "frames": [
        {"stamp": 1000000000, "light": "sun", "persons": [
            {"id": "p1", "x": 300.0, "y": 120.5, "w": 60.0, "h": 170.0, "distance_m": 5.2, "visible": 1.0}],
         "objects": [{"kind": "shadow", "x": 310.0, "y": 280.0, "w": 90.0, "h": 40.0}]}]}

Stamps are those of the images, in ns and ascending. ``distance_m`` may be missing; without ``visible`` a person is
visible as a whole. ``scene``, ``split``, ``light`` and ``objects`` are optional, as
are ``facing_rad`` (rad) and ``posture`` ("standing" or "seated") of a person. Other fields are ignored. Objects may be
taken for a person; those of the file are visible in all frames.

A bag may instead have the topic ``/ground_truth/persons`` (std_msgs/msg/String) with a `TruthMessage` as JSON for each
image. Its ``objects`` are all objects of that image.
"""

from __future__ import annotations

import codecs
import itertools
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from socialbot.core.decoding import from_json
from socialbot.core.errors import TruthError
from socialbot.core.reading import read_bytes

TRUTH_TOPIC = "/ground_truth/persons"
"""Topic of ground truth in a bag."""

LEAST_VISIBLE = 0.25
"""People of whom a smaller share is visible are not scored."""

T = TypeVar("T")
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Split = Literal["", "tune", "held-back"]
"""Use of a recording: for tuning, held back for evaluation, or neither."""


class Region(msgspec.Struct, frozen=True, kw_only=True):
    """Box in an image, pixels."""

    x: float
    y: float
    w: NotNegative
    h: NotNegative

    @property
    def box(self) -> tuple[float, float, float, float]:
        """x, y, w, h."""
        return self.x, self.y, self.w, self.h


class Person(Region, frozen=True, kw_only=True):
    """Person in one frame: horizontal distance (m) if known, visible share (0 to 1).

    A person with ``ignore`` is never scored, and neither is a detection of them. ``area`` (square pixels) is that of
    the outline, for COCO's sizes; by default, that of the box.
    """

    id: str
    distance_m: NotNegative | None
    visible: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    ignore: bool = False
    area: NotNegative | None = None

    @property
    def counts(self) -> bool:
        """Whether this person is scored."""
        return not self.ignore and self.visible >= LEAST_VISIBLE


class TruthPerson(Person, frozen=True, kw_only=True):
    """Person in one frame, with distance if known; the box is clipped to the image.

    ``facing_rad`` is the angle between where the person faces and the direction to the camera, seen from above: 0
    towards the camera, pi with the back turned.
    """

    distance_m: NotNegative | None = None
    visible: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 1.0
    facing_rad: Annotated[float, msgspec.Meta(ge=0.0, le=3.15)] | None = None
    posture: Literal["unknown", "standing", "seated"] = "unknown"


class TruthObject(Region, frozen=True, kw_only=True):
    """Object that may be taken for a person, such as a "coat stand", "poster" or "shadow"."""

    kind: str


class TruthFrame(msgspec.Struct, frozen=True, kw_only=True):
    """People in one frame, and objects visible only there; ``light`` names the state of lamps and sun."""

    stamp: int
    persons: tuple[TruthPerson, ...]
    objects: tuple[TruthObject, ...] = ()
    light: str = ""


class GroundTruth(msgspec.Struct, frozen=True, kw_only=True):
    """Ground truth of a recording; ``objects`` are visible in all frames."""

    schema: Literal["socialbot/truth"] = "socialbot/truth"
    version: Literal[1] = 1
    image_topic: str
    frames: tuple[TruthFrame, ...]
    scene: str = ""
    split: Split = ""
    objects: tuple[TruthObject, ...] = ()


class TruthMessage(TruthFrame, frozen=True, kw_only=True):
    """Ground truth of one frame in a bag, with all its ``objects``."""

    schema: Literal["socialbot/truth_frame"]
    version: Literal[1]
    image_topic: str
    scene: str = ""
    split: Split = ""


class _Header(msgspec.Struct):
    schema: Literal["socialbot/truth"]
    version: Literal[1]


def bag_name(bag: Path) -> str:
    """The display name of ``bag``: the folder name, or the file name without its suffix."""
    bag = bag.resolve()
    return bag.name if os.path.isdir(bag) else bag.stem


def truth_beside(bag: Path) -> Path:
    """The path of the ground truth file of ``bag``, NAME.truth.json beside it, whether or not it exists."""
    return bag.resolve().with_name(f"{bag_name(bag)}.truth.json")


def utf8(data: bytes) -> bytes:
    """Text without a byte order mark; text in UTF-16 with one becomes UTF-8."""
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return data.decode("utf-16", "replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def read_json(path: str | Path) -> bytes:
    """Read a text file as UTF-8. Raises TruthError if that fails."""
    try:
        return utf8(read_bytes(Path(path)))
    except OSError as error:
        raise TruthError(error.strerror or str(error), where=str(path), remedy="check the path") from error


def parse_json(data: bytes | str | msgspec.Raw, kind: type[T], *, where: str, remedy: str, prefix: str = "") -> T:
    """Parse ``data`` as ``kind``. Raises TruthError, which starts with ``prefix``, if it does not fit."""
    try:
        return from_json(data, kind)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise TruthError(f"{prefix}{error}", where=where, remedy=remedy) from error


def load_truth(path: str | Path) -> GroundTruth:
    """Load a ground truth file. Raises TruthError, with the path, if it is invalid."""
    data = read_json(path)
    about: dict[str, Any] = {"where": str(path), "remedy": "it must fit schema socialbot/truth, version 1"}
    parse_json(data, _Header, **about)
    truth = parse_json(data, GroundTruth, **about)
    _check_order(truth.frames, str(path))
    return truth


def truth_from_messages(texts: Iterable[str], where: str) -> GroundTruth:
    """Parse the ``texts`` on the ground truth topic of a bag; ``where`` names the bag in errors.

    Raises:
        TruthError: There are none, one is invalid, or they differ in image topic, scene or split.
    """
    remedy = "it must fit schema socialbot/truth_frame, version 1"
    messages = tuple(
        parse_json(text, TruthMessage, where=where, remedy=remedy, prefix=f"message {number}: ")
        for number, text in enumerate(texts)
    )
    if not messages:
        raise TruthError("no message with ground truth", where=where, remedy=f"record {TRUTH_TOPIC}")
    first, *_ = descriptions = [
        f"{message.image_topic}, scene {message.scene!r}, split {message.split!r}" for message in messages
    ]
    for message, description in zip(messages, descriptions, strict=True):
        if description != first:
            raise TruthError(
                f"frame {message.stamp} is of {description}, the first of {first}",
                where=where,
                remedy="record one scene a bag",
            )
    _check_order(messages, where)
    about = messages[0]
    return GroundTruth(image_topic=about.image_topic, scene=about.scene, split=about.split, frames=messages)


def _check_order(frames: tuple[TruthFrame, ...], where: str) -> None:
    for before, after in itertools.pairwise(frames):
        if after.stamp <= before.stamp:
            raise TruthError(
                f"frame {after.stamp} follows {before.stamp}", where=where, remedy="sort the frames, one a stamp"
            )
