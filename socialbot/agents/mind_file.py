"""The file in which the mind of an agent is kept while it lives, so that it goes on after a crash."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from socialbot.bdi import Engine, saving
from socialbot.clock import nanoseconds
from socialbot.graph import Context, Timer

SAVE_EVERY_S = 0.2
"""At least so long between two savings."""

RECORDS_SKIPPED = 1000
"""Numbers of trace records that may have been given after the last saving, and are not to be given again."""


class MindFile:
    """Keeps the mind of ``engine`` in ``path``. What takes time is done beside the agent.

    At any time the file holds one mind, whole. A disk that fails is told of, and keeps no agent from going on.
    """

    def __init__(self, engine: Engine, path: Path, context: Context, log: logging.Logger) -> None:
        self._engine = engine
        self._path = path
        self._context = context
        self._log = log
        self._earliest = 0
        self._due: Timer | None = None
        self._closed = threading.Event()
        self._one_at_a_time = threading.Lock()

    def recall(self) -> bool:
        """Gives the agent the mind that is kept; says whether there is one. One that is damaged is set aside."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if not self._path.exists():
            return False
        try:
            data = saving.read(self._path)
            saving.restore(self._engine, {**data, "records": data["records"] + RECORDS_SKIPPED})
        except (saving.MindError, KeyError, TypeError) as error:
            aside = self._path.with_name(f"{self._path.name}.damaged")
            self._log.warning("begins anew: its mind cannot be restored and is now %s: %s", aside, error)
            self._path.replace(aside)
            return False
        return True

    def changed(self) -> None:
        """Has the mind saved: soon, with all that changes until then."""
        if self._due is None:
            self._due = self._context.call_at(max(self._context.clock.now(), self._earliest), self._save)

    def close(self) -> None:
        """Saves the mind for the last time, at once."""
        if self._due is not None:
            self._due.cancel()
        with self._one_at_a_time:
            self._closed.set()
            self._try(lambda: saving.write(self._engine, self._path))

    def _save(self) -> None:
        self._due = None
        self._earliest = self._context.clock.now() + nanoseconds(SAVE_EVERY_S)
        if (data := self._try(lambda: saving.save(self._engine))) is not None:
            self._context.aside(functools.partial(self._write, data), self._written)

    def _write(self, data: dict[str, Any]) -> None:
        with self._one_at_a_time:
            if not self._closed.is_set():
                saving.write_data(data, self._path)

    def _written(self, result: Exception | None) -> None:
        if isinstance(result, Exception):
            self._log.warning("its mind is not kept: %s", result)

    def _try(self, work: Callable[[], Any]) -> Any:
        try:
            return work()
        except (saving.MindError, OSError) as error:
            self._written(error)
            return None
