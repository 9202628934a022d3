"""ONNX networks of anybody: the files that they name, and runs within limits of time and memory."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socialbot.core.errors import ParameterError
from socialbot.core.limits import NETWORK_BYTES
from socialbot.core.memory_limit import memory_limit
from socialbot.core.paths import leads_inside

if TYPE_CHECKING:
    import onnxruntime

LONGEST_RUN_S = 60.0
"""Longest run (s of processor time) of a network. Those for images and sentences need less than a second."""

MAX_FIELDS = 5_000_000
"""Most fields of the file of a network; the included detector has 6,147."""

_LOOK_S = 1.0  # pause between two looks at the runs of a network

_NAME_BYTES = 1024  # longest name of a file of data

_PARTS = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {13: "entry"},
}
"""Kind of the message in each field of a message, as far as tensors may be in it; ``entry`` is a key and a value."""


def network_limit(size: int) -> AbstractContextManager[None]:
    """Context manager that limits the memory of a network which is loaded in its block, from a file of ``size`` bytes.

    Loading computes what depends on no input.
    """
    return memory_limit(NETWORK_BYTES + 4 * size)


def check_external_data(model: bytes | memoryview, where: str, folder: Path | None = None) -> None:
    """Check that a network has its data in its file, or in files of ``folder``. onnxruntime 1.23 does not.

    Raises:
        ParameterError: It names another file, or has too many fields.
    """
    for name in _external_files(memoryview(model), where):
        # "*" tells onnxruntime an address in memory.
        if (
            folder is None
            or "*" in name
            or "\0" in name
            or len(name) > _NAME_BYTES
            or not leads_inside(folder, folder / name)
        ):
            what = f"the network has its data in {name[:80]!r}, outside of its folder"
            raise ParameterError(what, where=where, remedy="put its data into its file, or into its folder")


def _external_files(model: memoryview, where: str) -> Iterator[str]:
    waiting, count = [("model", model)], 0
    while waiting:
        kind, message = waiting.pop()
        entry: list[str] = []
        for number, content in _fields(message):
            count += 1
            if count > MAX_FIELDS:
                raise ParameterError(f"more than {MAX_FIELDS} fields", where=where, remedy="give a smaller network")
            if kind == "entry":
                entry.append(bytes(content[: _NAME_BYTES + 1]).decode("utf-8", "replace"))
            elif number in _PARTS[kind]:
                waiting.append((_PARTS[kind][number], content))
        if "location" in entry:
            yield from sorted(entry, key="location".__eq__)  # also a value "location", which may be a link


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Number and content of the fields of a message of protobuf; the content of numbers is empty."""
    at = 0
    while at < len(message):
        key, at = _number(message, at)
        kind, size = key & 7, 0
        if kind == 0:
            _, at = _number(message, at)
        elif kind == 2:
            size, at = _number(message, at)
        at += {1: 8, 5: 4}.get(kind, 0)
        yield key >> 3, message[at : at + size]
        at += size


def _number(message: memoryview, at: int) -> tuple[int, int]:
    """A number of protobuf, and where it ends."""
    value = shift = 0
    while at < len(message):
        byte = message[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128 or shift > 63:
            break
    return value, at


class Inference:
    """Runs of one ``session``, whose network errors name ``where``. A network that took too long is not run again.

    The time is processor time of the process, so that one that was stopped, or waited for a processor, is not late.
    One thread watches over all runs: a thread for each would take as long as a small network.
    """

    def __init__(self, session: onnxruntime.InferenceSession, where: str, longest_s: float = LONGEST_RUN_S) -> None:
        self._session = session
        self._where = where
        self._longest_s = longest_s
        self._is_late = False
        self._lock = threading.Lock()
        self._runs: dict[int, tuple[onnxruntime.RunOptions, float]] = {}
        """Options of the present runs, and the processor time (s) at which they are late."""
        self._is_watched = False

    def run(self, inputs: Mapping[str, Any]) -> list[Any]:
        """Return the outputs for ``inputs``. Thread-safe.

        Raises:
            ParameterError: The network takes too long, or too much memory.
            Exception: That of onnxruntime for inputs that do not fit.
        """
        import onnxruntime

        if self._is_late:
            raise self._late()
        options = onnxruntime.RunOptions()
        options.log_severity_level = 4
        with self._lock:
            self._runs[id(options)] = options, time.process_time() + self._longest_s
            if not self._is_watched:
                threading.Thread(target=self._watch, name="inference", daemon=True).start()
                self._is_watched = True
        try:
            with memory_limit(NETWORK_BYTES):
                return list(self._session.run(None, dict(inputs), options))
        except Exception as error:
            if "alloc" in str(error).lower():  # onnxruntime's errors have no class of their own
                what = f"the network takes more than {NETWORK_BYTES / 1e9:.1f} GB of memory for one input"
                raise ParameterError(what, where=self._where, remedy="give a smaller network") from error
            if not options.terminate:
                raise
            self._is_late = True
            raise self._late() from error
        finally:
            with self._lock:
                del self._runs[id(options)]

    def _watch(self) -> None:
        """Stop late runs, until none is left at a look."""
        while True:
            time.sleep(min(_LOOK_S, self._longest_s))
            with self._lock:
                now = time.process_time()
                for options, end_s in self._runs.values():
                    options.terminate = options.terminate or now >= end_s
                if not self._runs:
                    self._is_watched = False
                    return

    def _late(self) -> ParameterError:
        what = f"the network takes more than {self._longest_s:g} s for one input"
        return ParameterError(what, where=self._where, remedy="give a smaller network, or one without loops")
