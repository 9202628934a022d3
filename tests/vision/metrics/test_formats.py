"""Label formats: detection of the format, classes, COCO, YOLO and Pascal VOC."""

from __future__ import annotations

import codecs
import json
import re
import time
import unicodedata
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError, ParameterError, TruthError
from socialbot.vision.metrics.formats import FORMATS, labelled_sources, sniff
from socialbot.vision.metrics.formats._labels import role_of
from socialbot.vision.metrics.formats.yolo import image_size
from socialbot.vision.metrics.frames import FolderImages
from tests.bags.test_image_files import turned_jpeg
from tests.vision.metrics.label_files import (
    BOX,
    CVAT_IMAGES,
    EXAMPLES,
    HEIGHT,
    KITTI,
    TRACKING,
    VOC,
    WIDTH,
    YAML,
    YOLO,
    coco,
    one,
    thing,
    voc,
    write,
)

CARS = "".join(f"{name} 0 0 0 40 20 70 100 1.7 0.6 0.8 0 1.6 4 0\n" for name in ("Car", "DontCare"))
"""KITTI labels without people."""

MASK = "df4`2X1000000000000000000hNROFn0:ROFn0:ROFn0:ROFn0:ROFn0:ROFn0:ROFn0:ROFn0:ROFn0:ROFn0b1000000000000000000l`:"
"""Run lengths of BOX with a hole, as pycocotools writes them."""


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


OWN = """
from pathlib import Path

from socialbot.vision.metrics import LabelFormat, Labels, labelled_images

CSV = LabelFormat(
    "csv",
    "people.csv",
    lambda path, images, people: read(path, images, people),
    lambda folder: sorted(folder.glob("people.csv")),
    lambda path: path.suffix == ".csv",
)


def read(path, images, people):
    labels = Labels(path, people)
    for line in path.read_text().splitlines():
        name, kind, *box = line.split(",")
        labels.add(name, kind, tuple(map(float, box)), str(path))
    return [labelled_images(labels, "csv", images or path.parent)]
"""


def test_a_format_of_a_module_in_the_working_directory(tmp_path, monkeypatch):
    images = ("shown.png", "without_people.png")
    box = ",".join(str(value) for value in BOX)
    folder = write(tmp_path / "images", {"people.csv": f"shown.png,visitor,{box}\n"}, images)
    write(tmp_path, {"own_csv.py": OWN})
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    source = one(folder, format="own_csv:CSV", people=["visitor"])
    assert source.format == "csv"
    assert [len(frame.persons) for frame in source.frames] == [1, 0]
    assert source.frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)
    assert {frame.stamp for frame in source.frames} == {each.stamp for each in source.images.read()}
    with pytest.raises(ParameterError, match="own_csv has no 'CVS'") as error:
        labelled_sources(folder, format="own_csv:CVS")
    assert "did you mean 'CSV'" in str(error.value)
    with pytest.raises(ParameterError, match="'own_csv:read' is no format"):
        labelled_sources(folder, format="own_csv:read")


