"""Limit of the memory within a block."""

from __future__ import annotations

import resource
from collections.abc import Iterator

import numpy as np
import pytest

from socialbot.core.memory_limit import memory_limit


@pytest.fixture(autouse=True)
def before() -> Iterator[int]:
    """The limit of this process, which is the same after a test."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    yield soft
    assert resource.getrlimit(resource.RLIMIT_DATA) == (soft, hard)


def test_more_memory_is_refused_within_the_block_only():
    with memory_limit(1 << 26):
        np.empty(1 << 24, np.uint8)
        with pytest.raises(MemoryError):
            np.empty(1 << 27, np.uint8)
    np.empty(1 << 27, np.uint8)


def test_the_limit_lasts_until_all_have_left():
    first, second = memory_limit(1 << 26), memory_limit(1 << 26)
    first.__enter__()
    with second:
        first.__exit__(None, None, None)
        with pytest.raises(MemoryError):
            np.empty(1 << 27, np.uint8)


def test_a_lower_limit_of_the_process_stays():
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    own = 1 << 40
    resource.setrlimit(resource.RLIMIT_DATA, (own, hard))
    try:
        with memory_limit(1 << 50):
            assert resource.getrlimit(resource.RLIMIT_DATA) == (own, hard)
        assert resource.getrlimit(resource.RLIMIT_DATA) == (own, hard)
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
