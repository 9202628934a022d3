"""Label files of each format, with the same person in the first image."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from socialbot.vision.metrics.formats import labelled_sources
from socialbot.vision.metrics.frames import LabelledSource

WIDTH, HEIGHT = 160, 120
BOX = (40.0, 20.0, 30.0, 80.0)
"""x, y, w and h of the person that every example shows in its first image."""

Files = dict[str, str]


def write(folder: Path, files: Files, images: tuple[str, ...] = ("a.jpg", "b.jpg")) -> Path:
    """Write text files, and grey images."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for name in images:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    return folder


def coco(**changes) -> str:
    content = {
        "images": [
            {"id": 7, "file_name": "a.jpg", "width": WIDTH, "height": HEIGHT},
            {"id": 9, "file_name": "b.jpg", "width": WIDTH, "height": HEIGHT},
        ],
        "annotations": [
            {"id": 1, "image_id": 7, "category_id": 3, "bbox": list(BOX), "area": 1700.5, "iscrowd": 0},
            {"id": 2, "image_id": 7, "category_id": 3, "bbox": [0, 0, 20, 20], "area": 300, "iscrowd": 1},
            {"id": 3, "image_id": 9, "category_id": 5, "bbox": [1, 2, 3, 4], "area": 12, "iscrowd": 0},
        ],
        "categories": [{"id": 3, "name": "person"}, {"id": 5, "name": "car"}],
    }
    return json.dumps(content | changes)


SEQINFO = """[Sequence]
name=Hall-01
imDir=img1
frameRate=25
seqLength=2
imWidth=160
imHeight=120
imExt=.jpg
"""
MOT = """1,1,40,20,30,80,1,1,0.75
2,1,42,20,30,80,1,1,1.0
2,2,90,20,30,80,0,1,1.0
2,3,5,5,30,80,0,7,1.0
2,4,5,5,50,20,0,3,1.0
2,5,0,90,60,30,0,13,1.0
"""
KITTI = """Pedestrian 0.00 0 -0.20 40.00 20.00 70.00 100.00 1.89 0.48 1.20 3.00 1.47 4.00 0.01
Person_sitting 0.80 0 0.1 90.00 20.00 110.00 60.00 1.2 0.5 0.8 1.0 1.5 9.0 0.0
Cyclist 0.00 1 0.1 120.00 20.00 150.00 100.00 1.7 0.6 1.8 1.0 1.5 20.0 0.0
Car 0.00 1 0.1 120.00 20.00 150.00 100.00 1.7 0.6 1.8 1.0 1.5 20.0 0.0
DontCare -1 -1 -10 0.00 0.00 20.00 20.00 -1 -1 -1 -1000 -1000 -1000 -10
"""
TRACKING = "".join(f"{frame} 4 Pedestrian 0 0 {KITTI.splitlines()[0][18:]}\n" for frame in (0, 2)) + (
    "0 -1 DontCare -1 -1 -10 0 0 20 20 -1 -1 -1 -1000 -1000 -1000 -10\n"
)
YOLO = "0 0.34375 0.5 0.1875 0.66666667\n2 0.5 0.5 0.1 0.1\n"
YAML = "path: .\ntrain: images/train\nval: images/val\nnames:\n  0: person\n  2: dog\n"


def voc(*objects: str, name: str = "a.jpg") -> str:
    size = f"<size><width>{WIDTH}</width><height>{HEIGHT}</height><depth>3</depth></size>"
    return f"<annotation>\n<filename>{name}</filename>\n{size}\n" + "\n".join(objects) + "\n</annotation>"


def thing(name: str, sides: tuple[object, ...] = (40, 20, 70, 100), more: str = "") -> str:
    box = "".join(
        f"<{side}>{value}</{side}>" for side, value in zip(("xmin", "ymin", "xmax", "ymax"), sides, strict=True)
    )
    return f"<object><name>{name}</name>{more}<bndbox>{box}</bndbox></object>"


