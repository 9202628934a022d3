"""Convert ROS image encodings to BGR pixels and JPEG, as functions and as a node."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from socialbot.bags.image_files import READ_DEEP, eight_bits, has_too_many_scans, is_complete_png
from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError
from socialbot.core.limits import IMAGE_PIXELS, JPEG_SCANS
from socialbot.core.messages import CompressedImage, Image
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output

Pixels = np.ndarray
_EIGHT_BITS = {"bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "8UC4": 4, "rgba8": 4, "mono8": 1, "8UC1": 1,
               "bayer_rggb8": 1, "bayer_bggr8": 1, "bayer_gbrg8": 1, "bayer_grbg8": 1}  # fmt: skip
_SIXTEEN_BITS = {re.sub("^8|8$", "16", name): name for name in _EIGHT_BITS}
_SUBSAMPLED = {"yuv422": 2, "uyvy": 2, "yuv422_yuy2": 2, "yuyv": 2}
_PLANAR = {"nv12": cv2.COLOR_YUV2BGR_NV12, "nv21": cv2.COLOR_YUV2BGR_NV21}
_BYTES = {**_EIGHT_BITS, **{name: 2 * _EIGHT_BITS[alike] for name, alike in _SIXTEEN_BITS.items()},
          **_SUBSAMPLED, **dict.fromkeys(_PLANAR, 1), "nv24": 1}  # fmt: skip
_CODES = {"rgb8": cv2.COLOR_RGB2BGR, "bgra8": cv2.COLOR_BGRA2BGR, "8UC4": cv2.COLOR_BGRA2BGR,
          "rgba8": cv2.COLOR_RGBA2BGR, "mono8": cv2.COLOR_GRAY2BGR, "8UC1": cv2.COLOR_GRAY2BGR,
          "yuv422": cv2.COLOR_YUV2BGR_UYVY, "uyvy": cv2.COLOR_YUV2BGR_UYVY,
          "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2, "yuyv": cv2.COLOR_YUV2BGR_YUY2,
          # OpenCV's older two-letter names describe the second row; these describe the first, as ROS does.
          "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR, "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR,
          "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR, "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR}  # fmt: skip

ENCODINGS = tuple(_BYTES)
"""Every encoding that `bgr_from_image` takes."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_MARKER = re.compile(rb"\xff([^\x00\xff])", re.DOTALL)
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_WITHOUT_CONTENT = frozenset({0x01, *range(0xD0, 0xD8)})


def bgr_from_image(image: Image) -> Pixels:
    """Decode ``image``: shape (height, width, 3), uint8, BGR.

    A bgr8 image is not copied: the pixels are a view of its data. Raises ImageError for an unknown encoding or a size
    that the data does not fill.
    """
    rows, encoding = _rows(image), image.encoding
    if encoding in _PLANAR:
        return cv2.cvtColor(rows, _PLANAR[encoding])
    if encoding == "nv24":
        return _from_nv24(rows, image)
    if encoding in _SIXTEEN_BITS:
        encoding = _SIXTEEN_BITS[encoding]
        deep = np.ascontiguousarray(rows).view(">u2" if image.is_bigendian else "<u2").astype(np.uint16)
        rows = eight_bits(deep if _BYTES[encoding] == 1 else deep.reshape(image.height, image.width, -1))
    if encoding in ("bgr8", "8UC3"):
        return rows.reshape(image.height, image.width, 3)
    samples = _BYTES[encoding]
    shape = (image.height, image.width) if samples == 1 else (image.height, image.width, samples)
    return cv2.cvtColor(rows.reshape(shape), _CODES[encoding])


