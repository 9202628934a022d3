from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.distance import (
    FACE_AHEAD_M,
    FACE_HEIGHT_M,
    HIDDEN_SHARE,
    PERSON_HEIGHT_M,
    Estimate,
    Expected,
    Figure,
    Range,
    Stature,
    head_direction,
    measure,
    shared_error,
    whole_height,
)
from socialbot.vision.motion import Cut, cut_off
from tests.vision.test_camera import PITCHES, camera, project

DISTANCES = [1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0]
PEOPLE = Stature.of_people()


def box_of(model: CameraModel, distance: float, bearing: float, *, tall=1.70, wide=0.5, deep=0.24):
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


def measured(
    model: CameraModel, box, stature: Stature = PEOPLE, hidden: float = HIDDEN_SHARE, face: float = 0.0
) -> Estimate:
    """The distance of ``box``, cut off where it touches the picture's edge."""
    cut = cut_off(np.array(box), model.width, model.height)
    found = measure(model, box, stature, cut, hidden=hidden, face=face)
    assert found is not None
    return found.distance


def stature(height: float, width: float = 0.5, std: float = 0.01) -> Stature:
    return Stature(Estimate(height, std), Estimate(width, std))


@pytest.mark.parametrize("pitch", PITCHES)
@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("bearing", [-0.25, 0.0, 0.3])
def test_distance_of_a_person_of_usual_size(pitch, distance, bearing):
    model = camera(pitch)
    x, y, w, h = box = box_of(model, distance, bearing)
    cut = x <= 0 or y <= 0 or x + w >= model.width or y + h >= 0.97 * model.height
    assert measured(model, box).value == pytest.approx(distance, rel=0.15 if cut else 0.04)


def test_ground_corrects_for_tall_and_small_people():
    model = camera(0.052)
    for tall in (1.5, 1.9):
        box = box_of(model, 4.0, 0.0, tall=tall)
        assert measured(model, box).value == pytest.approx(4.0, rel=0.06)
        assert measured(model, box, stature(tall)).value == pytest.approx(4.0, rel=0.03)


def test_height_corrects_for_a_wrong_pitch_more_the_farther():
    seen, believed = camera(0.052), camera(0.04)
    box = box_of(seen, 12.0, 0.0)
    ground_only = believed.pose.height_m / -math.tan(believed.direction(box[0] + box[2] / 2, box[1] + box[3])[1])
    assert abs(ground_only - 12) > 1.0
    assert measured(believed, box).value == pytest.approx(12.0, rel=0.07)


def test_head_cut_off_leaves_the_ground():
    model = camera(0.5)
    box = box_of(model, 2.0, 0.0, tall=1.9)
    assert box[1] == 0
    assert box[1] + box[3] < 470
    assert measured(model, box).value == pytest.approx(2.0, rel=0.04)


def test_feet_cut_off_leave_the_width():
    model = camera()
    box = box_of(model, 1.6, 0.0)
    assert box[1] + box[3] == 480
    found = measured(model, box)
    assert found.value == pytest.approx(1.6, rel=0.1)
    assert 0.15 < found.std / found.value < 0.35


def test_feet_below_the_image_are_nearer_than_the_floor_at_its_edge():
    model = camera()
    x, y, w, h = box_of(model, 2.9, 0.0, wide=0.2)
    assert y + h == 480
    by_width = 0.5 * model.fx / w
    assert by_width > 7
    found = measured(model, (x, y, w, h))
    assert 2.5 < found.value <= 1.05 * 1.62 * model.fy / (480 - model.cy)
    assert found.std < 0.6


def test_low_camera_measures_the_head():
    model = camera(-0.3, height=0.8)
    box = box_of(model, 1.8, 0.0, wide=0.3)
    assert box[1] > 10
    assert box[1] + box[3] == 480
    by_width = 0.5 / 0.3 * 1.8
    assert abs(measured(model, box).value - 1.8) < 0.4 * (by_width - 1.8)


def test_feet_behind_something_leave_width_and_bounds():
    model = camera(0.052)
    x, y, w, h = box_of(model, 4.0, 0.0)
    half = (x, y, w, h / 2)
    assert measured(model, half).value > 5.0
    assert measured(model, half, hidden=0.99).value == pytest.approx(4.0, rel=0.2)


