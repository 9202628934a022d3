"""Small bags for whole graphs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.system.running import cut


@pytest.fixture
def short_bag(corridor: Path, tmp_path: Path) -> Path:
    """One second of the corridor: ten pictures."""
    return cut(corridor, tmp_path / "short", 0.0, 1.0)


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """A folder of images for a camera."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(20):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((240, 320, 3), 10 * number, np.uint8))
    return folder
