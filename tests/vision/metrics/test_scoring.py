from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.metrics.matches import FALSE, SPARED, pair
from socialbot.vision.metrics.scores import Score, score
from socialbot.vision.metrics.truth import GroundTruth, TruthFrame, TruthPerson


def true(x=0.0, *, w=10.0, h=20.0, distance=5.0, visible=1.0) -> TruthPerson:
    return TruthPerson(id="p", x=x, y=0, w=w, h=h, distance_m=distance, visible=visible)


def seen(x=0.0, *, w=10.0, h=20.0, value=0.5, distance: float | None = 5.0) -> PersonDetection:
    return PersonDetection(x=x, y=0, w=w, h=h, score=value, distance_m=distance)


def judge(truths, detections, **options):
    """Scores one frame."""
    return score(truth_of([truths]), [answer(0, detections)], **options)


def truth_of(frames) -> GroundTruth:
    return GroundTruth(
        image_topic="/i", frames=tuple(TruthFrame(stamp=n, persons=tuple(persons)) for n, persons in enumerate(frames))
    )


def answer(stamp, persons) -> PersonDetections:
    return PersonDetections(stamp=stamp, frame_id="c", width=640, height=480, persons=tuple(persons))


def counts(item: Score):
    return item.tp, item.fp, item.fn


def test_rates():
    assert (Score(3, 1, 2).precision, Score(3, 1, 2).recall) == (0.75, 0.6)
    assert Score(3, 1, 2).f1 == pytest.approx(2 / 3)
    assert (Score().precision, Score().recall, Score().f1) == (None, None, None)
    assert (Score(fp=2).precision, Score(fp=2).recall, Score(fp=2).f1) == (0, None, 0)
    assert (Score(fn=2).precision, Score(fn=2).recall, Score(fn=2).f1) == (None, 0, 0)


def test_hits_and_misses_count_in_the_band_of_the_true_person():
    result = judge([true(0, distance=1.9), true(100, distance=2.0), true(200, distance=19.9)], [seen(0, distance=15)])
    assert counts(result.bands["0-2 m"]) == (1, 0, 0)
    assert counts(result.bands["2-10 m"]) == (0, 0, 1)
    assert counts(result.bands["10-20 m"]) == (0, 0, 1)
    assert counts(result.overall) == (1, 0, 2)


def test_false_alarms_count_in_the_band_of_their_own_distance():
    result = judge([], [seen(0, distance=1), seen(50, distance=12), seen(90, distance=None), seen(150, distance=33)])
    assert {name: item.fp for name, item in result.bands.items()} == {
        "0-2 m": 1, "2-10 m": 0, "10-20 m": 1, "outside": 1, "unknown": 1,
    }  # fmt: skip


def test_people_beyond_all_bands_are_outside():
    assert counts(judge([true(distance=25)], []).bands["outside"]) == (0, 0, 1)


def test_the_overlap_must_reach_a_half():
    # 10 wide and shifted by d: IoU (10 - d) / (10 + d); a half at d = 10/3.
    assert counts(judge([true()], [seen(3.3)]).overall) == (1, 0, 0)
    assert counts(judge([true()], [seen(3.4)]).overall) == (0, 1, 1)
    # Just a half counts.
    assert counts(judge([true(w=10)], [seen(w=5)]).overall) == (1, 0, 0)


def test_a_second_detection_of_one_person_is_a_false_alarm():
    assert counts(judge([true()], [seen(), seen(0.5)]).overall) == (1, 1, 0)


def test_the_surer_detection_chooses_first():
    # The better detection fits both people, best the left one; the other fits only the left one.
    people = [true(0), true(2.5)]
    sure, unsure = seen(0.5, value=0.9), seen(-2.5, value=0.1)
    assert counts(judge(people, [unsure, sure]).overall) == (1, 1, 1)
    sure, unsure = seen(0.5, value=0.1), seen(-2.5, value=0.9)
    assert counts(judge(people, [unsure, sure]).overall) == (2, 0, 0)


def test_hardly_visible_people_are_passed_over():
    hidden = true(visible=0.24)
    assert counts(judge([hidden], []).overall) == (0, 0, 0)
    assert counts(judge([hidden], [seen(), seen(0.5)]).overall) == (0, 0, 0)
    assert counts(judge([hidden], [seen(50)]).overall) == (0, 1, 0)
    assert counts(judge([true(visible=0.25)], []).overall) == (0, 0, 1)
    assert judge([hidden, true(50)], []).ignored == 1


