from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from socialbot.core.errors import ParameterError
from socialbot.vision.metrics.coco import CocoImage, CocoScore, coco_image, coco_score
from socialbot.vision.metrics.exports import coco_results, export, mot_lines
from socialbot.vision.metrics.formats import labelled_sources
from socialbot.vision.metrics.frames import bag_source, image_sources
from socialbot.vision.metrics.pipeline import PipelineSettings, with_changes
from socialbot.vision.metrics.truth import Region
from tests.vision.metrics.scenes import POSE, drawn_bag, drawn_pictures, evaluated, frame, person, seen

REFERENCE = Path(__file__).with_name("reference")
FIGURES = json.loads((REFERENCE / "figures.json").read_text())["coco"]


def reference() -> list[CocoImage]:
    """The images of the files."""
    labels = json.loads((REFERENCE / "coco.json").read_text())
    results = json.loads((REFERENCE / "coco_results.json").read_text())
    images = []
    for image in labels["images"]:
        people = [each for each in labels["annotations"] if each["image_id"] == image["id"]]
        found = [each for each in results if each["image_id"] == image["id"]]
        crowd = np.array([each["iscrowd"] for each in people], bool)
        scores = np.array([each["score"] for each in found])
        order = np.argsort(-scores, kind="stable")
        boxes = np.array([each["bbox"] for each in found]).reshape(-1, 4)
        images.append(
            CocoImage(
                np.array([each["bbox"] for each in people]).reshape(-1, 4),
                np.array([each["area"] for each in people]),
                crowd,
                crowd,
                boxes[order],
                scores[order],
            )
        )
    return images


def figures(score: CocoScore) -> dict[str, float | None]:
    return {name: getattr(score, name) for name in FIGURES}


def test_same_figures_as_pycocotools_had():
    assert figures(coco_score(reference())) == pytest.approx(FIGURES, abs=1e-12)


def test_same_figures_as_pycocotools_has(capsys):
    coco = pytest.importorskip("pycocotools.coco")
    evaluation = pytest.importorskip("pycocotools.cocoeval")
    labels = coco.COCO(str(REFERENCE / "coco.json"))
    run = evaluation.COCOeval(labels, labels.loadRes(str(REFERENCE / "coco_results.json")), "bbox")
    run.evaluate()
    run.accumulate()
    run.summarize()
    theirs = dict(zip(FIGURES, (*run.stats[:6], run.stats[8]), strict=True))
    assert figures(coco_score(reference())) == pytest.approx(theirs, abs=1e-12)


def score(labelled, *found, least_visible=0.25) -> CocoScore:
    return coco_score([coco_image(labelled, found, least_visible)])


def test_perfect_boxes():
    assert score(frame(person(0), person(50)), seen(0), seen(50, score=0.9)).ap == pytest.approx(1)


def test_a_shifted_box_counts_at_low_thresholds_only():
    # 8 of 12 columns in common: an IoU of 2/3, enough for .50, .55, .60 and .65.
    assert score(frame(person(0)), seen(2)).ap == pytest.approx(0.4)


def test_without_people_there_are_no_figures():
    assert score(frame(), seen(0)) == CocoScore()


def test_without_detections_figures_are_zero():
    assert (score(frame(person(0))).ap, score(frame(person(0))).ar) == (0, 0)


@pytest.mark.parametrize(
    "labelled",
    [
        frame(person(0), person(200, visible=0.1)),
        frame(person(0), ignore=(Region(x=150, y=0, w=200, h=200),)),
        frame(person(0), complete=False),
    ],
)
def test_detections_of_what_is_not_scored_do_not_count(labelled):
    assert score(labelled, seen(0, score=0.5), seen(200, score=0.9)).ap == pytest.approx(1)


def test_small_and_large_people():
    labelled = frame(person(0, w=10, h=20), person(100, w=120, h=200))
    result = score(labelled, seen(100, w=120, h=200))
    assert (result.ap_small, result.ap_medium, result.ap_large) == (0, None, pytest.approx(1))


# Exports


