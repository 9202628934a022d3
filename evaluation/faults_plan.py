"""How much of each fault is tried, and where its records are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


class Skipped(Exception):  # noqa: N818 - it is none
    """A row that cannot be measured on this machine; the text says why."""


@dataclass(frozen=True)
class Plan:
    """What all rows are told: the ``folder`` for records, the ROS ``domain`` on this machine, where to ``tell`` lines.

    With ``quick`` a row does enough to see that it works; else all that is required.
    """

    folder: Path
    domain: int
    tell: Callable[[str], None]
    quick: bool = False

    def of(self, full: T, quick: T) -> T:
        """The one that holds for this plan."""
        return quick if self.quick else full

    def records(self, name: str) -> Path:
        """A new folder of that name for records."""
        path = self.folder / name
        path.mkdir(parents=True, exist_ok=False)
        return path
