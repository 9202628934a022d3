"""Log files of limited size: a log with the newest lines, and rotation of external logs."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

PARTS = 4
"""Maximum number of parts, including the current one."""


def nothing() -> Iterable[bytes]:
    """Return no lines."""
    return ()


class BoundedLog:
    """Size-limited log file that keeps the newest lines; `write` flushes each line.

    With ``room`` (bytes), each full quarter of it becomes PATH.1, PATH.2 and so on; the oldest part is removed. Each
    part begins with the lines of ``opening``. Raises FileExistsError and other OSErrors.
    """

    def __init__(
        self, path: Path, max_bytes: int | None = None, opening: Callable[[], Iterable[bytes]] = nothing
    ) -> None:
        self._path = path
        self._longest = None if max_bytes is None else max_bytes // PARTS
        self._opening = opening
        self._number = 0
        self._file: BinaryIO = path.open("xb")

    def write(self, line: bytes) -> None:
        """Append ``line``, which has no newline."""
        if self._longest is not None and self._file.tell() >= self._longest:
            self._begin_part()
        self._file.write(line + b"\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    @property
    def size(self) -> int:
        """Total size of all parts in bytes."""
        return sum(part.stat().st_size for part in parts(self._path))

    def _begin_part(self) -> None:
        self._file.close()
        self._number += 1
        self._path.replace(_part(self._path, self._number))
        if (oldest := self._number - PARTS + 1) > 0:
            _part(self._path, oldest).unlink(missing_ok=True)
        self._file = self._path.open("xb")
        self._file.writelines(line + b"\n" for line in self._opening())


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
        if parts:
            shutil.copyfile(log, parts[0])
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
