from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.core.messages import CompressedImage, Image
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.testing import GraphTester
from socialbot.vision.images import ImageConverter

RAW, COMPRESSED, COLOR = "/camera/image_raw", "/camera/image_raw/compressed", "/camera/image_color"


def converted(*messages):
    runner = InlineRunner(
        Graph("g", (NodeConfig("image_converter", ImageConverter),), inputs=frozenset({RAW, COMPRESSED}))
    )
    out: list[Any] = []
    runner.tap(COLOR, lambda _, message: out.append(message))
    runner.start()
    runner.run(messages)
    return out, runner.faults["image_converter"]


def rgb(stamp: int, **changes) -> Image:
    pixels = np.arange(2 * 3 * 3, dtype=np.uint8)
    fields = {"height": 2, "width": 3, "encoding": "rgb8", "step": 9, "data": pixels, **changes}
    return Image(stamp=stamp, frame_id="eye", **fields)


def test_raw_images_become_bgr8_of_the_same_stamp_and_frame():
    (image,), _ = converted((RAW, rgb(7)))
    assert (image.stamp, image.frame_id, image.encoding, image.step) == (7, "eye", "bgr8", 9)
    assert image.bgr()[0, 1].tolist() == [5, 4, 3]


def test_compressed_images_too():
    scene = np.full((8, 10, 3), (10, 100, 200), np.uint8)
    data = cv2.imencode(".png", scene)[1].reshape(-1)
    (image,), _ = converted((COMPRESSED, CompressedImage(stamp=9, frame_id="eye", format="png", data=data)))
    assert (image.stamp, image.frame_id, image.width, image.height) == (9, "eye", 10, 8)
    np.testing.assert_array_equal(image.bgr(), scene)


def packed(stamp: int) -> CompressedImage:
    data = cv2.imencode(".png", np.zeros((2, 3, 3), np.uint8))[1].reshape(-1)
    return CompressedImage(stamp=stamp, frame_id="eye", format="png", data=data)


def test_an_image_that_comes_raw_and_compressed_is_published_once():
    both = [
        message for tenth in range(1, 6) for message in ((RAW, rgb(tenth * 10**8)), (COMPRESSED, packed(tenth * 10**8)))
    ]
    late = [both[0], both[2], both[1], both[4], both[3]]
    for messages, stamps in (
        (both, [1, 2, 3, 4, 5]),
        (late, [1, 2, 3]),
        ([*both, (COMPRESSED, packed(6 * 10**8))], [1, 2, 3, 4, 5, 6]),
    ):
        out, _ = converted(*messages)
        assert [image.stamp // 10**8 for image in out] == stamps


def test_images_of_an_input_count_where_the_other_one_is_damaged_or_has_ended():
    bad = (RAW, rgb(10**9, encoding="unheard_of"))
    out, _ = converted(bad, (COMPRESSED, packed(10**9)))
    assert [image.stamp for image in out] == [10**9]
    out, _ = converted((RAW, rgb(100 * 10**9)), (COMPRESSED, packed(10**9)))
    assert [image.stamp for image in out] == [100 * 10**9, 10**9], "a new recording"


def test_bgr8_passes_without_a_copy():
    source = rgb(1, encoding="bgr8")
    (image,), _ = converted((RAW, source))
    assert np.shares_memory(image.data, source.data)


def test_padded_rows_are_closed_up():
    (image,), _ = converted((RAW, rgb(1, encoding="bgr8", step=10, data=np.arange(20, dtype=np.uint8))))
    assert image.step == 9
    assert image.data.tolist() == [*range(9), *range(10, 19)]


def test_bad_image_is_counted_and_skipped():
    out, faults = converted((RAW, rgb(1, encoding="weird")), (RAW, rgb(2)))
    assert [image.stamp for image in out] == [2]
    assert (faults.failures, faults.calls) == (1, 2)
    assert faults.first.startswith("ImageError: ")
    assert "weird" in faults.first


def noisy(seed: int, mean: float) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(mean, 2.0, (48, 64, 3))
    return np.clip(noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("look", "told"),
    [
        (lambda tenth: noisy(0, 128.0) + np.uint8(60) * (np.arange(64) > 30)[None, :, None], "do not change at all"),
        (lambda tenth: noisy(tenth, 4.0), "are black"),
        (lambda tenth: noisy(tenth, 200.0), "are of one colour"),
    ],
)
def test_images_that_show_nothing_are_told_until_they_show_something(look, told):
    scene = np.random.default_rng(1).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    with GraphTester(ImageConverter) as graph:

        def reasons(images) -> list[str]:
            said = []
            for pixels in images:
                graph.send(RAW, Image.from_bgr(pixels.astype(np.uint8), stamp=graph.clock.now(), frame_id="eye"))
                graph.run(0.1)
                said.append(graph.node().context.health_monitor.health())
            assert {each.state for each in said} == {"ok"}
            return [each.reason for each in said]

        bad = reasons(look(tenth) for tenth in range(120))
        assert not any(bad[:25])
        assert told in bad[-1]
        assert reasons([scene])[-1] == ""


def test_images_whose_time_stands_still_are_told():
    with GraphTester(ImageConverter) as graph:

        def health(stamp: int) -> tuple[str, str]:
            for _ in range(30):
                graph.runner.feed(RAW, rgb(stamp or graph.clock.now()), time=graph.clock.now())
                graph.run(0.1)
            now = graph.node().context.health_monitor.health()
            return now.state, now.reason

        assert health(0)[0] == "ok"
        state, reason = health(7)
        assert (state, "all images have the same stamp" in reason) == ("degraded", True)
        assert health(0)[0] == "ok"
