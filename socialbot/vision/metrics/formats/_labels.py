"""Shared parts of the label readers: class names, collected labels, and where images lie."""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from socialbot.bags.image_files import open_video, video_stamps
from socialbot.bags.reader import natural
from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError, TruthError
from socialbot.core.reading import open_file, read_bytes
from socialbot.vision.metrics.frames import (
    BLOCK_S,
    IMAGE_NS,
    Box,
    FolderImages,
    ImageSequence,
    Key,
    LabelledFrame,
    LabelledSource,
    VideoImages,
)
from socialbot.vision.metrics.truth import Person, Region, utf8

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".webm"})
DEEP = 6  # Folders are searched for images down to this depth.

Role = Literal["person", "ignored", "region", "other"]
"""What a class means: people, people who are not scored, regions that are not scored, or other objects."""

_NAMES: dict[Role, str] = {}
_NAMES["person"] = (
    "person people pedestrian pedestrians human man woman boy girl child adult walker persona personne passenger"
    "|person sitting|sitting person|seated person|standing person|other person|wheelchair user|full body|body"
)
_NAMES["ignored"] = (
    "cyclist bicyclist motorcyclist rider bikerider person? reflection distractor"
    "|person on vehicle|static person|person fa"
)
_NAMES["region"] = (
    "dontcare ignore ignored crowd mask group|dont care|ignored regions|ignored region|ignore region"
    "|ignore regions|person group|people group|group of people"
)
ROLES: dict[str, Role] = {
    name: role
    for role, names in _NAMES.items()
    for single, *phrases in [names.split("|")]
    for name in (*single.split(), *phrases)
}
"""Roles of class names in lower case with single spaces."""


def plain_name(name: str) -> str:
    """A class name in lower case, with single spaces instead of punctuation."""
    return " ".join(re.sub(r"[\s_\-()'/.]+", " ", name.lower()).split()).replace("don t care", "dont care")


def role_of(name: str, people: Iterable[str] = ()) -> Role:
    """Role of a class: the names ``people`` are people as well."""
    plain = plain_name(name)
    return "person" if plain in map(plain_name, people) else ROLES.get(plain, "other")


def fault(what: str, where: object, remedy: str) -> TruthError:
    """A TruthError."""
    return TruthError(what, where=str(where), remedy=remedy)


def read_text(path: Path) -> str:
    """Read a text file. Raises TruthError if that fails."""
    try:
        return utf8(read_bytes(path)).decode()
    except OSError as error:
        raise fault(error.strerror or str(error), path, "check the path") from error
    except UnicodeDecodeError as error:
        raise fault(f"not a text file: {error.reason} at byte {error.start}", path, "save it as UTF-8") from error


def first_line(path: Path) -> str:
    """First line of a ``.txt`` file that is not empty, among its first five; empty for other files."""
    if path.suffix.lower() != ".txt":
        return ""
    try:
        with open_file(path) as file:
            lines = utf8(file.read(1 << 15)).decode("utf-8", "replace").splitlines()[:5]
    except OSError:
        return ""
    return next(filter(str.strip, lines), "")


def text_files(folder: Path) -> list[Path]:
    """The first text files in ``folder`` that may hold labels, not names of classes."""
    return [path for path in sorted(folder.glob("*.txt"))[:20] if path.name != "classes.txt"]


def is_number(word: str) -> bool:
    """Whether a word is a number, which may be infinite."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def labelled_size(width: str | None, height: str | None) -> tuple[int, int] | None:
    """Width and height in a label file, pixels; None if they are missing or impossible: some tools write 0."""
    words = [(word or "").strip() for word in (width, height)]
    if not all(word.isdecimal() and len(word) < 7 and int(word) > 0 for word in words):
        return None
    return int(words[0]), int(words[1])


def numbers(words: Sequence[str], where: str, remedy: str) -> list[float]:
    """Parse finite numbers. Raises TruthError for another word."""
    parsed = []
    for column, word in enumerate(words, 1):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not abs(value) < 1e9:
            raise fault(f"{word[:40]!r} in column {column} is not a number", where, remedy)
        parsed.append(value)
    return parsed


def distance_in(attributes: object, where: str) -> float | None:
    """Distance (m) in the attribute ``distance_m`` of a box, as annotation tools write it; None if it is not known.

    Raises:
        TruthError: It is no number.
    """
    value = attributes.get("distance_m") if isinstance(attributes, dict) else None
    text = "" if value is None else str(value).strip()
    if not text:
        return None
    distance_m = numbers([text], f"{where}, distance_m", "write metres such as 5.2, or nothing")[0]
    return distance_m if distance_m >= 0 else None


def refuse_score(value: float, where: str) -> None:
    """Raise TruthError for the score of a detection; labels have a whole number in its place, or nothing."""
    if value != int(value):
        what = f"{value:g} is a score, so this is a detection and no label"
        raise fault(what, where, "give labels that people made or checked; if they are, remove the scores")


def lines_of(path: Path) -> Iterator[tuple[str, str]]:
    """Lines of a text file that are not empty, each with its place for error messages."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if line.strip():
            yield f"{path}, line {number}", line.strip()


