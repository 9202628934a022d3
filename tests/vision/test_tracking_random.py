"""Random detections: the tracks keep their invariants."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vision.scenes import Scene, ids

boxes_strategy = st.tuples(
    st.floats(-50, 600),
    st.floats(-50, 440),
    st.floats(5, 400),
    st.floats(5, 470),
    st.sampled_from((0.2, 0.5, 0.7, 0.95)),
)
frames_strategy = st.lists(
    st.tuples(st.sampled_from((0.0, 0.03, 0.1, 0.3, 1.0, 5.0, -0.2)), st.lists(boxes_strategy, max_size=5)), max_size=12
)


@settings(deadline=None, max_examples=100)
@given(frames_strategy, st.randoms(use_true_random=False))
def test_order_of_the_boxes_changes_nothing(frames, random):
    one, other = Scene(), Scene()
    for after_s, found in frames:
        shuffled = random.sample(found, len(found))
        first, second = one.show(*found, after_s=after_s), other.show(*shuffled, after_s=after_s)
        assert [(t.id, t.box.tolist(), t.score, t.unseen_s) for t in first] == [
            (t.id, t.box.tolist(), t.score, t.unseen_s) for t in second
        ]


@settings(deadline=None, max_examples=100)
@given(frames_strategy)
def test_every_id_is_one_unbroken_track(frames):
    scene, gone, before = Scene(bridge_s=0.5, keep_s=2.0), set[str](), set[str]()
    last_seen: dict[str, float] = {}
    for after_s, found in frames:
        tracks = scene.show(*found, after_s=after_s)
        names = ids(tracks)
        assert len(set(names)) == len(names)
        if after_s < 0:
            gone |= before
            last_seen.clear()
        assert not gone & set(names)
        for track in tracks:
            assert (track.box[2:] > 0).all()
            if track.unseen_s:
                assert track.unseen_s <= 0.5 + 1e-9
                assert scene.time_s - last_seen[track.id] == pytest.approx(track.unseen_s)
            else:
                assert (*track.box, track.score) in found
                last_seen[track.id] = scene.time_s
        # Weak boxes continue a track, published or not.
        last_seen |= {track.id: scene.time_s for track in scene.tracker.doubtful if track.id}
        scores = [track.score for track in tracks]
        assert scores == sorted(scores, reverse=True)
        gone |= {name for name, when in last_seen.items() if scene.time_s - when > 2.0 + 1e-9}
        before |= set(names)
        assert not gone & set(names)


@settings(deadline=None, max_examples=50)
@given(frames_strategy)
def test_without_a_sure_box_no_track_begins(frames):
    scene = Scene()
    for after_s, found in frames:
        assert scene.show(*(one for one in found if one[4] < 0.5), after_s=after_s) == ()


@settings(deadline=None, max_examples=50)
@given(frames_strategy)
def test_ids_count_up(frames):
    scene = Scene()
    names = [name for after_s, found in frames for name in ids(scene.show(*found, after_s=after_s))]
    first = list(dict.fromkeys(names))
    numbers = [int(name[1:]) for name in first]
    assert all(number >= 1 for number in numbers)
    assert len(set(numbers)) == len(first)
    for earlier, later in itertools.pairwise(sorted(numbers)):
        assert later > earlier


# A person in a lane of their own: first image, last image, middle in the lane, its step, height and score.
walks_strategy = st.tuples(
    st.integers(0, 20),
    st.integers(0, 20),
    st.floats(0.3, 0.7),
    st.floats(-0.03, 0.03),
    st.floats(60, 300),
    st.floats(0.77, 1.0),
)


@settings(deadline=None, max_examples=100)
@given(st.lists(walks_strategy, min_size=1, max_size=4), st.sampled_from((0.03, 0.1, 0.2, 1.0)))
def test_exact_detections_are_published_as_they_are(walks, period_s):
    scene = Scene(bridge_s=0.0)
    for image in range(21):
        found = []
        for lane, (first, last, middle, step, height, score) in enumerate(walks):
            if first <= image <= last:
                x = 160 * (lane + min(max(middle + step * (image - first), 0.3), 0.7))
                found.append((x - 0.15 * height, 90.0, 0.3 * height, height, score))
        published = scene.show(*found, after_s=period_s)
        assert sorted((*track.box, track.score) for track in published) == sorted(found)
