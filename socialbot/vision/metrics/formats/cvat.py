"""CVAT: one XML file, "CVAT for images 1.1" with boxes by image, or "CVAT for video 1.1" with tracks."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from socialbot.bags.image_files import DEFAULT_RATE_HZ
from socialbot.core.errors import ImageError
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    VIDEO_SUFFIXES,
    Entry,
    ImageFinder,
    Labels,
    distance_in,
    fault,
    first_folder,
    frames_of,
    image_files,
    labelled_size,
    missing_images,
    number_in,
    numbers,
    recording,
    video,
)
from socialbot.vision.metrics.formats._xml import Element, at, attribute, read_xml, root_tag
from socialbot.vision.metrics.frames import Box, ImageSequence, LabelledSource

REMEDY = "export it again as CVAT for images 1.1 or CVAT for video 1.1"
MAX_FRAME = 10_000_000
MAX_GAP = 1000  # Longer gaps between key frames are not filled.
OUTLINES = ("polygon", "polyline", "skeleton")


def cvat_files(folder: Path) -> list[Path]:
    """The CVAT file in ``folder``: annotations.xml or another one; none if there is none."""
    files = sorted(folder.glob("*.xml"), key=lambda path: (path.name != "annotations.xml", path.name))
    return [path for path in files[:20] if root_tag(path) == "annotations"][:1]


def read_cvat(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read a CVAT file. See `LabelReader`."""
    root = read_xml(path)
    if root.tag != "annotations":
        raise fault(f"the root is <{root.tag}>, not <annotations>", path, REMEDY)
    labels = Labels(path, people)
    classes = [(each.text or "").strip() for each in root.iterfind("meta//labels/label/name")]
    if root.find("image") is None:
        source = _video(root, labels, images)
    else:
        source = _images(root, labels, images)
    labels.declare(classes)
    return [source]


def _images(root: Element, labels: Labels, images: Path | None) -> LabelledSource:
    places = [images] if images else [labels.path.parent / "images", labels.path.parent]
    finder = ImageFinder(*(place for place in places if not place.is_file()))
    listed = root.findall("image")
    # Tasks of a project may have images of the same name; its export has a folder for each subset.
    names = ["/".join(word for word in (each.get("subset"), each.get("name")) if word) for each in listed]
    if listed and not any(map(finder.find, names)):
        films = _films(root, places)
        if films:
            return _frames(root, labels, films[0])
    found, missing = [], []
    for number, (each, path) in enumerate(zip(listed, names, strict=True)):
        where, name = at(labels.path, each), each.get("name") or ""
        if not name:
            raise fault("the image has no name", where, REMEDY)
        place = finder.find(path)
        if place is None:
            missing.append(name)
            continue
        found.append((number, name, place, labelled_size(each.get("width"), each.get("height"))))
        for shape in each:
            _add(labels, number, shape, shape.get("label") or "", "")
    missing_images(missing, len(listed), images or labels.path.parent, labels)
    return labels.single_source(_name(root, labels.path), "cvat", found)


def _frames(root: Element, labels: Labels, film: Path) -> LabelledSource:
    """Images that are frames of a video, with the number of the frame in their names."""
    pictures = video(film)
    entries, lost = [], []
    for each in root.findall("image"):
        name = each.get("name") or ""
        frame = number_in(name)
        if frame is None or frame >= len(pictures.stamps):
            lost.append(name)
            continue
        size = labelled_size(each.get("width"), each.get("height"))
        entries.append(Entry(frame, name, pictures.stamps[frame], frame + 1, size))
        for shape in each:
            _add(labels, frame, shape, shape.get("label") or "", "")
    missing_images(lost, len(entries) + len(lost), film, labels)
    entries.sort(key=lambda entry: entry.stamp)
    return labels.source(_name(root, labels.path), "cvat", pictures, entries)


def _video(root: Element, labels: Labels, images: Path | None) -> LabelledSource:
    for number, track in enumerate(root.findall("track")):
        name, id = track.get("label") or "", track.get("id") or str(number)
        shapes = sorted(
            ((_frame(shape, labels.path), shape) for shape in track if "frame" in shape.attrib),
            key=lambda each: each[0],
        )
        for frame, shape in shapes:
            if shape.get("outside") != "1":
                _add(labels, frame, shape, name, id)
        _interpolate(labels, shapes, name, id, _step(root))
    size = root.find("meta//original_size")
    labelled = None if size is None else labelled_size(size.findtext("width"), size.findtext("height"))
    return labels.tracked_source(_name(root, labels.path), "cvat", *_sequence(root, labels, images), labelled)


def _interpolate(
    labels: Labels, shapes: Sequence[tuple[int, ElementTree.Element]], name: str, id: str, step: int
) -> None:
    """Add the boxes between key frames that a file leaves out."""
    for (before, first), (after, second) in itertools.pairwise(shapes):
        if first.get("outside") == "1" or first.tag != "box" or second.tag != "box" or after - before <= step:
            continue
        if after - before > MAX_GAP:
            what = f"no box between the frames {before} and {after}"
            raise fault(what, at(labels.path, second), "export all frames, or end the track with outside=1")
        one, two = _box(first, labels.path), _box(second, labels.path)
        if one is None or two is None:
            continue
        near, far = _distance(first, labels.path), _distance(second, labels.path)
        for frame in range(before + step, after, step):
            share = (frame - before) / (after - before)
            x, y, w, h = (a + share * (b - a) for a, b in zip(one, two, strict=True))
            distance_m = None if near is None or far is None else near + share * (far - near)
            labels.add(frame, name, (x, y, w, h), at(labels.path, first), id=id, distance_m=distance_m)


