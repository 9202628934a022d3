"""Wheel and source archive contain all that a checkout has."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

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


def locked(name: str) -> set[str]:
    """The packages of a lock, each with its version, its marker and its hashes."""
    text = (ROOT / name).read_text("utf-8")
    return {block.strip() for block in re.split(r"(?m)^(?=\w)", text) if block}


def test_what_runs_is_locked_at_the_versions_that_are_tested():
    assert locked("requirements.lock") < locked("requirements-dev.lock")