def test_a_visible_person_goes_before_a_hidden_one():
    # The detection overlaps the hidden one more, but finds the visible one well enough.
    assert counts(judge([true(0, visible=0.1), true(2)], [seen(0.5)]).overall) == (1, 0, 0)


def test_only_answered_frames_count():
    truth = truth_of([[true()], [true()], [true()]])
    result = score(truth, [answer(0, [seen()]), answer(2, []), answer(99, [seen()])])
    assert (result.frames, result.missing_frames, result.unjudged_frames) == (2, 1, 1)
    assert counts(result.overall) == (1, 0, 1)


def test_of_two_answers_the_last_counts():
    result = score(truth_of([[true()]]), [answer(0, []), answer(0, [seen()])])
    assert (result.frames, counts(result.overall)) == (1, (1, 0, 0))


def test_other_bands():
    result = judge([true(distance=3)], [], bands=[(0, 2.5), (2.5, 4)])
    assert counts(result.bands["2.5-4 m"]) == (0, 0, 1)
    assert list(result.bands) == ["0-2.5 m", "2.5-4 m", "outside", "unknown"]


def boxes(*places):
    return np.array([(x, 0.0, 10.0, 20.0) for x in places]).reshape(-1, 4)


def test_who_is_found_by_which_detection():
    assert pair(boxes(52, 1, 0, 99, 300), boxes(0, 50), boxes(100)) == [1, 0, FALSE, SPARED, FALSE]
    assert pair(boxes(0), boxes(), boxes()) == [FALSE]
    assert pair(boxes(), boxes(0), boxes()) == []


def test_how_much_overlap_pairs():
    assert pair(boxes(3), boxes(0), boxes(), 0.6) == [FALSE]
    assert pair(boxes(3), boxes(0), boxes(), 0.5) == [0]
    assert pair(boxes(3), boxes(), boxes(0), 0.6) == [FALSE]


truths = st.builds(
    true,
    st.floats(0, 600),
    w=st.floats(1, 80),
    h=st.floats(1, 80),
    distance=st.floats(0, 30),
    visible=st.floats(0, 1),
)
found = st.builds(
    seen,
    st.floats(0, 600),
    w=st.floats(1, 80),
    h=st.floats(1, 80),
    value=st.floats(0, 1),
    distance=st.none() | st.floats(0, 30),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.lists(truths, max_size=5), st.lists(found, max_size=5)), max_size=4))
def test_every_person_and_every_detection_is_counted_once(frames):
    truth = truth_of([people for people, _ in frames])
    result = score(truth, [answer(n, detections) for n, (_, detections) in enumerate(frames)])
    visible = [person for people, _ in frames for person in people if person.visible >= 0.25]
    overall = result.overall
    assert overall.tp + overall.fn == len(visible)
    assert overall.tp + overall.fp <= sum(len(detections) for _, detections in frames)
    assert result.ignored == sum(len(people) for people, _ in frames) - len(visible)
    for band, low, high in (("0-2 m", 0, 2), ("2-10 m", 2, 10), ("10-20 m", 10, 20)):
        inside = sum(low <= person.distance_m < high for person in visible)
        assert result.bands[band].tp + result.bands[band].fn == inside
    if not result.ignored:
        assert overall.tp + overall.fp == sum(len(detections) for _, detections in frames)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(truths, max_size=4), min_size=1, max_size=3))
def test_perfect_detections_are_perfect(frames):
    # People side by side, so that none hides in another's box.
    rows = [[true(100.0 * n, distance=person.distance_m) for n, person in enumerate(people)] for people in frames]
    answers = [answer(n, [seen(p.x, distance=p.distance_m) for p in people]) for n, people in enumerate(rows)]
    result = score(truth_of(rows), answers)
    people = sum(map(len, rows))
    assert counts(result.overall) == (people, 0, 0)
    assert result.overall.f1 == (1.0 if people else None)


@settings(max_examples=60, deadline=None)
@given(st.lists(truths, max_size=5), st.lists(found, max_size=5), st.randoms(use_true_random=False))
def test_the_order_of_detections_does_not_matter(people, detections, random):
    shuffled = list(detections)
    random.shuffle(shuffled)
    assert judge(people, detections).bands == judge(people, shuffled).bands
