from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.errors import MessageError, ParameterError
from socialbot.messages import CameraInfo
from socialbot.vision.camera import CameraModel

PITCHES = [0.0, 0.052, 0.2, 0.4]
DISTANCES = [1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0]


def camera(pitch: float = 0.0, height: float = 1.62) -> CameraModel:
    return CameraModel(525, 530, 322, 238, 640, 480, height, pitch)


def project(model: CameraModel, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of ``points`` (n, 3) in the robot frame, by a rotation matrix and the pinhole equations."""
    c, s = math.cos(model.pitch_rad), math.sin(model.pitch_rad)
    tilt = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    seen = (points - [0, 0, model.mount_height_m]) @ tilt
    forward, left, up = seen.T
    return np.stack([model.cx - model.fx * left / forward, model.cy - model.fy * up / forward], axis=1)


def box_of(model: CameraModel, distance: float, bearing: float, *, tall=1.70, wide=0.5, deep=0.0):
    """The box, clipped to the picture, of an upright elliptic body, widest from hip to shoulders."""
    angles = np.linspace(0, 2 * np.pi, 60)
    c, s = math.cos(bearing), math.sin(bearing)
    rings = []
    for share in np.linspace(0, 1, 41):
        size = 0.6 if share < 0.45 else 1.0 if share < 0.85 else 0.35
        along, across = deep / 2 * np.cos(angles), size * wide / 2 * np.sin(angles)
        x, y = c * (distance + along) - s * across, s * (distance + along) + c * across
        rings.append(np.stack([x, y, np.full_like(x, share * tall)], axis=1))
    pixels = project(model, np.concatenate(rings))
    low = np.clip(pixels.min(axis=0), 0, (model.width, model.height))
    high = np.clip(pixels.max(axis=0), 0, (model.width, model.height))
    return (*low.tolist(), *(high - low).tolist())


@pytest.mark.parametrize("pitch", PITCHES)
@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("bearing", [-0.25, 0.0, 0.3])
def test_distance_of_a_person_of_usual_size(pitch, distance, bearing):
    model = camera(pitch)
    assert model.distance(box_of(model, distance, bearing)) == pytest.approx(distance, rel=0.05)


@pytest.mark.parametrize("pitch", PITCHES)
@pytest.mark.parametrize("distance", [2.0, 3.5, 6.0, 12.0])
def test_distance_of_a_body_with_depth(pitch, distance):
    model = camera(pitch)
    assert model.distance(box_of(model, distance, 0.1, deep=0.24)) == pytest.approx(distance, rel=0.08)


def test_the_ground_corrects_for_tall_and_small_people():
    model = camera(0.052)
    for tall in (1.5, 1.9):
        box = box_of(model, 4.0, 0.0, tall=tall)
        assert model.distance(box) == pytest.approx(4.0, rel=0.05)
        assert model.distance(box, person_height_m=tall) == pytest.approx(4.0, rel=0.001)


def test_the_height_corrects_for_a_wrong_pitch_more_the_farther():
    seen, believed = camera(0.052), camera(0.04)
    box = box_of(seen, 12.0, 0.0)
    ground_only = believed.mount_height_m / -math.tan(believed.direction(box[0] + box[2] / 2, box[1] + box[3])[1])
    assert abs(ground_only - 12) > 1.0
    assert believed.distance(box) == pytest.approx(12.0, rel=0.05)


def test_a_head_cut_off_leaves_the_ground():
    model = camera(0.5)
    box = box_of(model, 2.0, 0.0, tall=1.9)
    assert box[1] == 0
    assert box[1] + box[3] < 478
    assert model.distance(box) == pytest.approx(2.0, rel=0.02)


def test_feet_cut_off_leave_the_width_bounded_by_the_height():
    model = camera()
    box = box_of(model, 1.6, 0.0)
    assert box[1] + box[3] == 480
    assert model.distance(box) == pytest.approx(1.6, rel=0.05)
    x, y, w, h = box_of(model, 2.9, 0.0, wide=0.2)
    assert y + h == 480
    by_width = 0.5 * model.fx / w
    assert by_width > 7
    assert model.distance((x, y, w, h)) == pytest.approx(3.5, abs=0.1)


def test_feet_above_the_horizon_leave_the_height():
    model = camera()
    x, y, w, h = box_of(model, 6.0, 0.0)
    assert model.distance((x, y - 200, w, h)) == pytest.approx(6.0, rel=0.1)


@pytest.mark.parametrize("box", [(1, 1, 0, 5), (1, 1, 5, 0), (1, 1, -2, 5), (math.nan, 1, 5, 5), (1, math.inf, 5, 5)])
def test_an_empty_box_has_no_distance(box):
    assert camera().distance(box) is None


def test_a_speck_is_no_error():
    assert camera().distance((100, 100, 1e-300, 1e-300)) is None


@settings(max_examples=200, deadline=None)
@given(st.floats(0, 600), st.floats(0, 440), st.floats(0.5, 640), st.floats(0.5, 480), st.sampled_from(PITCHES))
def test_any_box_in_the_picture_has_a_distance_and_a_head(x, y, w, h, pitch):
    box = (x, y, min(w, 640 - x), min(h, 480 - y))
    model = camera(pitch)
    distance = model.distance(box)
    assert distance is not None
    assert 0 < distance < math.inf
    assert all(math.isfinite(angle) for angle in model.head(box))


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 600), st.floats(0, 440), st.floats(0.5, 640), st.floats(0.5, 480), st.floats(-1.5, 1.5))
def test_no_pitch_makes_a_distance_negative(x, y, w, h, pitch):
    distance = camera(pitch).distance((x, y, min(w, 640 - x), min(h, 480 - y)))
    assert distance is None or 0 < distance < math.inf


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


@pytest.mark.parametrize("pitch", [0.0, 0.1])
@pytest.mark.parametrize("distance", [2.0, 4.0, 9.0])
def test_the_head_is_where_the_middle_of_the_head_is(pitch, distance):
    model = camera(pitch)
    bearing, elevation = model.head(box_of(model, distance, 0.2))
    assert bearing == pytest.approx(0.2, abs=0.01)
    assert elevation == pytest.approx(math.atan2(1.70 - 0.12 - 1.62, distance), abs=0.01)


def test_a_head_out_of_the_picture_is_looked_for_above_it():
    model = camera(0.3)
    box = box_of(model, 0.8, 0.0, tall=1.9)
    assert box[1] == 0
    _, elevation = model.head(box, person_height_m=1.9)
    assert elevation == pytest.approx(math.atan2(1.9 - 0.12 - 1.62, 0.8), abs=0.05)


def info(k: tuple[float, ...], width: int = 640, height: int = 480) -> CameraInfo:
    return CameraInfo(stamp=0, frame_id="eye", width=width, height=height, k=k)


def test_from_info():
    model = CameraModel.from_info(info((500, 0, 310, 0, 510, 250, 0, 0, 1)), mount_height_m=1.0, pitch_rad=0.2)
    assert model == CameraModel(500, 510, 310, 250, 640, 480, 1.0, 0.2)


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
def test_an_uncalibrated_info_is_refused(bad):
    with pytest.raises(MessageError, match="eye"):
        CameraModel.from_info(bad)


def test_from_field_of_view():
    model = CameraModel.from_field_of_view(640, 480, 1.2)
    assert model.direction(0, 240)[0] == pytest.approx(0.6)
    assert model.direction(640, 240)[0] == pytest.approx(-0.6)
    assert model.fx == model.fy


@pytest.mark.parametrize("hfov", [0.0, -1.0, math.pi, 4.0, math.nan])
def test_an_impossible_field_of_view_is_refused(hfov):
    with pytest.raises(ParameterError):
        CameraModel.from_field_of_view(640, 480, hfov)


@pytest.mark.parametrize(("name", "value"), [("fx", 0.0), ("height", 0), ("mount_height_m", -1.0), ("fy", math.inf)])
def test_an_impossible_camera_is_refused(name, value):
    fields = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480, name: value}
    with pytest.raises(ParameterError, match=name):
        CameraModel(**fields)


def test_scaling_keeps_directions():
    model = camera(0.1)
    half = model.scaled(320, 120)
    assert half.direction(100, 50) == pytest.approx(model.direction(200, 200))
    assert (half.width, half.height) == (320, 120)
