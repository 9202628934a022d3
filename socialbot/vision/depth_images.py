"""Decode depth images, compressed depth images and point clouds."""

from __future__ import annotations

import math
import struct
from array import array
from typing import Protocol

import cv2
import numpy as np

from socialbot.bags.image_files import is_complete_png
from socialbot.core.errors import ImageError
from socialbot.core.limits import IMAGE_PIXELS
from socialbot.core.messages import CompressedImage, Image, PointCloud

NEAREST_M, FARTHEST_M = 0.15, 80.0
"""Range of valid measurements."""

_MM = 0.001
_NO_RETURN = 65535
_PNG = b"\x89PNG\r\n\x1a\n"
_CONFIG = struct.Struct("<iff")  # Format, and two parameters of the quantisation.
_POINT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def raw_depth(image: Image) -> np.ndarray:
    """Pixels of a depth image in their own type and byte order, without a copy.

    Raises ImageError for another encoding, or a size that the data does not fill.
    """

    def refused(what: str) -> ImageError:
        return ImageError(
            what,
            where=f"{image.encoding} depth image of {image.width}x{image.height}",
            remedy="have the depth camera publish 16UC1 (mm) or 32FC1 (m)",
        )

    kind = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}.get(image.encoding)
    if kind is None:
        raise refused(f"no depth encoding: {image.encoding!r}")
    dtype = np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<")
    used = image.width * dtype.itemsize
    data = np.ascontiguousarray(image.data, np.uint8).reshape(-1)
    if min(image.width, image.height) < 1 or image.step < used or data.size < (image.height - 1) * image.step + used:
        raise refused(f"{data.size} bytes do not fill it with rows of {image.step} bytes")
    return np.ndarray((image.height, image.width), dtype, data.data, strides=(image.step, dtype.itemsize))


def depth_in_metres(raw: np.ndarray) -> np.ndarray:
    """Depth along the optical axis in metres (float32), NaN where there is none, of integers in mm or floats in m."""
    if raw.dtype.kind == "u":
        metres = raw.astype(np.float32) * np.float32(_MM)
        metres[raw == _NO_RETURN] = np.nan
    else:
        metres = raw.astype(np.float32)
    with np.errstate(invalid="ignore"):
        metres[~((metres >= NEAREST_M) & (metres <= FARTHEST_M))] = np.nan
    return metres


def unpacked_depth(image: CompressedImage) -> np.ndarray:
    """Pixels of a compressed depth image: integers in mm, or floats in m.

    ``format`` is that of compressed_depth_image_transport ("16UC1; compressedDepth", "32FC1; compressedDepth rvl",
    "passthrough; compressedDepth"), or of a 16-bit PNG ("16UC1; png compressed").

    Raises ImageError for another format, a damaged file, and more than `IMAGE_PIXELS`.
    """

    def refused(what: str, remedy: str = "check the depth camera and its driver") -> ImageError:
        return ImageError(what, where=f"depth of format {image.format!r}, {image.data.size} bytes", remedy=remedy)

    data = np.ascontiguousarray(image.data, np.uint8).reshape(-1).tobytes()
    encoding, _, codec = image.format.partition(";")
    first, second = 0.0, 0.0
    if not data.startswith(_PNG) and len(data) > _CONFIG.size:
        _, first, second = _CONFIG.unpack_from(data)
        data = data[_CONFIG.size :]
    if data.startswith(_PNG):
        pixels = _png(data, refused)
    elif "jpeg" in codec.lower() or data.startswith(b"\xff\xd8"):
        raise refused("JPEG destroys depth", "record the raw topic or compressedDepth")
    elif "rvl" in codec.lower():
        pixels = _rvl(data, refused)
    else:
        raise refused("neither PNG nor RVL", "record the raw topic, or compressedDepth as png or rvl")
    encoding = encoding.strip()
    quantised = encoding == "32FC1" or (encoding not in ("16UC1", "mono16") and first > 0)
    if not quantised:
        return pixels
    if not (math.isfinite(first) and math.isfinite(second) and first > 0):
        raise refused(f"the quantisation {first:g}, {second:g} is invalid")
    levels = pixels.astype(np.float32) - np.float32(second)
    metres = np.full(pixels.shape, np.nan, np.float32)
    return np.divide(np.float32(first), levels, out=metres, where=(pixels > 0) & (levels > 0))


class _Refusal(Protocol):
    def __call__(self, what: str, remedy: str = ..., /) -> ImageError: ...


def _png(data: bytes, refused: _Refusal) -> np.ndarray:
    width, height = struct.unpack_from(">II", data, 16) if len(data) >= 24 else (0, 0)
    if width * height > IMAGE_PIXELS:
        raise refused(f"{width}x{height} pixels are too many", "use a lower resolution")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if is_complete_png(data) else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise refused("the PNG is damaged")
    if pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise refused(f"a PNG of {pixels.dtype} and {pixels.ndim - 1} dimensions is no depth image")
    return pixels


