"""Pascal VOC: an XML file for each image, in Annotations beside JPEGImages, or beside the image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from socialbot.bags.reader import natural
from socialbot.vision.metrics.formats._format import LabelFormat
from socialbot.vision.metrics.formats._labels import (
    ImageFinder,
    Labels,
    fault,
    folders_in,
    labelled_size,
    missing_images,
    numbers,
    role_of,
    unlabelled_images,
)
from socialbot.vision.metrics.formats._xml import at, read_xml, root_tag
from socialbot.vision.metrics.frames import LabelledSource

REMEDY = "write name and bndbox with xmin, ymin, xmax and ymax, pixels"


def voc_folders(folder: Path) -> list[Path]:
    """The folder of the XML files in or below ``folder``, or its parts with such files."""
    below = [folder / name for name in ("Annotations", "annotations", "annotations/xmls")]
    places = [each for each in (folder, *below, *sorted(folder.glob("**/Annotations"))[:1]) if each.is_dir()]
    whole = next((each for each in places if _has_voc(each)), None)
    parts = ([part for part in folders_in(each) if _has_voc(part)] for each in places)
    return [whole] if whole is not None else next(filter(None, parts), [])


def _has_voc(folder: Path) -> bool:
    return any(root_tag(path) == "annotation" for path in sorted(folder.glob("*.xml"))[:5])


def read_voc(path: Path, images: Path | None = None, people: Sequence[str] = ()) -> list[LabelledSource]:
    """Read a folder of Pascal VOC labels, or one XML file. See `LabelReader`."""
    files = [path] if path.is_file() else sorted(path.glob("*.xml"), key=natural)
    folder = path.parent if path.is_file() else path
    above = (each.parent for each in (folder, folder.parent) if each.name.lower() == "annotations")
    base = next(above, folder.parent if folder.name.lower() == "xmls" else folder)
    roots = [images] if images else [base / "JPEGImages", base / "images", folder, base]
    finder = ImageFinder(*roots)
    labels = Labels(path, people)
    found: dict[str, tuple[Path, tuple[int, int] | None]] = {}
    missing = []
    for file in files:
        root = read_xml(file)
        if root.tag != "annotation":
            raise fault(f"the root is <{root.tag}>, not <annotation>", file, "give Pascal VOC files only")
        name = (root.findtext("filename") or "").strip()
        image = finder.find(f"{folder.name}/{file.stem}") or (finder.find(name) if name else None)
        if image is None:
            missing.append(name or file.stem)
            continue
        found[file.stem] = image, labelled_size(root.findtext("size/width"), root.findtext("size/height"))
        for number, thing in enumerate(root.findall("object")):
            _add(labels, file, thing, number)
    missing_images(missing, len(files), roots[0], labels)
    if path.is_dir():
        unlabelled_images([image for image, _ in found.values()], "XML file", labels)
    part = f"/{folder.name}" if folder.parent.name.lower() == "annotations" and folder.name != "xmls" else ""
    listed = [(key, image.name, image, size) for key, (image, size) in found.items()]
    return [labels.single_source(base.resolve().name + part, "voc", listed)]


def _add(labels: Labels, file: Path, thing: ElementTree.Element, number: int) -> None:
    where = f"{at(file, thing)} (object {number + 1})"
    name, box = (thing.findtext("name") or "").strip(), thing.find("bndbox")
    if box is None and any(thing.find(tag) is not None for tag in ("polygon", "segm")):
        raise fault("outlines of LabelMe, no bndbox", where, "export the labels as Pascal VOC or COCO")
    if name and box is None and role_of(name, labels.people) == "other":
        labels.skipped[f"of class {name}"] += 1
        return
    if not name or box is None:
        raise fault(f"the object has no {'name' if not name else 'bndbox'}", where, REMEDY)
    words = [(box.findtext(side) or "").strip() for side in ("xmin", "ymin", "xmax", "ymax")]
    left, top, right, bottom = numbers(words, where, REMEDY)
    ignore = (thing.findtext("difficult") or "0").strip().lower() in ("1", "true", "yes")
    labels.add(file.stem, name, (left, top, right - left, bottom - top), where, ignore=ignore)


VOC = LabelFormat(
    "voc",
    "Annotations/NAME.xml",
    read_voc,
    voc_folders,
    lambda path: path.suffix.lower() == ".xml" and root_tag(path) == "annotation",
)
