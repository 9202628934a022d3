"""What an examination of the installation finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """What was looked at, how it stands, what was found, and how to mend it.

    A warning tells of something that not every graph needs, an error of something without which none runs.
    """

    name: str
    state: State
    text: str
    remedy: str = ""


Check = Callable[[], Finding | None]
"""Looks at one thing; None where there is no such thing to look at."""
