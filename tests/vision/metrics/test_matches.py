from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import ParameterError
from socialbot.vision.metrics.matches import Rules, judge, parse_bands
from socialbot.vision.metrics.truth import Region, TruthObject
from tests.vision.metrics.scenes import frame, person, seen

RULES = Rules()
PRESENCE = Rules(presence=True)


def kinds(matches):
    return sorted((verdict.kind, verdict.band) for verdict in matches)


def causes(matches):
    return [verdict.cause for verdict in matches if verdict.kind == "false"]


def thing(kind, x=0.0, *, w=10.0, h=20.0):
    return TruthObject(kind=kind, x=x, y=0, w=w, h=h)


def test_parses_bands():
    assert parse_bands("0-2, 2-10,10-20") == ((0, 2), (2, 10), (10, 20))
    assert Rules(parse_bands("0.5-3.5")).keys == ("0.5-3.5", "outside", "unknown")


@pytest.mark.parametrize("text", ["", "2", "2-", "a-b", "3-2", "2-2", "-1-2", "0-inf", "0-2,1-3", "2-10,0-2"])
def test_refuses_invalid_bands(text):
    with pytest.raises(ParameterError, match="--bands"):
        parse_bands(text)


def test_hits_use_the_true_distance_and_false_positives_the_detected_one():
    matches = judge(frame(person(0, distance=1.9), person(100, distance=15)), [seen(0, distance=7), seen(300)], RULES)
    assert kinds(matches) == [("false", "2-10"), ("hit", "0-2"), ("missed", "10-20")]


def test_people_of_unknown_distance_are_a_band():
    matches = judge(frame(person(0, distance=None), person(100, distance=None)), [seen(0)], RULES)
    assert kinds(matches) == [("hit", "unknown"), ("missed", "unknown")]


def test_false_positives_without_ranges_have_no_distance():
    assert kinds(judge(frame(ranged=False), [seen(distance=3)], RULES)) == [("false", "unknown")]


def test_least_overlap_is_configurable():
    off = seen(3)  # IoU 7 / 13
    assert kinds(judge(frame(person()), [off], RULES)) == [("hit", "2-10")]
    assert kinds(judge(frame(person()), [off], Rules(least_iou=0.6))) == [("false", "2-10"), ("missed", "2-10")]


def test_incomplete_frame_has_no_false_positives():
    matches = judge(frame(person(0), person(100), complete=False), [seen(0), seen(300)], RULES)
    assert kinds(matches) == [("hit", "2-10"), ("missed", "2-10"), ("spared", "2-10")]


def test_detections_in_ignored_boxes_are_not_scored():
    ignoring = frame(person(0), ignore=(Region(x=200, y=0, w=100, h=100),))
    detections = [seen(0), seen(210), seen(250), seen(194), seen(196)]
    matches = judge(ignoring, detections, RULES)
    # The one at 194 lies in it by 4 of its 10 pixels, that at 196 by 6.
    assert [verdict.box[0] for verdict in matches if verdict.kind == "false"] == [194]
    assert kinds(matches).count(("spared", "2-10")) == 3


def test_labelled_people_in_an_ignored_box_are_scored():
    assert kinds(judge(frame(person(0), ignore=(Region(x=0, y=0, w=50, h=50),)), [], RULES)) == [("missed", "2-10")]


def test_causes_of_false_positives():
    busy = frame(
        person(0), person(100, visible=0.1), objects=(thing("coat stand", 200), thing("poster", 300, w=200, h=200))
    )
    detections = [
        seen(0, score=0.9),
        seen(1, score=0.8),
        seen(105, score=0.7),
        seen(203, score=0.6),
        seen(400, score=0.5),
        seen(600, score=0.4),
    ]
    found = causes(judge(busy, detections, RULES))
    assert found == ["double", "hardly visible person", "coat stand", "poster", "nothing known"]


