from __future__ import annotations

import math
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import CameraInfo
from socialbot.vision.camera import (
    USUAL_HFOV_RAD,
    CameraModel,
    CameraPose,
    intrinsics_problems,
    lens_error_rad,
    read_calibration,
    scaled_info,
    without_lens,
)
from socialbot.vision.lens import Lens
from socialbot.vision.motion import moved

PITCHES = [0.0, 0.052, 0.2, 0.4]


def camera(pitch: float = 0.0, height: float = 1.62) -> CameraModel:
    return CameraModel(525, 530, 322, 238, 640, 480, CameraPose(height_m=height, pitch_rad=pitch))


def project(model: CameraModel, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of ``points`` (n, 3) in the robot frame, by a rotation matrix and the pinhole equations."""
    c, s = math.cos(model.pose.pitch_rad), math.sin(model.pose.pitch_rad)
    tilt = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    seen = (points - [0, 0, model.pose.height_m]) @ tilt
    forward, left, up = seen.T
    return np.stack([model.cx - model.fx * left / forward, model.cy - model.fy * up / forward], axis=1)


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(1, 30), st.sampled_from(PITCHES))
def test_direction_is_the_inverse_of_projection(bearing, elevation, distance, pitch):
    model = camera(pitch)
    flat = distance * math.cos(elevation)
    point = [flat * math.cos(bearing), flat * math.sin(bearing), 1.62 + distance * math.sin(elevation)]
    (u, v), *_ = project(model, np.array([point]))
    assert model.direction(u, v) == pytest.approx((bearing, elevation), abs=1e-9)


def test_signs_follow_rep_103():
    model = camera(0.1)
    assert model.direction(model.cx, model.cy) == pytest.approx((0.0, -0.1))
    assert model.direction(100, 240)[0] > 0 > model.direction(500, 240)[0]
    assert model.direction(320, 100)[1] > model.direction(320, 400)[1]


@pytest.mark.parametrize("pitch", PITCHES)
def test_horizon_is_where_the_elevation_is_zero(pitch):
    model = camera(pitch)
    assert model.direction(model.cx, model.horizon * model.height)[1] == pytest.approx(0.0, abs=1e-12)


_POSES = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.2, 0.4), st.floats(-0.3, 0.3))  # Yaw, pitch and roll.


@settings(max_examples=100, deadline=None)
@given(_POSES, _POSES, st.floats(0, 639), st.floats(0, 479))
def test_turn_moves_a_far_point_to_where_the_turned_camera_shows_it(first, second, u, v):
    before, after = (
        replace(camera(), pose=CameraPose(height_m=1.62, pitch_rad=pitch, roll_rad=roll), yaw_rad=yaw)
        for yaw, pitch, roll in (first, second)
    )
    turn = after.turn_from(before)
    assert turn is not None
    (there,) = moved(turn, np.array([[u, v]]))
    bearing, elevation = before.direction(u, v)
    expected = bearing + first[0] - second[0], elevation
    assert after.direction(*there) == pytest.approx(expected, abs=1e-6)


def test_turn_needs_both_directions():
    known, unknown = replace(camera(), yaw_rad=0.1), camera()
    assert known.turn_from(unknown) is None
    assert unknown.turn_from(known) is None


@pytest.mark.parametrize(
    ("lens", "is_known"),
    [
        (None, True),
        (Lens(False, (-0.02, 0.0, 0.0, 0.0, 0.0)), True),
        (Lens(False, (-0.3, 0.1, 0.0, 0.0, 0.0)), False),
        (Lens(True, (0.0, 0.0, 0.0, 0.0)), False),
    ],
    ids=["pinhole", "slightly bent", "strongly bent", "fisheye"],
)
def test_turn_moves_the_edges_rightly_or_is_unknown(lens, is_known):
    before = CameraModel(
        300.0, 300.0, 320.0, 240.0, 640, 480, CameraPose(height_m=1.2, pitch_rad=0.0), yaw_rad=0.1, lens=lens
    )
    after = replace(before, yaw_rad=0.0)
    turn = after.turn_from(before)
    assert (turn is not None) == is_known
    if turn is not None:
        for edge in ((5.0, 20.0), (600.0, 240.0), (320.0, 460.0)):
            (there,) = moved(turn, np.array([edge]))
            bearing, elevation = before.direction(*edge)
            assert after.direction(*there) == pytest.approx((bearing + 0.1, elevation), abs=0.02)


def info(k: tuple[float, ...], width: int = 640, height: int = 480) -> CameraInfo:
    return CameraInfo(stamp=0, frame_id="eye", width=width, height=height, k=k)


def test_from_info():
    model = CameraModel.from_info(info((500, 0, 310, 0, 510, 250, 0, 0, 1)), CameraPose(height_m=1.0, pitch_rad=0.2))
    assert model == CameraModel(500, 510, 310, 250, 640, 480, CameraPose(height_m=1.0, pitch_rad=0.2))


@pytest.mark.parametrize(
    "bad",
    [
        info((0.0,) * 9),
        info((500, 0, 310, 0, 0, 250, 0, 0, 1)),
        info((math.nan, 0, 310, 0, 500, 250, 0, 0, 1)),
        info((500, 0, 310, 0, 500, 250, 0, 0, 1), width=0),
        info((1.0, 2.0)),
        info(()),
    ],
)
def test_uncalibrated_info_is_refused(bad):
    with pytest.raises(MessageError, match="eye"):
        CameraModel.from_info(bad)


def test_from_field_of_view():
    model = CameraModel.from_field_of_view(640, 480, 1.2, CameraPose(height_m=1.2, pitch_rad=0.0))
    assert model.direction(0, 240)[0] == pytest.approx(0.6)
    assert model.direction(640, 240)[0] == pytest.approx(-0.6)
    assert model.fx == model.fy


def test_upright_images_of_an_unknown_camera_have_the_lens_of_the_others():
    across = CameraModel.from_field_of_view(1920, 1080, USUAL_HFOV_RAD)
    upright = CameraModel.from_field_of_view(1080, 1920, USUAL_HFOV_RAD)
    assert upright.fx == across.fx
    assert CameraModel.from_field_of_view(1080, 1920, 0.7).hfov_rad == pytest.approx(0.7)


@pytest.mark.parametrize("hfov", [0.0, -1.0, math.pi, 4.0, math.nan])
def test_impossible_field_of_view_is_refused(hfov):
    with pytest.raises(ParameterError):
        CameraModel.from_field_of_view(640, 480, hfov)


@pytest.mark.parametrize(("name", "value"), [("fx", 0.0), ("height", 0), ("fy", math.inf)])
def test_impossible_camera_is_refused(name, value):
    fields = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480, name: value}
    with pytest.raises(ParameterError, match=name):
        CameraModel(**fields)


def test_camera_below_the_floor_is_refused():
    with pytest.raises(ParameterError, match="height_m"):
        camera(height=-1.0)


def test_scaling_keeps_directions():
    model = camera(0.1)
    half = model.scaled(320, 240)
    assert half.direction(100, 100) == pytest.approx(model.direction(200, 200))
    assert (half.width, half.height) == (320, 240)


@pytest.mark.parametrize(("width", "height", "left", "top"), [(640, 360, 0, 60), (320, 180, 0, 60), (480, 480, 80, 0)])
def test_images_of_another_shape_are_cut_off_at_both_sides(width, height, left, top):
    model = camera(0.1)
    other = model.scaled(width, height)
    scale = (640 - 2 * left) / width
    assert other.direction(100, 50) == pytest.approx(model.direction(left + 100 * scale, top + 50 * scale))
    assert other.fx / other.fy == pytest.approx(model.fx / model.fy)


@pytest.mark.parametrize("binning", [1, 2])
def test_a_region_of_interest_moves_the_axis(binning):
    whole = info((500, 0, 310, 0, 510, 250, 0, 0, 1))
    part = msgspec.structs.replace(whole, roi=(200, 100, 320, 240))
    pose = CameraPose(height_m=1.0, pitch_rad=0.1)
    model = CameraModel.of_images(part, 320 // binning, 240 // binning, hfov_rad=1.0, pose=pose)
    expected = CameraModel.from_info(whole, pose).direction(200 + 80, 100 + 60)
    assert model.direction(80 / binning, 60 / binning) == pytest.approx(expected)


def test_an_uncalibrated_camera_has_the_given_field_of_view():
    pose = CameraPose(height_m=1.0, pitch_rad=0.1)
    model = CameraModel.of_images(info((0.0,) * 9), 640, 480, hfov_rad=1.2, pose=pose)
    assert model == CameraModel.from_field_of_view(640, 480, 1.2, pose)
    assert model.hfov_rad == pytest.approx(1.2)


def calibrated(model: str, *d: float, focal: float = 300.0) -> CameraInfo:
    k = (focal, 0.0, 320.0, 0.0, focal, 240.0, 0.0, 0.0, 1.0)
    return CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=k, d=d, distortion_model=model)


@pytest.mark.parametrize(
    ("info", "error"),
    [
        (calibrated("plumb_bob", 0.0, 0.0, 0.0, 0.0, 0.0), 0.0),
        (calibrated("plumb_bob"), 0.0),
        (calibrated("who knows", 1.0, 1.0, 1.0, 1.0), 0.0),
        # A point at the radius r of an ideal fisheye is at the angle r; a pinhole has it at atan(r).
        (calibrated("equidistant", 0.0, 0.0, 0.0, 0.0), 320 / 300 - math.atan(320 / 300)),
        (calibrated("equidistant"), 320 / 300 - math.atan(320 / 300)),
    ],
)
def test_error_of_a_lens_taken_as_a_pinhole(info: CameraInfo, error: float):
    assert lens_error_rad(info) == pytest.approx(error, abs=2e-3)


LENSES = [
    calibrated("plumb_bob", -0.29, 0.085, 0.0008, -0.0005, 0.0, focal=385.0),
    calibrated("plumb_bob", -0.4, 0.17, 0.0, 0.0, -0.03, focal=385.0),
    calibrated("rational_polynomial", 0.5, -0.3, 0.001, 0.002, 0.1, 0.8, -0.2, 0.05, focal=400.0),
    calibrated("rational_polynomial", *(0.5, -0.3, 0.001, 0.002, 0.1, 0.8, -0.2, 0.05, 0.01, 0.0, -0.01, 0.0)),
    calibrated("equidistant", 0.02, -0.01, 0.003, -0.001),
    calibrated("fisheye"),
    # As drivers publish them: of the Gemini 336L by Orbbec, of the T265 by RealSense, and of a ZenPhone by Tango.
    calibrated("plumb_bob", -0.030605, 0.035201, -0.000138, -0.000146, -0.01204, 0.0, 0.0, 0.0),
    calibrated("equidistant", -0.0043482, 0.0371257, -0.0355394, 0.005773, 0.0),
    calibrated("rational_polynomial", 0.0937095, -0.1640722, 0.0, 0.0, 0.1224193),
    # As the recorder of librealsense names them.
    calibrated("Brown Conrady", 0.1517, -0.5104, -0.0007, -0.0002, 0.4639, focal=600.0),
    calibrated("Kannala Brandt4", -0.0043482, 0.0371257, -0.0355394, 0.005773, 0.0),
]


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens.distortion_model} {len(lens.d)}")
def test_directions_are_those_of_the_lens(lens: CameraInfo):
    model = CameraModel.from_info(lens, CameraPose(height_m=1.0, pitch_rad=0.0))
    bearings, elevations = np.meshgrid(np.linspace(-0.7, 0.7, 5), np.linspace(-0.4, 0.4, 3))
    rays = np.stack([-np.tan(bearings), -np.tan(elevations) / np.cos(bearings), np.ones_like(bearings)], axis=-1)
    points, k, d = rays.reshape(-1, 1, 3), np.array(lens.k).reshape(3, 3), np.array(lens.d or (0.0,) * 4)
    fisheye = lens.distortion_model in ("equidistant", "fisheye", "Kannala Brandt4")
    if fisheye:
        d = d[:4]
    project = _fisheye if fisheye else cv2.projectPoints
    pixels = project(points, np.zeros(3), np.zeros(3), k, d)[0].reshape(-1, 2)
    for (u, v), bearing, elevation in zip(pixels, bearings.reshape(-1), elevations.reshape(-1), strict=True):
        assert model.direction(u, v) == pytest.approx((bearing, elevation), abs=1e-4)
    x, y = model.points(pixels[:, 0], pixels[:, 1])
    np.testing.assert_allclose(np.stack(model.pixels(x, y), axis=1), pixels, atol=1e-2)


def _fisheye(points: np.ndarray, turn: np.ndarray, move: np.ndarray, k: np.ndarray, d: np.ndarray):
    return cv2.fisheye.projectPoints(points, turn, move, k, d)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens.distortion_model} {len(lens.d)}")
def test_any_pixel_has_a_direction_and_points_behind_have_no_pixel(lens: CameraInfo):
    model = CameraModel.from_info(lens, CameraPose(height_m=1.0, pitch_rad=0.1))
    for u, v in ((0, 0), (640, 480), (-500, 900), (320, 240)):
        assert all(map(math.isfinite, model.direction(u, v)))
    x, _ = model.pixels(np.array([math.inf, math.nan, 0.0]), np.array([0.0, 0.0, 0.0]))
    assert np.isfinite(x).tolist() == [False, False, True]


@pytest.mark.parametrize(
    "bad",
    [
        calibrated("plumb_bob", 0.1, 0.1),
        calibrated("plumb_bob", *[0.1] * 6),
        calibrated("equidistant", 0.1, 0.1),
        calibrated("equidistant", *[0.1] * 5),
        calibrated("plumb_bob", *[math.nan] * 5),
        calibrated("equidistant", 0.1, 0.1, 0.1, 0.1, math.nan),
    ],
)
def test_distortion_that_does_not_fit_its_model_is_refused_by_name(bad: CameraInfo):
    with pytest.raises(MessageError, match=rf"{bad.distortion_model}.*eye|eye.*{bad.distortion_model}"):
        CameraModel.from_info(bad)


def test_rectified_images_have_no_lens():
    assert CameraModel.from_info(without_lens(LENSES[0])).lens is None


@given(st.floats(-0.08, 0.1))
def test_error_of_a_lens_is_that_of_opencv(k1: float):
    info = calibrated("plumb_bob", k1, 0.0, 0.0, 0.0)
    angle = math.atan(320 / 300) - lens_error_rad(info) * (1 if k1 > 0 else -1)
    seen = math.tan(angle)
    assert seen * (1 + k1 * seen**2) == pytest.approx(320 / 300, abs=0.01)


@pytest.mark.parametrize(
    ("size", "told"),
    [
        *(((3840, 480), 2), ((3840, 1080), 2), ((2520, 1080), 1), ((480, 3840), 1)),
        *(((1280, 480), 2), ((3840, 1920), 2), ((1920, 1080), 1), ((2164, 1080), 1), ((640, 640), 1)),
    ],
)
def test_panoramas_and_pictures_side_by_side_are_told(size: tuple[int, int], told: int) -> None:
    k = (800.0, 0.0, size[0] / 2, 0.0, 800.0, size[1] / 2, 0.0, 0.0, 1.0)
    info = CameraInfo(stamp=0, frame_id="eye", width=size[0], height=size[1], k=k)
    assert intrinsics_problems(info, *size, 1.09) == []
    for unknown in (None, msgspec.structs.replace(info, k=(0.0,) * 9)):
        problems = intrinsics_problems(unknown, *size, 1.09)
        assert sum("panorama" in problem for problem in problems) == told - 1
        assert len(problems) == told


CALIBRATION = """\
image_width: 64
image_height: 48
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [  60.5,    0.  ,   31.0,
            0.  ,   61. ,   25.5,
            0.  ,    0.  ,    1.  ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -2.5e-01, 1e-3, 0, 0.000000]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [60, 0, 31, 0, 0, 61, 25, 0, 0, 0, 1, 0]}
