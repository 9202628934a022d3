"""Limit of the memory that a decoder of a file takes: a small file may ask for gigabytes."""

from __future__ import annotations

import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_lock = threading.Lock()
_blocks = 0
_before = resource.RLIM_INFINITY


@contextmanager
def memory_limit(further_bytes: int) -> Iterator[None]:
    """Let this process take no more than ``further_bytes`` within the block, or less if its own limit is lower.

    All threads share the limit. If several are in such blocks, the last one to enter sets it, and it lasts until all
    have left. An allocation beyond it fails as if the memory were full. Systems other than Linux have no such limit.
    """
    global _blocks, _before
    if sys.platform != "linux":
        yield
        return
    with _lock:
        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if not _blocks:
            _before = soft
        _blocks += 1
        limits = [each for each in (_data_bytes() + further_bytes, _before, hard) if each != resource.RLIM_INFINITY]
        resource.setrlimit(resource.RLIMIT_DATA, (min(limits), hard))
    try:
        yield
    finally:
        with _lock:
            _blocks -= 1
            if not _blocks:
                resource.setrlimit(resource.RLIMIT_DATA, (_before, hard))


def _data_bytes() -> int:
    """Memory (bytes) that counts for the limit: private, writable, and without a file."""
    return int(Path("/proc/self/statm").read_bytes().split()[5]) * resource.getpagesize()