def _rvl(data: bytes, refused: _Refusal) -> np.ndarray:
    """Decode run-length and variable-length coded depth: differences of neighbours in groups of 3 bits."""
    width, height = struct.unpack_from("<II", data) if len(data) >= 8 else (0, 0)
    count = width * height
    if not 0 < count <= IMAGE_PIXELS:
        raise refused(f"{width}x{height} pixels cannot be")
    if len(data) > _RVL_HEAD + _RVL_PIXEL * count:
        raise refused(f"{len(data)} bytes of RVL data are too many for {width}x{height} pixels")
    numbers = _rvl_numbers(data[8 : 8 + (len(data) - 8) // 4 * 4])
    if numbers is None:
        raise refused("the RVL data is damaged")
    # Runs of pixels with depth: number of their first code, of their first pixel, and of their pixels.
    runs = array("q")
    values, at, index = numbers.data, 0, 0
    while at < count and index + 1 < len(values):
        at, filled = at + values[index], values[index + 1]
        index += 2
        if at + filled > count or index + filled > len(values) or (not filled and at < count):
            break
        runs.extend((index, at, filled))
        at, index = at + filled, index + filled
    if at != count:
        raise refused("the RVL data is damaged")
    first, place, filled = np.frombuffer(runs, np.int64).reshape(-1, 3).T
    within = np.arange(filled.sum()) - np.repeat(np.cumsum(filled) - filled, filled)
    codes = numbers[np.repeat(first, filled) + within]
    pixels = np.zeros(count, np.uint16)
    pixels[np.repeat(place, filled) + within] = np.cumsum((codes >> 1) ^ -(codes & 1)).astype(np.uint16)
    return pixels.reshape(height, width)


_RVL_HEAD, _RVL_PIXEL = 32, 4
"""Most bytes of RVL data: a pixel has up to 6 groups of 4 bits, and its run 2."""
_LONGEST_NUMBER = 11  # groups


def _rvl_numbers(data: bytes) -> np.ndarray | None:
    """Numbers of RVL data: each ends at a group without the continuation bit. None if one has too many groups."""
    words = np.frombuffer(data, "<u4").byteswap().view(np.uint8)
    groups = np.empty(2 * words.size, np.uint8)
    groups[0::2], groups[1::2] = words >> 4, words & 15
    ends = np.flatnonzero(groups < 8)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = (ends - starts + 1).astype(np.uint8) if ends.size and (ends - starts).max() < _LONGEST_NUMBER else None
    if lengths is None:
        return None
    numbers = np.zeros(ends.size, np.int64)
    for group in range(int(lengths.max())):
        longer = np.flatnonzero(lengths > group)
        numbers[longer] |= (groups[starts[longer] + group] & 7).astype(np.int64) << (3 * group)
    return numbers


def points_of(cloud: PointCloud) -> np.ndarray:
    """Points of a cloud in its frame: shape (n, 3), float32, metres, without invalid ones.

    Raises ImageError without fields x, y and z, or for a size that the data does not fill.
    """

    def refused(what: str) -> ImageError:
        where = f"point cloud of {cloud.width}x{cloud.height} in {cloud.frame_id!r}"
        return ImageError(what, where=where, remedy="check the driver of the lidar or depth camera")

    fields = {each.name: each for each in cloud.fields}
    types = {name: _POINT_TYPES.get(fields[name].datatype) for name in "xyz" if name in fields}
    if len(types) < 3 or None in types.values():
        raise refused(f"no fields x, y, z among {', '.join(fields) or 'none'}")
    count = cloud.width * cloud.height
    if not count:
        return np.empty((0, 3), np.float32)
    order = ">" if cloud.is_bigendian else "<"
    kinds = {name: np.dtype(f"{order}{kind}") for name, kind in types.items()}
    end = max(fields[name].offset + kind.itemsize for name, kind in kinds.items())
    data = np.ascontiguousarray(cloud.data, np.uint8).reshape(-1)
    row = cloud.row_step if cloud.height > 1 else cloud.width * cloud.point_step
    needed = (cloud.height - 1) * row + (cloud.width - 1) * cloud.point_step + end
    if end > cloud.point_step or row < cloud.width * cloud.point_step or data.size < needed:
        raise refused(f"{data.size} bytes do not fill it with points of {cloud.point_step} bytes")
    points = np.empty((cloud.height, cloud.width, 3), np.float32)
    for axis, (name, kind) in enumerate(kinds.items()):
        view = np.ndarray((cloud.height, cloud.width), kind, data.data, fields[name].offset, (row, cloud.point_step))
        points[..., axis] = view
    points = points.reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1) & (np.abs(points) < FARTHEST_M).all(axis=1)]
