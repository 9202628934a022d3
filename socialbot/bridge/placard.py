"""Which runs of ``socialbot up`` there are on this computer, as its kernel knows at once and with certainty.

Each holds a local socket whose name tells of it, and which is gone when its process is, however that ends. So nobody
has to listen, and for how long, to find out that nothing is up.
"""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path

SOCKETS = Path("/proc/net/unix")
_NAME = re.compile(r"@socialbot/up/(\d+)/([\da-f]+)/(\d+)$", re.MULTILINE)


class Placard:
    """Shows, until it is taken down, that the run with this id is up here in the ROS domain of this process."""

    def __init__(self, run: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.bind(f"\0socialbot/up/{_domain()}/{run}/{os.getpid()}")

    def take_down(self) -> None:
        """Shows it no longer."""
        self._socket.close()


def shown() -> Mapping[str, int]:
    """The runs that are up here in the ROS domain of this process, each with the id of its process."""
    found = _NAME.findall(SOCKETS.read_text("utf-8", errors="replace"))
    return {run: int(pid) for domain, run, pid in found if int(domain) == _domain()}


def _domain() -> int:
    return int(os.environ.get("ROS_DOMAIN_ID") or 0)
