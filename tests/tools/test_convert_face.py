"""The conversion of BlazeFace, on a network that has its kinds of operations and nothing else."""

from __future__ import annotations

import base64

import numpy as np
import onnx
import pytest

from tests.tools.test_convert_nanodet import ints, operation
from tools.convert_face import SIZE, convert


def coded(*texts: str) -> dict:
    return {"list": {"s": [base64.b64encode(text.encode()).decode() for text in texts]}}


def padding(text: str) -> dict:
    return {"s": base64.b64encode(text.encode()).decode()}


def network(last: str = "Identity") -> tuple[dict, dict[str, np.ndarray]]:
    """A convolution to four channels, halved by pooling, padded to six, and two rows of three for each cell."""
    random = np.random.default_rng(5)
    weights = {
        "kernel": random.normal(size=(3, 3, 3, 4)).astype(np.float16),
        "bias": random.normal(size=4).astype(np.float16),
        "deep": random.normal(size=(3, 3, 4, 1)).astype(np.float16),
        "more": np.array([[0, 0], [0, 0], [0, 0], [0, 2]], np.int32),
        "rows/2": np.array(3, np.int32),
    }
    step, one, window = ints(1, 2, 2, 1), ints(1, 1, 1, 1), ints(1, 2, 2, 1)
    nodes = [
        {"name": "input", "op": "Placeholder", "attr": {}},
        operation("conv", "_FusedConv2D", "input", "kernel", "bias", strides=step, padding=padding("SAME"),
                  fused_ops=coded("BiasAdd", "Relu")),
        operation("depth", "DepthwiseConv2dNative", "conv", "deep", strides=one, padding=padding("SAME")),
        operation("add", "AddV2", "conv", "depth"),
        operation("pool", "MaxPool", "add", ksize=window, strides=step),
        operation("pad", "Pad", "pool", "more"),
        operation("flat", "Reshape", "pad", "rows"),
        operation("end", last, "flat"),
    ]  # fmt: skip
    return {"node": nodes}, weights


def test_a_part_of_the_network_gives_what_tensorflow_gives():
    onnxruntime = pytest.importorskip("onnxruntime")
    topology, weights = network()
    model = onnx.load_from_string(convert(topology, weights))
    del model.graph.output[0].type.tensor_type.shape.dim[:]
    image = np.random.default_rng(6).normal(size=(1, 3, SIZE, SIZE)).astype(np.float32)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    (found,) = session.run(None, {"input": image})
    assert found.shape == (1, 32 * 32 * 2, 3)
    # The first cell by hand: TensorFlow pads an even side at its end only.
    kernel, bias, deep = (weights[name].astype(np.float32) for name in ("kernel", "bias", "deep"))
    padded = np.pad(image[0], ((0, 0), (0, 1), (0, 1))).transpose(1, 2, 0)
    first = np.array(
        [
            [np.tensordot(padded[2 * y : 2 * y + 3, 2 * x : 2 * x + 3], kernel, 3) + bias for x in range(3)]
            for y in range(3)
        ]
    ).clip(min=0)
    around = np.pad(first, ((1, 0), (1, 0), (0, 0)))
    second = np.array(
        [
            [first[y, x] + (around[y : y + 3, x : x + 3] * deep[:, :, :, 0]).sum((0, 1)) for x in range(2)]
            for y in range(2)
        ]
    )
    assert found[0, :2].ravel() == pytest.approx(np.append(second.max((0, 1)), [0, 0]), rel=1e-3, abs=1e-3)


def test_unknown_operations_are_refused():
    with pytest.raises(SystemExit, match="end: Softmax is not understood"):
        convert(*network("Softmax"))
