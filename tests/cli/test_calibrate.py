from __future__ import annotations

import itertools
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from typer import Typer
from typer.testing import CliRunner

from socialbot.bags.reader import BagWriter, open_bag
from socialbot.bridge.topics import observer_node
from socialbot.bridge.transport import message_class, open_transport
from socialbot.cli import calibrate as calibrate_command
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, ParameterError
from socialbot.core.messages import CompressedDepth, Image
from socialbot.graph.ports import Delivery
from socialbot.vision import camera_node
from socialbot.vision.camera_pose import load_pose
from tests.system.running import socialbot_here
from tests.vision.test_camera import CALIBRATION, camera

DATA = Path(__file__).parents[2] / "data/synthetic"
IMAGES, INFO = "/camera/image_raw/compressed", "/camera/camera_info"
DEPTH = "/camera/depth/image_raw/compressedDepth"
CAMERA = camera()
START = 1_700_000_000 * SECOND


def test_transforms_of_a_bag_give_the_pose_of_a_head_that_turns(tmp_path: Path) -> None:
    done = socialbot_here("calibrate", DATA / "turning_tune")
    assert done.returncode == 0, done.stderr
    assert "height  1.23 to 1.23 m above the floor: the camera moves" in done.stdout
    assert "pitch   -0.029 to 0.167 rad down" in done.stdout
    assert "source  transforms, in 70 of 70 images" in done.stdout
    refused = socialbot_here("calibrate", DATA / "turning_tune", "--save", tmp_path / "camera.json")
    assert refused.returncode == 3
    assert "the camera moves" in refused.stderr
    assert not (tmp_path / "camera.json").exists()


def test_bag_without_people_ends_with_error_3(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty") as bag:
        for index in range(3):
            stamp = START + index * SECOND
            image = Image.from_bgr(np.full((240, 320, 3), 90, np.uint8), stamp=stamp, frame_id="camera")
            bag.write("/camera/image_raw", image, stamp)
    done = socialbot_here("calibrate", tmp_path / "empty", "--save", tmp_path / "camera.json")
    assert done.returncode == 3
    assert "nobody is wholly visible in 3 images" in done.stderr
    assert "people must walk through the view" in done.stderr
    assert not (tmp_path / "camera.json").exists()


@pytest.mark.slow
def test_people_give_the_pose_and_its_file(tmp_path: Path) -> None:
    file = tmp_path / "camera.json"
    done = socialbot_here("calibrate", DATA / "corridor", "--save", file)
    assert done.returncode == 0, done.stderr
    assert "source  people: " in done.stdout
    assert str(file) in done.stdout
    pose = load_pose(file)
    assert pose is not None
    assert f"height  {pose.height_m:.2f} +- {pose.height_std_m:.2f} m" in done.stdout
    assert f"pitch   {pose.pitch_rad:.3f} +- {pose.pitch_std_rad:.3f} rad" in done.stdout
    assert (pose.source, pose.people > 0) == ("file", True)
    assert abs(pose.height_m - 1.62) < 2 * pose.height_std_m
    assert abs(pose.pitch_rad - 0.052) < 2 * pose.pitch_std_rad


class Walk:
    """A camera that shows a bag: its images, with the time of each."""

    rate_hz, size = 10.0, (640, 480)

    def __init__(self) -> None:
        self.images = [view.image for view in calibrate_command._bag_views(DATA / "lens_wide_tune", None)]
        self.now = 0.0

    def read(self) -> np.ndarray | None:
        self.now += 0.2
        return self.images[round(self.now / 0.2) - 1] if self.now < 0.2 * len(self.images) else None

    def close(self) -> None:
        self.images.clear()


def test_live_camera_is_watched_for_some_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    walk = Walk()
    monkeypatch.setattr(camera_node, "open_frames", lambda device: walk)
    monkeypatch.setattr(calibrate_command, "monotonic", lambda: walk.now)
    app = Typer()
    app.command()(calibrate_command.calibrate)
    result = CliRunner().invoke(app, ["0", "--seconds", "3", "--hfov-rad", "1.37"], catch_exceptions=False)
    assert result.output.startswith("watching camera 0 for 3 s")
    assert "in 15 images" in result.output
    assert "height  " in result.output
    assert "a field of view of 1.37 rad is assumed" in result.output
    assert not walk.images, "the camera is released"


def test_intrinsics_of_a_calibration_are_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    walk = Walk()
    monkeypatch.setattr(camera_node, "open_frames", lambda device: walk)
    monkeypatch.setattr(calibrate_command, "monotonic", lambda: walk.now)
    app = Typer()
    app.command()(calibrate_command.calibrate)
    text = CALIBRATION.replace("image_width: 64", "image_width: 640").replace("image_height: 48", "image_height: 480")
    text = text.replace("60.5", "390").replace("61.", "390").replace("31.0", "320").replace("25.5", "240")
    (tmp_path / "ost.yaml").write_text(text)
    command = ["0", "--seconds", "3", "--camera-info", str(tmp_path / "ost.yaml")]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert "height  " in result.output
    assert "is assumed" not in result.output
    with pytest.raises(ParameterError, match="without effect with --camera-info"):
        CliRunner().invoke(app, [*command, "--hfov-rad", "1.2"], catch_exceptions=False)


@pytest.mark.ros
def test_live_topic_is_watched_with_its_camera_info_and_depth() -> None:
    """A running graph publishes pictures, depth and camera_info of `seated_tune`."""
    with open_bag(DATA / "seated_tune") as bag:
        topics = {IMAGES: IMAGES, DEPTH: DEPTH, INFO: INFO}
        recorded = list(itertools.islice(bag.messages(topics, {DEPTH: CompressedDepth}), 40))
    ended = threading.Event()

    def publish() -> None:
        with observer_node("_robot") as ros:
            transport = open_transport()
            late = {INFO: Delivery.LATCHED}
            senders = {
                topic: transport.advertise(ros, topic, kind, late.get(topic, Delivery.EVERY))
                for topic, kind in {topic: type(message) for topic, message in recorded}.items()
            }
            while not ended.is_set():
                for topic, message in recorded:
                    senders[topic].publish(message)
                    ended.wait(0.05)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        views = calibrate_command._topic_views(IMAGES, 60.0)
        with closing(views):
            view = next(
                each for each in views if each.info and each.sensors and each.sensors.at(each.stamp, "", CAMERA)
            )
    finally:
        ended.set()
        thread.join()
    assert view.image.shape == (480, 640, 3)
    assert view.frame_id == "camera_optical_frame"


@pytest.mark.ros
def test_source_that_is_neither_a_file_nor_a_topic_is_refused() -> None:
    with pytest.raises(GraphError, match="SOURCE is no file: no valid topic: '/data/my bag'"):
        next(calibrate_command._topic_views("/data/my bag", 1.0))


def test_topic_without_pictures_is_refused() -> None:
    with observer_node("_robot") as ros:
        ros.create_publisher(message_class("std_msgs/msg/String"), "/words", 1)
        with pytest.raises(ParameterError, match="has no pictures"):
            next(calibrate_command._topic_views("/words", 1.0))
