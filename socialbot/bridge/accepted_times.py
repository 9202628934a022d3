"""Times of accepted messages, kept on disk across restarts.

A restarted receiver has lost the numbers of its messages. If the clock of a sender is ahead, a command that was
executed before the restart can have a time after it. Receivers therefore note how far the times of a sender's accepted
messages reach, and refuse everything up to there after a restart.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
from dataclasses import dataclass, field
from pathlib import Path

from socialbot.core.clock import SECOND
from socialbot.core.reading import read_bytes

log = logging.getLogger("socialbot.security")

RESERVED_S = 0.05
"""Time (s) that is noted in advance, so that a receiver writes at most twenty times a second for each sender."""

_BYTES = 8


@dataclass(eq=False)
class AcceptedTimes:
    """Latest times (ns) of accepted messages by sender, in files that all processes of a user share.

    Attributes:
        folder: Holds a file for each sender; made when it is needed.
    """

    folder: Path
    _reserved: dict[str, int] = field(default_factory=dict, init=False)
    _files: dict[str, int] = field(default_factory=dict, init=False)
    _failed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._before = {file.name: _value(read_bytes(file)) for file in self._kept()}

    def before(self, sender: str) -> int:
        """The time up to which earlier processes may have accepted messages of ``sender``; 0 if none did."""
        return self._before.get(sender, 0)

    def note(self, sender: str, time: int) -> None:
        """Note that a message from ``time`` (ns) is about to be accepted. Logs once while that cannot be written."""
        if time <= self._reserved.get(sender, 0):
            return
        reserved = self._reserved[sender] = time + round(RESERVED_S * SECOND)
        try:
            file = self._file(sender)
            fcntl.flock(file, fcntl.LOCK_EX)
            try:
                if _value(os.pread(file, _BYTES, 0)) < reserved:
                    os.pwrite(file, reserved.to_bytes(_BYTES, "big"), 0)
            finally:
                fcntl.flock(file, fcntl.LOCK_UN)
        except OSError as error:
            if not self._failed:
                log.warning(
                    "cannot note accepted messages in %s (%s): a sender whose clock is ahead could be replayed after a "
                    "restart; see docs/security.md",
                    self.folder,
                    error.strerror,
                )
            self._failed = True
        else:
            self._failed = False

    def _kept(self) -> list[Path]:
        try:
            return [file for file in self.folder.iterdir() if file.is_file() and os.access(file, os.R_OK)]
        except OSError:
            return []

    def _file(self, sender: str) -> int:
        if sender not in self._files:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._files[sender] = os.open(self.folder / sender, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        return self._files[sender]

    def __del__(self) -> None:
        for file in self._files.values():
            os.close(file)


def state_folder(realm: str, own_key: str) -> Path:
    """The folder of `AcceptedTimes` for messages of a ``realm``, read with the key of this fingerprint."""
    base = Path(os.environ.get("XDG_STATE_HOME") or Path("~/.local/state").expanduser()) / "socialbot"
    return base / "accepted" / hashlib.sha256(f"{realm}\n{own_key}".encode()).hexdigest()[:16]


def _value(data: bytes) -> int:
    return int.from_bytes(data, "big") if len(data) == _BYTES else 0