@dataclass
class Labels:
    """Labels of one source as they are read.

    Args:
        path: File or folder of the labels, for error messages.
        people: Further names of classes of people.
    """

    path: Path
    people: Sequence[str] = ()
    persons: dict[Key, list[Person]] = field(default_factory=dict)
    regions: dict[Key, list[Region]] = field(default_factory=dict)
    classes: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    _taken: set[tuple[Key, str]] = field(default_factory=set)

    def add(
        self,
        key: Key,
        name: str,
        box: Box,
        where: str,
        *,
        id: str = "",
        ignore: bool = False,
        region: bool = False,
        visible: float = 1.0,
        distance_m: float | None = None,
        area: float | None = None,
    ) -> None:
        """Add a labelled box.

        Args:
            key: Key of its image.
            name: Its class.
            box: x, y, w and h, pixels.
            where: Its place in the file, for error messages.
            id: Id of the person in the whole recording.
            ignore: The person is not scored.
            region: The box is a region that is not scored.

        Raises:
            TruthError: The box is no box, or the id has two boxes in one image.
        """
        role = role_of(name, self.people)
        self.classes[name] += 1
        if role == "other":
            self.skipped[f"of class {name}"] += 1
            return
        if not (all(abs(value) < 1e9 for value in box) and box[2] >= 0 and box[3] >= 0):
            text = ", ".join(f"{value:g}" for value in box)
            raise fault(f"the box {text} (x, y, width, height) is impossible", where, "correct it or remove it")
        corner = dict(zip("xywh", map(float, box), strict=True))
        if role == "region" or region:
            self.regions.setdefault(key, []).append(Region(**corner))
            return
        if not (box[2] > 0 and box[3] > 0):
            self.skipped["without area"] += 1
            return
        there = self.persons.setdefault(key, [])
        if id and (key, id) in self._taken:
            raise fault(f"id {id} has two boxes in one image", where, "give each person an id of their own")
        self._taken.add((key, id))
        there.append(
            Person(
                **corner,
                id=id or f"{key}.{len(there)}",
                distance_m=distance_m,
                visible=min(max(visible, 0.0), 1.0),
                ignore=ignore or role == "ignored",
                area=area,
            )
        )

    def declare(self, classes: Iterable[str]) -> None:
        """Add the names of classes that need not have a box."""
        self.classes.update(dict.fromkeys(classes, 0))

    def source(
        self,
        name: str,
        format: str,
        images: ImageSequence,
        entries: Sequence[Entry],
        *,
        identities: bool = False,
        category: Key = 1,
    ) -> LabelledSource:
        """Make a source of the images ``entries``, in order; other images have been left out."""
        places = images.images if isinstance(images, FolderImages) else [entry.stamp for entry in entries]
        [(place, count)] = Counter(places).most_common(1) or [("", 1)]
        if count > 1:
            one, other, *_ = [entry.name for entry, each in zip(entries, places, strict=True) if each == place]
            image = place if isinstance(images, FolderImages) else f"an image of {images.path}"
            what = f"the images {one} and {other} are the same file, {image}"
            raise fault(what, self.path, "label each image once, with its folder in its name")
        scored = ([person.box for person in there if not person.ignore] for there in self.persons.values())
        twice = sum(len(boxes) - len(set(boxes)) for boxes in scored)
        if twice:
            self.notes.append(f"{twice} boxes of people equal another one in their image: at most one of them is found")
        ranged = any(person.distance_m is not None for there in self.persons.values() for person in there)
        frames = tuple(
            LabelledFrame(
                stamp=entry.stamp,
                name=entry.name,
                block=int(entry.stamp / SECOND // BLOCK_S) if images.consecutive else number,
                persons=tuple(self.persons.get(entry.key, ())),
                ignore=tuple(self.regions.get(entry.key, ())),
                ranged=ranged,
                number=entry.number,
                size=entry.size,
            )
            for number, entry in enumerate(entries)
        )
        skipped = [
            f"not used: {count} {'box' if count == 1 else 'boxes'} {what}" for what, count in self.skipped.most_common()
        ]
        if not any(self.persons.values()):
            boxed = +self.classes
            classes = f" Its classes are {_some(sorted(boxed))}; name one with --people" if boxed else ""
            skipped.insert(0, f"nobody is labelled.{classes}")
        notes = (*self.notes, *skipped)
        return LabelledSource(
            name, name, "", images, frames, least_visible=0.0, format=format, identities=identities,
            category=category, notes=notes, classes=tuple(self.classes),
        )  # fmt: skip

    def single_source(
        self, name: str, format: str, found: Sequence[tuple[Key, str, Path, tuple[int, int] | None]]
    ) -> LabelledSource:
        """Make a source of independent images, given as keys, names, files and labelled sizes."""
        images, stamps = single_images([path for _, _, path, _ in found])
        rows = zip(found, stamps, strict=True)
        entries = [Entry(key, shown, stamp, None, size) for (key, shown, _, size), stamp in rows]
        return self.source(name, format, images, entries)

    def tracked_source(
        self,
        name: str,
        format: str,
        images: ImageSequence,
        numbered: Sequence[tuple[int, str, int]],
        size: tuple[int, int] | None = None,
    ) -> LabelledSource:
        """Make a source of a recording of people with ids; its frames, the keys, are given with names and stamps."""
        lost = {*self.persons, *self.regions} - {frame for frame, _, _ in numbered}
        if lost:
            self.notes.append(f"{len(lost)} labelled frames have no image")
        entries = [Entry(frame, shown, stamp, frame + 1, size) for frame, shown, stamp in numbered]
        return self.source(name, format, images, entries, identities=True)


def check_people(classes: Iterable[str], people: Sequence[str], path: Path) -> None:
    """Raises TruthError if there are ``classes``, but none of people."""
    names = sorted(classes)
    if names and not any(role_of(name, people) in ("person", "ignored") for name in names):
        raise fault(f"no class of people among its classes: {_some(names)}", path, "name it with --people")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")


@dataclass(frozen=True)
class Entry:
    """Image of a source: key of its labels, name, stamp (ns), number in the data set, and labelled size."""

    key: Key
    name: str
    stamp: int
    number: Key | None = None
    size: tuple[int, int] | None = None


# Images


def folders_in(folder: Path) -> list[Path]:
    """Visible folders directly in ``folder``, in natural order."""
    return sorted((each for each in folder.iterdir() if each.is_dir() and each.name[0] != "."), key=natural)


def image_files(folder: Path) -> list[Path]:
    """Images directly in ``folder``, in natural order."""
    if not folder.is_dir():
        return []
    return sorted((path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES), key=natural)


def first_folder(*folders: Path) -> Path | None:
    """The first of ``folders`` with images in it."""
    return next((folder for folder in folders if image_files(folder)), None)


class ImageFinder:
    """Finds images by the names in label files, in and below the folders ``roots``."""

    def __init__(self, *roots: Path) -> None:
        self.roots = roots
        self._index: dict[str, dict[Path, int]] | None = None  # images by name, with the numbers of their roots

    def find(self, name: str) -> Path | None:
        """The image called ``name``, which may have no suffix, folders before it, or Windows separators.

        Raises TruthError if several images fit equally well.
        """
        given = name.replace("\\", "/")
        parts = [part for part in given.split("/") if part not in ("", ".", "..") and ":" not in part]
        if not parts or "\0" in name:
            return None
        for root in self.roots:
            path = root.joinpath(*parts)
            if path.suffix.lower() in IMAGE_SUFFIXES and _is_file(path):
                return path
        if self._index is None:
            self._index = {}
            for number, root in enumerate(self.roots):
                for path in images_below(root):
                    for key in {path.name, path.stem}:
                        self._index.setdefault(_composed(key), {}).setdefault(path, number)
        last = _composed(parts[-1])
        found = self._index.get(last) or self._index.get(Path(last).stem) or {}
        # Of equal names, the one in the same folders, then the one in the first root.
        ranks = {path: (-_shared_end(path, parts), root) for path, root in found.items()}
        best = [path for path, rank in ranks.items() if rank == min(ranks.values())]
        if len(best) > 1:
            what = f"image {name} may be {best[0]} or {best[1]}"
            raise fault(what, best[0].parent, "write the folder into its name, or name one folder with --images")
        return best[0] if best else None


def _composed(name: str) -> str:
    """A name with composed letters: file systems of macOS store others."""
    return unicodedata.normalize("NFC", name)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False


def images_below(folder: Path, depth: int = DEEP) -> Iterator[Path]:
    """Images in ``folder`` and its visible folders, down to ``depth``, in natural order."""
    if not folder.is_dir():
        return
    for path in sorted(folder.iterdir(), key=natural):
        if path.suffix.lower() in IMAGE_SUFFIXES:
            yield path
        elif depth and path.is_dir() and not path.name.startswith("."):
            yield from images_below(path, depth - 1)


def _shared_end(path: Path, parts: Sequence[str]) -> int:
    """Number of equal folders before the names of two files."""
    pairs = zip(reversed(path.parts[:-1]), reversed(parts[:-1]), strict=False)
    return len(list(itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)))