VOC = voc(
    thing("person", more="<truncated>1</truncated>"), thing("person", more="<difficult>1</difficult>"), thing("cat")
)
LABELS = "<labels><label><name>person</name></label><label><name>car</name></label></labels>"
CVAT_IMAGES = f"""<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta><task><name>hall</name>{LABELS}</task></meta>
  <image id="0" name="a.jpg" width="160" height="120">
    <box label="person" occluded="1" xtl="40.00" ytl="20.00" xbr="70.00" ybr="100.00" z_order="0"></box>
    <polygon label="person" occluded="0" points="90.00,20.00;110.00,20.00;100.00,60.00" z_order="0"></polygon>
    <box label="car" occluded="0" xtl="1" ytl="2" xbr="3" ybr="4" z_order="0"></box>
    <points label="person" occluded="0" points="90.00,20.00" z_order="0"></points>
  </image>
  <image id="1" name="b.jpg" width="160" height="120"></image>
</annotations>
"""
CVAT_VIDEO = f"""<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta><task><name>hall</name><mode>interpolation</mode>{LABELS}
    <original_size><width>160</width><height>120</height></original_size></task></meta>
  <track id="3" label="person" source="manual">
    <box frame="0" outside="0" occluded="0" keyframe="1" xtl="40" ytl="20" xbr="70" ybr="100" z_order="0"></box>
    <box frame="2" outside="0" occluded="1" keyframe="1" xtl="50" ytl="20" xbr="80" ybr="100" z_order="0"></box>
    <box frame="3" outside="1" occluded="0" keyframe="1" xtl="50" ytl="20" xbr="80" ybr="100" z_order="0"></box>
  </track>
</annotations>
"""
FOUR = tuple(f"images/frame_{number:06}.png" for number in range(4))

EXAMPLES: dict[str, tuple[str, Files, tuple[str, ...]]] = {
    "coco": ("coco", {"annotations/instances_val.json": coco()}, ("val/a.jpg", "val/b.jpg")),
    "coco beside its images": ("coco", {"_annotations.coco.json": coco()}, ("a.jpg", "b.jpg")),
    "coco of Roboflow": ("coco", {"train/_annotations.coco.json": coco()}, ("train/a.jpg", "train/b.jpg")),
    "mot": ("mot", {"seqinfo.ini": SEQINFO, "gt/gt.txt": MOT}, ("img1/000001.jpg", "img1/000002.jpg")),
    "mot, only gt.txt": ("mot", {"gt.txt": MOT}, ("frame9.jpg", "frame10.jpg")),
    "kitti": ("kitti", {"training/label_2/000004.txt": KITTI}, ("training/image_2/000004.png",)),
    "kitti of TAO": ("kitti", {"labels/000004.txt": KITTI}, ("images/000004.png",)),
    "kitti tracking": (
        "kitti", {"label_02/0001.txt": TRACKING}, tuple(f"image_02/0001/{number:06}.png" for number in range(3))
    ),
    "yolo": ("yolo", {"data.yaml": YAML, "labels/train/a.txt": YOLO}, ("images/train/a.jpg", "images/val/b.jpg")),
    "yolo, classes.txt": (
        "yolo", {"classes.txt": "person\ncar\ndog\n", "labels/a.txt": YOLO}, ("images/a.jpg", "images/b.jpg")
    ),
    "yolo of Roboflow": (
        "yolo", {"data.yaml": "train: ../train/images\nnames: [person, car, dog]\n", "train/labels/a.txt": YOLO},
        ("train/images/a.jpg",),
    ),
    "yolo, one folder": ("yolo", {"a.txt": YOLO, "classes.txt": "person\ncar\ndog\n"}, ("a.jpg", "b.jpg")),
    "voc": ("voc", {"Annotations/a.xml": VOC}, ("JPEGImages/a.jpg", "JPEGImages/b.jpg")),
    "voc, one folder": ("voc", {"a.xml": VOC}, ("a.jpg",)),
    "voc of Roboflow": ("voc", {"train/a.xml": VOC}, ("train/a.jpg",)),
    "voc of Oxford": ("voc", {"annotations/xmls/a.xml": VOC}, ("images/a.jpg",)),
    "cvat images": ("cvat", {"annotations.xml": CVAT_IMAGES}, ("images/a.jpg", "images/b.jpg")),
    "cvat video": ("cvat", {"annotations.xml": CVAT_VIDEO}, FOUR),
}  # fmt: skip


def one(folder: Path, *args, **about) -> LabelledSource:
    [source] = [
        each for each in labelled_sources(folder, *args, **about) if any(frame.persons for frame in each.frames)
    ]
    return source
