"""ROS messages as rclpy knows them, made by the name of their type; imported only when one is needed."""

from __future__ import annotations

import array
import functools
import importlib
from typing import Any

import numpy as np

from socialbot.errors import InstallationError

_REMEDY = (
    "install the ROS wheels (pip install ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-rmw-fastrtps-cpp) "
    "or source a ROS 2 Jazzy installation"
)


class RclpyTypes:
    """A `codec.TypeFactory` that makes messages for rclpy."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """A message of ``type_name``. Raises InstallationError when its package is not installed."""
        return message_class(type_name)(**{name: _field(value) for name, value in fields.items()})


@functools.cache
def message_class(type_name: str) -> Any:
    """The class of a type such as ``sensor_msgs/msg/Image``.

    Raises InstallationError when ROS, or the package of this type, is not installed.
    """
    module, _, name = type_name.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InstallationError(f"the ROS type {type_name} is not installed: {error}", remedy=_REMEDY) from error


def _field(value: Any) -> Any:
    # The setters of rclpy take a numpy array apart number by number: 250 ms for a picture, an array.array 0.1 ms.
    if not isinstance(value, np.ndarray):
        return value
    numbers = array.array("B" if value.dtype == np.uint8 else "d")
    if value.size:
        numbers.frombytes(np.ascontiguousarray(value).data.cast("B"))
    return numbers
