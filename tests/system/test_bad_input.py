"""Bad input gives one clear message with a remedy and an exit code, or is counted and skipped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import cv2
import msgspec
import numpy as np
import pytest

from socialbot.bags.reader import BagWriter
from socialbot.core.messages import CompressedImage, Image, Message, Utterance
from tests.system.nodes import detector_graph
from tests.system.running import results, socialbot, socialbot_here

START = 1_700_000_000_000_000_000
PERIOD = 100_000_000


def jpeg(stamp: int) -> CompressedImage:
    data = cv2.imencode(".jpg", np.full((240, 320, 3), 90, np.uint8))[1].reshape(-1)
    return CompressedImage(stamp=stamp, frame_id="camera", format="jpeg", data=data)


def raw(stamp: int, encoding: str = "mono8", size: int = 32 * 24) -> Image:
    return Image(
        stamp=stamp, frame_id="camera", height=24, width=32, encoding=encoding, step=32, data=np.zeros(size, np.uint8)
    )


def bag_of(path: Path, topics: dict[str, list[Callable[[int], Message]]]) -> Path:
    with BagWriter(path) as bag:
        for topic, makers in topics.items():
            for number, make in enumerate(makers):
                stamp = START + number * PERIOD
                bag.write(topic, make(stamp), stamp)
    return path


def refuse(*arguments: object, code: int, by: Callable[..., CompletedProcess[str]] = socialbot_here) -> str:
    """Run a command that must fail with exit ``code`` and no traceback; return its standard error."""
    done = by(*arguments)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "\nerror" in "\n" + done.stderr
    return done.stderr


def replay_inline(bag: Path, tmp_path: Path, *more: object) -> tuple[object, ...]:
    return ("replay", bag, "--runner", "inline", "--out", tmp_path / "run", "--no-video", *more)


def test_a_missing_bag_is_an_error(tmp_path: Path) -> None:
    text = refuse(*replay_inline(tmp_path / "nothing", tmp_path), code=3, by=socialbot)
    assert "nothing" in text
    assert "remedy" in text


def test_a_file_without_a_bag_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "notes.mcap"
    file.write_text("not a bag")
    assert "notes.mcap" in refuse(*replay_inline(file, tmp_path), code=3)


def test_an_error_lists_the_topics_of_a_bag_without_images(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "talk", {"/speech/say": [lambda stamp: Utterance(stamp=stamp, id="1", text="hello")]})
    assert "/speech/say" in refuse(*replay_inline(bag, tmp_path), code=3)


def test_several_image_topics_need_an_option(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "two", {"/left/image_raw": [raw] * 3, "/right/image_raw": [raw] * 3})
    text = refuse(*replay_inline(bag, tmp_path), code=3)
    assert "/left/image_raw" in text
    assert "/right/image_raw" in text
    done = socialbot_here(*replay_inline(bag, tmp_path, "--image-topic", "/right/image_raw"))
    assert done.returncode == 0, done.stderr
    assert results(tmp_path / "run")["frames"] == 3


def test_suggests_the_name_of_an_image_topic(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "one", {"/camera/image_raw": [raw] * 3})
    text = refuse(*replay_inline(bag, tmp_path, "--image-topic", "/camera/image_row"), code=3)
    assert "did you mean '/camera/image_raw'" in text


def test_replays_the_readable_part_of_a_truncated_bag(corridor: Path, tmp_path: Path) -> None:
    bag = tmp_path / "cut.mcap"
    source = next(corridor.glob("*.mcap"))
    bag.write_bytes(source.read_bytes()[: source.stat().st_size // 8])
    done = socialbot(*replay_inline(bag, tmp_path, "--graph", detector_graph("Detector", tmp_path)))
    assert done.returncode == 0, done.stderr
    assert "truncated" in done.stdout + done.stderr
    found = results(tmp_path / "run")
    assert 0 < found["frames"] < 60
    assert found["bag"]["damage"]


def empty(stamp: int) -> CompressedImage:
    return CompressedImage(stamp=stamp, frame_id="camera", format="jpeg", data=np.zeros(0, np.uint8))


def damaged(stamp: int) -> CompressedImage:
    return msgspec.structs.replace(jpeg(stamp), data=jpeg(stamp).data[:200])


@pytest.mark.parametrize(
    ("topic", "bad", "words"),
    [
        ("/camera/image_raw/compressed", empty, "0 bytes|empty|no data"),
        ("/camera/image_raw/compressed", damaged, "JPEG|jpeg"),
        pytest.param(
            "/camera/image_raw", lambda stamp: raw(stamp, encoding="yuv999"), "yuv999", marks=pytest.mark.slow
        ),
        ("/camera/image_raw", lambda stamp: raw(stamp, size=100), "768 bytes are needed"),
    ],
    ids=["zero length", "damaged jpeg", "unknown encoding", "wrong size"],
)
def test_counts_and_skips_invalid_images(tmp_path: Path, topic: str, bad: Callable[[int], Message], words: str) -> None:
    good: Callable[[int], Message] = jpeg if topic.endswith("compressed") else raw
    bag = bag_of(tmp_path / "bag", {topic: [good, bad, good, bad, good]})
    done = socialbot_here(*replay_inline(bag, tmp_path))
    assert done.returncode == 0, done.stderr
    found = results(tmp_path / "run")
    assert found["frames"] == 3
    node = found["nodes"]["image_converter"]
    assert node["failures"] == 2
    assert any(word in node["first_failure"] for word in words.split("|"))
    assert "image_converter: failed 2 of 5 times" in done.stdout


def test_only_invalid_images_are_an_error(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", {"/camera/image_raw": [lambda stamp: raw(stamp, encoding="yuv999")] * 3})
    text = refuse(*replay_inline(bag, tmp_path), code=6)
    assert "yuv999" in text
    assert results(tmp_path / "run")["frames"] == 0


WALDO = "name: g\ninputs: [/camera/image_raw, /camera/image_raw/compressed]\nnodes:\n"


@pytest.mark.parametrize(
    ("page", "words"),
    [
        (WALDO + "  a: {type: image_convertor}\n", ["graph.yaml:4", "image_convertor", "'image_converter'"]),
        (WALDO + "  a: {type: image_converter, parameters: {size: 3}}\n", ["a", "no parameter 'size'"]),
        (WALDO + "  a: {type: image_converter, remap: {picture: /x}}\n", ["a", "no input or output 'picture'"]),
        (WALDO + "  a: {type: person_detector}\n", ["nobody publishes", "/camera/image_color"]),
        (WALDO + "  a: {type: image_converter, colour: red}\n", ["graph.yaml:4", "unknown key 'colour'"]),
        (WALDO + "  a: {type: person_detector, parameters: {threshold: high}}\n", ["threshold", "not of type float"]),
        (WALDO + "  a: {type: image_converter, remap: {image_color: /camera/image_raw/compressed}}\n", ["remap"]),
        ("name: [\n", ["graph.yaml:"]),
    ],
)
def test_a_bad_graph_is_one_error_with_file_and_line(
    page: str, words: list[str], corridor: Path, tmp_path: Path
) -> None:
    graph = tmp_path / "graph.yaml"
    graph.write_text(page)
    text = refuse(*replay_inline(corridor, tmp_path, "--graph", graph), code=4)
    assert all(word in text for word in words), text


def test_bad_parameters_on_the_command_line(corridor: Path, tmp_path: Path) -> None:
    def attempt(change: str) -> str:
        return refuse(*replay_inline(corridor, tmp_path, "--set", change), code=4)

    assert "out of range" in attempt("bdi_engine.help_after_s=0.1")
    assert "did you mean 'help_after_s'" in attempt("bdi_engine.help_after=3")
    assert "no node 'engine'" in attempt("engine.help_after_s=3")
    assert "not of type float" in attempt("bdi_engine.help_after_s=soon")
    assert "NODE.PARAMETER=VALUE" in attempt("help_after_s")


def test_never_overwrites_a_run(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", {"/camera/image_raw": [raw] * 3})
    assert socialbot_here(*replay_inline(bag, tmp_path)).returncode == 0
    before = (tmp_path / "run" / "trace.jsonl").read_bytes()
    assert "--out" in refuse(*replay_inline(bag, tmp_path), code=4)
    assert (tmp_path / "run" / "trace.jsonl").read_bytes() == before


def test_an_invalid_truth_is_an_error(corridor: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    truth.write_text('{"schema": "socialbot/truth", "version": 7, "image_topic": "/camera/image_raw", "frames": []}')
    text = refuse(*replay_inline(corridor, tmp_path, "--truth", truth), code=3)
    assert "truth.json" in text
    assert "version" in text


@pytest.mark.ros
def test_a_missing_camera_is_an_error(tmp_path: Path) -> None:
    graph = tmp_path / "graph.yaml"
    graph.write_text("name: eye\nnodes:\n  camera: {type: camera}\n")
    missing = tmp_path / "no-such-video.mp4"
    text = refuse("up", graph, "--camera", missing, "--out", tmp_path / "run", code=7, by=socialbot)
    assert "no-such-video.mp4" in text
