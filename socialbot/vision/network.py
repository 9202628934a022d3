"""ONNX models: inference on the CPU, views of an image, and output layouts."""

from __future__ import annotations

import hashlib
import math
import mmap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.inference import Inference, check_external_data, network_limit
from socialbot.core.installation import pip_command, restore_command
from socialbot.core.limits import MODEL_BYTES
from socialbot.core.reading import check_size, open_file, read_bytes

_DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}


@dataclass(frozen=True)
class TensorInfo:
    """Name, shape and type of a model input or output; free dimensions are 0."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    def __str__(self) -> str:
        sizes = " x ".join(str(size) if size else "?" for size in self.shape)
        return f"{self.name} {sizes or 'without a shape'} {self.dtype.removeprefix('tensor(').removesuffix(')')}"


class OnnxModel:
    """ONNX model that takes one image; its output does not depend on the number of threads."""

    def __init__(self, model: Path | bytes, *, threads: int = 1, where: str = "") -> None:
        """Load a model.

        Args:
            model: Path or content of the file.
            threads: Processor threads; they sleep between images.
            where: Name of the model in errors.

        Raises:
            InstallationError: onnxruntime is missing.
            ParameterError: The file is missing or not ONNX, or the model does not take one image.
        """
        self.where = where or (str(model) if isinstance(model, Path) else "network")
        session = _session(model, threads, self.where)
        self._inference = Inference(session, self.where)
        inputs, self.outputs = (
            tuple(
                TensorInfo(each.name, tuple(max(n, 0) if isinstance(n, int) else 0 for n in each.shape), each.type)
                for each in tensors
            )
            for tensors in (session.get_inputs(), session.get_outputs())
        )
        takes = f"the model takes {'; '.join(map(str, inputs)) or 'nothing'}, expected"
        if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].dtype not in _DTYPES:
            remedy = "export the detector alone: image in, boxes out, batch of one"
            raise ParameterError(f"{takes} one image of four dimensions", where=self.where, remedy=remedy)
        self.input = inputs[0]
        batch, channels, *_, last = self.input.shape
        self.channels_last = last == 3 and channels != 3
        if batch > 1 or (channels not in (0, 3) and not self.channels_last):
            expected, remedy = "1 x 3 x height x width or 1 x height x width x 3", "export it for one colour image"
            raise ParameterError(f"{takes} {expected}", where=self.where, remedy=remedy)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the input, pixels; 0 if free."""
        _, *sizes = self.input.shape
        height, width = sizes[:2] if self.channels_last else sizes[1:]
        return width, height

    @property
    def takes_bytes(self) -> bool:
        """Whether the input is uint8."""
        return _DTYPES[self.input.dtype] is np.uint8

    def run(self, image: np.ndarray) -> Sequence[np.ndarray]:
        """Run the model on an image of shape (3, height, width); returns one array per output.

        Raises:
            ParameterError: The model rejects the shape, or takes too long.
        """
        image = image.transpose(1, 2, 0) if self.channels_last else image
        data = np.ascontiguousarray(image[None], dtype=_DTYPES[self.input.dtype])
        try:
            return [np.asarray(answer) for answer in self._inference.run({self.input.name: data})]
        except ParameterError:
            raise
        except Exception as error:  # onnxruntime's errors have no class of their own.
            raise ParameterError(
                f"an image of shape {data.shape} does not fit the model, which takes {self.input}: {_first(error)}",
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
            remedy=f"{pip_command('install', 'onnxruntime')}, or choose the detector hog",
        ) from error
    if isinstance(model, Path) and not model.is_file():
        raise ParameterError("no such file", where=where, remedy="name an ONNX file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Spinning threads would use a whole core between images.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4
    if isinstance(model, Path):
        _check_file(model, where)
    try:
        source, size = (str(model), model.stat().st_size) if isinstance(model, Path) else (model, len(model))
        with network_limit(size):
            return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no class of their own.
        raise ParameterError(
            f"not a network that onnxruntime {onnxruntime.__version__} can run: {_first(error)}",
            where=where,
            remedy="export the detector to ONNX again, for the processor",
        ) from error


def _check_file(model: Path, where: str) -> None:
    try:
        check_size(model, MODEL_BYTES)
        with open_file(model) as file:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        check_external_data(memoryview(content), where, model.parent)
    except (OSError, ValueError) as error:  # ValueError: it is empty
        raise ParameterError(f"cannot be read: {error}", where=where, remedy="name an ONNX file") from error


def included_model(file: str, sha256: str) -> bytes:
    """The content of an included ONNX ``file``. Raises InstallationError if it is missing or its checksum is wrong."""
    path = resources.files("socialbot.vision") / "models" / file
    remedy = f"bring the file back: {restore_command(Path(str(path)))}"
    try:
        data = read_bytes(str(path), MODEL_BYTES)
    except OSError as error:
        raise InstallationError(error.strerror or str(error), where=str(path), remedy=remedy) from error
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256:
        raise InstallationError(
            f"wrong weights: {len(data)} bytes with sha256 {digest}, expected {sha256}",
            where=str(path),
            remedy=remedy,
        )
    return data


def _first(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


Region = tuple[int, int, int, int]
"""x, y, w, h in pixels."""

_NEAR_EDGE = 0.06  # A box nearer to an edge of its view counts as cut off: share of the view's height.
_LARGEST_SCALE = 2.0
_STEP = 32
_ABOVE, _BELOW = 0.13, 0.2  # Extent of the band around the horizon: share of the height, for people from 10 m on.


@dataclass(frozen=True)
class View:
    """Region ``x``, ``y``, ``w``, ``h`` of an image, scaled onto a canvas of ``width`` x ``height`` pixels.

    On the canvas it covers ``across`` x ``down`` pixels from ``left``, ``top``; the rest has the grey level ``fill``.
    Boxes lower than ``least`` canvas pixels are left to finer views.
    """

    x: int
    y: int
    w: int
    h: int
    width: int
    height: int
    across: int
    down: int
    left: int
    top: int
    fill: int = 0
    least: float = 0.0

    def cut(self, image: np.ndarray) -> np.ndarray:
        """The canvas of ``image``; both have shape (height, width, 3) and type uint8."""
        canvas = np.full((self.height, self.width, 3), self.fill, np.uint8)
        part = image[self.y : self.y + self.h, self.x : self.x + self.w]
        # Averaging keeps detail in strong reductions; networks are trained on linear interpolation.
        method = cv2.INTER_AREA if self.across < self.w / 2 else cv2.INTER_LINEAR
        target = canvas[self.top : self.top + self.down, self.left : self.left + self.across]
        target[:] = cv2.resize(part, (self.across, self.down), interpolation=method)
        return canvas

    def back(self, boxes: np.ndarray) -> np.ndarray:
        """Convert ``boxes`` (n, 4) from canvas pixels to image pixels."""
        scale = np.array([self.w / self.across, self.h / self.down])
        corner = (boxes[:, :2] - (self.left, self.top)) * scale + (self.x, self.y)
        return np.hstack([corner, boxes[:, 2:] * scale])

    def trusted(self, boxes: np.ndarray, width: int, height: int) -> np.ndarray:
        """Whether each of ``boxes``, (n, 4), is large enough and not cut off by the view.

        The boxes are in pixels of the image, which is ``width`` x ``height`` pixels large.
        """
        margin = _NEAR_EDGE * self.h
        return (
            (boxes[:, 3] * self.down >= self.least * self.h)
            & ((boxes[:, 0] > self.x + margin) | (self.x <= 0))
            & ((boxes[:, 1] > self.y + margin) | (self.y <= 0))
            & ((boxes[:, 0] + boxes[:, 2] < self.x + self.w - margin) | (self.x + self.w >= width))
            & ((boxes[:, 1] + boxes[:, 3] < self.y + self.h - margin) | (self.y + self.h >= height))
        )


def band(width: int, height: int, horizon: float) -> Region:
    """Region of distant people in an image; ``horizon`` is a share of the height."""
    middle = min(max(horizon, 0.0), 1.0)
    top, bottom = round(max(0.0, middle - _ABOVE) * height), round(min(1.0, middle + _BELOW) * height)
    return 0, min(top, height - 1), width, max(1, bottom - top)


def whole(width: int, height: int, canvas: tuple[int, int], *, centred: bool = True, fill: int = 0) -> View:
    """View of the whole image, as large as fits on ``canvas``, in its middle or at the upper left."""
    return _placed((0, 0, width, height), canvas, centred=centred, fill=fill)


def scaled(part: Region, ratio: float) -> View:
    """View of ``part``, scaled by ``ratio``, without border."""
    x, y, w, h = part
    width, height = max(1, round(w * ratio)), max(1, round(h * ratio))
    return View(x, y, w, h, width, height, width, height, 0, 0)


def fitting(part: Region, pixels: int, *, fill: int = 0, least: float = 0.0) -> View:
    """View of ``part`` on a canvas of about ``pixels``, with sides divisible by 32."""
    _, _, w, h = part
    scale = min(math.sqrt(pixels / (w * h)), _LARGEST_SCALE)
    canvas = (max(1, round(w * scale / _STEP)) * _STEP, max(1, round(h * scale / _STEP)) * _STEP)
    return _placed(part, canvas, fill=fill, least=least)


def _placed(part: Region, canvas: tuple[int, int], *, centred: bool = True, fill: int = 0, least: float = 0.0) -> View:
    x, y, w, h = part
    width, height = canvas
    scale = min(width / w, height / h)
    across, down = max(1, min(width, round(w * scale))), max(1, min(height, round(h * scale)))
    left, top = ((width - across) // 2, (height - down) // 2) if centred else (0, 0)
    return View(x, y, w, h, width, height, across, down, left, top, fill, least)


_STRIDES = (8, 16, 32, 64)  # Pixels per cell of each level; many networks lack the last.


class LayoutMismatch(Exception):  # noqa: N818
    """Output that does not have the layout; the message is the expected one."""


@dataclass(frozen=True)
class ModelOutput:
    """Output of a model, one array for each of its ``ports``, for an input of ``width`` x ``height`` pixels.

    ``person`` is the index of the class "person"; boxes with scores below ``threshold`` are dropped.
    """

    arrays: Sequence[np.ndarray]
    ports: Sequence[TensorInfo]
    width: int
    height: int
    person: int = 0
    classes: int = 80
    threshold: float = 0.0

    def table(self, expected: str) -> np.ndarray:
        """The only answer, without the dimension of the batch. Raises LayoutMismatch with ``expected``."""
        if len(self.arrays) != 1 or self.arrays[0].ndim != 3 or self.arrays[0].shape[0] != 1:
            raise LayoutMismatch(expected)
        return self.arrays[0][0]

    def cells(self, count: int) -> np.ndarray | None:
        """Column, row and stride of ``count`` cells, shape (count, 3); None if no levels have so many."""
        rows: list[np.ndarray] = []
        for stride in _STRIDES:
            across, down = math.ceil(self.width / stride), math.ceil(self.height / stride)
            row, column = np.divmod(np.arange(across * down), across)
            rows.append(np.stack([column, row, np.full_like(row, stride)], axis=1))
            if sum(map(len, rows)) == count:
                return np.vstack(rows)
        return None


Found = tuple[np.ndarray, np.ndarray]
"""Boxes (n, 4) in input pixels and scores (n,), both float64."""


@dataclass(frozen=True)
class OutputLayout:
    """Format of the output of models, and the usual format of their input.

    ``channels`` is the order of the colours, ``pixels`` the range of the pixel values. The image is in the middle of
    the input, or at the upper left if not ``centred``; ``fill`` is the grey level beside it. ``read`` raises
    LayoutMismatch for the output of another layout.
    """

    name: str
    read: Callable[[ModelOutput], Found]
    channels: str
    pixels: str
    centred: bool
    fill: int


def _nanodet(offset: float, answers: ModelOutput) -> Found:
    """Rows of cells: class scores, then for each edge the logits of its distance in strides."""
    expected = (
        f"one output 1 x n x ({answers.classes} classes + 4 x bins), class {answers.person} among them, n the cells of "
        f"{answers.width} x {answers.height} pixels with strides 8, 16, 32 and perhaps 64"
    )
    table = answers.table(expected)
    bins, rest = divmod(table.shape[1] - answers.classes, 4)
    cells = answers.cells(len(table))
    if cells is None or rest or bins < 2 or answers.person >= answers.classes:
        raise LayoutMismatch(expected)
    scores = table[:, answers.person]
    good = scores >= answers.threshold
    logits = table[good, answers.classes :].reshape(-1, 4, bins).astype(np.float64)
    shares = np.exp(logits - logits.max(axis=2, keepdims=True))
    column, row, stride = cells[good].astype(np.float64).T
    distances = shares @ np.arange(bins) / shares.sum(axis=2) * stride[:, None]
    centre = np.stack([column + offset, row + offset], axis=1) * stride[:, None]
    return _corners(centre - distances[:, :2], centre + distances[:, 2:]), scores[good].astype(np.float64)


def _yolox(answers: ModelOutput) -> Found:
    """Rows of cells: centre in strides from the cell, log width and height in strides, then as in YOLOv5."""
    expected = (
        f"one output 1 x n x (5 + classes), class {answers.person} among them, n the cells of {answers.width} x "
        f"{answers.height} pixels with strides 8, 16 and 32"
    )
    table = answers.table(expected)
    cells = answers.cells(len(table))
    if cells is None:
        raise LayoutMismatch(expected)
    rows, scores, good = _objects(table, answers, expected)
    place, stride = cells[good, :2].astype(np.float64), cells[good, 2:].astype(np.float64)
    return _centred((rows[:, :2] + place) * stride, np.exp(rows[:, 2:4]) * stride), scores


def _yolov5(answers: ModelOutput) -> Found:
    """Rows: centre, width and height in pixels, object score, class scores."""
    expected = f"one output 1 x n x (5 + classes), n the larger, class {answers.person} among them"
    rows, scores, _ = _objects(answers.table(expected), answers, expected)
    return _centred(rows[:, :2], rows[:, 2:4]), scores


def _objects(table: np.ndarray, answers: ModelOutput, expected: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if answers.person >= table.shape[1] - 5 or table.shape[1] >= len(table):
        raise LayoutMismatch(expected)
    scores = table[:, 4].astype(np.float64) * table[:, 5 + answers.person]
    good = scores >= answers.threshold
    return table[good].astype(np.float64), scores[good], good


def _yolov8(answers: ModelOutput) -> Found:
    """Columns: centre, width and height in pixels, class scores."""
    expected = f"one output 1 x (4 + classes) x n, n the larger, class {answers.person} among them"
    table = answers.table(expected)
    if answers.person >= len(table) - 4 or len(table) >= table.shape[1]:
        raise LayoutMismatch(expected)
    scores = table[4 + answers.person]
    good = scores >= answers.threshold
    rows = table[:4, good].astype(np.float64)
    return _centred(rows[:2].T, rows[2:].T), scores[good].astype(np.float64)


def _detections(answers: ModelOutput) -> Found:
    """Left, top, right, bottom in pixels, score and class, in one output or several."""
    expected = (
        "n x 6 (left, top, right, bottom, score, class), or boxes n x 5 (with scores) and labels n, or boxes n x 4, "
        "scores n and labels n; each perhaps with a batch of 1 before it"
    )
    # A batch dimension of the boxes is one of all outputs.
    batch = any(array.ndim == 3 for array in answers.arrays)
    tables = [array[0] if batch and len(array) == 1 else array for array in answers.arrays]
    wide = [table for table in tables if table.ndim == 2 and table.shape[1] in (4, 5, 6)]
    flat = [(port, table) for port, table in zip(answers.ports, tables, strict=True) if table.ndim == 1]
    if len(wide) != 1 or any(len(table) != len(wide[0]) for _, table in flat):
        raise LayoutMismatch(expected)
    labels = [
        table.dtype.kind in "iu" or any(word in port.name.lower() for word in ("label", "class"))
        for port, table in flat
    ]
    if (wide[0].shape[1], labels.count(False), labels.count(True)) not in {(6, 0, 0), (5, 0, 1), (4, 1, 1)}:
        raise LayoutMismatch(expected)
    # Sorting puts the scores before the labels.
    rest = [table[:, None] for _, (_, table) in sorted(zip(labels, flat, strict=True), key=lambda pair: pair[0])]
    rows = np.hstack([wide[0], *rest]).astype(np.float64)
    good = (rows[:, 5] == answers.person) & (rows[:, 4] >= answers.threshold)
    return _corners(rows[good, :2], rows[good, 2:4]), rows[good, 4]


def _corners(corner: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    return np.hstack([corner, opposite - corner])


def _centred(centre: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.hstack([centre - size / 2, size])


LAYOUTS: Mapping[str, OutputLayout] = {
    layout.name: layout
    for layout in (
        OutputLayout("nanodet", lambda answers: _nanodet(0.5, answers), "bgr", "imagenet", True, 0),
        OutputLayout("nanodet-plus", lambda answers: _nanodet(0.0, answers), "bgr", "imagenet", True, 0),
        OutputLayout("yolox", _yolox, "bgr", "0-255", False, 114),
        OutputLayout("yolov5", _yolov5, "rgb", "0-1", True, 114),
        OutputLayout("yolov8", _yolov8, "rgb", "0-1", True, 114),
        OutputLayout("detections", _detections, "rgb", "0-1", False, 0),
    )
}
