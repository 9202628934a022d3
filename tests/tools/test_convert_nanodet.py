"""The conversion, on a network that has the heads of NanoDet and nothing else."""

from __future__ import annotations

import base64
import hashlib

import numpy as np
import onnxruntime
import pytest

from tools import convert_nanodet
from tools.convert_nanodet import convert, read_source, read_weights

STRIDES = (8, 16, 32)


def operation(name: str, op: str, *inputs: str, **attributes) -> dict:
    return {"name": name, "op": op, "input": list(inputs), "attr": attributes}


def ints(*values: int) -> dict:
    return {"list": {"i": [str(value) for value in values]}}


def network() -> tuple[dict, dict[str, np.ndarray]]:
    """Three heads, each one convolution of a single pixel; the coarsest comes first in the file."""
    random = np.random.default_rng(5)
    nodes = [operation("input_1", "Placeholder")]
    nodes[0].pop("input")
    weights: dict[str, np.ndarray] = {"perm": np.array([0, 2, 3, 1], np.int32)}
    for stride in reversed(STRIDES):
        convolution = operation(
            f"conv{stride}", "Conv2D", "last", f"kernel{stride}", strides=ints(1, stride, stride, 1),
            dilations=ints(1, 1, 1, 1), padding={"s": base64.b64encode(b"VALID").decode()},
        )  # fmt: skip
        weights[f"kernel{stride}"] = random.normal(size=(1, 1, 3, 124)).astype(np.float16)
        weights[f"bias{stride}"] = random.normal(size=124).astype(np.float16)
        nodes += [
            convolution,
            operation(f"add{stride}", "Add", f"conv{stride}", f"bias{stride}"),
            operation(f"first{stride}", "Transpose", f"add{stride}", "perm"),
            operation(f"split{stride}", "SplitV", f"first{stride}", "perm", "perm"),
        ]
    nodes.insert(1, operation("last", "Transpose", "input_1", "perm"))
    return {"node": nodes}, weights


def answers(data: bytes, picture: np.ndarray) -> np.ndarray:
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    return np.asarray(session.run(None, {"picture": picture})[0])


def test_people_and_boxes_are_left_level_by_level_row_by_row():
    topology, weights = network()
    picture = np.random.default_rng(6).normal(size=(1, 3, 64, 96)).astype(np.float32)
    found = answers(convert(topology, weights), picture)
    levels = []
    for stride in STRIDES:
        cells = picture[0, :, ::stride, ::stride].reshape(3, -1).T
        both = cells @ weights[f"kernel{stride}"][0, 0].astype(np.float32) + weights[f"bias{stride}"].astype(np.float32)
        levels.append(np.hstack([1 / (1 + np.exp(-both[:, :1])), both[:, 80:]]))
    np.testing.assert_allclose(found[0], np.vstack(levels), rtol=1e-4, atol=1e-5)


def test_an_operation_that_is_not_known_is_refused():
    topology, weights = network()
    topology["node"][1] = operation("last", "Erf", "input_1")
    with pytest.raises(SystemExit, match="last: Erf is not understood"):
        convert(topology, weights)


def test_weights_finer_than_half_precision_are_refused():
    topology, weights = network()
    weights["bias8"] = np.full(124, 0.1, np.float32)
    with pytest.raises(SystemExit, match="add8/bias is finer than float16"):
        convert(topology, weights)


def test_weights_are_read_in_the_precision_they_are_stored_in():
    half, whole = np.array([[1.5, -2.0]], np.float16), np.array([7, -8], np.int32)
    manifest = [
        {
            "weights": [
                {"name": "a", "shape": [1, 2], "dtype": "float32", "quantization": {"dtype": "float16"}},
                {"name": "b", "shape": [2], "dtype": "int32"},
            ]
        }
    ]
    data = half.tobytes() + whole.tobytes()
    weights = dict(read_weights(manifest, data))
    assert weights["a"].tolist() == half.tolist()
    assert weights["b"].tolist() == whole.tolist()
    with pytest.raises(SystemExit, match="17 bytes of weights, 12 used"):
        dict(read_weights(manifest, data + b"extra"))


def test_only_the_files_that_were_meant_are_converted(tmp_path, monkeypatch):
    file = tmp_path / "nanodet.json"
    file.write_bytes(b"{}")
    with pytest.raises(SystemExit, match=r"nanodet\.json: sha256 44136fa3.*, expected 4495eb0e"):
        read_source(file)
    monkeypatch.setitem(convert_nanodet.SOURCES, "nanodet.json", hashlib.sha256(b"{}").hexdigest())
    assert read_source(file) == b"{}"
