"""Small ONNX networks: what a detector answers without one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

PICTURE = (1, 3, "height", "width")


def tensor(name: str, shape: Sequence[int | str], dtype: str = "float32") -> ValueInfoProto:
    """An input or output of a network."""
    return helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(np.dtype(dtype)), shape)


def model(
    nodes: Sequence[NodeProto],
    inputs: Sequence[ValueInfoProto],
    outputs: Sequence[ValueInfoProto],
    constants: Mapping[str, np.ndarray] | None = None,
) -> bytes:
    """The ONNX file of a network."""
    initializers = [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()]
    graph = helper.make_graph(nodes, "test", inputs, outputs, initializers)
    return helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 13)]).SerializeToString()


def constant_network(
    answers: Mapping[str, np.ndarray], *, shape: Sequence[int | str] = PICTURE, dtype: str = "float32"
) -> bytes:
    """A network that gives ``answers``, by name of the output, to every image of ``shape``."""
    nodes = [helper.make_node("Identity", [f"{name}_constant"], [name]) for name in answers]
    outputs = [tensor(name, value.shape, value.dtype.name) for name, value in answers.items()]
    constants = {f"{name}_constant": value for name, value in answers.items()}
    return model(nodes, [tensor("picture", shape, dtype)], outputs, constants)


def echo_network(*, shape: Sequence[int | str] = PICTURE, dtype: str = "float32", domain: str = "") -> bytes:
    """A network that returns its input image, by an operator of a ``domain``."""
    node = helper.make_node("Identity", ["picture"], ["echo"], domain=domain)
    return model([node], [tensor("picture", shape, dtype)], [tensor("echo", shape, dtype)])


def endless_network() -> bytes:
    """A network that runs a loop without end."""
    body = helper.make_graph(
        [helper.make_node("Identity", [name], [f"{name}_next"]) for name in ("go_on", "value")],
        "body",
        [tensor("turn", (), "int64"), tensor("go_on", (), "bool"), tensor("value", (1,))],
        [tensor("go_on_next", (), "bool"), tensor("value_next", (1,))],
    )
    node = helper.make_node("Loop", ["", "yes", "begin"], ["end"], body=body)
    constants = {"yes": np.array(True), "begin": np.zeros(1, np.float32)}
    return model([node], [tensor("picture", PICTURE)], [tensor("end", (1,))], constants)


def greedy_network(numbers: int) -> bytes:
    """A network that needs a list of so many ``numbers`` for each row of an image."""
    nodes = [
        helper.make_node("Shape", ["picture"], ["shape"]),
        helper.make_node("Mul", ["shape", "factors"], ["large"]),
        helper.make_node("ConstantOfShape", ["large"], ["zeros"]),
        helper.make_node("ReduceSum", ["zeros"], ["sum"], keepdims=0),
    ]
    factors = {"factors": np.array([1, 1, 1, numbers], np.int64)}
    return model(nodes, [tensor("picture", PICTURE)], [tensor("sum", ())], factors)


def model_with_external_data(location: str) -> bytes:
    """A network whose constant is in another file."""
    node = helper.make_node("Add", ["picture", "known"], ["sum"])
    known = np.zeros((1, 3, 2, 2), np.float32)
    loaded = ModelProto.FromString(
        model([node], [tensor("picture", PICTURE)], [tensor("sum", PICTURE)], {"known": known})
    )
    (constant,) = loaded.graph.initializer
    constant.ClearField("raw_data")
    constant.data_location = TensorProto.EXTERNAL
    constant.external_data.add(key="location", value=location)
    constant.external_data.add(key="length", value=str(known.nbytes))
    return loaded.SerializeToString()


def strict_network(width: int, height: int) -> bytes:
    """A network that declares any input size but accepts only one."""
    node = helper.make_node("Add", ["picture", "known"], ["sum"])
    known = np.zeros((1, 3, height, width), np.float32)
    return model([node], [tensor("picture", PICTURE)], [tensor("sum", PICTURE)], {"known": known})


def yolov8_rows(*people: tuple[float, float, float, float, float], count: int = 200, classes: int = 80) -> np.ndarray:
    """Answers of YOLOv8, (1, 4 + classes, count): each of ``people`` is x, y, w, h, score; the rest is empty."""
    table = np.zeros((1, 4 + classes, count), np.float32)
    for column, (x, y, w, h, score) in enumerate(people):
        table[0, :5, column] = (x + w / 2, y + h / 2, w, h, score)
    return table
