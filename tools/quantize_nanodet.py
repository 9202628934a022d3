"""Quantize the network of ``tools.convert_nanodet`` to 8 bits, with images of bags to find the ranges of its values.

Only developers need it, since the result is part of the package::

    python -m tools.quantize_nanodet nanodet_float.onnx socialbot/vision/models/nanodet.onnx data/synthetic/*_tune/

It needs the extra ``onnx``. The same processor and version of onnxruntime give the same file.

Weights have one scale for each output channel, and 7 bits: processors without VNNI add two products of 8 bits in 16
bits, which overflow otherwise. Values have 8 bits, and the range that they have in the images. The last convolutions
and what follows them stay in float32: scores and edges of a box would share one scale.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

from socialbot.bags.reader import open_bag
from socialbot.core.errors import ImageError
from socialbot.vision.detectors import DETECTORS, nanodet
from socialbot.vision.images import Pixels
from socialbot.vision.metrics.frames import BagImages
from socialbot.vision.network import OnnxModel

IMAGES = 5
"""Images of each bag, at even intervals."""
QUANTIZED = ("Conv", "LeakyRelu", "Concat", "Add", "MaxPool", "AveragePool", "Resize")


class Recorded(OnnxModel):
    """Model that keeps the ``inputs`` it was given, each of shape (1, 3, height, width)."""

    def __init__(self, model: bytes) -> None:
        self.inputs: list[np.ndarray] = []
        super().__init__(model, where="the model")

    def run(self, image: np.ndarray) -> Sequence[np.ndarray]:
        self.inputs.append(np.ascontiguousarray(image[None]))
        return super().run(image)


class Given(CalibrationDataReader):
    """Hands ``inputs`` for the input ``name`` to onnxruntime."""

    def __init__(self, name: str, inputs: Iterable[np.ndarray]) -> None:
        self._left = ({name: each} for each in inputs)

    def get_next(self) -> dict[str, np.ndarray]:
        return next(self._left, {})


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
    """Return the ONNX file of ``model`` with 8 bits, and ranges from the images ``shown``."""
    recorded = Recorded(model)
    finder = nanodet(DETECTORS["nanodet"].sure, network=recorded)
    for image in shown:
        finder.detect(image)
    source = single(onnx.load_model_from_string(model))
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "quantized.onnx"
        quantize_static(
            source,
            str(target),
            Given(recorded.input.name, recorded.inputs),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=list(QUANTIZED),
            nodes_to_exclude=heads(source),
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        made = onnx.load(str(target))
    made.ir_version = source.ir_version
    made.producer_name, made.producer_version = "socialbot", ""
    made.doc_string += " Quantized to 8 bits."
    return made.SerializeToString(deterministic=True)


def heads(model: onnx.ModelProto) -> list[str]:
    """Return the names of the last convolutions and of all nodes after them; nodes are in order of computation."""
    values = {node.input[0] for node in model.graph.node if node.op_type == "Split"}
    names = []
    for node in model.graph.node:
        if values & {*node.input, *node.output}:
            values.update(node.output)
            names.append(node.name)
    return names


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
