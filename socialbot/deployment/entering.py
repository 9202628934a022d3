"""How a process becomes one of a machine of a deployment."""

from __future__ import annotations

import os

from socialbot.bridge import environment
from socialbot.bridge.statistics import MACHINE_VARIABLE
from socialbot.bridge.wire import KEYS_VARIABLE
from socialbot.deployment.deployment import Deployment


def enter(deployment: Deployment, machine: str) -> None:
    """Makes this process one of ``machine``: its ROS domain, the way to the others, its key and its name.

    Call it before rclpy starts. Raises GraphError for an unknown machine.
    """
    deployment.address(machine)
    environment.prepare(domain=deployment.domain, across=deployment.across(machine))
    os.environ[MACHINE_VARIABLE] = machine
    if deployment.keys is not None:
        os.environ[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"