def test_a_whole_person_who_may_be_hidden_is_at_the_distance_of_the_feet():
    model = camera(0.052)
    box = box_of(model, 4.0, 0.0)
    assert measured(model, box, hidden=0.2).value == pytest.approx(4.0, rel=0.05)


def test_a_box_that_shrinks_from_below_is_no_jump_away():
    model = camera(0.052)
    x, y, w, h = box_of(model, 8.0, 0.0)
    short = (x, y, w, 0.75 * h)
    alone = measured(model, short)
    followed = measure(model, short, PEOPLE, expected=Expected(8.0, 0.04, True))
    assert followed is not None
    assert alone.value > 9.5
    assert abs(followed.distance.value - 8.0) < min(2 * followed.distance.std, 1.0)


def test_the_visible_side_of_a_person_at_the_edge_may_have_no_head():
    model = camera(0.052)
    _, y, w, h = box_of(model, 4.0, 0.0)
    side = (0.0, y + 0.15 * h, 0.35 * w, 0.8 * h)
    found = measured(model, side)
    assert abs(found.value - 4.0) < 2 * found.std


def test_a_face_that_is_far_too_small_is_not_this_person_s():
    model = camera(0.052)
    box = box_of(model, 2.0, 0.0)
    usual = measured(model, box)
    assert measured(model, box, face=0.17 * model.fy / 7.0).value == pytest.approx(usual.value, rel=0.1)


def test_visible_width_bounds_the_distance():
    model = camera()
    box = (0.0, 100.0, 300.0, 380.0)
    assert measured(model, box).value < 0.5 * model.fx / 300


def test_person_who_fills_the_image_is_near():
    model = camera()
    found = measured(model, (0.0, 0.0, 640.0, 480.0))
    assert 0.1 < found.value < 0.5


def test_feet_above_the_horizon_leave_the_height():
    model = camera()
    x, y, w, h = box_of(model, 6.0, 0.0)
    assert measured(model, (x, y - 200, w, h)).value == pytest.approx(6.0, rel=0.25)


def test_cues_that_disagree_make_unsure():
    model = camera(0.052)
    x, y, w, h = box_of(model, 6.0, 0.0)
    assert measured(model, (x, y, w, 0.6 * h)).std > 2 * measured(model, (x, y, w, h)).std


@pytest.mark.parametrize("box", [(1, 1, 0, 5), (1, 1, 5, 0), (1, 1, -2, 5), (math.nan, 1, 5, 5), (1, math.inf, 5, 5)])
def test_empty_box_has_no_distance(box):
    assert measure(camera(), box, PEOPLE) is None


def test_speck_is_no_error():
    assert measure(camera(), (100, 100, 1e-300, 1e-300), PEOPLE) is None


cuts = st.builds(Cut, st.booleans(), st.booleans(), st.booleans(), st.booleans())


@settings(max_examples=300, deadline=None)
@given(
    st.floats(0, 600), st.floats(0, 440), st.floats(0.5, 640), st.floats(0.5, 480), st.sampled_from(PITCHES), cuts,
    st.booleans(),
)  # fmt: skip
def test_any_box_in_the_image_has_a_distance_and_a_head(x, y, w, h, pitch, cut, hidden):
    box = (x, y, min(w, 640 - x), min(h, 480 - y))
    model = camera(pitch)
    seen = measure(model, box, PEOPLE, cut, hidden=0.7 if hidden else HIDDEN_SHARE)
    assert seen is not None
    found = seen.distance
    assert 0 < found.value < math.inf
    assert 0 < found.std < math.inf
    assert all(math.isfinite(angle) for angle in head_direction(model, box, cut, found.value, 1.7))


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 600), st.floats(0, 440), st.floats(0.5, 640), st.floats(0.5, 480), st.floats(-1.5, 1.5), cuts)
def test_no_pitch_makes_a_distance_negative(x, y, w, h, pitch, cut):
    found = measure(camera(pitch), (x, y, min(w, 640 - x), min(h, 480 - y)), PEOPLE, cut)
    assert found is None or 0 < found.distance.value < math.inf


