from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.messages import PersonDetections
from socialbot.vision.metrics.matches import FALSE, SPARED, box_array, pair
from socialbot.vision.metrics.scores import Score, score
from socialbot.vision.metrics.truth import GroundTruth, Region, TruthFrame, TruthPerson
from tests.vision.metrics.scenes import seen


def true(x=0.0, *, w=10.0, h=20.0, distance=5.0, visible=1.0) -> TruthPerson:
    return TruthPerson(id="p", x=x, y=0, w=w, h=h, distance_m=distance, visible=visible)


def counts(truths, detections) -> tuple[int, int, int]:
    """Counts of one frame."""
    total = sum(score(truth_of([truths]), [answer(0, detections)]).bands.values(), Score())
    return total.tp, total.fp, total.fn


def truth_of(frames) -> GroundTruth:
    return GroundTruth(
        image_topic="/i", frames=tuple(TruthFrame(stamp=n, persons=tuple(persons)) for n, persons in enumerate(frames))
    )


def answer(stamp, persons) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="c", width=640, height=480, persons=tuple(persons))


def test_rates():
    assert (Score(3, 1, 2).precision, Score(3, 1, 2).recall) == (0.75, 0.6)
    assert Score(3, 1, 2).f1 == pytest.approx(2 / 3)
    assert (Score().precision, Score().recall, Score().f1) == (None, None, None)
    assert (Score(fp=2).precision, Score(fp=2).recall, Score(fp=2).f1) == (0, None, 0)
    assert (Score(fn=2).precision, Score(fn=2).recall, Score(fn=2).f1) == (None, 0, 0)


def test_counts_by_band():
    people = [true(0, distance=1.9), true(100, distance=2.0), true(200, distance=19.9), true(300, distance=25)]
    detections = [
        seen(0, distance=15),
        *(seen(400 + 50 * d, distance=d) for d in (1, 12, 33)),
        seen(900, distance=None),
    ]
    result = score(truth_of([people]), [answer(0, detections)])
    assert {name: (band.tp, band.fp, band.fn) for name, band in result.bands.items()} == {
        "0-2 m": (1, 1, 0), "2-10 m": (0, 0, 1), "10-20 m": (0, 1, 1), "outside": (0, 1, 1), "unknown": (0, 1, 0),
    }  # fmt: skip


def test_overlap_must_reach_a_half():
    # 10 wide and shifted by d: IoU (10 - d) / (10 + d); a half at d = 10/3.
    assert counts([true()], [seen(3.3)]) == (1, 0, 0)
    assert counts([true()], [seen(3.4)]) == (0, 1, 1)
    assert counts([true(w=10)], [seen(w=5)]) == (1, 0, 0)


def test_second_detection_of_one_person_is_a_false_positive():
    assert counts([true()], [seen(), seen(0.5)]) == (1, 1, 0)


def test_detection_with_the_higher_score_matches_first():
    # The better detection fits both people, best the left one; the other fits only the left one.
    people = [true(0), true(2.5)]
    assert counts(people, [seen(-2.5, score=0.1), seen(0.5, score=0.9)]) == (1, 1, 1)
    assert counts(people, [seen(-2.5, score=0.9), seen(0.5, score=0.1)]) == (2, 0, 0)


def test_hardly_visible_people_are_not_scored():
    hidden = true(visible=0.24)
    assert counts([hidden], []) == (0, 0, 0)
    assert counts([hidden], [seen(), seen(0.5)]) == (0, 0, 0)
    assert counts([hidden], [seen(50)]) == (0, 1, 0)
    assert counts([true(visible=0.25)], []) == (0, 0, 1)
    # The detection overlaps the hidden one more, but finds the visible one well enough.
    assert counts([true(0, visible=0.1), true(2)], [seen(0.5)]) == (1, 0, 0)


def test_only_answered_frames_are_scored():
    truth = truth_of([[true()], [true()], [true()]])
    result = score(truth, [answer(0, []), answer(0, [seen()]), answer(2, []), answer(99, [seen()])])
    assert (result.frames, result.missing_frames) == (2, 1)
    assert [(len(frame.found), frame.errors) for frame in result.by_frame] == [(1, 0), (0, 1)]


def boxes(*places):
    return box_array(Region(x=x, y=0, w=10, h=20) for x in places)


def test_pairs_of_detections_and_people():
    assert pair(boxes(52, 1, 0, 99, 300), boxes(0, 50), boxes(100)) == [1, 0, FALSE, SPARED, FALSE]
    assert pair(boxes(0), boxes(), boxes()) == [FALSE]
    assert pair(boxes(), boxes(0), boxes()) == []
    assert pair(boxes(3), boxes(0), boxes(), 0.6) == [FALSE]
    assert pair(boxes(3), boxes(0), boxes(), 0.5) == [0]
    assert pair(boxes(3), boxes(), boxes(0), 0.6) == [FALSE]


sizes = st.floats(1, 80)
truths = st.builds(true, st.floats(0, 600), w=sizes, h=sizes, distance=st.floats(0, 30), visible=st.floats(0, 1))
found = st.builds(
    seen, st.floats(0, 600), w=sizes, h=sizes, score=st.floats(0, 1), distance=st.none() | st.floats(0, 30)
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.lists(truths, max_size=5), st.lists(found, max_size=5)), max_size=4))
def test_every_person_and_every_detection_is_counted_once(frames):
    truth = truth_of([people for people, _ in frames])
    result = score(truth, [answer(n, detections) for n, (_, detections) in enumerate(frames)])
    people = [person for persons, _ in frames for person in persons]
    visible = [person for person in people if person.visible >= 0.25]
    overall = sum(result.bands.values(), Score())
    assert overall.tp + overall.fn == len(visible)
    assert overall.tp + overall.fp <= sum(len(detections) for _, detections in frames)
    for band, low, high in (("0-2 m", 0, 2), ("2-10 m", 2, 10), ("10-20 m", 10, 20)):
        inside = sum(low <= person.distance_m < high for person in visible)
        assert result.bands[band].tp + result.bands[band].fn == inside
    if visible == people:
        assert overall.tp + overall.fp == sum(len(detections) for _, detections in frames)


@settings(max_examples=60, deadline=None)
@given(st.lists(truths, max_size=4))
def test_perfect_detections_are_perfect(people):
    # People side by side, so that none hides in another's box.
    row = [true(100.0 * n, distance=person.distance_m) for n, person in enumerate(people)]
    assert counts(row, [seen(person.x, distance=person.distance_m) for person in row]) == (len(row), 0, 0)


@settings(max_examples=60, deadline=None)
@given(st.lists(truths, max_size=5), st.lists(found, max_size=5), st.randoms(use_true_random=False))
def test_order_of_detections_does_not_matter(people, detections, random):
    shuffled = random.sample(detections, len(detections))
    assert (
        score(truth_of([people]), [answer(0, detections)]).bands
        == score(truth_of([people]), [answer(0, shuffled)]).bands
    )
