"""YOLO: a .txt file for each image, beside it or in a folder labels beside the folder images.

Lines: class, middle x, middle y, width, height as shares of the image; or class and the points of an outline. Class
names are in data.yaml, classes.txt or a .names file. An image without a file, or with an empty one, shows nobody.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.bags.image_files import read_image
from socialbot.bags.reader import natural
from socialbot.core.errors import ImageError
from socialbot.core.reading import open_file
from socialbot.core.yaml import load_yaml
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    IMAGE_SUFFIXES,
    Labels,
    fault,
    first_line,
    folders_in,
    image_files,
    images_below,
    is_number,
    lines_of,
    numbers,
    read_text,
    refuse_score,
    text_files,
)
from socialbot.vision.metrics.frames import Box, LabelledSource
from socialbot.vision.metrics.truth import utf8

REMEDY = "write class, middle x, middle y, width and height, as shares of the image from 0 to 1"
SLACK = 0.01  # Shares may exceed the image by rounding.
NAME_FILES = ("classes.txt", "labels/classes.txt", "names.txt", "_darknet.labels", "*.names")
SPLITS = ("train", "val", "valid", "test")
_SPLIT = re.compile(f"({'|'.join(SPLITS)})[0-9]*")  # COCO has years in them.


def is_yolo(folder: Path) -> bool:
    """Whether ``folder`` is a YOLO data set."""
    if _yaml_of(folder) or any(any(folder.glob(name)) for name in (*NAME_FILES, "obj.data", "train/_darknet.labels")):
        return True
    labels = folder if _holds_labels(folder) else folder / "labels"
    below = folders_in(labels) if labels.is_dir() else []
    folders = [labels, *(each for each in below if each.name in SPLITS), *(folder / s / "labels" for s in SPLITS)]
    return (
        any(place.is_dir() and any(place.glob("*.txt")) for place in folders)
        or any(_is_labels(path) for each in below for path in text_files(each))
        or any(path.with_suffix(".txt").is_file() for path in image_files(folder)[:20])
    )


def _yaml_of(folder: Path) -> Path | None:
    """The YAML file with class names."""
    files = sorted(folder.glob("*.y*ml"), key=lambda path: (path.stem != "data", path.name))
    return next((path for path in files if _has_names(path)), None)


def _has_names(path: Path) -> bool:
    try:
        with open_file(path) as file:
            text = file.read(100_000)
    except OSError:
        return False
    if b"names" not in text:
        return False
    try:
        loaded = load_yaml(YAML(typ="safe", pure=True), utf8(text).decode())
    except (YAMLError, UnicodeDecodeError):
        return utf8(text).startswith(b"names:") or b"\nnames:" in text
    return isinstance(loaded, dict) and "names" in loaded


def read_yolo(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read a YOLO data set, the folder of its labels, or data.yaml: one source for each part. See `LabelReader`."""
    folder = path if path.is_dir() else path.parent
    names_at, keypoints, parts = _description(path if path.is_file() else _yaml_of(folder), folder)
    names, where = names_at
    if not names:
        above = [folder, folder.parent if _holds_labels(folder) else folder / "train"]
        file = next((file for base in above for name in NAME_FILES for file in sorted(base.glob(name))), None)
        names = dict(enumerate(read_text(file).split("\n"))) if file else {}
        names, where = {number: name.strip() for number, name in names.items() if name.strip()}, file or folder
    parts = {"": [images]} if images is not None else parts or _parts(folder)
    labelled = path if path.is_dir() and (images is not None or _holds_labels(folder)) else None
    files: dict[str, dict[Path, Path | None]] = {}
    for part, places in parts.items():
        listed = dict.fromkeys(image for place in places for image in _images(place))
        paths = sorted(listed, key=natural)
        if paths:
            files[part] = {image: _label_file(image, labelled) for image in paths}
    if not files:
        raise ImageError("no images", where=str(folder), remedy="put them into images/, or give --images")
    if not any(file for part in files.values() for file in part.values()):
        raise fault("no image has a label file", where, "put NAME.txt for NAME.jpg into a folder labels")
    used = {file for there in files.values() for file in there.values() if file is not None}
    beside = sorted(file for place in {file.parent for file in used} for file in place.glob("*.txt"))
    lost = [file for file in beside if file not in used and _is_labels(file)]
    note = f"{len(lost)} label files have no image, the first: {lost[0]}" if lost else ""
    title = (folder.parent if _holds_labels(folder) else folder).resolve().name
    first, *others = (
        _source("/".join(word for word in (title, part) if word), there, names, where, keypoints, people)
        for part, there in files.items()
    )
    return [replace(first, notes=(*first.notes, note)) if note else first, *others]


