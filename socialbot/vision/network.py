"""A neural network in an ONNX file, run on the processor by onnxruntime."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialbot.errors import InstallationError, ParameterError

__all__ = ["Network", "NetworkPort"]

_DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
"""What a picture may be given as."""


@dataclass(frozen=True)
class NetworkPort:
    """An input or output: its shape has numbers where it is fixed and 0 where it is not."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    def __str__(self) -> str:
        sizes = " x ".join(str(size) if size else "?" for size in self.shape)
        return f"{self.name} {sizes or 'without a shape'} {self.dtype.removeprefix('tensor(').removesuffix(')')}"


class Network:
    """One picture in, answers out.

    ``threads`` work on it and sleep in between. The answers do not depend on their number.
    """

    def __init__(self, model: Path | bytes, *, threads: int = 1, where: str = "") -> None:
        """Loads the file at the path ``model``, or the file's bytes; ``where`` names it in errors.

        Raises InstallationError without onnxruntime, and ParameterError when there is no such file, when it is no
        ONNX network, or when the network does not take one picture.
        """
        self.where = where or (str(model) if isinstance(model, Path) else "network")
        self._session = _session(model, threads, self.where)
        inputs = [_port(port) for port in self._session.get_inputs()]
        self.outputs = tuple(_port(port) for port in self._session.get_outputs())
        if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].dtype not in _DTYPES:
            raise ParameterError(
                f"the model takes {'; '.join(map(str, inputs)) or 'nothing'}, expected one picture of four dimensions",
                where=self.where,
                remedy="export the detector alone: picture in, boxes out, batch of one",
            )
        self.input = inputs[0]
        batch, channels, *_, last = self.input.shape
        self.channels_last = last == 3 and channels != 3
        if batch > 1 or (channels not in (0, 3) and not self.channels_last):
            raise ParameterError(
                f"the model takes {self.input}, expected 1 x 3 x height x width or 1 x height x width x 3",
                where=self.where,
                remedy="export the detector for one colour picture at a time",
            )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels; 0 where the network takes any."""
        _, *sizes = self.input.shape
        height, width = sizes[:2] if self.channels_last else sizes[1:]
        return width, height

    def run(self, picture: np.ndarray) -> Sequence[np.ndarray]:
        """What the network answers to ``picture``, shape (3, height, width): an array an output.

        Raises ParameterError when the network refuses the picture.
        """
        picture = picture.transpose(1, 2, 0) if self.channels_last else picture
        data = np.ascontiguousarray(picture[None], dtype=_DTYPES[self.input.dtype])
        try:
            return [np.asarray(answer) for answer in self._session.run(None, {self.input.name: data})]
        except Exception as error:  # onnxruntime's errors have no class of their own.
            raise ParameterError(
                f"a picture of shape {data.shape} does not fit the model, which takes {self.input}: {_first(error)}",
                where=self.where,
                remedy="set the input size that the model was exported for",
            ) from error


def _session(model: Path | bytes, threads: int, where: str):
    try:
        import onnxruntime
    except ImportError as error:
        raise InstallationError(
            f"onnxruntime cannot be imported: {error}",
            where=where,
            remedy="pip install onnxruntime, or choose the detector hog",
        ) from error
    if isinstance(model, Path) and not model.is_file():
        raise ParameterError("no such file", where=where, remedy="name an ONNX file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # A thread that spins between pictures takes a whole core from the robot.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4
    source = str(model) if isinstance(model, Path) else model
    try:
        return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no class of their own.
        raise ParameterError(
            f"not a network that onnxruntime {onnxruntime.__version__} can run: {_first(error)}",
            where=where,
            remedy="export the detector to ONNX anew, for the processor",
        ) from error


def _port(port) -> NetworkPort:
    shape = tuple(size if isinstance(size, int) and size > 0 else 0 for size in port.shape)
    return NetworkPort(port.name, shape, port.type)


def _first(error: Exception) -> str:
    """The first line of what ``error`` says."""
    return next(iter(str(error).splitlines()), type(error).__name__)
