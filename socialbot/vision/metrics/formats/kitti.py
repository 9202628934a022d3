"""KITTI: label_2/NAME.txt beside image_2 (objects), or label_02/SEQUENCE.txt beside image_02 (tracking).

Columns: type, truncated, occluded, alpha, left, top, right, bottom, height, width, length, x, y, z, rotation; tracking
labels have frame (from 0) and id before them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from socialbot.bags.reader import natural
from socialbot.core.errors import ImageError
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    ImageFinder,
    Labels,
    fault,
    first_line,
    folders_in,
    frames_of,
    image_files,
    is_number,
    lines_of,
    missing_images,
    numbers,
    recording,
    refuse_score,
    text_files,
    unlabelled_images,
)
from socialbot.vision.metrics.frames import LabelledSource

RATE_HZ = 10.0
MOST_TRUNCATED = 0.5
MOST_OCCLUDED = 2
"""People beyond these limits, those of KITTI's level "hard", are not scored."""

REMEDY = "write type, truncated, occluded, alpha, left, top, right, bottom, 3 sizes, x, y, z, rotation"
NAMES = ("label_2", "label_3", "label_02", "label_03")


def kitti_folders(folder: Path) -> list[Path]:
    """Folders of labels in ``folder`` or in its folders, such as ``training``; else itself or its ``labels``."""
    bases = [folder.parent] if folder.name in NAMES else [folder, *folders_in(folder)]
    names = [folder.name] if folder.name in NAMES else NAMES
    held = (next((base / name for name in names if (base / name).is_dir()), None) for base in bases)
    # Exports of other tools have a folder for each part, beside these folders or within them.
    parts = [part for place in held if place for part in (place, *folders_in(place)) if text_files(part)]
    flat = (place for place in (folder, folder / "labels") if any(map(_is_kitti, text_files(place))))
    return parts or list(flat)[:1]


def read_kitti(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read KITTI labels: one source of single images, or one for each tracking sequence. See `LabelReader`."""
    files = [path] if path.is_file() else sorted(path.glob("*.txt"), key=natural)
    if not files:
        raise fault("no .txt files", path, "give the folder of the label files")
    folder = path.parent if path.is_file() else path
    holder = folder.parent if folder.parent.name in NAMES and folder.name not in NAMES else folder
    part = folder.name if holder is not folder else ""
    place = images or holder.with_name(holder.name.replace("label", "image")) / part
    if _is_tracking(files):
        return [_tracking(file, images or place / file.stem, people) for file in files]
    labels = Labels(path, people)
    for file in files:
        for where, line in lines_of(file):
            words = line.split()
            _add(labels, file.stem, words, where, "")
    finder = ImageFinder(place)
    found = {file.stem: finder.find(f"{file.stem}.png") for file in files}
    missing_images([stem for stem, image in found.items() if image is None], len(files), place, labels)
    there = {stem: image for stem, image in found.items() if image is not None}
    if path.is_dir():
        unlabelled_images(list(there.values()), "label file", labels)
    base = holder.parent if holder.parent.name != "training" else holder.parent.parent
    listed = [(stem, image.name, image, None) for stem, image in there.items()]
    name = "/".join(word for word in (base.resolve().name, part) if word)
    return [labels.single_source(name or "kitti", "kitti", listed)]


def _is_tracking(files: Sequence[Path]) -> bool:
    """Whether the first line begins with two numbers and a class, as in tracking labels."""
    for file in files:
        for _, line in lines_of(file):
            words = line.split()
            return len(words) >= 17 and words[0].lstrip("-").isdecimal() and not is_number(words[2])
    return False


def _tracking(file: Path, place: Path, people: Sequence[str]) -> LabelledSource:
    labels = Labels(file, people)
    for where, line in lines_of(file):
        words = line.split()
        frame, id = (words[0], words[1]) if len(words) > 2 else ("", "")
        if not frame.isdecimal() or not id.lstrip("-").isdecimal() or len(frame) > 9 or len(id) > 18:
            raise fault("the line does not begin with frame and id", where, f"write frame, id; then {REMEDY[6:]}")
        _add(labels, int(frame), words[2:], where, id if not id.startswith("-") else "")
    paths = image_files(place)
    if not paths:
        raise ImageError("no images", where=str(place), remedy="name their folder with --images")
    pictures, numbered = recording(paths, frames_of(paths, labels, 0), RATE_HZ)
    return labels.tracked_source(file.stem, "kitti", pictures, numbered)


def _add(labels: Labels, key: int | str, words: Sequence[str], where: str, id: str) -> None:
    """Add a line without frame and id."""
    if not 15 <= len(words) <= 16:
        raise fault(f"{len(words)} columns instead of 15", where, REMEDY)
    truncated, occluded, _, left, top, right, bottom, *rest = numbers(words[1:], where, REMEDY)
    refuse_score(sum(rest[7:]), where)
    # In tracking labels, truncation is a level: 0, 1 or 2.
    poor = truncated > (1 if id else MOST_TRUNCATED) or occluded > MOST_OCCLUDED
    x, _, z = rest[3:6]
    labels.add(
        key,
        words[0],
        (left, top, right - left, bottom - top),
        where,
        id=id,
        ignore=poor,
        distance_m=math.hypot(x, z) if z > 0 else None,
    )


def _is_kitti(path: Path) -> bool:
    """Whether the columns of a text file begin with a type, or with frame, id and type."""
    line = first_line(path)
    words = line.split()
    return "," not in line and len(words) in (15, 16, 17, 18) and not all(map(is_number, words[:3]))


KITTI = LabelFormat("kitti", "label_2 or label_02", read_kitti, kitti_folders, _is_kitti)
