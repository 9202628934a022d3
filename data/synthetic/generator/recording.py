"""The bag: compressed images, camera info, truth, depth, joints and transforms as ROS 2 Jazzy messages."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from optics import View
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from truths import IMAGE_TOPIC

INFO_TOPIC, TRUTH_TOPIC = "/camera/camera_info", "/ground_truth/persons"
IMAGE_TYPE, INFO_TYPE = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
TRUTH_TYPE = "std_msgs/msg/String"
DEPTH_TOPIC, DEPTH_LAG = "/camera/depth/image_raw/compressedDepth", 8_000_000  # ns after the image
JOINTS_TYPE, TF_TYPE = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
JOINTS_STEP = 50_000_000  # ns
NEVER = QosTime(2147483647, 4294967295)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, NEVER, NEVER,
    QosLiveliness.AUTOMATIC, NEVER, False,
)  # fmt: skip
STATIC_TOPIC, MODEL_TOPIC = "/tf_static", "/robot_description"
PAN, TILT = ("base_footprint", "head_pan_link"), ("head_pan_link", "head_tilt_link")
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
FRAME_ID = "camera_optical_frame"
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


URDF = """<robot name="head"><link name="base_footprint"/><link name="head_pan_link"/><link name="head_tilt_link"/>
<link name="camera_optical_frame"/>
<joint name="head_pan_joint" type="revolute"><parent link="base_footprint"/><child link="head_pan_link"/>
<origin xyz="0 0 {height}"/><axis xyz="0 0 1"/><limit lower="-1.6" upper="1.6" effort="5" velocity="2"/></joint>
<joint name="head_tilt_joint" type="revolute"><parent link="head_pan_link"/><child link="head_tilt_link"/>
<axis xyz="0 1 0"/><limit lower="-0.8" upper="0.8" effort="5" velocity="2"/></joint>
<joint name="camera_joint" type="fixed"><parent link="head_tilt_link"/><child link="camera_optical_frame"/>
<origin xyz="{ahead} 0 {up}" rpy="-1.5707963 0 -1.5707963"/></joint></robot>
"""


def header(stamp: int, frame: str = FRAME_ID) -> object:
    """Message header of a stamp (ns)."""
    time = TYPES["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def image_message(stamp: int, jpeg: np.ndarray) -> object:
    """The compressed image."""
    return TYPES[IMAGE_TYPE](header=header(stamp), format="jpeg", data=jpeg)


def depth_message(stamp: int, depth: np.ndarray) -> object:
    """A depth image (uint16, mm) as image_transport compresses it: a header of 12 bytes, then a PNG."""
    png = cv2.imencode(".png", depth, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    data = np.concatenate([np.frombuffer(struct.pack("<iff", 0, 0.0, 0.0), np.uint8), png])
    return TYPES[IMAGE_TYPE](header=header(stamp), format="16UC1; compressedDepth png", data=data)


def info_message(stamp: int, view: View) -> object:
    """Intrinsics of a camera."""
    (wide, high), f = view.size, view.focal
    k = np.array([f, 0, wide / 2, 0, f, high / 2, 0, 0, 1])
    p = np.array([f, 0, wide / 2, 0, 0, f, high / 2, 0, 0, 0, 1, 0])
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return TYPES[INFO_TYPE](
        header=header(stamp), height=high, width=wide, distortion_model="plumb_bob",
        d=np.array(view.lens or (0.0,) * 5), k=k, r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip


def transform(
    stamp: int, frames: tuple[str, str], place: tuple[float, float, float], turn: tuple[float, float, float, float]
) -> object:
    """A frame (parent, child) with its place (m) and turn (quaternion x, y, z, w)."""
    geometry = "geometry_msgs/msg/"
    moved = TYPES[geometry + "Transform"](
        translation=TYPES[geometry + "Vector3"](*map(float, place)),
        rotation=TYPES[geometry + "Quaternion"](*map(float, turn)),
    )
    stamped = TYPES[geometry + "TransformStamped"]
    return stamped(header=header(stamp, frames[0]), child_frame_id=frames[1], transform=moved)


@dataclass(frozen=True)
class Head:
    """A head that turns: joint angles (pan, tilt; rad) at a time (s), height of its axes, the lens ahead and above."""

    angles: Callable[[float], tuple[float, float]]
    height: float
    nose: tuple[float, float]

    def messages(self, start: int, end: int) -> Iterator[tuple[str, str, int, object]]:
        """Topic, type, stamp and message: what never changes at the start, joints and transforms to the end (ns)."""
        ahead, up = self.nose
        text = URDF.format(height=self.height, ahead=ahead, up=up)
        yield MODEL_TOPIC, TRUTH_TYPE, start, TYPES[TRUTH_TYPE](data=text)
        lens = transform(start, ("head_tilt_link", FRAME_ID), (ahead, 0, up), OPTICAL)
        yield STATIC_TOPIC, TF_TYPE, start, TYPES[TF_TYPE](transforms=[lens])
        for stamp in range(start, end + JOINTS_STEP, JOINTS_STEP):
            pan, tilt = self.angles((stamp - start) / 1e9)
            state = TYPES[JOINTS_TYPE](
                header=header(stamp, ""), name=["head_pan_joint", "head_tilt_joint"],
                position=np.array([pan, tilt]), velocity=np.empty(0), effort=np.empty(0),
            )  # fmt: skip
            yield "/joint_states", JOINTS_TYPE, stamp, state
            links = [
                transform(stamp, PAN, (0, 0, self.height), (0, 0, np.sin(pan / 2), np.cos(pan / 2))),
                transform(stamp, TILT, (0, 0, 0), (0, np.sin(tilt / 2), 0, np.cos(tilt / 2))),
            ]
            yield "/tf", TF_TYPE, stamp, TYPES[TF_TYPE](transforms=links)


def write_bag(
    path: Path,
    stamps: Sequence[int],
    jpegs: Sequence[np.ndarray],
    truths: Sequence[str],
    rate: int,
    view: View,
    depths: Mapping[int, np.ndarray] = {},
    head: Head | None = None,
) -> None:
    """The rosbag2 folder: camera info once a second, and for every image the truth at its time, right before it.

    depths: depth images (uint16, mm) by the stamp of their image.
    """
    messages = list(head.messages(stamps[0], stamps[-1])) if head else []
    for index, (stamp, jpeg, truth) in enumerate(zip(stamps, jpegs, truths, strict=True)):
        if index % rate == 0:
            messages.append((INFO_TOPIC, INFO_TYPE, stamp, info_message(stamp, view)))
        messages.append((TRUTH_TOPIC, TRUTH_TYPE, stamp, TYPES[TRUTH_TYPE](data=truth)))
        messages.append((IMAGE_TOPIC, IMAGE_TYPE, stamp, image_message(stamp, jpeg)))
        if stamp in depths:
            later = stamp + DEPTH_LAG
            messages.append((DEPTH_TOPIC, IMAGE_TYPE, later, depth_message(later, depths[stamp])))
    shutil.rmtree(path, ignore_errors=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {}
        for topic, kind, stamp, message in sorted(messages, key=lambda entry: entry[2]):
            if topic not in connections:
                latched = [LATCHED] if topic in (STATIC_TOPIC, MODEL_TOPIC) else []
                connections[topic] = bag.add_connection(topic, kind, typestore=STORE, offered_qos_profiles=latched)
            bag.write(connections[topic], stamp, STORE.serialize_cdr(message, kind))
