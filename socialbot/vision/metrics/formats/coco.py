"""COCO: a JSON file with images, annotations and categories.

COCO-VID adds videos and instance ids. YouTube-VIS has videos with names of images, and one annotation for each person.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import msgspec

from socialbot.bags.image_files import DEFAULT_RATE_HZ
from socialbot.bags.reader import natural
from socialbot.core.decoding import from_json
from socialbot.core.errors import TruthError
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    Entry,
    ImageFinder,
    Labels,
    distance_in,
    fault,
    folders_in,
    missing_images,
    recording,
    refuse_score,
    role_of,
    single_images,
)
from socialbot.vision.metrics.frames import Key, LabelledSource
from socialbot.vision.metrics.truth import parse_json, read_json

ROBOFLOW = "_annotations.coco.json"  # The same name in each folder of a data set of Roboflow.
REMEDY = "give a COCO file with images, annotations (with bbox) and categories, such as instances_val2017.json"

MOST_BITS = 35
"""Most bits of a run length: an image has fewer than 2 ** 32 pixels."""


class _Image(msgspec.Struct):
    id: Key
    file_name: str = ""
    coco_url: str = ""  # LVIS has no file names.
    width: float | None = None
    height: float | None = None
    video_id: Key | None = None
    frame_id: int | None = None
    frame_index: int | None = None  # TAO

    def __post_init__(self) -> None:
        if self.frame_id is None:
            self.frame_id = self.frame_index


class _Category(msgspec.Struct):
    id: Key
    name: str


class _Annotation(msgspec.Struct):
    image_id: Key = ""
    category_id: Key | None = None
    bbox: list[float] | None = None
    segmentation: msgspec.Raw = msgspec.Raw(b"null")
    id: Key | None = None
    iscrowd: int | bool | None = 0
    ignore: int | bool | None = 0
    area: float | None = None
    instance_id: Key | None = None
    track_id: Key | None = None
    distance_m: float | None = None
    attributes: Any = None  # of annotation tools
    score: float | None = None
    segments_info: list[msgspec.Raw] = []  # of panoptic labels: all objects of an image
    video_id: Key | None = None
    bboxes: list[list[float] | None] = []  # of YouTube-VIS: the boxes of a person in all images of the video
    segmentations: list[msgspec.Raw] = []


class _Mask(msgspec.Struct):
    size: tuple[int, int]
    counts: list[int] | str


class _Segment(msgspec.Struct):
    category_id: Key
    bbox: list[float]
    iscrowd: int | bool | None = 0
    area: float | None = None


class _Video(msgspec.Struct):
    id: Key
    name: str = ""
    fps: float | None = None
    file_names: list[str] = []
    width: float | None = None
    height: float | None = None


class _File(msgspec.Struct):
    annotations: list[msgspec.Raw]
    images: list[msgspec.Raw] = []
    categories: list[msgspec.Raw] = []
    videos: list[msgspec.Raw] = []


def is_coco(path: Path) -> bool:
    """Whether a file is a JSON object with images or videos, and annotations."""
    try:
        data = from_json(read_json(path), _File)
    except (TruthError, msgspec.MsgspecError, UnicodeError, RecursionError):
        return False
    return bool(data.images or data.videos)


def coco_files(folder: Path) -> list[Path]:
    """COCO files in ``folder`` or its folder ``annotations``, else in its other folders.

    If there are files of boxes and others, the former.
    """
    return _files_in(folder) or [path for part in folders_in(folder) for path in _files_in(part)]


def _files_in(folder: Path) -> list[Path]:
    files = [path for place in (folder / "annotations", folder) if place.is_dir() for path in place.glob("*.json")]
    found = [path for path in sorted(files, key=natural) if is_coco(path) and "caption" not in path.stem]
    boxes = [path for path in found if path.stem.startswith("instances")]
    return boxes or found


def read_coco(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read a COCO file: one source, or one for each video. See `LabelReader`."""
    data = parse_json(read_json(path), _File, where=str(path), remedy=REMEDY)
    listed = _parsed(data.images, _Image, path, "images")
    classes = _parsed(data.categories, _Category, path, "categories")
    categories = {each.id: each.name for each in classes}
    videos = {each.id: each for each in _parsed(data.videos, _Video, path, "videos")}
    listed += [
        _Image(_frame_key(video.id, number), name, "", video.width, video.height, video.id, number)
        for video in videos.values()
        for number, name in enumerate(video.file_names)
    ]
    labels = Labels(path, people)
    for number, image in enumerate(listed):
        image.file_name = image.file_name or image.coco_url.rpartition("/")[2]
        if not image.file_name:
            raise fault("no file_name", f"{path}: images[{number}]", REMEDY)
    for kind, each in (("images", listed), ("categories", classes)):
        [(id, count)] = Counter(one.id for one in each).most_common(1) or [(None, 1)]
        if count > 1:
            raise fault(f"two {kind} have the id {id}", path, f"give {kind} ids of their own")
    by_id = {image.id: image for image in listed}
    annotations = _single(_parsed(data.annotations, _Annotation, path, "annotations"), path)
    identities = _add_annotations(labels, annotations, by_id, categories)
    labels.declare(categories.values())
    people_ids = [id for id, name in categories.items() if role_of(name, people) == "person"]
    finder = ImageFinder(*([images] if images else [path.parent / path.stem.rpartition("_")[2], *_nearby(path)]))
    found = {image.id: finder.find(image.file_name) for image in listed}
    missing = [image.file_name for image in listed if found[image.id] is None]
    missing_images(missing, len(listed), images or path.parent, labels)
    groups: dict[Key | None, list[_Image]] = {}
    for image in listed:
        if found[image.id] is not None:
            video = image.video_id if image.frame_id is not None else None
            groups.setdefault(video, []).append(image)
    if not all(id is None or _rate(videos.get(id)) for id in groups):
        labels.notes.append(f"videos without fps: {DEFAULT_RATE_HZ:g} images a second are assumed")
    about = {"identities": identities, "category": people_ids[0] if people_ids else 1}
    return [
        _source(labels, videos.get(key) if key is not None else None, key, group, found, about)
        for key, group in groups.items()
    ]


