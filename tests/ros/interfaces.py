"""Packages of messages that the ROS wheels lack, built as ``interfaces/socialbot_msgs`` is."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from socialbot.bags.types import DEFINITIONS
from tests.ros.test_package import ROOT, plain_environment

RECIPE = ROOT / "interfaces" / "socialbot_msgs"
DEPENDENCIES = {
    "CMakeLists.txt": (
        ("find_package(std_msgs REQUIRED)", "find_package(std_msgs REQUIRED)\nfind_package(geometry_msgs REQUIRED)"),
        ("DEPENDENCIES std_msgs", "DEPENDENCIES std_msgs geometry_msgs"),
    ),
    "package.xml": (("<depend>std_msgs</depend>", "<depend>std_msgs</depend>\n  <depend>geometry_msgs</depend>"),),
    "pyproject.toml": (),
}


def write_package(name: str, folder: Path) -> Path:
    """A package of the types in `DEFINITIONS` that are called ``name/...``, by the recipe of socialbot_msgs."""
    package = folder / name
    (package / "msg").mkdir(parents=True)
    for file, changes in DEPENDENCIES.items():
        text = (RECIPE / file).read_text("utf-8")
        for old, new in changes:
            assert old in text, f"{file} no longer says {old}"
            text = text.replace(old, new)
        for own in (str, lambda title: title.replace("_", "-")):
            text = text.replace(own(RECIPE.name), own(name))
        (package / file).write_text(text, "utf-8")
    for type_name, definition in DEFINITIONS.items():
        owner, _, message = type_name.split("/")
        if owner == name:
            (package / "msg" / f"{message}.msg").write_text(definition, "utf-8")
    return package


def install(names: Sequence[str], folder: Path) -> Path:
    """Builds the packages called ``names``; the prefix that they are installed to. Skips where they cannot be built."""
    tomllib = pytest.importorskip("tomllib", reason="came with Python 3.11")
    if shutil.which("g++") is None:
        pytest.skip("there is no compiler")
    tools, prefix = folder / "tools", folder / "prefix"
    requires = tomllib.loads((RECIPE / "pyproject.toml").read_text("utf-8"))["build-system"]["requires"]
    pip = [str(tools / "bin" / "python"), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    for command in ([sys.executable, "-m", "venv", str(tools)], [*pip, *requires]):
        done = run(command)
        if done.returncode:
            pytest.skip(f"the tools to build messages cannot be installed: {(done.stderr or done.stdout)[-300:]}")
    for name in names:
        package = write_package(name, folder)
        done = run([*pip, "--no-deps", "--no-build-isolation", "--prefix", str(prefix), str(package)])
        assert done.returncode == 0, done.stdout + done.stderr
    return prefix


def run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Runs ``command`` to its end, without what the ROS wheels of the tests put into the environment."""
    return subprocess.run(command, env=plain_environment(), capture_output=True, text=True, check=False)
