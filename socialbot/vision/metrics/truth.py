"""Ground truth files: the people in each frame, with boxes and distances.

A JSON file beside its bag::

    {"schema": "socialbot/truth", "version": 1, "image_topic": "/camera/image_raw", "scene": "scene1",
     "split": "held-back", "objects": [{"kind": "poster", "x": 510.0, "y": 140.0, "w": 60.0, "h": 170.0}], "frames": [
        {"stamp": 1000000000, "light": "sun", "persons": [
            {"id": "p1", "x": 300.0, "y": 120.5, "w": 60.0, "h": 170.0, "distance_m": 5.2, "visible": 1.0}],
         "objects": [{"kind": "shadow", "x": 310.0, "y": 280.0, "w": 90.0, "h": 40.0}]}]}

Stamps are those of the images, in ns and ascending. ``scene``, ``split``, ``light`` and ``objects`` are optional, and
other fields are ignored. Objects may be taken for a person; those of the file are visible in all frames.

A bag may instead have the topic ``/ground_truth/persons`` (std_msgs/msg/String) with a `TruthMessage` as JSON for each
image. Its ``objects`` are all objects of that image.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from socialbot.core.errors import TruthError

__all__ = [
    "LEAST_VISIBLE", "TRUTH_TOPIC", "Split", "GroundTruth", "TruthFrame", "TruthMessage", "TruthObject", "TruthPerson",
    "bag_name", "load_truth", "truth_beside", "truth_from_messages",
]  # fmt: skip

TRUTH_TOPIC = "/ground_truth/persons"
"""Topic of ground truth in a bag."""

LEAST_VISIBLE = 0.25
"""People of whom a smaller share is visible are not scored."""

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Split = Literal["", "tune", "held-back"]
"""Use of a recording: for tuning, held back for evaluation, or neither."""


class TruthPerson(msgspec.Struct, frozen=True, kw_only=True):
    """Person in one frame: box (pixels, clipped), horizontal distance (m), visible share (0 to 1)."""

    id: str
    x: float
    y: float
    w: NotNegative
    h: NotNegative
    distance_m: NotNegative
    visible: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class TruthObject(msgspec.Struct, frozen=True, kw_only=True):
    """Object that may be taken for a person: kind ("coat stand", "poster", "shadow", ...) and box in pixels."""

    kind: str
    x: float
    y: float
    w: NotNegative
    h: NotNegative


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


class TruthMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Ground truth of one frame in a bag, with all its ``objects``."""

    schema: Literal["socialbot/truth_frame"]
    version: Literal[1]
    stamp: int
    image_topic: str
    scene: str = ""
    split: Split = ""
    light: str = ""
    persons: tuple[TruthPerson, ...]
    objects: tuple[TruthObject, ...] = ()


class _Header(msgspec.Struct):
    schema: Literal["socialbot/truth"]
    version: Literal[1]


def bag_name(bag: Path) -> str:
    """The display name of ``bag``: the folder name, or the file name without its suffix."""
    bag = bag.resolve()
    return bag.name if bag.is_dir() else bag.stem


def truth_beside(bag: Path) -> Path:
    """The path of the ground truth file of ``bag``, NAME.truth.json beside it, whether or not it exists."""
    return bag.resolve().with_name(f"{bag_name(bag)}.truth.json")


def load_truth(path: str | Path) -> GroundTruth:
    """Load a ground truth file. Raises TruthError, with the path, if it is invalid."""
    where = str(path)
    try:
        data = Path(path).read_bytes()
        msgspec.json.decode(data, type=_Header)
        truth = msgspec.json.decode(data, type=GroundTruth)
    except OSError as error:
        raise TruthError(error.strerror or str(error), where=where, remedy="check the path") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TruthError(str(error), where=where, remedy="it must fit schema socialbot/truth, version 1") from error
    _check_order(truth.frames, where)
    return truth


def truth_from_messages(texts: Iterable[str], where: str) -> GroundTruth:
    """Parse the ``texts`` on the ground truth topic of a bag; ``where`` names the bag in errors.

    Raises:
        TruthError: There are none, one is invalid, or they differ in image topic, scene or split.
    """
    messages = [_truth_message(number, text, where) for number, text in enumerate(texts)]
    if not messages:
        raise TruthError("no message with ground truth", where=where, remedy=f"record {TRUTH_TOPIC}")
    first = messages[0]
    about = (first.image_topic, first.scene, first.split)
    for message in messages:
        if (message.image_topic, message.scene, message.split) != about:
            raise TruthError(
                f"frame {message.stamp} is of {message.image_topic}, scene {message.scene!r}, split {message.split!r}, "
                f"the first of {about[0]}, scene {about[1]!r}, split {about[2]!r}",
                where=where,
                remedy="record one scene a bag",
            )
    frames = tuple(
        TruthFrame(stamp=message.stamp, persons=message.persons, objects=message.objects, light=message.light)
        for message in messages
    )
    _check_order(frames, where)
    return GroundTruth(image_topic=first.image_topic, scene=first.scene, split=first.split, frames=frames)


def _truth_message(number: int, text: str, where: str) -> TruthMessage:
    try:
        return msgspec.json.decode(text, type=TruthMessage)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise TruthError(
            f"message {number}: {error}", where=where, remedy="it must fit schema socialbot/truth_frame, version 1"
        ) from error


def _check_order(frames: tuple[TruthFrame, ...], where: str) -> None:
    for before, after in itertools.pairwise(frames):
        if after.stamp <= before.stamp:
            raise TruthError(
                f"frame {after.stamp} follows {before.stamp}", where=where, remedy="sort the frames, one a stamp"
            )