def _source(
    labels: Labels,
    video: _Video | None,
    key: Key | None,
    group: list[_Image],
    found: dict[Key, Path | None],
    about: dict[str, Any],
) -> LabelledSource:
    path = labels.path
    name = path.parent.resolve().name if path.name == ROBOFLOW else path.stem
    name = name if key is None else f"{name}/{video.name if video and video.name else key}"
    if key is not None:
        group.sort(key=lambda image: image.frame_id or 0)
    paths = [place for image in group if (place := found[image.id]) is not None]
    if key is None:
        images, stamps = single_images(paths)
    else:
        frames = [image.frame_id or 0 for image in group]
        if len(set(frames)) < len(frames) or not all(abs(frame) < 1 << 31 for frame in frames):
            raise fault(f"two images of video {key} have the same frame_id", path, "number the images of each video")
        images, _ = recording(paths, frames, _rate(video) or DEFAULT_RATE_HZ)
        stamps = images.stamps
    entries = [
        Entry(image.id, image.file_name, stamp, image.id, _size(image))
        for image, stamp in zip(group, stamps, strict=True)
    ]
    return labels.source(
        name, "coco", images, entries, **{**about, "identities": about["identities"] and key is not None}
    )


def _rate(video: _Video | None) -> float | None:
    return video.fps if video and video.fps and 0 < video.fps < 1e4 else None


def _frame_key(video: Key | None, number: int) -> str:
    """Id of an image that has none, in a video of YouTube-VIS."""
    return f"{video}/{number}"


def _single(annotations: list[_Annotation], path: Path) -> list[tuple[str, _Annotation]]:
    """Annotations of one object in one image, with their places in the file."""
    found: list[tuple[str, _Annotation]] = []
    for number, each in enumerate(annotations):
        where = f"annotations[{number}]"
        for part, segment in enumerate(_parsed(each.segments_info, _Segment, path, f"{where}.segments_info")):
            box, crowd, area = segment.bbox, segment.iscrowd, segment.area
            one = _Annotation(each.image_id, segment.category_id, box, iscrowd=crowd, area=area)
            found.append((f"{path}: {where}.segments_info[{part}]", one))
        none = msgspec.Raw(b"null")
        for part, (box, mask) in enumerate(zip_longest(each.bboxes, each.segmentations)):
            if box or bytes(mask or none) != bytes(none):
                key, track = _frame_key(each.video_id, part), each.id
                one = _Annotation(key, each.category_id, box, mask or none, iscrowd=each.iscrowd, track_id=track)
                found.append((f"{path}: {where}.bboxes[{part}]", one))
        if not (each.segments_info or each.bboxes or each.segmentations):
            found.append((f"{path}: {where}" + (f" (id {each.id})" if each.id is not None else ""), each))
    return found


