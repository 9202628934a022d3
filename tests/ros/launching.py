"""Processes of a launch file, by the part of `launch` and `launch_ros` that socialbot uses.

Neither is on PyPI. The names, their arguments and the order of what happens are those of ROS 2 Jazzy.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests.example_modules import load_file


@dataclass
class Context:
    launch_configurations: dict[str, str]
    folders: list[str] = field(default_factory=list)


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    description: str = ""

    def visit(self, context: Context) -> list[Any]:
        if self.default_value is not None:
            context.launch_configurations.setdefault(self.name, self.default_value)
        assert self.name in context.launch_configurations, f"{self.name}:= has to be given"
        return []


@dataclass
class OpaqueFunction:
    function: Callable[[Context], list[Any]]

    def visit(self, context: Context) -> list[Any]:
        return self.function(context)


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: Context) -> str:
        return context.launch_configurations[self.name]


class ThisLaunchFileDir:
    def perform(self, context: Context) -> str:
        return context.folders[-1]


@dataclass
class PathJoinSubstitution:
    parts: list[Any]

    def perform(self, context: Context) -> str:
        return "/".join(performed(part, context) for part in self.parts)


@dataclass
class PythonLaunchDescriptionSource:
    location: Any


@dataclass
class IncludeLaunchDescription:
    source: PythonLaunchDescriptionSource
    launch_arguments: Iterable[tuple[str, Any]] = ()

    def visit(self, context: Context) -> list[Any]:
        for name, value in self.launch_arguments:
            context.launch_configurations[name] = performed(value, context)
        path = Path(performed(self.source.location, context))
        context.folders.append(str(path.parent))
        return description_of(path).entities


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    name: str
    arguments: list[str]
    additional_env: dict[str, str] | None = None
    parameters: list[str] | None = None
    ros_arguments: list[str] | None = None
    output: str
    respawn: bool
    respawn_delay: float

    @property
    def command(self) -> list[str]:
        """The arguments of the executable, as `launch_ros` puts them together."""
        files = [part for file in self.parameters or [] for part in ("--params-file", file)]
        own = ["--ros-args", *self.ros_arguments] if self.ros_arguments else []
        return [*self.arguments, *own, "--ros-args", "-r", f"__node:={self.name}", *files]


def performed(value: Any, context: Context) -> str:
    if isinstance(value, list):
        return "".join(performed(part, context) for part in value)
    return value if isinstance(value, str) else value.perform(context)


def description_of(path: Path) -> LaunchDescription:
    return load_file(path, path.name.replace(".", "_")).generate_launch_description()


def launched(path: Path, log_folder: Path, monkeypatch: pytest.MonkeyPatch, **arguments: str) -> list[Node]:
    """Return the processes that ``ros2 launch path name:=value ...`` starts."""
    for name, contents in {
        "launch": [LaunchDescription],
        "launch.actions": [DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction],
        "launch.launch_description_sources": [PythonLaunchDescriptionSource],
        "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir],
        "launch.logging": [],
        "launch_ros": [],
        "launch_ros.actions": [Node],
    }.items():
        module = ModuleType(name)
        module.__dict__.update({each.__name__: each for each in contents})
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules["launch.logging"].launch_config = SimpleNamespace(log_dir=str(log_folder))  # pyright: ignore[reportAttributeAccessIssue]
    context = Context(arguments, [str(path.parent)])
    return list(_nodes(description_of(path).entities, context))


def _nodes(entities: list[Any], context: Context) -> Iterator[Node]:
    for entity in entities:
        if isinstance(entity, Node):
            yield entity
        else:
            yield from _nodes(entity.visit(context), context)
