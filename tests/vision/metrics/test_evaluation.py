"""Whole evaluations, of small bags and pictures, with HOG, which needs nothing beyond OpenCV."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from socialbot.core.errors import ImageError, ParameterError, SocialbotError, TruthError
from socialbot.core.installation import extra_command
from socialbot.runs.evaluation_json import content
from socialbot.vision.metrics.evaluation import Evaluation, EvaluationPlan, evaluate, scene_names
from socialbot.vision.metrics.frames import bag_source, image_sources
from socialbot.vision.metrics.pipeline import PipelineSettings, with_changes
from socialbot.vision.metrics.scores import PrecisionRecallCurve
from tests.vision.metrics.scenes import POSE, START, WALDO, drawn_bag, drawn_pictures, evaluated, with_band

HOG = PipelineSettings("hog")
PICTURES = 8


def carried_out(sources, **fields) -> Evaluation:
    plan = EvaluationPlan(tuple(sources), (HOG,), **{"threads": 0, "waldo": WALDO, **fields})
    return evaluate(plan, lambda job, frames: None, lambda what: None)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return drawn_bag(tmp_path_factory.mktemp("bag"), scene="hall", split="tune", frames=PICTURES)


@pytest.fixture(scope="module")
def tracked(bag) -> Evaluation:
    """Evaluation of the bag with tracking, and with the pose of the camera: people stand on the floor."""
    return evaluated([bag_source(bag)], with_changes(HOG, POSE))


@pytest.fixture(scope="module")
def untracked(bag) -> Evaluation:
    """Evaluation of the bag without tracking."""
    return evaluated([bag_source(bag)], with_changes(HOG, ["tracker=none"]))


@pytest.fixture(scope="module")
def two_bags(tmp_path_factory):
    """Two bags of 6 and 2 images, and the content of their evaluation in this process."""
    folder = tmp_path_factory.mktemp("two")
    bags = (("one", 0, 6), ("other", 50, 2))
    sources = [bag_source(drawn_bag(folder, name, seed=seed, frames=frames)) for name, seed, frames in bags]
    return sources, content(evaluated(sources))


def test_drawn_people_are_found(tracked):
    score = tracked.detectors["hog"].scenes["hall"].score
    assert score.bands["2-10"].score.tp + score.bands["2-10"].score.fn == PICTURES
    assert score.bands["2-10"].score.tp >= PICTURES - 2
    assert score.overall.ap is not None
    assert score.overall.ap >= 0.8
    assert tracked.scenes == ("hall",)


@pytest.mark.slow
def test_processes_change_no_figures_and_report_progress_up_to_the_last_frame(two_bags):
    sources, here = two_bags
    reported = []
    plan = EvaluationPlan(tuple(sources), (HOG,), threads=0, waldo=WALDO, processes=2)
    there = evaluate(plan, lambda job, frames: reported.append((job, frames)), lambda what: None)
    assert content(there) == here
    assert {(0, 5), (0, 6), (1, 2)} <= set(reported)
    assert reported.index((0, 5)) < reported.index((0, 6))


def test_raw_detections_do_not_depend_on_tracking(bag, tracked):
    scene = tracked.detectors["hog"].scenes["hall"]
    other = evaluated([bag_source(bag)], with_changes(HOG, [*POSE, "hide_still=false", "bridge_s=1.0"]))
    frames = other.detectors["hog"].scenes["hall"].clips[0].frames
    assert [each.found.raw for each in scene.clips[0].frames] == [each.found.raw for each in frames]


def test_without_tracking_people_may_stand_anywhere(tracked, untracked):
    with_tracks, without = (each.detectors["hog"].scenes["hall"].clips[0].frames for each in (tracked, untracked))
    counts = [sum(len(each.found.raw) for each in frames) for frames in (without, with_tracks)]
    assert counts[0] > counts[1] > 0
    assert all(person.track_id for each in with_tracks for person in each.found.persons)
    assert not any(person.track_id for each in without for person in each.found.persons)


def test_pipeline_without_tracking_applies_the_threshold(untracked):
    for each in untracked.detectors["hog"].scenes["hall"].clips[0].frames:
        sure = [person for person in each.found.raw if person.score >= HOG.sure]
        assert list(each.found.persons) == sure


def test_people_are_found_in_single_images_without_tracking(tmp_path):
    scene = evaluated(image_sources(drawn_pictures(tmp_path / "room"))).detectors["hog"].scenes["room"]
    assert scene.score.bands["2-10"].score.tp >= 2
    assert scene.clips[0].behaviour is None
    assert not any(person.track_id for each in scene.clips[0].frames for person in each.found.persons)


def test_labels_that_do_not_fit_their_image(tmp_path):
    folder = drawn_pictures(tmp_path / "room")
    path = folder / "persons.json"
    entries = json.loads(path.read_text())
    entries[2]["boxes"][0]["x"] = 2000
    path.write_text(json.dumps(entries))
    with pytest.raises(TruthError, match=r"2\.png: a box begins at 2000, .*640x480"):
        evaluated(image_sources(folder))


def test_labels_that_go_on_beyond_the_image_are_cut_off(tmp_path):
    folder = drawn_pictures(tmp_path / "room", 1)
    path = folder / "persons.json"
    entries = json.loads(path.read_text())
    entries[0]["boxes"].append({"x": 600, "y": -50, "w": 100, "h": 200})
    path.write_text(json.dumps(entries))
    (scored,) = evaluated(image_sources(folder)).detectors["hog"].scenes["room"].clips[0].frames
    first, second = (each.box for each in scored.frame.persons)
    assert first == pytest.approx([entries[0]["boxes"][0][name] for name in "xywh"])
    assert second == (600, 0, 40, 150)


def test_damaged_images_are_counted_and_left_out(tmp_path):
    folder = drawn_pictures(tmp_path / "room")
    (folder / "1.png").write_bytes(b"no picture")
    clip = evaluated(image_sources(folder)).detectors["hog"].scenes["room"].clips[0]
    assert (len(clip.frames), clip.missing_frames, clip.damaged) == (2, 1, 1)
    assert "1.png" in clip.first_damage


def test_pictures_that_are_all_damaged(tmp_path):
    folder = drawn_pictures(tmp_path / "room", 1)
    (folder / "0.png").write_bytes(b"no picture")
    with pytest.raises(ImageError, match=r"none of its images can be read; the first: .*0\.png"):
        evaluated(image_sources(folder))


def test_truth_of_another_time(tmp_path):
    bag = drawn_bag(tmp_path, frames=1)
    path = tmp_path / "clip.truth.json"
    path.write_text(path.read_text().replace(str(START), "12345"))
    with pytest.raises(TruthError, match=f"clip: no image has the stamp .* {START}, the first frame 12345"):
        evaluated([bag_source(bag)])


def test_footage_that_has_gone(tmp_path):
    bag = drawn_bag(tmp_path)
    source = bag_source(bag)
    shutil.rmtree(bag)
    with pytest.raises(SocialbotError, match="no such file or folder") as caught:
        evaluated([source])
    assert caught.value.remedy


def test_speed_is_measured_on_request(tmp_path):
    bag = drawn_bag(tmp_path, frames=2)
    speed = carried_out([bag_source(bag)], threads=1).detectors["hog"].speed
    assert speed is not None
    assert (speed.frames, speed.threads) == (1, 1), "the first half is not measured"
    assert 0 < speed.decode_ms < speed.median_ms <= speed.p95_ms
    assert 0 < speed.frames_per_s < 1000


@pytest.mark.slow
def test_speed_of_a_few_images(tmp_path):
    speed = carried_out(image_sources(drawn_pictures(tmp_path / "room", 1)), threads=1).detectors["hog"].speed
    assert speed is not None
    assert speed.frames == 1


def test_scenes_with_several_splits_are_not_mixed(tmp_path):
    one = bag_source(drawn_bag(tmp_path, "one", frames=1, scene="hall", split="tune"))
    other = bag_source(drawn_bag(tmp_path, "two", frames=1, scene="hall", split="held-back"))
    third = bag_source(drawn_bag(tmp_path, "three", frames=1, scene="stairs"))
    assert scene_names([one, other, third]) == ["hall (tune)", "hall (held-back)", "stairs"]
    assert scene_names([one, third]) == ["hall", "stairs"]


def test_contents_of_the_json(tracked):
    said = content(tracked)
    band = said["detectors"]["hog"]["scenes"]["hall"]["bands"]["2-10"]
    assert band["tp"] + band["fn"] == PICTURES
    assert band["f1"] == pytest.approx(2 * band["tp"] / (2 * band["tp"] + band["fp"] + band["fn"]))
    assert said["detectors"]["hog"]["scenes"]["hall"]["bands"]["10-20"]["recall"] is None
    assert said["detectors"]["hog"]["frames_per_s"] is None
    assert said["paper"]["Scene 1"]["bands"]["0-2"]["f1"] == pytest.approx(0.593, abs=0.001)
    json.dumps(said, allow_nan=False)


@pytest.mark.parametrize(("points", "kept"), [(0, 0), (1, 1), (200, 200), (399, 200), (1000, 200)])
def test_curves_are_thinned_in_the_json_but_keep_their_ends(tracked, points, kept):
    hog = tracked.detectors["hog"]
    recall = np.arange(points) / 1000
    band = replace(hog.scenes["hall"].score.bands["2-10"], curve=PrecisionRecallCurve(recall, recall, recall))
    said = content(replace(tracked, detectors={"hog": with_band(hog, "hall", "2-10", band)}))
    curve = said["detectors"]["hog"]["scenes"]["hall"]["bands"]["2-10"]["curve"]
    assert [len(set(column)) for column in curve.values()] == [len(column) for column in curve.values()] == [kept] * 3
    assert (curve["recall"][:1], curve["recall"][-1:]) == (recall[:1].tolist(), recall[-1:].tolist())


def test_settings_are_those_of_the_node():
    assert with_changes(HOG, ["bridge_s=0.2", "nanodet.threshold=0.9"]).changes == {"bridge_s": 0.2}
    assert with_changes(PipelineSettings("nanodet"), ["nanodet.threshold=0.9"]).sure == 0.9
    assert PipelineSettings("hog").sure == PipelineSettings("hog").spec.sure


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ("threshold", "cannot read"),
        ("treshold=1", "did you mean 'threshold'"),
        ("nonodet.threshold=1", "did you mean 'nanodet'"),
        ("threshold=high", "not of type float"),
        ("bridge_s=99", "out of range"),
        ("tracker=lost", "unknown choice"),
        ("threads=4", "no setting 'threads'"),
    ],
)
def test_settings_that_do_not_fit(change, word):
    with pytest.raises(ParameterError, match=word):
        with_changes(HOG, [change])


@pytest.mark.slow
def test_cluster_gives_the_same_figures(two_bags, tmp_path):
    distributed = pytest.importorskip("distributed")
    sources, here = two_bags
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        there = carried_out(sources, scheduler=cluster.scheduler_address)
        gone = bag_source(drawn_bag(tmp_path, "gone", frames=1))
        shutil.rmtree(tmp_path / "gone")
        with pytest.raises(SocialbotError, match="no such file or folder"):
            carried_out([gone], scheduler=cluster.scheduler_address)
    assert content(there) == here


def test_scheduler_that_does_not_answer(bag, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("socialbot.vision.metrics.workers.CONNECT_S", 0.5)
    with pytest.raises(ParameterError, match="no Dask scheduler answers"):
        carried_out([bag_source(bag)], scheduler="tcp://127.0.0.1:9")


def test_without_the_extra_a_cluster_is_an_error_with_a_remedy(bag, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(SocialbotError, match=re.escape(extra_command("dask"))) as caught:
        carried_out([bag_source(bag)], scheduler="tcp://127.0.0.1:9")
    assert caught.value.exit_code == 5
