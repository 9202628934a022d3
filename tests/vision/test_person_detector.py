from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.bridge._callback_queue import CallbackQueue
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, ParameterError, SocialbotError
from socialbot.core.messages import (
    BoxMarkers,
    CameraInfo,
    CompressedImage,
    DepthImage,
    Image,
    PersonDetections,
    Transform,
    Transforms,
)
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.vision import person_detector
from socialbot.vision.camera import UNKNOWN_HEIGHT, UNKNOWN_PITCH, CameraModel, CameraPose, without_lens
from socialbot.vision.camera_pose import save_pose
from socialbot.vision.detector import Detections
from socialbot.vision.detectors import DETECTORS, DetectorSettings, DetectorSpec
from socialbot.vision.distance import PERSON_HEIGHT_M, Stature, measure
from socialbot.vision.images import bgr_from_compressed
from socialbot.vision.lens import Lens
from socialbot.vision.metrics.truth import load_truth
from socialbot.vision.motion import cut_off
from socialbot.vision.network import LAYOUTS
from socialbot.vision.person_detector import PersonDetector
from tests.vision.drawn import add_person, corridor
from tests.vision.test_camera import CALIBRATION
from tests.vision.test_distance import box_of

COLOR, INFO = "/camera/image_color", "/camera/camera_info"
BOXES = np.array([[290.0, 150, 60, 180], [100, 200, 40, 120]])


class Stub:
    """A detector that always gives the same."""

    box_width_m = 0.6
    horizon = 0.5
    camera_height: float | None = None
    threshold = 0.5
    boxes = BOXES

    def __init__(self, settings: DetectorSettings) -> None:
        self.settings = settings

    def detect(self, image: np.ndarray) -> Detections:
        scores = np.array([0.9, 0.5])
        keep = scores >= self.threshold
        return Detections(self.boxes[keep], scores[keep])


class Rig:
    """The node in an inline runner, and what it has said. It is shown pictures in which nothing moves."""

    def __init__(self, **parameters) -> None:
        known = {"hide_still": False, "mount_height_m": 1.62, "pitch_rad": 0.052}
        config = NodeConfig("person_detector", PersonDetector, {**known, **parameters})
        self.runner = InlineRunner(Graph("g", (config,), inputs=frozenset({COLOR, INFO})))
        self.detections: list[Any] = []
        self.markers: list[Any] = []
        self.runner.tap("/humans/bodies/detections", lambda _, message: self.detections.append(message))
        self.runner.tap("/humans/bodies/annotations", lambda _, message: self.markers.append(message))
        self.runner.start()
        self.node = self.runner.nodes["person_detector"]
        self.faults = self.runner.faults["person_detector"]

    def show(self, pixels: np.ndarray, stamp: int = 5) -> PersonDetections:
        self.runner.feed(COLOR, Image.from_bgr(pixels, stamp=stamp, frame_id="eye"))
        return self.detections[-1]

    def info(self, width: int = 640, height: int = 480, focal: float = 525.0) -> None:
        k = (focal, 0.0, width / 2, 0.0, focal, height / 2, 0.0, 0.0, 1.0)
        self.runner.feed(INFO, CameraInfo(stamp=0, frame_id="eye", width=width, height=height, k=k), time=0)


@pytest.mark.parametrize("leap_s", [-3600, -1, 3600])
def test_people_keep_their_ids_when_the_clock_of_the_camera_is_set(stub, leap_s):
    rig = Rig()
    for tenth in range(30):
        now = (100 + tenth) * SECOND // 10
        stamp = now + leap_s * SECOND * (tenth >= 15)
        rig.runner.feed(COLOR, Image.from_bgr(BLANK, stamp=stamp + 3600 * SECOND, frame_id="eye"), time=now)
        assert rig.detections[-1].stamp == stamp + 3600 * SECOND
    assert {each.track_id for shown in rig.detections[3:] for each in shown.persons} == {"t1", "t2"}


DEPTH = "/camera/depth/image_raw"


def depth_at(metres: float, stamp: int, frame: str = "eye") -> DepthImage:
    """Depth of a wall ``metres`` ahead."""
    pixels = np.full((480, 640), round(metres * 1000), "<u2").view(np.uint8).reshape(-1)
    return DepthImage(stamp=stamp, frame_id=frame, height=480, width=640, encoding="16UC1", step=1280, data=pixels)


