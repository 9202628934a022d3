"""Import of videos, image folders and cameras, and conversion between message forms."""

from __future__ import annotations

import math
import os
import resource
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

from socialbot.bags import codec
from socialbot.bags.conversion import TOPIC, convert_bag, import_bag
from socialbot.bags.reader import FOXGLOVE_IMAGE, FOXGLOVE_RAW_IMAGE, BagWriter, RosbagsTypes, open_bag
from socialbot.cli.bag import bag as commands
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import BagError, ParameterError
from socialbot.core.messages import (
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    Image,
    Mind,
    PersonDetection,
    PersonDetections,
    Structured,
    TraceRecord,
    Utterance,
)
from socialbot.vision.depth_images import depth_in_metres, unpacked_depth
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from tests.system.running import limited

INFO = "/camera/camera_info"


def picture(level: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width, 3), level, np.uint8)


def folder(path: Path, count: int = 12) -> Path:
    path.mkdir()
    for index in range(count):
        cv2.imwrite(str(path / f"image{index}.png"), picture(index * 20))
    (path / "notes.txt").write_text("no image")
    return path


def video(path: Path, count: int = 30, rate_hz: float = 20.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (64, 48))
    for index in range(count):
        writer.write(picture(index * 8))
    writer.release()
    return path


def images_of(path: Path, topic: str = TOPIC) -> list[tuple[int, np.ndarray]]:
    with open_bag(path) as bag:
        found = [message for _, message in bag.messages({topic: topic})]
        assert not bag.skipped
    images = [message for message in found if isinstance(message, CompressedImage)]
    assert len(images) == len(found)
    return [(image.stamp, np.asarray(cv2.imdecode(image.data, cv2.IMREAD_COLOR))) for image in images]


def levels_of(path: Path) -> list[int]:
    return [round(float(pixels.mean())) for _, pixels in images_of(path)]


def test_folder_in_natural_order(tmp_path: Path) -> None:
    made = import_bag(folder(tmp_path / "images"), tmp_path / "bag", rate_hz=4.0, start=7 * SECOND)
    assert (made.images, made.width, made.height, made.duration_s) == (12, 64, 48, 2.75)
    assert [stamp for stamp, _ in images_of(tmp_path / "bag")] == [
        7 * SECOND + index * SECOND // 4 for index in range(12)
    ]
    assert levels_of(tmp_path / "bag") == pytest.approx([index * 20 for index in range(12)], abs=2)


def tum_rgbd(path: Path, rgb: str = "", units: int = 5000) -> Path:
    """A folder of TUM RGB-D: three images, and depth 10 ms later."""
    lines: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"]}
    for name in lines:
        (path / name).mkdir(parents=True)
    for index in range(3):
        for name, late, pixels in (("rgb", 0, picture(9)), ("depth", 0.01, np.full((48, 64), 3 * units, np.uint16))):
            stamp = f"{1341846313.592 + index / 4 + late:.6f}"
            cv2.imwrite(str(path / name / f"{stamp}.png"), pixels)
            lines[name].append(f"{stamp} {name}/{stamp}.png")
    for name, written in lines.items():
        (path / f"{name}.txt").write_text("\n".join([*written, rgb if name == "rgb" else ""]))
    return path


def test_tum_rgbd_with_its_stamps_and_depth(tmp_path: Path) -> None:
    made = import_bag(tum_rgbd(tmp_path / "tum"), tmp_path / "bag")
    assert (made.images, made.depths, made.duration_s) == (3, 3, pytest.approx(0.5, abs=1e-6))
    with open_bag(tmp_path / "bag") as bag:
        sensors = bag.depth_sensors_for(TOPIC)
        [(topic, kind)] = sensors.items()
        assert kind is CompressedDepth
        depths = [message for _, message in bag.messages({topic: topic}, sensors)]
    pictures = [stamp for stamp, _ in images_of(tmp_path / "bag")]
    assert pictures[0] == SECOND
    assert [depth.stamp - stamp for depth, stamp in zip(depths, pictures, strict=True)] == pytest.approx(
        [10**7] * 3, abs=999
    )
    assert isinstance(depths[0], CompressedDepth)
    assert np.allclose(depth_in_metres(unpacked_depth(depths[0])), 3.0)


