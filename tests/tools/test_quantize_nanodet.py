"""The quantization, on a small network of one layer before the heads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from socialbot.vision.detectors import PIXELS
from tests.tools.test_convert_nanodet import answers, network
from tools.convert_nanodet import convert
from tools.quantize_nanodet import Inputs, Values, best_range, images, quantize, round_kernel


def model(seed: int) -> bytes:
    """The heads, and before them a convolution of 3 x 3 pixels with random weights."""
    made = onnx.load_model_from_string(convert(*network()))
    for node in made.graph.node:
        node.input[:] = ["first" if each == "picture" else each for each in node.input]
    kernel = np.random.default_rng(seed).normal(0, 0.3, size=(3, 3, 3, 3)).astype(np.float32)
    made.graph.initializer.append(numpy_helper.from_array(kernel, "kernel"))
    made.graph.node.insert(
        0, helper.make_node("Conv", ["picture", "kernel"], ["first"], name="Conv_first", pads=[1] * 4)
    )
    return made.SerializeToString()


@pytest.mark.parametrize("seed", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in (1, 2))])
def test_answers_stay_close_and_the_file_is_the_same_again(corridor: Path, seed: int):
    source = model(seed)
    shown = list(images(corridor))
    made = quantize(source, shown)
    pixels = shown[0][:256, :320].transpose(2, 0, 1)[None]
    mean, deviation = (np.array(each[::-1]).reshape(3, 1, 1) for each in PIXELS["imagenet"])
    before = answers(source, ((pixels - mean) / deviation).astype(np.float32))
    after = answers(made, pixels)
    differences = np.abs(after - before)
    assert 0 < differences[..., 1:].mean() < 0.05 * before[..., 1:].std()
    assert differences[..., 0].mean() < 0.02
    assert made == quantize(source, shown)


def test_only_what_comes_before_the_heads_has_integers(corridor: Path):
    made = onnx.load_model_from_string(quantize(model(0), images(corridor)))
    constants = {each.name: numpy_helper.to_array(each) for each in made.graph.initializer}
    kernels = {name: value for name, value in constants.items() if value.dtype == np.int8 and value.ndim == 4}
    assert list(kernels) == ["kernel/whole"]
    # A weight of 8 bits would make two products overflow on processors without VNNI.
    assert np.abs(kernels["kernel/whole"]).max() <= 64
    assert constants["kernel/scale"].shape == (3,)


def test_rounded_weights_make_up_for_each_other():
    chance = np.random.default_rng(2)
    kernel = chance.normal(size=(8, 4, 3, 3))
    rows = chance.normal(size=(2000, 6)) @ chance.normal(size=(6, 36)) + chance.normal(size=(2000, 36)) * 0.1 + 1.0
    whole, scale, bias = round_kernel(kernel, Inputs(len(rows), rows.sum(axis=0), rows.T @ rows))
    wanted = rows @ kernel.reshape(8, -1).T

    def error(levels: np.ndarray, more: np.ndarray) -> float:
        return float(np.square(rows @ (levels.reshape(8, -1) * scale[:, None]).T + more - wanted).mean())

    nearest = np.rint(kernel / scale[:, None, None, None])
    assert error(whole, bias) < 0.3 * error(nearest, np.zeros(8))


def test_a_range_spends_few_levels_on_what_an_activation_makes_small():
    sample = np.concatenate([np.linspace(-100, 0, 200), np.linspace(0, 10, 2000)])
    values = Values(sample, -100.0, 10.0)
    plain, before_activation = best_range(values, 1.0), best_range(values, 0.01)
    assert before_activation[0] < plain[0]
    assert before_activation[0] * (255 - before_activation[1]) >= 9.0
