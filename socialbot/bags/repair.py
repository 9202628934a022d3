"""Repair damaged bags: truncated MCAP files, and clocks that were wrong or were set."""

from __future__ import annotations

import contextlib
import io
import logging
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.reading import open_file

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _DATA_END = 1, 2, 15
_KNOWN = range(_FOOTER + 1, _DATA_END)
_NO_INDEX = struct.pack("<BQ", _FOOTER, 20) + bytes(20) + MAGIC
_PROFILE = struct.pack("<I4s", 4, b"ros2")
_LONGEST_HEADER = 1 << 16


@dataclass(frozen=True)
class Mended:
    """Path-like .mcap file: ``head``, then the bytes of ``path`` up to ``whole`` of ``size``, then ``tail``."""

    path: Path
    whole: int
    size: int
    tail: bytes = b""
    head: bytes = b""

    @property
    def suffix(self) -> str:
        return self.path.suffix

    def __str__(self) -> str:
        return str(self.path)

    def exists(self) -> bool:
        return self.path.exists()

    def is_dir(self) -> bool:
        return False

    def open(self, mode: str = "rb") -> BinaryIO:
        """Open the three parts as one file, for reading."""
        return io.BufferedReader(_Joined(open_file(self.path), self.whole, self.head, self.tail), 1 << 16)


class _Joined(io.RawIOBase):
    """First ``length`` bytes of a file, which begin with ``head`` in place of their own, followed by ``tail``."""

    def __init__(self, file: BinaryIO, length: int, head: bytes, tail: bytes) -> None:
        self._file, self._length, self._position = file, length, 0
        self._head, self._tail = head, tail

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        origin = (0, self._position, self._length + len(self._tail))[whence]
        self._position = max(origin + offset, 0)
        return self._position

    def readinto(self, buffer: memoryview, /) -> int:  # type: ignore[override]
        left = self._length - self._position
        if self._position < len(self._head):
            part = self._head[self._position : self._position + len(buffer)]
        elif left > 0:
            self._file.seek(self._position)
            part = self._file.read(min(len(buffer), left))
        else:
            part = self._tail[-left : len(buffer) - left]
        buffer[: len(part)] = part
        self._position += len(part)
        return len(part)

    def close(self) -> None:
        self._file.close()
        super().close()


def with_profile_of_ros2(path: Path) -> Mended | None:
    """The .mcap file at ``path`` with the profile "ros2" in its header, without which rosbags does not read it.

    Recorders of other systems leave the profile empty, and converters of ROS 1 bags write "ros1". None if the header
    has this profile, is damaged or has no room for it.
    """
    with contextlib.suppress(OSError), open_file(path) as file:
        start = file.read(len(MAGIC) + 13)
        if len(start) < len(MAGIC) + 13 or start[: len(MAGIC)] != MAGIC or start[len(MAGIC)] != _HEADER:
            return None
        length, profile = struct.unpack_from("<QI", start, len(MAGIC) + 1)
        room = length - len(_PROFILE) - 4
        if length > _LONGEST_HEADER or room < 0 or file.read(profile) == _PROFILE[4:]:
            return None
        # Its bytes take those of the name of the library.
        head = start[: len(MAGIC) + 9] + _PROFILE + struct.pack("<I", room) + bytes(room)
        size = path.stat().st_size
        return Mended(path, size, size, head=head)
    return None


def salvage(path: Path) -> Mended | None:
    """Find the intact records of the .mcap file at ``path``; None if it does not begin as one."""
    size = path.stat().st_size
    with open_file(path) as file:
        whole = len(MAGIC)
        if file.read(whole) != MAGIC:
            return None
        while len(head := file.read(9)) == 9:
            kind, end = head[0], file.tell() + int.from_bytes(head[1:], "little")
            if kind not in (_KNOWN if whole > len(MAGIC) else (_HEADER,)) or end > size:
                break
            whole = file.seek(end)
    return Mended(path, whole, size, _NO_INDEX) if whole > len(MAGIC) else None


