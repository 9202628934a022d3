"""Reaches the scripts of the generator, which are no package."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

GENERATOR = Path(__file__).parents[2] / "data" / "synthetic" / "generator"


def part(name: str) -> ModuleType:
    """A module of the generator, whose modules find each other by their bare names."""
    sys.path.insert(0, str(GENERATOR))
    try:
        return import_module(name)
    finally:
        sys.path.remove(str(GENERATOR))
