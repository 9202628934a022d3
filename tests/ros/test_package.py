"""The ROS packages say what pyproject.toml says; colcon knows them, and builds the one that needs no full ROS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

import socialbot
from tests.test_house import imports, modules

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros"

tomllib = pytest.importorskip("tomllib", reason="came with Python 3.11")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
INTERFACES = ROOT / "interfaces" / "socialbot_msgs"
MANIFEST = ElementTree.parse(PACKAGE / "package.xml").getroot()
MESSAGES = ("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rcl_interfaces", "sensor_msgs", "std_msgs")
"""Packages of messages that may be imported by name."""


def test_it_is_the_package_that_pip_installs():
    assert MANIFEST.get("format") == "3"
    for name in ("name", "description", "license"):
        assert MANIFEST.findtext(name) == PROJECT[name]
    assert MANIFEST.findtext("version") == socialbot.__version__
    assert (PACKAGE / "socialbot").resolve() == Path(socialbot.__file__).parent


def test_all_manifests_have_the_same_authors_and_version():
    for folder in (PACKAGE, INTERFACES):
        manifest = ElementTree.parse(folder / "package.xml").getroot()
        assert [maintainer.text for maintainer in manifest.iter("maintainer")] == [PROJECT["authors"][0]["name"]]
        assert manifest.findtext("version") == socialbot.__version__
    citation = YAML(typ="safe").load(ROOT / "CITATION.cff")
    assert citation["authors"] == PROJECT["authors"]
    assert (citation["version"], citation["license"]) == (socialbot.__version__, PROJECT["license"])


def test_requires_the_same_packages_except_the_ros_wheels():
    lines = (PACKAGE / "requirements.txt").read_text("utf-8").splitlines()
    listed = [line for line in lines if not line.startswith("#")]
    assert listed == [line for line in PROJECT["dependencies"] if not line.startswith("ros-jazzy-")]


def test_lists_the_imported_ros_packages():
    needed = {element.text for element in MANIFEST.iter("exec_depend")}
    imported = {name.partition(".")[0] for path in modules("bridge") for name in imports(path)}
    assert imported & {"rclpy", *MESSAGES} <= needed
    launching = {name.partition(".")[0] for path in (PACKAGE / "launch").glob("*.py") for name in imports(path)}
    assert launching & {"launch", "launch_ros"} <= needed


@pytest.fixture(scope="module")
def colcon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return colcon_python(tmp_path_factory.mktemp("colcon") / "venv")


def run(*command: object, cwd: Path) -> str:
    """Return the output of a command that must succeed."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=plain_environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_colcon_builds_and_installs_it(colcon: Path, tmp_path: Path):
    run(colcon, "-m", "colcon", "build", "--base-paths", PACKAGE, cwd=tmp_path)
    installed = tmp_path / "install" / "socialbot"
    share = installed / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "socialbot").is_file()
    assert {path.name for path in (share / "socialbot" / "launch").iterdir()} == {
        path.name for path in (PACKAGE / "launch").glob("*.launch.py")
    }
    assert {path.name for path in (installed / "lib" / "socialbot").iterdir()} == {"node", "socialbot"}
    (package,) = installed.glob("lib/python*/site-packages/socialbot")
    assert files(package) == files(PACKAGE / "socialbot")


@pytest.mark.slow
def test_colcon_finds_both_packages(colcon: Path, tmp_path: Path):
    listed = run(colcon, "-m", "colcon", "list", "--base-paths", PACKAGE, INTERFACES, cwd=tmp_path).splitlines()
    assert {line.split("\t")[0]: line.split("\t")[-1] for line in listed} == {
        "socialbot": "(ros.ament_python)",
        "socialbot_msgs": "(ros.ament_cmake)",
    }


PARSING = """
import json, sys
from catkin_pkg.package import parse_package
warnings = []
for folder in sys.argv[1:]:
    package = parse_package(folder, warnings=warnings)
    package.evaluate_conditions({})
    package.validate(warnings=warnings)
print(json.dumps(warnings))
"""


@pytest.mark.slow
def test_the_manifests_are_valid(colcon: Path, tmp_path: Path):
    assert json.loads(run(colcon, "-c", PARSING, PACKAGE, INTERFACES, cwd=tmp_path)) == []


def files(folder: Path) -> set[str]:
    root = folder.resolve()
    found = {path.relative_to(root) for path in root.rglob("*") if path.is_file()}
    return {str(path) for path in found if "__pycache__" not in path.parts}


COLCON = ("colcon-ros", "colcon-package-information")


def colcon_python(folder: Path) -> Path:
    """A Python of its own with colcon, and with the setuptools of Ubuntu 24.04, the system of ROS 2 Jazzy."""
    python = folder / "bin" / "python"
    for command in (
        [sys.executable, "-m", "venv", str(folder)],
        [str(python), "-m", "pip", "install", "--quiet", *COLCON, "setuptools==68.1.2"],
    ):
        done = subprocess.run(command, env=plain_environment(), capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"colcon cannot be installed: {(done.stderr or done.stdout).strip()[-300:]}")
    return python


def plain_environment() -> dict[str, str]:
    """The environment without what the ROS wheels put there for this Python."""
    private = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "VIRTUAL_ENV")
    return {name: value for name, value in os.environ.items() if name not in private}
