"""Triangle meshes from which bodies and clothes are cut."""

from __future__ import annotations

from itertools import pairwise

import mesh
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

CUBE = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
CORNERS = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], float)


def cube(halvings: int = 0):
    """The surface of [-1, 1]^3, faces outwards; two bones whose weights go over from one to the other along x."""
    share = (CORNERS[:, :1] + 1) / 2
    made = mesh.Mesh(CORNERS, mesh.triangles(CUBE), np.hstack([share, 1 - share]))
    for _ in range(halvings):
        made = made.subdivided()
    return made


def ball(halvings: int = 3):
    """The unit sphere."""
    made = cube(halvings)
    made.points /= np.linalg.norm(made.points, axis=1, keepdims=True)
    return made


def area(made) -> float:
    """Square metres of the surface."""
    return float(np.linalg.norm(crosses(made), axis=1).sum() / 2)


def crosses(made) -> np.ndarray:
    """Face normals (m, 3), twice as long as the face is large."""
    a, b, c = np.moveaxis(made.points[made.faces], 1, 0)
    return np.cross(b - a, c - a)


def volume(made) -> float:
    """Cubic metres inside, positive when the faces look outwards; right for closed meshes only."""
    return float((made.points[made.faces[:, 0]] * crosses(made)).sum() / 6)


def assert_sound(made) -> None:
    """Indices in range, nothing unused, all finite, weights that add up to one."""
    assert set(made.faces.ravel().tolist()) == set(range(len(made.points)))
    assert np.isfinite(made.points).all()
    assert made.skin.min() >= -1e-12
    assert made.skin.sum(1) == pytest.approx(1)


DIRECTIONS = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)


def test_quads_are_split_with_the_winding_they_had():
    made = cube()
    assert_sound(made)
    assert area(made) == pytest.approx(24)
    assert volume(made) == pytest.approx(8)


# Parts


def test_a_kept_part_has_the_same_triangles_and_no_vertices_besides():
    whole = cube(1)
    some = whole.kept(whole.faces[::3])
    assert_sound(some)
    assert len(some.points) < len(whole.points)
    assert (some.points[some.faces] == whole.points[whole.faces[::3]]).all()
    assert (some.skin[some.faces] == whole.skin[whole.faces[::3]]).all()


@given(DIRECTIONS, st.floats(-0.8, 0.8), st.integers(0, 2))
def test_a_cut_follows_the_plane_and_both_sides_make_the_whole(direction, offset, halvings):
    whole, direction = cube(halvings), np.array(direction) / np.linalg.norm(direction)
    sides = [whole.clipped(sign * (whole.points @ direction - offset)) for sign in (1, -1)]
    for sign, side in zip((1, -1), sides, strict=True):
        height = sign * (side.points @ direction - offset)
        assert_sound(side)
        assert height.min() > -1e-9
        assert np.abs(height[side.border()]).max() < 1e-9
        assert side.skin[:, 0] == pytest.approx((side.points[:, 0] + 1) / 2)
    assert sum(area(side) for side in sides) == pytest.approx(24)
    assert sum(crosses(side).sum(0) for side in sides) == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_cut_keeps_the_winding():
    top = ball().clipped(ball().points[:, 2])
    assert ((crosses(top) * top.points[top.faces].mean(1)).sum(1) > -1e-12).all()


def test_a_cut_beside_the_mesh_keeps_all_or_none_of_it():
    whole = cube()
    everything, nothing = whole.clipped(np.ones(8)), whole.clipped(-np.ones(8))
    assert (everything.points[everything.faces] == whole.points[whole.faces]).all()
    assert nothing.points.shape == nothing.faces.shape == (0, 3)


def test_a_vertex_on_the_cut_is_kept():
    square = mesh.Mesh(np.eye(4, 3), np.array([[0, 1, 2], [1, 3, 2]]), np.ones((4, 1)))
    part_of = square.clipped(np.array([0.0, 1.0, 0.0, -1.0]))
    assert {tuple(point) for point in part_of.points.round(9)} >= {(1, 0, 0), (0, 1, 0), (0, 0, 1)}


# Finer and smoother


