"""Read labelled data sets in the common formats: COCO, MOTChallenge, KITTI, YOLO, Pascal VOC and CVAT."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from socialbot.core.errors import ParameterError
from socialbot.vision.metrics.formats._labels import fault, is_number
from socialbot.vision.metrics.formats._xml import root_tag
from socialbot.vision.metrics.formats.coco import coco_files, is_coco, read_coco
from socialbot.vision.metrics.formats.cvat import cvat_file, read_cvat
from socialbot.vision.metrics.formats.kitti import kitti_folders, read_kitti
from socialbot.vision.metrics.formats.mot import read_mot, sequences, unlabelled_note
from socialbot.vision.metrics.formats.voc import read_voc, voc_folders
from socialbot.vision.metrics.formats.yolo import is_yolo, read_yolo
from socialbot.vision.metrics.frames import LABELS_FILE, LabelledSource, image_sources

FORMATS = ("socialbot", "coco", "mot", "kitti", "yolo", "voc", "cvat")
"""Names of the formats."""

_READERS = {
    "coco": read_coco, "mot": read_mot, "kitti": read_kitti, "yolo": read_yolo, "voc": read_voc, "cvat": read_cvat,
}  # fmt: skip

_EXPECTED = {
    "socialbot": LABELS_FILE,
    "coco": "a JSON file with images and annotations",
    "mot": "gt/gt.txt",
    "kitti": "label_2 or label_02",
    "yolo": "labels/NAME.txt for images/NAME.jpg",
    "voc": "Annotations/NAME.xml",
    "cvat": "annotations.xml",
}


def sniff(path: Path) -> str | None:
    """Format of a label file or of the labels in a folder; None if it is not known."""
    if path.is_dir():
        return next((name for name in FORMATS if _places(path, name)), None)
    suffix = path.suffix.lower()
    if suffix == ".json":
        return "coco" if is_coco(path) else "socialbot"
    if suffix == ".xml":
        return {"annotation": "voc", "annotations": "cvat"}.get(root_tag(path))
    if suffix in (".yaml", ".yml"):
        return "yolo"
    return _text_format(path) if suffix == ".txt" else None


def _places(folder: Path, format: str) -> list[Path]:
    """What the reader of a format is to be called with for ``folder``; empty if there is nothing of that format."""
    if format == "socialbot":
        return [folder] if (folder / LABELS_FILE).is_file() else []
    if format == "coco":
        return coco_files(folder)
    if format == "mot":
        return sequences(folder)
    if format == "kitti":
        flat = [place for place in (folder, folder / "labels") if _first_text(place) == "kitti"]
        return kitti_folders(folder) or flat[:1]
    if format == "yolo":
        return [folder] if is_yolo(folder) or _first_text(folder) == "yolo" else []
    if format == "voc":
        return voc_folders(folder)
    found = cvat_file(folder)
    return [] if found is None else [found]


def _first_text(folder: Path) -> str | None:
    """Format of the first text file in ``folder`` that has one."""
    known = (_text_format(path) for path in sorted(folder.glob("*.txt"))[:20] if path.name != "classes.txt")
    return next((format for format in known if format), None)


def _text_format(path: Path) -> str | None:
    """Format of a text file by its first line."""
    try:
        with path.open("rb") as file:
            line = next((each for each in (file.readline(4096) for _ in range(5)) if each.strip()), b"")
    except OSError:
        return None
    words = line.decode("utf-8", "replace").replace(",", " ").split()
    if b"," in line:
        return "mot" if len(words) >= 6 else None
    if len(words) in (15, 16, 17, 18) and not all(is_number(word) for word in words[:3]):
        return "kitti"
    return "yolo" if len(words) >= 5 and all(map(is_number, words)) else None


def labelled_sources(
    images: Path | None, truth: Path | None = None, format: str | None = None, people: Sequence[str] = ()
) -> list[LabelledSource]:
    """Read labelled images or videos of any known format.

    Args:
        images: Folder of the data set, or, with ``truth``, of its images; may be a label file or a video.
        truth: Label file or folder, relative to the working directory or to ``images``; default: found in ``images``.
        format: One of `FORMATS`; default: recognised by the files.
        people: Further names of classes of people.

    Raises:
        ParameterError: The format is unknown.
        TruthError: The labels are invalid.
        ImageError: There are no images.
    """
    if format is not None and format not in FORMATS:
        raise ParameterError(f"unknown format {format!r}", where="--format", remedy=f"one of {', '.join(FORMATS)}")
    if truth is not None and images is not None and not truth.exists() and (images / truth).exists():
        truth = images / truth
    labels = truth or images
    assert labels is not None
    if not labels.exists():
        raise fault("there is no such file or folder", labels, "check the path")
    place = images if truth is not None else None
    format = format or sniff(labels)
    if format is None:
        expected = "; ".join(f"{name}: {what}" for name, what in _EXPECTED.items())
        raise fault("no labels of a known format", labels, f"expected is {expected}. Or name one with --format")
    if format == "socialbot":
        return image_sources(images if images is not None else labels.parent, truth)
    places = (_places(labels, format) if labels.is_dir() else [labels]) or [labels]
    sources = [source for each in places for source in _READERS[format](each, place, people)]
    note = unlabelled_note(labels) if format == "mot" and labels.is_dir() else ""
    return [replace(sources[0], notes=(*sources[0].notes, note)), *sources[1:]] if note else sources