@pytest.mark.parametrize(
    "content",
    [
        {"version": "5.0", "shapes": [{"label": "person", "points": [[1, 2], [3, 4]]}], "imagePath": "a.jpg"},
        [{"name": "a.jpg", "labels": [{"category": "pedestrian", "box2d": {"x1": 1}}]}],
        [{"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.9}],
    ],
)
def test_json_of_other_formats_is_not_taken_for_the_own_one(tmp_path, content):
    write(tmp_path, {"labels.json": json.dumps(content)}, ("a.jpg",))
    with pytest.raises(TruthError, match="no labels of a known format") as error:
        labelled_sources(tmp_path, tmp_path / "labels.json")
    assert "convert others to COCO" in str(error.value.remedy)


@pytest.mark.parametrize(
    ("tool", "content"),
    [
        ("LabelMe", {"version": "5.3.1", "shapes": [], "imagePath": "a.jpg", "imageData": None}),
        ("VIA", {"_via_settings": {}, "_via_img_metadata": {}}),
        ("VIA", {"a.jpg123": {"filename": "a.jpg", "size": 123, "regions": [], "file_attributes": {}}}),
        ("Label Studio", [{"id": 1, "annotations": [], "data": {"image": "/data/upload/a.jpg"}}]),
        ("Label Studio", [{"image": "/data/upload/a.jpg", "id": 1, "label": []}]),
        ("Datumaro", {"info": {}, "categories": {}, "items": []}),
        ("Supervisely", {"description": "", "objects": [], "size": {"height": 120, "width": 160}}),
        ("CreateML", [{"image": "a.jpg", "annotations": [{"label": "person", "coordinates": {"x": 1}}]}]),
        (
            "VIA",
            {"project": {"pid": "1"}, "file": {"1": {"fname": "a.jpg"}}, "metadata": {"1_a": {"vid": "1", "av": {}}}},
        ),
        ("VoTT", {"name": "hall", "assets": {"1": {"asset": {"name": "a.jpg"}, "regions": []}}}),
        (
            "VoTT",
            {
                "name": "hall",
                "videoSettings": {"frameExtractionRate": 15},
                "tags": [{"name": "person"}],
                "assets": {"1": {"asset": {"name": "a.jpg", "size": {}}, "regions": []}},
            },
        ),
        ("BDD100K", [{"name": "a.jpg", "labels": [{"category": "pedestrian", "box2d": {"x1": 1}}]}]),
        ("JRDB", {"labels": {"000000.jpg": [{"label_id": "pedestrian:1", "box": [1, 2, 3, 4]}]}}),
        ("EuroCity Persons", {"tags": [], "imagewidth": 160, "imageheight": 120, "children": []}),
        ("CityPersons", {"imgHeight": 120, "imgWidth": 160, "objects": []}),
    ],
)
def test_labels_of_other_tools_are_refused_by_name(tmp_path, tool, content):
    write(tmp_path, {"a.json": json.dumps(content)}, ("a.jpg",))
    for path in (tmp_path, tmp_path / "a.json"):
        with pytest.raises(TruthError, match=rf"no labels of a known format, but of {tool}") as caught:
            labelled_sources(tmp_path, path)
        assert "convert others to COCO" in str(caught.value.remedy)


@pytest.mark.parametrize(
    ("name", "file", "content"),
    [
        ("CrowdHuman", "annotation_val.odgt", '{"ID": "a", "gtboxes": []}'),
        ("VisDrone", "annotations/0000001.txt", "107,12,222,620,1,1,0,0\n"),
        ("VisDrone", "annotations/uav1_v.txt", "1,0,107,12,222,620,1,1,0,0\n"),
        ("VisDrone", "annotations/0000001.txt", "107,12,222,620,1,1,0,0,\n"),
        ("WiderPerson", "Annotations/000040.jpg.txt", "1\n1 107 12 329 632\n"),
        ("WIDER FACE", "wider_face_split/wider_face_val_bbx_gt.txt", "a.jpg\n1\n1 2 3 4 0 0 0 0 0 0\n"),
        (r"a detector \(det.txt\)", "det/det.txt", "1,-1,107,12,222,620,0.9,-1,-1,-1\n"),
        ("Label Studio", "export.csv", "annotation_id,annotator,created_at,id,image,label\n"),
        ("Open Images", "train/annotations-bbox.csv", "\ufeffImageID,Source,LabelName,Confidence,XMin\n"),
        ("TensorFlow", "train/_annotations.csv", "filename,width,height,class,xmin,ymin,xmax,ymax\n"),
        ("TensorFlow", "people.tfrecord", "x"),
        (
            "VIA",
            "via_export_csv.csv",
            "filename,file_size,file_attributes,region_count,region_id,region_shape_attributes",
        ),
        ("VIA", "via.csv", "# Exported using VGG Image Annotator (http://www.robots.ox.ac.uk/~vgg/software/via)\n"),
        (
            "VoTT",
            "vott-csv-export/hall-export.csv",
            '"image","xmin","ymin","xmax","ymax","label"\n"a.jpg",1,2,3,4,"x"\n',
        ),
        ("Caltech Pedestrians", "set00/V000.vbb", "x"),
        ("Supervisely", "project/ds0/ann/a.jpg.json", '{"objects": [], "size": {"height": 1, "width": 1}}'),
    ],
)
def test_files_of_other_formats_are_refused_by_name_wherever_they_are(tmp_path, name, file, content):
    write(tmp_path, {file: content}, ("images/a.jpg",))
    with pytest.raises(TruthError, match=rf"no labels of a known format, but of {name}"):
        labelled_sources(tmp_path)


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


@pytest.mark.parametrize(
    ("files", "images"),
    [
        ({"coco.json": coco(categories=[{"id": 3, "name": "van"}, {"id": 5, "name": "car"}])}, ("a.jpg", "b.jpg")),
        ({"label_2/1.txt": CARS}, ("image_2/1.png",)),
        ({"label_02/1.txt": f"0 1 {CARS.splitlines()[0]}\n"}, ("image_02/1/0.png",)),
        ({"Annotations/a.xml": voc(thing("cat"))}, ("JPEGImages/a.jpg",)),
        ({"gt/gt.txt": "1,1,40,20,30,80,1,3,1\n"}, ("img1/1.jpg",)),
        ({"labels/a.txt": YOLO, "classes.txt": "cat\ncar\ndog\n"}, ("images/a.jpg",)),
    ],
)
def test_labels_of_other_classes_alone_are_refused(tmp_path, files, images):
    write(tmp_path, files, images)
    with pytest.raises(TruthError, match=r"no class of people among its classes: .*\n.*name it with --people"):
        labelled_sources(tmp_path)


def test_a_recording_without_people_beside_one_with_people(tmp_path):
    files = {"label_02/0.txt": f"0 1 {CARS.splitlines()[0]}\n", "label_02/1.txt": TRACKING}
    write(tmp_path, files, ("image_02/0/0.png", *(f"image_02/1/{number:06}.png" for number in range(3))))
    alone, both = labelled_sources(tmp_path)
    assert not any(frame.persons for frame in alone.frames)
    assert any(frame.persons for frame in both.frames)


def test_further_classes_of_people(tmp_path):
    categories = [{"id": 3, "name": "Museum_Visitor"}, {"id": 5, "name": "car"}]
    write(tmp_path, {"coco.json": coco(categories=categories)})
    with pytest.raises(TruthError, match="no class of people among its classes: Museum_Visitor, car") as error:
        labelled_sources(tmp_path)
    assert error.value.remedy == "name it with --people"
    assert one(tmp_path, people=["museum visitor"]).frames[0].persons[0].counts


@pytest.mark.parametrize("mark", [codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE])
@pytest.mark.parametrize("name", EXAMPLES)
def test_text_with_a_byte_order_mark_and_lines_of_windows(tmp_path, name, mark):
    format, files, images = EXAMPLES[name]
    encoding = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}.get(mark, "utf-8")
    write(tmp_path / "plain", files, images)
    write(tmp_path / "marked", {}, images)
    for file, text in files.items():
        (tmp_path / "marked" / file).parent.mkdir(parents=True, exist_ok=True)
        lines = text.replace("\n", "\r\n").replace("utf-8", "utf-8" if mark == codecs.BOM_UTF8 else "utf-16")
        (tmp_path / "marked" / file).write_bytes(mark + lines.encode(encoding))
    assert sniff(tmp_path / "marked") == format
    plain, marked = (one(tmp_path / folder).frames for folder in ("plain", "marked"))
    assert [[(each.box, each.ignore) for each in frame.persons] for frame in marked] == [
        [(each.box, each.ignore) for each in frame.persons] for frame in plain
    ]


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("a.json", '{"images": [NaN], "annotations": []}', "malformed"),
        ("annotations/a.json", "", "truncated"),
        ("a.xml", f"\n<?xml version='1.0'?>{voc(thing('person'))}", "line 2: not valid XML"),
        ("Annotations/a.xml", "", "line 1: not valid XML"),
    ],
)
def test_damaged_file_in_a_folder_is_named(tmp_path, file, text, message):
    write(tmp_path, {file: text})
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert str(tmp_path / file) in str(error.value)


