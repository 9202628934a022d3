from __future__ import annotations

import itertools
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from socialbot.core.messages import PersonDetection
from socialbot.vision.detector import iou
from socialbot.vision.metrics.formats import labelled_sources
from socialbot.vision.metrics.frames import LabelledFrame, bag_source
from socialbot.vision.metrics.pipeline import PipelineSettings
from socialbot.vision.metrics.tracks import TrackedFrame, TrackingScore, best_pairs, tracked_frame, tracking_score
from socialbot.vision.metrics.truth import Region
from tests.vision.metrics.scenes import drawn_bag, evaluated, frame, person, seen

REFERENCE = Path(__file__).with_name("reference")
RATES = ("mota", "motp", "idf1", "idp", "idr", "hota", "deta", "assa", "loca")


def tracks(*frames: str, overlap=0.8) -> TrackingScore:
    """The score of frames such as "a1 b-": person a has track 1, nobody has found b."""
    return tracking_score(_tracked(text, overlap) for text in frames)


def _tracked(text: str, overlap: float) -> TrackedFrame:
    pairs = [tuple(word) for word in text.split()]
    people = tuple(who for who, _ in pairs if who != "-")
    found = tuple(track for _, track in pairs if track != "-")
    overlaps = np.zeros((len(people), len(found)))
    for who, track in pairs:
        if "-" not in (who, track):
            overlaps[people.index(who), found.index(track)] = overlap
    return TrackedFrame(people, found, overlaps)


def test_perfect_tracks():
    score = tracks("a1 b2", "a1 b2", "a1 b2", overlap=1.0)
    assert {getattr(score, name) for name in RATES} == {1.0}
    assert (score.switches, score.fragments, score.mostly_tracked, score.people, score.tracks) == (0, 0, 2, 2, 2)


def test_a_new_id_is_a_switch_and_halves_the_identity():
    score = tracks("a1", "a1", "a2", "a2")
    assert (score.hits, score.switches, score.fragments) == (4, 1, 0)
    assert score.mota == 0.75
    assert score.idf1 == 0.5
    assert score.motp == pytest.approx(0.8)
    # Each pair is associated with 2 of 4 frames of its person.
    assert score.assa == pytest.approx(0.5 * 16 / 19)


def test_a_gap_is_a_fragment_and_no_switch():
    score = tracks("a1 b2", "a- b2", "a1 b2")
    assert (score.switches, score.fragments, score.missed) == (0, 1, 1)
    assert score.idr == pytest.approx(5 / 6)
    assert score.idp == 1


def test_swapped_ids_are_two_switches():
    assert tracks("a1 b2", "a2 b1").switches == 2


def test_false_tracks_lower_precision_only():
    score = tracks("a1 -9", "a1")
    assert (score.false, score.missed, score.idr) == (1, 0, 1)
    assert score.idp == pytest.approx(2 / 3)
    assert score.mota == 0.5


def test_a_pair_goes_on_while_it_overlaps_enough():
    first = TrackedFrame(("a",), ("1",), np.array([[0.9]]))
    second = TrackedFrame(("a",), ("1", "2"), np.array([[0.5, 0.9]]))
    assert tracking_score([first, second]).switches == 0
    apart = TrackedFrame(("a",), ("1", "2"), np.array([[0.4, 0.9]]))
    assert tracking_score([first, apart]).switches == 1


def test_rates_without_data_are_none():
    score = tracking_score([])
    assert {getattr(score, name) for name in RATES} == {None}


def test_sum_of_recordings():
    score = tracks("a1", "a1") + tracks("a2", "a3")
    assert (score.people, score.hits, score.switches) == (2, 4, 1)
    assert score.idf1 == 0.75


def test_nothing_in_common_scores_nothing():
    score = tracks("a-", "-1")
    assert (score.mota, score.idf1, score.hota) == (-0.5 + -0.5, 0, 0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.integers(0, 4), st.randoms(use_true_random=False))
def test_best_pairs_are_the_best(n, m, random):
    gains = np.array([random.choice((0, 0.25, random.random())) for _ in range(n * m)]).reshape(n, m)
    rows, columns = best_pairs(gains)
    assert sorted(set(rows.tolist())) == rows.tolist()
    assert len(set(columns.tolist())) == len(columns)
    small = gains if n <= m else gains.T
    every = itertools.permutations(range(max(n, m)), min(n, m))
    best = max((sum(small[row, column] for row, column in enumerate(chosen)) for chosen in every), default=0)
    assert gains[rows, columns].sum() == pytest.approx(best)
    assert (gains[rows, columns] > 0).all()


