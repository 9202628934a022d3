"""Convert ROS image encodings to BGR pixels and JPEG, as functions and as a node."""

from __future__ import annotations

import re
import struct

import cv2
import numpy as np

from socialbot.core.errors import ImageError
from socialbot.core.messages import CompressedImage, Image
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Delivery, Input, Node, Output

__all__ = ["ENCODINGS", "ImageConverter", "MOST_PIXELS", "bgr_from_compressed", "bgr_from_image"]


Pixels = np.ndarray
_BYTES = {"bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "8UC4": 4, "rgba8": 4, "mono8": 1, "8UC1": 1,
          "mono16": 2, "16UC1": 2, "yuv422": 2, "uyvy": 2, "yuv422_yuy2": 2, "yuyv": 2,
          "bayer_rggb8": 1, "bayer_bggr8": 1, "bayer_gbrg8": 1, "bayer_grbg8": 1}  # fmt: skip
_CODES = {"rgb8": cv2.COLOR_RGB2BGR, "bgra8": cv2.COLOR_BGRA2BGR, "8UC4": cv2.COLOR_BGRA2BGR,
          "rgba8": cv2.COLOR_RGBA2BGR, "mono8": cv2.COLOR_GRAY2BGR, "8UC1": cv2.COLOR_GRAY2BGR,
          "yuv422": cv2.COLOR_YUV2BGR_UYVY, "uyvy": cv2.COLOR_YUV2BGR_UYVY,
          "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2, "yuyv": cv2.COLOR_YUV2BGR_YUY2,
          # OpenCV's older two-letter names speak of the second row; these speak of the first, as ROS does.
          "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR, "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR,
          "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR, "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR}  # fmt: skip
_SUBSAMPLED = frozenset({"yuv422", "uyvy", "yuv422_yuy2", "yuyv"})

ENCODINGS = tuple(_BYTES)
"""Every encoding that `bgr_from_image` takes."""

