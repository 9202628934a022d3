from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from socialbot.bags.codec import encode
from socialbot.bags.reader import BagWriter, RosbagsTypes, open_bag
from socialbot.bridge.transport import RclpyTypes, message_class
from socialbot.cli.bag import bag as app
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, ParameterError
from socialbot.core.messages import CameraInfo, CompressedImage, Image, Utterance
from tests.bags.making_bags import contents
from tests.system.running import eventually
from tests.vision.drawn import add_person, corridor
from tests.vision.metrics.scenes import TOP
from tests.vision.test_camera import CALIBRATION

START = 1_700_000_000 * SECOND


def run(*arguments: str) -> str:
    result = CliRunner(env={"COLUMNS": "80", "LINES": None}).invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def make(path: Path) -> Path:
    image = Image.from_bgr(np.zeros((6, 8, 3), np.uint8), stamp=1, frame_id="c")
    jpeg = np.frombuffer(b"\xff\xd8 no picture", np.uint8)
    with BagWriter(path) as bag:
        for index in range(11):
            bag.write("/camera/image_raw", image, START + index * SECOND // 5)
        bag.write("/other/image/compressed", CompressedImage(stamp=1, frame_id="c", format="jpeg", data=jpeg), START)
        bag.write_raw("/speech/say", "std_msgs/msg/String", b"", START)
        bag.write_raw("/speech/say", "std_msgs/msg/String", b"", START)
        bag.write_raw("/odd", "nobody_msgs/msg/Thing", b"\0\1\0\0abcd", START)
    return path


def test_info_shows_topics(tmp_path: Path) -> None:
    output = run("info", str(make(tmp_path / "walk")))
    lines = {line.split()[0]: line.split()[1:] for line in output.splitlines()}
    assert output.startswith("walk  2.0 s, 15 messages, from 2023-11-14 22:13:20 UTC")
    assert lines["/camera/image_raw"] == ["Image", "11", "5.0", "0", "8x6", "bgr8"]
    assert lines["/other/image/compressed"] == ["CompressedImage", "1", "0", "unreadable", "jpeg"]
    assert lines["/speech/say"][:4] == ["String", "2", "0.5", "2"]
    assert lines["/odd"][:3] == ["nobody_msgs/Thing", "1", "0"]
    assert "/speech/say: 2 damaged, first: ValueError: 0 bytes" in output
    assert max(map(len, output.splitlines())) <= 80


def test_quick_info_skips_the_damage_check(tmp_path: Path) -> None:
    output = run("info", "--quick", str(make(tmp_path / "walk")))
    assert "damaged" not in output
    assert "8x6 bgr8" in output


def test_info_of_a_truncated_bag(tmp_path: Path) -> None:
    path = make(tmp_path / "walk") / "walk.mcap"
    path.write_bytes(path.read_bytes()[:-50])
    output = run("info", str(path)).replace("\n", "")
    assert "incomplete" in output
    assert "truncated; the first" in output


def test_info_of_a_missing_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no such file"):
        run("info", str(tmp_path / "nothing"))


def test_import_makes_a_bag(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for index in range(3):
        cv2.imwrite(str(tmp_path / "images" / f"{index}.png"), np.zeros((48, 64, 3), np.uint8))
    output = run(
        "import", str(tmp_path / "images"), str(tmp_path / "bag"), "--image-rate", "5", "--start", "3", "--width", "32"
    )
    assert "3 images of 32x24, 0.4 s" in output
    with open_bag(tmp_path / "bag") as bag:
        assert (bag.start, bag.duration_s) == (3 * SECOND, 0.4)


def test_import_of_one_image(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((48, 64, 3), np.uint8))
    assert "1 image of 64x48" in run("import", str(tmp_path / "images"), str(tmp_path / "bag"))


@pytest.mark.parametrize(
    ("size", "options", "told"), [((96, 48), (), 1), ((96, 48), ("--hfov", "90"), 0), ((64, 48), (), 0)]
)
def test_import_warns_of_pictures_of_all_directions(
    tmp_path: Path, size: tuple[int, int], options: tuple[str, ...], told: int
) -> None:
    """An imported bag has a CameraInfo, so the person detector would not tell that its lens is a guess."""
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((*size[::-1], 3), np.uint8))
    output = run("import", str(tmp_path / "images"), str(tmp_path / "bag"), *options)
    assert output.count("may be a panorama or pictures side by side") == told


def test_import_takes_the_intrinsics_of_a_calibration(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((48, 64, 3), np.uint8))
    (tmp_path / "ost.yaml").write_text(CALIBRATION)
    options = ("import", str(tmp_path / "images"), str(tmp_path / "bag"), "--camera-info", str(tmp_path / "ost.yaml"))
    with pytest.raises(ParameterError, match="without effect with --camera-info"):
        run(*options, "--hfov", "60")
    assert "scaled" not in run(*options)
    (info,) = [message for _, message in contents(tmp_path / "bag", "/camera/camera_info")]
    assert isinstance(info, CameraInfo)
    assert (info.width, info.k[0], info.d[:2]) == (64, 60.5, (0.1, -0.25))


# Recording


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, other_domain: int) -> int:
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(other_domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return other_domain


@contextmanager
def robot() -> Iterator[Any]:
    """A node that publishes from this process."""
    from socialbot.bridge.environment import spinning_node

    with spinning_node("robot") as node:
        yield node


def publisher(node: Any, topic: str, message: Any, *, best_effort: bool = False, latched: bool = False) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    qos = QoSProfile(
        depth=10,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    return node.create_publisher(type(message), topic, qos)


NOW = time.time_ns()
IMAGE = Image.from_bgr(np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3), stamp=NOW, frame_id="c")
INFO = CameraInfo(stamp=NOW, frame_id="c", width=8, height=6, k=(1.0,) * 9)
SAY = Utterance(stamp=START + 7, id="u", text="hello")


@pytest.mark.ros
def test_records_present_and_later_topics(domain: int, tmp_path: Path) -> None:
    from socialbot.bridge.recorder import record

    ros = RclpyTypes()
    image, info, say = (encode(message, ros) for message in (IMAGE, INFO, SAY))
    done = threading.Event()

    def publish(node: Any) -> None:
        latched = publisher(node, "/camera/camera_info", info, latched=True)
        latched.publish(info)
        pictures = publisher(node, "/camera/image_raw", image, best_effort=True)
        await_listener(pictures)
        # A best-effort message is lost if the recorder does not know the publisher yet, so more than one is sent.
        eventually(lambda: pictures.publish(image) or messages_on_disk(tmp_path / "bag", "/camera/image_raw"))
        sentences = publisher(node, "/speech/say", say)
        hidden = publisher(node, "/_hidden", say)
        await_listener(sentences)
        await_listener(latched)
        hidden.publish(say)
        for _ in range(3):
            sentences.publish(say)
        eventually(lambda: messages_on_disk(tmp_path / "bag", "/speech/say") == 3)
        done.set()

    with robot() as node:
        thread = threading.Thread(target=publish, args=(node,), daemon=True)
        thread.start()
        made = record(tmp_path / "bag", duration_s=60.0, stopped=done.is_set)
        thread.join()
    images = made.counts["/camera/image_raw"]
    assert images >= 1
    assert made.counts == {"/camera/camera_info": 1, "/camera/image_raw": images, "/speech/say": 3}
    with open_bag(tmp_path / "bag") as bag:
        found = dict(bag.messages({topic.name: topic.name for topic in bag.topics}))
        assert not bag.skipped
    picture = found["/camera/image_raw"]
    assert isinstance(picture, Image)
    assert np.array_equal(picture.bgr(), IMAGE.bgr())
    assert (found["/camera/camera_info"], found["/speech/say"]) == (INFO, SAY)
    assert "transient_local" in (tmp_path / "bag" / "metadata.yaml").read_text()


def await_listener(sender: Any) -> None:
    assert eventually(lambda: sender.get_subscription_count() > 0)


@pytest.mark.ros
def test_refuses_to_overwrite_a_bag(domain: int, tmp_path: Path) -> None:
    from socialbot.bridge.recorder import record

    with pytest.raises(BagError, match="already exists"):
        record(make(tmp_path / "bag"), duration_s=0.1)


@pytest.mark.ros
@pytest.mark.parametrize("end", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow), None])
def test_record_ends_with_a_readable_bag(domain: int, tmp_path: Path, end: signal.Signals | None) -> None:
    say = encode(SAY, RclpyTypes())
    out = tmp_path / "bag"
    program = "from socialbot.cli.bag import bag; bag()"
    options = ["--topics", "/speech/say", "--topics", "missing"] + ([] if end else ["--duration", "5"])
    command = [sys.executable, "-c", program, "record", str(out), *options]
    with robot() as node:
        sentences, others = publisher(node, "/speech/say", say), publisher(node, "/other", say)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            await_listener(sentences)
            for _ in range(3):
                sentences.publish(say)
            assert not others.get_subscription_count()
            if end:
                assert eventually(lambda: messages_on_disk(out) == 3)
                process.send_signal(end)
            output = process.communicate(timeout=180)[0].decode()
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 0, output
    assert "3  /speech/say" in output
    assert "no messages on /missing" in output
    assert "Traceback" not in output
    with open_bag(out) as bag:
        assert [message for _, message in bag.messages({"/speech/say": "/say"})] == [SAY] * 3


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("privacy", ["blur", "no-images"])
def test_a_private_recording_leaves_no_recognisable_pictures(domain: int, tmp_path: Path, privacy: str) -> None:
    pixels = corridor(seed=1)
    x, y, w, _ = (round(each) for each in add_person(pixels, 300, TOP, 220))
    image = Image.from_bgr(pixels, stamp=time.time_ns(), frame_id="c")
    out, original = tmp_path / "bag", tmp_path / "bag.original"
    program = "from socialbot.cli.bag import bag; bag()"
    options = ["--topics", "/camera/image_raw", "--privacy", privacy]
    command = [sys.executable, "-c", program, "record", str(out), *options]
    with robot() as node:
        made = encode(image, RclpyTypes())
        images = publisher(node, "/camera/image_raw", made)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            await_listener(images)
            images.publish(made)
            assert eventually(lambda: messages_on_disk(original) == 1)
            process.send_signal(signal.SIGINT)
            output = process.communicate(timeout=180)[0].decode()
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 0, output
    assert not original.exists()
    with open_bag(out) as bag:
        [(_, kept)] = bag.messages({"/camera/image_raw": "/camera/image_raw"})
    assert isinstance(kept, Image)
    if privacy == "no-images":
        assert not kept.data.size
    else:
        changed = (kept.data.reshape(480, 640, 3) != pixels).any(axis=2)
        assert changed[y + 5 : y + 25, x + w // 3 : x + w * 2 // 3].mean() > 0.9
        assert not changed[:, x + 3 * w :].any()


def messages_on_disk(path: Path, name: str = "") -> int:
    """Number of messages in the flushed part of a bag, on the topic ``name`` or all."""
    try:
        with open_bag(path) as bag:
            return sum(topic.count for topic in bag.topics if name in ("", topic.name))
    except BagError:
        return 0


@pytest.mark.ros
def test_recorded_bytes_are_unchanged(domain: int, tmp_path: Path) -> None:
    from rclpy.serialization import serialize_message

    data = serialize_message(encode(IMAGE, RclpyTypes()))
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_raw("/i", "sensor_msgs/msg/Image", data, 1)
    with open_bag(tmp_path / "bag") as bag:
        ((_, _, name, read),) = bag.raw_messages({"/i": "/i"})
    assert read == data
    assert RosbagsTypes().deserialize(read, name).data.tolist() == IMAGE.data.tolist()
    assert message_class(name).__name__ == "Image"