def test_poor_box_of_a_missed_person():
    matches = judge(frame(person(0)), [seen(5)], RULES)
    assert causes(matches) == ["poor box"]
    assert kinds(matches) == [("false", "2-10"), ("missed", "2-10")]


def test_person_goes_before_an_object_as_cause():
    assert causes(judge(frame(person(0), objects=(thing("shadow", 8),)), [seen(4)], RULES)) == ["poor box"]


def test_hardly_visible_people_are_not_matched():
    assert kinds(judge(frame(person(visible=0.1)), [seen()], RULES)) == [("spared", "2-10")]
    assert kinds(judge(frame(person(visible=0.1)), [], RULES)) == []


def test_presence_matches_bands():
    two = frame(person(0, distance=3), person(100, distance=4), person(200, distance=15))
    assert kinds(judge(two, [seen(500, distance=9)], PRESENCE)) == [("hit", "2-10"), ("missed", "10-20")]
    assert kinds(judge(frame(), [seen(distance=1), seen(50, distance=1)], PRESENCE)) == [("false", "0-2")]
    assert kinds(judge(frame(), [], PRESENCE)) == []


def test_presence_does_not_score_bands_with_hardly_visible_people():
    assert kinds(judge(frame(person(visible=0.1)), [seen()], PRESENCE)) == [("spared", "2-10")]


def test_presence_matches_any_detection_with_unknown_distance():
    unranged = frame(person(0, distance=None), ranged=False)
    assert kinds(judge(unranged, [seen(300, distance=7)], PRESENCE)) == [("hit", "unknown")]
    assert kinds(judge(unranged, [], PRESENCE)) == [("missed", "unknown")]


def test_presence_has_the_best_score():
    (verdict,) = judge(frame(person()), [seen(score=0.3), seen(50, score=0.8)], PRESENCE)
    assert verdict.score == 0.8


places, sizes, meters = st.floats(0, 600), st.floats(1, 80), st.floats(0, 30)
persons = st.builds(person, places, w=sizes, h=sizes, distance=st.none() | meters, visible=st.floats(0, 1))
detections = st.builds(seen, places, w=sizes, h=sizes, score=st.floats(0, 1), distance=st.none() | meters)
frames = st.builds(
    lambda people, complete, ranged, ignore: frame(*people, complete=complete, ranged=ranged, ignore=tuple(ignore)),
    st.lists(persons, max_size=5),
    st.booleans(),
    st.booleans(),
    st.lists(st.builds(Region, x=places, y=places, w=sizes, h=sizes), max_size=2),
)


@settings(deadline=None)
@given(frames, st.lists(detections, max_size=6))
def test_every_person_and_detection_is_matched_once(truth, found):
    matches = judge(truth, found, RULES)
    count = {kind: sum(verdict.kind == kind for verdict in matches) for kind in ("hit", "missed", "false", "spared")}
    assert count["hit"] + count["missed"] == sum(each.counts for each in truth.persons)
    assert count["hit"] + count["false"] + count["spared"] == len(found)
    assert all(verdict.cause for verdict in matches if verdict.kind == "false")
    assert truth.complete or not count["false"]


@settings(deadline=None)
@given(frames, st.lists(detections, max_size=6), st.randoms(use_true_random=False), st.booleans())
def test_order_of_detections_does_not_matter(truth, found, random, presence):
    rules = Rules(presence=presence)
    shuffled = list(found)
    random.shuffle(shuffled)
    assert judge(truth, found, rules) == judge(truth, shuffled, rules)


@settings(deadline=None)
@given(frames, st.lists(detections, max_size=6), st.floats(0, 1))
def test_matches_do_not_depend_on_lower_scores(truth, found, threshold):
    def of_detections(matches):
        # Why something is a false alarm may depend on who else is found.
        return [replace(each, cause="") for each in matches if each.kind != "missed" and each.score >= threshold]

    sure = judge(truth, [each for each in found if each.score >= threshold], RULES)
    assert of_detections(judge(truth, found, RULES)) == of_detections(sure)