def test_archive_is_to_be_unpacked(tmp_path):
    (tmp_path / "task.zip").write_bytes(b"PK")
    with pytest.raises(TruthError, match=r"no labels of a known format\n *remedy: unpack it"):
        labelled_sources(tmp_path / "task.zip")


def test_skipped_classes_are_reported(tmp_path):
    write(tmp_path, {"coco.json": coco()})
    assert one(tmp_path).notes == ("not used: 1 box of class car",)


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


@pytest.mark.parametrize(
    ("about", "distance_m"),
    [
        ({"distance_m": 2}, 2.0), ({"distance_m": -1}, None), ({"attributes": {"distance_m": "4.5"}}, 4.5),
        ({"attributes": {"distance_m": 10.0, "occluded": True}}, 10.0), ({"attributes": {"distance_m": ""}}, None),
        ({"attributes": {"occluded": False}}, None), ({"attributes": ["x"]}, None),
        ({"distance_m": 0, "attributes": {"distance_m": 3}}, 0.0),
    ],
)  # fmt: skip
def test_coco_distances(tmp_path, about, distance_m):
    annotations = [{"image_id": 7, "category_id": 3, "bbox": BOX, **about}]
    source = one(write(tmp_path, {"x.json": coco(annotations=annotations)}))
    assert [each.distance_m for each in source.frames[0].persons] == [distance_m]


def test_coco_panoptic_segments(tmp_path):
    person = {"id": 7, "category_id": 3, "bbox": [40, 20, 30, 80], "area": 1200, "iscrowd": 0}
    segments = [person, {**person, "id": 8, "category_id": 5}, {**person, "id": 9, "iscrowd": 1}]
    entry = {"image_id": 7, "file_name": "a.png", "segments_info": segments}
    write(tmp_path, {"annotations/panoptic_val.json": coco(annotations=[entry])}, ("val/a.jpg", "val/b.jpg"))
    frame = one(tmp_path).frames[0]
    assert [(person.box, person.area) for person in frame.persons] == [((40, 20, 30, 80), 1200)]
    assert len(frame.ignore) == 1