def _from_nv24(luma: Pixels, image: Image) -> Pixels:
    """Convert a plane of brightness with a plane of colours of full size behind it."""
    step, used = _step(image), 2 * image.width
    stride = step if step >= used else 2 * step
    flat = np.asarray(image.data).reshape(-1)[image.height * step :]
    needed = (image.height - 1) * stride + used
    if flat.size < needed:
        raise ImageError(
            f"{image.data.size} bytes where {image.height * step + needed} bytes are needed",
            where=f"nv24 image of {image.width}x{image.height}",
            remedy="check the driver's encoding, width, height and step",
        )
    colours = np.lib.stride_tricks.as_strided(flat, (image.height, used), (stride * flat.strides[0], flat.strides[0]))
    u, v = (cv2.LUT(np.ascontiguousarray(colours[:, first::2]), _FULL_COLOUR) for first in (0, 1))
    return cv2.cvtColor(cv2.merge([cv2.LUT(luma, _FULL_BRIGHTNESS), v, u]), cv2.COLOR_YCrCb2BGR)


_VALUES = np.arange(256)
_FULL_BRIGHTNESS = np.clip(np.rint((_VALUES - 16) * 255 / 219), 0, 255).astype(np.uint8)
_FULL_COLOUR = np.clip(np.rint((_VALUES - 128) * 255 / 224 + 128), 0, 255).astype(np.uint8)
"""Values of the whole range by those of video (BT.601), 16 to 235 and 16 to 240."""


def _step(image: Image) -> int:
    """Bytes of a row of ``image``. Some drivers give another step for planes that lie close together."""
    size = {"nv12": 1.5, "nv21": 1.5, "nv24": 3.0}.get(image.encoding, 0.0) * image.width * image.height
    return image.width if size and image.data.size == size else image.step


def _rows(image: Image) -> Pixels:
    """The bytes of ``image`` without padding: (height, width * bytes per pixel), and half as many planar rows again.

    Of nv24 only the plane of brightness.
    """

    def refused(what: str, remedy: str) -> ImageError:
        return ImageError(what, where=f"{image.encoding} image of {image.width}x{image.height}", remedy=remedy)

    if image.encoding not in _BYTES:
        raise refused(f"unknown encoding {image.encoding!r}", f"have the camera publish one of {', '.join(ENCODINGS)}")
    if image.width <= 0 or image.height <= 0:
        raise refused("no pixels", "check the camera driver's width and height")
    sides = {"width": image.width, "height": image.height if image.encoding in _PLANAR else 0}
    for name, side in sides.items() if image.encoding in (*_SUBSAMPLED, *_PLANAR) else ():
        if side % 2:
            remedy = f"set the driver to a {name} of {side - 1} or {side + 1}, or to bgr8"
            raise refused(f"two pixels share their colour, so the {name} must be even", remedy)
    if image.encoding.startswith("bayer") and min(image.width, image.height) < 3:
        raise refused("too small to interpolate colours", "use 3x3 pixels or more")
    used = image.width * _BYTES[image.encoding]
    step = _step(image)
    if step < used:
        raise refused(f"a row has {image.step} bytes (step) but needs {used}", "check the driver's encoding")
    # Some drivers leave out the padding of the last row.
    height = image.height * 3 // 2 if image.encoding in _PLANAR else image.height
    needed = (height - 1) * step + used
    flat = np.asarray(image.data).reshape(-1)
    if flat.dtype != np.uint8 or flat.size < needed:
        what = f"{flat.size} values of type {flat.dtype} where {needed} bytes are needed"
        raise refused(what, "check the driver's encoding, width, height and step")
    return np.lib.stride_tricks.as_strided(
        flat, (height, used), (step * flat.strides[0], flat.strides[0]), writeable=flat.flags.writeable
    )


