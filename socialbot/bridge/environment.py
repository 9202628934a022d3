"""The environment that ROS needs: the DDS profile, the reach of discovery, the folder for logs."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

from socialbot.errors import GraphError, InstallationError

PROFILE = Path(__file__).with_name("dds_profile.xml")
"""The Fast DDS profile with a shared-memory segment that holds pictures."""

HIGHEST_DOMAIN = 232
PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def prepare(
    environment: MutableMapping[str, str] = os.environ, *, log_folder: Path | None = None, domain: int | None = None
) -> None:
    """Fills in what is not set, or empty; call it before rclpy starts. ``domain`` and ``log_folder`` do override."""
    for variable, value in ((PROFILE_VARIABLE, str(PROFILE)), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")):
        environment[variable] = environment.get(variable) or value
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    if log_folder is not None:
        environment["ROS_LOG_DIR"] = str(log_folder)
    elif "ROS_LOG_DIR" not in environment and "ROS_HOME" not in environment:
        environment["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / "socialbot-ros-log")


def check_domain(environment: MutableMapping[str, str] = os.environ) -> None:
    """Raises GraphError when ROS_DOMAIN_ID is no number that ROS can use."""
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdigit() and int(domain) <= HIGHEST_DOMAIN):
        raise GraphError(
            f"no ROS domain: {domain!r}", where="ROS_DOMAIN_ID", remedy=f"set it to a number from 0 to {HIGHEST_DOMAIN}"
        )


def require_ros() -> None:
    """Raises InstallationError when there is no ROS 2 for Python here, GraphError when its domain is none."""
    check_domain()
    if importlib.util.find_spec("rclpy") is None:
        raise InstallationError(
            "ROS 2 is not installed for this Python",
            remedy="on x86-64 Linux: pip install socialbot (brings the ROS wheels); elsewhere: source a ROS 2 Jazzy "
            "installation; or use --runner inline, which needs no ROS",
        )
