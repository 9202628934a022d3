"""MOTChallenge: gt/gt.txt beside seqinfo.ini and the images or video of a sequence.

Columns: frame (from 1, or from 0 if one has that number), id, x, y, width, height, confidence (0: not scored), then
class and visible share (MOT16 and later) or three coordinates (MOT15).
"""

from __future__ import annotations

import configparser
from collections.abc import Sequence
from pathlib import Path

from socialbot.bags.image_files import DEFAULT_RATE_HZ
from socialbot.bags.reader import natural
from socialbot.core.errors import ImageError
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    VIDEO_SUFFIXES,
    Entry,
    Labels,
    fault,
    first_folder,
    first_line,
    frames_of,
    image_files,
    lines_of,
    numbers,
    read_text,
    recording,
    refuse_score,
    video,
)
from socialbot.vision.metrics.frames import ImageSequence, LabelledSource

CLASSES = (
    "pedestrian", "person on vehicle", "car", "bicycle", "motorbike", "non-motorised vehicle", "static person",
    "distractor", "occluder", "occluder on the ground", "full occluder", "reflection", "crowd",
)  # fmt: skip
"""Names of the classes 1 to 13."""

VISDRONE = 11, 1, 2
"""Largest class, truncation and occlusion in the last columns of VisDrone."""

REMEDY = "write frame, id, x, y, width, height, confidence, class, visibility, separated by commas"
MAX_FRAME = 10_000_000
MAX_NAME = 200


def is_sequence(folder: Path) -> bool:
    """Whether ``folder`` is a MOTChallenge sequence."""
    return (folder / "seqinfo.ini").is_file() or _is_labelled(folder)


def _is_labelled(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("gt/gt.txt", "gt.txt"))


def sequences(folder: Path) -> list[Path]:
    """Sequences in or below ``folder``; those with labels if there are any."""
    found = _all_sequences(folder)
    return [path for path in found if _is_labelled(path)] or found


def unlabelled_note(folder: Path) -> str:
    """Note about the sequences that `sequences` leaves out; empty if there are none."""
    used = sequences(folder)
    left = [path.name for path in _all_sequences(folder) if path not in used]
    return f"{len(left)} sequences have no labels, the first: {left[0]}" if left else ""


def _all_sequences(folder: Path) -> list[Path]:
    if is_sequence(folder):
        return [folder]
    below = [path for pattern in ("*", "*/*") for path in folder.glob(pattern) if path.is_dir() and is_sequence(path)]
    # The folder gt of a sequence looks like a sequence, too.
    return sorted((path for path in below if path.parent not in below), key=natural)


