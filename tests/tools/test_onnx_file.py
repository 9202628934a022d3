from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.onnx_file import Node, Port, model


def run(data: bytes, **inputs: np.ndarray) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    return [np.asarray(answer) for answer in session.run(None, inputs)]


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.integers(1, 5), max_size=4),
    st.sampled_from(["float32", "float16", "uint8", "int32", "int64"]),
    st.integers(0, 1000),
)
def test_constants_of_any_shape_and_type_come_through(shape, dtype, seed):
    value = np.random.default_rng(seed).integers(0, 200, shape).astype(dtype)
    file = model(
        [Node("Identity", ["value"], ["out"])], [], [Port("out", value.shape, dtype)], {"value": value}, name="constant"
    )
    (answer,) = run(file)
    assert answer.dtype == value.dtype
    assert answer.shape == value.shape
    assert (answer == value).all()


@pytest.mark.parametrize("axis", [0, 1, -1])
def test_whole_numbers_and_lists_of_them_are_attributes(axis):
    one, two = np.zeros((2, 2), np.float32), np.ones((2, 2), np.float32)
    nodes = [
        Node("Concat", ["a", "b"], ["both"], {"axis": axis}),
        Node("Transpose", ["both"], ["out"], {"perm": (1, 0)}),
    ]
    (answer,) = run(
        model(nodes, [Port("a", (2, 2)), Port("b", (2, 2))], [Port("out", ("n", "m"))], {}, name="x"), a=one, b=two
    )
    assert (answer == np.concatenate([one, two], axis=axis).T).all()


def test_numbers_and_words_are_attributes():
    value = np.array([[[[-1.0, 2.0]]]], np.float32)
    scales = np.array([1, 1, 1, 2], np.float32)
    nodes = [
        Node("LeakyRelu", ["picture"], ["leaky"], {"alpha": 0.5}),
        Node("Resize", ["leaky", "", "scales"], ["out"], {"mode": "nearest"}),
    ]
    file = model(nodes, [Port("picture", (1, 1, 1, 2))], [Port("out", (1, 1, 1, 4))], {"scales": scales}, name="x")
    (answer,) = run(file, picture=value)
    assert answer.ravel().tolist() == [-0.5, -0.5, 2.0, 2.0]


def test_named_sizes_may_vary():
    file = model([Node("Neg", ["a"], ["b"])], [Port("a", ("n", 2))], [Port("b", ("n", 2))], {}, name="x")
    for count in (1, 3):
        (answer,) = run(file, a=np.ones((count, 2), np.float32))
        assert (answer == -np.ones((count, 2))).all()


def test_the_same_network_is_the_same_bytes():
    def build() -> bytes:
        return model([Node("Neg", ["a"], ["b"])], [Port("a", (1,))], [Port("b", (1,))], {}, name="x", text="how")

    assert build() == build()
