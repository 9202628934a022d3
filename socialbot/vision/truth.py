"""Ground truth: who really is in each frame, and where.

A JSON file beside its bag::

    {"schema": "socialbot/truth", "version": 1, "image_topic": "/camera/image_raw", "frames": [
        {"stamp": 1000000000, "persons": [
            {"id": "p1", "x": 300.0, "y": 120.5, "w": 60.0, "h": 170.0, "distance_m": 5.2, "visible": 1.0}]}]}

Stamps are those of the images, in ns and ascending. Other fields are passed over.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from socialbot.errors import TruthError

__all__ = ["Truth", "TruthFrame", "TruthPerson", "load_truth"]

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class TruthPerson(msgspec.Struct, frozen=True, kw_only=True):
    """One person in one frame: box (pixels, clipped to the image), horizontal distance, visible share (0 to 1)."""

    id: str
    x: float
    y: float
    w: NotNegative
    h: NotNegative
    distance_m: NotNegative
    visible: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class TruthFrame(msgspec.Struct, frozen=True, kw_only=True):
    """The people in one frame; ``stamp`` (ns) is the image's."""

    stamp: int
    persons: tuple[TruthPerson, ...]


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """The people in every frame of a recording."""

    schema: Literal["socialbot/truth"] = "socialbot/truth"
    version: Literal[1] = 1
    image_topic: str
    frames: tuple[TruthFrame, ...]


class _Header(msgspec.Struct):
    """A file has to say what it is."""

    schema: Literal["socialbot/truth"]
    version: Literal[1]


def load_truth(path: str | Path) -> Truth:
    """The ground truth in the file ``path``. Raises TruthError, with the file's name, when it does not fit."""
    where = str(path)
    try:
        data = Path(path).read_bytes()
        msgspec.json.decode(data, type=_Header)
        truth = msgspec.json.decode(data, type=Truth)
    except OSError as error:
        raise TruthError(error.strerror or str(error), where=where, remedy="check the path") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise TruthError(str(error), where=where, remedy="it must fit schema socialbot/truth, version 1") from error
    for before, after in zip(truth.frames, truth.frames[1:], strict=False):
        if after.stamp <= before.stamp:
            raise TruthError(
                f"frame {after.stamp} follows {before.stamp}", where=where, remedy="sort the frames, one a stamp"
            )
    return truth
