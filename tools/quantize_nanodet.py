"""Quantize the network of ``tools.convert_nanodet`` to 8 bits, with images of bags to find the ranges of its values.

Only developers need it, since the result is part of the package::

    python -m tools.quantize_nanodet nanodet_float.onnx socialbot/vision/models/nanodet.onnx data/synthetic/*_tune/

It needs the extra ``onnx``. The same processor and versions of numpy and onnxruntime give the same file.

The quantized network takes pixels as they are, from 0 to 255. Weights have one scale for each output channel, and 7
bits: processors without VNNI add two products of 8 bits in 16 bits, which overflow otherwise. They are rounded one
after the other, and the weights that are left make up for each error (GPTQ). Values have 8 bits, and the range that
distorts them least in the images. The last convolutions and what follows them stay in float32: scores and edges of a
box would share one scale.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper

from socialbot.bags.reader import open_bag
from socialbot.core.errors import ImageError
from socialbot.vision.detectors import DETECTORS, PIXELS, nanodet
from socialbot.vision.images import Pixels
from socialbot.vision.metrics.frames import BagImages
from socialbot.vision.network import OnnxModel

IMAGES = 5
"""Images of each bag, at even intervals."""
QUANTIZED = ("Conv", "LeakyRelu", "Concat", "Add", "MaxPool", "AveragePool", "Resize")
_SAME_VALUES = ("MaxPool", "Resize")  # Their output keeps the range of the input.
_GREY = 114  # Beside the image, convolutions see this pixel value: the mean of the training images.
_LEVELS, _LARGEST = 255, 64  # Steps of the values, and the largest weight.
_VALUES, _PLACES = 1000, 80  # Sample of each tensor and each image: values for ranges, and places for weights.
_POWER = 3  # The range of a tensor has the least mean error to this power: large values are rare, and matter.
_SHARES = np.linspace(0.1, 1.0, 10)  # Shares of the extreme values that are tried as ends of a range.
_DAMPING = 0.1  # Added to the variances of the inputs of a convolution, as a share of their mean.


class Recorded(OnnxModel):
    """Model that keeps the ``inputs`` it was given, each of shape (1, 3, height, width)."""

    def __init__(self, model: bytes) -> None:
        self.inputs: list[np.ndarray] = []
        super().__init__(model, where="the model")

    def run(self, image: np.ndarray) -> Sequence[np.ndarray]:
        self.inputs.append(np.ascontiguousarray(image[None]))
        return super().run(image)


def images(bag: Path) -> Iterator[Pixels]:
    """Return ``IMAGES`` images of ``bag``, shape (height, width, 3), blue first."""
    with open_bag(bag) as opened:
        topic = opened.choose_image_topic()
    every = max(1, topic.count // IMAGES)
    for encoded in itertools.islice(BagImages(str(bag), topic.name).read(), every // 2, None, every):
        try:
            yield encoded.bgr()
        except ImageError as error:
            raise SystemExit(f"{bag}: {error}") from error


def quantize(model: bytes, shown: Iterable[Pixels]) -> bytes:
    """Return the ONNX file of ``model`` with 8 bits, chosen with the images ``shown``."""
    source = over_pixels(single(onnx.load_model_from_string(model)))
    recorded = Recorded(source.SerializeToString())
    finder = nanodet(DETECTORS["nanodet"].sure, network=recorded)
    recorded.inputs.clear()
    for image in shown:
        finder.detect(image)
    layers = [node for node in source.graph.node if node.op_type in QUANTIZED and node.name not in heads(source)]
    made = write(source, layers, *observe(source, layers, recorded.inputs))
    made.producer_name, made.producer_version = "socialbot", ""
    made.doc_string += " Quantized to 8 bits."
    return made.SerializeToString(deterministic=True)


def over_pixels(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return ``model`` with an input of pixels from 0 to 255: the first convolution normalizes them."""
    mean, deviation = (np.array(each[::-1]) for each in PIXELS["imagenet"])
    (first,) = [node for node in model.graph.node if "picture" in node.input]
    weights = {each.name: each for each in model.graph.initializer}
    kernel = numpy_helper.to_array(weights[first.input[1]]).astype(np.float64)
    bias = numpy_helper.to_array(weights[first.input[2]]) if len(first.input) > 2 else np.zeros(len(kernel))
    bias = bias + (kernel * ((_GREY - mean) / deviation)[:, None, None]).sum(axis=(1, 2, 3))
    names = first.input[1], f"{first.input[1]}/bias"
    for name, value in zip(names, (kernel / deviation[:, None, None], bias), strict=True):
        if name in weights:
            model.graph.initializer.remove(weights[name])
        model.graph.initializer.append(numpy_helper.from_array(value.astype(np.float32), name))
    model.graph.initializer.append(numpy_helper.from_array(np.array(_GREY, np.float32), "grey"))
    first.input[:] = ["centred", *names]
    model.graph.node.insert(0, helper.make_node("Sub", ["picture", "grey"], ["centred"], name="centre"))
    return model


