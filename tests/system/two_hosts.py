"""Two hosts for a test, which is skipped where they cannot be made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from evaluation import two_hosts as hosts
from evaluation.two_hosts import ROBOT, WORKSTATION, Host, TwoHosts

__all__ = ["ROBOT", "WORKSTATION", "Host", "TwoHosts", "two_hosts"]


@contextmanager
def two_hosts() -> Iterator[TwoHosts]:
    """Context manager of two hosts. Skips the test, with the reason, where they cannot be made."""
    if reason := hosts.obstacle():
        pytest.skip(f"no two hosts: {reason}")
    with hosts.two_hosts() as both:
        yield both
