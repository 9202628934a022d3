"""Detections as files of other tools: COCO results and MOTChallenge tracks."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec

from socialbot.core.errors import ParameterError
from socialbot.core.paths import replace_file, writing
from socialbot.vision.metrics.evaluation import ClipResult, DetectorResult, Evaluation
from socialbot.vision.metrics.matches import ranked

EXPORTS = ("coco", "mot")
"""Names of the formats."""


def export(evaluation: Evaluation, name: str, path: Path) -> list[Path]:
    """Write the detections of all detectors.

    Args:
        evaluation: What was found.
        name: One of `EXPORTS`.
        path: The JSON file of "coco", or the folder of "mot", with a file for each recording. With several detectors,
            the name of each is added: to the file name, or as a folder.

    Returns:
        The files written.

    Raises:
        ParameterError: A file cannot be written.
    """
    several = len(evaluation.detectors) > 1
    files: dict[Path, bytes] = {}
    for detector, result in evaluation.detectors.items():
        if name == "coco":
            place = path.with_name(f"{path.stem}-{detector}{path.suffix}") if several else path
            files[place] = msgspec.json.encode(coco_results(result)) + b"\n"
            continue
        for clip in (clip for scene in result.scenes.values() for clip in scene.clips):
            if clip.source.images.consecutive:
                place = _free(path / detector if several else path, clip.source.name, files)
                files[place] = "".join(f"{line}\n" for line in mot_lines(clip)).encode()
    if not files:
        raise ParameterError(
            "there are no recordings, only single images", where="--export mot", remedy="use coco=FILE"
        )
    for place, data in files.items():
        with writing(place, ParameterError, remedy="choose another place"):
            place.parent.mkdir(parents=True, exist_ok=True)
            replace_file(place, data)
    return list(files)


def _free(folder: Path, name: str, taken: Collection[Path]) -> Path:
    """File for the recording ``name``: different names may have the same letters, so a number follows."""
    plain = re.sub(r"[^\w.-]+", "-", name)
    places = itertools.chain([folder / f"{plain}.txt"], (folder / f"{plain}-{n}.txt" for n in itertools.count(2)))
    return next(place for place in places if place not in taken)


def coco_results(result: DetectorResult) -> list[dict[str, Any]]:
    """All boxes of a detector as COCO results: ``image_id``, ``category_id``, ``bbox`` (x, y, w, h) and ``score``.

    The ids are those of a COCO data set; otherwise images are numbered from 1 in their order. ``file_name`` names the
    image.
    """
    entries = []
    number = 0
    for scene in result.scenes.values():
        for clip in scene.clips:
            found = {each.frame.stamp: each.found for each in clip.frames}
            for frame in clip.source.frames:
                number += 1
                given = frame.number if clip.source.format == "coco" else None
                entries += [
                    {
                        "image_id": number if given is None else given,
                        "category_id": clip.source.category,
                        "bbox": [person.x, person.y, person.w, person.h],
                        "score": person.score,
                        "file_name": frame.name,
                    }
                    for person in ranked(found[frame.stamp].raw if frame.stamp in found else ())
                ]
    return entries


def mot_lines(clip: ClipResult) -> Iterator[str]:
    """Tracks of a recording in the ten columns of the MOTChallenge; frames and ids are numbered from 1.

    Without tracking, all ids are -1. Tentative detections are left out.
    """
    ids: dict[str, int] = {}
    found = {each.frame.stamp: each.found for each in clip.frames}
    for position, frame in enumerate(clip.source.frames, 1):
        number = frame.number if clip.source.format != "coco" and isinstance(frame.number, int) else position
        for person in found[frame.stamp].persons if frame.stamp in found else ():
            if person.tentative:
                continue
            id = ids.setdefault(person.track_id, len(ids) + 1) if person.track_id else -1
            box = ",".join(f"{value:.3f}" for value in (person.x, person.y, person.w, person.h))
            yield f"{number},{id},{box},{person.score:.6f},-1,-1,-1"