@dataclass
class Values:
    """Sample of the values of a tensor, and its extremes."""

    sample: np.ndarray
    least: float = 0.0
    most: float = 0.0


@dataclass
class Inputs:
    """Sums over ``count`` places of the inputs of a convolution, n at each place, and of their products, (n, n)."""

    count: int
    sums: np.ndarray
    products: np.ndarray


def observe(
    source: onnx.ModelProto, layers: Sequence[onnx.NodeProto], images: Sequence[np.ndarray]
) -> tuple[dict[str, Values], dict[str, Inputs]]:
    """Run ``source`` on ``images``: values of the outputs of ``layers``, and inputs of convolutions by kernel."""
    chance = np.random.default_rng(0)
    names = list(dict.fromkeys(["centred", *(node.output[0] for node in layers)]))
    sizes = {each.name: each.dims[2:] for each in source.graph.initializer}
    open_model = onnx.ModelProto.FromString(source.SerializeToString())
    del open_model.graph.output[:]
    open_model.graph.output.extend(helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in names)
    network = OnnxModel(open_model.SerializeToString())
    values: dict[str, Values] = {}
    inputs: dict[str, Inputs] = {}
    for image in images:
        seen = dict(zip(names, network.run(image[0]), strict=True))
        for name, value in seen.items():
            sample = chance.choice(value.ravel(), min(value.size, _VALUES))
            before = values.setdefault(name, Values(sample[:0]))
            before.sample = np.concatenate([before.sample, sample])
            before.least, before.most = min(before.least, value.min()), max(before.most, value.max())
        for node in layers:
            if node.op_type == "Conv":
                shape = seen[node.output[0]].shape[2:]
                places = chance.choice(np.prod(shape), min(np.prod(shape), _PLACES), replace=False)
                rows = patches(
                    seen[node.input[0]][0], node, sizes[node.input[1]], *np.unravel_index(places, shape)
                ).astype(np.float64)
                add = Inputs(len(rows), rows.sum(axis=0), rows.T @ rows)
                before = inputs.get(node.input[1])
                inputs[node.input[1]] = (
                    add
                    if before is None
                    else Inputs(before.count + add.count, before.sums + add.sums, before.products + add.products)
                )
    return values, inputs