@pytest.fixture
def stub(monkeypatch):
    monkeypatch.setattr(person_detector, "DETECTORS", {"nanodet": DetectorSpec("nanodet", 0.5, 0.2, Stub)})


@pytest.fixture(autouse=True)
def opencv_threads():
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


BLANK = np.zeros((480, 640, 3), np.uint8)


def distance_of(
    camera: CameraModel,
    box: np.ndarray,
    *,
    height_m: float = PERSON_HEIGHT_M,
    width_m: float = 0.6 * PERSON_HEIGHT_M / 1.70,
) -> float:
    stature = Stature.of_people(height_m, width_m)
    found = measure(camera, box.tolist(), stature, cut_off(box, camera.width, camera.height))
    assert found is not None
    return found.distance.value


@pytest.mark.parametrize("tracker", ["kalman", "none"])
def test_drawn_person_has_distance_and_direction(tracker):
    rig = Rig(detector="hog", tracker=tracker)
    rig.info()
    picture = corridor()
    # 1.70 m at 5 m, camera 1.62 m high and 0.052 rad down: 178 pixels, feet at row 383.
    x, y, w, h = add_person(picture, 400, 383 - 178, 178)
    message = rig.show(picture, stamp=5)
    person = message.persons[0]
    assert (message.stamp, message.frame_id, message.width, message.height) == (5, "eye", 640, 480)
    assert abs(person.x + person.w / 2 - (x + w / 2)) < 15
    assert person.distance_m == pytest.approx(5.0, rel=0.15)
    assert person.bearing_rad == pytest.approx(-np.arctan(80 / 525), abs=0.03)
    assert person.elevation_rad == pytest.approx(-0.01, abs=0.05)
    assert person.distance_std_m is not None
    assert 0.1 < person.distance_std_m < 1.0
    assert person.track_id == ("t1" if tracker == "kalman" else "")
    assert y + h < 480


def test_empty_image_gives_an_empty_message():
    rig = Rig(detector="hog")
    assert rig.show(corridor(320, 240)).persons == ()
    assert rig.markers[-1].boxes == ()


def test_markers_are_the_boxes(stub):
    rig = Rig()
    message = rig.show(BLANK, stamp=8)
    assert rig.markers == [BoxMarkers(stamp=8, frame_id="eye", boxes=tuple(map(tuple, BOXES.tolist())))]
    assert [[p.x, p.y, p.w, p.h] for p in message.persons] == BOXES.tolist()
    assert [p.score for p in message.persons] == [0.9, 0.5]
    assert all(type(p.x) is float and type(p.score) is float for p in message.persons)


def test_camera_model_uses_camera_info_and_parameters(stub):
    rig = Rig(mount_height_m=1.2, pitch_rad=0.1, person_height_m=1.8)
    rig.info(focal=400.0)
    person = rig.show(BLANK).persons[0]
    camera = CameraModel(400, 400, 320, 240, 640, 480, CameraPose(height_m=1.2, pitch_rad=0.1))
    width = 0.6 * 1.8 / 1.7
    assert person.distance_m == pytest.approx(distance_of(camera, BOXES[0], height_m=1.8, width_m=width))
    assert person.bearing_rad == camera.direction(320, 150)[0]


def test_cut_off_person_is_measured_by_the_box_width_of_the_detector(stub, monkeypatch):
    rig = Rig()
    rig.info()
    monkeypatch.setattr(Stub, "boxes", np.array([[300.0, 150, 120, 330], [0, 0, 1, 1]]))
    camera = CameraModel(525, 525, 320, 240, 640, 480, CameraPose(height_m=1.62, pitch_rad=0.052))
    near = rig.show(BLANK).persons[0].distance_m
    assert near == pytest.approx(distance_of(camera, Stub.boxes[0]))
    assert near != pytest.approx(distance_of(camera, Stub.boxes[0], width_m=0.5))