def missing_images(missing: Sequence[str], total: int, where: Path, labels: Labels) -> None:
    """Note missing images. Raises ImageError if all are missing."""
    if missing and len(missing) == total:
        raise ImageError(
            f"none of its {total} images is there; the first: {missing[0]}",
            where=str(where),
            remedy="give the folder of the images with --images",
        )
    if missing:
        labels.notes.append(f"{len(missing)} of {total} images are missing, the first: {missing[0]}")


def unlabelled_images(files: Sequence[Path], what: str, labels: Labels) -> None:
    """Note images beside the labelled ones ``files`` that have no label file ``what``."""
    place = files[0].parent if files else None
    count = len(set(image_files(place)) - set(files)) if place is not None else 0
    if place is not None and count:
        labels.notes.append(f"{count} images in {place.name} have no {what} and are not used")


def single_images(paths: Sequence[Path]) -> tuple[FolderImages, tuple[int, ...]]:
    """Independent images, and their stamps."""
    return FolderImages("", tuple(map(str, paths))), tuple(number * IMAGE_NS for number in range(len(paths)))


def labelled_images(labels: Labels, format: str, folder: Path) -> LabelledSource:
    """Return a source of the independent images in ``folder``.

    Args:
        labels: Labels, whose keys are names of files in ``folder``.
        format: Name of the format.
        folder: Folder of the images.

    Raises:
        ImageError: None of the labelled images is there.
        TruthError: The labels have no class of people.
    """
    files = {path.name: path for path in image_files(folder)}
    labelled = {str(key) for key in (*labels.persons, *labels.regions)}
    missing_images(sorted(labelled - files.keys()), len(labelled), folder, labels)
    found = [(name, name, file, None) for name, file in files.items()]
    return labels.single_source(folder.resolve().name, format, found)


