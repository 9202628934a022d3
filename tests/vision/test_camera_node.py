from __future__ import annotations

import logging
from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, ParameterError
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.vision import camera_node as frames
from socialbot.vision.camera import CameraModel
from socialbot.vision.camera_node import Camera
from tests.vision.test_camera import CALIBRATION


class Rig:
    """The node in an inline runner, and what it has published."""

    def __init__(self, source, *, start: int = 100 * SECOND, **parameters) -> None:
        config = NodeConfig("camera", Camera, {"source": str(source), **parameters})
        self.runner = InlineRunner(Graph("g", (config,)), start=start)
        self.images: list[Any] = []
        self.infos: list[Any] = []
        self.runner.tap("/camera/image_raw", lambda _, message: self.images.append(message))
        self.runner.tap("/camera/camera_info", lambda _, message: self.infos.append(message))
        self.faults = self.runner.faults["camera"]
        self.node = self.runner.nodes["camera"]
        self.runner.start()

    def pass_time(self, seconds: float) -> None:
        self.runner.advance(self.runner.clock.now() + round(seconds * SECOND))

    @property
    def health(self) -> tuple[str, str]:
        context = self.runner.context_of("camera")
        assert context is not None
        health = context.health_monitor.health()
        return health.state, health.reason

    @property
    def values(self) -> list[int]:
        """The brightness of each picture, by which the test tells them apart."""
        return [round(float(image.bgr().mean())) for image in self.images]


@pytest.fixture
def folder(tmp_path):
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"f{number}.png"), np.full((48, 64, 3), number * 10, np.uint8))
    (tmp_path / "notes.txt").write_text("no image")
    return tmp_path


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(5):
        writer.write(np.full((48, 64, 3), 40 * number, np.uint8))
    writer.release()
    return path


def test_folder_is_published_in_natural_order_at_the_given_rate(folder, caplog):
    with caplog.at_level(logging.INFO):
        rig = Rig(folder, rate_hz=4.0, frame_id="eye")
        rig.pass_time(10)
    assert rig.values == [10, 20, 100]
    assert [image.stamp for image in rig.images] == [100 * SECOND + n * SECOND // 4 for n in range(3)]
    assert {image.frame_id for image in rig.images} == {"eye"}
    assert rig.faults.failures == 0
    assert [record.levelname for record in caplog.records if "has ended" in record.message] == ["INFO"]


def test_pictures_of_all_directions_are_told_once(tmp_path, caplog):
    """The node publishes a CameraInfo of one lens, so nothing else tells that these pictures have none."""
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((48, 96, 3), 9 * number, np.uint8))
    rig = Rig(tmp_path, rate_hz=4.0, loop=True, width=48, height=48)
    rig.pass_time(3)
    assert ["96x48 may be a panorama" in record.message for record in caplog.records] == [True]


def test_images_of_other_formats_are_told_once(folder, caplog):
    (folder / "b.heic").write_bytes(b"x")
    rig = Rig(folder, rate_hz=4.0, loop=True)
    rig.pass_time(3)
    told = f"{folder}: 1 image is left out, the first: b.heic; convert to jpg or png"
    assert [record.message for record in caplog.records] == [told]


