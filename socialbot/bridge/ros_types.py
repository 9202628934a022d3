"""ROS messages as rclpy knows them, made by the name of their type; imported only when one is needed."""

from __future__ import annotations

import array
import functools
import importlib
from typing import Any

import numpy as np

from socialbot.bridge.interfaces import PACKAGE
from socialbot.errors import InstallationError

_REMEDY = (
    "install the ROS wheels (pip install ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-rmw-fastrtps-cpp) "
    "or source a ROS 2 Jazzy installation"
)
_REMEDY_TYPED = "pip install ./interfaces/socialbot_msgs (see docs/interfaces.md), or write wire: json in the graph"


class RclpyTypes:
    """A `codec.TypeFactory` that makes messages for rclpy."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """A message of ``type_name``. Raises InstallationError when its package is not installed."""
        message = message_class(type_name)(
            **{name: value for name, value in fields.items() if not isinstance(value, np.ndarray)}
        )
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                _fill(message, name, value)
        return message


@functools.cache
def message_class(type_name: str) -> Any:
    """The class of a type such as ``sensor_msgs/msg/Image``.

    Raises InstallationError when ROS, or the package of this type, is not installed.
    """
    module, _, name = type_name.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        remedy = _REMEDY_TYPED if type_name.startswith(f"{PACKAGE}/") else _REMEDY
        raise InstallationError(f"the ROS type {type_name} is not installed: {error}", remedy=remedy) from error


def _fill(message: Any, name: str, numbers: np.ndarray) -> None:
    # The setter would copy an array.array, and take a numpy array apart number by number: for a picture of
    # 640x480, 2 ms and 250 ms, where filling the array that the message already has takes 0.04 ms.
    own = getattr(message, name)
    if isinstance(own, array.array):
        own.frombytes(np.ascontiguousarray(numbers, np.dtype(own.typecode)).data.cast("B"))
    else:
        setattr(message, name, numbers)
