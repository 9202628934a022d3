"""Functions to call in other processes. This module imports little, so that a fresh process starts soon."""

from __future__ import annotations

import os
import time
from typing import TypeVar

T = TypeVar("T")


def double(number: int) -> int:
    return 2 * number


def crash(code: int) -> int:
    os._exit(code)


def wait(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def give_back(value: T | Exception) -> T:
    """Return ``value``, or raise it."""
    if isinstance(value, Exception):
        raise value
    return value