def _holds_labels(folder: Path) -> bool:
    """Whether ``folder`` is the folder of labels in a data set, and no data set of that name."""
    return folder.name == "labels" and not (folder / "labels").is_dir()


def _source(
    name: str,
    files: Mapping[Path, Path | None],
    names: Mapping[int, str],
    where: Path,
    keypoints: int,
    people: Sequence[str],
) -> LabelledSource:
    labels = Labels(where, people)
    first = "0" if people else "person"
    if not names and not people:
        labels.notes.append("no data.yaml and no classes.txt: class 0 is taken for people")
    unlabelled = 0
    for path, file in files.items():
        size = image_size(path)
        if file is None:
            unlabelled += 1
            continue
        for place, line in lines_of(file):
            words = line.split()
            number = numbers(words[:1], place, REMEDY)[0]
            if number != int(number) or number < 0:
                raise fault(f"the class {words[0][:20]} is not a whole number", place, REMEDY)
            if names and int(number) not in names:
                raise fault(f"class {int(number)} has no name", place, f"name it in {where}")
            box = _box(words[1:], size, keypoints, place)
            labels.add(str(path), names.get(int(number), f"{int(number)}" if number else first), box, place)
    if unlabelled:
        labels.notes.append(f"{unlabelled} of {len(files)} images have no label file: they show nobody")
    labels.declare(names.values())
    return labels.single_source(name, "yolo", [(str(path), path.name, path, None) for path in files])


def _box(words: Sequence[str], size: tuple[int, int], keypoints: int, where: str) -> Box:
    """Box in pixels of a line without its class: a box, a box with score or key points, or an outline."""
    values = numbers(words, where, REMEDY)
    # Trackers write box, score and id. A triangle hardly ever ends with a whole number.
    tracked = not keypoints and len(values) == 6 and values[5] == int(values[5])
    outline = not keypoints and len(values) >= 6 and len(values) % 2 == 0 and not tracked
    if tracked or (len(values) == 5 and not keypoints):
        refuse_score(values[4], where)
    if len(values) < 4 or not (len(values) < 6 or tracked or outline or keypoints):
        remedy = f"{REMEDY}; for key points, set kpt_shape in data.yaml" if len(values) > 5 else REMEDY
        raise fault(f"{len(values) + 1} columns", where, remedy)
    shares = values if outline else values[:4]
    if not all(-SLACK <= value <= 1 + SLACK for value in shares):
        worst = max(shares, key=abs)
        raise fault(f"{worst:g} is not a share of the image", where, REMEDY)
    width, height = size
    if outline:
        left, right, top, bottom = min(values[::2]), max(values[::2]), min(values[1::2]), max(values[1::2])
        return left * width, top * height, (right - left) * width, (bottom - top) * height
    x, y, w, h = shares
    return (x - w / 2) * width, (y - h / 2) * height, w * width, h * height


def _label_file(image: Path, folder: Path | None) -> Path | None:
    """The label file of an image: the last folder "images" in its path becomes "labels"."""
    name = f"{image.stem}.txt"
    places = [folder / name] if folder else []
    for depth, part in enumerate(reversed(image.parts[:-1])):
        if part == "images":
            at = len(image.parts) - 2 - depth
            places.append(Path(*image.parts[:at], "labels", *image.parts[at + 1 : -1], name))
            break
    places += [image.with_name(name), image.parent / "labels" / name, image.parent.parent / "labels" / name]
    return next((place for place in places if place.is_file()), None)


def _parts(folder: Path) -> dict[str, list[Path]]:
    """Folders of images by part, without a description."""
    base = folder.parent if _holds_labels(folder) else folder
    names = [each.name for each in folders_in(base / "images")] if (base / "images").is_dir() else []
    splits = dict.fromkeys((*SPLITS, *filter(_SPLIT.fullmatch, names)))
    for pattern in ("images/{}", "{}/images", "{}"):
        found = {part: [base / pattern.format(part)] for part in splits}
        if any(_images(place) for [place] in found.values()):
            return found
    places = [place for place in (base / "images", base / "obj_train_data") if _images(place)]
    return {"": places[:1] or [base][: len(image_files(base))]}