def test_coco_panoptic_segment_without_a_box(tmp_path):
    entry = {"image_id": 7, "file_name": "a.png", "segments_info": [{"id": 7, "category_id": 3}]}
    write(tmp_path, {"annotations/panoptic_val.json": coco(annotations=[entry])}, ("val/a.jpg", "val/b.jpg"))
    with pytest.raises(TruthError, match=r"annotations\[0\].segments_info\[0\].*bbox"):
        labelled_sources(tmp_path)


def test_coco_outline_without_a_box(tmp_path):
    outline = {"id": 1, "image_id": 7, "category_id": 3, "segmentation": [[40, 20, 70, 20, 70, 100], [40, 90, 50, 100]]}
    other = {"id": 2, "image_id": 7, "category_id": 5}
    write(tmp_path, {"a.json": coco(annotations=[outline, other])})
    source = one(tmp_path)
    assert [person.box for frame in source.frames for person in frame.persons] == [BOX]
    assert "not used: 1 box of class car" in source.notes


def test_impossible_box_of_another_class_is_counted_with_its_class(tmp_path):
    write(tmp_path, {"a.xml": voc(thing("person"), thing("cat", (70, 20, 40, 100)))}, ("a.jpg",))
    assert "not used: 1 box of class cat" in one(tmp_path).notes


@pytest.mark.parametrize("counts", [[4820, *[80, 40] * 29, 80, 10820], MASK])
@pytest.mark.parametrize("box", [{}, {"bbox": None}, {"bbox": []}])
def test_coco_mask_without_a_box(tmp_path, counts, box):
    mask = {"image_id": 7, "category_id": 3, "segmentation": {"size": [HEIGHT, WIDTH], "counts": counts}, **box}
    source = one(write(tmp_path, {"a.json": coco(annotations=[mask, {**mask, "iscrowd": 1}])}))
    assert [person.box for person in source.frames[0].persons] == [BOX]
    assert [region.box for region in source.frames[0].ignore] == [BOX]


@pytest.mark.parametrize(
    ("size", "counts", "box"),
    [
        ((4, 5), [5, 2, 13], (1, 1, 1, 2)),
        ((4, 5), [7, 2, 11], (1, 0, 2, 4)),
        ((4, 5), [0, 20], (0, 0, 5, 4)),
        ((4, 5), [3, 0, 2, 1, 14], (1, 1, 1, 1)),
        ((4, 5), [21, 1], None),
        ((4, 5), [5, -2, 17], None),
        ((0, 5), [1, 1], None),
        ((4, 5), [20], None),
        ((4, 5), "p", None),
    ],
)
def test_coco_box_around_a_mask(tmp_path, size, counts, box):
    mask = {"image_id": 7, "category_id": 3, "segmentation": {"size": size, "counts": counts}}
    write(tmp_path, {"a.json": coco(annotations=[mask])})
    if box is None:
        with pytest.raises(TruthError, match="no bbox"):
            labelled_sources(tmp_path)
    else:
        assert one(tmp_path).frames[0].persons[0].box == box


def test_coco_ids_that_are_written_with_a_point(tmp_path):
    boxes = [{"id": 1.0, "image_id": 7.0, "category_id": 3.0, "bbox": BOX}]
    assert one(write(tmp_path, {"a.json": coco(annotations=boxes)})).frames[0].persons[0].box == BOX


def test_coco_image_named_by_its_address_alone(tmp_path):
    listed = [{"id": 7, "coco_url": "http://images.cocodataset.org/val2017/a.jpg"}, {"id": 9, "file_name": "b.jpg"}]
    source = one(write(tmp_path, {"lvis.json": coco(images=listed)}))
    assert [frame.name for frame in source.frames] == ["a.jpg", "b.jpg"]


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


def test_coco_videos_with_frame_index_and_without_rate(tmp_path):
    images = [{"id": n, "file_name": f"{n}.jpg", "video_id": 1, "frame_index": 30 * n} for n in range(2)]
    boxes = [{"image_id": n, "category_id": 3, "bbox": BOX, "track_id": 5} for n in range(2)]
    files = {"tao.json": coco(images=images, annotations=boxes, videos=[{"id": 1, "name": "hall"}])}
    source = one(write(tmp_path, files, ("0.jpg", "1.jpg")))
    assert (source.images.consecutive, source.identities) == (True, True)
    assert [frame.stamp for frame in source.frames] == [0, SECOND]
    assert source.notes == ("videos without fps: 30 images a second are assumed",)