@pytest.mark.parametrize("halvings", [1, 2, 3])
def test_a_finer_mesh_is_the_same_closed_surface(halvings):
    coarse, fine = cube(halvings - 1), cube(halvings)
    assert_sound(fine)
    assert len(fine.faces) == 4 * len(coarse.faces)
    assert len(fine.points) == len(coarse.points) + len(coarse.edges()) == len(np.unique(fine.points, axis=0))
    assert (fine.points[: len(coarse.points)] == coarse.points).all()
    assert (area(fine), volume(fine)) == pytest.approx((24, 8))
    assert fine.skin[:, 0] == pytest.approx((fine.points[:, 0] + 1) / 2)
    assert not fine.border().any()


def test_every_edge_is_named_once():
    edges = cube(1).edges()
    assert len(edges) == len(np.unique(edges, axis=0)) == 3 * 48 / 2
    assert (edges[:, 0] < edges[:, 1]).all()


def test_only_the_rim_of_an_open_mesh_is_border():
    whole = cube(2)
    lid = whole.kept(whole.faces[(whole.points[whole.faces][:, :, 2] == 1).all(1)])
    assert (lid.border() == (np.abs(lid.points[:, :2]).max(1) == 1)).all()
    assert 0 < lid.border().sum() < len(lid.points)


@given(DIRECTIONS, st.floats(0.01, 100))
def test_normals_have_unit_length_and_look_outwards(stretch, size):
    made = ball()
    made.points = made.points * size * (1 + np.abs(stretch))
    out = made.normals()
    assert np.linalg.norm(out, axis=1) == pytest.approx(1)
    assert ((out * made.points).sum(1) > 0).all()


def test_normals_of_a_ball_are_its_radii():
    assert (ball(4).normals() * ball(4).points).sum(1).min() > 0.999


def test_large_faces_count_more_in_a_normal_than_small_ones():
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 1]], float)
    corner = mesh.Mesh(points, np.array([[0, 1, 2], [0, 2, 3]]), np.ones((4, 1)))
    assert corner.normals()[0] == pytest.approx(np.array([10, 0, 100]) / np.hypot(10, 100))


@given(st.integers(0, 8), st.floats(-5, 5))
def test_smoothing_keeps_even_and_pinned_points(rounds, level):
    made = cube(2)
    pinned = made.points[:, 2] == 1
    rough = np.random.default_rng(rounds).normal(size=(len(made.points), 2)) * [1, 3]
    assert made.smoothed(np.full(len(made.points), level), rounds) == pytest.approx(level)
    assert (made.smoothed(rough, rounds, pinned)[pinned] == rough[pinned]).all()


def test_smoothing_brings_neighbours_nearer_to_each_other_in_every_column():
    made = cube(2)
    rough = np.random.default_rng(3).normal(size=(len(made.points), 2)) * [1, 3]
    a, b = made.edges().T
    steps = [np.abs(field[a] - field[b]).mean(0) for field in (made.smoothed(rough, k) for k in range(5))]
    assert all((after < before).all() for before, after in pairwise(steps))
    assert made.smoothed(rough[:, 0], 4) == pytest.approx(made.smoothed(rough, 4)[:, 0])
    assert np.abs(made.smoothed(rough, 400) - made.smoothed(rough, 400).mean(0)).max() < 0.01


# Noise


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 1000), st.floats(0.02, 0.5))
def test_noise_is_seeded_and_of_about_unit_size(seed, length):
    points = np.random.default_rng(1).uniform(-1, 1, (4000, 3))
    noise = mesh.waves(points, length, (1, 1, 1), seed)
    assert (noise == mesh.waves(points, length, (1, 1, 1), seed)).all()
    assert (noise != mesh.waves(points, length, (1, 1, 1), seed + 1)).any()
    assert 0.3 < noise.std() < 1
    ridges = mesh.folds(points, length, (1, 1, 1), seed)
    assert -0.3 <= ridges.min() < -0.2
    assert 0.6 < ridges.max() <= 0.7


@pytest.mark.slow
@given(st.integers(0, 1000))
def test_noise_hardly_changes_over_a_small_part_of_its_length_and_less_along_a_stretch(seed):
    points = np.random.default_rng(2).uniform(-1, 1, (500, 3))
    here = mesh.waves(points, 0.1, (1, 1, 8), seed)
    across, along = (
        np.abs(mesh.waves(points + 0.005 * axis, 0.1, (1, 1, 8), seed) - here).mean() for axis in np.eye(3)[[0, 2]]
    )
    assert along < 0.4 * across < 0.2
