"""Extent of the fault evaluation, and the folder of its records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


class Skipped(Exception):  # noqa: N818 - it is none
    """Row that this machine cannot measure; the text gives the reason."""


@dataclass(frozen=True)
class Plan:
    """Settings of all rows: ``folder`` for records, ROS ``domain``, and ``tell`` for progress lines.

    With ``quick`` a row only checks that it works, instead of all requirements.
    """

    folder: Path
    domain: int
    tell: Callable[[str], None]
    quick: bool = False

    def of(self, full: T, quick: T) -> T:
        return quick if self.quick else full

    def records(self, name: str) -> Path:
        path = self.folder / name
        path.mkdir(parents=True, exist_ok=False)
        return path
