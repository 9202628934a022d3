"""Wheel and source archive contain all that a checkout has."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import metadata, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with wheel and source archive."""
    folder = tmp_path_factory.mktemp("dist")
    hatchling = Path(sys.executable).with_name("hatchling")
    subprocess.run([hatchling, "build", "--directory", folder], cwd=ROOT, check=True, capture_output=True)
    return folder


def tracked(*paths: str) -> set[str]:
    """The files of the repository below ``paths``."""
    listed = subprocess.run(["git", "ls-files", "-z", *paths], cwd=ROOT, check=True, capture_output=True, text=True)
    return {name for name in listed.stdout.split("\0") if name and not (ROOT / name).is_symlink()}


@pytest.mark.slow
def test_the_wheel_holds_every_file_of_the_package(built):
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == tracked("socialbot")


@pytest.mark.slow
def test_the_source_archive_holds_what_the_wheel_is_built_from(built):
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert names >= tracked(".")


def copied() -> list[str]:
    """Return what the Dockerfile copies from the checkout."""
    lines = [line.split() for line in (ROOT / "Dockerfile").read_text("utf-8").splitlines()]
    return [name for words in lines if words[:1] == ["COPY"] for name in words[1:-1]]


def test_the_image_holds_what_it_builds_the_package_from(tmp_path: Path):
    allowed = {line.lstrip("!") for line in (ROOT / ".dockerignore").read_text("utf-8").splitlines() if line[0] == "!"}
    assert allowed == set(copied())
    for name in tracked(*copied()):
        target = tmp_path / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((ROOT / name).read_bytes())
    hatchling = Path(sys.executable).with_name("hatchling")
    subprocess.run([hatchling, "build", "--target", "wheel"], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == tracked("socialbot")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder of a checkout, with a whole environment that another Python has made."""
    for name in ("Makefile", "requirements.lock", "requirements-dev.lock", "pyproject.toml"):
        shutil.copyfile(ROOT / name, tmp_path / name)
    (tmp_path / ".venv" / "lib" / "python3.9").mkdir(parents=True)
    for name in ("installed", "tools-installed"):
        (tmp_path / ".venv" / name).touch()
    return tmp_path


def make(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `make` as in a shell of its own: the tests themselves may be run by it."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHON" and not name.startswith("MAKE")}
    command = ["make", *arguments]
    return subprocess.run(command, cwd=folder, env=kept | environment, capture_output=True, text=True, check=False)


def test_make_names_the_pip_that_it_needs_before_it_makes_an_environment(made: Path):
    shutil.rmtree(made / ".venv")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", made / "bare"], check=True)
    python = made / "bare" / "bin" / "python"
    done = make(made, "setup", f"PYTHON={python}")
    assert done.returncode
    assert f"error: {python} needs pip 22.3 or newer; " in done.stderr
    assert f"{python} -m pip install --upgrade pip" in done.stderr
    assert not (made / ".venv").exists()


@pytest.mark.parametrize("target", ["setup", "tools", "demo", "sim"])
def test_make_refuses_a_python_that_is_not_that_of_the_environment(target: str, made: Path):
    done = make(made, target, f"PYTHON={sys.executable}")
    assert done.returncode
    python = "{}.{}".format(*sys.version_info)
    assert f"error: .venv was made with another Python than {python}; remove it first: rm -r .venv\n" in done.stderr
    assert sorted(path.name for path in (made / ".venv").iterdir()) == ["installed", "lib", "tools-installed"]
    assert make(made, target, PYTHON=sys.executable).stderr == done.stderr


def test_make_takes_the_environment_as_it_is_where_no_python_is_named(made: Path):
    assert not make(made, "setup").returncode


def test_make_takes_the_environment_of_the_python_that_is_named(made: Path):
    (made / ".venv" / "lib" / "python{}.{}".format(*sys.version_info)).mkdir()
    assert not make(made, "setup", f"PYTHON={sys.executable}").returncode


def test_the_development_container_sets_up_what_the_makefile_offers():
    settings = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text("utf-8"))
    editor = settings["customizations"]["vscode"]["settings"]
    make, target = settings["postCreateCommand"].split()
    assert make == "make"
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert editor["python.defaultInterpreterPath"].endswith(".venv/bin/python")


@pytest.mark.parametrize(("machine", "has_ros"), [("x86_64", True), ("aarch64", False)])
def test_an_arm_machine_installs_all_but_ros(machine: str, has_ros: bool):
    here = {"sys_platform": "linux", "platform_machine": machine}
    needs = [Requirement(text) for text in requires("socialbot") or ()]
    needs = [need for need in needs if "extra ==" not in str(need.marker or "")]
    chosen = {need.name for need in needs if need.marker is None or need.marker.evaluate(here)}
    assert ("ros-jazzy-rclpy" in chosen) is has_ros
    assert {"numpy", "onnxruntime", "opencv-python-headless", "kairos-planner"} <= chosen


@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13", "3.14"])
def test_every_extra_installs_something_with_each_python(python: str):
    here = {"python_version": python, "sys_platform": "linux", "platform_machine": "x86_64"}
    markers = [Requirement(text).marker for text in requires("socialbot") or () if "extra ==" in text]
    extras = metadata("socialbot").get_all("Provides-Extra") or []
    assert extras
    for extra in extras:
        assert any(marker and marker.evaluate(here | {"extra": extra}) for marker in markers), extra


def locked(name: str, here: dict[str, str]) -> set[tuple[str, str]]:
    """The packages that a lock installs somewhere: each with its version, and its hashes."""
    blocks = re.split(r"(?m)^(?=\w)", (ROOT / name).read_text("utf-8"))[1:]
    split = [block.partition("\n") for block in blocks]
    pins = [(Requirement(first.rstrip(" \\")), hashes) for first, _, hashes in split]
    chosen = [(pin, hashes) for pin, hashes in pins if pin.marker is None or pin.marker.evaluate(here)]
    return {(f"{pin.name}{pin.specifier}", hashes.strip()) for pin, hashes in chosen}


@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13", "3.14"])
@pytest.mark.parametrize(("system", "machine"), [("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "arm64")])
def test_what_runs_is_locked_at_the_versions_that_are_tested(python: str, system: str, machine: str):
    here = {"python_version": python, "python_full_version": f"{python}.1"}
    here |= {"sys_platform": system, "platform_machine": machine}
    assert locked("requirements.lock", here) < locked("requirements-dev.lock", here)
