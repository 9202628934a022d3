"""Depth images and point clouds: decoding, and the distances of people."""

from __future__ import annotations

import contextlib
import math
import struct
import time
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError, ParameterError
from socialbot.core.messages import CompressedDepth, DepthImage, DepthInfo, Message, PointCloud, Transform, Transforms
from socialbot.vision.camera import Box, CameraModel, CameraPose
from socialbot.vision.depth import ProjectedPoints, measure_people
from socialbot.vision.depth_images import depth_in_metres, points_of, raw_depth, unpacked_depth
from socialbot.vision.depth_sensors import DepthSensors
from socialbot.vision.distance import Estimate
from socialbot.vision.transforms import AXES
from tests.vision.depth_scenes import (
    CAMERA,
    Blob,
    Room,
    box_of,
    cloud,
    compressed,
    depth_image,
    render,
    scan,
    visible_share,
    with_errors,
)

METRES = np.array([[0.5, 1.234, 0.0], [7.5, 3.0, 19.999]])


def expected(metres: np.ndarray) -> np.ndarray:
    return np.where(metres > 0, metres, np.nan)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_raw_depth_in_both_byte_orders(encoding: str, big: bool, padding: int) -> None:
    image = depth_image(METRES, encoding=encoding, big=big, padding=padding)
    assert depth_in_metres(raw_depth(image)) == pytest.approx(expected(METRES), abs=1e-6, nan_ok=True)


def test_invalid_measurements_are_nan() -> None:
    odd = np.array([[np.nan, np.inf, -np.inf, -1.0, 0.0, 1e9, 2.0]])
    image = DepthImage(
        stamp=0, frame_id="", height=1, width=7, encoding="32FC1", step=28, data=odd.astype("<f4").view(np.uint8)[0]
    )
    assert np.isfinite(depth_in_metres(raw_depth(image))).tolist() == [[False] * 6 + [True]]
    full = np.array([[65535, 2000]], "<u2").view(np.uint8)[0]
    image = DepthImage(stamp=0, frame_id="", height=1, width=2, encoding="16UC1", step=4, data=full)
    assert np.isfinite(depth_in_metres(raw_depth(image))).tolist() == [[False, True]]


@pytest.mark.parametrize(
    ("change", "what"), [({"encoding": "rgb8"}, "rgb8"), ({"step": 3}, "bytes"), ({"height": 9}, "do not fill")]
)
def test_refuses_what_is_no_depth_image(change: dict[str, Any], what: str) -> None:
    image = depth_image(METRES)
    fields = {name: getattr(image, name) for name in image.__struct_fields__} | change
    with pytest.raises(ImageError, match=what):
        depth_in_metres(raw_depth(DepthImage(**fields)))


