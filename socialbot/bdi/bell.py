"""A bell that wakes a sleeping thread: a pipe, as the kernel wakes its reader in half the time a lock takes."""

from __future__ import annotations

import contextlib
import os
import select


class Bell:
    """Rings from any thread; one thread waits for it. Rings while nobody waits are remembered as one."""

    def __init__(self) -> None:
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._poll = select.poll()
        self._poll.register(self._reader, select.POLLIN)

    def ring(self) -> None:
        """Wakes the thread that waits, or the next one that would."""
        with contextlib.suppress(BlockingIOError):  # it rings already, and nobody has heard it yet
            os.write(self._writer, b"!")

    def wait(self, seconds: float | None = None) -> None:
        """Sleeps until it rings, for ``seconds`` at most."""
        if seconds is None or self._poll.poll(max(0.0, seconds * 1000)):
            os.read(self._reader, 65536)

    def __del__(self) -> None:
        # Not before: while somebody may still ring, the number of the pipe must not become that of another file.
        os.close(self._reader)
        os.close(self._writer)
