"""Puts rendered frames together, adds sensor noise, and writes the bag, the truth and the contact sheet."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from story import RATE, SECONDS

START = 1_700_000_000 * 10**9
IMAGE_TOPIC, INFO_TOPIC = "/camera/image_raw/compressed", "/camera/camera_info"
FRAME_ID = "camera_optical_frame"
WIDTH, HEIGHT, FOCAL = 640, 480, 525.0
FEATHER = 12
SHEET = [20, 45, 75, 100, 165, 227, 250, 335, 365, 378, 388, 394]
CAPACITY = 13_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def stamp_of(index: int) -> int:
    """Nanoseconds of a frame."""
    return START + index * (10**9 // RATE)


def ramp(low: int, high: int, limit: int) -> np.ndarray:
    """Weights along one side of a region."""
    rise = np.clip(np.arange(1, high - low + 1) / FEATHER, 0, 1)
    return np.minimum(rise if low > 0 else 1, rise[::-1] if high < limit else 1) * np.ones(high - low)


def feather(region: list[int]) -> np.ndarray:
    """Weights that fall to zero at the region's edges, but not at the picture's."""
    left, top, right, bottom = region
    across, down = ramp(left, right, WIDTH), ramp(top, bottom, HEIGHT)
    return np.minimum(across[None], down[:, None])[:, :, None]


def composed(frames: Path, index: int, background: np.ndarray) -> np.ndarray:
    """The background with the frame's regions blended in."""
    picture = background.astype(float)
    for number, region in enumerate(json.loads((frames / f"{index:04d}.json").read_text())["regions"]):
        left, top, right, bottom = region
        patch = cv2.imread(str(frames / f"{index:04d}_{number}.png")).astype(float)
        share = feather(region)
        hole = picture[top:bottom, left:right]
        picture[top:bottom, left:right] = hole + (patch - hole) * share
    return picture


def noisy(picture: np.ndarray, index: int, amount: float) -> np.ndarray:
    """Sensor noise: grows with brightness, slightly blurred by demosaicing, a different draw for each frame."""
    rng = np.random.default_rng(index)
    grain = rng.normal(0, 1, picture.shape) * 0.4 + rng.normal(0, 1, picture.shape[:2])[:, :, None]
    grain = cv2.GaussianBlur(grain, (3, 3), 0.6) * amount * (0.6 + picture / 255)
    return np.clip(picture + grain, 0, 255).round().astype(np.uint8)


def header(stamp: int) -> object:
    """Message header of a stamp."""
    time = TYPES["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=FRAME_ID)


def image_message(stamp: int, jpeg: np.ndarray) -> object:
    """The compressed image."""
    return TYPES["sensor_msgs/msg/CompressedImage"](header=header(stamp), format="jpeg", data=jpeg)


def info_message(stamp: int) -> object:
    """Intrinsics of the ideal camera."""
    k = np.array([FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1])
    p = np.array([FOCAL, 0, WIDTH / 2, 0, 0, FOCAL, HEIGHT / 2, 0, 0, 0, 1, 0])
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return TYPES["sensor_msgs/msg/CameraInfo"](
        header=header(stamp), height=HEIGHT, width=WIDTH, distortion_model="plumb_bob", d=np.zeros(5), k=k,
        r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip


def write_bag(path: Path, jpegs: list[np.ndarray]) -> None:
    """The rosbag2 folder with images at the frame rate and camera info once a second."""
    shutil.rmtree(path, ignore_errors=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        image_type, info_type = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
        images = bag.add_connection(IMAGE_TOPIC, image_type, typestore=STORE)
        infos = bag.add_connection(INFO_TOPIC, info_type, typestore=STORE)
        for index, jpeg in enumerate(jpegs):
            stamp = stamp_of(index)
            if index % RATE == 0:
                bag.write(infos, stamp, STORE.serialize_cdr(info_message(stamp), info_type))
            bag.write(images, stamp, STORE.serialize_cdr(image_message(stamp, jpeg), image_type))


def write_truth(path: Path, frames: Path) -> None:
    """One entry for every frame, one line each."""
    entries = []
    for index in range(SECONDS * RATE):
        persons = json.loads((frames / f"{index:04d}.json").read_text())["persons"]
        entries.append(json.dumps({"stamp": stamp_of(index), "persons": persons}))
    head = f'{{"schema": "socialbot/truth", "version": 1, "image_topic": "{IMAGE_TOPIC}", "frames": [\n'
    path.write_text(head + ",\n".join(entries) + "\n]}\n")


def write_sheet(path: Path, jpegs: list[np.ndarray], indices: list[int]) -> None:
    """Sample frames at half size, three in a row."""
    tiles = []
    for index in indices:
        picture = cv2.imdecode(jpegs[index], cv2.IMREAD_COLOR)
        tile = cv2.resize(picture, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA)
        label = f"{index / RATE:.1f} s"
        tiles.append(cv2.putText(tile, label, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1))
    rows = [np.hstack(tiles[i : i + 3]) for i in range(0, len(tiles), 3)]
    cv2.imwrite(str(path), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=Path, default=Path("frames"))
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--name", default="corridor")
    parser.add_argument("--quality", type=int, default=85)
    parser.add_argument("--noise", type=float, default=1.3, help="grey levels")
    parser.add_argument("--sheet", type=int, nargs="*", default=SHEET)
    options = parser.parse_args()
    background = cv2.imread(str(options.frames / "background.png"))
    jpegs = []
    for index in range(SECONDS * RATE):
        picture = noisy(composed(options.frames, index, background), index, options.noise)
        jpegs.append(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, options.quality])[1])
    write_bag(options.out / options.name, jpegs)
    write_truth(options.out / f"{options.name}.truth.json", options.frames)
    write_sheet(options.out / "sample.jpg", jpegs, options.sheet)
    size = sum(file.stat().st_size for file in (options.out / options.name).iterdir())
    print(f"{size} bytes")
    if size > CAPACITY:
        raise SystemExit("the bag is too large: lower --quality or --noise")


if __name__ == "__main__":
    main()