def test_results_have_the_ids_of_the_data_set(tmp_path):
    folder = drawn_pictures(tmp_path / "shown", 2)
    boxes = [entry["boxes"][0] for entry in json.loads((folder / "persons.json").read_text())]
    (folder / "persons.json").unlink()
    labels = {
        "images": [{"id": 40 - number, "file_name": f"{number}.png"} for number in range(2)],
        "annotations": [
            {"image_id": 40 - number, "category_id": 7, "bbox": [box[side] for side in "xywh"], "area": 1, "iscrowd": 0}
            for number, box in enumerate(boxes)
        ],
        "categories": [{"id": 7, "name": "person"}],
    }
    (folder / "coco.json").write_text(json.dumps(labels))
    evaluation = evaluated(labelled_sources(folder))
    results = coco_results(evaluation.detectors["hog"])
    assert {(entry["image_id"], entry["category_id"], entry["file_name"]) for entry in results} == {
        (40, 7, "0.png"),
        (39, 7, "1.png"),
    }
    [scene] = evaluation.detectors["hog"].scenes.values()
    assert scene.coco.ap50 is not None
    assert export(evaluation, "coco", tmp_path / "out" / "results.json") == [tmp_path / "out" / "results.json"]
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == results


def test_tracks_are_ten_columns_with_whole_numbers(tmp_path):
    evaluation = evaluated(
        [bag_source(drawn_bag(tmp_path, frames=6, objects=[]))], with_changes(PipelineSettings("hog"), POSE)
    )
    [scene] = evaluation.detectors["hog"].scenes.values()
    lines = [line.split(",") for line in mot_lines(scene.clips[0])]
    assert lines
    assert {len(line) for line in lines} == {10}
    assert {int(line[1]) for line in lines} == {1}
    assert {int(line[0]) for line in lines} <= set(range(1, 7))
    assert scene.tracking is not None
    assert len(lines) == scene.tracking.hits + scene.tracking.false
    [written] = export(evaluation, "mot", tmp_path / "tracks")
    assert written == tmp_path / "tracks" / "clip.txt"
    assert written.read_text().splitlines() == [",".join(line) for line in lines]


def test_recordings_with_similar_names_have_files_of_their_own(tmp_path):
    source = bag_source(drawn_bag(tmp_path, frames=1, objects=[]))
    names = ("hall 1", "hall-1", "hall-1-2", "hall/1")
    evaluation = evaluated([replace(source, name=name, scene=name) for name in names])
    written = export(evaluation, "mot", tmp_path / "tracks")
    assert [path.name for path in written] == ["hall-1.txt", "hall-1-2.txt", "hall-1-2-2.txt", "hall-1-3.txt"]
    assert all(path.is_file() for path in written)


def test_single_images_have_no_tracks(tmp_path):
    evaluation = evaluated(image_sources(drawn_pictures(tmp_path / "shown", 1)))
    with pytest.raises(ParameterError, match="only single images"):
        export(evaluation, "mot", tmp_path / "tracks")


# Images that do not fit their labels


def labelled_folder(tmp_path: Path, **image) -> Path:
    folder = drawn_pictures(tmp_path / "shown", 2)
    (folder / "persons.json").unlink()
    images = [{"id": number, "file_name": f"{number}.png", **(image if number else {})} for number in range(2)]
    boxes = [{"image_id": 1, "category_id": 1, "bbox": [5000, 10, 50, 100], "area": 9, "iscrowd": 0}]
    content = {"images": images, "annotations": boxes, "categories": [{"id": 1, "name": "person"}]}
    (folder / "coco.json").write_text(json.dumps(content))
    return folder


def test_image_of_another_size_is_left_out_and_told(tmp_path):
    [source] = labelled_sources(labelled_folder(tmp_path, width=1920, height=1080))
    [scene] = evaluated([source]).detectors["hog"].scenes.values()
    [clip] = scene.clips
    assert (clip.damaged, clip.missing_frames) == (1, 1)
    assert "has 640x480 pixels, but its labels are for 1920x1080" in clip.first_damage


def test_people_outside_their_image_are_not_scored_but_told(tmp_path):
    [source] = labelled_sources(labelled_folder(tmp_path))
    [scene] = evaluated([source]).detectors["hog"].scenes.values()
    assert scene.clips[0].outside == 1
    assert scene.score.overall.score.fn == 0
