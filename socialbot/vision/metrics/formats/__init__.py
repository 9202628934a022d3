"""Read labelled data sets in the common formats: COCO, MOTChallenge, KITTI, YOLO, Pascal VOC and CVAT.

Each format is a `LabelFormat`, which its module declares. Formats outside socialbot are given as ``module:NAME``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from socialbot.core.decoding import from_json
from socialbot.core.errors import ParameterError, TruthError, suggestion
from socialbot.core.references import load_reference
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import Labels, check_people, fault, labelled_images
from socialbot.vision.metrics.formats._others import format_of_json, unread_format
from socialbot.vision.metrics.formats.coco import COCO
from socialbot.vision.metrics.formats.cvat import CVAT
from socialbot.vision.metrics.formats.kitti import KITTI
from socialbot.vision.metrics.formats.mot import MOT
from socialbot.vision.metrics.formats.voc import VOC
from socialbot.vision.metrics.formats.yolo import YOLO
from socialbot.vision.metrics.frames import LABELS_FILE, LabelledSource, image_sources, with_own_names
from socialbot.vision.metrics.truth import read_json

__all__ = ["FORMATS", "LabelFormat", "Labels", "label_format", "labelled_images", "labelled_sources", "sniff"]

SOCIALBOT = LabelFormat(
    "socialbot",
    LABELS_FILE,
    lambda path, images, _: _own_labels(path, images),
    lambda folder: [folder] if (folder / LABELS_FILE).is_file() else [],
    lambda path: _is_own(path),
)

FORMATS = {each.name: each for each in (SOCIALBOT, COCO, MOT, KITTI, YOLO, VOC, CVAT)}
"""Formats by name, in the order in which they are tried."""

ARCHIVES = frozenset({".7z", ".gz", ".rar", ".tar", ".tgz", ".zip"})


def _own_labels(path: Path, images: Path | None) -> list[LabelledSource]:
    if path.is_dir():
        return image_sources(path if images is None else images, None if images is None else path)
    return image_sources(path.parent if images is None else images, path)


def _is_own(path: Path) -> bool:
    """Whether a JSON file has entries of the own format, or is damaged: its reader names the damage."""
    if path.suffix.lower() != ".json" or COCO.is_file(path):
        return False
    try:
        content = from_json(read_json(path), Any)
    except (TruthError, msgspec.MsgspecError, UnicodeError, RecursionError):
        return True
    if format_of_json(content):
        return False
    entries = content if isinstance(content, list) else []
    return path.name == LABELS_FILE or any(
        isinstance(each, dict) and {"image", "boxes"} & each.keys() for each in entries
    )


def sniff(path: Path) -> str | None:
    """Format of a label file or of the labels in a folder; None if it is not known."""
    is_folder = path.is_dir()
    known = (name for name, each in FORMATS.items() if (each.places(path) if is_folder else each.is_file(path)))
    return next(known, None)


def label_format(name: str) -> LabelFormat:
    """Return the format ``name``, or that of a reference ``module:NAME``. Raises ParameterError."""
    if name in FORMATS:
        return FORMATS[name]
    if ":" not in name:
        remedy = f"{suggestion(name, FORMATS)}; or module:NAME, a LabelFormat of your own"
        raise ParameterError(f"unknown format {name!r}", where="--format", remedy=remedy)
    found = load_reference(name, "format", _is_format, where="--format", error=ParameterError)
    if not _is_format(found):
        remedy = "give an instance of socialbot.vision.metrics.LabelFormat"
        raise ParameterError(f"{name!r} is no format", where="--format", remedy=remedy)
    return found


def _is_format(value: object) -> bool:
    return isinstance(value, LabelFormat)


def labelled_sources(
    images: Path | None, truth: Path | None = None, format: str | None = None, people: Sequence[str] = ()
) -> list[LabelledSource]:
    """Read labelled images or videos of any known format.

    Args:
        images: Folder of the data set, or, with ``truth``, of its images; may be a label file or a video.
        truth: Label file or folder, relative to the working directory or to ``images``; default: found in ``images``.
        format: A name in `FORMATS`, or ``module:NAME`` of a `LabelFormat`; default: recognised by the files.
        people: Further names of classes of people.

    Raises:
        ParameterError: The format is unknown.
        TruthError: The labels are invalid.
        ImageError: There are no images.
    """
    chosen = None if format is None else label_format(format)
    if truth is not None and images is not None and not truth.exists() and (images / truth).exists():
        truth = images / truth
    labels = truth or images
    assert labels is not None
    if not labels.exists():
        raise fault("there is no such file or folder", labels, "check the path")
    if chosen is None:
        name = sniff(labels)
        if name is None:
            other = unread_format(labels)
            expected = "; ".join(f"{each.name}: {each.expected}" for each in FORMATS.values())
            remedy = f"expected is a bag, or {expected}. Name one with --format, or convert others to COCO"
            if labels.suffix.lower() in ARCHIVES:
                remedy = "unpack it, and give its folder"
            raise fault(f"no labels of a known format{other and f', but of {other}'}", labels, remedy)
        chosen = FORMATS[name]
    place = images if truth is not None else None
    places = (chosen.places(labels) if labels.is_dir() else [labels]) or [labels]
    sources = with_own_names([(each, source) for each in places for source in chosen.read(each, place, people)])
    check_people({name for source in sources for name in source.classes}, people, labels)
    note = chosen.note(labels) if labels.is_dir() else ""
    return [replace(sources[0], notes=(*sources[0].notes, note)), *sources[1:]] if note and sources else sources