log = logging.getLogger("socialbot.bags")

CLOCKS_APART_S = 1.0
"""Smallest clock offset that is corrected if stamps lie in the future."""
MAX_LAG_S = 5.0
"""Longest time from an image to its reception on one machine; a longer one means that a clock is wrong."""
LEAP_S = 3600.0
"""Maximum pause; a longer one means that the clock was set during the recording."""


class Receptions:
    """Correction of reception times in the bag ``name``: removes leaps above ``LEAP_S``."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._offset = 0
        self._last: int | None = None

    def next(self, time: int) -> int:
        """Correct the time (ns) of a message received at ``time``."""
        set_right = time + self._offset
        if self._last is not None and set_right - self._last > nanoseconds(LEAP_S):
            ahead = set_right - self._last
            log.warning("%s: the clock leaps ahead by %.0f s; corrected", self._name, ahead / SECOND)
            self._offset -= ahead
            set_right = self._last
        self._last = set_right
        return set_right


class Stamps:
    """Correction of the header stamps of one topic to plausible times on the clock of the reception.

    Args:
        topic: Name for warnings.
        offset: Clock offset (ns) to add, from `clock_offsets`.
        repeats: Whether a stamp may repeat; images need different stamps.
        slack_s: How far a stamp may go back, on a topic of several publishers.
    """

    def __init__(self, topic: str, *, offset: int = 0, repeats: bool = True, slack_s: float = 0.0) -> None:
        self._topic = topic
        self._offset = offset
        self._repeats = repeats
        self._slack = nanoseconds(slack_s)
        self._stamp: int | None = None
        self._time = 0
        self._warned = False
        if offset:
            log.warning("%s: the clock of the sender is %.1f s off; corrected", topic, -offset / SECOND)

    def next(self, header: int, time: int) -> int:
        """Correct the stamp (ns) ``header`` of a message received at ``time``."""
        last = self._stamp
        if header > 0:
            header += self._offset
        why = ""
        if header <= 0:
            why = "are zero"
        elif last is not None and header < last - self._slack:
            why = "go backwards"
        elif last is not None and header == last and not self._repeats:
            why = "repeat"
        elif header - time > nanoseconds(CLOCKS_APART_S):
            why = "lie in the future"
        if why and not self._warned:
            self._warned = True
            log.warning("%s: header stamps %s; the times of reception are used instead", self._topic, why)
        stamp = header if not why else time if last is None else last + max(time - self._time, 0)
        self._stamp, self._time = stamp if last is None else max(stamp, last), time
        return stamp


def clock_offsets(lags: Mapping[str, int]) -> dict[str, int]:
    """Clock offset (ns) to add to the stamps of each topic: that of its machine, or 0.

    Topics with similar lags come from one machine. Its clock is wrong if its fastest topic arrives before its stamp, or
    more than `MAX_LAG_S` after it: processing in the robot delays images by a second or two.

    Args:
        lags: Time (ns) from the header stamp to the reception of the first message, by topic.
    """
    offsets: dict[str, int] = {}
    machine: list[int] = []
    for topic, lag in sorted(lags.items(), key=lambda each: each[1]):
        if machine and lag - machine[-1] > nanoseconds(MAX_LAG_S):
            machine = []
        machine.append(lag)
        is_right = -nanoseconds(CLOCKS_APART_S) <= machine[0] <= nanoseconds(MAX_LAG_S)
        offsets[topic] = 0 if is_right else machine[0]
    return offsets


def nearest_offset(lag: int, lags: Mapping[str, int], offsets: Mapping[str, int]) -> int:
    """Clock offset (ns) of a topic with this ``lag`` (ns): that of the topic of `clock_offsets` with a similar one.

    It is 0 if there is none, so that the topic comes from another machine.
    """
    nearest = min(lags, key=lambda topic: abs(lags[topic] - lag), default=None)
    return 0 if nearest is None or abs(lags[nearest] - lag) > nanoseconds(MAX_LAG_S) else offsets[nearest]
