"""The bag: compressed images, camera info and truth as ROS 2 Jazzy messages."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from optics import FOCAL, HEIGHT, WIDTH
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from truths import IMAGE_TOPIC

INFO_TOPIC, TRUTH_TOPIC = "/camera/camera_info", "/ground_truth/persons"
IMAGE_TYPE, INFO_TYPE = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
TRUTH_TYPE = "std_msgs/msg/String"
FRAME_ID = "camera_optical_frame"
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def header(stamp: int) -> object:
    """Message header of a stamp (ns)."""
    time = TYPES["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=FRAME_ID)


def image_message(stamp: int, jpeg: np.ndarray) -> object:
    """The compressed image."""
    return TYPES[IMAGE_TYPE](header=header(stamp), format="jpeg", data=jpeg)


def info_message(stamp: int) -> object:
    """Intrinsics of the ideal camera."""
    k = np.array([FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1])
    p = np.array([FOCAL, 0, WIDTH / 2, 0, 0, FOCAL, HEIGHT / 2, 0, 0, 0, 1, 0])
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return TYPES[INFO_TYPE](
        header=header(stamp), height=HEIGHT, width=WIDTH, distortion_model="plumb_bob", d=np.zeros(5), k=k,
        r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip


def write_bag(path: Path, stamps: Sequence[int], jpegs: Sequence[np.ndarray], truths: Sequence[str], rate: int) -> None:
    """The rosbag2 folder: camera info once a second, and for every image the truth at its time, right before it."""
    shutil.rmtree(path, ignore_errors=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        infos = bag.add_connection(INFO_TOPIC, INFO_TYPE, typestore=STORE)
        people = bag.add_connection(TRUTH_TOPIC, TRUTH_TYPE, typestore=STORE)
        images = bag.add_connection(IMAGE_TOPIC, IMAGE_TYPE, typestore=STORE)
        for index, (stamp, jpeg, truth) in enumerate(zip(stamps, jpegs, truths, strict=True)):
            if index % rate == 0:
                bag.write(infos, stamp, STORE.serialize_cdr(info_message(stamp), INFO_TYPE))
            message = TYPES[TRUTH_TYPE](data=truth)
            bag.write(people, stamp, STORE.serialize_cdr(message, TRUTH_TYPE))
            bag.write(images, stamp, STORE.serialize_cdr(image_message(stamp, jpeg), IMAGE_TYPE))