"""


def test_calibration_of_ros_is_read(tmp_path):
    (tmp_path / "ost.yaml").write_text(CALIBRATION)
    info = read_calibration(tmp_path / "ost.yaml")
    assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
    assert info.k == (60.5, 0, 31, 0, 61, 25.5, 0, 0, 1)
    assert info.d == (0.1, -0.25, 0.001, 0, 0)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("ost.txt", "# oST version 5.0 parameters\n[image]\n", "INI format is not read"),
        ("a.yaml", CALIBRATION.replace("image_width: 64", "image_width: 0"), "a.yaml:1: 'image_width' must be"),
        ("a.yaml", CALIBRATION.replace("camera_matrix", "camera_matrx"), "unknown key 'camera_matrx'"),
        ("a.yaml", CALIBRATION.replace("60.5,", ""), "k has 8 numbers, not 9"),
        ("a.yaml", CALIBRATION.replace("60.5", ".nan"), "a.yaml:7: each of 'data' must be a number, got nan"),
        ("a.yaml", CALIBRATION.replace("60.5", "wide"), "each of 'data' must be"),
        (
            "a.yaml",
            CALIBRATION.replace("-2.5e-01, 1e-3, 0, 0.000000", "0.2"),
            "no distortion of the model",
        ),
        ("a.yaml", "cam0: {camera_model: pinhole, intrinsics: [1, 1, 1, 1]}\n", "unknown key 'cam0'"),
        ("missing.yaml", None, "missing.yaml"),
    ],
)
def test_other_calibration_is_refused(tmp_path, name, text, why):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ParameterError) as caught:
        read_calibration(tmp_path / name)
    assert why in str(caught.value)


@given(width=st.integers(16, 4000), height=st.integers(16, 4000))
def test_scaled_intrinsics_are_those_of_the_scaled_camera(width, height):
    info = CameraInfo(stamp=1, frame_id="c", width=640, height=480, k=(525, 0, 322, 0, 530, 238, 0, 0, 1), d=(0.1,) * 5)
    scaled = scaled_info(info, width, height)
    assert CameraModel.from_info(scaled) == CameraModel.from_info(info).scaled(width, height)
    assert scaled_info(info, 640, 480) == info