def recording(
    paths: Sequence[Path], frames: Sequence[int], rate_hz: float
) -> tuple[FolderImages, list[tuple[int, str, int]]]:
    """Consecutive images in the order of their ``frames``; and the frame, name and stamp (ns) of each."""
    ordered = sorted(zip(frames, paths, strict=True), key=lambda each: each[0])
    listed = [(frame, path.name, round((frame - ordered[0][0]) * SECOND / rate_hz)) for frame, path in ordered]
    stamps = tuple(stamp for _, _, stamp in listed)
    return FolderImages("", tuple(str(path) for _, path in ordered), stamps, consecutive=True), listed


def video(path: Path, rate_hz: float | None = None) -> VideoImages:
    """Open a video, with the given rate or its own time stamps.

    Raises:
        ImageError: It cannot be read.
    """
    capture = open_video(path)
    try:
        # The number of images in a header is often a guess.
        stamps = tuple(video_stamps(capture))
    finally:
        capture.release()
    if rate_hz is not None:
        stamps = tuple(round(number * SECOND / rate_hz) for number in range(len(stamps)))
    return VideoImages(str(path), stamps)


def number_in(name: str) -> int | None:
    """The last number in the name of a file."""
    found = re.findall(r"\d+", Path(name).stem)
    return int(found[-1]) if found and len(found[-1]) < 16 else None


def frames_of(paths: Sequence[Path], labels: Labels, first: int, step: int = 1) -> list[int]:
    """Frames of the images of a recording: the numbers in their names.

    They begin with ``first`` instead if the names begin with 0 or 1 and more labelled frames have an image then, or if
    no labelled frame has the number of an image. Images whose names do not number them are taken in order.

    Args:
        paths: Images in natural order.
        labels: Labels, whose keys are frames; notes are added to it.
        first: First frame of the recording.
        step: Difference of consecutive frames.
    """
    known = {int(key) for key in (*labels.persons, *labels.regions)}
    written = [number for path in paths if (number := number_in(path.name)) is not None]
    frames = list(range(first, first + step * len(paths), step))
    if len(set(written)) == len(paths) > 0:
        moved = [number - min(written) + first for number in written]
        given = len(known.intersection(written))
        if not given and known:
            frames = max(moved, frames, key=lambda numbers: len(known.intersection(numbers)))
        else:
            fits = min(written) in (0, 1) and len(known.intersection(moved)) > given
            frames = moved if fits else written
        if frames != written:
            labels.notes.append(f"image {paths[0].name} is taken for frame {frames[0]}")
    return frames
