"""Channel between a node process and its supervisor, for reports of node states and commands.

It is a pair of local sockets: private to both processes, and closed when either ends.
"""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping

CHANNEL_VARIABLE = "SOCIALBOT_LIFELINE"
"""The environment variable with the file descriptor of the channel."""

_MAX_BYTES = 4096


class SupervisorChannel:
    """End of a channel. A message is a node name and a word; delivery is atomic."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self.broken = False

    def fileno(self) -> int:
        """The file descriptor, for ``select``."""
        return self._end.fileno()

    def send(self, node: str, word: str, /) -> None:
        """Send ``word`` about ``node``; thread-safe. Never blocks: a full buffer drops the message."""
        try:
            self._end.send(f"{node} {word}".encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.broken = True

    def receive(self) -> list[tuple[str, str]]:
        """The node names and words received since the last call; sets ``broken`` after a disconnect."""
        received = []
        while (message := self._receive(socket.MSG_DONTWAIT)) is not None:
            received.append(message)
        return received

    def wait(self) -> tuple[str, str] | None:
        """Wait for the next node name and word; None after a disconnect."""
        return self._receive(0)

    def close(self) -> None:
        self.broken = True
        self._end.close()

    def _receive(self, flags: int) -> tuple[str, str] | None:
        if self.broken:
            return None
        try:
            data = self._end.recv(_MAX_BYTES, flags)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            data = b""
        if not data:
            self.broken = True
            return None
        node, _, word = data.decode(errors="replace").partition(" ")
        return node, word


def channel_pair() -> tuple[SupervisorChannel, socket.socket]:
    """Return the supervisor's end, and the socket of the process to start."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return SupervisorChannel(ours), theirs


def own_channel(environment: MutableMapping[str, str] = os.environ) -> SupervisorChannel | None:
    """The channel to the supervisor of this process, if any. Child processes do not inherit it."""
    number = environment.pop(CHANNEL_VARIABLE, "")
    if not number:
        return None
    os.set_inheritable(int(number), False)
    return SupervisorChannel(socket.socket(fileno=int(number)))