@pytest.mark.parametrize("line", ["1 rgb/no.png x", "soon rgb/no.png", "inf rgb/no.png", "1 rgb/no.png"])
def test_damaged_tum_rgbd(tmp_path: Path, line: str) -> None:
    with pytest.raises(BagError, match=r"rgb.txt, line 5|no.png"):
        import_bag(tum_rgbd(tmp_path / "tum", line), tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_folder_whose_folders_have_images(tmp_path: Path) -> None:
    for name in ("left", "right"):
        folder(tmp_path / name, 1)
    with pytest.raises(BagError, match="left, right"):
        import_bag(tmp_path, tmp_path / "bag")


def test_camera_info_once_a_second(tmp_path: Path) -> None:
    import_bag(folder(tmp_path / "images"), tmp_path / "bag", rate_hz=4.0, hfov_deg=90.0)
    with open_bag(tmp_path / "bag") as bag:
        infos = [message for _, message in bag.messages({INFO: INFO}) if isinstance(message, CameraInfo)]
        assert bag.camera_info_topic_for(TOPIC) is not None
    assert [info.stamp for info in infos] == [SECOND, 2 * SECOND, 3 * SECOND]
    assert (infos[0].width, infos[0].height) == (64, 48)
    assert infos[0].k == pytest.approx((32, 0, 32, 0, 32, 24, 0, 0, 1))


@pytest.mark.parametrize(("hfov_deg", "focal"), [(None, 50 / math.tan(math.radians(30))), (60.0, 15 * 3**0.5)])
def test_an_unknown_field_of_view_is_along_the_longer_side(
    tmp_path: Path, hfov_deg: float | None, focal: float
) -> None:
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images/a.png"), np.full((100, 30, 3), 90, np.uint8))
    import_bag(tmp_path / "images", tmp_path / "bag", hfov_deg=hfov_deg)
    with open_bag(tmp_path / "bag") as bag:
        (info,) = (message for _, message in bag.messages({INFO: INFO}) if isinstance(message, CameraInfo))
    assert info.k[0] == pytest.approx(focal)


def test_pictures_can_be_made_smaller(tmp_path: Path) -> None:
    made = import_bag(folder(tmp_path / "images"), tmp_path / "bag", width=32)
    assert (made.width, made.height) == (32, 24)
    assert images_of(tmp_path / "bag")[0][1].shape == (24, 32, 3)
    with open_bag(tmp_path / "bag") as bag:
        (first, *_) = [message for _, message in bag.messages({INFO: INFO}) if isinstance(message, CameraInfo)]
    assert first.k[0] == pytest.approx(16 / math.tan(math.radians(30)))


def test_quality_decides_on_the_size(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    noise = np.random.default_rng(1).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "images" / "a.png"), noise)
    sizes = []
    for quality in (10, 95):
        import_bag(tmp_path / "images", tmp_path / f"bag{quality}", jpeg_quality=quality)
        sizes.append((tmp_path / f"bag{quality}" / f"bag{quality}.mcap").stat().st_size)
    assert sizes[0] < 0.7 * sizes[1]


