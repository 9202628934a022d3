"""Log files of limited size: a log with the newest lines, and rotation of external logs."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from socialbot.core.paths import create_like
from socialbot.core.reading import open_file

PARTS = 4
"""Maximum number of parts, including the current one."""


def nothing() -> Iterable[bytes]:
    """Return no lines."""
    return ()


class BoundedLog:
    """Size-limited log file that keeps the newest lines; `write` writes each line whole or not at all.

    With ``max_bytes``, each full quarter of it becomes PATH.1, PATH.2 and so on; the oldest part is removed. Each
    part begins with the lines of ``opening``. Raises FileExistsError and other OSErrors.
    """

    def __init__(
        self, path: Path, max_bytes: int | None = None, opening: Callable[[], Iterable[bytes]] = nothing
    ) -> None:
        self._path = path
        self._longest = None if max_bytes is None else max_bytes // PARTS
        self._opening = opening
        self._number = 0
        self._length = 0
        self._file: FileIO = _new_file(path)

    def write(self, line: bytes) -> None:
        """Append ``line``, which has no newline. Raises OSError, and keeps no part of it."""
        if self._longest is not None and self._length >= self._longest:
            self._begin_part()
        self._append(line + b"\n")

    def close(self) -> None:
        self._file.close()

    @property
    def is_gone(self) -> bool:
        """Whether the file was removed, or moved with its folder, so that nobody will find it here."""
        return not self._path.exists() and not self._is_own(_part(self._path, self._number + 1))

    def _is_own(self, path: Path) -> bool:
        return path.exists() and os.path.samestat(os.fstat(self._file.fileno()), path.stat())

    def reopen(self) -> None:
        """Begin a new file, and its folder, after the old one is gone. Raises OSError."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        file = _new_file(self._path)
        self._file.close()
        self._file, self._length, self._number = file, 0, 0
        for line in self._opening():
            self._append(line + b"\n")

    def _append(self, data: bytes) -> None:
        written = 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            os.ftruncate(self._file.fileno(), self._length)
            self._file.seek(self._length)
            raise
        self._length += len(data)

    @property
    def size(self) -> int:
        """Total size of all parts in bytes."""
        return sum(part.stat().st_size for part in parts(self._path) if part.exists())

    def _begin_part(self) -> None:
        """Put the full part aside and begin a new one. After an OSError the full part is open, and this may go on."""
        aside = _part(self._path, self._number + 1)
        if not self._is_own(aside):
            if not self._is_own(self._path):  # the folder of another run is in the place of ours
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), self._path)
            self._path.replace(aside)
        if (oldest := self._number + 2 - PARTS) > 0:
            _part(self._path, oldest).unlink(missing_ok=True)
        file = _new_file(self._path)
        self._file.close()
        self._file, self._length, self._number = file, 0, self._number + 1
        for line in self._opening():
            self._append(line + b"\n")


def _new_file(path: Path) -> FileIO:
    """Open a new file, and lock it, so that `is_being_written` tells. Raises OSError."""
    file = path.open("xb", buffering=0)
    with contextlib.suppress(OSError):  # the file system may have no locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def is_being_written(path: Path) -> bool:
    """Check whether a process writes the log ``path``."""
    try:
        with open_file(path) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


RETRY_S = 1.0
"""Time (s) between two attempts to write to a disk that is full, read-only or gone."""


class LossyLog:
    """Bounded log that drops lines while they cannot be written, and goes on when they can. Threads may share it.

    Attributes:
        problem: Why lines cannot be written at present; empty if they can.
        lost: Number of dropped lines.
    """

    def __init__(self, log: BoundedLog, steady_s: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._steady_s = steady_s
        self._look_at = 0.0
        self._lock = threading.Lock()
        self.problem = ""
        self.lost = 0

    def write(self, line: bytes) -> None:
        """Append ``line``, or drop it."""
        now = self._steady_s()
        with self._lock:
            if self.problem and now < self._look_at:
                self.lost += 1
                return
            try:
                if now >= self._look_at:
                    self._look_at = now + RETRY_S
                    self._reopen_if_gone()
                self._log.write(line)
            except OSError as error:
                self.problem = error.strerror or str(error)
                self.lost += 1
            else:
                self.problem = ""

    def restore(self) -> None:
        """Make the file again if it was removed, even if there is nothing to write."""
        with self._lock:
            try:
                self._reopen_if_gone()
            except OSError as error:
                self.problem = error.strerror or str(error)

    def _reopen_if_gone(self) -> None:
        if self._log.is_gone:
            self._log.reopen()
            self.problem = ""

    def close(self) -> None:
        self._log.close()

    @property
    def size(self) -> int:
        """Total size of all parts in bytes."""
        return self._log.size


def parts(path: Path) -> list[Path]:
    """Return the parts of the log ``path``, oldest first."""
    aside = {_number(part): part for part in path.parent.glob(f"{path.name}.*")}
    return [*(part for number, part in sorted(aside.items()) if number), path]


def is_whole(path: Path) -> bool:
    """Check whether the log ``path`` still has its first part."""
    return len(parts(path)) == 1 or _part(path, 1).exists()


def _part(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}")


def _number(part: Path) -> int:
    """Return the number of an older part; 0 for any other file."""
    digits = part.suffix[1:]
    return int(digits) if digits.isascii() and digits.isdigit() else 0


@dataclass(frozen=True)
class Rotation:
    """Limits for log rotation: ``longest`` in bytes, ``kept`` older parts, ``most`` log files of ROS itself."""

    longest: int = 5_000_000
    kept: int = 3
    most: int = 50

    def rotate(self, log: Path) -> bool:
        """Rotate ``log`` if it is too long; return whether it was.

        The file is truncated in place, so its writer must append. Lines written between copy and truncation are lost.
        """
        try:
            if log.stat().st_size <= self.longest:
                return False
        except FileNotFoundError:
            return False
        parts = [log.with_name(f"{log.name}.{number}") for number in range(1, self.kept + 1)]
        for newer, older in reversed(list(itertools.pairwise(parts))):
            if newer.exists():
                newer.replace(older)
        with contextlib.suppress(OSError):  # on a full disk the old lines are lost
            if parts:
                parts[0].unlink(missing_ok=True)
                with open_file(log) as lines, create_like(log, parts[0]) as part:
                    shutil.copyfileobj(lines, part)
        os.truncate(log, 0)
        return True

    def rotate_all(self, logs: Sequence[Path], ros_folder: Path) -> None:
        """Rotate ``logs`` and the logs of ROS, which creates one per process."""
        for log in logs:
            self.rotate(log)
        by_age = sorted(ros_folder.glob("*.log"), key=lambda log: log.stat().st_mtime)
        for log in by_age[: -self.most]:
            log.unlink(missing_ok=True)
        for log in by_age[-self.most :]:
            self.rotate(log)