# Is the error honest?


def population(seed: int, count: int, low: float, high: float):
    """People of any stature at any distance, a camera whose pitch is a little wrong, and boxes a little wrong."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        distance = random.uniform(low, high)
        seen = camera(0.052 + random.normal(0, 0.008))
        x, y, w, h = box_of(
            seen, distance, random.uniform(-0.3, 0.3), tall=random.normal(1.70, 0.09), wide=random.normal(0.5, 0.11)
        )
        top, bottom = random.normal(0, 0.025 * h, 2) * [y > 0, y + h < 480]
        left, right = random.normal(0, 0.03 * w, 2) * [x > 0, x + w < 640]
        low_x, low_y = np.clip([x + left, y + top], 0, (640, 480))
        high_x, high_y = np.clip([x + w + right, y + h + bottom], 0, (640, 480))
        yield distance, (float(low_x), float(low_y), float(high_x - low_x), float(high_y - low_y))


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.8, 2.0), (10.0, 20.0), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((2.0, 3.5), (3.5, 10.0)))],
)
def test_errors_are_not_larger_than_stated(low, high):
    believed = camera(0.052)
    errors = []
    for distance, box in population(7, 400, low, high):
        found = measured(believed, box)
        errors.append(abs(found.value - distance) / found.std)
    assert 0.55 < np.mean(np.array(errors) <= 1) < 0.97
    assert np.mean(np.array(errors) <= 2) > 0.90


# What is learnt of a person


def test_learnt_stature_improves_cut_off_boxes():
    model, figure = camera(0.052), Figure(PEOPLE)
    for distance in np.arange(8.0, 3.5, -0.13):
        figure.learn(model, box_of(model, distance, 0.0, tall=1.85, wide=0.62), 0.1)
    near = box_of(model, 1.5, 0.0, tall=1.85, wide=0.62)
    before, after = measured(model, near), measured(model, near, figure.stature)
    assert before.value < 1.35
    assert after.value == pytest.approx(1.5, rel=0.06)
    assert after.std / after.value < 0.8 * before.std / before.value


def test_stature_is_learnt_and_never_quite_certain():
    model, figure = camera(0.052), Figure(PEOPLE)
    for _ in range(1000):
        figure.learn(model, box_of(model, 4.0, 0.0, tall=1.85, wide=0.4), 0.1)
    assert figure.stature.height.value == pytest.approx(1.85, abs=0.03)
    assert figure.stature.width.value == pytest.approx(0.4, abs=0.03)
    assert figure.stature.height.std > 0.02
    assert figure.stature.width.std > 0.03


def test_one_look_teaches_less_than_many_and_no_time_teaches_nothing():
    model, box = camera(0.052), box_of(camera(0.052), 4.0, 0.0, tall=1.85)
    none, one, many = Figure(PEOPLE), Figure(PEOPLE), Figure(PEOPLE)
    none.learn(model, box, 0.0)
    one.learn(model, box, 0.1)
    for _ in range(10):
        many.learn(model, box, 0.1)
    assert none.stature == PEOPLE
    assert 1.70 < one.stature.height.value < many.stature.height.value < 1.86


def test_empty_box_teaches_nothing():
    figure = Figure(PEOPLE)
    figure.learn(camera(), (1, 1, 0, 0), 1.0)
    assert figure.stature == PEOPLE


# Over time


def test_walk_is_followed_without_lag():
    path = Range(Estimate(8.0, 0.4), "whole")
    for step in range(1, 50):
        path.pass_(0.1)
        path.see(Estimate(8.0 - 0.13 * step, 0.3), "whole", 0.1)
        assert path.estimate.value == pytest.approx(8.0 - 0.13 * step, abs=0.15)


def test_standing_person_is_measured_better_with_time_and_worse_when_not_seen():
    path = Range(Estimate(4.0, 0.4), "whole")
    for _ in range(30):
        path.pass_(0.1)
        path.see(Estimate(4.0, 0.4), "whole", 0.1)
    standing = path.estimate
    path.pass_(1.0)
    assert standing.value == pytest.approx(4.0, abs=0.01)
    assert 0.1 < standing.std < 0.45
    assert path.estimate.std > 1.5 * standing.std


def test_vague_cues_keep_the_known_distance():
    path = Range(Estimate(3.2, 0.15), "whole")
    for step in range(100):
        path.pass_(0.1)
        if step < 20:
            path.see(Estimate(3.2, 0.15), "whole", 0.1)
        else:
            path.see(Estimate(2.4, 0.6), "cut", 0.1)
        if step == 25:
            assert path.estimate.value == pytest.approx(3.2, abs=0.2)
    assert 2.4 < path.estimate.value < 3.0
    assert 0.3 < path.estimate.std < 0.7


def test_biased_cue_still_measures_changes():
    path = Range(Estimate(3.0, 0.1), "whole")
    for step in range(1, 16):
        path.pass_(0.1)
        path.see(Estimate(0.8 * (3.0 - 0.1 * step), 0.6), "cut", 0.1)
    assert path.estimate.value == pytest.approx(1.5, abs=0.2)


def test_more_precise_cue_has_a_smaller_bias():
    path = Range(Estimate(8.9, 1.9), "hidden")
    for value, std in [(6.3, 1.1), (4.6, 0.5), (4.6, 0.5), (4.6, 0.5)]:
        path.pass_(0.1)
        path.see(Estimate(value, std), "hidden", 0.1)
        assert path.estimate.value > 4.0
    assert path.estimate.value == pytest.approx(4.6, abs=0.5)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0, 20), st.floats(0.05, 40), st.floats(0.01, 10)), max_size=20))
def test_distance_stays_positive_and_its_error_too(steps):
    path = Range(Estimate(3.0, 0.5), "whole")
    for seconds, value, std in steps:
        path.pass_(seconds)
        path.see(Estimate(value, std), "whole", seconds)
        assert path.estimate.value > 0
        assert 0 < path.estimate.std < math.inf


# The head


@pytest.mark.parametrize("pitch", [0.0, 0.1])
@pytest.mark.parametrize("distance", [2.0, 4.0, 9.0])
def test_head_is_where_the_middle_of_the_head_is(pitch, distance):
    model = camera(pitch)
    bearing, elevation = head_direction(model, box_of(model, distance, 0.2), Cut(), distance, 1.70)
    assert bearing == pytest.approx(0.2, abs=0.01)
    assert elevation == pytest.approx(math.atan2(1.70 - 0.12 - 1.62, distance), abs=0.01)


def test_head_above_the_image_is_estimated():
    model = camera(0.3)
    box = box_of(model, 0.8, 0.0, tall=1.9)
    assert box[1] == 0
    _, elevation = head_direction(model, box, Cut(top=True), 0.8, 1.9)
    assert elevation == pytest.approx(math.atan2(1.9 - 0.12 - 1.62, 0.8), abs=0.05)


def test_without_a_distance_the_head_is_the_top_of_the_box():
    model = camera()
    assert head_direction(model, (300, 100, 50, 100), Cut(), None, 1.7) == model.direction(325, 100)


@pytest.mark.parametrize("distance", [4.0, 5.0, 9.0])
@pytest.mark.parametrize("share", [0.3, 0.6, 1.0])
def test_how_far_down_the_feet_are_follows_from_the_distance(distance, share):
    model = camera(0.052)
    x, y, w, h = box_of(model, distance, 0.0)
    assert whole_height(model, (x, y, w, share * h), distance) == pytest.approx(h, rel=0.08)


def test_empty_box_has_no_whole_height():
    assert whole_height(camera(0.052), (300.0, 200.0, 0.0, 10.0), 3.0) == 10.0


def test_error_of_an_estimated_pose_is_common_to_all_distances():
    exact = camera()
    assert shared_error(exact, 5.0) == 0.0
    rough = exact.at(msgspec.structs.replace(exact.pose, height_std_m=0.1, pitch_std_rad=0.01))
    rougher = exact.at(msgspec.structs.replace(exact.pose, height_std_m=0.3, pitch_std_rad=0.05))
    assert 0.05 < shared_error(rough, 5.0) < shared_error(rougher, 5.0) < 0.15


def test_face_gives_the_distance_of_somebody_near():
    model = camera()
    x, y, w, h = box_of(model, 1.4, 0.0)
    assert y + h == 480
    without, near = measured(model, (x, y, w, h)), measured(model, (x, y, w, h), face=FACE_HEIGHT_M * model.fy / 1.0)
    assert near.value < 0.85 * without.value
    assert near.std / near.value < without.std / without.value


@pytest.mark.parametrize("distance", [1.2, 1.8, 2.5])
def test_distance_by_the_face_is_that_of_the_body(distance):
    """A face of usual size, which is ahead of the body, does not move the distance of a usual person."""
    model = camera()
    box = box_of(model, distance, 0.0, tall=PERSON_HEIGHT_M)
    face = FACE_HEIGHT_M * model.fy / (distance - FACE_AHEAD_M)
    alone, seen = measured(model, box), measured(model, box, face=face)
    assert seen.value == pytest.approx(distance, rel=0.05)
    assert abs(seen.value - distance) <= abs(alone.value - distance) + 0.01 * distance


@pytest.mark.parametrize("legs", [0.2, 0.4, 0.6])
def test_seated_person_seen_from_above_is_not_learnt_as_a_small_standing_one(legs):
    """From 2.5 m above the floor, both look alike."""
    model = CameraModel.from_field_of_view(640, 480, 1.14, CameraPose(height_m=2.5, pitch_rad=0.35))
    distance, tall = 4.2, 1.37
    x, y, w, h = box_of(model, distance - legs, 0.0, tall=tall, wide=0.6)
    head = box_of(model, distance, 0.0, tall=tall, wide=0.6)[1]
    seen = measure(model, (x, head, w, y + h - head), PEOPLE)
    assert seen is not None
    assert not seen.whole
    assert abs(seen.distance.value - distance) < 2 * seen.distance.std


@pytest.mark.parametrize("foot", [0.12, 0.20, 0.26])
def test_nearest_foot_is_before_the_body(foot):
    """It is farthest ahead while somebody walks towards the camera."""
    model, distance = camera(), 4.0
    x, y, w, _ = box_of(model, distance, 0.0)
    _, near, _, tall = box_of(model, distance - foot + 0.12, 0.0)  # The body of `box_of` begins 0.12 m ahead.
    seen = measured(model, (x, y, w, near + tall - y), stature(1.70))
    assert seen.value == pytest.approx(distance, rel=0.03)


def test_feet_of_seated_people_are_before_them():
    """Somebody of 1.28 m sits, with the feet 0.35 m before the body."""
    model, distance = camera(), 4.0
    top = model.cy - model.fy * math.tan(math.atan((1.28 - model.pose.height_m) / distance) + model.pose.pitch_rad)
    x, y, w, h = box_of(model, distance - 0.23, 0.0, tall=1.28, wide=0.7)
    seen = measure(model, (x, top, w, y + h - top), Stature.of_people())
    assert seen is not None
    assert seen.posture == "seated"
    assert seen.distance.value == pytest.approx(distance, rel=0.06)


@pytest.mark.parametrize("feet", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("distance", [3.0, 4.15, 5.0])
def test_error_with_a_known_pose_covers_how_far_seated_people_stretch_their_legs(feet, distance):
    """Somebody of 1.4 m sits, no wider than standing."""
    model = camera()
    top = model.cy - model.fy * math.tan(math.atan((1.4 - model.pose.height_m) / distance) + model.pose.pitch_rad)
    x, _, w, _ = box_of(model, distance, 0.0, tall=1.4)
    _, y, _, h = box_of(model, distance - feet + 0.12, 0.0, tall=1.4)
    seen = measured(model, (x, top, w, y + h - top))
    assert abs(seen.value - distance) < 2 * seen.std


def test_only_a_box_that_clearly_ends_at_the_feet_is_whole():
    model = camera()
    x, y, w, h = box_of(model, 5.0, 0.0)
    seen = [measure(model, (x, y, w, share * h), Stature.of_people()) for share in (1.0, 0.6)]
    assert [each and each.whole for each in seen] == [True, False]