def _images(place: Path) -> list[Path]:
    """Images in a folder, or those that a text file lists."""
    if place.suffix.lower() in IMAGE_SUFFIXES:
        return [place] if place.is_file() else []
    if place.is_file():
        listed = [Path(line) for _, line in lines_of(place) if "\0" not in line]
        return [found for path in listed if (found := _listed(path, place.parent)) is not None]
    return image_files(place) or image_files(place / "images") or list(images_below(place))


def _listed(path: Path, base: Path) -> Path | None:
    """An image of a list, which may have been moved together with it."""
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        return None
    places = [path, *(base.joinpath(*path.parts[first:]) for first in range(len(path.parts)))]
    try:
        return next((place for place in places[not path.is_absolute() :] if place.is_file()), None)
    except OSError:
        return None


def _description(path: Path | None, folder: Path) -> tuple[tuple[dict[int, str], Path], int, dict[str, list[Path]]]:
    """Class names and their file, the number of key points, and folders or lists of images by part."""
    if path is None:
        return ({}, folder), 0, {}
    try:
        loaded: Any = load_yaml(YAML(typ="safe", pure=True), read_text(path))
    except YAMLError as error:
        raise fault(
            f"cannot be read: {' '.join(str(error).split())[:200]}", path, "write names: [person, ...]"
        ) from error
    names: Any = loaded.get("names") if isinstance(loaded, dict) else None
    if isinstance(names, list):
        names = dict(enumerate(names))
    if isinstance(names, dict):
        names = {int(key) if isinstance(key, str) and key.isdecimal() else key: name for key, name in names.items()}
    if not isinstance(names, dict) or not all(isinstance(key, int) for key in names):
        raise fault("no names of classes", path, "write names: [person, ...], or names: {0: person}")
    shape = loaded.get("kpt_shape")
    keypoints = shape[0] if isinstance(shape, list) and shape and isinstance(shape[0], int) else 0
    root = loaded.get("path")
    bases = [path.parent, path.parent.parent]
    if isinstance(root, str) and "\0" not in root:
        bases = [path.parent / root, path.parent.parent / root, *bases]
    parts: dict[str, list[Path]] = {}
    for part in SPLITS:
        given = loaded.get(part)
        for each in [given] if isinstance(given, str) else given if isinstance(given, list) else []:
            place = _existing(str(each), bases)
            if place is not None and place not in [other for listed in parts.values() for other in listed]:
                parts.setdefault(part, []).append(place)
    return ({number: str(name) for number, name in names.items()}, path), keypoints, parts


def _existing(name: str, bases: Iterable[Path]) -> Path | None:
    """A folder or file with images; Roboflow writes ../train/images for train/images."""
    if "\0" in name:
        return None
    names = [name, name.removeprefix("../")]
    places = [base / each for each in names for base in bases]
    try:
        return next((place.resolve() for place in places if place.is_file() or _images(place)), None)
    except OSError:
        return None


def _is_labels(path: Path) -> bool:
    """Whether a text file has five or more columns of numbers."""
    line = first_line(path)
    words = line.split()
    return "," not in line and len(words) >= 5 and all(map(is_number, words))


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image as it is shown, from its header where possible.

    Raises:
        ImageError: It cannot be read.
    """
    try:
        with open_file(path) as file:
            head = file.read(1 << 16)
            head += file.read() if head.startswith(b"\x89PNG") else b""  # its EXIF may be at the end
    except OSError as error:
        raise ImageError(error.strerror or str(error), where=str(path), remedy="check the path") from error
    # EXIF may turn the image.
    turned = any(name in head.lower() for name in (b"exif", b"raw profile type app1"))
    size = None if turned else _png_size(head) or _jpeg_size(head)
    if size is None:
        pixels = read_image(path)
        size = pixels.shape[1], pixels.shape[0]
    return size


def _png_size(head: bytes) -> tuple[int, int] | None:
    if head[:8] != b"\x89PNG\r\n\x1a\n" or head[12:16] != b"IHDR" or len(head) < 24:
        return None
    return struct.unpack(">II", head[16:24])


def _jpeg_size(head: bytes) -> tuple[int, int] | None:
    if head[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(head) and head[at] == 0xFF:
        marker, length = head[at + 1], int.from_bytes(head[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            return (width, height) if width and height else None
        at += 2 + length
    return None


YOLO = LabelFormat(
    "yolo",
    "labels/NAME.txt for images/NAME.jpg",
    read_yolo,
    lambda folder: [folder] if is_yolo(folder) or any(map(_is_labels, text_files(folder))) else [],
    lambda path: path.suffix.lower() in (".yaml", ".yml") or _is_labels(path),
)