def png(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


MILLIMETRES = np.round(METRES * 1000).astype(np.uint16)
A, B = 100 * (100 + 1), 1 + 100.0 / 10  # as compressed_depth_image_transport computes them: depth 10 m, step 100


def quantised(metres: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.where(metres > 0, A / metres + B, 0).astype(np.uint16)


@pytest.mark.parametrize("form", ["16UC1; compressedDepth", "16UC1; compressedDepth png", "mono16; compressedDepth"])
@pytest.mark.parametrize("parameters", [(0.0, 0.0), (3.5, 7.0)])
def test_compressed_depth_in_millimetres(form: str, parameters: tuple[float, float]) -> None:
    image = compressed(form, struct.pack("<iff", 0, *parameters) + png(MILLIMETRES))
    assert depth_in_metres(unpacked_depth(image)) == pytest.approx(expected(METRES), abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("form", ["32FC1; compressedDepth", "passthrough; compressedDepth"])
def test_compressed_depth_with_inverse_quantisation(form: str) -> None:
    image = compressed(form, struct.pack("<iff", 0, A, B) + png(quantised(METRES)))
    found = depth_in_metres(unpacked_depth(image))
    assert found == pytest.approx(expected(METRES), rel=0.05, nan_ok=True)


@pytest.mark.parametrize("form", ["passthrough; compressedDepth", "16UC1; png compressed ", "png", ""])
def test_bare_png_is_in_millimetres(form: str) -> None:
    header = struct.pack("<iff", 0, 0.0, 0.0) if "compressedDepth" in form else b""
    found = depth_in_metres(unpacked_depth(compressed(form, header + png(MILLIMETRES))))
    assert found == pytest.approx(expected(METRES), abs=1e-6, nan_ok=True)


def rvl(pixels: np.ndarray) -> bytes:
    """Encode as RVL does: runs of zeros, then differences as zigzag numbers in nibbles."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while True:
            nibble, number = number & 7, number >> 3
            nibbles.append(nibble | (8 if number else 0))
            if not number:
                return

    flat = pixels.reshape(-1).astype(int).tolist()
    at, last = 0, 0
    while at < len(flat):
        zeros = next((n for n, value in enumerate(flat[at:]) if value), len(flat) - at)
        filled = next((n for n, value in enumerate(flat[at + zeros :]) if not value), len(flat) - at - zeros)
        put(zeros)
        put(filled)
        for value in flat[at + zeros : at + zeros + filled]:
            put((value - last) << 1 if value >= last else ((last - value) << 1) - 1)
            last = value
        at += zeros + filled
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        sum(nibble << (28 - 4 * n) for n, nibble in enumerate(nibbles[i : i + 8])) for i in range(0, len(nibbles), 8)
    ]
    return struct.pack("<II", pixels.shape[1], pixels.shape[0]) + struct.pack(f"<{len(words)}I", *words)


@given(st.lists(st.one_of(st.just(0), st.integers(150, 60000)), min_size=1, max_size=60), st.integers(1, 6))
def test_rvl(values: list[int], width: int) -> None:
    pixels = np.array(values[: max(len(values) // width, 1) * width][: len(values)], np.uint16)
    pixels = pixels[: len(pixels) // width * width].reshape(-1, width) if len(pixels) >= width else pixels[None]
    image = compressed("16UC1; compressedDepth rvl", struct.pack("<iff", 1, 0, 0) + rvl(pixels))
    found = depth_in_metres(unpacked_depth(image))
    assert found == pytest.approx(expected(pixels / 1000), abs=1e-5, nan_ok=True)


@pytest.mark.parametrize(
    ("form", "data", "what"),
    [
        ("16UC1; compressedDepth", b"", "neither PNG nor RVL"),
        ("16UC1; compressedDepth", bytes(12) + png(MILLIMETRES)[:40], "damaged"),
        ("16UC1; compressedDepth", bytes(12) + png(np.zeros((2, 2, 3), np.uint8)), "no depth image"),
        ("16UC1; jpeg compressed", b"\xff\xd8\xff", "JPEG destroys depth"),
        ("16UC1; compressedDepth", bytes(12) + png(MILLIMETRES)[:60] + b"IEND" + bytes(4), "damaged"),
        ("16UC1; compressedDepth rvl", bytes(12) + struct.pack("<II", 4, 4) + b"\xff" * 8, "damaged"),
        ("16UC1; compressedDepth rvl", bytes(12) + struct.pack("<II", 1 << 30, 4), "cannot be"),
        ("16UC1; compressedDepth rvl", bytes(12) + struct.pack("<II", 4, 4) + bytes(200), "too many"),
        ("16UC1; compressedDepth rvl", bytes(12) + struct.pack("<II", 4, 4) + bytes(64), "damaged"),
        ("32FC1; compressedDepth", bytes(12) + png(MILLIMETRES), "quantisation"),
    ],
)  # fmt: skip
def test_refuses_damaged_compressed_depth(form: str, data: bytes, what: str) -> None:
    with pytest.raises(ImageError, match=what):
        depth_in_metres(unpacked_depth(compressed(form, data)))


@pytest.mark.parametrize("groups", [b"\0\0\0\0", b"\x10\x10\x10\x10", b"\x11\x01\x11\x01"])
def test_runs_of_rvl_take_little_time(groups: bytes) -> None:
    """Runs without pixels, and runs of one."""
    image = compressed("16UC1; compressedDepth rvl", bytes(12) + struct.pack("<II", 640, 480) + groups * 300_000)
    begin = time.process_time()
    with contextlib.suppress(ImageError):
        depth_in_metres(unpacked_depth(image))
    assert time.process_time() - begin < 1.0


@given(st.binary(max_size=80), st.sampled_from(["16UC1; compressedDepth rvl", "32FC1; compressedDepth", "png", ""]))
def test_any_bytes_are_decoded_or_refused(data: bytes, form: str) -> None:
    with contextlib.suppress(ImageError):
        depth_in_metres(unpacked_depth(compressed(form, data)))


POINTS = np.array([[1.0, 2.0, 3.0], [-4.5, 0.25, 9.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    "layout",
    [{}, {"kind": "f8", "step": 40}, {"fields": "zyx"}, {"offset": 10, "step": 23}, {"offset": 20, "step": 32}],
)
def test_points_in_any_layout(big: bool, layout: dict[str, Any]) -> None:
    assert points_of(cloud(POINTS, big=big, **layout)) == pytest.approx(POINTS)


def test_points_of_an_organised_cloud_with_padded_rows() -> None:
    flat = cloud(np.vstack([POINTS, POINTS * np.nan, POINTS])[:6])
    rows = np.pad(flat.data.reshape(2, -1), ((0, 0), (0, 7))).reshape(-1)
    fields = {name: getattr(flat, name) for name in flat.__struct_fields__}
    fields |= {"height": 2, "width": 3, "row_step": 3 * 32 + 7, "data": rows}
    assert points_of(PointCloud(**fields)) == pytest.approx(POINTS)


@pytest.mark.parametrize("change", [{"width": 99}, {"fields": ()}, {"point_step": 8}, {"data": np.zeros(3, np.uint8)}])
def test_refuses_clouds_without_points(change: dict[str, Any]) -> None:
    flat = cloud(POINTS)
    with pytest.raises(ImageError, match="point cloud"):
        points_of(PointCloud(**{name: getattr(flat, name) for name in flat.__struct_fields__} | change))


# Distances of people


def guessed(distance: float, share: float = 0.25) -> Estimate:
    """Distance from the image, with a relative standard error."""
    return Estimate(distance, share * distance)


def measured(
    room: Room,
    sensors: DepthSensors,
    *,
    guess: float = 1.0,
    boxes: list[Box] | None = None,
    camera: CameraModel = CAMERA,
) -> list[tuple[float, float] | None]:
    """Distance and standard error of each person; the image says ``guess`` times their distance."""
    given_boxes = boxes or [box_of(room, index) for index in range(len(room.people))]
    images = sensors.at(0, "eye", camera)
    guesses = [guessed(person.distance * guess) for person in room.people]
    found = measure_people(images, camera, given_boxes, guesses)
    return [each and (each.estimate.value, each.estimate.std) for each in found]


def with_depth(room: Room, *messages: Message, seed: int = 0, **errors: float) -> DepthSensors:
    sensors = DepthSensors()
    for message in messages or (depth_image(with_errors(render(room), seed, **errors)),):
        sensors.take(message)
    return sensors


ROOMS = [
    Room([Blob(1.0)]), Room([Blob(2.0, 0.5)]), Room([Blob(4.0, -1.0)], wall=4.6), Room([Blob(7.0, 1.0)], wall=20.0),
    Room([Blob(3.6, seated=True)], wall=6.0), Room([Blob(2.5)], table=(1.5, 2.0, 0.8)), Room([Blob(3.0, height=1.1)]),
    Room([Blob(2.0), Blob(4.0, 0.35)]), Room([Blob(3.0, 0.3), Blob(3.1, -0.3)]), Room([Blob(5.0), Blob(2.0, 0.9)]),
    Room([Blob(6.0, -2.0)], table=(2.0, 4.0, 0.9)),
]  # fmt: skip


@pytest.mark.parametrize("guess", [0.6, 1.0, 1.6])
@pytest.mark.parametrize("room", ROOMS, ids=range(len(ROOMS)))
def test_distance_of_people_in_depth_with_errors(room: Room, guess: float) -> None:
    found = measured(room, with_depth(room, holes=0.15), guess=guess)
    for person, each in zip(room.people, found, strict=True):
        assert each is not None
        distance, std = each
        assert distance == pytest.approx(person.distance, rel=0.06, abs=0.04)
        assert abs(distance - person.distance) < 2.5 * std


@given(
    ahead=st.floats(0.8, 8.0), left=st.floats(-0.35, 0.35), wall=st.floats(0.3, 8.0), guess=st.floats(0.6, 1.7),
    shift=st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1)), grow=st.floats(0.85, 1.25), seed=st.integers(0, 99),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_distance_with_imprecise_boxes(
    ahead: float, left: float, wall: float, guess: float, shift: tuple[float, float], grow: float, seed: int
) -> None:
    room = Room([Blob(ahead, left * ahead)], wall=ahead + wall)
    x, y, w, h = box_of(room, 0)
    box = (x + w * (shift[0] + (1 - grow) / 2), y + h * (shift[1] + (1 - grow) / 2), w * grow, h * grow)
    (found,) = measured(room, with_depth(room, seed=seed), guess=guess, boxes=[box])
    assert found is not None
    assert found[0] == pytest.approx(room.people[0].distance, rel=0.12, abs=0.05)


def test_two_boxes_of_one_person_have_one_distance() -> None:
    room = Room([Blob(3.0)], wall=4.5)
    x, y, w, h = box_of(room, 0)
    images = with_depth(room).at(0, "eye", CAMERA)
    found = measure_people(images, CAMERA, [(x, y, w, h), (x - w / 8, y, w, 0.9 * h)], [guessed(3.0), guessed(4.5)])
    assert [each and each.estimate.value for each in found] == pytest.approx([3.0, 3.0], rel=0.05)


def test_a_person_in_front_hides_most_of_the_box_behind() -> None:
    room = Room([Blob(2.0), Blob(4.0, 0.35)])
    for guess in (0.6, 1.0, 1.6):
        found = measured(room, with_depth(room), guess=guess)
        assert [each and each[0] for each in found] == pytest.approx([2.0, math.hypot(4.0, 0.35)], rel=0.06)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("grow", [0.6, 1.0, 1.25])
def test_the_wall_does_not_become_a_second_person(first: int, grow: float) -> None:
    """The second box of a seated person contains mainly the wall, whose distance fits the image better."""
    room = Room([Blob(4.5, 0.3, seated=True)], wall=6.0)
    x, y, w, h = box_of(room, 0)
    boxes = [(x, y, w, h), (x + w / 10 - w * (grow - 1) / 2, y, w * grow, h * grow)]
    boxes.insert(0, boxes.pop(first))
    images = with_depth(room, holes=0.0).at(0, "eye", CAMERA)
    found = measure_people(images, CAMERA, boxes, [guessed(6.2, 0.1)] * 2)
    assert [each and each.estimate.value for each in found] == pytest.approx([room.people[0].distance] * 2, rel=0.06)


@pytest.mark.parametrize("left", [-1.0, 1.0])
def test_person_at_the_edge_of_the_image(left: float) -> None:
    room = Room([Blob(2.0, left)], wall=2.8)
    (found,) = measured(room, with_depth(room), guess=1.5)
    assert found is not None
    assert found[0] == pytest.approx(room.people[0].distance, rel=0.06)


def test_people_who_stand_side_by_side() -> None:
    """An undetected neighbour at the same distance does not make a person background."""
    room = Room([Blob(3.0, 0.5), Blob(3.0, 0.0), Blob(3.0, -0.5)], wall=5.0)
    found = measured(room, with_depth(room), boxes=[box_of(room, 1)])
    assert found[0] is not None
    assert found[0][0] == pytest.approx(3.0, rel=0.06)


@pytest.mark.parametrize("guess", [0.6, 1.0, 1.6])
def test_depth_without_any_background(guess: float) -> None:
    room = Room([Blob(3.0)])
    flat = np.full((CAMERA.height, CAMERA.width), 2.9)
    found = measured(room, with_depth(room, depth_image(flat)), guess=guess)
    assert found[0] is not None
    assert found[0][0] == pytest.approx(3.0, rel=0.06)


def test_person_out_of_range_keeps_the_distance_of_the_image() -> None:
    room = Room([Blob(7.0)], wall=12.0, table=(2.0, 2.5, 0.7))
    assert measured(room, with_depth(room, farthest=4.5)) == [None]
    room = Room([Blob(3.0)])
    assert measured(room, with_depth(room, holes=1.0)) == [None]


@pytest.mark.parametrize("size", [(320, 240), (160, 120), (848, 636), (640, 480)])
def test_registered_depth_of_another_resolution(size: tuple[int, int]) -> None:
    room = Room([Blob(3.0, 0.5)])
    sensors = with_depth(room, depth_image(with_errors(render(room, CAMERA.scaled(*size)))))
    (found,) = measured(room, sensors)
    assert found is not None
    assert found[0] == pytest.approx(room.people[0].distance, rel=0.05)


def info_of(camera: CameraModel, frame: str) -> DepthInfo:
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    return DepthInfo(stamp=0, frame_id=frame, width=camera.width, height=camera.height, k=k)


def transform(
    parent: str, child: str, at: tuple[float, float, float], turn: tuple[float, ...] = (0, 0, 0, 1)
) -> Transform:
    return Transform(stamp=0, parent=parent, child=child, translation=at, rotation=(turn[0], turn[1], turn[2], turn[3]))


def test_depth_of_another_camera_is_projected() -> None:
    room = Room([Blob(2.5, 0.4)])
    depth_camera = CameraModel(
        400.0, 400.0, 320.0, 200.0, 640, 400, CameraPose(height_m=CAMERA.pose.height_m, pitch_rad=CAMERA.pose.pitch_rad)
    )
    image = depth_image(with_errors(render(room, depth_camera)), frame="depth_optical_frame")
    info, pose = (
        info_of(depth_camera, "depth_optical_frame"),
        Transforms(stamp=0, transforms=(transform("eye", "depth_optical_frame", (0.02, 0.0, 0.0)),)),
    )
    (found,) = measured(room, with_depth(room, info, pose, image))
    assert found is not None
    assert found[0] == pytest.approx(room.people[0].distance, rel=0.05)


def test_depth_of_a_rear_camera_of_the_same_kind_says_nothing() -> None:
    room, behind = Room([Blob(2.5)]), Room([Blob(3.5)])
    image = depth_image(with_errors(render(behind, CAMERA)), frame="rear_eye")
    rear = Transforms(stamp=0, transforms=(transform("eye", "rear_eye", (0.0, 0.0, -0.4), (0, 1, 0, 0)),))
    assert measured(room, with_depth(room, info_of(CAMERA, "rear_eye"), rear, image)) == [None]


@pytest.mark.parametrize("placed", [False, True])
def test_aligned_depth_may_have_a_frame_of_its_own(placed: bool, caplog: pytest.LogCaptureFixture) -> None:
    room = Room([Blob(2.5)])
    image = depth_image(with_errors(render(room, CAMERA)), frame="aligned_depth_to_color")
    tree = [Transforms(stamp=0, transforms=(transform("eye", "aligned_depth_to_color", (0.0, 0.0, 0.0)),))]
    with caplog.at_level("WARNING"):
        (found,) = measured(room, with_depth(room, info_of(CAMERA, "aligned"), *tree[: int(placed)], image))
    assert found is not None
    assert found[0] == pytest.approx(2.5, rel=0.05)
    assert ["taken as registered" in record.message for record in caplog.records] == [True] * (not placed)


@pytest.mark.parametrize("placed", [False, True])
def test_depth_of_another_shape_is_not_registered(placed: bool) -> None:
    """Scaled to the height of the picture and cut off at the sides, its intrinsics would be those of the picture."""
    room = Room([Blob(2.5, 0.9)])
    wide = CameraModel(
        CAMERA.fx / 2, CAMERA.fy / 2, 106.0, 60.0, 212, 120, CameraPose(height_m=1.3, pitch_rad=CAMERA.pose.pitch_rad)
    )
    image = depth_image(with_errors(render(room, wide)), frame="depth")
    tree = [Transforms(stamp=0, transforms=(transform("eye", "depth", (0.0, 0.0, 0.0)),))]
    (found,) = measured(room, with_depth(room, info_of(wide, "depth"), *tree[: int(placed)], image))
    assert (found is not None) == placed
    assert found is None or found[0] == pytest.approx(room.people[0].distance, rel=0.05)


def test_unregistered_depth_is_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    room = Room([Blob(2.5)])
    other = CameraModel(400.0, 400.0, 320.0, 200.0, 640, 400)
    image = depth_image(render(room, other), frame="depth_frame")
    with caplog.at_level("WARNING"):
        assert measured(room, with_depth(room, info_of(other, "depth_frame"), image)) == [None]
        assert measured(room, with_depth(room, image)) == [None]
    assert all("depth_frame" in record.message and "/tf" in record.message for record in caplog.records)


# From the axes of a lidar (ahead, left, up) to those of a level camera, as a quaternion of the camera in the lidar.
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
LEVEL = CameraModel.from_field_of_view(320, 240, 1.09, CameraPose(height_m=1.3, pitch_rad=0.0))


@pytest.mark.parametrize("ahead", [1.5, 3.0, 6.0, 9.0])
@pytest.mark.parametrize("given_pose", [False, True])
def test_lidar(ahead: float, given_pose: bool) -> None:
    room = Room([Blob(ahead, 0.4)], wall=15.0)
    points = cloud(scan(room, 0.9), big=ahead > 4)
    sensors = DepthSensors()
    if given_pose:
        sensors.set_pose("0 0 -0.4 0 0 0")
    else:
        tree = (transform("base", "lidar", (0, 0, 0.9)), transform("base", "eye", (0, 0, 1.3), OPTICAL))
        sensors.take(Transforms(stamp=0, transforms=tree))
    sensors.take(points)
    box = box_of(room, 0, LEVEL)
    (found,) = measured(room, sensors, guess=1.4, boxes=[box], camera=LEVEL)
    assert found is not None
    assert found[0] == pytest.approx(room.people[0].distance, rel=0.05)
    assert sensors.at(0, "eye", LEVEL)[0].source == "lidar"


@pytest.mark.parametrize("rings", [16, *(pytest.param(rings, marks=pytest.mark.slow) for rings in (32, 64))])
def test_lidar_with_floor_wall_and_occluders(rings: int) -> None:
    """Visible people are precise up to 15 m; up to 30 m, a distance is stated with an honest error, or none."""
    random = np.random.default_rng(3)
    errors: list[float] = []
    honest: list[bool] = []
    for ahead in (3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 20.0, 29.0):
        people = [Blob(ahead, 0.2 * ahead, seated=ahead == 6.0), Blob(ahead, -0.05 * ahead), Blob(0.7 * ahead)]
        room = Room(people, wall=ahead + 1.5, table=(0.5 * ahead, 0.5 * ahead + 0.7, 0.75))
        ahead_left_up = scan(room, 1.0, rings=rings)
        points = np.stack([-ahead_left_up[:, 1], 0.3 - ahead_left_up[:, 2], ahead_left_up[:, 0]], axis=1)
        # The nearest person is not detected.
        visible = [index for index in (0, 1) if visible_share(room, index, LEVEL) > 0.5]
        boxes = [box_of(room, index, LEVEL) for index in visible]
        guesses = [guessed(ahead * math.exp(random.normal(0, 0.2)), 0.2) for _ in visible]
        found = measure_people([ProjectedPoints(points.astype(np.float32))], LEVEL, boxes, guesses)
        for index, each in zip(visible, found, strict=True):
            if each is None:
                assert ahead > 15
                continue
            error = abs(each.estimate.value - people[index].distance)
            honest.append(error < 2 * each.estimate.std)
            if ahead < 15:
                errors.append(error / people[index].distance)
    assert len(errors) > 6
    assert np.median(errors) < 0.02
    assert np.quantile(errors, 0.9) < 0.05
    assert np.mean(honest) >= 0.9


@pytest.mark.parametrize(
    ("image", "sensor", "axes", "tree"),
    [
        ("camera_link", "camera_link", "body", ()),
        ("camera_link_optical", "camera_link_optical", "body", ()),  # Gazebo
        ("rgb_camera_link", "rgb_camera_link", "optical", ()),
        ("rgb_camera_link", "depth_camera_link", "optical", ((0.03, 0.004, 0.002), (0, 0, 0, 1))),  # Azure Kinect
        ("camera_link", "depth_link", "body", ((0.002, 0.03, 0.004), (0, 0, 0, 1))),
        ("rgb_optical", "depth_optical", "optical", ((0.03, 0.004, 0.002), (0, 0, 0, 1))),
        ("rgb_optical", "depth_optical", "body", ((0.03, 0.004, 0.002), (0, 0, 0, 1))),
        ("left_optical", "left_frame", "body", ((0.0, 0.0, 0.0), (0.5, -0.5, 0.5, 0.5))),  # ZED
    ],
)
@pytest.mark.parametrize("left", [-0.6, 0.5])
def test_axes_of_a_cloud_follow_from_its_points(
    image: str, sensor: str, axes: str, tree: tuple[Any, ...], left: float
) -> None:
    room = Room([Blob(2.5, left)], wall=6.0)
    depth = render(room)
    rows, columns = np.indices(depth.shape)
    x, y = CAMERA.points(columns + 0.5, rows + 0.5)
    points = np.stack([x * depth, y * depth, depth], axis=-1).reshape(-1, 3)
    if axes == "body":
        points = points @ AXES[:3, :3]
    sensors = DepthSensors()
    if tree:
        sensors.take(Transforms(stamp=0, transforms=(transform(image, sensor, *tree),)))
    organised = {"height": CAMERA.height, "width": CAMERA.width, "row_step": 32 * CAMERA.width}
    sensors.take(msgspec.structs.replace(cloud(points, frame=sensor), **organised))
    ranges = sensors.at(0, image, CAMERA)
    (found,) = measure_people(ranges, CAMERA, [box_of(room, 0)], [guessed(2.0)])
    assert found is not None
    assert found.estimate.value == pytest.approx(room.people[0].distance, rel=0.05)
    assert found.source == "depth"


def test_axes_of_a_lidar_follow_from_its_frame() -> None:
    room = Room([Blob(3.0, 0.4)], wall=6.0)
    points = scan(room, 0.3, rings=32)
    points = np.concatenate([points[points[:, 2] > 0], points[points[:, 2] > 0] * [-1, -1, 1]])  # without the floor
    sensors = DepthSensors()
    sensors.take(Transforms(stamp=0, transforms=(transform("camera_link", "lidar", (0.0, 0.0, -1.0)),)))
    sensors.take(cloud(points))
    (found,) = measure_people(sensors.at(0, "camera_link", LEVEL), LEVEL, [box_of(room, 0, LEVEL)], [guessed(3.0)])
    assert found is not None
    assert found.estimate.value == pytest.approx(room.people[0].distance, rel=0.05)
    assert found.source == "lidar"


def test_a_damaged_sensor_leaves_the_other_one(caplog: pytest.LogCaptureFixture) -> None:
    room = Room([Blob(3.0)], wall=15.0)
    sensors = DepthSensors()
    sensors.set_pose("0 0 -0.4 0 0 0")
    sensors.take(CompressedDepth(stamp=0, frame_id="eye", format="16UC1; compressedDepth", data=np.zeros(4, np.uint8)))
    sensors.take(cloud(scan(room, 0.9)))
    with caplog.at_level("WARNING"):
        assert [each.source for each in sensors.at(0, "eye", LEVEL)] == ["lidar"]
    assert len(caplog.records) == 1


def test_lidar_without_enough_points() -> None:
    room = Room([Blob(12.0)], wall=60.0)
    box = box_of(room, 0, LEVEL)
    points = np.array([[0.0, 0.0, 11.9], [0.0, 0.1, 11.9], [5.0, 0.0, 11.9]], np.float32)
    assert measure_people([ProjectedPoints(points)], LEVEL, [box], [guessed(12.0)]) == [None]


def test_lidar_without_a_transform_is_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    room = Room([Blob(3.0)])
    with caplog.at_level("WARNING"):
        sensors = with_depth(room, cloud(scan(room, 0.9), frame="velodyne"))
        assert [measured(room, sensors) for _ in range(3)] == [[None]] * 3
    assert "velodyne" in caplog.records[0].message
    assert all(word in caplog.records[0].message for word in ("depth_pose", "tf2_msgs"))
    assert len(caplog.records) == 1


def test_depth_is_taken_by_stamp() -> None:
    sensors = DepthSensors()
    for index in range(10):
        room = Room([Blob(2.0 + index / 2)])
        sensors.take(depth_image(render(room), stamp=index * SECOND))
    for stamp, distance in ((3 * SECOND, 3.5), (9 * SECOND - SECOND // 10, 6.5)):
        room = Room([Blob(distance)])
        found = measure_people(sensors.at(stamp, "eye", CAMERA), CAMERA, [box_of(room, 0)], [guessed(distance)])
        if stamp > 7 * SECOND:
            assert found[0] is not None
            assert found[0].estimate.value == pytest.approx(distance, rel=0.05)
        else:
            assert found == [None], "only the latest images are kept"
    assert sensors.at(9 * SECOND - SECOND // 2, "eye", CAMERA) == ()


def test_damaged_depth_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    sensors = DepthSensors()
    sensors.take(CompressedDepth(stamp=0, frame_id="eye", format="16UC1; compressedDepth", data=np.zeros(4, np.uint8)))
    with caplog.at_level("WARNING"):
        assert [sensors.at(0, "eye", CAMERA) for _ in range(3)] == [(), (), ()]
    assert len(caplog.records) == 1


def test_malformed_pose() -> None:
    with pytest.raises(ParameterError, match="no pose"):
        DepthSensors().set_pose("1 2 3")
