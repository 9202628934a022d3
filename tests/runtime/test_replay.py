from __future__ import annotations

import resource
import sys
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, GraphError
from socialbot.core.messages import CameraInfo, Image, PersonDetections
from socialbot.graph.files import dump_graph, load_graph, with_changes
from socialbot.runs.bag_images import write_video
from socialbot.runs.record import RunRecord
from socialbot.runs.report import recorded
from socialbot.runtime.bag_source import BagSource, find_truth, graph_of, replay
from tests.planning import busy
from tests.system.running import limited, socialbot_here
from tests.vision.metrics.scenes import IMAGES, drawn_bag

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


def test_finds_the_truth_beside_a_bag(tmp_path):
    drawn_bag(tmp_path, "run", frames=3)
    with open_bag(drawn_bag(tmp_path, "run.1", frames=2)) as bag:
        truth = find_truth(bag)
    assert truth is not None
    assert len(truth.frames) == 2


def test_finds_the_graph_in_a_bag(tmp_path):
    assert graph_of(tmp_path).name == "waldo"
    (tmp_path / "graph.yaml").write_text("name: mute\nnodes:\n  head: {type: head, remap: {detections: ~/seen}}\n")
    with pytest.raises(GraphError, match=r"graph\.yaml:3: head.*nobody publishes"):
        graph_of(tmp_path)
    (tmp_path / "graph.yaml").write_text("name: mute\nnodes:\n  camera: {type: camera}\n")
    assert graph_of(tmp_path).name == "mute"


def test_does_not_import_code_beside_a_bag(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "lies_beside.py").write_text("raise SystemExit('this was run')")
    (tmp_path / "graph.yaml").write_text("name: odd\nnodes:\n  odd: {type: lies_beside:Node}\n")
    with pytest.raises(GraphError, match="there is no module 'lies_beside'"):
        graph_of(tmp_path)


def test_the_graph_of_a_bag_moves_no_robot(tmp_path):
    head = "type: 'socialbot.robots.reachy_mini:ReachyHead', parameters: {in_simulated_time: true, rate_hz: 9.0}"
    text = f"name: odd\ninputs: [/robot/head_target]\nnodes:\n  robot_head: {{{head}}}\n"
    (tmp_path / "graph.yaml").write_text(text)
    graph = graph_of(tmp_path)
    assert graph.node("robot_head").parameters == {"in_simulated_time": False, "rate_hz": 9.0}
    moved = with_changes(graph, ["robot_head.in_simulated_time=true"])
    assert moved.node("robot_head").parameters["in_simulated_time"], "only the user may say so"


@pytest.mark.slow
@busy.in_turn
@busy.can_be_made
def test_a_busy_machine_does_not_change_the_trace(tmp_path):
    bag = BAGS / "warehouse_run2"
    graph = graph_of(bag).with_parameters({"gripper_a": {"planning_timeout_s": 0.5}})
    traces = []
    for name, machine in ("alone", nullcontext()), ("among others", busy.busy_machine()):
        with machine:
            outcome = replay(bag, graph, tmp_path / name)
        assert outcome.decisions is not None
        assert outcome.decisions.exact, outcome.decisions.text
        traces.append((tmp_path / name / "trace.jsonl").read_bytes())
    assert traces[0] == traces[1]


def test_finds_the_images_of_a_run_from_any_folder(tmp_path, monkeypatch):
    drawn_bag(tmp_path, "visit", frames=3)
    monkeypatch.chdir(tmp_path)
    done = socialbot_here("replay", "visit", "--runner", "inline", "--no-video", "--out", "run")
    assert done.returncode == 0, done.stderr
    assert "visit has no graph of its own: it goes through waldo" in done.stderr
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with recorded(tmp_path / "run") as run:
        assert run.damage == []
        assert run.picture(run.end) is not None


@pytest.mark.parametrize("kind", [str, Path])
def test_replay_takes_paths_as_texts_and_as_paths(tmp_path, kind):
    bag = drawn_bag(tmp_path, "visit", frames=2)
    truth, graph = tmp_path / "visit.truth.json", tmp_path / "own.yaml"
    graph.write_text(dump_graph(load_graph("waldo")).replace("name: waldo", "name: own"))
    result = replay(kind(bag), kind(graph), kind(tmp_path / "run"), truth=kind(truth), cache=False)
    assert result.results["graph"] == "own"


