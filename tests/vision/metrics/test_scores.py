from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.messages import PersonDetection
from socialbot.vision.metrics.matches import Match, Rules, judge
from socialbot.vision.metrics.scores import FrameMatches, average_precision, score_scene
from tests.vision.metrics.scenes import frame, person

KEYS = ("0-2", "2-10")


def hit(score=0.5, band="2-10"):
    return Match("hit", band, score=score)


def false(score=0.5, band="2-10", cause="poster"):
    return Match("false", band, score=score, cause=cause)


def missed(band="2-10"):
    return Match("missed", band)


def scored(*frames, raw=None):
    """The score of frames, each a list of verdicts and a block of its own."""
    scored = [FrameMatches(number, tuple(matches)) for number, matches in enumerate(frames)]
    return score_scene(scored, scored if raw is None else [FrameMatches(n, tuple(v)) for n, v in enumerate(raw)], KEYS)


def quickly_scored(*frames):
    """The same with a tenth of the draws of the bootstrap, for many random frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("socialbot.vision.metrics.scores.DRAWS", 100)
        return scored(*frames)


def test_counts_by_band():
    result = scored([hit(), false()], [missed(), hit(band="0-2")], [Match("spared", "2-10", score=0.9)])
    score = result.bands["2-10"].score
    assert (score.tp, score.fp, score.fn) == (1, 1, 1)
    assert result.bands["0-2"].score.recall == 1.0
    assert (result.overall.score.tp, result.overall.score.fp, result.overall.score.fn) == (2, 1, 1)
    assert (result.frames, result.blocks) == (3, 3)
    assert result.overall.causes == {"poster": 1}


def test_average_precision_of_a_known_curve():
    # Hit, false, hit, missed of three: precision 1, 1/2, 2/3 at recall 1/3, 1/3, 2/3; the dip is filled by 2/3.
    result = scored([hit(0.9), false(0.8), hit(0.7), missed()]).bands["2-10"]
    assert result.ap == pytest.approx(1 / 3 + 2 / 3 / 3)
    assert result.curve is not None
    assert result.curve.recall.tolist() == pytest.approx([1 / 3, 1 / 3, 2 / 3])
    assert result.curve.precision.tolist() == pytest.approx([1, 1 / 2, 2 / 3])
    assert result.curve.scores.tolist() == [0.9, 0.8, 0.7]


def test_detections_of_equal_score_give_one_point():
    assert scored([false(0.5), hit(0.5)]).bands["2-10"].ap == scored([hit(0.5), false(0.5)]).bands["2-10"].ap == 0.5


def test_curve_is_the_detectors_and_the_score_the_pipelines():
    result = scored([hit()], raw=[[hit(0.9), false(0.1)]]).bands["2-10"]
    assert result.score.precision == 1
    assert result.curve is not None
    assert result.curve.precision[-1] == 0.5


def test_band_without_people_has_no_average_precision():
    result = scored(*[[false(band="0-2")]] * 4).bands["0-2"]
    assert (result.ap, result.curve, result.score.precision) == (None, None, 0.0)
    assert "ap" not in result.intervals
    assert "recall" not in result.intervals


def test_average_precision_without_detections_is_zero():
    assert scored([missed()]).bands["2-10"].ap == 0.0


def test_too_few_blocks_give_no_interval():
    assert scored(*[[hit()]] * 3).bands["2-10"].intervals == {}
    assert scored(*[[hit()]] * 4).bands["2-10"].intervals["f1"] == (1.0, 1.0)
    assert scored(*[[hit()]] * 3, [], []).bands["2-10"].intervals == {}


def test_nothing_at_all():
    result = scored()
    assert (result.frames, result.overall.score.f1, result.overall.ap) == (0, None, None)


def test_perfect_detections_are_perfect():
    band = scored(*[[hit(0.5 + n / 100)] for n in range(20)]).bands["2-10"]
    assert (band.score.f1, band.ap) == (1.0, 1.0)
    assert set(band.intervals.values()) == {(1.0, 1.0)}


def test_interval_of_independent_frames_is_as_wide_as_theory_has_it():
    # 400 frames, in each a hit with a chance of 0.8: 95 % lie within 1.96 * sqrt(.8 * .2 / 400) = 0.039 of it.
    frames = [[hit()] if n % 5 else [missed()] for n in range(400)]
    low, high = scored(*frames).bands["2-10"].intervals["recall"]
    assert low == pytest.approx(0.8 - 0.039, abs=0.006)
    assert high == pytest.approx(0.8 + 0.039, abs=0.006)


def test_frames_that_belong_together_give_a_wider_interval():
    frames = [[hit()] if n % 100 < 80 else [missed()] for n in range(400)]

    def width(together):
        scored = [FrameMatches(number // together, tuple(matches)) for number, matches in enumerate(frames)]
        low, high = score_scene(scored, scored, KEYS).bands["2-10"].intervals["recall"]
        return high - low

    assert width(20) > 3 * width(1)


matches = st.one_of(
    st.builds(hit, st.floats(0, 1), st.sampled_from(KEYS)),
    st.builds(false, st.floats(0, 1), st.sampled_from(KEYS)),
    st.builds(missed, st.sampled_from(KEYS)),
)
scenes = st.lists(st.lists(matches, max_size=4), min_size=1, max_size=8)


@settings(deadline=None, max_examples=40)
@given(scenes)
def test_rates_lie_between_none_and_all_and_within_their_intervals(frames):
    result = quickly_scored(*frames)
    for band in (*result.bands.values(), result.overall):
        rates = {"precision": band.score.precision, "recall": band.score.recall, "f1": band.score.f1, "ap": band.ap}
        assert set(band.intervals) in ({name for name, rate in rates.items() if rate is not None}, set())
        for name, (low, high) in band.intervals.items():
            rate = rates[name]
            assert rate is not None
            assert 0 <= low <= rate <= high <= 1


@settings(deadline=None, max_examples=20)
@given(scenes, st.randoms(use_true_random=False))
def test_order_of_matches_does_not_matter(frames, random):
    shuffled = [list(each) for each in frames]
    for each in shuffled:
        random.shuffle(each)
    one, other = quickly_scored(*frames), quickly_scored(*shuffled)
    for key in KEYS:
        assert one.bands[key].score == other.bands[key].score
        assert one.bands[key].ap == other.bands[key].ap
        assert one.bands[key].intervals == other.bands[key].intervals


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=20))
def test_average_precision_is_between_the_curve_and_one(points):
    recall = np.sort([recall for recall, _ in points])
    precision = np.array([precision for _, precision in points])
    area = float(average_precision(recall, precision))
    assert np.sum(np.diff(recall, prepend=0) * precision) <= area + 1e-12
    assert area <= recall[-1] * precision.max() + 1e-12


def test_errors_of_distances_are_those_of_found_people_with_known_distances():
    # Errors: 0.1, -0.2, 0.5, 0 of the true distances; the standard error is 0.4 m.
    truth = [5.0, 5.0, 4.0, 1.0, None, 3.0]
    detected = [5.5, 4.0, 6.0, 1.0, 4.0, None]
    frames = []
    for there, value in zip(truth, detected, strict=True):
        std = None if value is None else 0.4
        seen = PersonDetection(x=0, y=0, w=10, h=20, score=0.5, distance_m=value, distance_std_m=std)
        false = PersonDetection(x=300, y=0, w=10, h=20, score=0.4, distance_m=9.0, distance_std_m=0.1)
        frames.append(list(judge(frame(person(distance=there), person(100.0)), [seen, false], Rules())))
    result = scored(*frames)
    near, far = result.bands["0-2"].distance, result.bands["2-10"].distance
    assert near is not None
    assert far is not None
    assert (near.people, near.median, near.p90, near.bias, near.within) == (1, 0, 0, 0, 1)
    assert (far.people, far.median, far.bias) == (3, pytest.approx(0.2), pytest.approx(0.1))
    assert far.p90 == pytest.approx(0.2 + 0.8 * 0.3)
    assert far.within == pytest.approx(1 / 3)
    assert result.overall.distance is not None
    assert result.overall.distance.people == 4


def test_no_errors_of_distances_without_distances():
    assert scored([hit(), missed(), false()]).overall.distance is None