def patches(
    data: np.ndarray, node: onnx.NodeProto, size: Sequence[int], rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """What a convolution of a kernel ``size`` sees of ``data``, (channels, height, width), at places of its output.

    The result has the shape (places, inputs).
    """
    height, width = size
    options = {each.name: helper.get_attribute_value(each) for each in node.attribute}
    top, left, bottom, right = options.get("pads", [0] * 4)
    down, across = options.get("strides", [1, 1])
    data = np.pad(data, ((0, 0), (top, bottom), (left, right)))
    parts = [data[:, rows * down + y, columns * across + x] for y in range(height) for x in range(width)]
    return np.stack(parts, axis=-1).transpose(1, 0, 2).reshape(len(rows), -1)


Range = tuple[np.float32, int]
"""Step of a tensor with 8 bits, and the level of 0."""


def span(least: float, most: float) -> Range:
    """The levels from ``least`` to ``most``."""
    step = np.float32((most - least) / _LEVELS or 1.0)
    return step, int(np.clip(np.rint(-least / step), 0, _LEVELS))


def best_range(values: Values, slope: float) -> Range:
    """The range that distorts ``values`` least; below 0, errors count ``slope`` times."""

    def error(candidate: Range) -> float:
        step, zero = candidate
        rounded = (np.clip(np.rint(values.sample / step) + zero, 0, _LEVELS) - zero) * step
        before, after = (np.where(each < 0, slope * each, each) for each in (values.sample, rounded))
        return float((np.abs(after - before) ** _POWER).mean())

    return min(
        (span(low * values.least, high * values.most) for low, high in itertools.product(_SHARES, _SHARES)), key=error
    )


def round_kernel(kernel: np.ndarray, inputs: Inputs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Round ``kernel``: whole numbers, the scale of each output channel, and what to add to the bias.

    Weights are rounded one after the other, those of strong inputs first. Those that are left take over the error, by
    the covariances of the ``inputs`` (GPTQ).
    """
    mean = inputs.sums / inputs.count
    spread = inputs.products / inputs.count - np.outer(mean, mean)
    spread += np.eye(len(mean)) * (_DAMPING * np.diag(spread).mean() + 1e-12)
    order = np.argsort(-np.diag(spread), kind="stable")
    factor = np.linalg.cholesky(np.linalg.inv(spread[np.ix_(order, order)])).T
    weights = kernel.reshape(len(kernel), -1).astype(np.float64)
    scale = np.maximum(np.abs(weights).max(axis=1) / _LARGEST, 1e-12).astype(np.float32)
    left, whole = weights[:, order], np.zeros_like(weights)
    for number, index in enumerate(order):
        whole[:, index] = np.clip(np.rint(left[:, number] / scale), -_LARGEST, _LARGEST)
        error = (left[:, number] - whole[:, index] * scale) / factor[number, number]
        left[:, number:] -= np.outer(error, factor[number, number:])
    bias = (weights - whole * scale[:, None]) @ mean
    return whole.reshape(kernel.shape).astype(np.int8), scale, bias


def write(
    source: onnx.ModelProto,
    layers: Sequence[onnx.NodeProto],
    values: Mapping[str, Values],
    inputs: Mapping[str, Inputs],
) -> onnx.ModelProto:
    """Return ``source`` with ``layers`` in 8 bits."""
    weights = {each.name: numpy_helper.to_array(each) for each in source.graph.initializer}
    slopes = {node.input[0]: node.attribute[0].f for node in layers if node.op_type == "LeakyRelu"}
    names = {node.name for node in layers}
    ranges: dict[str, Range] = {"centred": (np.float32(1), _GREY)}
    nodes: list[onnx.NodeProto] = []

    def convert(
        kind: str, tensor: str, result: str, scale: np.ndarray | np.generic, zero: np.ndarray | np.generic
    ) -> None:
        ends = [f"{result}/scale", f"{result}/zero"]
        weights.update(zip(ends, map(np.asarray, (scale, zero)), strict=True))
        nodes.append(helper.make_node(kind, [tensor, *ends], [result], name=f"{result}/{kind}", axis=0))

    for node in source.graph.node:
        if node.output[0] == "centred":
            convert("DequantizeLinear", "picture", "centred", np.float32(1), np.uint8(_GREY))
        elif node.name not in names:
            nodes.append(node)
        else:
            if node.op_type == "Conv":
                whole, scale, more = round_kernel(weights[node.input[1]], inputs[node.input[1]])
                bias = weights[node.input[2]] if len(node.input) > 2 else np.zeros(len(scale))
                product = scale * ranges[node.input[0]][0]
                parts = (whole, scale), (np.rint((bias + more) / product).astype(np.int32), product)
                node.input[:] = [*node.input[:2], f"{node.input[1]}/bias"]
                for name, (data, unit) in zip(node.input[1:], parts, strict=True):
                    weights.pop(name, None)
                    weights[f"{name}/whole"] = data
                    convert("DequantizeLinear", f"{name}/whole", name, unit, np.zeros(len(unit), data.dtype))
            name = node.output[0]
            ranges[name] = (
                ranges[node.input[0]]
                if node.op_type in _SAME_VALUES
                else best_range(values[name], slopes.get(name, 1.0))
            )
            step, zero = np.float32(ranges[name][0]), np.uint8(ranges[name][1])
            node.output[0] = f"{name}/float"
            nodes.append(node)
            convert("QuantizeLinear", node.output[0], f"{name}/whole", step, zero)
            convert("DequantizeLinear", f"{name}/whole", name, step, zero)
    del source.graph.node[:], source.graph.initializer[:]
    source.graph.node.extend(nodes)
    used = {name for node in nodes for name in node.input}
    source.graph.initializer.extend(
        numpy_helper.from_array(value, name) for name, value in weights.items() if name in used
    )
    source.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.UINT8
    return source


def heads(model: onnx.ModelProto) -> set[str]:
    """Return the names of the last convolutions, the activations before them, and all nodes after them."""
    values = {node.input[0] for node in model.graph.node if node.op_type == "Split"}
    names = set()
    for node in model.graph.node:  # In order of computation.
        if values & {*node.input, *node.output}:
            values.update(node.output)
            names.add(node.name)
    inputs = {name for node in model.graph.node if node.name in names for name in node.input}
    others = {name for node in model.graph.node if node.name not in names for name in node.input}
    return names | {
        node.name for node in model.graph.node if node.op_type == "LeakyRelu" and node.output[0] in inputs - others
    }


def single(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return ``model`` with weights in float32, without the Cast of each weight in float16."""
    weights = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    nodes = []
    for node in model.graph.node:
        if node.op_type == "Cast" and node.input[0] in weights:
            weights[node.output[0]] = weights.pop(node.input[0]).astype(np.float32)
        else:
            nodes.append(node)
    del model.graph.node[:], model.graph.initializer[:]
    model.graph.node.extend(nodes)
    model.graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in weights.items())
    return model


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Quantize NanoDet to 8 bits")
    parser.add_argument("source", type=Path, help="the ONNX file of tools.convert_nanodet")
    parser.add_argument("target", type=Path, help="the ONNX file to write")
    parser.add_argument("bags", type=Path, nargs="+", help="bags with images for the ranges")
    arguments = parser.parse_args()
    result = quantize(arguments.source.read_bytes(), itertools.chain.from_iterable(map(images, arguments.bags)))
    arguments.target.write_bytes(result)
    print(f"{arguments.target}: {len(result)} bytes, sha256 {hashlib.sha256(result).hexdigest()}")