def read_mot(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read a MOTChallenge sequence: its folder, or its file gt.txt. See `LabelReader`."""
    given = path.parent.parent if path.parent.name == "gt" else path.parent
    folder = path if path.is_dir() else given
    truth = next(
        (each for each in (folder / "gt" / "gt.txt", folder / "gt.txt") if each.is_file()), folder / "gt/gt.txt"
    )
    truth = truth if path.is_dir() else path
    if not truth.is_file():
        raise fault("no gt/gt.txt: this sequence has no labels", folder, "use a training sequence")
    info = _info(folder / "seqinfo.ini")
    labels = Labels(truth, people)
    identities = _read_lines(labels, _class_names(truth.parent / "labels.txt"))
    if labels.persons and not identities:
        labels.notes.append("people have no ids, as in det.txt, which holds detections and no labels")
    rate = _rate(info, folder, labels)
    found, entries = _images(folder, images, info, rate, labels)
    there = {entry.key for entry in entries}
    lost = {key for key in (*labels.persons, *labels.regions) if key not in there}
    if lost:
        labels.notes.append(f"{len(lost)} labelled frames have no image; the last is frame {max(map(int, lost))}")
    name = info.get("name") or folder.resolve().name
    return [labels.source(name, "mot", found, entries, identities=identities)]


def _read_lines(labels: Labels, names: Sequence[str]) -> bool:
    """Add all boxes; returns whether people have ids."""
    identities, widest, rows = False, 0.0, list[list[float]]()
    for where, line in lines_of(labels.path):
        words = [word.strip() for word in line.split(",")] if "," in line else line.split()
        if not 6 <= len(words) <= 10:
            raise fault(f"{len(words)} columns", where, REMEDY)
        values = numbers(words, where, REMEDY)
        if len(values) == 10 and values[9] == -1 != values[7]:
            values.pop()  # A place is either known, or -1, -1, -1: this is class and visible share.
        frame, id, x, y, w, h = values[:6]
        widest = max(widest, w)
        rows.append(values[7:] if len(values) == 10 else [])
        if frame != int(frame) or id != int(id) or not 0 <= frame <= MAX_FRAME:
            raise fault(f"frame {words[0][:20]} and id {words[1][:20]} must be whole numbers", where, REMEDY)
        confidence = values[6] if len(words) > 6 else 1.0
        refuse_score(confidence, where)
        # Ten columns are those of MOT15: a place instead of class and visibility.
        number = int(values[7]) if len(values) in (8, 9) else 1
        visible = values[8] if len(values) == 9 else 1.0
        name = names[number - 1] if 0 < number <= len(names) else f"{number}"
        labels.add(
            int(frame),
            "pedestrian" if number < 1 else name,
            (x, y, w, h),
            where,
            id=f"{int(id)}" if id >= 0 else "",
            ignore=confidence == 0,
            visible=visible if visible >= 0 else 1.0,
        )
        identities |= id >= 0
    if rows and widest <= 1:
        raise fault(
            "no box is wider than one pixel: the columns are others, or shares of the image", labels.path, REMEDY
        )
    if all(_is_visdrone(row) for row in rows) and any(row[0] for row in rows):
        raise fault("the last columns are class, truncation and occlusion, as in VisDrone", labels.path, REMEDY)
    return identities


def _is_visdrone(row: Sequence[float]) -> bool:
    """Whether the last three of ten columns are class, truncation and occlusion, not the place of MOT15."""
    return len(row) == 3 and all(value in range(most + 1) for value, most in zip(row, VISDRONE, strict=True))


def _info(path: Path) -> dict[str, str]:
    """Fields of seqinfo.ini in lower case; empty without the file."""
    if not path.is_file():
        return {}
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(path))
    except configparser.Error as error:
        what = " ".join(str(error).split())
        raise fault(f"cannot be read: {what}", path, "write a section [Sequence] with NAME=VALUE lines") from error
    section = "Sequence" if parser.has_section("Sequence") else next(iter(parser.sections()), "")
    return dict(parser[section]) if section else {}


def _class_names(path: Path) -> Sequence[str]:
    """Names of the classes from 1, from labels.txt as CVAT and Datumaro write it, or those of MOT16 to MOT20."""
    return [line.strip() for line in read_text(path).splitlines()] if path.is_file() else CLASSES


def _rate(info: dict[str, str], folder: Path, labels: Labels) -> float | None:
    text = info.get("framerate")
    if text is None:
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate <= 1000:
        raise fault(f"frameRate is {text!r}", folder / "seqinfo.ini", "write images a second, such as 30")
    return rate


def _images(
    folder: Path, images: Path | None, info: dict[str, str], rate: float | None, labels: Labels
) -> tuple[ImageSequence, list[Entry]]:
    named = info.get("imdir", "img1")
    if len(named) > MAX_NAME or "\0" in named:
        raise fault("imDir is no folder name", folder / "seqinfo.ini", "write imDir=img1")
    places = [images] if images else [folder / named, folder / "img1", folder / "images", folder / "img", folder]
    place = first_folder(*places)
    videos = sorted(
        path
        for each in places
        for path in ([each] if each.is_file() else each.glob("*") if each.is_dir() else ())
        if path.suffix.lower() in VIDEO_SUFFIXES
    )
    if place is None and not videos:
        raise ImageError("no images and no video", where=str(images or folder), remedy="name them with --images")
    known = {int(key) for key in (*labels.persons, *labels.regions)}
    first = min(known | {1})
    if place is None:
        if len(videos) > 1:
            raise fault(f"{len(videos)} videos: {videos[0].name}, ...", folder, "name the one to use with --images")
        film = video(videos[0], rate)
        return film, [Entry(frame, f"frame {frame}", stamp, frame) for frame, stamp in enumerate(film.stamps, first)]
    if rate is None:
        labels.notes.append(f"no frame rate in seqinfo.ini: {DEFAULT_RATE_HZ:g} images a second are assumed")
    paths = image_files(place)
    frames = frames_of(paths, labels, first)
    if 0 in frames and first == 1:
        labels.notes.append("image 0 has no label: the numbers of the images are taken for frames")
    pictures, numbered = recording(paths, frames, rate or DEFAULT_RATE_HZ)
    length = info.get("seqlength", "").strip()[:20]
    if length and length != str(len(paths)):
        labels.notes.append(f"{len(paths)} images, but seqinfo.ini says {length}")
    return pictures, [Entry(frame, name, stamp, frame) for frame, name, stamp in numbered]


def _is_mot(path: Path) -> bool:
    """Whether a text file has six or more columns with commas."""
    words = first_line(path)
    return "," in words and len(words.replace(",", " ").split()) >= 6


MOT = LabelFormat("mot", "gt/gt.txt", read_mot, sequences, _is_mot, unlabelled_note)