def _sequence(root: Element, labels: Labels, images: Path | None) -> tuple[ImageSequence, list[tuple[int, str, int]]]:
    """The images, and frame number, name and stamp of each labelled one."""
    folder = labels.path.parent
    places = [images] if images else [folder / "images", folder]
    films = _films(root, places)
    place = first_folder(*(each for each in places if each.is_dir()))
    if place is None and not films:
        source = _film_name(root)
        raise ImageError(
            f"no images and no video{f' {source}' if source else ''}",
            where=str(images or folder),
            remedy="put them beside the file, or name them with --images",
        )
    start, stop = _number(root, "start_frame", 0), _number(root, "stop_frame", -1)
    if place is None:
        film = video(films[0])
        count = len(film.stamps)
        frames = range(start, min(stop + 1, count) if stop >= 0 else count, _step(root))
        return film, [(frame, f"frame {frame}", film.stamps[frame]) for frame in frames]
    paths = image_files(place)
    labels.notes.append(f"{DEFAULT_RATE_HZ:g} images a second are assumed")
    return recording(paths, frames_of(paths, labels, start, _step(root)), DEFAULT_RATE_HZ)


def _films(root: Element, places: Sequence[Path]) -> list[Path]:
    """Videos in ``places``, that of the task first."""
    films = [place for place in places if place.is_file()]
    films += [path for place in places if place.is_dir() for path in sorted(place.iterdir()) if _is_video(path)]
    return sorted(films, key=lambda path: path.name != Path(_film_name(root)).name)


def _film_name(root: Element) -> str:
    return (root.findtext("meta/source") or root.findtext("meta//source") or "").strip()


def _add(labels: Labels, key: int, shape: ElementTree.Element, name: str, id: str) -> None:
    if shape.tag in ("attribute", "tag"):
        return
    where = at(labels.path, shape)
    box = _box(shape, labels.path)
    if not name:
        labels.skipped["without a label"] += 1
    elif box is None:
        labels.skipped[f"of shape {shape.tag}"] += 1
    else:
        labels.add(key, name, box, where, id=id, distance_m=_distance(shape, labels.path))


def _distance(shape: ElementTree.Element, path: Path) -> float | None:
    return distance_in({each.get("name"): each.text for each in shape.iterfind("attribute")}, at(path, shape))


def _box(shape: ElementTree.Element, path: Path) -> Box | None:
    """Box of a shape, or around it; None for shapes without one."""
    if shape.tag == "box":
        left, top, right, bottom = (attribute(shape, side, path) for side in ("xtl", "ytl", "xbr", "ybr"))
        width, height, (cos, sin) = right - left, bottom - top, _rotation(shape, path)
        if not sin:
            return left, top, width, height
        return _centred((left + right) / 2, (top + bottom) / 2, width * cos + height * sin, width * sin + height * cos)
    if shape.tag == "ellipse":
        x, y, across, down = (attribute(shape, name, path) for name in ("cx", "cy", "rx", "ry"))
        cos, sin = _rotation(shape, path)
        return _centred(x, y, 2 * math.hypot(across * cos, down * sin), 2 * math.hypot(across * sin, down * cos))
    if shape.tag == "mask":
        left, top, width, height = (attribute(shape, side, path) for side in ("left", "top", "width", "height"))
        return left, top, width, height
    if shape.tag in OUTLINES:
        parts = [shape, *(point for point in shape.iterfind("points") if point.get("outside") != "1")]
        words = [word for part in parts if part.get("points") for word in re.split(r"[;,]", part.get("points") or "")]
        if not words:
            return None
        values = numbers(words, f"{at(path, shape)}, points", "write x,y;x,y;...")
        across, down = values[::2], values[1::2]
        if len(across) == len(down):
            return min(across), min(down), max(across) - min(across), max(down) - min(down)
    return None


def _rotation(shape: ElementTree.Element, path: Path) -> tuple[float, float]:
    """Absolute cosine and sine of the rotation of a shape about its middle."""
    angle = math.radians(attribute(shape, "rotation", path)) if shape.get("rotation") else 0.0
    return abs(math.cos(angle)), abs(math.sin(angle))


def _centred(x: float, y: float, width: float, height: float) -> Box:
    return x - width / 2, y - height / 2, width, height


def _frame(shape: ElementTree.Element, path: Path) -> int:
    frame = attribute(shape, "frame", path)
    if frame != int(frame) or not 0 <= frame <= MAX_FRAME:
        raise fault(f"frame is {frame:g}", at(path, shape), "number the frames from 0")
    return int(frame)


def _step(root: Element) -> int:
    found = re.search(r"step\s*=\s*(\d{1,6})", root.findtext("meta//frame_filter") or "")
    return max(1, int(found[1])) if found else 1


def _number(root: Element, name: str, default: int) -> int:
    text = (root.findtext(f"meta//{name}") or "").strip()
    return int(text) if text.isdecimal() and len(text) < 8 else default


def _name(root: Element, path: Path) -> str:
    for place in ("task", "job", "project"):
        name = (root.findtext(f"meta/{place}/name") or "").strip()
        if name:
            return name
    return path.parent.resolve().name if path.stem == "annotations" else path.stem


def _is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_SUFFIXES


CVAT = LabelFormat(
    "cvat",
    "annotations.xml",
    read_cvat,
    cvat_files,
    lambda path: path.suffix.lower() == ".xml" and root_tag(path) == "annotations",
)