def simulated(seed: int) -> list[TrackedFrame]:
    """People who cross each other, and a poor tracker."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 10))
    place, speed = random.random((count, 2)) * 300, random.normal(size=(count, 2)) * 3
    size = np.array([40, 100]) * (0.7 + random.random((count, 1)) * 0.6)
    ids = list(range(count))
    frames = []
    for number in range(40):
        place = place + speed
        one, other = random.integers(count, size=2)
        if random.random() < 0.3:
            ids[one], ids[other] = ids[other], ids[one]
        if random.random() < 0.2:
            ids[one] = 100 + number
        there = [who for who in range(count) if random.random() < 0.9] if random.random() < 0.95 else []
        found = [who for who in range(count) if random.random() < 0.85] if random.random() < 0.95 else []
        boxes = np.hstack([place, size])
        noisy = boxes + random.normal(size=boxes.shape) * 6
        overlaps = np.array([iou(boxes[who], noisy[found]) for who in there]).reshape(len(there), len(found))
        frames.append(TrackedFrame(tuple(there), tuple(ids[who] for who in found), overlaps))
    return frames


@pytest.mark.parametrize("seed", range(8))
def test_same_figures_as_trackeval(seed):
    metrics = pytest.importorskip("trackeval.metrics")
    frames = simulated(seed)
    people, tracks = ({}, {})
    data = {
        "gt_ids": [np.array([people.setdefault(each, len(people)) for each in f.people], int) for f in frames],
        "tracker_ids": [np.array([tracks.setdefault(each, len(tracks)) for each in f.tracks], int) for f in frames],
        "similarity_scores": [f.overlaps for f in frames],
        "num_timesteps": len(frames),
        "num_gt_dets": sum(len(f.people) for f in frames),
        "num_tracker_dets": sum(len(f.tracks) for f in frames),
    }
    data |= {"num_gt_ids": len(people), "num_tracker_ids": len(tracks)}
    quiet = {"PRINT_CONFIG": False}
    clear = metrics.CLEAR(quiet).eval_sequence(data)
    identity = metrics.Identity(quiet).eval_sequence(data)
    hota = {key: np.mean(value) for key, value in metrics.HOTA().eval_sequence(data).items()}
    mine = tracking_score(frames)
    names = ("MOTA", "MOTP", "CLR_FP", "CLR_FN", "IDSW", "Frag", "MT", "ML")
    fields = ("mota", "motp", "false", "missed", "switches", "fragments", "mostly_tracked", "mostly_lost")
    assert [getattr(mine, each) for each in fields] == pytest.approx([clear[each] for each in names], abs=1e-9)
    assert [mine.idf1, mine.idp, mine.idr] == pytest.approx([identity[each] for each in ("IDF1", "IDP", "IDR")])
    assert [mine.hota, mine.deta, mine.assa, mine.loca] == pytest.approx(
        [hota[each] for each in ("HOTA", "DetA", "AssA", "LocA")]
    )


def test_same_figures_as_trackeval_had_for_files(tmp_path):
    images = tmp_path / "img1"
    images.mkdir()
    for number in range(1, 41):
        cv2.imwrite(str(images / f"{number:06}.png"), np.zeros((2, 2, 3), np.uint8))
    (tmp_path / "gt.txt").write_bytes((REFERENCE / "gt.txt").read_bytes())
    [source] = labelled_sources(tmp_path)
    found: dict[int, list[PersonDetection]] = {}
    for line in (REFERENCE / "tracks.txt").read_text().splitlines():
        number, track, *values = line.split(",")[:7]
        x, y, w, h, score = map(float, values)
        track_seen = PersonDetection(x=x, y=y, w=w, h=h, score=score, track_id=track)
        found.setdefault(int(number), []).append(track_seen)
    score = tracking_score(
        tracked_frame(frame, found.get(number, []), source.least_visible)
        for number, frame in enumerate(source.frames, 1)
    )
    figures = json.loads((REFERENCE / "figures.json").read_text())["tracks"]
    assert {name: getattr(score, name) for name in figures} == pytest.approx(figures)


# Frames


def rows(labelled: LabelledFrame, *found, **about) -> tuple[tuple, tuple]:
    tracked = tracked_frame(labelled, found, **about)
    return tracked.people, tracked.tracks


def test_people_and_tracks_of_a_frame():
    labelled = frame(person(0, id="a"), person(100, id="b"))
    assert rows(labelled, seen(0, track="t1"), seen(300, track="t2")) == (("a", "b"), ("t1", "t2"))


def test_tentative_detections_are_no_tracks():
    labelled = frame(person(0, id="a"), person(100, id="b"))
    assert rows(labelled, seen(0, track="t1"), replace(seen(100), tentative=True)) == (("a", "b"), ("t1",))


def test_track_of_a_person_who_is_not_scored():
    hidden = frame(person(0, id="a", visible=0.1))
    assert rows(hidden, seen(0, track="t1"), seen(300, track="t2")) == ((), ("t2",))
    assert rows(hidden, seen(0, track="t1"), least_visible=0.0) == (("a",), ("t1",))


def test_track_in_an_ignored_region():
    region = Region(x=290, y=0, w=50, h=50)
    labelled = frame(person(0, id="a"), person(300, id="b"), ignore=(region,))
    # The person in the region counts; another track there does not.
    found = (seen(0, track="t1"), seen(300, track="t2"), seen(320, track="t3"))
    assert rows(labelled, *found) == (("a", "b"), ("t1", "t2"))


def test_incomplete_labels_have_no_false_tracks():
    assert rows(frame(complete=False), seen(0, track="t1")) == ((), ())


def test_recordings_have_a_tracking_score_and_single_images_not(tmp_path):
    source = bag_source(drawn_bag(tmp_path, frames=3, objects=[]))
    [scene] = evaluated([source]).detectors["hog"].scenes.values()
    assert scene.tracking is not None
    assert scene.tracking.people == 1
    assert scene.tracking.hits + scene.tracking.missed == 3
    settings = PipelineSettings("hog", {"tracker": "none"})
    [scene] = evaluated([source], settings).detectors["hog"].scenes.values()
    assert scene.tracking is None