def test_missing_camera_info_is_logged_once(stub, caplog):
    rig = Rig(hfov_rad=1.2)
    with caplog.at_level(logging.WARNING):
        person = rig.show(BLANK, 1).persons[0]
        rig.show(BLANK, 2)
    camera = CameraModel.from_field_of_view(640, 480, 1.2, CameraPose(height_m=1.62, pitch_rad=0.052))
    assert person.distance_m == pytest.approx(distance_of(camera, BOXES[0]))
    assert sum("no camera_info" in record.message for record in caplog.records) == 1
    rig.info()
    assert rig.show(BLANK, 3).persons[0].distance_m != person.distance_m


def calibrated(folder: Path) -> Path:
    """A calibration for 1280x960 pixels."""
    text = CALIBRATION.replace("image_width: 64", "image_width: 1280").replace("image_height: 48", "image_height: 960")
    file = folder / "ost.yaml"
    file.write_text(text.replace("60.5", "1050").replace("61.", "1050").replace("31.0", "640").replace("25.5", "480"))
    return file


@pytest.mark.parametrize("rectified", [False, True])
def test_calibration_counts_until_a_camera_info_arrives(stub, tmp_path, caplog, rectified):
    file = calibrated(tmp_path)
    rig = Rig(camera_info_url=f"file://{file}", rectified=rectified)
    with caplog.at_level(logging.WARNING):
        person, other = rig.show(BLANK, 1).persons
        assert "no camera_info" not in caplog.text
        lens = None if rectified else Lens(False, (0.1, -0.25, 0.001, 0, 0))
        camera = CameraModel(525, 525, 320, 240, 640, 480, CameraPose(height_m=1.62, pitch_rad=0.052), lens=lens)
        assert person.distance_m == pytest.approx(distance_of(camera, BOXES[0]))
        assert person.bearing_rad == camera.direction(320, 150)[0]
        rig.runner.feed(INFO, CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=(0.0,) * 9), time=0)
        assert rig.show(BLANK, 2).persons[1].bearing_rad == other.bearing_rad, "drivers without calibration send zeros"
        rig.info(focal=400.0)
        assert rig.show(BLANK, 3).persons[1].bearing_rad != other.bearing_rad
    assert caplog.text.count("camera_info_url is not used: a camera_info has arrived") == 1
    assert PersonDetector.external_files({"camera_info_url": f"file://{file}", "model": "m.onnx"}) == (
        Path("m.onnx"),
        file,
    )


def test_pictures_of_another_size_than_camera_info_scale_it_with_one_warning(stub, caplog):
    rig = Rig()
    rig.info(1280, 720, 900.0)
    with caplog.at_level(logging.WARNING):
        person = rig.show(BLANK, 1).persons[0]
        rig.show(BLANK, 2)
    camera = CameraModel(600, 600, 320, 240, 640, 480, CameraPose(height_m=1.62, pitch_rad=0.052))
    assert person.distance_m == pytest.approx(distance_of(camera, BOXES[0]))
    assert sum("1280x720" in record.message and "640x480" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("rectified", [False, True])
def test_distortion_is_used_unless_the_images_are_rectified(stub, rectified):
    rig = Rig(tracker="none", rectified=rectified)
    k = (525.0, 0.0, 320.0, 0.0, 525.0, 240.0, 0.0, 0.0, 1.0)
    info = CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=k, d=(-0.3, 0.1, 0.0, 0.0, 0.0))
    rig.runner.feed(INFO, info, time=0)
    camera = CameraModel.from_info(without_lens(info) if rectified else info)
    x, y, w, _ = BOXES[0]
    bearing, _ = camera.direction(x + w / 2, y)
    assert rig.show(BLANK, 1).persons[0].bearing_rad == pytest.approx(bearing)


def test_uncalibrated_camera_info_is_told_and_changes_nothing(stub, caplog):
    rig = Rig(tracker="none")
    before = rig.show(BLANK, 1).persons
    k = (0.0,) * 9
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            rig.runner.feed(INFO, CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=k), time=0)
    assert rig.faults.failures == 0
    assert sum("eye is not calibrated" in record.message for record in caplog.records) == 1
    assert rig.show(BLANK, 2).persons == before


def test_impossible_camera_info_is_refused_and_changes_nothing(stub):
    rig = Rig(tracker="none")
    before = rig.show(BLANK, 1).persons
    rig.info(focal=0.0)
    assert (rig.faults.failures, "focal" in rig.faults.first) == (1, True)
    assert rig.show(BLANK, 2).persons == before


