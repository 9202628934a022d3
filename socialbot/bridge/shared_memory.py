"""Shared memory of Fast DDS: segments that ended processes left, and ports that others do not reach any more."""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import pwd
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from socialbot.core.reading import open_file

SHARED = Path("/dev/shm")

YOUNG_S = 3.0  # minimum age (s) of a stale segment; a younger one may not be locked yet
_LOCK = re.compile(r"fastrtps_[\da-z]{16}_el")
"""Locks of segments only. Testing the lock of a port could make a new process refuse it, and receive no images."""


def stale_locks(folder: Path = SHARED) -> Iterator[Path]:
    """Yield the lock files of unused segments in ``folder``."""
    now = _file_time(folder)
    for path in sorted(folder.glob("fastrtps_*_el")):
        with contextlib.suppress(OSError):  # deleted meanwhile, or owned by another user
            # A file from the future is from before the clock was set back.
            if _LOCK.fullmatch(path.name) and abs(now - path.stat().st_mtime) > YOUNG_S and is_free(path):
                yield path


def _file_time(folder: Path) -> float:
    """Modification time (s) that a file written now in ``folder`` has."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            return os.fstat(file.fileno()).st_mtime
    except OSError:
        return time.time()


def is_free(path: Path) -> bool:
    """Whether no process holds the lock file ``path``. The test holds it for a moment."""
    try:
        with open_file(path) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def remove_stale(folder: Path = SHARED) -> int:
    """Remove the shared-memory segments of ended processes, and return their number."""
    removed = 0
    for lock in stale_locks(folder):
        with contextlib.suppress(OSError):
            lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
            lock.unlink()
            removed += 1
    return removed


_PORT = re.compile(r"fastrtps_port(\d+)")


def other_users(domain: int, folder: Path = SHARED) -> list[str]:
    """Names of other users who use a ROS domain. DDS gives node names and images only to the same user."""
    ports = range(7400 + 250 * domain, 7650 + 250 * domain)
    found: set[int] = set()
    for path in folder.glob("fastrtps_port*"):
        if (name := _PORT.fullmatch(path.name)) and int(name[1]) in ports:
            with contextlib.suppress(FileNotFoundError):
                found.add(path.stat().st_uid)
    return sorted(map(_user_name, found - {os.getuid()}))


def _user_name(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


CHECK_S = 1.0
"""Shortest time (s) between two checks of ports."""
SCAN_S = 10.0
"""Longest time (s) after which new ports are looked for."""
LOST_PORT = "messages in shared memory"
"""What a process with a lost port does not receive."""
LOST_CHECKS = 3
"""Checks in a row that find a port lost. A reader opens the new file of its port within a tenth of a second."""
_PORT_LOCK = re.compile(r"(fastrtps_port\d+)_el(?: \(deleted\))?")


@dataclass(eq=False)
class PortWatch:
    """Watch over the ports of the process ``pid``: the queues in shared memory that it reads.

    A port is a file. While its reader is paused, those who write to it replace the file, again and again. Fast DDS 2.14
    lets two processes do so at once (`~Port` in SharedMemGlobal.hpp removes the mutex that they share). Then the reader
    waits at a file that nobody finds by its name, for ever. Only a new DDS participant has a new port.

    Attributes:
        pid: Process id.
        clock: Steady clock (s).
        folder: Folder of the shared memory.
        ports: Files of the ports that could be reached, with their inodes.
    """

    pid: int
    clock: Callable[[], float] = time.monotonic
    folder: Path = SHARED
    ports: dict[Path, int] = field(default_factory=dict, init=False)
    _lost: int = field(default=0, init=False)
    """Number of checks in a row that found a lost port."""
    _checked_at: float = field(default=-math.inf, init=False)
    _scanned_at: float = field(default=-math.inf, init=False)

    def is_lost(self, alive_at: float) -> bool:
        """Whether others do not reach a port any more. Call it often.

        ``alive_at`` is the last time (s) at which the process was seen to run. A paused one replaces its ports later.
        """
        now = self.clock()
        if now - self._checked_at >= CHECK_S and alive_at > self._checked_at:
            self._checked_at = now
            self._lost = 0 if self._is_reached(now) else self._lost + 1
        return self._lost >= LOST_CHECKS

    def _is_reached(self, now: float) -> bool:
        if now - self._scanned_at < SCAN_S and all(_inode(file) == inode for file, inode in self.ports.items()):
            return True
        try:
            files = {self.folder / name for name in self._names()}
            mapped = self._mapped() if files else set()
        except OSError:  # ended, or of another user
            return True
        found = {file: _inode(file) for file in files}
        self.ports = {file: inode for file, inode in found.items() if inode in mapped}
        is_reached = len(self.ports) == len(files)
        self._scanned_at = now if is_reached else -math.inf
        return is_reached

    def _names(self) -> Iterator[str]:
        """Yield the names of the ports that the process reads: it has their lock files open."""
        for link in Path(f"/proc/{self.pid}/fd").iterdir():
            with contextlib.suppress(OSError):  # closed meanwhile
                folder, _, name = os.readlink(link).rpartition("/")
                if folder == str(self.folder) and (lock := _PORT_LOCK.fullmatch(name)):
                    yield lock[1]

    def _mapped(self) -> set[int]:
        """Return the inodes of the ports that the process has in its memory."""
        lines = Path(f"/proc/{self.pid}/maps").read_text("utf-8", "replace").splitlines()
        return {int(line.split()[4]) for line in lines if "/fastrtps_port" in line}


def _inode(file: Path) -> int:
    """Inode of ``file``; 0 if it does not exist."""
    try:
        return file.stat().st_ino
    except OSError:
        return 0
