from __future__ import annotations

import numpy as np
import pytest

from socialbot.core.errors import ParameterError
from socialbot.vision.detectors import PIXELS, NetworkDetector, _gain
from socialbot.vision.network import LAYOUTS, ModelOutput, OnnxModel, OutputLayout, fitting, whole
from tests.vision.networks import constant_network, echo_network, yolov8_rows

CANVAS = (320, 240)
IMAGE = np.zeros((480, 640, 3), np.uint8)


def all_of_it(width: int, height: int, horizon: float):
    return [whole(width, height, CANVAS)]


def detector(*people, views=all_of_it, **changes) -> NetworkDetector:
    network = OnnxModel(constant_network({"out": yolov8_rows(*people)}))
    return NetworkDetector(network, LAYOUTS["yolov8"], views, **{"threshold": 0.3, **changes})


def test_boxes_are_in_pixels_of_the_image_best_first():
    found = detector((10, 20, 30, 60, 0.5), (100, 20, 30, 60, 0.75)).detect(IMAGE)
    np.testing.assert_allclose(found.boxes, [[200, 40, 60, 120], [20, 40, 60, 120]])
    np.testing.assert_allclose(found.scores, [0.75, 0.5])
    assert found.boxes.dtype == found.scores.dtype == np.float64


def test_image_without_people():
    found = detector().detect(IMAGE)
    assert found.boxes.shape == (0, 4)
    assert len(found) == 0


def test_of_two_boxes_round_one_person_the_better_stays():
    people = [(10, 20, 30, 60, 0.5), (11, 21, 30, 60, 0.9), (20, 20, 30, 60, 0.4)]
    assert len(detector(*people).detect(IMAGE)) == 2
    assert len(detector(*people, overlap=0.3).detect(IMAGE)) == 1


def test_boxes_of_a_threshold_are_those_of_a_lower_one_that_reach_it():
    random = np.random.default_rng(3)
    corners, sizes = random.uniform(0, 200, (60, 2)), random.uniform(20, 90, (60, 2))
    people = np.hstack([corners, sizes, random.uniform(0.05, 1, (60, 1))])
    finder = detector(*people.tolist(), threshold=0.05)
    all_of_them = finder.detect(IMAGE)
    finder.threshold = 0.5
    sure = finder.detect(IMAGE)
    assert 0 < len(sure) < len(all_of_them)
    np.testing.assert_array_equal(sure.boxes, all_of_them.boxes[all_of_them.scores >= 0.5])


def test_boxes_are_clipped_to_the_image():
    found = detector((-20, 100, 60, 200, 0.9)).detect(IMAGE)
    np.testing.assert_allclose(found.boxes, [[0, 200, 80, 280]])


def test_views_are_merged_without_cut_off_boxes():
    def views(width: int, height: int, horizon: float):
        top = round(height * horizon)
        return [whole(width, height, (320, 224)), fitting((0, top, width, 160), 640 * 160)]

    # On the canvas of the band, whose pixels are the picture's, the first touches its lower edge.
    finder = detector((50, 60, 40, 99, 0.8), (300, 20, 40, 100, 0.9), views=views)
    finder.horizon = 0.25
    found = finder.detect(IMAGE)
    band = found.boxes[found.boxes[:, 3] == 100]
    assert band.tolist() == [[300, 140, 40, 100]]
    assert len(found) == 3


@pytest.mark.parametrize(
    ("channels", "pixels", "expected"),
    [
        ("bgr", "0-255", (51, 102, 255)),
        ("rgb", "0-255", (255, 102, 51)),
        ("rgb", "0-1", (1.0, 0.4, 0.2)),
        ("bgr", "imagenet", ((51 - 103.53) / 57.375, (102 - 116.28) / 57.12, (255 - 123.675) / 58.395)),
        ("rgb", "imagenet", ((255 - 123.675) / 58.395, (102 - 116.28) / 57.12, (51 - 103.53) / 57.375)),
    ],
)
def test_network_gets_its_image_as_it_wants_it(channels, pixels, expected):
    seen = []

    def read(answers: ModelOutput):
        seen.append(answers.arrays[0])
        return np.empty((0, 4)), np.empty(0)

    layout = OutputLayout("echo", read, "bgr", "0-255", True, 0)
    finder = NetworkDetector(
        OnnxModel(echo_network()), layout, all_of_it, threshold=0.5, channels=channels, pixels=pixels
    )
    finder.detect(np.full((480, 640, 3), (51, 102, 255), np.uint8))
    assert seen[-1].shape == (1, 3, *CANVAS[::-1])
    np.testing.assert_allclose(seen[-1][0, :, 100, 100], expected, rtol=1e-5)


def test_usual_pixels_and_channels_are_those_of_the_layout():
    assert {layout.pixels for layout in LAYOUTS.values()} <= set(PIXELS)
    with pytest.raises(ParameterError, match="channels: 'grey' is not one of bgr, rgb"):
        detector(channels="grey")
    with pytest.raises(ParameterError, match="pixels: '0-100' is not one of 0-255, 0-1, imagenet"):
        detector(pixels="0-100")


def test_error_names_actual_and_expected_layout():
    network = OnnxModel(constant_network({"out": yolov8_rows()}), where="my.onnx")
    with pytest.raises(ParameterError) as error:
        NetworkDetector(network, LAYOUTS["yolox"], all_of_it, threshold=0.5)
    assert str(error.value).startswith(
        "my.onnx: the model answers out 1 x 84 x 200 float32; layout yolox expects one output"
    )
    assert "remedy: choose the layout it was exported in (nanodet, nanodet-plus, yolox" in str(error.value)


@pytest.mark.parametrize(("value", "expected"), [(200, 200), (140, 140), (70, 140), (28, 140), (10, 80), (0, 0)])
def test_dark_image_is_made_brighter(value, expected):
    seen = []

    def read(answers: ModelOutput):
        seen.append(answers.arrays[0])
        return np.empty((0, 4)), np.empty(0)

    layout = OutputLayout("echo", read, "bgr", "0-255", True, 0)
    finder = NetworkDetector(OnnxModel(echo_network()), layout, all_of_it, threshold=0.5)
    finder.detect(np.full((480, 640, 3), value, np.uint8))
    np.testing.assert_allclose(seen[-1], expected, atol=0.01)


def test_dark_image_with_lamps_stays_as_it_is():
    image = np.full((480, 640, 3), 20, np.uint8)
    image[:, :64] = 250
    assert _gain(image) == 1.0


def test_answers_of_another_layout_with_the_same_shape_are_known_by_their_scores():
    with pytest.raises(ParameterError, match=r"layout yolov8 expects scores from 0 to 1, not 3\.5"):
        detector((10, 20, 30, 60, 3.5))
