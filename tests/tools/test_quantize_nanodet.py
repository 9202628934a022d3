"""The quantization, on a small network of one layer before the heads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from tests.tools.test_convert_nanodet import answers, network
from tools.convert_nanodet import convert
from tools.quantize_nanodet import images, quantize


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


@pytest.mark.parametrize("seed", range(3))
def test_answers_stay_close_and_the_file_is_the_same_again(corridor: Path, seed: int):
    source = model(seed)
    shown = list(images(corridor))
    made = quantize(source, shown)
    picture = ((shown[0][:256, :320].transpose(2, 0, 1)[None] - 114.0) / 57).astype(np.float32)
    before, after = answers(source, picture), answers(made, picture)
    differences = np.abs(after - before)
    assert 0 < differences[..., 1:].mean() < 0.05 * before[..., 1:].std()
    assert differences[..., 0].mean() < 0.02
    assert made == quantize(source, shown)


def test_only_what_comes_before_the_heads_has_integers(corridor: Path):
    made = onnx.load_model_from_string(quantize(model(0), images(corridor)))
    constants = {each.name: numpy_helper.to_array(each) for each in made.graph.initializer}
    kernels = {name: value for name, value in constants.items() if value.dtype == np.int8 and value.ndim == 4}
    assert list(kernels) == ["kernel_quantized"]
    largest = np.abs(kernels["kernel_quantized"]).max(axis=(1, 2, 3))
    # A weight of 8 bits would make two products overflow on processors without VNNI.
    assert largest.tolist() == [64, 64, 64]
    assert constants["kernel_scale"].shape == (3,)
