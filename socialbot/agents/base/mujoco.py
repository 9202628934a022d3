"""Load MuJoCo, the physics engine of the extra ``sim``."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command


def load_mujoco() -> Any:
    """Import MuJoCo, with EGL for drawing if no other OpenGL is chosen.

    Raises:
        InstallationError: It is not installed.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read by MuJoCo when it is imported; other windowing needs a screen
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        remedy = extra_command("sim") if sys.version_info >= (3, 11) else "use Python 3.11 or newer, which MuJoCo needs"
        raise InstallationError(f"MuJoCo cannot be imported: {error}", remedy=remedy) from error
