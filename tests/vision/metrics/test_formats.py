from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError, ParameterError, TruthError
from socialbot.vision.metrics.formats import FORMATS, labelled_sources, sniff
from socialbot.vision.metrics.formats._labels import image_size, role_of
from socialbot.vision.metrics.frames import FolderImages, LabelledSource, VideoImages

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
    "mot": ("mot", {"seqinfo.ini": SEQINFO, "gt/gt.txt": MOT}, ("img1/000001.jpg", "img1/000002.jpg")),
    "mot, only gt.txt": ("mot", {"gt.txt": MOT}, ("frame9.jpg", "frame10.jpg")),
    "kitti": ("kitti", {"training/label_2/000004.txt": KITTI}, ("training/image_2/000004.png",)),
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
    "cvat images": ("cvat", {"annotations.xml": CVAT_IMAGES}, ("images/a.jpg", "images/b.jpg")),
    "cvat video": ("cvat", {"annotations.xml": CVAT_VIDEO}, FOUR),
}  # fmt: skip


def one(folder: Path, *args, **about) -> LabelledSource:
    [source] = [
        each for each in labelled_sources(folder, *args, **about) if any(frame.persons for frame in each.frames)
    ]
    return source


@pytest.mark.parametrize("name", EXAMPLES)
def test_format_is_recognised_and_read(tmp_path, name):
    format, files, images = EXAMPLES[name]
    write(tmp_path, files, images)
    assert sniff(tmp_path) == format
    source = one(tmp_path)
    assert source.format == format
    person = source.frames[0].persons[0]
    assert person.box == pytest.approx(BOX, abs=0.01)
    assert person.counts
    read = [each.bgr().shape for each in source.images.read()]
    assert set(read) == {(HEIGHT, WIDTH, 3)}
    stamps = {each.stamp for each in source.images.read()}
    assert {frame.stamp for frame in source.frames} <= stamps
    # The same when it is said.
    assert labelled_sources(tmp_path, format=format) == labelled_sources(tmp_path)


@pytest.mark.parametrize("name", EXAMPLES)
def test_labels_and_images_in_different_folders(tmp_path, name):
    format, files, images = EXAMPLES[name]
    if "data.yaml" in files or format == "kitti":
        pytest.skip("these name their images by folders")
    labels = write(tmp_path / "labels here", files, ())
    shown = write(tmp_path / "images there", {}, tuple(Path(image).name for image in images))
    place = next(labels / name for name in files if name != "seqinfo.ini" and name != "classes.txt")
    truth = place if format in ("coco", "mot", "cvat") else place.parent
    source = one(shown, truth, format=format)
    assert source.frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)
    assert isinstance(source.images, FolderImages)
    assert all(Path(image).parent == shown for image in source.images.images)


def test_unknown_format(tmp_path):
    write(tmp_path, {"notes.md": "x"})
    assert sniff(tmp_path) is None
    with pytest.raises(TruthError, match="no labels of a known format") as error:
        labelled_sources(tmp_path)
    assert all(name in str(error.value) for name in FORMATS)
    with pytest.raises(ParameterError, match="unknown format 'cocoa'"):
        labelled_sources(tmp_path, format="cocoa")
    with pytest.raises(TruthError, match="no such file"):
        labelled_sources(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("person", "person"), ("Pedestrian", "person"), ("people", "person"), ("Person_sitting", "person"),
        ("Person (sitting)", "person"), ("Cyclist", "ignored"), ("person_on_vehicle", "ignored"),
        ("DontCare", "region"), ("ignore-regions", "region"), ("crowd", "region"), ("car", "other"), ("", "other"),
    ],
)  # fmt: skip
def test_classes_of_people(name, role):
    assert role_of(name) == role


