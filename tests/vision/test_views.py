from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.detectors import _views
from socialbot.vision.network import View, band, fitting, scaled, whole

size = st.integers(1, 900)


@st.composite
def parts(draw):
    """A picture's width and height and a part of it."""
    width, height = draw(size), draw(size)
    x, y = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    return width, height, (x, y, draw(st.integers(1, width - x)), draw(st.integers(1, height - y)))


def to_canvas(view: View, boxes: np.ndarray) -> np.ndarray:
    """Return boxes of the image in canvas coordinates."""
    across, down = view.across / view.w, view.down / view.h
    moved = boxes - (view.x, view.y, 0, 0)
    return moved * (across, down, across, down) + (view.left, view.top, 0, 0)


@settings(max_examples=60, deadline=None)
@given(parts(), st.integers(1000, 200_000))
def test_boxes_go_to_the_canvas_and_back(picture, pixels):
    _, _, part = picture
    view = fitting(part, pixels)
    boxes = np.array([part, (part[0] + 1, part[1] + 2, 3, 4)], float)
    np.testing.assert_allclose(view.back(to_canvas(view, boxes)), boxes, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(parts(), st.integers(1000, 200_000))
def test_canvas_has_sides_that_the_step_divides_and_holds_the_part(picture, pixels):
    width, height, part = picture
    view = fitting(part, pixels)
    assert view.width % 32 == view.height % 32 == 0
    assert 0 <= view.left <= view.left + view.across <= view.width
    assert 0 <= view.top <= view.top + view.down <= view.height
    assert view.cut(np.zeros((height, width, 3), np.uint8)).shape == (view.height, view.width, 3)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (480, 640), (1920, 1080), (1242, 375), (768, 576)])
def test_pictures_of_any_shape_cost_about_the_same(width, height):
    view = fitting((0, 0, width, height), 416 * 320)
    assert view.width * view.height == pytest.approx(416 * 320, rel=0.2)
    assert view.across / view.down == pytest.approx(width / height, rel=0.02)


def test_picture_as_cameras_give_it_fills_the_view():
    view = fitting((0, 0, 640, 480), 416 * 320)
    assert (view.width, view.height, view.across, view.down, view.left, view.top) == (416, 320, 416, 312, 0, 4)


def test_whole_is_in_the_middle_or_at_the_upper_left():
    picture = np.full((50, 100, 3), 200, np.uint8)
    middle = whole(100, 50, (64, 64), fill=114).cut(picture)
    assert (middle[16:48] == 200).all()
    assert (middle[:16] == 114).all()
    assert (middle[48:] == 114).all()
    corner = whole(100, 50, (64, 64), centred=False).cut(picture)
    assert (corner[:32] == 200).all()
    assert (corner[32:] == 0).all()


def test_cut_shows_its_part_of_the_image():
    picture = np.arange(40 * 60 * 3, dtype=np.uint8).reshape(40, 60, 3)
    view = View(10, 5, 32, 32, 32, 32, 32, 32, 0, 0)
    assert (view.cut(picture) == picture[5:37, 10:42]).all()


def test_boxes_cut_off_by_the_view_are_not_trusted():
    view = fitting((0, 100, 640, 160), 640 * 160)
    boxes = {
        "inside": (300, 120, 40, 100),
        "at the picture's left edge": (0, 120, 40, 100),
        "at the picture's right edge": (600, 120, 40, 100),
        "cut off above": (300, 101, 40, 100),
        "cut off below": (300, 150, 40, 110),
        "through all of it": (300, 90, 80, 180),
    }
    trusted = view.trusted(np.array(list(boxes.values()), float), 640, 480)
    assert dict(zip(boxes, trusted, strict=True)) == {
        "inside": True,
        "at the picture's left edge": True,
        "at the picture's right edge": True,
        "cut off above": False,
        "cut off below": False,
        "through all of it": False,
    }
    assert fitting((0, 0, 640, 480), 99_999).trusted(np.array([[0.0, 0, 640, 480]]), 640, 480).all()


def test_small_boxes_are_left_to_finer_views():
    coarse = fitting((0, 0, 640, 480), 160 * 120, least=60)
    boxes = np.array([[0, 0, 90, 200], [0, 0, 90, 260]], float)
    assert coarse.trusted(boxes, 640, 480).tolist() == [False, True]


@settings(max_examples=60, deadline=None)
@given(size, size, st.floats(-1, 2))
def test_band_is_within_the_image(width, height, horizon):
    x, y, w, h = band(width, height, horizon)
    assert (x, w) == (0, width)
    assert 0 <= y < y + h <= height


def test_band_holds_people_from_10_m_on_whether_the_horizon_is_known_or_not():
    camera = CameraModel.from_field_of_view(640, 480, 1.09, CameraPose(height_m=1.62, pitch_rad=0.052))
    known = (240 - camera.fy * math.tan(0.052)) / 480
    for horizon in (known, 0.5):
        _, top, _, height = band(640, 480, horizon)
        for distance in (10, 20):
            head = 240 + camera.fy * math.tan(math.atan((1.62 - 1.95) / distance) - 0.052)
            feet = 240 + camera.fy * math.tan(math.atan(1.62 / distance) - 0.052)
            assert top + 0.06 * height < head < feet < top + 0.94 * height


def test_scaled_part_fills_its_canvas():
    view = scaled((10, 20, 100, 60), 1.5)
    assert (view.width, view.height, view.across, view.down) == (150, 90, 150, 90)
    assert view.back(np.array([[15.0, 15, 30, 30]])).tolist() == [[20, 30, 20, 20]]


@pytest.mark.parametrize(
    ("size", "scale"), [((640, 480), 1.0), ((720, 576), 1.0), ((800, 600), 1.0), ((1600, 900), 0.57), ((320, 240), 2.0)]
)
def test_distant_people_keep_most_of_their_pixels_in_large_images(size: tuple[int, int], scale: float):
    views = _views(*size, 0.5)
    assert views[1].across / views[1].w == pytest.approx(scale, abs=0.06)
    assert sum(view.width * view.height for view in views) < 380_000