def test_coco_videos_of_youtube_vis(tmp_path):
    videos = [{"id": n, "file_names": [f"{n}/a.jpg", f"{n}/b.jpg"], "width": WIDTH, "height": HEIGHT} for n in (1, 2)]
    mask = {"size": [HEIGHT, WIDTH], "counts": MASK}
    people = [
        {"id": 4, "video_id": 1, "category_id": 3, "bboxes": [BOX, None], "segmentations": [mask, None], "iscrowd": 0},
        {"id": 5, "video_id": 1, "category_id": 3, "segmentations": [None, mask]},
        {"id": 6, "video_id": 2, "category_id": 5, "bboxes": [None, BOX]},
    ]
    content = {"videos": videos, "annotations": people, "categories": json.loads(coco())["categories"]}
    write(tmp_path, {"train.json": json.dumps(content)}, tuple(f"train/{n}/{x}.jpg" for n in (1, 2) for x in "ab"))
    first, second = labelled_sources(tmp_path)
    assert [[(person.id, person.box) for person in frame.persons] for frame in first.frames] == [
        [("4", BOX)],
        [("5", BOX)],
    ]
    assert [frame.name for frame in second.frames] == ["2/a.jpg", "2/b.jpg"]
    assert not any(frame.persons for frame in second.frames)
    assert (first.identities, first.images.consecutive, first.frames[0].size) == (True, True, (WIDTH, HEIGHT))
    assert "not used: 1 box of class car" in first.notes


def listed(*names: str) -> str:
    images = [{"id": id, "file_name": name} for id, name in enumerate(names)]
    return coco(images=images, annotations=[{"image_id": 0, "category_id": 3, "bbox": BOX}])


@pytest.mark.parametrize("names", [("a.jpg", "b.jpg"), ("east/a.jpg", "b.jpg")])
def test_image_that_may_be_one_of_several_is_refused(tmp_path, names):
    write(tmp_path, {"labels.json": listed(*names)}, ("north/a.jpg", "south/a.jpg", "south/b.jpg"))
    with pytest.raises(TruthError, match=rf"image {names[0]} may be .*north/a.jpg or .*south/a.jpg"):
        one(tmp_path)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ({"labels.json": listed("north/a.jpg", "south/a.jpg")}, "north/a.jpg and south/a.jpg are the same file"),
        ({"labels.json": listed("a.jpg", "a.jpg")}, "a.jpg and a.jpg are the same file"),
        ({"labels.xml": CVAT_IMAGES.replace("b.jpg", "a.png")}, "a.jpg and a.png are the same file"),
        ({"a.xml": VOC, "b.xml": VOC}, "a.jpg and a.jpg are the same file"),
    ],
)
def test_image_with_two_entries_is_refused(tmp_path, labels, words):
    with pytest.raises(TruthError, match=words):
        one(write(tmp_path, labels, ("north/a.jpg",) if "labels.json" in labels else ("a.jpg",)))


def test_equal_boxes_are_told(tmp_path):
    text = voc(thing("person"), thing("person"), thing("person"), thing("person", (41, 20, 70, 100)))
    source = one(write(tmp_path, {"a.xml": text}, ("a.jpg",)))
    assert len(source.frames[0].persons) == 4
    assert "2 boxes of people equal another one in their image: at most one of them is found" in source.notes


def test_image_beside_masks_of_the_same_name(tmp_path):
    images = ("JPEGImages/a.jpg", "SegmentationClass/a.png")
    assert one(write(tmp_path, {"Annotations/a.xml": VOC}, images)).frames[0].name == "a.jpg"


def test_name_with_composed_and_decomposed_letters(tmp_path):
    composed, decomposed = (unicodedata.normalize(form, "Mädchen.jpg") for form in ("NFC", "NFD"))
    assert one(write(tmp_path / "1", {"labels.json": listed(composed)}, (decomposed,))).frames
    assert one(write(tmp_path / "2", {"labels.json": listed(decomposed)}, (composed,))).frames


def test_missing_images_are_reported_and_none_is_an_error(tmp_path):
    write(tmp_path, {"coco.json": coco()}, ("a.jpg",))
    source = one(tmp_path)
    assert len(source.frames) == 1
    assert "1 of 2 images are missing, the first: b.jpg" in source.notes
    (tmp_path / "a.jpg").unlink()
    with pytest.raises(ImageError, match="none of its 2 images is there"):
        labelled_sources(tmp_path)