def _add_annotations(
    labels: Labels,
    annotations: list[tuple[str, _Annotation]],
    images: dict[Key, _Image],
    categories: dict[Key, str],
) -> bool:
    """Add all boxes; returns whether people have ids."""
    identities = bool(annotations)
    for where, each in annotations:
        refuse_score(each.score or 0, where)
        if each.image_id not in images:
            raise fault(
                f"image_id {each.image_id!r} is not among the images", where, "add the image, or remove this entry"
            )
        if each.category_id not in categories:
            raise fault(f"category_id {each.category_id!r} is not among the categories", where, "add the category")
        box = each.bbox or _box_around(each.segmentation)
        if not box and role_of(categories[each.category_id], labels.people) == "other":
            labels.skipped[f"of class {categories[each.category_id]}"] += 1
            continue
        if len(box) != 4:
            raise fault("no bbox of four numbers", where, "write bbox as [x, y, width, height], pixels")
        track = each.instance_id if each.instance_id is not None else each.track_id
        identities &= track is not None
        x, y, w, h = box
        labels.add(
            each.image_id,
            categories[each.category_id],
            (x, y, w, h),
            where,
            id="" if track is None or each.iscrowd else str(track),
            ignore=bool(each.ignore),
            region=bool(each.iscrowd),
            area=each.area if each.area is not None and 0 <= each.area < 1e12 else None,
            distance_m=distance_in(
                each.attributes if each.distance_m is None else {"distance_m": each.distance_m}, where
            ),
        )
    return identities


def _box_around(segmentation: msgspec.Raw) -> list[float]:
    """Box around the outlines or the mask of a person; empty without them."""
    try:
        outlines = from_json(segmentation, list[list[float]] | _Mask | None) or []
    except msgspec.MsgspecError:
        return []
    if isinstance(outlines, _Mask):
        return _box_around_mask(outlines)
    across = [value for outline in outlines for value in outline[::2]]
    down = [value for outline in outlines for value in outline[1::2]]
    if not down:
        return []
    return [min(across), min(down), max(across) - min(across), max(down) - min(down)]


def _box_around_mask(mask: _Mask) -> list[float]:
    """Box around a mask of run lengths, which alternate between background and person, column by column.

    Empty if the mask is empty or invalid.
    """
    height, width = mask.size
    runs = _run_lengths(mask.counts) if isinstance(mask.counts, str) else mask.counts
    if height <= 0 or min(runs, default=0) < 0 or sum(runs) > height * width:
        return []
    across, down, at = list[int](), list[int](), 0
    for number, length in enumerate(runs):
        if number % 2 and length:
            (first, top), (last, bottom) = divmod(at, height), divmod(at + length - 1, height)
            across += [first, last]
            down += [top, bottom] if first == last else [0, height - 1]
        at += length
    if not down:
        return []
    return [min(across), min(down), max(across) - min(across) + 1, max(down) - min(down) + 1]


def _run_lengths(text: str) -> list[int]:
    """Run lengths in the text of pycocotools: five bits a character; from the fourth, changes against two before.

    Empty if a number has too many bits.
    """
    runs, value, shift = list[int](), 0, 0
    for bits in (ord(character) - 48 for character in text):
        value |= (bits & 31) << shift
        shift += 5
        if shift > MOST_BITS:
            return []
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return runs


def _size(image: _Image) -> tuple[int, int] | None:
    if not image.width or not image.height or not (0 < image.width < 1e6 and 0 < image.height < 1e6):
        return None
    return int(image.width), int(image.height)


def _nearby(path: Path) -> list[Path]:
    """Folders to search for images: that of the file, and the one above a folder of annotations."""
    above = path.parent.parent
    split = path.stem.rpartition("_")[2]
    if path.parent.name.lower() not in ("annotations", "labels", "coco", "json"):
        return [path.parent]
    return [above / split, above / "images" / split, above / "images", above, path.parent]


def _parsed(entries: list[msgspec.Raw], kind: type[Any], path: Path, name: str) -> list[Any]:
    return [
        parse_json(entry, kind, where=f"{path}: {name}[{number}]", remedy=REMEDY)
        for number, entry in enumerate(entries)
    ]


COCO = LabelFormat(
    "coco",
    "a JSON file with images and annotations",
    read_coco,
    coco_files,
    lambda path: path.suffix.lower() == ".json" and is_coco(path),
)