def test_video_keeps_its_time_stamps(tmp_path: Path) -> None:
    made = import_bag(video(tmp_path / "film.avi"), tmp_path / "bag")
    stamps = [stamp for stamp, _ in images_of(tmp_path / "bag")]
    assert made.images == 30
    assert stamps == pytest.approx([SECOND + index * SECOND // 20 for index in range(30)], abs=2_000_000)
    assert levels_of(tmp_path / "bag") == pytest.approx([index * 8 for index in range(30)], abs=4)


def test_limit_ends_the_import(tmp_path: Path) -> None:
    made = import_bag(video(tmp_path / "film.avi"), tmp_path / "bag", limit_s=0.5)
    assert made.images == 10


class Camera:
    """A camera that is unplugged after some pictures, and whose clock goes on with each."""

    rate_hz = 30.0
    size = (64, 48)

    def __init__(self, clock: ManualClock, count: int) -> None:
        self.clock = clock
        self.left = count
        self.closed = False

    def read(self) -> np.ndarray | None:
        self.clock.advance(0.1)
        self.left -= 1
        return picture(50) if self.left >= 0 else None

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(("limit_s", "stop_after", "expected"), [(1.0, 99, 10), (None, 5, 5), (None, 99, 20)])
def test_camera_is_stamped_by_the_clock(tmp_path: Path, limit_s: float | None, stop_after: int, expected: int) -> None:
    clock = ManualClock(5 * SECOND)
    camera = Camera(clock, 20)
    made = import_bag(
        "0",
        tmp_path / "bag",
        camera=camera,
        limit_s=limit_s,
        clock=clock,
        stopped=lambda: camera.left < 20 - stop_after,
    )
    stamps = [stamp for stamp, _ in images_of(tmp_path / "bag")]
    assert made.images == expected
    assert stamps == pytest.approx([5 * SECOND + (index + 1) * SECOND // 10 for index in range(expected)])
    assert camera.closed


def test_topic_can_be_chosen(tmp_path: Path) -> None:
    import_bag(folder(tmp_path / "images", 2), tmp_path / "bag", topic="/left/image/compressed")
    with open_bag(tmp_path / "bag") as bag:
        assert [topic.name for topic in bag.topics] == ["/left/camera_info", "/left/image/compressed"]


def nothing(path: Path) -> Path:
    return path / "nothing"


def empty(path: Path) -> Path:
    (path / "empty").mkdir()
    return path / "empty"


def text(path: Path) -> Path:
    (path / "film.mp4").write_text("hello world")
    return path / "film.mp4"


def uneven(path: Path) -> Path:
    cv2.imwrite(str(folder(path / "images") / "image5.png"), picture(0, 32, 48))
    return path / "images"


def undecodable(path: Path) -> Path:
    (folder(path / "images") / "image7.png").write_bytes(b"hello world")
    return path / "images"


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        (nothing, "no such video, folder or camera"),
        (empty, "no images"),
        (text, "cannot be opened as a video"),
        (uneven, r"image5.png: the image has 32x48 pixels, but image0.png has 64x48"),
        (undecodable, r"image7.png: cannot be decoded"),
    ],
)
def test_sources_that_cannot_be_read_leave_no_bag(
    tmp_path: Path, source: Callable[[Path], Path], complaint: str
) -> None:
    with pytest.raises(BagError, match=complaint) as caught:
        import_bag(source(tmp_path), tmp_path / "bag")
    assert caught.value.remedy
    assert not (tmp_path / "bag").exists()


def test_existing_bag_is_left_alone(tmp_path: Path) -> None:
    import_bag(folder(tmp_path / "images"), tmp_path / "bag")
    with pytest.raises(BagError, match="already exists"):
        import_bag(empty(tmp_path), tmp_path / "bag")
    assert len(images_of(tmp_path / "bag")) == 12


@pytest.mark.parametrize(
    "options", [{"rate_hz": 0.0}, {"hfov_deg": 180.0}, {"jpeg_quality": 0}, {"width": 0}, {"limit_s": -1.0}]
)
def test_options_out_of_range(tmp_path: Path, options: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=next(iter(options))):
        import_bag(tmp_path, tmp_path / "bag", **options)  # type: ignore[arg-type]


TYPES = RosbagsTypes()


class Private(Structured, frozen=True, kw_only=True):
    """A message of somebody else."""

    load: str


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    person = PersonDetection(x=1.5, y=2.0, w=3.0, h=4.0, score=0.1, track_id="t1", distance_m=2.25)
    said = Utterance(stamp=40, id="u1", text="Grüß Gott")
    with BagWriter(tmp_path / "recorded") as writer:
        writer.write(
            "/camera", CompressedImage(stamp=1, frame_id="c", format="jpeg", data=np.arange(9, dtype=np.uint8)), 5
        )
        writer.write("/detections", PersonDetections(stamp=1, frame_id="c", width=64, height=48, persons=(person,)), 10)
        record = TraceRecord(stamp=30, id="a-1", source="waldo", kind="did", what="x", detail={"n": [1, 2.5, "é"]})
        writer.write("/waldo/trace", record, 20)
        writer.write("/waldo/trace", TraceRecord(stamp=3, id="a-2", source="waldo", kind="did", what="early"), 30)
        writer.write("/waldo/mind", Mind(stamp=35, agent="waldo", beliefs=(), desires=("d",), intentions=()), 35)
        writer.write("/speech/say", said, 40)
        plain = TYPES.serialize(TYPES.make(codec.STRING, data="Good morning"))
        writer.write_raw("/speech/say", codec.STRING, plain, 50)
        writer.write("/private", Private(stamp=1, load="crate"), 60)
        writer.write_raw(
            "/other", "somebody_msgs/msg/Own", b"\0\1\0\0\7\0\0\0", 70, type_hash="RIHS01_7", definition="uint32 n\n"
        )
    return tmp_path / "recorded"


def contents(path: Path) -> list[tuple[str, int, str, bytes]]:
    with open_bag(path) as bag:
        return list(bag.raw_messages({topic.name: topic.name for topic in bag.topics}))


def said_in(path: Path) -> list[object]:
    with open_bag(path) as bag:
        known = {topic.name: topic.name for topic in bag.topics if topic.name not in ("/other", "/camera", "/private")}
        return list(bag.messages(known))


def test_there_and_back_every_byte_is_the_same(recorded: Path, tmp_path: Path) -> None:
    there = convert_bag(recorded, tmp_path / "typed", "typed")
    assert (there.messages, there.converted) == (9, 5)
    assert {topic: kept.first for topic, kept in there.kept.items()} == {
        "/speech/say": "plain text",
        "/private": there.kept["/private"].first,
    }
    back = convert_bag(tmp_path / "typed", tmp_path / "back", "json")
    assert back.converted == 5
    assert contents(tmp_path / "back") == contents(recorded)
    for path in (tmp_path / "typed", tmp_path / "back"):
        with open_bag(path) as bag:
            assert bag.is_latched("/waldo/mind")
            assert not bag.is_latched("/speech/say")
            assert bag.definition("somebody_msgs/msg/Own") == ("uint32 n\n", "RIHS01_7")


def test_typed_bag_has_equal_messages(recorded: Path, tmp_path: Path) -> None:
    convert_bag(recorded, tmp_path / "typed", "typed", storage="sqlite3")
    assert said_in(tmp_path / "typed") == said_in(recorded)
    types = {topic: name for topic, _, name, _ in contents(tmp_path / "typed")}
    assert types["/waldo/trace"] == "socialbot_msgs/msg/TraceRecord"
    assert types["/private"] == codec.STRING


def test_messages_in_the_requested_form_are_copied(recorded: Path, tmp_path: Path) -> None:
    made = convert_bag(recorded, tmp_path / "again", "json")
    assert made.converted == 0
    assert contents(tmp_path / "again") == contents(recorded)


def test_graph_of_a_bag_is_copied(recorded: Path, tmp_path: Path) -> None:
    (recorded / "graph.yaml").write_text("name: g\n")
    convert_bag(recorded, tmp_path / "typed", "typed")
    names = {file.name for file in (tmp_path / "typed").iterdir()}
    assert names == {"graph.yaml", "metadata.yaml", "typed.mcap"}
    assert (tmp_path / "typed" / "graph.yaml").read_text() == "name: g\n"


def test_no_bag_is_written_over(recorded: Path) -> None:
    with pytest.raises(BagError, match="already exists"):
        convert_bag(recorded, recorded, "typed")


def test_command_reports_the_conversion(recorded: Path, tmp_path: Path) -> None:
    answer = CliRunner().invoke(commands, ["convert", str(recorded), str(tmp_path / "t"), "--wire", "typed"])
    assert answer.exit_code == 0, answer.output
    assert "as before: /speech/say: 1, first: plain text" in answer.output
    assert "5 of them now typed" in " ".join(answer.output.split())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_conversion_that_cannot_be_written_leaves_no_bag(recorded: Path, tmp_path: Path, storage: str) -> None:
    with limited(resource.RLIMIT_FSIZE, 20), pytest.raises(BagError, match="cannot be written"):
        convert_bag(recorded, tmp_path / "out", "typed", storage=storage)
    assert not (tmp_path / "out").exists()


def test_a_file_of_a_bag_that_cannot_be_copied_leaves_no_bag(recorded: Path, tmp_path: Path) -> None:
    (recorded / "graph.yaml").write_bytes(bytes(40_000))
    with limited(resource.RLIMIT_FSIZE, 30_000), pytest.raises(BagError, match=r"graph\.yaml: cannot be written"):
        convert_bag(recorded, tmp_path / "out", "typed")
    assert not (tmp_path / "out").exists()


def test_an_import_that_cannot_be_written_leaves_no_bag(tmp_path: Path) -> None:
    images = folder(tmp_path / "images")
    with limited(resource.RLIMIT_FSIZE, 20), pytest.raises(BagError, match="cannot be written"):
        import_bag(images, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_that_cannot_be_begun_leaves_no_folder(tmp_path: Path, storage: str) -> None:
    """Such as on a disk without room for another file."""
    lowest = os.dup(0)
    os.close(lowest)
    with limited(resource.RLIMIT_NOFILE, lowest), pytest.raises(BagError, match="cannot be written"):
        BagWriter(tmp_path / "out", storage=storage).__enter__()
    assert not (tmp_path / "out").exists()


FOXGLOVE = {
    FOXGLOVE_IMAGE: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    FOXGLOVE_RAW_IMAGE: "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\n"
    "string encoding\nuint32 step\nuint8[] data\n",
}


def foxglove_bag(path: Path, topic: str, kind: str, fields: dict[str, object], text: str = "") -> Path:
    """Write a bag with three messages of ``kind`` on ``topic``, one a second."""
    types = get_typestore(Stores.ROS2_JAZZY)
    types.register(get_types_from_msg(text or FOXGLOVE[kind], kind))
    with BagWriter(path) as writer:
        for second in range(3):
            at = types.types["builtin_interfaces/msg/Time"](sec=second + 1, nanosec=7)
            message = types.types[kind](**{"timestamp": at, "frame_id": "optical", **fields})
            data = bytes(types.serialize_cdr(message, kind))
            writer.write_raw(topic, kind, data, (second + 1) * SECOND, definition=text or FOXGLOVE[kind])
    return path


@pytest.mark.parametrize("kind", FOXGLOVE)
def test_images_of_foxglove_become_those_of_ros(tmp_path: Path, kind: str) -> None:
    rows = np.zeros((48, 208), np.uint8)  # a padded row
    rows[:, : 64 * 3] = picture(90).reshape(48, 192)
    fields = {"width": 64, "height": 48, "encoding": "rgb8", "step": 208, "data": rows.reshape(-1)}
    if kind == FOXGLOVE_IMAGE:
        fields = {"format": "png", "data": cv2.imencode(".png", picture(90))[1].reshape(-1)}
    bag = foxglove_bag(tmp_path / "bag", "/camera", kind, fields)
    with open_bag(bag) as opened, pytest.raises(BagError, match="the bag has no images") as refused:
        opened.choose_image_topic()
    assert f"socialbot bag convert {bag} NEW --decode" in str(refused.value)
    done = CliRunner().invoke(commands, ["convert", str(bag), str(tmp_path / "new"), "--decode"])
    assert done.exit_code == 0, done.output
    assert "3 of them now images" in done.output
    with open_bag(tmp_path / "new") as opened:
        found = [message for _, message in opened.messages({opened.choose_image_topic().name: "/image"})]
    assert [message.stamp for message in found] == [second * SECOND + 7 for second in (1, 2, 3)]
    for message in found:
        assert isinstance(message, Image | CompressedImage)
        assert message.frame_id == "optical"
        pixels = bgr_from_image(message) if isinstance(message, Image) else bgr_from_compressed(message)
        assert np.array_equal(pixels, picture(90))


def test_images_of_foxglove_with_other_fields_are_refused(tmp_path: Path) -> None:
    text = "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\n"
    bag = foxglove_bag(tmp_path / "bag", "/camera", FOXGLOVE_IMAGE, {"data": np.zeros(9, np.uint8)}, text)
    with pytest.raises(BagError, match=r"CompressedImage has other fields .*format"):
        convert_bag(bag, tmp_path / "new", None, decode=True)
    assert not (tmp_path / "new").exists()
