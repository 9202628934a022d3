"""Small ONNX networks: what a detector answers without one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tools.onnx_file import Node, Port, model

PICTURE = (1, 3, "height", "width")


def constant_network(
    answers: Mapping[str, np.ndarray], *, shape: Sequence[int | str] = PICTURE, dtype: str = "float32"
) -> bytes:
    """A network that gives ``answers``, by name of the output, to every picture of ``shape``."""
    nodes = [Node("Identity", [f"{name}_constant"], [name]) for name in answers]
    outputs = [Port(name, value.shape, value.dtype.name) for name, value in answers.items()]
    constants = {f"{name}_constant": value for name, value in answers.items()}
    return model(nodes, [Port("picture", shape, dtype)], outputs, constants, name="constant")


def echo_network(*, shape: Sequence[int | str] = PICTURE, dtype: str = "float32") -> bytes:
    """A network that answers with the picture it was given."""
    return model(
        [Node("Identity", ["picture"], ["echo"])], [Port("picture", shape, dtype)], [Port("echo", shape, dtype)], {},
        name="echo",
    )  # fmt: skip


def strict_network(width: int, height: int) -> bytes:
    """A network that says any size would do but can only add a picture of one size to what it knows."""
    known = np.zeros((1, 3, height, width), np.float32)
    return model(
        [Node("Add", ["picture", "known"], ["sum"])], [Port("picture", PICTURE)], [Port("sum", PICTURE)],
        {"known": known}, name="strict",
    )  # fmt: skip


def yolov8_rows(*people: tuple[float, float, float, float, float], count: int = 200, classes: int = 80) -> np.ndarray:
    """Answers of YOLOv8, (1, 4 + classes, count): each of ``people`` is x, y, w, h, score; the rest is empty."""
    table = np.zeros((1, 4 + classes, count), np.float32)
    for column, (x, y, w, h, score) in enumerate(people):
        table[0, :5, column] = (x + w / 2, y + h / 2, w, h, score)
    return table