MOST_PIXELS = 1 << 25
"""Largest compressed image (8K): a small file may claim gigabytes of pixels."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_MARKER = re.compile(rb"\xff([^\x00\xff])", re.DOTALL)
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_WITHOUT_CONTENT = frozenset({0x01, *range(0xD0, 0xD8)})


def bgr_from_image(image: Image) -> Pixels:
    """Decode ``image``: shape (height, width, 3), uint8, BGR.

    A bgr8 image is not copied: the pixels are a view of its data. Raises ImageError for an
    unknown encoding or a size that the data does not fill.
    """
    rows = _rows(image)
    if image.encoding in ("bgr8", "8UC3"):
        return rows.reshape(image.height, image.width, 3)
    if image.encoding in ("mono16", "16UC1"):
        upper = rows[:, 0::2] if image.is_bigendian else rows[:, 1::2]
        return cv2.cvtColor(np.ascontiguousarray(upper), cv2.COLOR_GRAY2BGR)
    samples = _BYTES[image.encoding]
    shape = (image.height, image.width) if samples == 1 else (image.height, image.width, samples)
    return cv2.cvtColor(rows.reshape(shape), _CODES[image.encoding])


def _rows(image: Image) -> Pixels:
    """The bytes of ``image`` without padding: (height, width * bytes per pixel)."""
    where = f"{image.encoding} image of {image.width}x{image.height}"
    if image.encoding not in _BYTES:
        raise ImageError(
            f"unknown encoding {image.encoding!r}", where=where, remedy=f"have the camera publish one of {_listed()}"
        )
    if image.width <= 0 or image.height <= 0:
        raise ImageError("no pixels", where=where, remedy="check the camera driver's width and height")
    if image.encoding in _SUBSAMPLED and image.width % 2:
        raise ImageError(
            "two pixels share their colour, so the width must be even",
            where=where,
            remedy=f"set the driver to a width of {image.width - 1} or {image.width + 1}, or to bgr8",
        )
    if image.encoding.startswith("bayer") and min(image.width, image.height) < 3:
        raise ImageError("too small to interpolate colours", where=where, remedy="use 3x3 pixels or more")
    used = image.width * _BYTES[image.encoding]
    if image.step < used:
        raise ImageError(
            f"a row has {image.step} bytes (step) but needs {used}", where=where, remedy="check the driver's encoding"
        )
    # Some drivers leave out the padding of the last row.
    needed = (image.height - 1) * image.step + used
    flat = np.asarray(image.data).reshape(-1)
    if flat.dtype != np.uint8 or flat.size < needed:
        raise ImageError(
            f"{flat.size} values of type {flat.dtype} where {needed} bytes are needed",
            where=where,
            remedy="check the driver's encoding, width, height and step",
        )
    return np.lib.stride_tricks.as_strided(
        flat, (image.height, used), (image.step * flat.strides[0], flat.strides[0]), writeable=flat.flags.writeable
    )


def _listed() -> str:
    return ", ".join(ENCODINGS)


def bgr_from_compressed(image: CompressedImage) -> Pixels:
    """Decode a JPEG or PNG: shape (height, width, 3), uint8, BGR.

    ``format`` is what image_transport and others write: "jpeg", "jpg", "png", "rgb8; jpeg compressed
    bgr8", "bgr8; png compressed ". Where it says "compressed rgb" the file holds red and blue exchanged,
    and they are put back. An orientation in the file is ignored, as CameraInfo speaks of the sensor.

    Raises ImageError for another format, no data, a damaged or cut file, and more than `MOST_PIXELS`.
    """
    words = image.format.lower()
    where = f"image of format {image.format!r}, {image.data.size} bytes"
    kind = next((kind for kind in ("jpeg", "jpg", "png") if kind in words), "")
    if not kind or "compresseddepth" in words:
        raise ImageError("unknown format", where=where, remedy="have the camera publish jpeg or png")
    data = np.ascontiguousarray(image.data, dtype=np.uint8).reshape(-1)
    if not data.size:
        raise ImageError("no data", where=where, remedy="check the camera and its driver")
    file = data.tobytes()
    width, height = _size(file)
    if not width * height:
        raise ImageError("cannot be decoded", where=where, remedy="check that the data is what its format says")
    if width * height > MOST_PIXELS:
        raise ImageError(
            f"{width}x{height} pixels are too many",
            where=where,
            remedy=f"send images of {MOST_PIXELS / 1e6:.0f} million pixels at most",
        )
    if not _is_complete(file):
        raise ImageError("the file is cut short", where=where, remedy="check the camera's cable and bandwidth")
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise ImageError(f"cannot be decoded ({error})", where=where, remedy="check what publishes it") from error
    if pixels is None:
        raise ImageError("cannot be decoded", where=where, remedy="check that the data is what its format says")
    return cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if "compressed rgb" in words else pixels


def _size(data: bytes) -> tuple[int, int]:
    """Width and height that a JPEG or PNG gives in its header; zeros where there is none."""
    if data.startswith(_PNG) and len(data) >= 24:
        return struct.unpack_from(">II", data, 16)
    found = _MARKER.search(data, len(_JPEG)) if data.startswith(_JPEG) else None
    while found is not None and len(data) >= found.end() + 7:
        kind = found[1][0]
        if kind in _FRAMES:
            height, width = struct.unpack_from(">HH", data, found.end() + 3)
            return width, height
        (length,) = (0,) if kind in _WITHOUT_CONTENT else struct.unpack_from(">H", data, found.end())
        found = _MARKER.search(data, found.end() + length)
    return 0, 0


def _is_complete(data: bytes) -> bool:
    return _is_complete_png(data) if data.startswith(_PNG) else _is_complete_jpeg(data)


def _is_complete_png(data: bytes) -> bool:
    """False for a PNG without its end: OpenCV would make room for whatever length the last part gives."""
    at, kind = len(_PNG), b""
    while kind != b"IEND" and at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        at += 12 + length
    return kind == b"IEND" and at <= len(data)


def _is_complete_jpeg(data: bytes) -> bool:
    """False for a JPEG without its end: OpenCV would fill what is missing with grey and say nothing."""
    # A thumbnail has an end of its own, hence the search behind the last start of scan.
    return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")


WIDTH = 640
QUALITY = 80
_JPEG_OPTIONS = b"\xff\xd8"


def as_jpeg(image: Image | CompressedImage, width: int = WIDTH, quality: int = QUALITY) -> bytes:
    """``image`` as JPEG, at most ``width`` pixels wide; one that is a JPEG is left as it is. Raises ImageError."""
    if isinstance(image, CompressedImage):
        data = bytes(image.data)
        if data.startswith(_JPEG_OPTIONS):
            return data
        pixels = bgr_from_compressed(image)
    else:
        pixels = bgr_from_image(image)
    height, whole = pixels.shape[:2]
    if whole > width:
        pixels = cv2.resize(pixels, (width, max(1, round(height * width / whole))), interpolation=cv2.INTER_AREA)
    done, packed = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ImageError("the image cannot be encoded as JPEG")
    return packed.tobytes()


class ImageConverter(Node):
    """Publishes each raw or compressed image as bgr8, with the same stamp and frame.

    An image that cannot be converted raises ImageError and is skipped.
    """

    image_raw = Input(Image, "/camera/image_raw", Delivery.NEWEST, deadline_s=SILENT_S)
    image_compressed = Input(
        CompressedImage, "/camera/image_raw/compressed", Delivery.NEWEST, deadline_s=SILENT_S, alternative_to=image_raw
    )
    image_color = Output(Image, "/camera/image_color", Delivery.NEWEST)

    @image_raw
    def on_image(self, image: Image) -> None:
        pixels = bgr_from_image(image)
        if image.encoding == "bgr8" and pixels.base is not None and image.data.size == pixels.size:
            self.image_color.publish(image)  # nothing to convert: the same message, without a copy
        else:
            self._publish(pixels, image)

    @image_compressed
    def on_compressed(self, image: CompressedImage) -> None:
        self._publish(bgr_from_compressed(image), image)

    def _publish(self, pixels: np.ndarray, source: Image | CompressedImage) -> None:
        self.image_color.publish(Image.from_bgr(pixels, stamp=source.stamp, frame_id=source.frame_id))
