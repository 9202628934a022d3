"""Times and numbers of accepted messages, kept on disk across restarts.

A restarted receiver has lost the numbers of its messages. If the clock of a sender is ahead, a command that was
executed before the restart can have a time after it. Receivers therefore note how far the times of a sender's accepted
messages reach, and refuse everything up to there after a restart.

Times do not suffice if the clock was set back meanwhile: it then reaches the times of old commands once more. So
receivers note the last number of each stream as well.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from socialbot.core.clock import SECOND
from socialbot.core.paths import user_folder
from socialbot.core.reading import read_bytes

log = logging.getLogger("socialbot.security")

RESERVED_S = 0.05
"""Time (s) that is noted in advance, so that a receiver writes at most twenty times a second for each sender."""

LOCKED_S = 0.1
"""Longest time (s) to wait for other processes, each of which needs microseconds."""

_BYTES = 8
_STREAMS = ".streams"  # no name of a sender begins with a dot
_ID_BYTES = 16
_ENTRY_BYTES = _ID_BYTES + _BYTES
_GROUPS, _GROUP_BYTES = 128, 32 * _ENTRY_BYTES


@dataclass(eq=False)
class AcceptedTimes:
    """Latest times (ns) of accepted messages by sender, and their numbers, in files that all processes of a user share.

    Attributes:
        folder: Holds a file for each sender, and one for the last 4096 streams; made when it is needed.
    """

    folder: Path
    _reserved: dict[str, int] = field(default_factory=dict, init=False)
    _files: dict[str, int] = field(default_factory=dict, init=False)
    _failed: bool = field(default=False, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def __post_init__(self) -> None:
        kept = {file.name: read_bytes(file) for file in self._kept()}
        self._streams = kept.pop(_STREAMS, b"")
        self._before = {name: _value(data) for name, data in kept.items()}

    def before(self, sender: str) -> int:
        """The time up to which earlier processes may have accepted messages of ``sender``; 0 if none did."""
        return self._before.get(sender, 0)

    def number(self, sender: str, stream: str) -> int:
        """The last number of ``stream`` that earlier processes accepted; -1 if none did."""
        place, name = _entry(sender, stream)
        return _number(self._streams[place : place + _GROUP_BYTES], name)

    def note(self, sender: str, stream: str, number: int, time: int) -> None:
        """Note that a message from ``time`` (ns) is about to be accepted. Logs once while that cannot be written."""
        try:
            self._note_time(sender, time)
            self._note_number(sender, stream, number)
        except OSError as error:
            if not self._failed:
                log.warning(
                    "cannot note accepted messages in %s (%s): a sender whose clock is ahead could be replayed after a "
                    "restart, and any sender if the clock of this machine is set back; see docs/security.md",
                    self.folder,
                    error.strerror,
                )
            self._failed = True
        else:
            self._failed = False

    def _note_time(self, sender: str, time: int) -> None:
        if time <= self._reserved.get(sender, 0):
            return
        reserved = self._reserved[sender] = time + round(RESERVED_S * SECOND)
        with self._locked(sender) as file:
            if _value(os.pread(file, _BYTES, 0)) < reserved:
                os.pwrite(file, reserved.to_bytes(_BYTES, "big"), 0)

    def _note_number(self, sender: str, stream: str, number: int) -> None:
        """Write an entry at the begin of its group, whose oldest entry may be lost."""
        place, name = _entry(sender, stream)
        with self._locked(_STREAMS) as file:
            group = os.pread(file, _GROUP_BYTES, place)
            entry = name + max(number, _number(group, name)).to_bytes(_BYTES, "big")
            if not group.startswith(entry):
                rest = (each for each in _entries(group) if each[:_ID_BYTES] != name)
                os.pwrite(file, b"".join((entry, *rest))[:_GROUP_BYTES], place)

    @contextmanager
    def _locked(self, name: str) -> Iterator[int]:
        """Lock a file, also against other threads. Raises OSError if another process holds it, which may be stopped."""
        with self._lock:
            file = self._file(name)
            end = time.monotonic() + (0.0 if self._failed else LOCKED_S)
            while not _is_locked(file, last=time.monotonic() >= end):
                time.sleep(LOCKED_S / 100)
            try:
                yield file
            finally:
                fcntl.flock(file, fcntl.LOCK_UN)

    def _kept(self) -> list[Path]:
        try:
            return [file for file in self.folder.iterdir() if file.is_file() and os.access(file, os.R_OK)]
        except OSError:
            return []

    def _file(self, name: str) -> int:
        if name not in self._files:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _expect_own(self.folder)
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            self._files[name] = os.open(self.folder / name, flags, 0o600)
        return self._files[name]

    def __del__(self) -> None:
        for file in self._files.values():
            os.close(file)


def state_folder(realm: str, keys: Path, name: str) -> Path:
    """The folder of `AcceptedTimes` for messages of a ``realm``, read with the key ``name`` in the folder ``keys``.

    It stays the same when the key is replaced. Raises ParameterError if the user has no home folder.
    """
    base = user_folder("XDG_STATE_HOME", ".local/state") / "socialbot"
    machine = b"\n".join((realm.encode(), name.encode(), os.fsencode(keys.resolve())))
    return base / "accepted" / hashlib.sha256(machine).hexdigest()[:16]


def _expect_own(folder: Path) -> None:
    """Raise PermissionError if another user can change the files of a folder, as one that was prepared in /tmp."""
    found = folder.stat()
    if found.st_mode & 0o022 or os.getuid() not in (0, found.st_uid):
        raise PermissionError(errno.EPERM, "other users can change the folder", str(folder))


def _is_locked(file: int, *, last: bool) -> bool:
    """Try to lock a file; return whether that succeeded. The ``last`` attempt raises OSError."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if last:
            raise
        return False
    return True


def _entry(sender: str, stream: str) -> tuple[int, bytes]:
    """Place of the group of a stream in the file of streams, and the name of its entry."""
    digest = hashlib.sha256(f"{sender}\n{stream}".encode()).digest()
    return digest[-1] % _GROUPS * _GROUP_BYTES, digest[:_ID_BYTES]


def _entries(group: bytes) -> Iterator[bytes]:
    return (group[place : place + _ENTRY_BYTES] for place in range(0, len(group), _ENTRY_BYTES))


def _number(group: bytes, name: bytes) -> int:
    """Number of the entry of this name; -1 if there is none."""
    found = (each[_ID_BYTES:] for each in _entries(group) if each[:_ID_BYTES] == name)
    return int.from_bytes(next(found, b""), "big") if name in group else -1


def _value(data: bytes) -> int:
    return int.from_bytes(data, "big") if len(data) == _BYTES else 0
