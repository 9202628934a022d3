"""Node that detects people in images, with distance and direction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import cv2
import msgspec
import numpy as np

from socialbot.core import paths
from socialbot.core.clock import SECOND, SteadyStamps
from socialbot.core.errors import ParameterError
from socialbot.core.messages import (
    BoxMarkers,
    CameraInfo,
    CompressedDepth,
    DepthImage,
    DepthInfo,
    Image,
    Message,
    PersonDetection,
    PersonDetections,
    PointCloud,
    Transforms,
)
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.vision.camera import (
    ASSUMED,
    UNKNOWN_HEIGHT,
    UNKNOWN_PITCH,
    USUAL_HFOV_RAD,
    CameraModel,
    CameraPose,
    calibrated_info,
    calibration_at,
    calibration_file,
    intrinsics_problems,
    is_calibrated,
    without_lens,
)
from socialbot.vision.camera_pose import load_pose, save_pose
from socialbot.vision.depth_sensors import TOLERANCE_S, DepthSensors
from socialbot.vision.detector import Detector
from socialbot.vision.detectors import DETECTORS, PIXELS, DetectorSettings, DetectorSpec
from socialbot.vision.distance import PERSON_HEIGHT_M
from socialbot.vision.network import LAYOUTS
from socialbot.vision.pipeline import TRACKERS, PersonPipeline
from socialbot.vision.reidentification import REMEMBER_S

_GEOMETRY = ("mount_height_m", "pitch_rad", "hfov_rad")
_USUAL = DetectorSettings()
_STEEP_RAD = 0.95  # Cameras that look down more steeply are told: people seen from above are mostly missed.
_MANY_IMAGES = 100  # From so many images without people on, the end of a run tells it.

_SAVE_NS = 60 * SECOND  # Pause between two writes of the pose file.
_REPORT_NS = 10 * SECOND  # Pause between two reports of the pose.

_CHECK_S, _LONGEST_CHECK_S = 0.5, 60.0  # Pauses between two checks, doubled after a round without people.
_TURNED_SCORE, _BETTER = 0.6, 0.05  # Score of people in a turned image, and its lead over that in upright ones.
_TURNS = {1: "90 degrees anticlockwise", 2: "180 degrees", 3: "90 degrees clockwise"}
"""Turns of an image by the number of quarter turns."""
_ROTATIONS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}


class _TurnedCamera:
    """Tells whether the camera is turned: its detector is surer of people in turned images than in upright ones.

    A round of checks searches one image in each turn; a camera is turned if two rounds agree.
    """

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._scores = dict.fromkeys((0, *_TURNS), 0.0)
        self._left = list(_TURNS)
        self._pause, self._next = _CHECK_S, 0
        self._last = 0
        self.done = False

    def look(self, image: np.ndarray, stamp: int, persons: Sequence[PersonDetection]) -> str:
        """The turn that makes images upright, or an empty text; some images are searched again in one turn."""
        self._scores[0] = max(self._scores[0], *(person.score for person in persons), 0.0)
        if self.done or stamp < self._next:
            return ""
        turns = self._left.pop()
        found = self._detector.detect(cv2.rotate(image, _ROTATIONS[turns]))
        self._scores[turns] = float(found.scores.max(initial=0.0))
        self._next = stamp + round(self._pause * SECOND)
        return "" if self._left else self._judge()

    def _judge(self) -> str:
        """The result of a round."""
        best = max(_TURNS, key=lambda turns: self._scores[turns])
        upright, turned = self._scores[0], self._scores[best]
        sure = turned >= _TURNED_SCORE and turned > upright + _BETTER
        self.done = (sure and self._last == best) or (upright >= _TURNED_SCORE and not sure)
        text = _TURNS[best] if self.done and sure else ""
        self._last = best if sure else 0
        nobody = max(upright, turned) < _TURNED_SCORE
        self._pause = min(2 * self._pause, _LONGEST_CHECK_S) if nobody else _CHECK_S
        self._scores, self._left = dict.fromkeys(self._scores, 0.0), list(_TURNS)
        return text


class PersonDetector(Node):
    """Publishes the people in each image, with distance and direction, and their boxes for viewers.

    An image without people gives an empty message. Until a camera_info arrives, the field of view is ``hfov_rad``.
    Images that arrive during detection are skipped, except the newest.

    Depth images or a point cloud near the stamp of an image give the distances, where they measure a person. A depth
    image may have any resolution. In another frame than the image, it needs its camera_info and transforms.
    """

    image = Input(Image, "/camera/image_color", Delivery.NEWEST, deadline_s=SILENT_S)
    camera_info = Input(CameraInfo, "/camera/camera_info", Delivery.LATCHED)
    depth = Input(DepthImage, "/camera/depth/image_raw", Delivery.NEWEST, optional=True)
    depth_compressed = Input(CompressedDepth, "/camera/depth/image_raw/compressedDepth", Delivery.NEWEST, optional=True)
    depth_info = Input(DepthInfo, "/camera/depth/camera_info", Delivery.LATCHED, optional=True)
    points = Input(PointCloud, "/points", Delivery.NEWEST, optional=True)
    tf = Input(Transforms, "/tf", optional=True)
    tf_static = Input(Transforms, "/tf_static", Delivery.LATCHED, optional=True)
    detections = Output(PersonDetections, "/humans/bodies/detections", exclusive=True)
    annotations = Output(BoxMarkers, "/humans/bodies/annotations", Delivery.NEWEST)

    detector = Parameter("nanodet", "detector", choices=tuple(DETECTORS), fixed=True)
    threshold = Parameter(
        -1.0,
        "score from which a detection counts alone, in the detector's scale: hog 0 to about 3, networks 0 to 1; "
        "below 0: the default of the detector",
        minimum=-1.0,
        maximum=10.0,
    )
    tracker = Parameter("kalman", "tracker", choices=TRACKERS, fixed=True)
    bridge_s = Parameter(
        -1.0,
        "how long a lost track is still published, s; below 0: the default of the detector",
        minimum=-1.0,
        maximum=2.0,
    )
    remember_s = Parameter(
        REMEMBER_S,
        "how long a lost person is recognised by colours and keeps the id, s; 0: never; needs a tracker",
        minimum=0.0,
        maximum=600.0,
    )
    id_prefix = Parameter(
        "",
        "begin of the ids of people, such as rear_; a second camera has its name by default",
        fixed=True,
    )
    hide_still = Parameter(True, "remove objects that never move: coat stands, posters; needs a tracker")
    faces = Parameter(True, "search the faces of near people; needs a tracker, not with hog", fixed=True)
    threads = Parameter(1, "processor threads for OpenCV and the detector", minimum=1, maximum=64, fixed=True)
    mount_height_m = Parameter(
        UNKNOWN_HEIGHT, "height of the camera above the floor, m; 0: not known, estimated", minimum=0.0, maximum=10.0
    )
    pitch_rad = Parameter(
        UNKNOWN_PITCH, "downward tilt of the camera, rad; 2: not known, estimated", minimum=-1.5, maximum=UNKNOWN_PITCH
    )
    camera_file = Parameter(
        "", "file with the pose of the camera; read at the start, and written when people refine it", fixed=True
    )
    keep_pose = Parameter(True, "write camera_file, at most once a minute; replays never do")
    person_height_m = Parameter(
        PERSON_HEIGHT_M, "mean height of adults, with shoes and hair, m", minimum=0.5, maximum=2.5
    )
    hfov_rad = Parameter(
        USUAL_HFOV_RAD, "horizontal field of view until a camera_info arrives, rad", minimum=0.1, maximum=3.0
    )
    camera_info_url = Parameter(
        "", "calibration of a camera without camera_info, a file of camera_calibration in YAML; replaces hfov_rad",
        fixed=True,
    )  # fmt: skip
    depth_tolerance_s = Parameter(
        TOLERANCE_S, "largest difference of the stamps of an image and its depth or points, s", minimum=0.0, maximum=2.0
    )
    rectified = Parameter(
        False, "whether the images are rectified: the distortion in camera_info is ignored", fixed=True
    )
    depth_pose = Parameter(
        "",
        "x y z roll pitch yaw of the depth camera or lidar in the camera's forward, left and up axes, m and rad; "
        "for a robot without transforms",
    )
    model = Parameter(_USUAL.model, "onnx: path of the model's file", fixed=True)
    layout = Parameter(_USUAL.layout, "onnx: layout of its output", choices=tuple(LAYOUTS), fixed=True)
    input_width = Parameter(0, "onnx: pixels; 0: from the model", minimum=0, maximum=8192, fixed=True)
    input_height = Parameter(0, "onnx: pixels; 0: from the model", minimum=0, maximum=8192, fixed=True)
    channels = Parameter("", "onnx: order of colours; empty: from the layout", choices=("", "bgr", "rgb"), fixed=True)
    pixels = Parameter("", "onnx: range of pixels; empty: from the layout", choices=("", *PIXELS), fixed=True)
    classes = Parameter(_USUAL.classes, "onnx: number of classes", minimum=1, maximum=100000, fixed=True)
    person_class = Parameter(0, "onnx: index of the class person, from 0", minimum=0, maximum=99999, fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises InstallationError if the detector is not installed, ParameterError for invalid settings."""
        super().__init__(name, context, parameters)
        self._spec = self.find_spec()
        settings = {field.name: self.parameter_values[field.name] for field in fields(DetectorSettings)}
        if self.model:
            path = Path(self.model).expanduser()
            settings["model"] = str(paths.in_workspace(path, where=f"{name}.model"))
        detector = self._spec.make(DetectorSettings(**settings))
        self._file: Path | None = None
        self._filed_pose: CameraPose | None = None
        self._saved, self._saved_at = ASSUMED, -(2**62)
        if self.camera_file:
            self._file = paths.in_workspace(Path(self.camera_file).expanduser(), where=f"{name}.camera_file")
            self._filed_pose = load_pose(self._file)
            if self._filed_pose is None:
                self.log.warning("%s does not exist yet: the camera's pose is estimated from people", self._file)
        self._reported, self._reported_at = "", -(2**62)
        where = f"{name}.camera_info_url"
        self._calibration = calibration_at(self.camera_info_url, where=where, rectified=self.rectified)
        self._info = self._calibration
        self._sensors = DepthSensors()
        self._time = SteadyStamps()
        self._pipeline = PersonPipeline(
            self._spec,
            detector,
            tracker=self.tracker,
            remember_s=self.remember_s,
            faces=self.faces,
        )
        for parameter in ("threshold", "bridge_s", "person_height_m", "hide_still", "depth_pose"):
            self.on_parameter(parameter)
        self._turned = _TurnedCamera(detector) if self._spec.faces else None
        self._camera: CameraModel | None = None
        self._without_people = 0
        """Number of images so far; -1 once there was somebody."""
        self._warned: set[str] = set()

    @classmethod
    def external_files(cls, parameters: Mapping[str, object]) -> Sequence[Path]:
        named = (str(parameters.get(name) or "") for name in ("model", "camera_file"))
        url = str(parameters.get("camera_info_url") or "")
        return (*(Path(path).expanduser() for path in named if path), *([calibration_file(url)] if url else ()))

    def find_spec(self) -> DetectorSpec:
        """The detector to use; override it for a detector of your own."""
        return DETECTORS[self.detector]

    @property
    def camera_pose(self) -> CameraPose:
        """Pose of the camera at the last image: as given, or as estimated from the people so far."""
        return self._pipeline.pose

    def start(self) -> None:
        cv2.setNumThreads(self.threads)

    def stop(self) -> None:
        self._save_pose(0)
        if self._without_people >= _MANY_IMAGES:
            self._warn_once(
                f"nobody was found in {self._without_people} images; if people are there, the camera may look down too "
                "steeply, be turned, or show them too small: docs/detectors.md"
            )

    def on_parameter(self, name: str) -> None:
        if name == "threshold":
            self._pipeline.set_threshold(None if self.threshold < 0 else self.threshold)
        elif name == "bridge_s":
            self._pipeline.set_bridge(None if self.bridge_s < 0 else self.bridge_s)
        elif name == "remember_s" and self._pipeline.tracker is not None:
            self._pipeline.tracker.remember_s = self.remember_s
        elif name == "hide_still":
            self._pipeline.hide_still = self.hide_still
        elif name == "person_height_m":
            self._pipeline.person_height_m = self.person_height_m
        elif name in ("depth_tolerance_s", "depth_pose"):
            self._sensors.tolerance_s = self.depth_tolerance_s
            self._sensors.set_pose(self.depth_pose)
        elif name in _GEOMETRY:
            self._camera = None

    @camera_info
    def on_camera_info(self, info: CameraInfo) -> None:
        given = msgspec.structs.replace(without_lens(info) if self.rectified else info, stamp=0)
        known = calibrated_info(given, self._calibration) or given
        if known != self._info:
            if self._calibration is not None:
                self._warn_once("camera_info_url is not used: a camera_info has arrived")
            model = CameraModel.from_info(known) if is_calibrated(known) else None
            self._tell_intrinsics(known, (0, 0) if model is None else (model.width, model.height))
            self._info, self._camera = known, None

    @depth
    @depth_compressed
    @depth_info
    @points
    @tf_static
    def on_sensor(self, message: Message) -> None:
        self._sensors.take(message)

    @tf
    def on_transforms(self, message: Transforms) -> None:
        self._sensors.take(message, moving=True)

    @image
    def on_image(self, image: Image) -> None:
        camera = self._placed(self._camera_of(image), image)
        yaw_rad = self._sensors.camera_yaw(image.frame_id, image.stamp)
        if yaw_rad is not None:
            camera = replace(camera, yaw_rad=yaw_rad)
        depth = self._sensors.at(image.stamp, image.frame_id, camera)
        bgr = image.bgr()
        time = self._time.at(image.stamp, self.clock.now())
        persons = self._pipeline.find(bgr, time, camera, depth)
        if self.id_prefix:
            persons = tuple(
                msgspec.structs.replace(each, track_id=each.track_id and self.id_prefix + each.track_id)
                for each in persons
            )
        pose = self.camera_pose
        source = "unknown" if pose.source == "assumed" else pose.source
        self._without_people = -1 if persons or self._without_people < 0 else self._without_people + 1
        if pose.pitch_rad - 2 * pose.pitch_std_rad > _STEEP_RAD:
            self._warn_once(
                f"the camera looks down by {pose.pitch_rad:.2f} rad: people seen from above are mostly missed; tilt it "
                f"by less than {_STEEP_RAD} rad, or use a model for such images (detector: onnx)"
            )
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp,
                frame_id=image.frame_id,
                width=image.width,
                height=image.height,
                persons=persons,
                camera_yaw_rad=yaw_rad,
                camera_hfov_rad=None if yaw_rad is None else camera.hfov_rad,
                camera_height_m=None if source == "unknown" else pose.height_m,
                camera_pitch_rad=None if source == "unknown" else pose.pitch_rad,
                camera_pose_source=source,
                faces=self._pipeline.searches_faces,
            )
        )
        boxes = tuple((person.x, person.y, person.w, person.h) for person in persons)
        self.annotations.publish(BoxMarkers(stamp=image.stamp, frame_id=image.frame_id, boxes=boxes))
        self._save_pose(_SAVE_NS)
        self._report_pose(time)
        turn = self._turned.look(bgr, time, persons) if self._turned is not None else ""
        if turn:
            self._warn_once(f"the camera seems to be turned: people are upright in images turned by {turn}")

    def _camera_of(self, image: Image) -> CameraModel:
        """The camera model, scaled to the size of ``image``."""
        width, height, info = image.width, image.height, self._info
        if self._camera is None or (self._camera.width, self._camera.height) != (width, height):
            self._tell_intrinsics(info, (width, height))
            pose = CameraPose.stated(self.mount_height_m, self.pitch_rad, self._filed_pose)
            self._camera = CameraModel.of_images(info, width, height, hfov_rad=self.hfov_rad, pose=pose)
        return self._camera

    def _tell_intrinsics(self, info: CameraInfo | None, size: tuple[int, int]) -> None:
        for problem in intrinsics_problems(info, *size, self.hfov_rad):
            self._warn_once(problem)

    def _placed(self, camera: CameraModel, image: Image) -> CameraModel:
        """The camera at the pose of the transforms, if neither parameters nor a file state one."""
        if self._filed_pose is not None or camera.pose.source == "given":
            return camera
        known = self._sensors.camera_pose(image.frame_id, image.stamp)
        return camera if known is None else camera.at(CameraPose.stated(self.mount_height_m, self.pitch_rad, known))

    def _save_pose(self, pause_ns: int) -> None:
        """Write a pose that people have refined to its file, at most every ``pause_ns``."""
        pose, now = self.camera_pose, self.clock.now()
        if (
            self._file is None
            or not self.keep_pose
            or pose.source not in ("people", "floor")
            or pose == self._saved
            or 0 <= now - self._saved_at < pause_ns
        ):
            return
        self._saved, self._saved_at = pose, now
        try:
            save_pose(pose, self._file)
        except ParameterError as error:
            self._warn_once(f"the pose of the camera is not kept: {error}")

    def _report_pose(self, stamp: int) -> None:
        """Report the pose of the camera with the health of the node, at most every ten seconds."""
        text = f"camera {self.camera_pose}"
        if self._info is None or not is_calibrated(self._info):
            text += f"; no camera_info: a field of view of {self.hfov_rad:.2f} rad is assumed"
        if self.camera_pose.source == "assumed":
            text += "; its pose is not known yet, so distances are rough"
        if text != self._reported and not 0 <= stamp - self._reported_at < _REPORT_NS:
            self._reported, self._reported_at = text, stamp
            self.report_health("ok", text)

    def _warn_once(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            self.log.warning(text)
