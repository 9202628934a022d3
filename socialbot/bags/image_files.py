"""Images and videos from files, within the limits of `socialbot.core.limits`."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError
from socialbot.core.limits import DECODER_BYTES, DECODER_FRAMES, IMAGE_PIXELS, JPEG_SCANS
from socialbot.core.memory_limit import memory_limit
from socialbot.core.reading import open_file, read_bytes

SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"})
"""Suffixes of images in a folder."""

_UNREAD_SUFFIXES = frozenset({".avif", ".dng", ".gif", ".heic", ".heif", ".jfif", ".jp2", ".jxl"})

DEFAULT_RATE_HZ = 30.0
"""Rate of a video that does not say it."""

READ_DEEP = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
"""Flags that decode a file to three channels of its own depth."""

_REMEDY = "remove or replace this image"
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_SCAN = b"\xff\xda"
_EXIF = b"Exif\0\0"
_EXIF_KEYS = (b"Raw profile type exif", b"Raw profile type APP1")
_EXIF_TEXT_BYTES = 1 << 20

_FILLED = 0x4000  # Values of 16 bits that span so much keep their upper 8 bits.
_LEAST_SPAN = 0x200  # Images of a smaller span show the noise of a covered camera.
_LEAST_PIXELS = 4096  # Smaller images do not show their range.
_TAILS = (0.2, 99.8)  # Percentiles of the range: single pixels may be defective.
_SAMPLED_WIDTH = 160

_VIDEO_MARKS = (
    *((4, name.encode()) for name in ("ftyp", "moov", "mdat", "moof", "free", "skip", "wide", "styp")),  # MP4
    *((8, name) for name in (b"AVI ", b"AVIX")),
    (0, b"\x1a\x45\xdf\xa3"),  # Matroska, WebM
    *((at, b"\x47") for at in (188, 196)),  # MPEG transport stream, of a camcorder
    *((0, name) for name in (b"\0\0\1", b"\0\0\0\1")),  # MPEG program stream; H.264 and H.265 without container
    *((0, name) for name in (b"OggS", b"FLV", b"GIF8", b"DKIF", b"YUV4MPEG2 ")),
    (0, b"\x30\x26\xb2\x75"),  # ASF, WMV
    (0, b"\x06\x0e\x2b\x34"),  # MXF
    (0, b"\xff\xd8\xff"),  # motion JPEG
)
"""Bytes that tell the format of a video, each after its place in the file."""
_BEGIN_BYTES = 200


def read_image(path: Path) -> np.ndarray:
    """Decode an image file: shape (height, width, 3), uint8, BGR, turned as its EXIF orientation says.

    Raises ImageError if it cannot be read or decoded, or has more than `IMAGE_PIXELS`.
    """
    try:
        data = read_bytes(path)
    except OSError as error:
        raise ImageError(error.strerror or str(error), where=str(path), remedy="check the path") from error
    return decode_image(data, where=str(path), turned=True)


def unread_images(folder: Path) -> str:
    """What to tell of images in a folder whose formats are not read, such as those of phones; empty without any."""
    found = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in _UNREAD_SUFFIXES)
    count = f"{len(found)} image{'s are' if len(found) > 1 else ' is'}"
    return f"{count} left out, the first: {found[0]}; convert to jpg or png" if found else ""


def read_depth(path: Path) -> np.ndarray:
    """Decode a depth image of 16 bits: shape (height, width), uint16. Raises ImageError for another file."""
    try:
        data = read_bytes(path)
    except OSError as error:
        raise ImageError(error.strerror or str(error), where=str(path), remedy="check the path") from error
    try:
        flags = cv2.IMREAD_UNCHANGED
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if is_complete_png(data) else None
    except cv2.error:
        pixels = None
    if pixels is None or pixels.ndim != 2 or pixels.dtype != np.uint16 or pixels.size > IMAGE_PIXELS:
        raise ImageError("no depth image: a PNG of 16 bits with one channel", where=str(path), remedy=_REMEDY)
    return pixels


def decode_image(data: bytes, *, where: str, turned: bool = False) -> np.ndarray:
    """Decode the content of an image file as `read_image` does; as stored unless ``turned``. Errors name ``where``."""
    if data.startswith(_PNG) and not is_complete_png(data):
        raise ImageError("the file is truncated", where=where, remedy=_REMEDY)
    if has_too_many_scans(data):
        raise ImageError(f"more than {JPEG_SCANS} scans", where=where, remedy=_REMEDY)
    try:
        flags = READ_DEEP if turned else READ_DEEP | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(_with_plain_exif(data), np.uint8), flags) if data else None
    except cv2.error as error:
        what = too_many_pixels() if "MAX_IMAGE_PIXELS" in str(error) else f"cannot be decoded: {error.err}"
        raise ImageError(what, where=where, remedy=_REMEDY) from error
    if pixels is None:
        raise ImageError("cannot be decoded", where=where, remedy=_REMEDY)
    if pixels.shape[0] * pixels.shape[1] > IMAGE_PIXELS:
        raise ImageError(too_many_pixels(), where=where, remedy=_REMEDY)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"has values of type {pixels.dtype}", where=where, remedy="convert it to 8 or 16 bits")
    return eight_bits(pixels)


def _with_plain_exif(data: bytes) -> bytes:
    """Put the EXIF of a PNG or WebP where OpenCV reads it: many programs write it as text, or with a prefix of JPEG."""
    if data.startswith(_PNG):
        return _with_plain_exif_of_png(data)
    at = 12 if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else len(data)
    while at + 8 <= len(data):
        kind, length = struct.unpack_from("<4sI", data, at)
        begin, at = at + 8, at + 8 + length + length % 2
        if kind == b"EXIF" and data.startswith(_EXIF, begin) and length > len(_EXIF):
            end = begin + length
            return data[:begin] + data[begin + len(_EXIF) : end] + bytes(len(_EXIF)) + data[end:]
    return data


def _with_plain_exif_of_png(data: bytes) -> bytes:
    """Replace the first text of a PNG that holds EXIF, or its part eXIf with a prefix. A valid eXIf counts alone."""
    found = None
    for kind, begin, end in _png_parts(data):
        if kind == b"eXIf" and not data.startswith(_EXIF, begin):
            return data
        exif = data[begin + len(_EXIF) : end] if kind == b"eXIf" else _exif_in_text(kind, data[begin:end])
        if exif and (found is None or kind == b"eXIf"):
            found = exif, begin - 8, end + 4
    if found is None:
        return data
    (exif, begin, end), head = found, len(_PNG) + 25
    part = b"eXIf" + exif
    part = struct.pack(">I", len(exif)) + part + struct.pack(">I", zlib.crc32(part))
    return data[:head] + part + data[head:begin] + data[end:]


def _exif_in_text(kind: bytes, content: bytes) -> bytes:
    """EXIF in a text part of a PNG: a name, the length, and hexadecimal digits. Empty without one, or if damaged."""
    key, _, text = content.partition(b"\0")
    if kind not in (b"tEXt", b"zTXt", b"iTXt") or key not in _EXIF_KEYS:
        return b""
    is_compressed = kind == b"zTXt" or (kind == b"iTXt" and text[:1] == b"\1")
    if kind == b"zTXt":
        text = text[1:]  # behind the method
    elif kind == b"iTXt":
        text = text[2:].split(b"\0", 2)[-1]  # behind the method, the language and the translated key
    try:
        text = zlib.decompressobj().decompress(text, _EXIF_TEXT_BYTES) if is_compressed else text
        digits = b"".join(text.split()[2:])
        exif = bytes.fromhex(digits[: len(digits) // 2 * 2].decode("ascii")).removeprefix(_EXIF)
    except (zlib.error, ValueError):
        return b""
    return exif if exif[:4] in (b"II*\0", b"MM\0*") else b""


def _png_parts(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind of each part of a PNG, and begin and end of its content. The last end may be behind that of the file."""
    at, kind = len(_PNG), b""
    while kind != b"IEND" and at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        yield kind, at + 8, at + 8 + length
        at += 12 + length


