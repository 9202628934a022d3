"""The channel between a node process and its supervisor: reports of node states, and commands.

The channel is a pair of local sockets. No other process can use it, and it closes when either process ends.
"""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping

CHANNEL_VARIABLE = "SOCIALBOT_LIFELINE"
"""The environment variable with the file descriptor of the channel."""

_MAX_BYTES = 4096


class SupervisorChannel:
    """One end of the channel. A message is a node name and a word; it arrives whole or not at all."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self.broken = False

    def fileno(self) -> int:
        """The file descriptor, for ``select``."""
        return self._end.fileno()

    def send(self, node: str, word: str, /) -> None:
        """Send ``word`` about ``node``, from any thread. Never blocks: a full buffer drops the message."""
        try:
            self._end.send(f"{node} {word}".encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.broken = True

    def receive(self) -> list[tuple[str, str]]:
        """The nodes and words received since the last call; sets ``broken`` when the other end is closed."""
        received = []
        while (message := self._receive(socket.MSG_DONTWAIT)) is not None:
            received.append(message)
        return received

    def wait(self) -> tuple[str, str] | None:
        """Wait for the next node and word; None when the channel is broken."""
        return self._receive(0)

    def close(self) -> None:
        """Close this end."""
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
    """The end for the supervisor, and the socket for the process that it starts."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return SupervisorChannel(ours), theirs


def own_channel(environment: MutableMapping[str, str] = os.environ) -> SupervisorChannel | None:
    """The channel to the supervisor of this process, if any. Child processes do not inherit it."""
    number = environment.pop(CHANNEL_VARIABLE, "")
    if not number:
        return None
    os.set_inheritable(int(number), False)
    return SupervisorChannel(socket.socket(fileno=int(number)))
