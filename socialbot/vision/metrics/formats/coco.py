"""COCO: a JSON file with images, annotations and categories; COCO-VID adds videos and instance ids."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from socialbot.bags.reader import natural
from socialbot.core.clock import SECOND
from socialbot.core.reading import read_bytes
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    DEFAULT_RATE_HZ,
    Entry,
    ImageFinder,
    Labels,
    fault,
    folders_in,
    missing_images,
    refuse_score,
    role_of,
    sequence,
    single_images,
)
from socialbot.vision.metrics.frames import LabelledSource
from socialbot.vision.metrics.truth import parse_json, read_json

ROBOFLOW = "_annotations.coco.json"  # The same name in each folder of a data set of Roboflow.
REMEDY = "give a COCO file with images, annotations (with bbox) and categories, such as instances_val2017.json"

Key = int | str


class _Image(msgspec.Struct):
    id: Key
    file_name: str = ""
    coco_url: str = ""  # LVIS has no file names.
    width: float | None = None
    height: float | None = None
    video_id: Key | None = None
    frame_id: int | None = None


class _Category(msgspec.Struct):
    id: Key
    name: str


class _Annotation(msgspec.Struct):
    image_id: Key
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
    score: float | None = None
    segments_info: list[msgspec.Raw] = []  # of panoptic labels: all objects of an image


class _Segment(msgspec.Struct):
    category_id: Key
    bbox: list[float]
    iscrowd: int | bool | None = 0
    area: float | None = None


class _Video(msgspec.Struct):
    id: Key
    name: str = ""
    fps: float | None = None


class _File(msgspec.Struct):
    images: list[msgspec.Raw]
    annotations: list[msgspec.Raw]
    categories: list[msgspec.Raw] = []
    videos: list[msgspec.Raw] = []


def is_coco(path: Path) -> bool:
    """Whether a file is a JSON object with images and annotations."""
    try:
        msgspec.json.decode(read_bytes(path), type=_File)
    except (OSError, msgspec.MsgspecError, UnicodeError, RecursionError):
        return False
    return True


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
    """Read a COCO file.

    Args:
        path: The JSON file.
        images: Folder of the images; default: found near the file.
        people: Further names of classes of people.

    Returns:
        One source, or one for each video.

    Raises:
        TruthError: The file is invalid.
        ImageError: There are no images.
    """
    data = parse_json(read_json(path), _File, where=str(path), remedy=REMEDY)
    listed = _parsed(data.images, _Image, path, "images")
    categories = {each.id: each.name for each in _parsed(data.categories, _Category, path, "categories")}
    videos = {each.id: each for each in _parsed(data.videos, _Video, path, "videos")}
    labels = Labels(path, people)
    for number, image in enumerate(listed):
        image.file_name = image.file_name or image.coco_url.rpartition("/")[2]
        if not image.file_name:
            raise fault("no file_name", f"{path}: images[{number}]", REMEDY)
    by_id = {image.id: image for image in listed}
    if len(by_id) < len(listed):
        twice = next(image.id for number, image in enumerate(listed) if listed[number] is not by_id[image.id])
        raise fault(f"two images have the id {twice}", path, "give each image its own id")
    annotations = _with_segments(_parsed(data.annotations, _Annotation, path, "annotations"), path)
    identities = _add_annotations(labels, annotations, by_id, categories)
    labels.check_people(categories.values())
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
    if key is None:
        paths = [place for image in group if (place := found[image.id]) is not None]
        images, stamps = single_images(paths)
    else:
        group.sort(key=lambda image: image.frame_id or 0)
        paths = [place for image in group if (place := found[image.id]) is not None]
        rate = video.fps if video and video.fps and 0 < video.fps < 1e4 else DEFAULT_RATE_HZ
        frames = [image.frame_id or 0 for image in group]
        if len(set(frames)) < len(frames) or not all(abs(frame) < 1 << 31 for frame in frames):
            raise fault(f"two images of video {key} have the same frame_id", path, "number the images of each video")
        stamps = tuple(round((frame - min(frames)) * SECOND / rate) for frame in frames)
        images = sequence(paths, stamps)
    entries = [
        Entry(image.id, image.file_name, stamp, image.id, _size(image))
        for image, stamp in zip(group, stamps, strict=True)
    ]
    return labels.source(
        name, "coco", images, entries, **{**about, "identities": about["identities"] and key is not None}
    )


def _with_segments(annotations: list[_Annotation], path: Path) -> list[tuple[str, _Annotation]]:
    """Each annotation with its place in the file; panoptic labels become one annotation for each segment."""
    found: list[tuple[str, _Annotation]] = []
    for number, each in enumerate(annotations):
        where = f"annotations[{number}]"
        for part, segment in enumerate(_parsed(each.segments_info, _Segment, path, f"{where}.segments_info")):
            box, crowd, area = segment.bbox, segment.iscrowd, segment.area
            one = _Annotation(each.image_id, segment.category_id, box, iscrowd=crowd, area=area)
            found.append((f"{path}: {where}.segments_info[{part}]", one))
        if not each.segments_info:
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
                f"image_id {each.image_id} is not among the images", where, "add the image, or remove this entry"
            )
        if each.category_id not in categories:
            raise fault(f"category_id {each.category_id} is not among the categories", where, "add the category")
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
            distance_m=each.distance_m if each.distance_m is not None and each.distance_m >= 0 else None,
        )
    return identities


def _box_around(segmentation: msgspec.Raw) -> list[float]:
    """Box around the outlines of a person; empty without outlines."""
    try:
        outlines = msgspec.json.decode(segmentation, type=list[list[float]])
    except msgspec.MsgspecError:
        return []
    across = [value for outline in outlines for value in outline[::2]]
    down = [value for outline in outlines for value in outline[1::2]]
    if not down:
        return []
    return [min(across), min(down), max(across) - min(across), max(down) - min(down)]


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
