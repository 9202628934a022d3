"""Hosts for a test, which is skipped where they cannot be made."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from evaluation import hosts
from evaluation.hosts import ROBOT, SECOND_ROBOT, WORKSTATION, Host, SwitchedHosts, TwoHosts
from socialbot.bridge.environment import PROFILE_VARIABLE

__all__ = [
    "CLOSED",
    "ROBOT",
    "SECOND_ROBOT",
    "WORKSTATION",
    "Host",
    "TwoHosts",
    "open_to",
    "script",
    "switched_hosts",
    "two_hosts",
]

CLOSED = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
"""Variables of a graph on one machine."""


def open_to(address: str) -> dict[str, str]:
    """Variables of a graph that another host can reach."""
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": address}


@contextmanager
def two_hosts() -> Iterator[TwoHosts]:
    """Context manager of two hosts. Skips the test, with the reason, where they cannot be made."""
    if reason := hosts.obstacle():
        pytest.skip(f"no two hosts: {reason}")
    with hosts.two_hosts() as both:
        yield both


@contextmanager
def switched_hosts(*addresses: str) -> Iterator[SwitchedHosts]:
    """Context manager of hosts at a switch. Skips the test, with the reason, where they cannot be made."""
    try:
        with hosts.switched_hosts(*addresses) as made:
            yield made
    except hosts.NoHostsError as reason:
        pytest.skip(f"no hosts: {reason}")


@contextmanager
def idle_processors() -> Iterator[None]:
    """Let this thread, and processes that it starts in the block, run before others, as on a machine without load.

    For tests that judge delays in real time. Without the privilege, they depend on the load.
    """
    before = os.sched_getscheduler(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        with suppress(PermissionError):
            os.sched_setscheduler(0, before, os.sched_param(0))


@contextmanager
def script(
    host: Host, text: str, log: Path, variables: dict[str, str], *arguments: str
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the Python program ``text`` on ``host`` within the block; ``log`` gets its output."""
    root = str(Path(__file__).parents[2])
    always = {"PYTHONPATH": root, PROFILE_VARIABLE: "", "SOCIALBOT_DATAGRAM_BYTES": ""}
    with log.open("w") as output:
        process = host.start(
            *(sys.executable, "-c", text, *arguments),
            variables={**always, **variables},
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
