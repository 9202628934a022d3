"""The line between a process and the supervisor that has started it: how its nodes are, and what they are to do.

A pair of local sockets: nobody else can speak on it, and it breaks when the process at either end is gone.
"""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping

LIFELINE_VARIABLE = "SOCIALBOT_LIFELINE"
"""Names the file by which a supervised process speaks to its supervisor."""

BEAT_S = 0.5
"""How often a node that is well says so."""

LONGEST = 4096


class SupervisorChannel:
    """One end of the line. What is said is the name of a node and a word; each is heard whole or not at all."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self.broken = False

    def fileno(self) -> int:
        """For ``select``."""
        return self._end.fileno()

    def say(self, node: str, word: str) -> None:
        """Says ``word`` about ``node``, from any thread. It never waits: who does not listen, does not hear it."""
        try:
            self._end.send(f"{node} {word}".encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.broken = True

    def hear(self) -> list[tuple[str, str]]:
        """Nodes and words that have come since; none when the line is ``broken``."""
        heard = []
        while (word := self._receive(socket.MSG_DONTWAIT)) is not None:
            heard.append(word)
        return heard

    def wait(self) -> tuple[str, str] | None:
        """Waits for the next node and word; None when the line is broken."""
        return self._receive(0)

    def close(self) -> None:
        """Breaks the line."""
        self.broken = True
        self._end.close()

    def _receive(self, flags: int) -> tuple[str, str] | None:
        if self.broken:
            return None
        try:
            said = self._end.recv(LONGEST, flags)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            said = b""
        if not said:
            self.broken = True
            return None
        node, _, word = said.decode(errors="replace").partition(" ")
        return node, word


def lifelines() -> tuple[SupervisorChannel, socket.socket]:
    """The end for a supervisor, and the one for the process that it is about to start."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return SupervisorChannel(ours), theirs


def own_lifeline(environment: MutableMapping[str, str] = os.environ) -> SupervisorChannel | None:
    """The line to the supervisor of this process, if it has one; processes that it starts do not get it."""
    number = environment.pop(LIFELINE_VARIABLE, "")
    if not number:
        return None
    os.set_inheritable(int(number), False)
    return SupervisorChannel(socket.socket(fileno=int(number)))
