"""Redacted bags: nobody is recognisable, all else is the same, and replays decide the same."""

from __future__ import annotations

import re
import resource
from pathlib import Path

import cv2
import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.bags.types import RosbagsTypes
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError
from socialbot.core.messages import Image, PointCloud, Utterance
from socialbot.graph.files import load_graph
from socialbot.runtime.bag_source import replay
from socialbot.runtime.perception_cache import SEEN_FILE
from socialbot.runtime.redaction import redact
from socialbot.vision.annotate import blurred, regions_of
from tests.system.running import limited, socialbot_here
from tests.vision.drawn import add_person, corridor
from tests.vision.metrics.scenes import IMAGES, START, TENTH, TOP, drawn_bag
from tests.vision.networks import constant_network, yolov8_rows

BAGS = Path(__file__).parents[2] / "data" / "synthetic"


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    made = drawn_bag(tmp_path_factory.mktemp("bags"), frames=5)
    answers = {"boxes": yolov8_rows((250, 100, 100, 300, 0.9))}
    made.with_name("model.onnx").write_bytes(constant_network(answers, shape=(1, 3, 480, 640)))
    return made


def waldo(bag: Path, **more: object):
    eyes = {"detector": "onnx", "model": str(bag.with_name("model.onnx")), "layout": "yolov8", "faces": False}
    return load_graph("waldo").with_parameters({"person_detector": {**eyes, **more}})


def raw(path: Path, *, pictures: bool) -> list[tuple[str, int, str, bytes]]:
    with open_bag(path) as opened:
        names = [topic.name for topic in opened.topics if (topic.name == IMAGES) == pictures]
        return list(opened.raw_messages({name: name for name in names}))


@pytest.mark.parametrize("privacy", ["blur", "no-images"])
def test_replays_of_a_redacted_bag_decide_the_same(bag, tmp_path, privacy):
    replay(bag, waldo(bag), tmp_path / "before", cache=False)
    made = redact(bag, tmp_path / "out", privacy, graph=waldo(bag))
    assert made.perception == "recorded"
    for name, cache in ("cached", True), ("uncached", False):
        replay(made.path, waldo(bag), tmp_path / name, cache=cache)
        assert (tmp_path / name / "trace.jsonl").read_bytes() == (tmp_path / "before" / "trace.jsonl").read_bytes()
    hasty = waldo(bag).with_parameters({"bdi_engine": {"appear_s": 0.1}})
    replay(made.path, hasty, tmp_path / "hasty")
    assert (tmp_path / "hasty" / "trace.jsonl").read_bytes() != (tmp_path / "before" / "trace.jsonl").read_bytes()
    with pytest.raises(BagError, match="another setting of person_detector"):
        replay(made.path, waldo(bag, threshold=0.3), tmp_path / "other")


def test_all_but_images_is_the_same_to_the_byte(bag, tmp_path):
    redact(bag, tmp_path / "out", "blur", graph=waldo(bag))
    assert raw(bag, pictures=False) == raw(tmp_path / "out", pictures=False) != []
    before, after = raw(bag, pictures=True), raw(tmp_path / "out", pictures=True)
    assert [each[:3] for each in before] == [each[:3] for each in after]
    assert all(one[3] != other[3] for one, other in zip(before, after, strict=True))
    assert (tmp_path / "out.truth.json").read_bytes() == bag.with_name(f"{bag.name}.truth.json").read_bytes()


def test_no_pixel_is_left_without_images(bag, tmp_path):
    made = redact(bag, tmp_path / "out", "no-images", graph=waldo(bag))
    assert made.emptied == {IMAGES: 5}
    types = RosbagsTypes()
    assert all(not types.deserialize(data, kind).data.size for _, _, kind, data in raw(made.path, pictures=True))
    files = b"".join(path.read_bytes() for path in made.path.iterdir())
    assert b"\xff\xd8\xff" not in files
    assert (made.path / SEEN_FILE).exists()


def test_blurred_people_are_as_flat_as_blocks_of_their_colours():
    picture = corridor(seed=3)
    box = np.array([add_person(picture, 300, TOP, 220)], np.float64)
    picture[:] = np.clip(picture + np.random.default_rng(1).normal(0, 20, picture.shape), 0, 255).astype(np.uint8)
    x, y, w, h = regions_of(box, whole=False)[0].astype(int)
    after = blurred(picture, box)
    detail = [cv2.Laplacian(each[y + 2 : y + h - 2, x + 2 : x + w - 2], cv2.CV_64F).var() for each in (picture, after)]
    assert detail[1] < detail[0] / 1000
    outside = np.ones(picture.shape[:2], bool)
    outside[max(0, y - 1) : y + h + 2, max(0, x - 1) : x + w + 2] = False
    assert (picture[outside] == after[outside]).all()
    assert regions_of(box, whole=True)[0, 3] > regions_of(box, whole=False)[0, 3] * 2


