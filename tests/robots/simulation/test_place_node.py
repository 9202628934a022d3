"""The node of a simulated place, its pictures and its ground truth."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from socialbot.core.clock import SECOND
from socialbot.core.messages import CompressedImage, JointTrajectory, Message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.robots.simulation.demo import PLACE, simulation
from socialbot.robots.simulation.node import PAN, TILT, SimulatedHead, SimulatedPlace
from socialbot.robots.simulation.truth import CAMERA_HEIGHT_M, HeadCamera
from socialbot.vision.detector import iou
from socialbot.vision.detectors import DETECTORS, DetectorSettings
from socialbot.vision.images import bgr_from_compressed
from socialbot.vision.metrics.truth import TruthMessage, parse_json
from socialbot.vision.transforms import TransformTree
from tests.system.running import socialbot_here

COMMANDS = frozenset({"/head_controller/joint_trajectory"})


def messages(seconds: float, **parameters: object) -> dict[str, list[Message]]:
    """Run a place alone, and return its messages by topic."""
    graph = simulation(head="still", **parameters)  # type: ignore[arg-type]
    runner = InlineRunner(graph, start=SECOND)
    found: dict[str, list[Message]] = {topic: [] for topic in graph.topics()}
    for topic in found:
        runner.tap(topic, lambda topic, message: found[topic].append(message))
    runner.start()
    runner.advance(round((1 + seconds) * SECOND))
    runner.close()
    assert not [fault for fault in runner.faults.values() if fault.failures]
    return found


def test_the_truth_has_the_form_of_the_evaluation_and_says_who_faces_and_talks_to_whom():
    found = messages(30, pictures=False, people=8, seed=0, duration_s=30.0, rate_hz=2.0)
    texts = [message.data for message in found["/ground_truth/persons"]]  # type: ignore[attr-defined]
    frames = [parse_json(text, TruthMessage, where="truth", remedy="") for text in texts]
    assert len(frames) == 61
    assert max(len(frame.persons) for frame in frames) >= 2
    people = [person for text in texts for person in json.loads(text)["persons"]]
    assert all(0.05 <= person["visible"] <= 1 and 0 <= person["facing_rad"] <= math.pi for person in people)
    talkers = [person for person in people if person["talks_to"]]
    assert talkers
    assert sum(person["faces"] == person["talks_to"] for person in talkers) > 0.8 * len(talkers)


def test_a_place_begins_when_its_node_starts():
    graph = simulation(head="sweep", pictures=False, people=1, duration_s=1.0, rate_hz=2.0)
    runner = InlineRunner(graph)  # the clock is not set yet
    stamps: list[int] = []
    runner.tap("/joint_states", lambda _, message: stamps.append(message.stamp))
    runner.clock.set(10 * SECOND)
    runner.start()
    runner.advance(12 * SECOND)
    assert stamps == [round((10 + number / 20) * SECOND) for number in range(21)]


def test_people_behind_others_and_outside_of_the_picture_are_less_visible():
    found = messages(40, pictures=False, people=12, seed=1, duration_s=40.0, rate_hz=2.0)
    shares = [
        person["visible"]
        for message in found["/ground_truth/persons"]
        for person in json.loads(message.data)["persons"]  # type: ignore[attr-defined]
    ]
    assert min(shares) < 0.5 < max(shares)


def test_nobody_who_reaches_into_the_image_is_left_out(monkeypatch):
    def persons() -> list[list[object]]:
        truths = messages(30, seed=5, people=8, pictures=False, rate_hz=2.0, duration_s=30.0)["/ground_truth/persons"]
        return [json.loads(message.data)["persons"] for message in truths]  # type: ignore[attr-defined]

    quick = persons()
    monkeypatch.setattr(HeadCamera, "may_show", lambda *_: True)
    assert sum(map(len, quick)) > 20
    assert quick == persons()


def test_the_camera_projects_as_a_pinhole_that_pans_and_tilts():
    ahead = HeadCamera()
    pixels, depths = ahead.seen(np.array([[3.0, 0.0, CAMERA_HEIGHT_M], [3.0, 1.0, CAMERA_HEIGHT_M + 1]]))
    assert pixels[0] == pytest.approx([320, 240])
    assert pixels[1] == pytest.approx([320 - ahead.focal_px / 2.94, 240 - ahead.focal_px / 2.94])
    assert depths == pytest.approx([2.94, 2.94])
    turned = HeadCamera(pan_rad=math.atan2(1, 3), tilt_rad=0.3)
    pixels, _ = turned.seen(np.array([[3.0, 1.0, CAMERA_HEIGHT_M + math.hypot(3, 1) * math.tan(0.3)]]))
    assert pixels[0] == pytest.approx([320, 240])


def turned(head: str) -> tuple[dict[str, Any], np.ndarray]:
    """Command the head of a place for 3 s; return the last ground truth, and the pose of the lens by transforms."""
    parameters = {"head": head, "pictures": False, "people": 8, "seed": 0, "duration_s": 20.0, "rate_hz": 1.0}
    runner = InlineRunner(Graph("turned", (NodeConfig(PLACE, SimulatedPlace, parameters),), inputs=COMMANDS))
    truths: list[dict[str, Any]] = []
    tree = TransformTree()
    runner.tap("/ground_truth/persons", lambda _, message: truths.append(json.loads(message.data)))  # type: ignore[attr-defined]
    for topic in ("/tf", "/tf_static"):
        runner.tap(topic, lambda _, message: tree.add(message.transforms))  # type: ignore[attr-defined]
    runner.start()
    runner.advance(14 * SECOND)
    runner.feed("/head_controller/joint_trajectory", command(-0.4, 0.2, 1.0))
    runner.advance(17 * SECOND)
    lens = tree.lookup("base_footprint", "camera_optical_frame", 17 * SECOND)
    assert lens is not None
    return truths[-1], lens


def test_truth_and_transforms_follow_the_head():
    truth, lens = turned("commanded")
    assert truth["camera"]["yaw_rad"] == pytest.approx(-0.4, abs=0.005)
    assert truth["camera"]["pitch_rad"] == pytest.approx(-0.2, abs=0.005)
    ahead = (math.cos(0.2) * math.cos(-0.4), math.cos(0.2) * math.sin(-0.4), math.sin(0.2))
    assert lens[:3, 2] == pytest.approx(ahead, abs=0.005)  # the optical axis
    assert truth["persons"]
    for person in truth["persons"]:
        x, y = person["at"]
        assert person["bearing_rad"] == pytest.approx(math.atan2(y, x) + 0.4, abs=0.03)


def test_a_still_head_takes_no_commands():
    truth, _ = turned("still")
    assert (truth["camera"]["yaw_rad"], truth["camera"]["pitch_rad"]) == (0.0, 0.0)


def test_a_fast_motion_beyond_the_limit_ends_at_rest_without_a_swing():
    head = SimulatedHead()
    fast = JointTrajectory(stamp=0, joint_names=(PAN,), positions=(3.0,), velocities=(6.0,), duration_s=1.0)
    head.command(fast, 0)
    pans = []
    for step in range(1, 151):
        head.advance(step * SECOND // 100)
        pans.append(head.pan_rad)
    assert -0.005 < min(pans) <= max(pans) < 1.605


def test_perception_by_the_truth_draws_no_pictures():
    assert simulation(perception="truth").node(PLACE).parameters["pictures"] is False


def command(pan: float, tilt: float, seconds: float) -> JointTrajectory:
    return JointTrajectory(
        stamp=0, joint_names=(PAN, TILT), positions=(pan, tilt), velocities=(0.0, 0.0), duration_s=seconds
    )


def test_the_head_follows_a_trajectory_within_its_limits_without_overshoot():
    head = SimulatedHead()
    head.command(command(0.8, -2.0, 1.0), 0)
    way = []
    for step in range(1, 151):
        head.advance(step * SECOND // 100)
        way.append((head.pan_rad, head.tilt_rad))
    pans, tilts = np.array(way).T
    assert pans[49] < 0.4 < pans[57]  # half way after half of the time, at most 80 ms late
    assert pans[-1] == pytest.approx(0.8, abs=0.005)
    assert pans.max() < 0.81
    assert tilts[-1] == pytest.approx(-0.8, abs=0.005)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes():
    def digest(seed: int) -> str:
        found = messages(2, people=5, seed=seed, duration_s=2.0, width=160, height=120, rate_hz=5.0)
        images = found["/camera/image_raw/compressed"]
        assert len(images) == 11
        return hashlib.sha256(b"".join(image.data.tobytes() for image in images)).hexdigest()  # type: ignore[attr-defined]

    assert digest(3) == digest(3) != digest(4)


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "unlike"), [(2.0, True), (0.0, False)])
def test_only_noise_tells_the_pictures_of_an_empty_place_apart(noise, unlike):
    found = messages(0.2, people=0, width=160, height=120, duration_s=1.0, noise=noise)
    first, second, *_ = (
        bgr_from_compressed(image)
        for image in found["/camera/image_raw/compressed"]
        if isinstance(image, CompressedImage)
    )
    assert bool((first != second).mean() > 0.2) == unlike
    assert np.abs(first.astype(int) - second).max() < 40


@pytest.mark.slow
def test_the_default_detector_finds_the_drawn_people():
    found = messages(30, people=8, seed=2, duration_s=30.0, width=320, height=240, rate_hz=1.0)
    spec = DETECTORS["nanodet"]
    detector = spec.make(DetectorSettings())
    hits = people = 0
    truths = [json.loads(message.data) for message in found["/ground_truth/persons"]]  # type: ignore[attr-defined]
    for truth, image in zip(truths, found["/camera/image_raw/compressed"], strict=True):
        assert isinstance(image, CompressedImage)
        boxes = detector.detect(bgr_from_compressed(image)).boxes
        for person in truth["persons"]:
            if person["visible"] > 0.7:
                people += 1
                box = np.array([person[side] for side in "xywh"])
                hits += bool(len(boxes) and iou(box, boxes).max() > 0.5)
    assert people > 40
    assert hits >= 0.95 * people


@pytest.mark.slow
def test_a_bag_of_the_demo_replays_to_the_same_decisions(tmp_path: Path):
    small = ["--set", f"{PLACE}.width=320", "--set", f"{PLACE}.height=240"]
    out = tmp_path / "run"
    socialbot_here("demo", "foyer", "--duration", "60", "--seed", "1", "--out", str(out), *small)
    replayed = socialbot_here("replay", str(out / "bag"), "--out", str(tmp_path / "replay"))
    results = json.loads((tmp_path / "replay" / "results.json").read_text())
    assert replayed.returncode == 0, replayed.stderr
    assert results["decisions"]["exact"], replayed.stdout
    assert results["decisions"]["recorded"] > 3


AWAY = """
place: corridor
people:
  - id: ann
    enter: behind
    legs:
      - {walk: [0.6, -0.6], speed: 1.0, aim: pass}
      - {walk: [3.0, -0.4], speed: 1.0, aim: pass}
      - {walk: end, aim: pass}
"""
COMES = """
place: corridor
people:
  - id: ann
    enter: left
    legs:
      - {walk: [4.0, 0.0], speed: 1.4}
      - {walk: [1.9, 0.0], face: robot, aim: visit}
      - {stand: 5, face: robot, aim: visit}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "seconds", "greets"), [(AWAY, 9.0, False), (COMES, 11.0, True)], ids=["walks away", "comes"]
)
def test_people_who_walk_away_are_not_greeted(script: str, seconds: float, greets: bool, tmp_path: Path):
    file = tmp_path / "script.yaml"
    file.write_text(script)
    graph = simulation("corridor", script=file, seed=5, duration_s=seconds)
    runner = InlineRunner(graph, start=SECOND)
    said: list[str] = []
    runner.tap("/speech/say", lambda _, message: said.append(message.key))  # type: ignore[attr-defined]
    runner.start()
    runner.advance(SECOND + round(seconds * SECOND))
    runner.close()
    assert ("greeting" in said) == greets
