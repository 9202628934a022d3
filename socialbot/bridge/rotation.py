"""Logs that do not fill the disk: what grows too long is moved to .1, what was there to .2, and so on."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


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