def test_wide_boxes_are_blurred_whole():
    upper_body = np.array([[100.0, 50.0, 120.0, 150.0]])
    assert regions_of(upper_body, whole=False)[0, 3] >= 150


@pytest.mark.parametrize(
    "encoding", ["rgb8", *(pytest.param(each, marks=pytest.mark.slow) for each in ("mono8", "bgr8"))]
)
def test_raw_images_are_blurred(tmp_path, encoding):
    with BagWriter(tmp_path / "raw") as writer:
        for number in range(3):
            picture = corridor(seed=number)
            add_person(picture, 300, TOP, 220)
            codes = {"rgb8": cv2.COLOR_BGR2RGB, "mono8": cv2.COLOR_BGR2GRAY}
            pixels = cv2.cvtColor(picture, codes[encoding]) if encoding in codes else picture
            stamp = START + number * TENTH
            image = Image(
                stamp=stamp, frame_id="c", height=480, width=640, encoding=encoding,
                step=640 * (pixels.size // (480 * 640)), data=pixels.reshape(-1),
            )  # fmt: skip
            writer.write("/image", image, stamp)
    hog = load_graph("waldo").with_parameters({"person_detector": {"detector": "hog"}})
    made = redact(tmp_path / "raw", tmp_path / "out", "blur", graph=hog)
    assert made.images == {"/image": 3}
    with open_bag(made.path) as opened:
        [first, *_] = [message for _, message in opened.messages({"/image": "/image"})]
    assert isinstance(first, Image)
    assert (first.encoding, first.data.size) == ("bgr8", 640 * 480 * 3)


def test_images_that_cannot_be_decoded_are_emptied(bag, tmp_path):
    types = RosbagsTypes()
    with BagWriter(tmp_path / "broken") as writer:
        for number, (topic, time, kind, data) in enumerate(raw(bag, pictures=True)):
            message = types.deserialize(data, kind)
            if number == 2:
                message.data = message.data[: len(message.data) // 2]
            writer.write_raw(topic, kind, types.serialize(message), time)
    made = redact(tmp_path / "broken", tmp_path / "out", "blur", graph=waldo(bag))
    assert (made.unreadable, made.emptied, made.images) == ({IMAGES: 1}, {IMAGES: 1}, {IMAGES: 4})


def test_points_and_depth_go_with_the_images(tmp_path):
    cloud = PointCloud(
        stamp=START, frame_id="c", height=1, width=1, fields=(), is_bigendian=False, point_step=4, row_step=4,
        data=np.ones(4, np.uint8),
    )  # fmt: skip
    with BagWriter(tmp_path / "cloud") as writer:
        writer.write("/points", cloud, START)
    made = redact(tmp_path / "cloud", tmp_path / "out", "no-images")
    assert made.emptied == {"/points": 1}
    kept = redact(tmp_path / "cloud", tmp_path / "kept", "blur")
    assert kept.depth == ("/points",)


def test_the_command_says_what_it_did(bag, tmp_path):
    sets = ["--graph", bag.with_name("eyes.yaml")]
    bag.with_name("eyes.yaml").write_text(
        "name: eyes\ninputs: [/camera/image_raw, /camera/image_raw/compressed, /camera/camera_info]\nnodes:\n"
        "  image_converter: {type: image_converter}\n  person_detector:\n    type: person_detector\n"
        f"    parameters: {{detector: onnx, model: {bag.with_name('model.onnx')}, layout: yolov8, faces: false}}\n"
    )
    done = socialbot_here("bag", "redact", bag, tmp_path / "out", "--privacy", "no-images", *sets)
    assert done.returncode == 0, done.stderr
    for part in (f"emptied: 5 messages of {IMAGES}", "seen.percepts", "1 messages are the same"):
        assert part in done.stdout
    again = socialbot_here("bag", "redact", bag, tmp_path / "out", *sets)
    assert (again.returncode, "already exists" in again.stderr) == (3, True)
    shown = socialbot_here("replay", tmp_path / "out", *sets, "--out", tmp_path / "run")
    assert shown.returncode == 0, shown.stderr
    assert not (tmp_path / "run" / "annotated.mp4").exists()
    over_ros = socialbot_here("replay", tmp_path / "out", *sets, "--out", tmp_path / "ros", "--runner", "ros")
    assert "replay it with --runner inline" in over_ros.stderr


def test_a_bag_without_images_can_be_shared_as_it_is(tmp_path):
    with BagWriter(tmp_path / "words") as writer:
        writer.write("/speech/say", Utterance(stamp=SECOND, id="u", text="Hello"), SECOND)
    with pytest.raises(BagError, match="the bag has no images"):
        redact(tmp_path / "words", tmp_path / "out", "blur")


FIELDS = {
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "uint8[] data",
    "foxglove_msgs/msg/CompressedVideo": "uint8[] data",
    "foxglove_msgs/msg/RawImage": "uint8[] data",
    "realsense2_camera_msgs/msg/RGBD": "sensor_msgs/Image rgb\n====\nMSG: sensor_msgs/Image\nuint8[] data",
    "visualization_msgs/msg/Marker": "sensor_msgs/CompressedImage texture",
    "unitree_go/msg/Go2FrontVideoData": "uint8[] video720p",
    "naoqi_bridge_msgs/msg/Bumper": "uint8 bumper  # not in a sensor_msgs/Image",
    "my_msgs/msg/Undefined": "",
}


@pytest.mark.parametrize("privacy", ["blur", "no-images"])
def test_pictures_in_fields_and_video_are_left_out(bag, tmp_path, privacy):
    with open_bag(bag) as opened, BagWriter(tmp_path / "more") as writer:
        for topic, time, name, data in opened.raw_messages({each.name: each.name for each in opened.topics}):
            writer.write_raw(topic, name, data, time)
        for name, definition in FIELDS.items():
            writer.write_raw(f"/{name.split('/')[2]}", name, b"\0\1\0\0" + bytes(8), START, definition=definition)
    made = redact(tmp_path / "more", tmp_path / "out", privacy, graph=waldo(bag))
    assert made.left_out == {"/FFMPEGPacket": 1, "/CompressedVideo": 1, "/RawImage": 1, "/RGBD": 1}
    assert set(made.unknown) == {"/Go2FrontVideoData", "/Undefined"}
    with open_bag(made.path) as opened:
        names = {topic.name for topic in opened.topics}
    assert names.isdisjoint(made.left_out)
    assert names >= {"/Marker", "/Go2FrontVideoData", "/Bumper", "/Undefined"}


def test_a_bag_of_video_alone_is_redacted(tmp_path):
    with BagWriter(tmp_path / "video") as writer:
        writer.write("/speech/say", Utterance(stamp=SECOND, id="u", text="Hello"), SECOND)
        writer.write_raw("/video", "foxglove_msgs/msg/CompressedVideo", bytes(12), SECOND, definition="uint8[] data")
    made = redact(tmp_path / "video", tmp_path / "out", "blur")
    assert (made.left_out, made.kept) == ({"/video": 1}, 1)


@pytest.mark.slow
def test_heads_of_labelled_people_are_blurred():
    from evaluation.privacy import covered

    result = covered(BAGS / "lens_low_tune")
    assert result.heads >= 20
    assert result.share >= 0.99


def pixels_of(video: Path) -> np.ndarray:
    read = cv2.VideoCapture(str(video))
    good, pixels = read.read()
    read.release()
    assert good
    return pixels


@pytest.mark.slow
def test_the_record_of_a_replay_has_blurred_pictures_or_none(bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for mode in ("none", "blur", "no-images"):
        done = socialbot_here("replay", bag, "--privacy", mode, "--out", mode, "--set", "person_detector.detector=hog")
        assert done.returncode == 0, done.stderr
    assert not (tmp_path / "no-images" / "annotated.mp4").exists()
    pages = {mode: (tmp_path / mode / "report.html").read_text() for mode in ("none", "blur", "no-images")}
    pictures = {mode: set(re.findall(r"data:image/jpeg;base64,[^\"' ]+", page)) for mode, page in pages.items()}
    assert pictures["none"]
    assert pictures["blur"]
    assert not pictures["none"] & pictures["blur"]
    assert not pictures["no-images"]
    plain, blurry = (pixels_of(tmp_path / mode / "annotated.mp4") for mode in ("none", "blur"))
    head = np.s_[TOP + 15 : TOP + 45, 222:280]
    assert cv2.Laplacian(blurry[head], cv2.CV_64F).var() < cv2.Laplacian(plain[head], cv2.CV_64F).var()
    traces = [(tmp_path / mode / "trace.jsonl").read_bytes() for mode in ("none", "blur", "no-images")]
    assert traces[0] == traces[1] == traces[2]


def test_a_redaction_that_cannot_be_written_leaves_no_bag(bag, tmp_path):
    (bag / "large.yaml").write_bytes(bytes(10_000_000))
    try:
        with (
            limited(resource.RLIMIT_FSIZE, 9_000_000),
            pytest.raises(BagError, match="out: cannot be written"),
        ):
            redact(bag, tmp_path / "out", "no-images", graph=waldo(bag))
    finally:
        (bag / "large.yaml").unlink()
    assert not (tmp_path / "out").exists()