@pytest.mark.parametrize("tracker", ["kalman", "none"])
def test_threshold_and_geometry_change_at_run_time(stub, tracker):
    rig = Rig(threshold=0.3, tracker=tracker)
    rig.info()
    first = rig.show(BLANK, 1).persons
    assert [p.score for p in first] == [0.9, 0.5]
    distances = [first[0].distance_m]
    for number, (name, value) in enumerate([("mount_height_m", 1.0), ("pitch_rad", 0.2), ("person_height_m", 1.5)], 1):
        rig.node.set_parameter(name, value)
        distances.append(rig.show(BLANK, 60 * number * SECOND).persons[0].distance_m)
    assert len(set(distances)) == 4
    rig.node.set_parameter("threshold", 0.7)
    assert [p.score for p in rig.show(BLANK, 600 * SECOND).persons] == [0.9]


def test_below_zero_the_threshold_is_the_detector_s_own(stub, monkeypatch):
    assert [p.score for p in Rig().show(BLANK).persons] == [0.9, 0.5]
    monkeypatch.setattr(person_detector, "DETECTORS", {"nanodet": DetectorSpec("nanodet", 0.6, 0.2, Stub)})
    rig = Rig()
    assert [p.score for p in rig.show(BLANK).persons] == [0.9]
    rig.node.set_parameter("threshold", 0.4)
    assert [p.score for p in rig.show(BLANK, 60 * SECOND).persons] == [0.9, 0.5]
    rig.node.set_parameter("threshold", -1.0)
    assert [p.score for p in rig.show(BLANK, 120 * SECOND).persons] == [0.9]


