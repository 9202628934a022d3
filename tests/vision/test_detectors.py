from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from socialbot.core.errors import ParameterError
from socialbot.vision.detector import iou
from socialbot.vision.detectors import DETECTORS, FILE, SHA256, DetectorSettings
from socialbot.vision.network import included_model
from tests.vision.drawn import add_person, corridor
from tests.vision.networks import constant_network, echo_network, strict_network, yolov8_rows


@pytest.fixture
def model(tmp_path) -> Path:
    file = tmp_path / "model.onnx"
    file.write_bytes(constant_network({"out": yolov8_rows((40, 60, 20, 50, 0.9))}, shape=(1, 3, 160, 160)))
    return file


def settings(model: Path | str = "", **changes) -> DetectorSettings:
    return DetectorSettings(model=str(model), **changes)


def test_nanodet_is_the_default():
    assert list(DETECTORS) == ["nanodet", "hog", "onnx"]
    assert all(name == spec.name for name, spec in DETECTORS.items())


def test_every_detector_begins_at_its_own_sure_score(model):
    for spec in DETECTORS.values():
        detector = spec.make(settings(model))
        assert detector.threshold == spec.sure > spec.weak
        assert detector.horizon == 0.5
        assert 0.3 < detector.box_width_m < 1


def test_hog_finds_a_drawn_person():
    picture = corridor()
    add_person(picture, 300, 190, 250)
    found = DETECTORS["hog"].make(DetectorSettings(threads=2)).detect(picture)
    np.testing.assert_allclose(found.boxes[0], (255, 190, 90, 250), atol=40)


def test_any_model_may_be_named(model):
    found = DETECTORS["onnx"].make(settings(model)).detect(np.zeros((320, 320, 3), np.uint8))
    np.testing.assert_allclose(found.boxes, [[80, 120, 40, 100]])


def test_model_for_any_size_is_shown_the_size_that_is_set(tmp_path):
    file = tmp_path / "free.onnx"
    file.write_bytes(constant_network({"out": yolov8_rows((40, 60, 20, 50, 0.9))}))
    free = DETECTORS["onnx"].make(settings(file)).detect(np.zeros((320, 320, 3), np.uint8))
    small = DETECTORS["onnx"].make(settings(file, input_width=160, input_height=160))
    np.testing.assert_allclose(small.detect(np.zeros((320, 320, 3), np.uint8)).boxes, [[80, 120, 40, 100]])
    assert free.boxes[0, 2] < 40


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"model": ""}, "no model is named"),
        ({"layout": "yolov9"}, "layout: 'yolov9' is not one of nanodet, nanodet-plus, yolox"),
        (
            {"layout": "yolov5"},
            r"answers out 1 x 84 x 200 float32; layout yolov5 expects one output 1 x n x \(5 . classes\)",
        ),
        (
            {"input_width": 320, "input_height": 160},
            r"takes picture 1 x 3 x 160 x 160 float, not images of 320 x 160",
        ),
        ({"person_class": 80}, "layout yolov8 expects one output .* class 80 among them"),
        ({"channels": "red"}, "channels"),
        ({"pixels": "many"}, "pixels"),
    ],
)
def test_settings_that_do_not_fit_are_one_clear_error(model, changes, expected):
    with pytest.raises(ParameterError, match=expected):
        DETECTORS["onnx"].make(DetectorSettings(**{"model": str(model), **changes}))


def test_included_weights_work_as_an_onnx_model(tmp_path):
    file = tmp_path / "nanodet.onnx"
    file.write_bytes(included_model(FILE, SHA256))
    picture = corridor()
    box = add_person(picture, 300, 150, 200)
    found = DETECTORS["onnx"].make(settings(file, layout="nanodet", classes=1)).detect(picture)
    assert len(found) == 1
    assert iou(np.array(box), found.boxes)[0] > 0.6


def test_missing_model_is_named():
    with pytest.raises(ParameterError, match=r"/nowhere/model\.onnx: no such file"):
        DETECTORS["onnx"].make(settings("/nowhere/model.onnx"))


def test_one_side_of_the_size_is_not_enough(tmp_path):
    file = tmp_path / "free.onnx"
    file.write_bytes(echo_network())
    with pytest.raises(ParameterError, match="set both input_width and input_height"):
        DETECTORS["onnx"].make(settings(file, input_width=160))


def test_size_that_the_model_refuses_is_one_clear_error(tmp_path):
    file = tmp_path / "strict.onnx"
    file.write_bytes(strict_network(64, 64))
    with pytest.raises(ParameterError, match=r"an image of shape \(1, 3, 160, 160\) does not fit the model"):
        DETECTORS["onnx"].make(settings(file, input_width=160, input_height=160))
