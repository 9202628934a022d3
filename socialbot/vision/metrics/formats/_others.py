"""Name the formats of labels that are not read, for error messages."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterator
from pathlib import Path

from socialbot.core.reading import open_file
from socialbot.vision.metrics.formats._xml import read_xml
from socialbot.vision.metrics.truth import parse_json, read_json

_DEPTH, _MOST_FILES = 3, 100  # Levels of folders that are searched, and files that are read.
_BEGIN = 2000  # Bytes of a text file that tell its format.

_JSON: tuple[tuple[str, frozenset[str]], ...] = (
    ("LabelMe", frozenset({"shapes", "imagePath"})),
    ("VIA", frozenset({"_via_img_metadata"})),
    ("VIA", frozenset({"filename", "regions"})),
    ("VIA", frozenset({"project", "file", "metadata"})),
    ("Label Studio", frozenset({"annotations", "data"})),
    ("Label Studio", frozenset({"image", "label"})),
    ("Datumaro", frozenset({"categories", "items"})),
    ("Supervisely", frozenset({"objects", "size"})),
    ("CreateML", frozenset({"image", "annotations"})),
    ("VoTT", frozenset({"asset", "regions"})),
    ("VoTT", frozenset({"tags", "assets"})),
    ("BDD100K", frozenset({"name", "labels"})),
    ("JRDB", frozenset({"label_id", "box"})),
    ("EuroCity Persons", frozenset({"children", "imagewidth"})),
    ("CityPersons", frozenset({"objects", "imgHeight"})),
)
"""Fields of an object in JSON."""

_NAMES = (
    ("CrowdHuman", re.compile(r"\.odgt$")),
    ("Caltech Pedestrians", re.compile(r"\.vbb$")),
    ("TensorFlow", re.compile(r"\.(tfrecord|record)$")),
    ("WIDER FACE", re.compile(r"^wider_face.*\.txt$")),
    ("WiderPerson", re.compile(r"\.(jpg|png)\.txt$")),
    ("a detector (det.txt)", re.compile(r"^det\.txt$")),
)
_BEGINS = (
    ("Label Studio", re.compile(r"annotation_id,annotator,")),
    ("Open Images", re.compile(r"ImageID,Source,LabelName,")),
    ("VIA", re.compile(r"filename,file_size,file_attributes,|# Exported using VGG Image Annotator")),
    ("VoTT", re.compile(r'"image","xmin","ymin","xmax","ymax","label"')),
    ("TensorFlow", re.compile(r"filename,width,height,class,")),
    ("VisDrone", re.compile(r"(-?\d+,){7}(-?\d+,-?\d+,)?-?\d+,?\s")),
)
"""Begins of text files."""


def format_of_json(content: object) -> str:
    """Format of the content of a JSON file that is not read; empty if it is not known."""
    for _ in range(_DEPTH + 1):
        if isinstance(content, dict):
            if "boxes" in content:
                return ""
            for name, fields in _JSON:
                if fields <= content.keys():
                    return name
        within = content if isinstance(content, list) else content.values() if isinstance(content, dict) else ()
        content = next((each for each in within if isinstance(each, dict | list)), None)
    return ""


def unread_format(path: Path) -> str:
    """Format of the labels in ``path``; empty if it is not known. Raises TruthError for a damaged file."""
    files = [path] if path.is_file() else itertools.islice(_files(path), _MOST_FILES)
    return next((name for file in files if (name := _format_of(file))), "")


def _format_of(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix == ".xml":
        read_xml(file)
    elif suffix == ".json":
        return format_of_json(parse_json(read_json(file), object, where=str(file), remedy="export it again"))
    for name, pattern in _NAMES:
        if pattern.search(file.name.lower()):
            return name
    if suffix in (".csv", ".txt"):
        with open_file(file) as stream:
            begin = stream.read(_BEGIN).decode("utf-8", "replace").lstrip("\ufeff")
        return next((name for name, pattern in _BEGINS if pattern.match(begin)), "")
    return ""


def _files(folder: Path) -> Iterator[Path]:
    """Files that may have labels, those in the upper folders first."""
    for root, folders, names in os.walk(folder):
        folders.sort()
        if len(Path(root).relative_to(folder).parts) >= _DEPTH:
            folders.clear()
        kinds = (".json", ".xml", ".csv", ".txt", ".odgt", ".vbb", ".tfrecord", ".record")
        yield from (Path(root, name) for name in sorted(names) if name.lower().endswith(kinds))