@pytest.mark.parametrize("counts", [300_000 * "o", 20 * "o" + "0"])
def test_a_coco_mask_of_endless_numbers_is_refused(tmp_path, counts):
    """Each character may continue a number, whose bits must not grow with the file."""
    mask = {"image_id": 7, "category_id": 3, "segmentation": {"size": [HEIGHT, WIDTH], "counts": counts}}
    write(tmp_path, {"a.json": coco(annotations=[mask])})
    begin = time.process_time()
    with pytest.raises(TruthError, match="no bbox"):
        labelled_sources(tmp_path)
    assert time.process_time() - begin < 1.0


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
        ({"annotations": [{"image_id": "7", "category_id": 3, "bbox": BOX}]}, "image_id '7' is not"),
        ({"images": [{"id": 7, "file_name": "a.jpg"}] * 2}, "two images have the id 7"),
        ({"categories": [{"id": 3, "name": "person"}, {"id": 3, "name": "car"}]}, "two categories have the id 3"),
        ({"images": [{"id": 7, "width": 3}]}, r"images\[0\]: no file_name"),
    ],
)
def test_broken_coco(tmp_path, change, message):
    write(tmp_path, {"coco.json": coco(**change)})
    with pytest.raises(TruthError, match=message) as error:
        labelled_sources(tmp_path)
    assert str(tmp_path / "coco.json") in str(error.value)
    assert error.value.remedy


# Names of sources


@pytest.mark.parametrize(
    ("file", "names"),
    [
        ("_annotations.coco.json", ["train", "valid"]),
        ("instances.json", ["train/instances", "valid/instances"]),
    ],
)
def test_parts_of_a_data_set_have_different_names(tmp_path, file, names):
    parts = ("train", "valid")
    write(
        tmp_path,
        {f"{part}/{file}": coco() for part in parts},
        ("train/a.jpg", "train/b.jpg", "valid/a.jpg", "valid/b.jpg"),
    )
    sources = labelled_sources(tmp_path)
    assert sorted(source.name for source in sources) == names
    assert [source.scene for source in sources] == [source.name for source in sources]


# YOLO