def bgr_from_compressed(image: CompressedImage) -> Pixels:
    """Decode a JPEG or PNG: shape (height, width, 3), uint8, BGR.

    ``format`` is that of image_transport or others: "jpeg", "jpg", "png", "rgb8; jpeg compressed bgr8", "bgr8; png
    compressed ". With "compressed rgb", red and blue are exchanged in the file, and exchanged again here. An
    orientation in the file is ignored, since CameraInfo describes the sensor. A file without a known ``format`` is
    recognised by its first bytes.

    Raises ImageError for another format, no data, a damaged or truncated file, and more than `IMAGE_PIXELS`.
    """

    def refused(what: str, remedy: str) -> ImageError:
        return ImageError(what, where=f"image of format {image.format!r}, {image.data.size} bytes", remedy=remedy)

    words = image.format.lower()
    if "compresseddepth" in words:
        raise refused("a depth image, not a picture", "connect a topic with pictures")
    data = np.ascontiguousarray(image.data, dtype=np.uint8).reshape(-1)
    if not data.size:
        raise refused("no data", "check the camera and its driver")
    file = data.tobytes()
    # Some drivers leave the format empty, or give only the encoding.
    if not any(kind in words for kind in ("jpeg", "jpg", "png")) and not file.startswith((_PNG, _JPEG)):
        remedy = "connect the topic of its raw images, or have the camera publish jpeg or png"
        raise refused("unknown format", f"{remedy}; for others and for video: ros2 run image_transport republish")
    width, height = _size(file)
    if width * height > IMAGE_PIXELS:
        remedy = f"send images of {IMAGE_PIXELS / 1e6:.0f} million pixels at most"
        raise refused(f"{width}x{height} pixels are too many", remedy)
    if width * height and not (is_complete_png if file.startswith(_PNG) else _is_complete_jpeg)(file):
        raise refused("the file is truncated", "check the camera's cable and bandwidth")
    if has_too_many_scans(file):
        raise refused(f"more than {JPEG_SCANS} scans", "have the camera publish baseline JPEG")
    pixels, why = None, ""
    try:
        if width * height:
            pixels = cv2.imdecode(data, READ_DEEP | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        why = f" ({error})"
    if pixels is None:
        raise refused(f"cannot be decoded{why}", "check that the data is what its format says")
    pixels = eight_bits(pixels)
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


def _is_complete_jpeg(data: bytes) -> bool:
    """Whether a JPEG has its end: otherwise OpenCV would fill the rest with grey, without an error."""
    # A thumbnail has its own end, hence the search behind the last start of scan.
    return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")


WIDTH = 640
QUALITY = 80


def as_jpeg(image: Image | CompressedImage, width: int = WIDTH) -> bytes:
    """Encode ``image`` as JPEG, at most ``width`` pixels wide; a JPEG is returned unchanged. Raises ImageError."""
    if isinstance(image, CompressedImage):
        data = bytes(image.data)
        if data.startswith(_JPEG):
            return data
        pixels = bgr_from_compressed(image)
    else:
        pixels = bgr_from_image(image)
    height, whole = pixels.shape[:2]
    if whole > width:
        pixels = cv2.resize(pixels, (width, max(1, round(height * width / whole))), interpolation=cv2.INTER_AREA)
    return encode_jpeg(pixels, QUALITY).tobytes()


def encode_jpeg(pixels: Pixels, quality: int) -> np.ndarray:
    """Encode BGR pixels as JPEG: uint8, shape (n,). Raises ImageError if they have no JPEG."""
    done, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ImageError("cannot be encoded as JPEG", where=f"image of {pixels.shape[1]}x{pixels.shape[0]}")
    return data.reshape(-1)


_COPY_NS = 2 * SECOND  # An image is a copy if the other input is ahead of it by less than this.
_STILL_S, _PLAIN_S, _TIMELESS_S = 10.0, 3.0, 2.0
"""Time of equal images, of images of one colour, and of equal stamps, that is reported."""
_PLAIN_LEVELS = 16  # difference of the values in an image of one colour, with the noise of a covered camera
_SAMPLED = 8  # of so many rows and columns, one is compared


class _ImageWatch:
    """Tells images that show nothing: always the same one, as of a frozen camera, or one colour."""

    def __init__(self) -> None:
        self._last: Pixels | None = None
        self._changed_at = self._seen_at = self._ticked_at = 0
        self._stamp = -1

    def stands_still(self, stamp: int, now: int) -> bool:
        """Whether images have had the same ``stamp`` for long."""
        if stamp != self._stamp:
            self._stamp, self._ticked_at = stamp, now
        return now - self._ticked_at >= _TIMELESS_S * SECOND

    def problem(self, pixels: Pixels, now: int) -> str:
        """Return why the images up to ``now`` (ns) show nothing; empty if they show something."""
        sample = pixels[::_SAMPLED, ::_SAMPLED].transpose(2, 0, 1).copy()  # by colour: its extremes are found faster
        if self._last is None or not np.array_equal(sample, self._last):
            self._changed_at = now
        self._last = sample
        low, high = sample.min(axis=(1, 2)), sample.max(axis=(1, 2))
        if self._seen_at == 0 or (high - low).max() > _PLAIN_LEVELS:
            self._seen_at = now
        if now - self._seen_at >= _PLAIN_S * SECOND:
            kind = "black" if high.max() <= 2 * _PLAIN_LEVELS else "of one colour"
            return f"the images are {kind}: check the cover, exposure and light of the camera"
        if now - self._changed_at >= _STILL_S * SECOND:
            return "the images do not change at all: a camera shows at least noise, so its driver may be frozen"
        return ""


class ImageConverter(Node):
    """Publishes each raw or compressed image as bgr8, with the same stamp and frame.

    An image that cannot be converted raises ImageError and is skipped. The health of the node tells images that are
    all the same, black, or of one colour. It is degraded while all images have the same stamp: nothing moves then.
    With both inputs connected, an image that came on one is skipped on the other.
    """

    image_raw = Input(Image, "/camera/image_raw", Delivery.NEWEST, deadline_s=SILENT_S)
    image_compressed = Input(
        CompressedImage, "/camera/image_raw/compressed", Delivery.NEWEST, deadline_s=SILENT_S, alternative_to=image_raw
    )
    image_color = Output(Image, "/camera/image_color", Delivery.NEWEST)

    @classmethod
    def external_files(cls, parameters: Mapping[str, object]) -> Sequence[Path]:
        return ()

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._watch = _ImageWatch()
        self._problem = ""
        self._newest: dict[type[Image | CompressedImage], int] = {}
        """Stamp (ns) of the newest image of each input."""

    @image_raw
    def on_image(self, image: Image) -> None:
        if self._is_copy(image):
            return
        pixels = bgr_from_image(image)
        self._look(pixels, image)
        if image.encoding == "bgr8" and pixels.base is not None and image.data.size == pixels.size:
            self.image_color.publish(image)  # nothing to convert: the same message, without a copy
        else:
            self._publish(pixels, image)

    @image_compressed
    def on_compressed(self, image: CompressedImage) -> None:
        if self._is_copy(image):
            return
        pixels = bgr_from_compressed(image)
        self._look(pixels, image)
        self._publish(pixels, image)

    def _is_copy(self, image: Image | CompressedImage) -> bool:
        """Whether the other input has this image, or a newer one: drivers publish them raw and compressed."""
        others = (stamp for kind, stamp in self._newest.items() if kind is not type(image))
        return any(0 <= other - image.stamp < _COPY_NS for other in others)

    def _look(self, pixels: Pixels, image: Image | CompressedImage) -> None:
        self._newest[type(image)] = stamp = image.stamp
        now, state = self.clock.now(), "ok"
        problem = self._watch.problem(pixels, now)
        if self._watch.stands_still(stamp, now):
            state, problem = (
                "degraded",
                "all images have the same stamp; set header.stamp in the driver at each exposure",
            )
        if problem != self._problem:
            self._problem = problem
            self.report_health(state, problem)

    def _publish(self, pixels: np.ndarray, source: Image | CompressedImage) -> None:
        self.image_color.publish(Image.from_bgr(pixels, stamp=source.stamp, frame_id=source.frame_id))
