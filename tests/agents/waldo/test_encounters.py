"""Judgements of a person in one frame and of a path: attention, and whether more frames are needed."""

from __future__ import annotations

import math

import pytest

from socialbot.agents.waldo.encounters import Path, View, attention, is_undecided, newest_path, telling
from socialbot.core.messages import PersonDetection

COMES = Path(seconds=1.0, speed_mps=1.2, approach_mps=1.2, passes_m=0.2)
PASSES = COMES._replace(passes_m=2.0)
LEAVES = COMES._replace(approach_mps=-1.2)
STANDS = COMES._replace(speed_mps=0.1, approach_mps=0.1)
STROLLS = COMES._replace(speed_mps=0.4, approach_mps=0.4)
NEAR, FAR = 2.0, 4.0
TOWARDS, UNCLEAR, AWAY = 0.5, 1.4, 2.0


def person(
    distance_m: float | None = NEAR, facing_rad: float | None = None, approach_mps: float | None = None
) -> PersonDetection:
    return PersonDetection(
        x=0,
        y=0,
        w=9,
        h=9,
        score=1.0,
        distance_m=distance_m,
        bearing_rad=0.0,
        facing_rad=facing_rad,
        approach_mps=approach_mps,
    )


@pytest.mark.parametrize(
    ("seen", "path", "attends", "what"),
    [
        (person(6.0, TOWARDS), COMES, False, "is 6.0 m away"),
        (person(FAR), COMES, True, "walks up to the robot"),
        (person(FAR, UNCLEAR), COMES, True, "walks up to the robot"),
        (person(FAR, AWAY), COMES, False, "faces away from the robot"),
        (person(FAR, TOWARDS), PASSES, False, "walks past the robot at 2.0 m"),
        (person(FAR, TOWARDS), LEAVES, False, "walks away from the robot"),
        (person(FAR, TOWARDS), STANDS, True, "faces the robot"),
        (person(FAR, TOWARDS), None, True, "faces the robot"),
        (person(NEAR, AWAY), STANDS, False, "faces away from the robot"),
        (person(NEAR, AWAY), STROLLS, False, "faces away from the robot"),
        (person(FAR), STROLLS, True, "walks up to the robot"),
        (person(NEAR), STANDS, True, "stands before the robot"),
        (person(NEAR, UNCLEAR), STANDS, True, "stands before the robot"),
        (person(FAR), STANDS, False, "stands 4.0 m away"),
        (person(NEAR), None, True, "does not turn away"),
        (person(NEAR, approach_mps=-0.2), None, True, "approaches at -0.2 m/s"),
        (person(NEAR, approach_mps=-1.0), None, False, "approaches at -1.0 m/s"),
    ],
)
def test_attention_where_faces_are_detected(seen, path, attends, what):
    assert attention(seen, path, 5.0, faces=True) == (attends, what)


@pytest.mark.parametrize(("passes_m", "new", "going_on"), [(1.0, True, True), (1.5, False, True), (2.0, False, False)])
def test_a_path_is_left_farther_from_the_robot_than_it_is_entered(passes_m: float, new: bool, going_on: bool):
    path = COMES._replace(passes_m=passes_m)
    found = [attention(person(FAR), path, 5.0, faces=True, before=before)[0] for before in (False, True)]
    assert found == [new, going_on]


def test_without_detection_of_faces_a_person_may_stand_far_away():
    assert attention(person(FAR), STANDS, 5.0, faces=False) == (True, "stands before the robot")


@pytest.mark.parametrize(
    ("path", "with_faces", "without"),
    [
        (None, True, True),
        (STANDS, True, False),
        (COMES, False, False),
        (COMES._replace(seconds=0.5), True, False),
        (COMES._replace(seconds=0.6), False, False),
    ],
)
def test_more_frames_are_needed_until_a_path_or_a_face_is_known(path, with_faces, without):
    assert is_undecided(person(), path, faces=True) == with_faces
    assert is_undecided(person(), path, faces=False) == without
    assert is_undecided(person(facing_rad=UNCLEAR), path, faces=True) == with_faces, "a person who passes shows a side"
    assert not is_undecided(person(facing_rad=TOWARDS), path, faces=True)
    assert not is_undecided(person(None), path, faces=True)


def walks_up(path: Path, longer: Path, *, before: bool) -> bool:
    newest = newest_path(path, longer, before=before)
    assert newest is not None
    assert newest.speed_mps == min(path.speed_mps, longer.speed_mps)
    return newest.is_towards_robot(before=before)


def test_the_slower_speed_counts_with_the_newest_line():
    assert not walks_up(PASSES, STANDS, before=False)
    assert walks_up(STANDS, PASSES, before=False)
    assert walks_up(COMES, PASSES, before=False)
    assert not walks_up(PASSES, COMES, before=False)


def test_a_visitor_has_turned_aside_only_if_both_lines_pass_the_robot():
    assert walks_up(PASSES, COMES, before=True)
    assert walks_up(COMES, PASSES, before=True)
    assert not walks_up(PASSES, PASSES, before=True)


@pytest.mark.parametrize("before", [False, True])
def test_a_single_path_counts(before):
    assert newest_path(None, STANDS, before=before) == newest_path(STANDS, None, before=before) == STANDS
    assert newest_path(None, None, before=before) is None


def test_the_edge_of_a_view_is_not_in_it():
    view = View(math.pi - 0.1, 0.5)
    assert [view.shows(view.yaw_rad + angle) for angle in (-0.4, -0.3, 0.3, 0.4)] == [False, True, True, False]
    assert view.shows(-math.pi + 0.1)


def test_looks_of_unknown_direction_do_not_count_against_a_back():
    unknown, back, front = person(), person(facing_rad=AWAY), person(facing_rad=TOWARDS)
    assert telling([unknown, unknown, back]) == [back]
    assert telling([unknown, back, front]) == [unknown, back, front]
    assert telling([front, unknown]) == [front, unknown]