def test_further_classes_of_people(tmp_path):
    categories = [{"id": 3, "name": "Museum_Visitor"}, {"id": 5, "name": "car"}]
    write(tmp_path, {"coco.json": coco(categories=categories)})
    with pytest.raises(TruthError, match="no class of people among its classes: Museum_Visitor, car") as error:
        labelled_sources(tmp_path)
    assert error.value.remedy == "name it with --people"
    assert one(tmp_path, people=["museum visitor"]).frames[0].persons[0].counts


def test_skipped_classes_are_told(tmp_path):
    write(tmp_path, {"coco.json": coco()})
    assert one(tmp_path).notes == ("1 boxes of class car are not used",)


# COCO


def test_coco_crowds_areas_and_ids(tmp_path):
    write(tmp_path, {"coco.json": coco()})
    source = one(tmp_path)
    first, second = source.frames
    assert [region.box for region in first.ignore] == [(0, 0, 20, 20)]
    assert first.persons[0].area == 1700.5
    assert (first.number, second.number, source.category) == (7, 9, 3)
    assert (first.size, first.ranged) == ((WIDTH, HEIGHT), False)
    assert not source.images.consecutive
    assert second.persons == ()


def test_coco_videos_are_sequences(tmp_path):
    images = [
        {"id": 10 + number, "file_name": f"{number}.jpg", "video_id": 1, "frame_id": 2 - number} for number in range(3)
    ]
    boxes = [{"image_id": 10 + number, "category_id": 3, "bbox": BOX, "instance_id": 5} for number in range(3)]
    files = {"coco.json": coco(images=images, annotations=boxes, videos=[{"id": 1, "name": "hall", "fps": 10}])}
    source = one(write(tmp_path, files, ("0.jpg", "1.jpg", "2.jpg")))
    assert source.name == "coco/hall"
    assert source.images.consecutive
    assert source.identities
    assert [frame.stamp for frame in source.frames] == [0, SECOND // 10, SECOND // 5]
    assert [frame.name for frame in source.frames] == ["2.jpg", "1.jpg", "0.jpg"]


def test_missing_images_are_told_and_none_is_an_error(tmp_path):
    write(tmp_path, {"coco.json": coco()}, ("a.jpg",))
    source = one(tmp_path)
    assert len(source.frames) == 1
    assert "1 of 2 images are missing, the first: b.jpg" in source.notes
    (tmp_path / "a.jpg").unlink()
    with pytest.raises(ImageError, match="none of its 2 images is there"):
        labelled_sources(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"annotations": [{"image_id": 8, "category_id": 3, "bbox": [1, 2, 3, 4]}]}, r"annotations\[0\]: image_id 8"),
        ({"annotations": [{"image_id": 7, "category_id": 1, "bbox": [1, 2, 3, 4]}]}, "category_id 1 is not"),
        ({"annotations": [{"id": 4, "image_id": 7, "category_id": 3}]}, r"annotations\[0\] \(id 4\): no bbox"),
        (
            {"annotations": [{"image_id": 7, "category_id": 3, "bbox": [1, 2, -3, 4]}]},
            "the box 1, 2, -3, 4 .* impossible",
        ),
        ({"annotations": [{"image_id": 7, "category_id": 3, "bbox": "1 2 3 4"}]}, r"annotations\[0\]: Expected `array"),
        ({"images": [{"id": 7, "file_name": "a.jpg"}] * 2}, "two images have the id 7"),
    ],
)
def test_broken_coco(tmp_path, change, message):
    write(tmp_path, {"coco.json": coco(**change)})
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert str(tmp_path / "coco.json") in str(error.value)
    assert error.value.remedy


# MOTChallenge


