"""The ROS package says what pyproject.toml says, and colcon builds it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

import socialbot
from tests.test_house import imports, modules

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros"

tomllib = pytest.importorskip("tomllib", reason="came with Python 3.11")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
MANIFEST = ElementTree.parse(PACKAGE / "package.xml").getroot()
MESSAGES = ("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rcl_interfaces", "sensor_msgs", "std_msgs")
"""Packages of messages that may be imported by name."""


def test_it_is_the_package_that_pip_installs():
    assert MANIFEST.get("format") == "3"
    for name in ("name", "description", "license"):
        assert MANIFEST.findtext(name) == PROJECT[name]
    assert MANIFEST.findtext("version") == socialbot.__version__
    assert (PACKAGE / "socialbot").resolve() == Path(socialbot.__file__).parent


def test_it_needs_the_same_packages_but_for_the_wheels_of_ros():
    lines = (PACKAGE / "requirements.txt").read_text("utf-8").splitlines()
    listed = [line for line in lines if not line.startswith("#")]
    assert listed == [line for line in PROJECT["dependencies"] if not line.startswith("ros-jazzy-")]


def test_it_names_the_ros_packages_that_are_imported():
    needed = {element.text for element in MANIFEST.iter("exec_depend")}
    imported = {name.partition(".")[0] for path in modules("bridge") for name in imports(path)}
    assert imported & {"rclpy", *MESSAGES} <= needed
    launching = {name.partition(".")[0] for path in (PACKAGE / "launch").glob("*.py") for name in imports(path)}
    assert launching & {"launch", "launch_ros"} <= needed


@pytest.mark.slow
def test_colcon_builds_and_installs_it(tmp_path: Path):
    python = colcon_python(tmp_path / "venv")
    command = [python, "-m", "colcon", "build", "--base-paths", PACKAGE]
    done = subprocess.run(command, cwd=tmp_path, env=plain_environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    installed = tmp_path / "install" / "socialbot"
    share = installed / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "socialbot").is_file()
    assert {path.name for path in (share / "socialbot" / "launch").iterdir()} == {
        path.name for path in (PACKAGE / "launch").glob("*.launch.py")
    }
    assert {path.name for path in (installed / "lib" / "socialbot").iterdir()} == {"node", "socialbot"}
    (package,) = installed.glob("lib/python*/site-packages/socialbot")
    assert files(package) == files(PACKAGE / "socialbot")


def files(folder: Path) -> set[str]:
    root = folder.resolve()
    found = {path.relative_to(root) for path in root.rglob("*") if path.is_file()}
    return {str(path) for path in found if "__pycache__" not in path.parts}


def colcon_python(folder: Path) -> Path:
    """A Python of its own with colcon, and with the setuptools of Ubuntu 24.04, the system of ROS 2 Jazzy."""
    python = folder / "bin" / "python"
    for command in (
        [sys.executable, "-m", "venv", str(folder)],
        [str(python), "-m", "pip", "install", "--quiet", "colcon-ros", "setuptools==68.1.2"],
    ):
        done = subprocess.run(command, env=plain_environment(), capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"colcon cannot be installed: {(done.stderr or done.stdout).strip()[-300:]}")
    return python


def plain_environment() -> dict[str, str]:
    """The environment without what the ROS wheels put there for this Python."""
    private = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "VIRTUAL_ENV")
    return {name: value for name, value in os.environ.items() if name not in private}
