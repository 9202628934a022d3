"""The arguments that ROS tools give to every node: ``--ros-args -p threshold:=0.5 -r __ns:=/hall --``."""

from __future__ import annotations

from collections.abc import Iterable

BEGIN, END = "--ros-args", "--"


def divided(arguments: Iterable[str]) -> tuple[list[str], list[str]]:
    """The arguments that are ours, and those for ROS: from each ``--ros-args`` to ``--`` or the end."""
    ours: list[str] = []
    ros: list[str] = []
    for argument in arguments:
        inside = bool(ros) and ros[-1] != END
        (ros if inside or argument == BEGIN else ours).append(argument)
    return ours, ros
