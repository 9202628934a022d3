"""A bell that wakes a sleeping thread: a counter in the kernel, which does it in half the time that a lock takes."""

from __future__ import annotations

import os
import select

_ONE = (1).to_bytes(8, "little")


class Wakeup:
    """Rings from any thread; one thread waits for it. Rings while nobody waits are remembered as one."""

    def __init__(self) -> None:
        if hasattr(os, "eventfd"):
            self._reader = self._writer = os.eventfd(0)
        else:
            self._reader, self._writer = os.pipe()
            os.set_blocking(self._writer, False)
        self._poll = select.poll()
        self._poll.register(self._reader, select.POLLIN)

    def ring(self) -> None:
        """Wakes the thread that waits, or the next one that would."""
        # Nothing but the call of the system: who rings still runs when the sleeper wakes, and stands in its way.
        try:  # noqa: SIM105
            os.write(self._writer, _ONE)
        except BlockingIOError:
            pass  # A full pipe: it rings already, and nobody has heard it yet.

    def wait(self, seconds: float | None = None) -> None:
        """Sleeps until it rings, for ``seconds`` at most."""
        if seconds is None or self._poll.poll(max(0.0, seconds * 1000)):
            os.read(self._reader, 65536)

    def __del__(self) -> None:
        # Not before: while somebody may still ring, the number must not become that of another file.
        for number in {self._reader, self._writer}:
            os.close(number)
