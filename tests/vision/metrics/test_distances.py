"""Distances of labelled people from the depth in a bag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.cli.main import app
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, TruthError
from socialbot.core.messages import CameraInfo, Image, Transform, Transforms
from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.lens import Lens
from socialbot.vision.metrics.frames import BagImages, bag_source
from socialbot.vision.metrics.pipeline import PipelineSettings, SourceCamera, with_distances
from tests.vision.depth_scenes import CAMERA, Blob, Room, box_of, depth_image, render, with_errors
from tests.vision.test_camera import CALIBRATION

DEPTH, RGB, INFO = "/camera/depth/image_raw", "/camera/color/image_raw", "/camera/color/camera_info"
HOG = PipelineSettings("hog")
START = 1_700_000_000 * SECOND
WALK = [Room([Blob(4.0 - index / 4, 0.3), Blob(6.0, -1.5)]) for index in range(5)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five pictures of two people without distances; depth arrives 0.4 s after the pictures."""
    folder = tmp_path_factory.mktemp("depth")
    k = (CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0)
    messages = []
    frames = []
    for index, room in enumerate(WALK):
        stamp = START + index * SECOND // 5
        picture = Image.from_bgr(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), stamp=stamp, frame_id="eye")
        info = CameraInfo(stamp=stamp, frame_id="eye", width=CAMERA.width, height=CAMERA.height, k=k)
        depth = depth_image(with_errors(render(room), index), stamp=stamp)
        messages += [(INFO, info, stamp), (RGB, picture, stamp + SECOND), (DEPTH, depth, stamp + 14 * SECOND // 10)]
        boxes = [dict(zip("xywh", box_of(room, person), strict=True)) for person in range(2)]
        frames.append({"stamp": stamp, "persons": [{"id": f"p{n}", **box} for n, box in enumerate(boxes)]})
    with BagWriter(folder / "walk") as writer:
        for topic, message, time in sorted(messages, key=lambda each: each[2]):
            writer.write(topic, message, time)
    truth = {"schema": "socialbot/truth", "version": 1, "image_topic": RGB, "frames": frames}
    (folder / "labels.json").write_bytes(msgspec.json.encode(truth))
    return folder / "walk"


def labels(bag: Path) -> Path:
    return bag.with_name("labels.json")


@pytest.mark.parametrize("topic", [DEPTH, "/camera/depth"])
def test_unknown_distances_come_from_depth(bag: Path, topic: str) -> None:
    source = bag_source(bag, labels(bag))
    assert {person.distance_m for frame in source.frames for person in frame.persons} == {None}
    for frame, room in zip(with_distances(source, topic, HOG).frames, WALK, strict=True):
        for person, blob in zip(frame.persons, room.people, strict=True):
            assert person.distance_m == pytest.approx(blob.distance, rel=0.05)


def test_known_distances_are_kept(bag: Path, tmp_path: Path) -> None:
    truth = msgspec.json.decode(labels(bag).read_bytes())
    truth["frames"][0]["persons"][0]["distance_m"] = 9.0
    (tmp_path / "labels.json").write_bytes(msgspec.json.encode(truth))
    frames = with_distances(bag_source(bag, tmp_path / "labels.json"), DEPTH, HOG).frames
    assert frames[0].persons[0].distance_m == 9.0
    assert frames[0].persons[1].distance_m == pytest.approx(WALK[0].people[1].distance, rel=0.05)


def test_refuses_topics_without_distances(bag: Path) -> None:
    source = bag_source(bag, labels(bag))
    with pytest.raises(BagError, match="no depth images") as caught:
        with_distances(source, "/camera/depht", HOG)
    assert DEPTH in str(caught.value.remedy)
    nobody = msgspec.structs.replace(source.frames[0].persons[0], x=0.0, y=0.0, w=2.0, h=2.0)
    lost = replace(source, frames=tuple(replace(frame, persons=(nobody,)) for frame in source.frames))
    with pytest.raises(TruthError, match="none of the labelled people"):
        with_distances(lost, DEPTH, HOG)


@pytest.mark.parametrize("known", ["transforms", "settings", "floor", "nothing"])
def test_distances_are_horizontal_from_a_camera_that_looks_down(tmp_path: Path, known: str) -> None:
    """Two people 2 m and 4 m away; nothing is known without transforms if the depth shows nothing but them."""
    camera = CameraModel.from_field_of_view(320, 240, 1.2, CameraPose(height_m=1.4, pitch_rad=0.45))
    room = Room([Blob(2.0, 0.3), Blob(4.0, -0.6)])
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    picture = Image.from_bgr(np.zeros((camera.height, camera.width, 3), np.uint8), stamp=START, frame_id="eye")
    measured = with_errors(render(room, camera))
    if known == "nothing":
        measured[render(room, camera) == render(Room([]), camera)] = 0
    half = 0.45 / 2
    down = (-0.5 * (np.cos(half) + np.sin(half)), 0.5 * (np.cos(half) + np.sin(half)))
    up = (0.5 * (np.cos(half) - np.sin(half)), -0.5 * (np.cos(half) - np.sin(half)))
    turn = Transform(
        stamp=START, parent="base_footprint", child="eye", translation=(0.0, 0.0, 1.4),
        rotation=(down[0], down[1], up[1], up[0]),
    )  # fmt: skip
    boxes = [dict(zip("xywh", box_of(room, person, camera), strict=True)) for person in range(2)]
    frames = [{"stamp": START, "persons": [{"id": f"p{n}", **box} for n, box in enumerate(boxes)]}]
    with BagWriter(tmp_path / "bag") as writer:
        if known == "transforms":
            writer.write("/tf_static", Transforms(stamp=START, transforms=(turn,)), START)
        writer.write(INFO, CameraInfo(stamp=START, frame_id="eye", width=320, height=240, k=k), START)
        writer.write(DEPTH, depth_image(measured, stamp=START), START)
        writer.write(RGB, picture, START + 1)
    truth = {"schema": "socialbot/truth", "version": 1, "image_topic": RGB, "frames": frames}
    (tmp_path / "labels.json").write_bytes(msgspec.json.encode(truth))
    settings = PipelineSettings("hog", {"mount_height_m": 1.4, "pitch_rad": 0.45} if known == "settings" else {})
    source = with_distances(bag_source(tmp_path / "bag", tmp_path / "labels.json"), DEPTH, settings)
    found = [person.distance_m for person in source.frames[0].persons]
    assert any("taken as level" in note for note in source.notes) == (known == "nothing")
    if known != "nothing":
        assert found == pytest.approx([blob.distance for blob in room.people], rel=0.02)


def test_distances_that_stay_unknown_are_told(bag: Path) -> None:
    source = bag_source(bag, labels(bag))
    wall = msgspec.structs.replace(source.frames[0].persons[0], x=0.0, y=0.0, w=2.0, h=2.0)
    extended = replace(source.frames[0], persons=(*source.frames[0].persons, wall))
    notes = with_distances(replace(source, frames=(extended, *source.frames[1:])), DEPTH, HOG).notes
    assert notes == (f"1 of 11 distances stay unknown: {DEPTH} does not measure these people",)


def test_assumed_intrinsics_are_told(bag: Path, tmp_path: Path) -> None:
    assert bag_source(bag, labels(bag)).notes == ()
    for name, info, told in (
        ("none", None, "no camera_info"),
        ("zero", {"k": (0.0,) * 9}, "not calibrated"),
        ("sphere", {"distortion_model": "double_sphere", "d": (0.1, 0.2)}, "'double_sphere' is not known"),
        ("wide", {"width": 640, "height": 360}, "as if the sides of another shape were cut off"),
    ):
        with BagWriter(tmp_path / name) as writer, open_bag(bag) as recorded:
            for topic, message in recorded.messages({INFO: INFO, RGB: RGB}):
                if isinstance(message, CameraInfo):
                    if info is not None:
                        writer.write(topic, msgspec.structs.replace(message, **info), message.stamp)
                else:
                    writer.write(topic, message, message.stamp)
        (note,) = bag_source(tmp_path / name, labels(bag), hfov_rad=1.5).notes
        assert told in note
        assert ("field of view of 1.50 rad" in note) == (name in ("none", "zero"))


def test_calibration_gives_the_intrinsics_of_a_bag_without_camera_info(bag: Path, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer, open_bag(bag) as recorded:
        for topic, message in recorded.messages({RGB: RGB}):
            writer.write(topic, message, message.stamp)
    (tmp_path / "ost.yaml").write_text(CALIBRATION)
    assert bag_source(tmp_path / "bag", labels(bag), calibrated=True).notes == ()
    changed = PipelineSettings("hog", {"camera_info_url": str(tmp_path / "ost.yaml")})
    images = BagImages(str(tmp_path / "bag"), RGB)
    camera, _ = SourceCamera(changed, images).at(next(iter(images.read())), 128, 96)
    assert (camera.fx, camera.cx, camera.lens) == (121, 62, Lens(False, (0.1, -0.25, 0.001, 0, 0)))


def test_command_takes_labels_and_a_depth_topic(bag: Path, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    arguments = ["--truth", str(labels(bag)), "--distance-from", "/camera/depth", "--detector", "hog", "--no-speed"]
    result = CliRunner().invoke(app, ["evaluate", str(bag), *arguments, "--jobs", "1", "--figures", str(figures)])
    assert result.exit_code == 0, result.output
    assert "2-10" in figures.read_text()