def test_video_is_shown_at_its_own_rate(video):
    rig = Rig(video)
    rig.pass_time(1)
    assert rig.values == pytest.approx([0, 40, 80, 120, 160], abs=3)
    assert np.diff([image.stamp for image in rig.images]).tolist() == [SECOND // 25] * 4


def test_with_loop_it_begins_again_without_a_gap(video):
    rig = Rig(video, loop=True)
    rig.pass_time(11.5 / 25)
    assert rig.values == pytest.approx([0, 40, 80, 120, 160] * 2 + [0, 40], abs=3)
    assert set(np.diff([image.stamp for image in rig.images])) == {SECOND // 25}


def test_looped_folder_resumes_once_its_first_image_is_repaired(folder):
    rig = Rig(folder, loop=True, rate_hz=10.0)
    rig.pass_time(0.15)
    whole = (folder / "f1.png").read_bytes()
    (folder / "f1.png").write_bytes(b"rubbish")
    rig.pass_time(7)
    assert rig.values == [10, 20, 100]
    assert rig.faults.failures == 1
    assert "f1.png" in rig.faults.first
    (folder / "f1.png").write_bytes(whole)
    rig.pass_time(2.15)
    assert rig.values[3:6] == [10, 20, 100]
    assert rig.faults.failures == 1


def test_intrinsics_are_published_at_the_start(folder):
    rig = Rig(folder, hfov_rad=1.2, frame_id="eye")
    (info,) = rig.infos
    assert (info.frame_id, info.stamp) == ("eye", 100 * SECOND)
    assert CameraModel.from_info(info) == CameraModel.from_field_of_view(64, 48, 1.2)
    rig.node.set_parameter("hfov_rad", 1.0)
    rig.pass_time(0)
    assert CameraModel.from_info(rig.infos[-1]) == CameraModel.from_field_of_view(64, 48, 1.0)


@pytest.mark.parametrize("scheme", ["", "file://"])
@pytest.mark.parametrize("size", [(64, 48), (32, 24)])
def test_intrinsics_of_a_calibration_are_published_for_the_size_of_the_images(folder, caplog, scheme, size):
    (folder / "ost.yaml").write_text(CALIBRATION)
    rig = Rig(folder, camera_info_url=f"{scheme}{folder}/ost.yaml", width=size[0], hfov_rad=1.2, frame_id="eye")
    (info,) = rig.infos
    assert (info.frame_id, info.stamp, info.width, info.height) == ("eye", 100 * SECOND, *size)
    assert info.k[0] == pytest.approx(60.5 * size[0] / 64)
    assert info.d == (0.1, -0.25, 0.001, 0, 0)
    assert "hfov_rad has no effect" in caplog.text
    assert ("its intrinsics are scaled" in caplog.text) == (size != (64, 48))


@pytest.mark.parametrize(
    ("url", "why"),
    [("package://robot/ost.yaml", "no file: 'package:"), ("none.yaml", "none.yaml"), ("f1.png", "f1.png")],
)
def test_calibration_that_cannot_be_read_is_refused(folder, url, why):
    with pytest.raises(ParameterError) as caught:
        Rig(folder, camera_info_url=url if ":" in url else str(folder / url))
    assert why in str(caught.value)


@pytest.mark.parametrize(
    ("asked", "size"), [({"width": 32, "height": 20}, (32, 20)), ({"width": 32}, (32, 24)), ({"height": 96}, (128, 96))]
)
def test_images_are_scaled_to_the_given_size(folder, asked, size):
    rig = Rig(folder, **asked)
    rig.pass_time(0.2)
    assert {(image.width, image.height) for image in rig.images} == {size}
    assert (rig.infos[0].width, rig.infos[0].height) == size


def test_damaged_image_is_skipped_with_an_error(folder):
    (folder / "f2.png").write_bytes(b"rubbish")
    rig = Rig(folder)
    rig.pass_time(1)
    assert rig.values == [10, 100]
    assert rig.faults.failures == 1
    assert "f2.png" in rig.faults.first


def test_file_that_is_not_there_is_a_device_error():
    with pytest.raises(DeviceError, match=r"no/such/film\.mp4") as caught:
        Rig("no/such/film.mp4")
    assert caught.value.remedy


@pytest.mark.parametrize("source", ["/dev/video97", "97"])
def test_camera_that_is_not_there_is_reported_once(source, caplog):
    rig = Rig(source)
    rig.pass_time(9)
    problem = "/dev/video97: no such camera; plug it in, or choose one of /dev/video*; retried every 2 s"
    assert rig.health == ("failed", problem)
    assert [record.message for record in caplog.records] == [problem]
    assert rig.faults.failures == 0


def test_empty_folder_and_a_file_that_is_no_video(tmp_path):
    with pytest.raises(DeviceError, match="no images"):
        Rig(tmp_path)
    (tmp_path / "film.mp4").write_bytes(b"rubbish")
    with pytest.raises(DeviceError, match=r"film\.mp4: cannot be opened"):
        Rig(tmp_path / "film.mp4")


class FakeCapture:
    """A camera on a cable that the test plugs and pulls."""

    plugged = True
    frozen = False
    opened = 0
    asked: dict[int, float]

    def __init__(self, source) -> None:
        type(self).opened += 1
        self.source = source
        type(self).asked = {}

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self.plugged

    def read(self):
        good = self.plugged and not self.frozen
        return good, np.full((48, 64, 3), 7, np.uint8) if good else None

    def get(self, prop: int) -> float:
        return {cv2.CAP_PROP_FPS: 10.0, cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}[prop]

    def set(self, prop: int, value: float) -> None:
        self.asked[prop] = value

    def release(self) -> None:
        pass


@pytest.fixture
def cable(monkeypatch):
    class Cable(FakeCapture):
        pass

    monkeypatch.setattr(frames.cv2, "VideoCapture", Cable)
    monkeypatch.setattr(frames.sys, "platform", "test")
    return Cable


def test_camera_is_set_to_the_size_and_read_at_its_rate(cable):
    rig = Rig("0", width=64, height=48)
    rig.pass_time(0.95)
    assert len(rig.images) == 10
    assert cable.asked[cv2.CAP_PROP_FRAME_WIDTH] == 64
    assert cable.asked[cv2.CAP_PROP_FRAME_HEIGHT] == 48


def test_lost_camera_is_reported_once_and_reopened(cable, caplog):
    with caplog.at_level(logging.INFO):
        rig = Rig("0")
        rig.pass_time(0.25)
        assert len(rig.images) == 3
        cable.plugged = False
        rig.pass_time(9)
        assert (len(rig.images), rig.faults.failures) == (3, 1)
        assert rig.faults.first.startswith("DeviceError: 0: the camera sends no more images")
        assert "remedy" in rig.faults.first
        assert 4 <= cable.opened - 1 <= 5
        # A camera that can be opened but shows nothing is not back.
        cable.plugged, cable.frozen = True, True
        rig.pass_time(6)
        assert not any("is back" in record.message for record in caplog.records)
        cable.frozen = False
        rig.pass_time(2.05)
    assert rig.faults.failures == 1
    assert sum("camera 0 is back" in record.message for record in caplog.records) == 1
    before = len(rig.images)
    assert before > 3
    rig.pass_time(1)
    assert len(rig.images) == before + 10


def test_camera_that_cannot_be_opened_at_the_start_is_opened_later(cable):
    cable.plugged = False
    rig = Rig("3")
    rig.pass_time(3)
    assert rig.health[0] == "failed"
    assert rig.health[1].startswith("/dev/video3: the camera cannot be opened; end other programs that use it")
    assert (rig.images, rig.infos) == ([], [])
    cable.plugged = True
    rig.pass_time(3.05)
    assert rig.health == ("ok", "")
    assert len(rig.infos) == 1
    assert len(rig.images) > 10


def test_camera_without_permission(cable, monkeypatch):
    """Root may read every device, so the permission is made up."""
    cable.plugged = False
    monkeypatch.setattr(frames.os, "access", lambda path, mode: False)
    rig = Rig("/dev/null")
    assert rig.health[1].startswith("/dev/null: no permission to use the camera; add the user to the group 'video'")


def test_nothing_is_published_after_stop(folder):
    rig = Rig(folder)
    rig.pass_time(0)
    rig.runner.close()
    rig.pass_time(1)
    assert rig.values == [10]


def test_late_images_do_not_pile_up(folder):
    rig = Rig(folder, rate_hz=10.0)
    rig.pass_time(0)
    rig.runner.clock.advance(5)
    rig.pass_time(0.15)
    assert np.diff([image.stamp for image in rig.images]).tolist() == [5 * SECOND, SECOND // 10]


def test_lost_camera_reports_failed_health_until_it_is_back(cable):
    rig = Rig("0")
    said: list[str] = []
    rig.runner.tap("/health", lambda _, message: said.append(message.state))  # type: ignore[attr-defined]
    rig.pass_time(0.25)
    cable.plugged = False
    rig.pass_time(3)
    assert said == ["failed"]
    cable.plugged = True
    rig.pass_time(3)
    assert said == ["failed", "ok"]
