"""Load MuJoCo, the physics engine of the extra ``sim``."""

from __future__ import annotations

import importlib
import os
from typing import Any

from socialbot.core.errors import InstallationError


def load_mujoco() -> Any:
    """Import MuJoCo, with EGL for drawing if no other OpenGL is chosen.

    Raises:
        InstallationError: It is not installed.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read by MuJoCo when it is imported; other windowing needs a screen
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise InstallationError(f"MuJoCo cannot be imported: {error}", remedy="pip install 'socialbot[sim]'") from error
