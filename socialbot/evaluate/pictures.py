"""Labelled pictures: a folder of images and a file that says who is in them.

The file, ``persons.json``, is a list with an entry for each picture::

    [{"image": "hall/007.jpg", "complete": true,
      "boxes": [{"x": 300, "y": 120, "w": 60, "h": 170, "distance_m": 5.2, "truncated": false, "occluded": false}],
      "ignore": [{"x": 10, "y": 200, "w": 90, "h": 40}]}]

Boxes are in pixels. ``distance_m`` may be null or missing. In a picture that is not ``complete`` there may be people
without a box, so that false alarms cannot be told there. What lies in an ``ignore`` box is neither asked for nor held
against a detector. An optional ``scene`` names the scene that the picture counts for.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from socialbot.errors import TruthError

__all__ = ["PICTURES_FILE", "IgnoreBox", "LabelledPicture", "PersonBox", "dump_pictures", "load_pictures"]

PICTURES_FILE = "persons.json"

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
Flag = bool | int | float | None
"""Some label with yes and no, some with levels; none is no."""

FITS = (
    'each entry needs "image" and "boxes" with x, y, w and h in pixels; "complete", "ignore", "distance_m", '
    '"truncated" and "occluded" are optional'
)


class PersonBox(msgspec.Struct, frozen=True, kw_only=True):
    """A person: box in pixels, distance (m) if known, whether cut off by the picture's edge or partly hidden."""

    x: float
    y: float
    w: Positive
    h: Positive
    distance_m: NotNegative | None = None
    truncated: Flag = False
    occluded: Flag = False


class IgnoreBox(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the picture that is not judged, pixels."""

    x: float
    y: float
    w: Positive
    h: Positive


class LabelledPicture(msgspec.Struct, frozen=True, kw_only=True):
    """One picture: its path in the folder, its people, and whether these are all people in it."""

    image: str
    boxes: tuple[PersonBox, ...]
    complete: bool = True
    ignore: tuple[IgnoreBox, ...] = ()
    scene: str = ""


def load_pictures(path: str | Path) -> tuple[LabelledPicture, ...]:
    """The entries of the file at ``path``. Raises TruthError, with file and entry, for the first that does not fit."""
    where = str(path)
    try:
        entries = msgspec.json.decode(Path(path).read_bytes(), type=list[msgspec.Raw])
    except OSError as error:
        raise TruthError(error.strerror or str(error), where=where, remedy="check the path") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TruthError(str(error), where=where, remedy="it must be a JSON list, one entry a picture") from error
    if not entries:
        raise TruthError("no pictures in the list", where=where, remedy=FITS)
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


def dump_pictures(pictures: Sequence[LabelledPicture]) -> bytes:
    """``pictures`` as the content of a file that `load_pictures` reads."""
    return msgspec.json.format(msgspec.json.encode(pictures), indent=2) + b"\n"


def _entry(number: int, entry: msgspec.Raw, where: str) -> LabelledPicture:
    try:
        picture = msgspec.json.decode(entry, type=LabelledPicture)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TruthError(f"{error}", where=f"{where}: {_name(number, entry)}", remedy=FITS) from error
    numbers = [value for box in (*picture.boxes, *picture.ignore) for value in (box.x, box.y, box.w, box.h)]
    if numbers and max(numbers) <= 1.0:
        raise TruthError(
            "all numbers of the boxes are at most 1",
            where=f"{where}: {_name(number, entry)}",
            remedy="give pixels, not shares of the picture",
        )
    for box in (*picture.boxes, *picture.ignore):
        if box.x + box.w <= 0 or box.y + box.h <= 0:
            raise TruthError(
                f"the box at {box.x:g}, {box.y:g} lies outside the picture",
                where=f"{where}: {_name(number, entry)}",
                remedy="x and y are those of the upper left corner, from the upper left of the picture",
            )
    if not picture.image:
        raise TruthError("the name of the image is empty", where=f"{where}: {_name(number, entry)}", remedy=FITS)
    return picture


def _name(number: int, entry: msgspec.Raw) -> str:
    """How a person finds the entry: its number and, where it can be read, its image."""
    try:
        image = msgspec.json.decode(entry, type=dict).get("image", "")
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        image = ""
    return f"entry {number} ({image})" if image else f"entry {number}"