def eight_bits(values: np.ndarray) -> np.ndarray:
    """Reduce an image of 16 bits to 8, grey or with channels in the last axis; one of 8 bits is returned unchanged.

    Values that span a quarter of the range keep their upper 8 bits. Others, as of sensors of 10, 12 or 14 bits, are
    scaled to the whole range. Those of grey images begin at the darkest pixel: thermal cameras have an offset.
    """
    if values.dtype == np.uint8:
        return values
    step = max(1, values.shape[1] // _SAMPLED_WIDTH)
    sample = values[::step, ::step].reshape(-1, 1 if values.ndim == 2 else values.shape[2])
    is_grey = bool((sample == sample[:, :1]).all())
    low, high = np.percentile(sample[:, :1] if is_grey else sample, _TAILS).tolist()
    low = low if is_grey else 0.0
    if high - low >= _FILLED or values.shape[0] * values.shape[1] < _LEAST_PIXELS:
        return (values >> 8).astype(np.uint8)
    scaled = (np.arange(0x10000) - low) * (255 / max(high - low, _LEAST_SPAN))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)[values]


def is_complete_png(data: bytes) -> bool:
    """Whether a PNG has its end: otherwise OpenCV would allocate the length that the last part gives."""
    kind, end = b"", 0
    for part, _, behind in _png_parts(data):
        kind, end = part, behind
    return kind == b"IEND" and end + 4 <= len(data)


