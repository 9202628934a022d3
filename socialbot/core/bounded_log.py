"""Log files of limited size: one that keeps the newest lines, and logs that are rotated."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

PARTS = 4
"""Of so many parts, with the one that is written, the oldest is given up when there is no room left."""


def nothing() -> Iterable[bytes]:
    """No lines."""
    return ()


class BoundedLog:
    """Appends lines to the new file ``path``; each is in the file before `write` returns.

    With ``room`` (bytes) the file is set aside as PATH.1, PATH.2 and so on, the newest with the highest number, each
    time that it has a fourth of that, and the oldest of these are removed. Each part begins with the lines ``opening``,
    for what is told only once. Raises FileExistsError and other OSErrors.
    """

    def __init__(self, path: Path, room: int | None = None, opening: Callable[[], Iterable[bytes]] = nothing) -> None:
        self._path = path
        self._longest = None if room is None else room // PARTS
        self._opening = opening
        self._number = 0
        self._file: BinaryIO = path.open("xb")

    def write(self, line: bytes) -> None:
        """Appends ``line``, which has no end of line."""
        if self._longest is not None and self._file.tell() >= self._longest:
            self._begin_part()
        self._file.write(line + b"\n")
        self._file.flush()

    def close(self) -> None:
        """Ends it."""
        self._file.close()

    @property
    def size(self) -> int:
        """So many bytes it has, in all parts."""
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
    """The files that the journal ``path`` is in, the oldest first."""
    aside = {_number(part): part for part in path.parent.glob(f"{path.name}.*")}
    return [*(part for number, part in sorted(aside.items()) if number), path]


def is_whole(path: Path) -> bool:
    """Whether the journal ``path`` still has its beginning."""
    return len(parts(path)) == 1 or _part(path, 1).exists()


def _part(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}")


def _number(part: Path) -> int:
    """The number of a part that was set aside; 0 for what is none."""
    digits = part.suffix[1:]
    return int(digits) if digits.isascii() and digits.isdigit() else 0


@dataclass(frozen=True)
class Rotation:
    """A log may grow to ``longest`` bytes; ``kept`` older parts of it are kept. Of the logs of ROS itself, ``most``."""

    longest: int = 5_000_000
    kept: int = 3
    most: int = 50

    def rotate(self, log: Path) -> bool:
        """Rotates ``log`` if it is too long; says whether it was.

        It stays the same file, as a process writes to it, which has to do so by appending. What it writes between the
        copy and the cut is lost.
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
        """Rotates ``logs``, and those that ROS writes itself, a new one for each process that is started."""
        for log in logs:
            self.rotate(log)
        by_age = sorted(ros_folder.glob("*.log"), key=lambda log: log.stat().st_mtime)
        for log in by_age[: -self.most]:
            log.unlink(missing_ok=True)
        for log in by_age[-self.most :]:
            self.rotate(log)
