"""How a process ends on SIGINT and SIGTERM: well, with exit code 0, at whatever it is."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def end_well_on_signals() -> None:
    """From now on signals end the process with exit code 0; ones that came while they were blocked do so at once.

    One that comes while it is going already changes nothing.
    """
    atexit.register(_ignore_signals)
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda *_: sys.exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)


def _ignore_signals() -> None:
    # Python takes its handlers away before it lets go of modules, which takes long on a busy machine.
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class Ending:
    """Notes that SIGINT or SIGTERM came, or that the parent process is gone."""

    def __init__(self, parent: int | None = None) -> None:
        self._asked = False
        self._parent = parent

    @property
    def asked(self) -> bool:
        """Whether it is time to end."""
        return self._asked or (self._parent is not None and os.getppid() != self._parent)

    def ask(self, signum: int = 0, frame: FrameType | None = None) -> None:
        """Asks for the end; serves as a signal handler."""
        self._asked = True

    @contextmanager
    def on_signals(self) -> Iterator[Ending]:
        """Ends on SIGINT and SIGTERM within this context."""
        before = {number: signal.signal(number, self.ask) for number in ENDING_SIGNALS}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