def test_a_graph_without_detections_has_no_scores(tmp_path):
    bag = drawn_bag(tmp_path, "visit", frames=2)
    nodes = "{camera: {type: camera}, image_converter: {type: image_converter}}"
    (tmp_path / "own.yaml").write_text(f"name: plain\ninputs: [/camera/image_raw]\nnodes: {nodes}\n", "utf-8")
    result = replay(bag, tmp_path / "own.yaml", tmp_path / "run", cache=False)
    assert (result.scores, result.results["scores"]) == (None, None)
    assert not (tmp_path / "run" / "scored.jsonl").exists()


def test_replay_never_writes_the_camera_file(tmp_path):
    settings = {"camera_file": "camera.json", "keep_pose": True}
    graph = load_graph("waldo").with_parameters({"person_detector": settings})
    with open_bag(drawn_bag(tmp_path, frames=2)) as bag:
        replayed = BagSource(bag).prepare(graph, "inline", tmp_path)
    detector = next(each for each in replayed.nodes if each.name == "person_detector")
    assert (detector.parameters["keep_pose"], detector.parameters["camera_file"]) == (False, "camera.json")


@pytest.mark.parametrize(("topic", "rectified"), [("/camera/image_rect", True), ("/camera/image_raw", False)])
def test_rectified_topics_have_no_distortion_in_a_replay(tmp_path, topic, rectified):
    with BagWriter(tmp_path / "bag") as out:
        out.write(topic, Image.from_bgr(np.zeros((4, 6, 3), np.uint8), stamp=SECOND, frame_id="eye"), SECOND)
    with open_bag(tmp_path / "bag") as bag:
        replayed = BagSource(bag).prepare(load_graph("waldo"), "inline", tmp_path)
    detector = next(each for each in replayed.nodes if each.name == "person_detector")
    assert detector.parameters.get("rectified", False) is rectified


def test_a_video_that_cannot_be_written_is_an_error(tmp_path):
    """OpenCV reports no error of the disk, and leaves a file that no player opens."""
    made = drawn_bag(tmp_path, frames=5)
    with RunRecord(tmp_path / "run") as record, open_bag(made) as bag:
        with limited(resource.RLIMIT_FSIZE, 4000), pytest.raises(BagError, match="the video cannot be written"):
            write_video(bag, IMAGES, record, None, tmp_path / "video.mp4")
        assert not (tmp_path / "video.mp4").exists()
        assert write_video(bag, IMAGES, record, None, tmp_path / "video.mp4").stat().st_size > 4000


def test_the_video_has_the_times_of_the_run(tmp_path):
    """Cameras pause, change their rate and begin late; people who label the video write down its times."""
    taken_s = [*np.arange(1.0, 2.0, 0.1), *np.arange(4.0, 5.0, 0.1), *np.arange(5.0, 7.0, 0.2)]
    with BagWriter(tmp_path / "bag") as out:
        out.write(
            "/camera/camera_info", CameraInfo(stamp=SECOND, frame_id="eye", width=64, height=64, k=(9.0,) * 9), SECOND
        )
        for number, at_s in enumerate(taken_s):
            stamp = SECOND + round(float(at_s) * SECOND)
            grey = np.full((64, 64, 3), 20 + 8 * number, np.uint8)
            out.write(IMAGES, Image.from_bgr(grey, stamp=stamp, frame_id="eye"), stamp)
        out.write(
            "/tail", CameraInfo(stamp=30 * SECOND, frame_id="eye", width=64, height=64, k=(9.0,) * 9), 30 * SECOND
        )
    with RunRecord(tmp_path / "run") as record, open_bag(tmp_path / "bag") as bag:
        for at_s in taken_s:
            stamp = SECOND + round(float(at_s) * SECOND)
            record.observe(IMAGES, PersonDetections(stamp=stamp, frame_id="eye", persons=(), width=64, height=64))
        video = cv2.VideoCapture(str(write_video(bag, IMAGES, record, None, tmp_path / "video.mp4")))
    shown = []
    while True:
        at_s = video.get(cv2.CAP_PROP_POS_FRAMES) / video.get(cv2.CAP_PROP_FPS)
        found, pixels = video.read()
        if not found:
            break
        shown.append((at_s, int(pixels[:, -1].max())))
    assert {round((grey - 20) / 8) for at_s, grey in shown if at_s > 0.9} == set(range(len(taken_s))), "all are shown"
    for at_s, grey in shown:
        before, until = (sum(each < at_s + margin for each in taken_s) for margin in (-0.11, 0.11))
        assert before <= round((grey - 20) / 8) + 1 <= until if grey > 16 else before == 0, (at_s, grey)
    assert shown[-1][0] == pytest.approx(taken_s[-1], abs=0.21)
