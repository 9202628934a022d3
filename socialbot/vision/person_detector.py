"""The node that finds people in pictures and says where they stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2

from socialbot.graph import Context, Delivery, Input, Node, Output, Parameter
from socialbot.messages import BoxMarkers, CameraInfo, Image, PersonDetection, PersonDetections
from socialbot.vision.camera import CameraModel
from socialbot.vision.detector import Detector
from socialbot.vision.hog import HogDetector

__all__ = ["DETECTORS", "PersonDetector"]

DETECTORS: Mapping[str, Callable[[float, int], Detector]] = {
    "hog": lambda threshold, threads: HogDetector(threshold, threads=threads),
}
"""The detectors by name; each is made from a threshold and a number of threads."""

_GEOMETRY = frozenset({"mount_height_m", "pitch_rad", "hfov_rad"})


class PersonDetector(Node):
    """Publishes the people in each picture, with distance and direction, and their boxes for viewers.

    Every picture is answered, also one without people. Until a camera_info arrives the camera's
    field of view is taken from ``hfov_rad``.
    """

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    camera_info = Input(CameraInfo, "/camera/camera_info", Delivery.LATCHED)
    detections = Output(PersonDetections, "/humans/bodies/detections")
    annotations = Output(BoxMarkers, "/humans/bodies/annotations", Delivery.NEWEST)

    detector = Parameter("hog", "how people are found", choices=tuple(DETECTORS), fixed=True)
    threshold = Parameter(
        0.5, "least score of a detection, in the detector's scale: hog 0 to about 3", minimum=-1.0, maximum=10.0
    )
    threads = Parameter(1, "processor threads for OpenCV and the detector", minimum=1, maximum=64, fixed=True)
    mount_height_m = Parameter(1.62, "height of the camera above the floor, m", minimum=0.05, maximum=10.0)
    pitch_rad = Parameter(0.052, "how far the camera looks down, rad", minimum=-1.0, maximum=1.0)
    person_height_m = Parameter(1.70, "how tall people are taken to be, m", minimum=0.5, maximum=2.5)
    hfov_rad = Parameter(1.09, "horizontal field of view until a camera_info arrives, rad", minimum=0.1, maximum=3.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises InstallationError when the detector is not installed."""
        super().__init__(name, context, parameters)
        self._detector = DETECTORS[self.detector](self.threshold, self.threads)
        self._info: CameraInfo | None = None
        self._camera: CameraModel | None = None
        self._told: set[str] = set()

    def start(self) -> None:
        cv2.setNumThreads(self.threads)

    def on_parameter(self, name: str) -> None:
        if name == "threshold":
            self._detector.threshold = self.threshold
        elif name in _GEOMETRY:
            self._camera = None

    @camera_info
    def on_camera_info(self, info: CameraInfo) -> None:
        CameraModel.from_info(info)
        self._info = info
        self._camera = None

    @image
    def on_image(self, image: Image) -> None:
        found = self._detector.detect(image.bgr())
        camera = self._camera_of(image)
        persons = tuple(
            self._person(camera, tuple(box), score)
            for box, score in zip(found.boxes.tolist(), found.scores.tolist(), strict=True)
        )
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp, frame_id=image.frame_id, width=image.width, height=image.height, persons=persons
            )
        )
        boxes = tuple((person.x, person.y, person.w, person.h) for person in persons)
        self.annotations.publish(BoxMarkers(stamp=image.stamp, frame_id=image.frame_id, boxes=boxes))

    def _person(self, camera: CameraModel, box: tuple[float, ...], score: float) -> PersonDetection:
        x, y, w, h = box
        size = {"person_height_m": self.person_height_m, "person_width_m": self._detector.box_width_m}
        bearing, elevation = camera.head(box, **size)
        return PersonDetection(
            x=x,
            y=y,
            w=w,
            h=h,
            score=score,
            distance_m=camera.distance(box, **size),
            bearing_rad=bearing,
            elevation_rad=elevation,
        )

    def _camera_of(self, image: Image) -> CameraModel:
        """The camera that took ``image``, its intrinsics fitted to the size of the picture."""
        if self._camera is None or (self._camera.width, self._camera.height) != (image.width, image.height):
            self._camera = self._new_camera(image.width, image.height)
        return self._camera

    def _new_camera(self, width: int, height: int) -> CameraModel:
        mount, pitch = self.mount_height_m, self.pitch_rad
        if self._info is None:
            self._tell_once(f"no camera_info yet: distances assume a field of view of {self.hfov_rad:.2f} rad")
            return CameraModel.from_field_of_view(width, height, self.hfov_rad, mount_height_m=mount, pitch_rad=pitch)
        camera = CameraModel.from_info(self._info, mount_height_m=mount, pitch_rad=pitch)
        if (camera.width, camera.height) == (width, height):
            return camera
        self._tell_once(
            f"camera_info is for {camera.width}x{camera.height} pixels but pictures have {width}x{height}: "
            "its intrinsics are scaled"
        )
        return camera.scaled(width, height)

    def _tell_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self.log.warning(text)
