"""Small bags for whole graphs."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.running import cut


@pytest.fixture
def short_bag(corridor: Path, tmp_path: Path) -> Path:
    """One second of the corridor: ten pictures."""
    return cut(corridor, tmp_path / "short", 0.0, 1.0)
