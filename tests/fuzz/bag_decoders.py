"""Bags of all formats, the definitions of types in them, and messages that only bags and robots of others have."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from socialbot.bags import codec
from socialbot.bags.other_images import decoded_images
from socialbot.bags.reader import FFMPEG_PACKET, FOXGLOVE_IMAGE, FOXGLOVE_RAW_IMAGE, FOXGLOVE_VIDEO, BagWriter, open_bag
from socialbot.bags.sound import has_decoder
from socialbot.bags.types import RosbagsTypes
from socialbot.core.clock import SECOND
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import (
    AudioData,
    CompressedImage,
    Image,
    Message,
    PointCloud,
    PointField,
    Structured,
    Transform,
    Transforms,
)
from socialbot.vision.depth_images import depth_in_metres, points_of, raw_depth, unpacked_depth
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.transforms import TransformTree
from tests.bags.making_bags import make_mcap, make_ros1
from tests.fuzz.decoder import STAMP, Decoder, text_of
from tests.fuzz.node_decoders import detections

TYPES = RosbagsTypes()
SOUND = "audio_common_msgs/msg/AudioStamped"
FOXGLOVE = "builtin_interfaces/Time timestamp\nstring frame_id\n"
OTHERS = {
    FFMPEG_PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
    FOXGLOVE_VIDEO: f"{FOXGLOVE}uint8[] data\nstring format\n",
    FOXGLOVE_IMAGE: f"{FOXGLOVE}uint8[] data\nstring format\n",
    SOUND: "std_msgs/Header header\naudio_common_msgs/Audio audio\n"
    f"{'=' * 80}\nMSG: audio_common_msgs/Audio\naudio_common_msgs/AudioData audio_data\n"
    "audio_common_msgs/AudioInfo info\n"
    f"{'=' * 80}\nMSG: audio_common_msgs/AudioInfo\nint32 format\nint32 channels\nint32 rate\nint32 chunk\n"
    f"{'=' * 80}\nMSG: audio_common_msgs/AudioData\nfloat32[] float32_data\nint32[] int32_data\nint16[] int16_data\n"
    "int8[] int8_data\nuint8[] uint8_data\n",
    FOXGLOVE_RAW_IMAGE: f"{FOXGLOVE}uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n",
}
DEFINITION = (
    'uint8 RED=1\nstring<=10 name "a"\nfloat64[3] place\nothers_msgs/Part[<=4] parts\nstd_msgs/Header header\n'
    f"{'=' * 80}\nMSG: others_msgs/Part\nint32[] numbers\nbuiltin_interfaces/Time time\n"
)
IDL = (
    "module others_msgs { module msg { module Whole_Constants { const uint8 RED = 1 << 2; };\n"
    '@verbatim(language="comment", text="a") '
    "struct Whole { sequence<double, 4> places; string name; long n[3]; }; }; };"
)


def bag_decoders(images: tuple[Image, ...], pictures: tuple[CompressedImage, ...], folder: Path) -> Iterator[Decoder]:
    """Decoders that read bags in ``folder``, made of these images."""
    for storage in ("mcap", "sqlite3"):
        bag = _bag(folder / f"made-{storage}", storage, images[0], pictures[0])
        [data] = (path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))
        yield Decoder(f"bag-{data.suffix[1:]}", _file(folder / f"bag{data.suffix}"), (data.read_bytes(),))
        if storage == "mcap":
            yield Decoder("bag-metadata", partial(_read_folder, folder, data), ((bag / "metadata.yaml").read_bytes(),))
    old = make_ros1(folder / "made.bag", count=3)
    yield Decoder("bag-ros1", _file(folder / "bag.bag"), (old.read_bytes(),))
    seeds = (
        f"ros2msg\n{DEFINITION}",
        f"ros2idl\n{'=' * 80}\nIDL: others_msgs/msg/Whole\n{IDL}",
        f"ros1msg\n{DEFINITION}",
    )
    yield Decoder("bag-definition", partial(_read_defined, folder / "defined.mcap"), tuple(map(str.encode, seeds)))
    for name, seeds in _others(pictures[0]).items():
        yield Decoder(f"bag-{name.rpartition('/')[2]}", partial(_convert, folder / "others", name), seeds)


def sensor_decoders() -> Iterator[Decoder]:
    """Serialised messages of sensors."""
    sound = AudioData(stamp=STAMP, samples=bytes(range(200)), sample_rate=16_000, channels=2)
    yield Decoder("cdr-typed", _typed, (_serialized(sound, "typed"),))
    fields = tuple(PointField(name, 4 * place, 7, 1) for place, name in enumerate("xyz"))
    data = np.frombuffer(np.linspace(0, 3, 12, dtype=np.float32).tobytes(), np.uint8)
    cloud = PointCloud(
        stamp=STAMP, frame_id="lidar", height=1, width=4, fields=fields, is_bigendian=False, point_step=12, row_step=48,
        data=data,
    )  # fmt: skip
    yield Decoder("cdr-cloud", _cdr(codec.ros_type(PointCloud), PointCloud, points_of), (_serialized(cloud),))
    moved = tuple(
        Transform(stamp=STAMP, parent=one, child=two, translation=(1, 0, 0), rotation=(0, 0, 0, 1))
        for one, two in (("base", "head"), ("head", "camera"))
    )
    transforms = Transforms(stamp=STAMP, transforms=moved)
    yield Decoder("cdr-transforms", _cdr(codec.ros_type(Transforms), Transforms, _moved), (_serialized(transforms),))
    raw = tuple(
        Image(
            stamp=STAMP, frame_id="c", height=2, width=2, encoding=encoding, step=2 * size, data=np.ones(4 * size, "u1")
        )
        for encoding, size in (("16UC1", 2), ("32FC1", 4))
    )
    use = lambda image: depth_in_metres(raw_depth(image))  # noqa: E731
    yield Decoder("cdr-depth", _cdr(codec.ros_type(Image), Image, use), tuple(map(_serialized, raw)))
    png = cv2.imencode(".png", np.full((2, 3), 1000, np.uint16))[1].tobytes()
    rvl = np.array([3, 2, 0x24222200], "<u4").tobytes()  # two pixels without depth, four with it
    packed = (b"16UC1; compressedDepth\n" + bytes(12) + png, b"16UC1; png compressed\n" + png)
    packed += (b"32FC1; compressedDepth rvl\n" + np.array([0, 100, 1], "<f4").tobytes() + rvl,)
    yield Decoder("depth-packed", _unpacked, packed)


def _serialized(message: Message, form: codec.WireForm = "json") -> bytes:
    return TYPES.serialize(codec.encode(message, TYPES, form))


def _cdr(name: str, kind: type[Message], use: Callable[..., object] = str) -> Callable[[bytes], object]:
    def decode(data: bytes) -> None:
        use(codec.decode(kind, TYPES.deserialize(data, name), stamp=STAMP))

    return decode


def _typed(data: bytes) -> None:
    codec.decode(Structured, TYPES.deserialize(data, codec.ros_type(AudioData, "typed")), stamp=STAMP)


def _moved(message: Transforms) -> None:
    tree = TransformTree()
    for moving in (False, True):
        tree.add(message.transforms, moving=moving)
    tree.lookup("base", "camera", STAMP)


def _unpacked(data: bytes) -> None:
    format, _, rest = data.partition(b"\n")
    image = CompressedImage(stamp=STAMP, frame_id="c", format=text_of(format), data=np.frombuffer(rest, np.uint8))
    depth_in_metres(unpacked_depth(image))


# Bags


def _bag(path: Path, storage: str, image: Image, picture: CompressedImage) -> Path:
    with BagWriter(path, storage=storage) as bag:
        for number in range(3):
            time = STAMP + number * SECOND
            for topic, message in (("/image", image), ("/jpeg", picture), ("/say", detections(number))):
                bag.write(topic, msgspec.structs.replace(message, stamp=time), time)
    return path


def _file(path: Path) -> Callable[[bytes], object]:
    def decode(data: bytes) -> None:
        path.write_bytes(data)
        _read(path)

    return decode


def _read(path: Path) -> None:
    with open_bag(path) as bag:
        bag.check()
        known = {topic.name: topic.name for topic in bag.topics if topic.type in codec.decodable_types()}
        for _ in bag.messages(known):
            pass


def _read_folder(folder: Path, file: Path, metadata: bytes) -> None:
    bag = folder / "bag"
    bag.mkdir(exist_ok=True)
    shutil.copy(file, bag / file.name)
    (bag / "metadata.yaml").write_bytes(metadata)
    _read(bag)


def _read_defined(path: Path, data: bytes) -> None:
    language, _, definition = data.partition(b"\n")
    channel = ("/others", "others_msgs/msg/Whole", text_of(language), definition, "cdr", [b"\0\1\0\0" + bytes(200)])
    _read(make_mcap(path, "ros2", [channel]))


def _others(picture: CompressedImage) -> dict[str, tuple[bytes, ...]]:
    """Serialised messages with images, sound or video by type; of video only where PyAV is installed."""
    types = get_typestore(Stores.ROS2_JAZZY)
    for name, text in OTHERS.items():
        types.register(get_types_from_msg(text, name))
    time = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    jpeg, bgr = np.asarray(picture.data), np.zeros(12, np.uint8)
    foxglove = {"timestamp": time, "frame_id": "camera"}
    fields = {
        FOXGLOVE_IMAGE: [{**foxglove, "data": jpeg, "format": "jpeg"}],
        FOXGLOVE_RAW_IMAGE: [{**foxglove, "width": 2, "height": 2, "encoding": "bgr8", "step": 6, "data": bgr}],
    }
    header = types.types["std_msgs/msg/Header"](stamp=time, frame_id="camera")
    samples = {
        f"{name}_data": np.arange(8 if name == "int16" else 0, dtype=name)
        for name in ("float32", "int32", "int16", "int8", "uint8")
    }
    info = types.types["audio_common_msgs/msg/AudioInfo"](format=8, channels=2, rate=16_000, chunk=4)
    data = types.types["audio_common_msgs/msg/AudioData"](**samples)
    fields[SOUND] = [{"header": header, "audio": types.types["audio_common_msgs/msg/Audio"](data, info)}]
    if has_decoder():
        for encoding in ("mpeg4", "vp8"):
            packet = np.frombuffer(_packet(encoding), np.uint8)
            ffmpeg = {"header": header, "width": 32, "height": 16, "pts": 0, "flags": 1, "is_bigendian": False}
            fields.setdefault(FFMPEG_PACKET, []).append({**ffmpeg, "encoding": encoding, "data": packet})
            fields.setdefault(FOXGLOVE_VIDEO, []).append({**foxglove, "data": packet, "format": encoding})
    return {
        name: tuple(bytes(types.serialize_cdr(types.types[name](**each), name)) for each in messages)
        for name, messages in fields.items()
    }


def _packet(encoding: str) -> bytes:
    import av  # pyright: ignore[reportMissingImports] - extra hear

    context: Any = av.CodecContext.create("libvpx" if encoding == "vp8" else encoding, "w")
    context.width, context.height, context.pix_fmt, context.framerate = 32, 16, "yuv420p", 10
    frame = av.VideoFrame.from_ndarray(np.zeros((16, 32, 3), np.uint8), format="bgr24")
    frame.pts = 0
    return bytes([*context.encode(frame), *context.encode(None)][0])


def _convert(path: Path, name: str, data: bytes) -> None:
    """Read a bag that has this message twice."""
    shutil.rmtree(path, ignore_errors=True)
    with BagWriter(path) as bag:
        for number in range(2):
            bag.write_raw("/others", name, data, STAMP + number, definition=OTHERS[name])
    if name == SOUND:
        _read(path)
        return
    with open_bag(path) as bag:
        for _, _, image in decoded_images(bag, ["/others"], {}):
            with suppress(SocialbotError):
                bgr_from_compressed(image) if isinstance(image, CompressedImage) else bgr_from_image(image)
