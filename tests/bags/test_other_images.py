"""Video packets in bags become images."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from socialbot.bags.conversion import convert_bag
from socialbot.bags.image_files import decode_image
from socialbot.bags.reader import FFMPEG_PACKET, FOXGLOVE_VIDEO, BagWriter, open_bag
from socialbot.core.errors import BagError
from socialbot.core.messages import CompressedImage, Utterance
from tests.bags.making_bags import SAY, START
from tests.system.running import socialbot_here

av = pytest.importorskip("av", reason="`make hear` installs it")

DEFINITIONS = {
    FFMPEG_PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
    FOXGLOVE_VIDEO: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
}
TYPES = get_typestore(Stores.ROS2_JAZZY)
for name, text in DEFINITIONS.items():
    TYPES.register(get_types_from_msg(text, name))
TIME, HEADER = TYPES.types["builtin_interfaces/msg/Time"], TYPES.types["std_msgs/msg/Header"]
STEP = 100_000_000
NAMES = {FFMPEG_PACKET: "/camera/image_raw/ffmpeg", FOXGLOVE_VIDEO: "/camera/front"}
IMAGES = {FFMPEG_PACKET: "/camera/image_raw/compressed", FOXGLOVE_VIDEO: "/camera/front/compressed"}

AV1 = [
    "EgAKCgAAAAM3++NXzAIygQEUACAgIAAAAPAI1/8RCli8pw2DH6x98NP3Fv9GRcymskaR6D8UptDzrhvhG6Xer7V8xhL+Lcg7Js8O"
    "EL9yyf3fqz15DAVxv5MooJAlZOcMn1Ac/EV/TPSnHzAn2CXuC5KX6OKNuc7YLyUAgNH9PAcNPM7nEy//Rjh1MzFLnLNEFcA=",
    "EgAyNigCACSSST0BAAwwQQAAADAA2r14lULNp0KfUsvYin0urWv12EdRzbT9tyTRC/JOawe+lOUUwDITMAIECSQAegKAAACAAAMAAI08zA==",
    "EgAaAYg=",
    "EgAyEjAGAgAAAHoCgAAAgAAAAIBigA==",
]
"""The first four images, encoded by SVT-AV1 (base64). That encoder gives the threads of root real-time priority."""


def pixels(number: int) -> np.ndarray:
    image = np.full((96, 128, 3), 40, np.uint8)
    cv2.rectangle(image, (8 * number, 20), (8 * number + 20, 70), (30, 200, 230), -1)
    return image


def packets(encoder: str, count: int = 12, tune: str = "zerolatency") -> Iterator[tuple[int, bytes]]:
    """Yield the number and the packet of each image, in the order of the encoder."""
    if encoder == "av1":
        yield from enumerate(map(b64decode, AV1))
        return
    context = av.CodecContext.create(encoder, "w")
    context.width, context.height, context.pix_fmt = 128, 96, "yuv420p"
    context.framerate, context.bit_rate = 10, 2_000_000
    context.gop_size = 6
    context.options = {"tune": tune, "x265-params": "log-level=none"} if "x26" in encoder else {}
    for number in range(count):
        frame = av.VideoFrame.from_ndarray(pixels(number), format="bgr24")
        frame.pts = number
        yield from ((packet.pts, bytes(packet)) for packet in context.encode(frame))
    yield from ((packet.pts, bytes(packet)) for packet in context.encode(None))


def video_bag(path: Path, kind: str, encoding: str, data: list[tuple[int, bytes]]) -> Path:
    with BagWriter(path) as writer:
        for index, (number, each) in enumerate(data):
            stamp, received = START + number * STEP, START + index * STEP
            time, content = TIME(sec=stamp // 10**9, nanosec=stamp % 10**9), np.frombuffer(each, np.uint8)
            if kind == FFMPEG_PACKET:
                header = HEADER(stamp=time, frame_id="camera_optical")
                fields = {"header": header, "width": 128, "height": 96, "encoding": encoding, "pts": number, "flags": 0}
                message = TYPES.types[kind](**fields, is_bigendian=False, data=content)
            else:
                message = TYPES.types[kind](timestamp=time, frame_id="camera_optical", data=content, format=encoding)
            written = bytes(TYPES.serialize_cdr(message, kind))
            writer.write_raw(NAMES[kind], kind, written, received, definition=DEFINITIONS[kind])
            writer.write(SAY, Utterance(stamp=received, id=f"say-{index}", text="hello"), received)
    return path


def images(path: Path, topic: str) -> list[CompressedImage]:
    with open_bag(path) as bag:
        return [image for _, image in bag.messages({topic: topic}) if isinstance(image, CompressedImage)]


@pytest.mark.parametrize(
    ("kind", "encoding", "encoder"),
    [
        (FFMPEG_PACKET, "libx264", "libx264"),
        (FFMPEG_PACKET, "h264;yuv420p;bgr8;bgr8", "libx264"),
        (FFMPEG_PACKET, "hevc_nvenc", "libx265"),
        (FOXGLOVE_VIDEO, "h264", "libx264"),
        (FOXGLOVE_VIDEO, "h265", "libx265"),
        (FOXGLOVE_VIDEO, "vp9", "libvpx-vp9"),
        (FFMPEG_PACKET, "libvpx_vp8", "libvpx"),
        (FFMPEG_PACKET, "mpeg4", "mpeg4"),
        (FOXGLOVE_VIDEO, "av1", "av1"),
    ],
)
def test_each_packet_becomes_the_image_of_its_time(tmp_path: Path, kind: str, encoding: str, encoder: str) -> None:
    if encoder not in av.codecs_available:
        pytest.skip(f"PyAV has no encoder {encoder}")
    data = list(packets(encoder))
    bag = video_bag(tmp_path / "bag", kind, encoding, data)
    done = socialbot_here("bag", "convert", bag, tmp_path / "new", "--decode")
    assert done.returncode == 0, done.stderr
    assert f"{len(data)} of them now images" in done.stdout
    found = images(tmp_path / "new", IMAGES[kind])
    assert [image.stamp for image in found] == [START + number * STEP for number in range(len(data))]
    assert {image.frame_id for image in found} == {"camera_optical"}
    for number, image in enumerate(found):
        seen = decode_image(image.data.tobytes(), where="image")
        assert float(np.abs(seen.astype(int) - pixels(number)).mean()) < 6.0
    with open_bag(tmp_path / "new") as new, open_bag(bag) as old:
        assert list(new.messages({SAY: SAY})) == list(old.messages({SAY: SAY}))
        assert new.choose_image_topic().name == IMAGES[kind]


def test_images_that_the_encoder_reorders_keep_their_times(tmp_path: Path) -> None:
    data = list(packets("libx264", tune="animation"))
    assert [number for number, _ in data] != sorted(number for number, _ in data)
    convert_bag(video_bag(tmp_path / "bag", FOXGLOVE_VIDEO, "h264", data), tmp_path / "new", None, decode=True)
    found = images(tmp_path / "new", IMAGES[FOXGLOVE_VIDEO])
    assert [image.stamp for image in found] == [START + number * STEP for number in range(len(data))]
    for number, image in enumerate(found):
        seen = decode_image(image.data.tobytes(), where="image")
        assert float(np.abs(seen.astype(int) - pixels(number)).mean()) < 6.0


def test_packets_before_a_key_frame_and_damaged_ones_give_no_image(tmp_path: Path) -> None:
    data = list(packets("libx264"))[1:]
    data[7] = 8, b"\0\0\0\1\x65" + bytes(range(60))
    made = convert_bag(video_bag(tmp_path / "bag", FOXGLOVE_VIDEO, "h264", data), tmp_path / "new", None, decode=True)
    found = images(tmp_path / "new", IMAGES[FOXGLOVE_VIDEO])
    assert [image.stamp for image in found][:2] == [START + number * STEP for number in (6, 7)]
    assert made.skipped[NAMES[FOXGLOVE_VIDEO]].count == len(data) - len(found) >= 6


@pytest.mark.parametrize("data", [bytes(50), None], ids=["no video", "no key frame"])
def test_a_video_without_any_image_is_refused(tmp_path: Path, data: bytes | None) -> None:
    parts = list(packets("libx264"))[1:4] if data is None else [(0, data)]
    bag = video_bag(tmp_path / "bag", FOXGLOVE_VIDEO, "h264", parts)
    with pytest.raises(BagError, match="no image can be decoded"):
        convert_bag(bag, tmp_path / "new", None, decode=True)
    assert not (tmp_path / "new").exists()


def test_unknown_encodings_and_bags_without_video_are_refused(tmp_path: Path) -> None:
    bag = video_bag(tmp_path / "bag", FOXGLOVE_VIDEO, "prores", [(0, b"data")])
    with pytest.raises(BagError, match="the video encoding 'prores' is unknown"):
        convert_bag(bag, tmp_path / "new", None, decode=True)
    assert not (tmp_path / "new").exists()
    bag = video_bag(tmp_path / "both", FOXGLOVE_VIDEO, "h264", list(packets("libx264", 2)))
    with BagWriter(tmp_path / "again") as writer, open_bag(bag) as opened:
        for topic, time, kind, data in opened.raw_messages({NAMES[FOXGLOVE_VIDEO]: NAMES[FOXGLOVE_VIDEO]}):
            writer.write_raw(topic, kind, data, time, definition=DEFINITIONS[kind])
        image = CompressedImage(stamp=START, frame_id="", format="jpeg", data=np.zeros(9, np.uint8))
        writer.write(IMAGES[FOXGLOVE_VIDEO], image, START)
    with pytest.raises(BagError, match="has messages on /camera/front/compressed already"):
        convert_bag(tmp_path / "again", tmp_path / "new", None, decode=True)
    with BagWriter(tmp_path / "two") as writer, open_bag(bag) as opened:
        for topic, time, kind, data in opened.raw_messages({NAMES[FOXGLOVE_VIDEO]: NAMES[FOXGLOVE_VIDEO]}):
            for name in (topic, f"{topic}/video"):
                writer.write_raw(name, kind, data, time, definition=DEFINITIONS[kind])
    with pytest.raises(BagError, match="has messages on /camera/front/compressed already"):
        convert_bag(tmp_path / "two", tmp_path / "new", None, decode=True)
    with BagWriter(tmp_path / "words") as writer:
        writer.write(SAY, Utterance(stamp=START, id="say", text="hello"), START)
    with pytest.raises(BagError, match="has no images that can be decoded"):
        convert_bag(tmp_path / "words", tmp_path / "new", None, decode=True)


def test_a_replay_of_video_packets_names_the_command_that_decodes_them(tmp_path: Path) -> None:
    bag = video_bag(tmp_path / "bag", FOXGLOVE_VIDEO, "h264", list(packets("libx264", 3)))
    with open_bag(bag) as opened, pytest.raises(BagError) as refused:
        opened.choose_image_topic()
    assert f"socialbot bag convert {bag} NEW --decode" in str(refused.value)
