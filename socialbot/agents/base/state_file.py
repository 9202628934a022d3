"""Files with the state of a node, from which it continues after a restart."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from socialbot.bdi import Engine, saving
from socialbot.core.clock import nanoseconds
from socialbot.graph.node import Node, Timer

LOOK_EVERY_S = 1.0
"""Time (s) between two looks for the file, and before a failed save is tried again."""

SAVE_EVERY_S = 0.2
"""Minimum time between two saves of a mind."""

RECORDS_SKIPPED = 1000
"""Trace numbers to skip after a restart: records since the last save may have used them."""


class StateFile:
    """Saves the state of ``node`` in ``path`` by ``write``, which makes the folder and raises OSError.

    A failure is logged and does not stop the node.
    """

    def __init__(self, node: Node, path: Path, write: Callable[[], None]) -> None:
        self._node = node
        self._path = path
        self._write = write
        self._failed = False
        self._next_look = 0
        self._retry: Timer | None = None

    def changed(self) -> None:
        """Save the state."""
        try:
            self._write()
        except OSError as error:
            self._finished(error)
        else:
            self._finished(None)

    def look(self) -> None:
        """Save the state again if the file was removed; at most once a second."""
        now = self._node.clock.now()
        if now >= self._next_look:
            self._next_look = now + nanoseconds(LOOK_EVERY_S)
            if not self._path.exists():
                self.changed()

    def _finished(self, error: Exception | None) -> None:
        if error is not None and not self._failed:
            self._node.log.warning("cannot save its state: %s", error)
        self._failed = error is not None
        if self._failed and self._retry is None:  # an idle node may not look for a long time
            at = self._node.clock.now() + nanoseconds(LOOK_EVERY_S)
            self._retry = self._node.context.call_at(at, self._try_again)

    def _try_again(self) -> None:
        self._retry = None
        if self._failed:
            self.changed()


class MindFile(StateFile):
    """Saves the mental state of ``engine`` in ``path``, by atomic writes in the background."""

    def __init__(self, node: Node, path: Path, engine: Engine) -> None:
        super().__init__(node, path, lambda: self._write_data(saving.save(engine)))
        self._engine = engine
        self._earliest = 0
        self._due: Timer | None = None
        self._closed = threading.Event()
        self._one_at_a_time = threading.Lock()

    def recall(self) -> bool:
        """Restore the saved state; return whether there is one. Rename a damaged file, if the disk can be written."""
        if not self._path.exists():
            return False
        try:
            data = saving.read(self._path)
            saving.restore(self._engine, {**data, "records": data["records"] + RECORDS_SKIPPED})
        except (saving.MindError, KeyError, TypeError) as error:
            damaged = self._path.with_name(f"{self._path.name}.damaged")
            try:
                self._path.replace(damaged)
                state = f"now {damaged}"
            except OSError as problem:
                state = f"cannot be renamed ({problem.strerror})"
            self._node.log.warning("starts without its mind file, which is damaged and %s: %s", state, error)
            return False
        return True

    def changed(self) -> None:
        """Schedule a save."""
        if self._due is None:
            self._due = self._node.context.call_at(max(self._node.clock.now(), self._earliest), self._save)

    def close(self) -> None:
        """Save once more, synchronously."""
        if self._due is not None:
            self._due.cancel()
        with self._one_at_a_time:
            self._closed.set()
            try:
                self._write()
            except (saving.MindError, OSError) as error:
                self._finished(error)
        if self._retry is not None:
            self._retry.cancel()

    def _save(self) -> None:
        self._due = None
        self._earliest = self._node.clock.now() + nanoseconds(SAVE_EVERY_S)
        try:
            data = saving.save(self._engine)
        except saving.MindError as error:
            self._finished(error)
        else:
            self._node.context.run_in_background(functools.partial(self._write_if_open, data), self._finished)

    def _write_if_open(self, data: dict[str, Any]) -> None:
        with self._one_at_a_time:
            if not self._closed.is_set():
                self._write_data(data)

    def _write_data(self, data: dict[str, Any]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)  # it may have been removed
        saving.write_data(data, self._path)
