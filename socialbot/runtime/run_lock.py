"""Run locks: abstract sockets that list the live runs of ``socialbot up`` on this computer."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

SOCKETS = Path("/proc/net/unix")
_NAME = re.compile(r"@socialbot/up/(\d+)/([\da-f]+)/(\d+)$", re.MULTILINE)


@contextmanager
def run_lock(run: str) -> Iterator[None]:
    """Hold the lock of ``run`` in the ROS domain of this process. The kernel releases it if the process ends."""
    with closing(socket.socket(socket.AF_UNIX)) as lock:
        lock.bind(f"\0socialbot/up/{_domain()}/{run}/{os.getpid()}")
        yield


def locked_runs() -> Mapping[str, int]:
    """Process ids of the live runs in this ROS domain and computer, by run id."""
    found = _NAME.findall(SOCKETS.read_text("utf-8", errors="replace"))
    return {run: int(pid) for domain, run, pid in found if int(domain) == _domain()}


def _domain() -> int:
    return int(os.environ.get("ROS_DOMAIN_ID") or 0)