def test_mot_classes_times_and_ids(tmp_path):
    _, files, images = EXAMPLES["mot"]
    source = one(write(tmp_path, files, images))
    first, second = source.frames
    assert source.name == "Hall-01"
    assert (first.stamp, second.stamp) == (0, SECOND // 25)
    assert first.persons[0].visible == 0.75
    assert [(person.id, person.ignore) for person in second.persons] == [("1", False), ("2", True), ("3", True)]
    assert [region.box for region in second.ignore] == [(0, 90, 60, 30)]
    assert source.images.consecutive
    assert source.identities
    assert source.notes == ("1 boxes of class car are not used",)
    assert source.least_visible == 0


def test_mot15_has_coordinates_instead_of_a_class(tmp_path):
    files = {"gt/gt.txt": "1,1,40,20,30,80,1,-1,-1,-1\n1,2,90,20,30,80,0,4.5,-2.1,0\n", "seqinfo.ini": SEQINFO}
    source = one(write(tmp_path, files, EXAMPLES["mot"][2]))
    assert [(person.ignore, person.visible) for person in source.frames[0].persons] == [(False, 1.0), (True, 1.0)]


def test_mot_without_ids_is_not_scored_for_identity(tmp_path):
    source = one(write(tmp_path, {"gt/gt.txt": "1,-1,40,20,30,80,1\n1,-1,90,20,30,80,1\n"}, EXAMPLES["mot"][2]))
    assert not source.identities
    assert len(source.frames[0].persons) == 2


def test_mot_image_numbers_are_frames_where_they_fit(tmp_path):
    source = one(write(tmp_path, {"gt.txt": "9,1,40,20,30,80,1,1,1\n"}, ("7.jpg", "8.jpg", "9.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [0, 0, 1]
    source = one(write(tmp_path / "other", {"gt.txt": "1,1,40,20,30,80,1,1,1\n"}, ("7.jpg", "8.jpg", "9.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 0]


def test_mot_beside_a_video(tmp_path):
    write(tmp_path, {"gt/gt.txt": MOT}, ())
    film = cv2.VideoWriter(str(tmp_path / "hall.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (WIDTH, HEIGHT))
    for _ in range(3):
        film.write(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    film.release()
    source = one(tmp_path)
    assert isinstance(source.images, VideoImages)
    assert [frame.stamp for frame in source.frames] == [0, SECOND // 10, SECOND // 5]
    assert [each.stamp for each in source.images.read()] == [frame.stamp for frame in source.frames]
    assert [len(frame.persons) for frame in source.frames] == [1, 3, 0]
    # The video may be somewhere else.
    other = write(tmp_path / "other", {"gt.txt": MOT}, ())
    assert one(tmp_path / "hall.avi", other / "gt.txt").frames == source.frames


def test_many_mot_sequences(tmp_path):
    for name in ("MOT-02", "MOT-10"):
        write(tmp_path / "train" / name, {"gt/gt.txt": MOT}, ("img1/000001.jpg", "img1/000002.jpg"))
    assert [source.name for source in labelled_sources(tmp_path)] == ["MOT-02", "MOT-10"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,1,2,3", "line 2: 4 columns"),
        ("1,1,2,x,4,5,1,1,1", "line 2: 'x' in column 4 is not a number"),
        ("1,1,2,nan,4,5,1,1,1", "line 2: 'nan' in column 4"),
        ("1,1,2,3,-4,5,1,1,1", "line 2: the box 2, 3, -4, 5"),
        ("1.5,1,2,3,4,5,1,1,1", "line 2: frame 1.5 and id 1 must be whole numbers"),
        ("1,1,2,3,4,5,1,1,1", "line 2: id 1 has two boxes in one image"),
    ],
)
def test_broken_mot(tmp_path, line, message):
    write(tmp_path, {"gt/gt.txt": f"1,1,40,20,30,80,1,1,1\n{line}\n"}, EXAMPLES["mot"][2])
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert "gt.txt" in str(error.value)
    assert error.value.remedy


def test_broken_seqinfo(tmp_path):
    write(tmp_path, {"gt/gt.txt": MOT, "seqinfo.ini": "[Sequence]\nframeRate=fast\n"}, EXAMPLES["mot"][2])
    with pytest.raises(TruthError, match="frameRate is 'fast'"):
        labelled_sources(tmp_path)
    write(tmp_path, {"seqinfo.ini": "frameRate=3\n"}, ())
    with pytest.raises(TruthError, match=r"seqinfo.ini: cannot be read"):
        labelled_sources(tmp_path)


# KITTI


def test_kitti_distances_and_ignored(tmp_path):
    _, files, images = EXAMPLES["kitti"]
    [frame] = one(write(tmp_path, files, images)).frames
    walking, sitting, cyclist = frame.persons
    assert walking.distance_m == 5  # 3 m to the side, 4 m ahead
    assert not walking.ignore
    assert sitting.ignore  # four fifths are cut off
    assert cyclist.ignore
    assert [region.box for region in frame.ignore] == [(0, 0, 20, 20)]
    assert frame.ranged


def test_kitti_tracking(tmp_path):
    _, files, images = EXAMPLES["kitti tracking"]
    source = one(write(tmp_path, files, images))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 1]
    assert [frame.stamp for frame in source.frames] == [0, SECOND // 10, SECOND // 5]
    assert source.identities
    assert source.frames[0].persons[0].id == "4"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Pedestrian 0 0 0 1 2 3 4", "000004.txt, line 6: 8 columns instead of 15"),
        ("Pedestrian 0 0 0 x 2 3 4 1 1 1 1 1 1 1", "line 6: 'x' in column 4"),
        ("Pedestrian 0 0 0 9 2 3 4 1 1 1 1 1 1 1", "line 6: the box 9, 2, -6, 2"),
    ],
)
def test_broken_kitti(tmp_path, line, message):
    write(tmp_path, {"label_2/000004.txt": KITTI + line + "\n"}, ("image_2/000004.png",))
    with pytest.raises(TruthError, match=message):
        labelled_sources(tmp_path)


# YOLO


def test_yolo_images_without_labels_show_nobody(tmp_path):
    _, files, images = EXAMPLES["yolo, classes.txt"]
    source = one(write(tmp_path, {**files, "labels/c.txt": ""}, (*images, "images/c.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 0]
    assert "1 of 3 images have no label file: they show nobody" in source.notes
    assert "1 boxes of class dog are not used" in source.notes


def test_yolo_without_names(tmp_path):
    source = one(write(tmp_path, {"labels/a.txt": YOLO}, ("images/a.jpg",)))
    assert "no data.yaml and no classes.txt: class 0 is taken for people" in source.notes


def test_yolo_outlines_and_key_points(tmp_path):
    outline = "0 0.25 0.5 0.5 0.5 0.25 0.75 0.5 0.75\n"
    source = one(write(tmp_path / "outline", {"labels/a.txt": outline}, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx((40, 60, 40, 30))
    points = "0 0.34375 0.5 0.1875 0.66666667 0.4 0.5 2 0 0 0\n"
    files = {"data.yaml": "names: [person]\nkpt_shape: [2, 3]\n", "labels/a.txt": points}
    source = one(write(tmp_path / "points", files, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 40 20 30 80", "line 1: 80 is not a share of the image"),
        ("0 0.5 0.5", "line 1: 3 columns"),
        ("person 0.5 0.5 0.1 0.1", "line 1: 'person' in column 1"),
        ("0.5 0.5 0.5 0.1 0.1", "the class 0.5 is not a whole number"),
        ("9 0.5 0.5 0.1 0.1", "class 9 has no name"),
    ],
)
def test_broken_yolo(tmp_path, line, message):
    write(tmp_path, {"data.yaml": "names: [person]\n", "labels/a.txt": line}, ("images/a.jpg",))
    with pytest.raises(TruthError, match=message):
        labelled_sources(tmp_path)


@pytest.mark.parametrize("text", ["names: [person", "names:\n", "names: 3\n"])
def test_broken_data_yaml(tmp_path, text):
    write(tmp_path, {"data.yaml": text, "labels/a.txt": YOLO}, ("images/a.jpg",))
    with pytest.raises(TruthError, match=r"data\.yaml"):
        labelled_sources(tmp_path)


# Pascal VOC


def test_voc_difficult_people_are_ignored(tmp_path):
    _, files, images = EXAMPLES["voc"]
    source = one(write(tmp_path, files, images))
    assert [person.ignore for person in source.frames[0].persons] == [False, True]
    assert source.frames[0].size == (WIDTH, HEIGHT)
    assert source.notes == (
        "1 images in JPEGImages have no XML file and are not used",
        "1 boxes of class cat are not used",
    )


def test_voc_file_name_decides_if_the_stem_does_not(tmp_path):
    source = one(write(tmp_path, {"Annotations/007.xml": voc(thing("person"))}, ("JPEGImages/a.jpg",)))
    assert source.frames[0].name == "a.jpg"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (voc(thing("person"), "<object>"), "not valid XML: mismatched tag"),
        (voc(thing("person", (1, 2, "x", 4))), "line 4 .object 1.: 'x' in column 3"),
        (voc("<object><name>person</name></object>"), "the object has no bndbox"),
        (voc(thing("")), "the object has no name"),
        (voc(thing("person", (9, 2, 3, 4))), "the box 9, 2, -6, 2"),
        (f"<!DOCTYPE x [<!ENTITY a 'b'>]>{voc(thing('person'))}", "defines entities"),
    ],
)
def test_broken_voc(tmp_path, text, message):
    write(tmp_path, {"Annotations/a.xml": text}, ("JPEGImages/a.jpg",))
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path, format="voc")
    assert "a.xml" in str(error.value)


# CVAT


def test_cvat_images(tmp_path):
    _, files, images = EXAMPLES["cvat images"]
    source = one(write(tmp_path, files, images))
    assert source.name == "hall"
    first, second = source.frames
    assert [person.box for person in first.persons] == [BOX, (90, 20, 20, 40)]
    assert second.persons == ()
    assert source.notes == ("1 boxes of class car are not used", "1 boxes of shape points are not used")


def test_cvat_tracks_outside_and_between_key_frames(tmp_path):
    source = one(write(tmp_path, {"annotations.xml": CVAT_VIDEO}, FOUR))
    assert [[person.box for person in frame.persons] for frame in source.frames] == [
        [BOX], [(45, 20, 30, 80)], [(50, 20, 30, 80)], [],
    ]  # fmt: skip
    assert {person.id for frame in source.frames for person in frame.persons} == {"3"}
    assert source.identities
    assert source.frames[0].size == (WIDTH, HEIGHT)


def test_cvat_with_steps_between_frames(tmp_path):
    text = CVAT_VIDEO.replace("<mode>", "<start_frame>10</start_frame><frame_filter>step=3</frame_filter><mode>")
    text = text.replace('frame="0"', 'frame="10"').replace('frame="2"', 'frame="13"').replace('frame="3"', 'frame="16"')
    images = ("images/frame_000010.png", "images/frame_000013.png", "images/frame_000016.png")
    source = one(write(tmp_path, {"annotations.xml": text}, images))
    assert [len(frame.persons) for frame in source.frames] == [1, 1, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CVAT_IMAGES.replace('xtl="40.00"', ""), "line 6: <box> has no xtl"),
        (CVAT_IMAGES.replace("40.00", "left"), "line 6, xtl: 'left' in column 1"),
        (CVAT_VIDEO.replace('frame="2"', 'frame="-2"'), "frame is -2"),
        (CVAT_IMAGES.replace("</annotations>", ""), "not valid XML: no element found"),
    ],
)
def test_broken_cvat(tmp_path, text, message):
    write(tmp_path, {"annotations.xml": text}, ("images/a.jpg", "images/b.jpg", *FOUR))
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path, format="cvat")
    assert "annotations.xml" in str(error.value)


# Images


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp"])
def test_size_of_an_image(tmp_path, suffix):
    write(tmp_path, {}, (f"a{suffix}",))
    assert image_size(tmp_path / f"a{suffix}") == (WIDTH, HEIGHT)


def test_size_of_no_image(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ImageError, match="cannot be decoded"):
        image_size(tmp_path / "a.jpg")