def test_yolo_images_without_labels_show_no_person(tmp_path):
    _, files, images = EXAMPLES["yolo, classes.txt"]
    source = one(write(tmp_path, {**files, "labels/c.txt": ""}, (*images, "images/c.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0, 0]
    assert "1 of 3 images have no label file: they show nobody" in source.notes
    assert "not used: 1 box of class dog" in source.notes


@pytest.mark.parametrize(
    "text", ["'names': [car, person]", '{"names": ["car", "person"]}', "{train: images, names: {0: car, 1: person}}"]
)
def test_yolo_names_in_other_notations_of_yaml(tmp_path, text):
    files = {"dataset.yaml": text, "labels/a.txt": f"0 0.5 0.5 0.1 0.1\n1{YOLO.splitlines()[0][1:]}\n"}
    [person] = one(write(tmp_path, files, ("images/a.jpg",))).frames[0].persons
    assert person.box == pytest.approx(BOX, abs=0.01)


def test_yolo_folders_in_folders(tmp_path):
    files = {"data.yaml": YAML, "labels/train/hall/a.txt": YOLO, "labels/train/yard/a.txt": ""}
    source = one(write(tmp_path, files, ("images/train/hall/a.jpg", "images/train/yard/a.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0]


def test_yolo_parts_with_a_year_and_without_names(tmp_path):
    """The folders of COCO as YOLO, such as those of coco128, have neither names nor the usual parts."""
    files = {"labels/train2017/a.txt": YOLO, "labels/val2017/b.txt": "", "labels/val2017/c.txt": YOLO}
    write(tmp_path, files, ("images/train2017/a.jpg", "images/val2017/b.jpg", "images/val2017/c.jpg"))
    train, val = labelled_sources(tmp_path)
    assert (train.format, train.name, val.name) == ("yolo", f"{tmp_path.name}/train2017", f"{tmp_path.name}/val2017")
    assert [[len(frame.persons) for frame in each.frames] for each in (train, val)] == [[1], [0, 1]]
    assert [len(source.frames) for source in labelled_sources(tmp_path / "images", tmp_path / "labels")] == [3]


def test_yolo_folders_of_any_name_without_names(tmp_path):
    files = {"labels/hall/a.txt": YOLO, "labels/yard/a.txt": ""}
    source = one(write(tmp_path, files, ("images/hall/a.jpg", "images/yard/a.jpg")))
    assert [len(frame.persons) for frame in source.frames] == [1, 0]


def test_yolo_parts_of_darknet(tmp_path):
    files = {"train/_darknet.labels": "person\ncar\ndog\n", "train/a.txt": YOLO, "valid/b.txt": ""}
    first, second = labelled_sources(write(tmp_path, files, ("train/a.jpg", "valid/b.jpg")))
    assert (len(first.frames[0].persons), len(second.frames[0].persons)) == (1, 0)


@pytest.mark.parametrize("folder", ["labels/", ""])
def test_yolo_label_files_without_an_image_are_told(tmp_path, folder):
    files = {"classes.txt": "person\ncar\ndog\n", **{f"{folder}{name}.txt": YOLO for name in "abc"}}
    write(tmp_path, {**files, f"{folder}train.txt": "a.jpg\n"}, ("images/a.jpg" if folder else "a.jpg",))
    assert f"2 label files have no image, the first: {tmp_path}/{folder}b.txt" in one(tmp_path).notes


def test_yolo_label_files_of_another_part_have_an_image(tmp_path):
    files = {"data.yaml": YAML.replace("images/train", "train.txt").replace("images/val", "val.txt")}
    lists = {f"{part}.txt": f"./images/{name}.jpg\n" for part, name in (("train", "a"), ("val", "b"))}
    labels = {f"labels/{name}.txt": YOLO for name in "ab"}
    write(tmp_path, {**files, **lists, **labels}, ("images/a.jpg", "images/b.jpg"))
    assert not any("no image" in note for source in labelled_sources(tmp_path) for note in source.notes)


@pytest.mark.parametrize("name", ["kitti", "voc"])
def test_images_without_a_label_file_are_told(tmp_path, name):
    _, files, [image, *_] = EXAMPLES[name]
    others = [image.replace("a.jpg", other).replace("000004.png", other) for other in ("x.jpg", "y.jpg")]
    [note] = [note for note in one(write(tmp_path, files, (image, *others))).notes if "not used: " not in note]
    assert re.fullmatch(r"2 images in \w+ have no (label|XML) file and are not used", note)


def test_yolo_without_names(tmp_path):
    source = one(write(tmp_path, {"labels/a.txt": YOLO}, ("images/a.jpg",)))
    assert "no data.yaml and no classes.txt: class 0 is taken for people" in source.notes


def test_yolo_without_names_takes_the_given_class_for_people(tmp_path):
    write(
        tmp_path, {"labels/a.txt": YOLO, "labels/b.txt": YOLO.replace("0 ", "3 ", 1)}, ("images/a.jpg", "images/b.jpg")
    )
    [source] = labelled_sources(tmp_path, people=["3"])
    assert [len(frame.persons) for frame in source.frames] == [0, 1]
    assert not any("taken for people" in note for note in source.notes)


def test_yolo_data_set_whose_folder_is_called_labels(tmp_path):
    files = {"classes.txt": "person\ncar\ndog\n", "labels/train/a.txt": YOLO}
    source = one(write(tmp_path / "labels", files, ("images/train/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)


def test_yolo_outlines_and_key_points(tmp_path):
    outline = "0 0.25 0.5 0.5 0.5 0.25 0.75 0.5 0.75\n"
    source = one(write(tmp_path / "outline", {"labels/a.txt": outline}, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx((40, 60, 40, 30))
    points = "0 0.34375 0.5 0.1875 0.66666667 0.4 0.5 2 0 0 0\n"
    files = {"data.yaml": "names: [person]\nkpt_shape: [2, 3]\n", "labels/a.txt": points}
    source = one(write(tmp_path / "points", files, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)


def test_yolo_classes_with_numbers_as_text(tmp_path):
    files = {"data.yaml": "names: {'0': person, '1': dog, '2': cat}\n", "labels/a.txt": YOLO}
    assert len(one(write(tmp_path, files, ("images/a.jpg",))).frames[0].persons) == 1


def test_yolo_key_points_without_their_shape(tmp_path):
    files = {"data.yaml": "names: [person]\n", "labels/a.txt": f"0 0.5 0.5 0.1 0.2{' 0.5 0.5 2' * 17}\n"}
    write(tmp_path, files, ("images/a.jpg",))
    with pytest.raises(TruthError, match="56 columns") as error:
        labelled_sources(tmp_path)
    assert "kpt_shape" in str(error.value.remedy)


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


DETECTIONS = {
    "det.txt of MOTChallenge": ("mot", "gt.txt", "1,-1,40,20,30,80,0.93", "1.jpg"),
    "tracks of MOTChallenge": ("mot", "gt.txt", "1,1,40,20,30,80,0.93,-1,-1,-1", "1.jpg"),
    "KITTI results": ("kitti", "label_2/4.txt", f"{KITTI.splitlines()[0]} 0.93", "image_2/4.png"),
    "KITTI tracks": ("kitti", "label_02/1.txt", f"{TRACKING.splitlines()[0]} 0.93", "image_02/1/0.png"),
    "YOLO predictions": ("yolo", "labels/a.txt", "0 0.34375 0.5 0.1875 0.66666667 0.93", "images/a.jpg"),
    "YOLO tracks": ("yolo", "labels/a.txt", "0 0.34375 0.5 0.1875 0.66666667 0.93 1", "images/a.jpg"),
    "COCO predictions": ("coco", "a.json", coco().replace('"iscrowd": 0', '"score": 0.93', 1), "a.jpg"),
}


@pytest.mark.parametrize("name", DETECTIONS)
def test_detections_are_no_labels(tmp_path, name):
    format, file, text, image = DETECTIONS[name]
    write(tmp_path, {file: text}, (image,))
    with pytest.raises(TruthError, match=r"0\.93 is a score") as error:
        labelled_sources(tmp_path, format=format)
    assert str(tmp_path / file) in str(error.value.where)
    # A whole number there is none: ids and flags of other tools.
    write(tmp_path, {file: text.replace("0.93", "1")}, ())
    assert one(tmp_path, format=format).frames[0].persons[0].box == pytest.approx(BOX, abs=0.01)


def test_yolo_triangle_is_an_outline(tmp_path):
    source = one(write(tmp_path, {"labels/a.txt": "0 0.25 0.5 0.5 0.5 0.25 0.75\n"}, ("images/a.jpg",)))
    assert source.frames[0].persons[0].box == pytest.approx((40, 60, 40, 30))


def test_yolo_names_of_darknet(tmp_path):
    files = {"data.names": "dog\nperson\n", "labels/a.txt": f"0 0.5 0.5 0.1 0.1\n1{YOLO.splitlines()[0][1:]}\n"}
    [person] = one(write(tmp_path, files, ("images/a.jpg",))).frames[0].persons
    assert person.box == pytest.approx(BOX, abs=0.01)


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
        "not used: 1 box of class cat",
    )


def test_voc_file_name_decides_if_the_stem_does_not(tmp_path):
    source = one(write(tmp_path, {"Annotations/007.xml": voc(thing("person"))}, ("JPEGImages/a.jpg",)))
    assert source.frames[0].name == "a.jpg"


def test_voc_object_of_another_class_without_a_box(tmp_path):
    files = {"Annotations/a.xml": voc(thing("person"), "<object><name>car</name><robndbox/></object>")}
    assert "not used: 1 box of class car" in one(write(tmp_path, files, ("JPEGImages/a.jpg",))).notes


@pytest.mark.parametrize("shape", ["<polygon><pt><x>1</x><y>2</y></pt></polygon>", "<segm><box/></segm>"])
@pytest.mark.parametrize("name", ["person", "window"])
def test_labelme_in_xml_is_no_voc(tmp_path, name, shape):
    """LabelMe on the web, and exports of CVAT for it, have outlines instead of boxes."""
    text = f"<annotation><filename>a.jpg</filename><object><name>{name}</name>{shape}</object></annotation>"
    write(tmp_path, {"Annotations/hall/a.xml": text}, ("Images/hall/a.jpg",))
    with pytest.raises(TruthError, match=r"a\.xml, line 1 .*: outlines of LabelMe") as caught:
        labelled_sources(tmp_path)
    assert "Pascal VOC" in str(caught.value.remedy)


def test_voc_folders_in_annotations(tmp_path):
    files = {"Annotations/hall/a.xml": voc(thing("person")), "Annotations/yard/a.xml": voc()}
    hall, yard = labelled_sources(write(tmp_path, files, ("JPEGImages/hall/a.jpg", "JPEGImages/yard/a.jpg")))
    assert (hall.name, yard.name) == (f"{tmp_path.name}/hall", f"{tmp_path.name}/yard")
    assert [len(each.frames[0].persons) for each in (hall, yard)] == [1, 0]
    [image] = yard.images.read()
    assert image.name.endswith("yard/a.jpg")


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


# Images


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp"])
def test_size_of_an_image(tmp_path, suffix):
    write(tmp_path, {}, (f"a{suffix}",))
    assert image_size(tmp_path / f"a{suffix}") == (WIDTH, HEIGHT)


@pytest.mark.parametrize("size", [None, (WIDTH, HEIGHT), (HEIGHT, WIDTH)])
def test_turned_image_is_read_as_it_was_labelled(tmp_path, size):
    stored = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    (tmp_path / "a.jpg").write_bytes(turned_jpeg(cv2.rotate(stored, cv2.ROTATE_90_CLOCKWISE)))
    about = {} if size is None else dict(zip(("width", "height"), size, strict=True))
    write(tmp_path, {"x.json": coco(images=[{"id": 7, "file_name": "a.jpg", **about}], annotations=[])}, ())
    [source] = labelled_sources(tmp_path)
    [encoded] = source.images.read()
    height, width = encoded.bgr(source.frames[0].size).shape[:2]
    assert (width, height) == (size or (HEIGHT, WIDTH))


def test_yolo_shares_are_those_of_the_image_as_it_is_shown(tmp_path):
    (tmp_path / "a.jpg").write_bytes(turned_jpeg(np.zeros((WIDTH, HEIGHT, 3), np.uint8)))
    source = one(write(tmp_path, {"classes.txt": "person\n", "a.txt": "0 0.5 0.25 0.5 0.5\n"}, ()))
    assert source.frames[0].persons[0].box == (HEIGHT / 4, 0, HEIGHT / 2, WIDTH / 2)


def test_size_of_no_image(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ImageError, match="cannot be decoded"):
        image_size(tmp_path / "a.jpg")
