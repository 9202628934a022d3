"""The share of Python calls that one frame of Waldo's graph spends on bookkeeping."""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

import socialbot
from socialbot import SECOND, CompressedImage, Image, InlineRunner, load_graph
from socialbot.testing import GraphTester
from socialbot.vision.images import ImageConverter

FOLDER = f"{Path(socialbot.__file__).parent}/"
PICTURE = Path(socialbot.__file__).parents[1] / "data" / "synthetic" / "sample.jpg"
PERIOD = SECOND // 10


def test_health_monitoring_takes_at_most_a_fifth_of_the_calls_of_a_frame():
    data = np.frombuffer(PICTURE.read_bytes(), np.uint8)
    runner = InlineRunner(load_graph("waldo").without_sources())
    runner.start()
    calls: Counter[str] = Counter()

    def count(frame, event, _argument):
        if event == "call" and frame.f_code.co_filename.startswith(FOLDER):
            calls[frame.f_code.co_filename.removeprefix(FOLDER)] += 1

    for number in range(12):
        image = CompressedImage(stamp=number * PERIOD, frame_id="camera", format="jpeg", data=data)
        if number >= 6:
            sys.setprofile(count)
        try:
            runner.feed("/camera/image_raw/compressed", image)
        finally:
            sys.setprofile(None)
    runner.close()
    assert calls["graph/health.py"] <= 0.2 * calls.total()
    assert calls["graph/health.py"] + calls["graph/inline.py"] <= 0.4 * calls.total()


def test_an_image_that_is_bgr8_passes_the_converter_without_a_copy():
    image = Image.from_bgr(np.zeros((4, 6, 3), np.uint8), stamp=SECOND, frame_id="camera")
    with GraphTester(ImageConverter) as tester:
        tester.send("/camera/image_raw", image)
    (converted,) = tester.messages("/camera/image_color")
    assert converted is image