def test_people_keep_their_ids_across_gaps(stub, monkeypatch):
    rig = Rig(bridge_s=0.25)
    for tenth in range(5):
        named = [p.track_id for p in rig.show(BLANK, tenth * SECOND // 10).persons]
        assert sorted(named) == ["t1", "t2"]
    monkeypatch.setattr(Stub, "boxes", np.empty((0, 4)))
    monkeypatch.setattr(Stub, "detect", lambda *_: Detections(np.empty((0, 4)), np.empty(0)))
    bridged = rig.show(BLANK, 5 * SECOND // 10)
    assert [p.unseen_s for p in bridged.persons] == [pytest.approx(0.1)] * 2
    assert len(rig.markers[-1].boxes) == 2
    rig.node.set_parameter("bridge_s", 0.1)
    assert rig.show(BLANK, 6 * SECOND // 10).persons == ()


def test_ids_begin_with_the_prefix_of_the_camera(stub):
    assert {p.track_id for p in Rig(id_prefix="rear_").show(BLANK).persons} == {"rear_t1", "rear_t2"}


def test_no_ids_without_a_tracker(stub):
    rig = Rig(tracker="none", id_prefix="rear_")
    rig.node.set_parameter("bridge_s", 1.0)
    assert {p.track_id for p in rig.show(BLANK).persons} == {""}


def test_threads_reach_opencv_and_the_detector_and_are_fixed(stub):
    rig = Rig(threads=2)
    assert cv2.getNumThreads() == 2
    assert rig.node._pipeline._detector.settings.threads == 2  # type: ignore[attr-defined]
    with pytest.raises(ParameterError, match="before the node starts"):
        rig.node.set_parameter("threads", 1)


def test_slow_detector_is_handed_the_newest_image():
    inbox, port = CallbackQueue(lambda: 0, simulated=True), PersonDetector.inputs()["image"]
    taken = []
    for stamp in range(0, 30):
        inbox.put(port, Image.from_bgr(BLANK, stamp=stamp * SECOND // 10, frame_id="eye"))
        if stamp % 4 == 0:  # A look takes four pictures' time.
            line, image = inbox.take()  # type: ignore[misc]
            line.record_cost(0.4)
            taken.append(image.stamp * 10 // SECOND)
    assert taken[2:] == [8, 12, 16, 20, 24, 28]


def test_settings_of_the_detector_are_parameters(stub):
    given = {"model": "m.onnx", "layout": "yolox", "input_width": 320, "channels": "rgb", "person_class": 3}
    settings = Rig(**given).node._pipeline._detector.settings  # type: ignore[attr-defined]
    assert settings == DetectorSettings(**{**given, "model": str(Path("m.onnx").resolve())})
    assert PersonDetector.layout.choices == tuple(LAYOUTS)
    assert PersonDetector.detector.choices == tuple(DETECTORS)


def test_onnx_model_that_is_not_there_is_named():
    with pytest.raises(SocialbotError, match=r"nowhere\.onnx"):
        Rig(detector="onnx", model="nowhere.onnx")


def test_unknown_detector_is_refused():
    with pytest.raises((ParameterError, GraphError), match="hog"):
        Rig(detector="magic")


def test_picture_that_is_not_bgr8_is_counted(stub):
    rig = Rig()
    image = Image(stamp=1, frame_id="eye", height=2, width=2, encoding="rgb8", step=6, data=np.zeros(12, np.uint8))
    rig.runner.feed(COLOR, image)
    assert (rig.faults.failures, rig.detections) == (1, [])


def test_still_person_with_a_high_score_is_kept_by_default(stub):
    rig = Rig(hide_still=True)
    assert all(rig.show(BLANK, stamp=step * SECOND // 10).persons for step in range(10))
    rig.node.set_parameter("hide_still", False)
    assert rig.show(BLANK, stamp=SECOND).persons


def test_depth_gives_the_distance_near_its_stamp(stub) -> None:
    rig, tenth = Rig(pitch_rad=0.0), SECOND // 10
    rig.info()
    first = rig.show(corridor(), stamp=SECOND).persons[0]
    assert first.distance_source == "image"
    rig.runner.feed(DEPTH, depth_at(3.1, SECOND + tenth))
    near = rig.show(corridor(), stamp=SECOND + tenth).persons[0]
    assert near.distance_source == "depth"
    assert near.distance_m == pytest.approx(3.2, abs=0.1)
    assert near.distance_std_m is not None
    assert near.distance_std_m < 0.2
    late = rig.show(corridor(), stamp=2 * SECOND).persons[0]
    assert late.distance_source == "image"
    assert not rig.faults.failures


@pytest.mark.parametrize(("metres", "told"), [(2.5, 0), (12.5, 1)])
def test_depth_that_measures_nobody_is_told_of_once(stub, monkeypatch, caplog, metres, told):
    monkeypatch.setattr(Stub, "boxes", np.array([[250.0, 80, 120, 360], [100.0, 90, 110, 350]]))
    rig = Rig(pitch_rad=0.0, faces=False)
    rig.info()
    for number in range(60):
        rig.runner.feed(DEPTH, depth_at(metres, SECOND + number))
        rig.show(BLANK, stamp=SECOND + number)
    assert sum("measures nearly none of the people" in record.getMessage() for record in caplog.records) == told


def test_depth_tolerance_and_pose_are_parameters(stub) -> None:
    rig = Rig(depth_tolerance_s=1.0)
    rig.info()
    rig.runner.feed(DEPTH, depth_at(3.1, SECOND))
    assert rig.show(corridor(), stamp=2 * SECOND - 1).persons[0].distance_source == "depth"
    rig.node.set_parameter("depth_tolerance_s", 0.1)
    assert rig.show(corridor(), stamp=3 * SECOND).persons[0].distance_source == "image"
    with pytest.raises(ParameterError, match="no pose"):
        rig.node.set_parameter("depth_pose", "behind the head")


def test_a_fisheye_lens_is_told_of(caplog):
    rig = Rig(detector="hog")
    k = (300.0, 0.0, 320.0, 0.0, 300.0, 240.0, 0.0, 0.0, 1.0)
    info = CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=k, d=(0.0,) * 4, distortion_model="equidistant")
    for _ in range(2):
        rig.runner.feed(INFO, info, time=0)
    assert [record.getMessage() for record in caplog.records if "the lens (equidistant)" in record.getMessage()] != []
    assert sum("the lens" in record.getMessage() for record in caplog.records) == 1


def test_an_unknown_distortion_model_is_named(caplog):
    rig = Rig(detector="hog")
    k = (300.0, 0.0, 320.0, 0.0, 300.0, 240.0, 0.0, 0.0, 1.0)
    info = CameraInfo(stamp=0, frame_id="eye", width=640, height=480, k=k, d=(0.1,) * 5, distortion_model="odd")
    rig.runner.feed(INFO, info, time=0)
    assert sum("model 'odd' is not known" in record.message for record in caplog.records) == 1


@pytest.fixture(scope="module")
def near(request: pytest.FixtureRequest) -> np.ndarray:
    """An image of the committed bag with one near person."""
    corridor_bag: Path = request.getfixturevalue("corridor")
    truth = load_truth(corridor_bag.with_suffix(".truth.json"))
    clear = {frame.stamp for frame in truth.frames if len(frame.persons) == 1 and frame.persons[0].h > 200}
    with open_bag(corridor_bag) as bag:
        topic = bag.choose_image_topic()
        images = (image for _, image in bag.messages({topic.name: topic.type}) if image.stamp in clear)
        image = next(images)
    assert isinstance(image, CompressedImage)
    return bgr_from_compressed(image)


@pytest.mark.parametrize(
    ("parameters", "searched"), [({}, True), ({"faces": False}, False), ({"tracker": "none"}, False)]
)
def test_tells_whether_faces_are_searched(parameters, searched):
    assert Rig(**parameters).show(corridor()).faces is searched


@pytest.mark.parametrize(("pitch_rad", "told"), [(0.8, 0), (1.2, 1)])
def test_a_camera_that_looks_down_steeply_is_told_of_once(stub, caplog, pitch_rad, told):
    rig = Rig(mount_height_m=2.5, pitch_rad=pitch_rad)
    for number in range(3):
        rig.show(BLANK, stamp=(1 + number) * SECOND)
    assert sum("seen from above" in record.getMessage() for record in caplog.records) == told


@pytest.mark.parametrize(("images", "at", "told"), [(99, None, 0), (100, None, 1), (100, 60, 0)])
def test_the_end_of_a_run_tells_that_nobody_was_found(stub, monkeypatch, caplog, images, at, told):
    rig = Rig(faces=False)
    for number in range(images):
        shown = 2 if number == at else 0
        monkeypatch.setattr(Stub, "detect", lambda *_, shown=shown: Detections(BOXES[:shown], np.full(shown, 0.9)))
        rig.show(np.zeros((120, 160, 3), np.uint8), stamp=SECOND + number * SECOND // 10)
    rig.node.stop()
    assert sum("nobody was found" in record.getMessage() for record in caplog.records) == told


def test_tells_the_pose_of_the_camera_once_it_is_known():
    found = Rig().show(corridor())
    assert (found.camera_height_m, found.camera_pitch_rad, found.camera_pose_source) == (1.62, 0.052, "given")
    rig = Rig(mount_height_m=0.0, pitch_rad=2.0)
    found = rig.show(corridor())
    assert (found.camera_height_m, found.camera_pitch_rad, found.camera_pose_source) == (None, None, "unknown")


@pytest.mark.parametrize(
    ("turns", "told"),
    [
        (0, ""),
        (1, "by 90 degrees clockwise"),
        pytest.param(2, "by 180 degrees", marks=pytest.mark.slow),
        pytest.param(3, "by 90 degrees anticlockwise", marks=pytest.mark.slow),
    ],
)
def test_a_turned_camera_is_told_of(near, caplog, turns, told):
    rig = Rig(faces=False)
    picture = np.ascontiguousarray(np.rot90(near, turns))
    for number in range(8):
        rig.show(picture, stamp=round((1 + 0.5 * number) * SECOND))
    found = [record.getMessage() for record in caplog.records if "turned" in record.getMessage()]
    assert len(found) == bool(told)
    assert all(text.endswith(told) for text in found)


def test_nobody_says_nothing_of_a_turned_camera(caplog):
    rig = Rig(faces=False)
    for number in range(8):
        rig.show(corridor(), stamp=round((1 + 0.5 * number) * SECOND))
    assert not [record for record in caplog.records if "turned" in record.getMessage()]


@pytest.mark.parametrize(
    ("parameters", "height_m", "source"),
    [({}, 1.0, "tf"), ({"mount_height_m": 1.4}, 1.4, "tf"), ({"mount_height_m": 1.4, "pitch_rad": 0.1}, 1.4, "given")],
)
def test_pose_of_transforms_is_used_unless_parameters_state_it(stub, parameters, height_m, source):
    rig = Rig(**{"mount_height_m": UNKNOWN_HEIGHT, "pitch_rad": UNKNOWN_PITCH, **parameters})
    rig.info()
    optical = Transform(
        stamp=0, parent="base_footprint", child="eye", translation=(0.0, 0.0, 1.0), rotation=(-0.5, 0.5, -0.5, 0.5)
    )
    rig.runner.feed("/tf_static", Transforms(stamp=0, transforms=(optical,)))
    rig.show(BLANK)
    assert isinstance(rig.node, PersonDetector)
    pose = rig.node.camera_pose
    assert (pose.height_m, pose.source) == (pytest.approx(height_m), source)
    assert pose.height_std_m == pose.pitch_std_rad == 0.0


def walk(rig: Rig, model: CameraModel, seconds: range) -> None:
    """Show a person who walks up to the camera."""
    for second in seconds:
        Stub.boxes = np.array([box_of(model, 8.0 - 0.4 * (second % 12), 0.0), (0.0, 0.0, 1.0, 1.0)])
        for tick in range(5):
            rig.show(BLANK, stamp=second * SECOND + tick * SECOND // 5)


def test_estimated_pose_is_kept_in_its_file_and_read_at_the_start(stub, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Stub, "boxes", BOXES)
    monkeypatch.setattr(person_detector, "save_pose", saved := Saved())
    model = CameraModel.from_field_of_view(640, 480, 1.09, CameraPose(height_m=1.2, pitch_rad=0.05))
    unknown = {"mount_height_m": UNKNOWN_HEIGHT, "pitch_rad": UNKNOWN_PITCH, "camera_file": "camera.json"}
    rig = Rig(**unknown)
    walk(rig, model, range(10, 20))
    assert isinstance(rig.node, PersonDetector)
    assert rig.node.camera_pose.source == "people"
    assert saved.count == 1, "at most once a minute"
    walk(rig, model, range(80, 90))
    assert saved.count == 2
    rig.runner.close()
    Stub.boxes = np.zeros((2, 4))
    again = Rig(**unknown)
    again.show(BLANK)
    assert isinstance(again.node, PersonDetector)
    assert again.node.camera_pose.source == "file"
    assert again.node.camera_pose.height_m == pytest.approx(rig.node.camera_pose.height_m)


class Saved:
    """Writes pose files, and counts them."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, pose: CameraPose, path: Path) -> None:
        self.count += 1
        save_pose(pose, path)


def test_health_states_the_pose_of_the_camera_at_most_every_ten_seconds(stub, monkeypatch):
    monkeypatch.setattr(Stub, "boxes", BOXES)
    model = CameraModel.from_field_of_view(640, 480, 1.09, CameraPose(height_m=1.2, pitch_rad=0.05))
    rig = Rig(mount_height_m=UNKNOWN_HEIGHT, pitch_rad=UNKNOWN_PITCH)
    told: list[tuple[str, str]] = []
    monkeypatch.setattr(rig.node, "report_health", lambda state, reason: told.append((state, reason)))
    walk(rig, model, range(10, 35))
    assert [state for state, _ in told] == ["ok"] * 3
    assert re.match(r"camera 1\.\d\d \+- 0\.\d\d m high, 0\.\d{3} \+- 0\.\d{3} rad down", told[0][1])
    assert all("(1 person)" in text or " people)" in text for _, text in told)
    assert all(text.endswith("no camera_info: a field of view of 1.09 rad is assumed") for _, text in told)


def test_health_names_an_unknown_pose_of_the_camera(stub, monkeypatch):
    rig = Rig(mount_height_m=UNKNOWN_HEIGHT, pitch_rad=UNKNOWN_PITCH)
    told: list[str] = []
    monkeypatch.setattr(rig.node, "report_health", lambda state, reason: told.append(reason))
    monkeypatch.setattr(Stub, "boxes", np.full((2, 4), 1.0))  # No whole person.
    rig.show(BLANK)
    assert "(assumed); no camera_info" in told[0]
    assert told[0].endswith("its pose is not known yet, so distances are rough")