def has_too_many_scans(data: bytes) -> bool:
    """Whether a JPEG has more than `JPEG_SCANS`."""
    return data.startswith(_JPEG) and data.count(_SCAN) > JPEG_SCANS


def open_video(path: str | Path) -> cv2.VideoCapture:
    """Open a video file. Raises ImageError if it is none, or its frames have more than `IMAGE_PIXELS`."""
    check_video(path)
    with memory_limit(DECODER_BYTES):
        capture = cv2.VideoCapture(str(path))
    if capture.isOpened() and _pixels(capture) <= IMAGE_PIXELS:
        return capture
    what = too_many_pixels() if capture.isOpened() else "cannot be opened as a video"
    capture.release()
    raise ImageError(what, where=str(path), remedy="convert it to mp4, avi or mkv, with smaller frames")


def decoder_limit(capture: cv2.VideoCapture) -> AbstractContextManager[None]:
    """Context manager that limits the memory of the decoder, which reads further frames in its block.

    A few bytes of an MP4 file can ask for an index of gigabytes. The video then ends.
    """
    return memory_limit(DECODER_BYTES + DECODER_FRAMES * 3 * int(min(_pixels(capture), IMAGE_PIXELS)))


def _pixels(capture: cv2.VideoCapture) -> float:
    return capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT)


def check_video(path: str | Path) -> None:
    """Raise ImageError if a file is no container of a video. A playlist may go on without end, and name any file."""
    try:
        with open_file(path) as file:  # a pipe would be waited for
            begin = file.read(_BEGIN_BYTES)
    except OSError as error:
        raise ImageError(error.strerror or str(error), where=str(path), remedy="check the path") from error
    if not any(begin[at : at + len(mark)] == mark for at, mark in _VIDEO_MARKS):
        remedy = "convert it to mp4, avi or mkv"
        raise ImageError("cannot be opened as a video: no known format", where=str(path), remedy=remedy)


def video_stamps(capture: cv2.VideoCapture) -> Iterator[int]:
    """Take the images of a video one after the other; yields their stamps, ns, from 0 and ascending."""
    rate = capture.get(cv2.CAP_PROP_FPS)
    period = round(SECOND / (rate if 0 < rate <= 1000 else DEFAULT_RATE_HZ))
    first = last = None
    while _grabs(capture):
        time = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        first = time if first is None else first
        # Some containers have no time stamps, and some repeat them.
        last = 0 if last is None else time - first if time - first > last else last + period
        yield last


def _grabs(capture: cv2.VideoCapture) -> bool:
    with decoder_limit(capture):
        return capture.grab()


def too_many_pixels() -> str:
    """Describe a violation of the limit."""
    return f"more than {IMAGE_PIXELS / 1e6:.0f} million pixels"
