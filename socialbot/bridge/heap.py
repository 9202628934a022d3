"""The heap of a process through which pictures pass."""

from __future__ import annotations

import ctypes

MXFAST, TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = 1, -1, -2, -3
"""The names of glibc's malloc.h for what `mallopt` sets."""

KEPT_BYTES = 64 << 20
SPARE_BYTES = 16 << 20
LARGEST_BYTES = 32 << 20
"""What glibc takes at most for its threshold; an 8-bit picture of 3840x2160 has 25 million bytes."""


def keep_freed_memory() -> bool:
    """Has this process keep what it frees, up to `KEPT_BYTES`, for the next picture. Returns False without glibc.

    Otherwise glibc gives the memory of each picture back and asks for it anew, and the kernel clears every page of it:
    640x480 at 30 Hz cost a camera and its sender 40 000 page faults a second, a fifth of their time.

    What is small joins what is free beside it at once. Otherwise it lies apart until somebody asks for something large,
    and of threads that never do, as those of DDS, the heap grew by nearly 6 MB an hour, of which nothing was in use.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    taken = [
        mallopt(MXFAST, 0),
        mallopt(MMAP_THRESHOLD, LARGEST_BYTES),
        mallopt(TRIM_THRESHOLD, KEPT_BYTES),
        mallopt(TOP_PAD, SPARE_BYTES),
    ]
    return all(taken)
