"""Where pictures come from: a camera, a video file or a folder of images."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from socialbot.errors import DeviceError, ImageError

__all__ = ["Frames", "is_device", "open_frames"]

_IMAGES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"})
_USUAL_RATE_HZ = 30.0
_FOLDER_RATE_HZ = 10.0


class Frames(Protocol):
    """Pictures one after the other."""

    rate_hz: float
    """How many a second there are; for a folder, how many are usual."""
    size: tuple[int, int]
    """Width and height of the first picture, pixels."""

    def read(self) -> np.ndarray | None:
        """The next picture, shape (height, width, 3), uint8, blue first; None when there are no more.

        Raises ImageError for one that cannot be read; the one after it is read next time.
        """
        ...

    def close(self) -> None:
        """Gives the camera or file back."""
        ...


def is_device(source: str) -> bool:
    """Whether ``source`` names a camera: an index ("0") or a device file ("/dev/video0")."""
    return source.isdecimal() or source.startswith("/dev/")


def open_frames(source: str, *, width: int = 0, height: int = 0) -> Frames:
    """The pictures of ``source``; a camera is asked for ``width`` x ``height`` pixels (0: its own choice).

    Raises DeviceError when there is no such camera, file or folder, or nothing to read in it.
    """
    if is_device(source):
        return _CameraFrames(source, width, height)
    path = Path(source)
    if path.is_dir():
        return _FolderFrames(path)
    if path.is_file():
        return _VideoFrames(source)
    raise DeviceError("no such camera, video file or folder", where=repr(source), remedy="check the parameter 'source'")


class _VideoFrames:
    """A video file."""

    def __init__(self, source: str | int) -> None:
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            self._capture.release()
            raise DeviceError("cannot be opened", where=str(source), remedy="check that it is a video and not damaged")
        self._read_properties()

    def _read_properties(self) -> None:
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.rate_hz = rate if 0 < rate < 1000 else _USUAL_RATE_HZ
        self.size = (
            int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )

    def read(self) -> np.ndarray | None:
        good, pixels = self._capture.read()
        return pixels if good else None

    def close(self) -> None:
        self._capture.release()


class _CameraFrames(_VideoFrames):
    """A camera of this computer."""

    def __init__(self, source: str, width: int, height: int) -> None:
        path = f"/dev/video{source}" if source.isdecimal() else source
        # OpenCV complains at length on stderr about a device that is not there; asking first is quieter.
        if sys.platform == "linux" and not Path(path).exists():
            raise DeviceError("no such camera", where=path, remedy="plug it in, or choose one of /dev/video*")
        try:
            super().__init__(int(source) if source.isdecimal() else source)
        except DeviceError:
            remedy = "is another program using it? may you read it (group 'video')?"
            raise DeviceError("the camera cannot be opened", where=path, remedy=remedy) from None
        if width:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        if height:
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        # Without this a slow reader sees pictures that are several frames old.
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._read_properties()


class _FolderFrames:
    """The images of a folder in the order of their names, 2 before 10."""

    rate_hz = _FOLDER_RATE_HZ

    def __init__(self, folder: Path) -> None:
        self._paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in _IMAGES), key=_natural)
        self._next = 0
        if not self._paths:
            raise DeviceError("no images in this folder", where=str(folder), remedy="put jpg or png files there")
        height, width = _load(self._paths[0]).shape[:2]
        self.size = (width, height)

    def read(self) -> np.ndarray | None:
        if self._next == len(self._paths):
            return None
        self._next += 1
        return _load(self._paths[self._next - 1])

    def close(self) -> None:
        self._paths = self._paths[: self._next]


def _natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words], path.name


def _load(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None:
        raise ImageError("cannot be decoded", where=str(path), remedy="remove or replace this image")
    return pixels
