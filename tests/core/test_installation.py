"""Commands that install what is missing."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from socialbot.core import installation
from socialbot.core.installation import (
    INTERFACES,
    checkout,
    extra_command,
    interfaces_command,
    pip_command,
    restore_command,
)

ROOT = Path(__file__).resolve().parents[2]


def no_pip(monkeypatch: pytest.MonkeyPatch, *, missing: bool) -> None:
    monkeypatch.setattr(installation, "find_spec", lambda name: None if missing else object())


class TestInACheckout:
    @pytest.fixture(autouse=True)
    def venv_of_make(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "prefix", str(ROOT / ".venv"))

    def test_it_is_recognised(self):
        assert checkout() == ROOT

    @pytest.mark.parametrize("extras", [("sim",), ("hear", "hear-model")])
    def test_an_extra_has_a_target(self, extras):
        assert shlex.split(extra_command(*extras)) == ["make", "-C", str(ROOT), *extras]

    @pytest.mark.parametrize("package", INTERFACES)
    def test_a_package_of_ros_types_has_a_target(self, package):
        command = shlex.split(interfaces_command(package))
        assert command == ["make", "-C", str(ROOT), INTERFACES[package]]
        assert f"./interfaces/{package}" in recipe(command[-1])
        assert (ROOT / "interfaces" / package / "pyproject.toml").is_file()

    def test_another_environment_gets_the_checkout_with_the_extra(self, monkeypatch, tmp_path):
        monkeypatch.setattr(sys, "prefix", str(tmp_path))
        no_pip(monkeypatch, missing=False)
        assert shlex.split(extra_command("sim")) == ["pip", "install", "-e", f"{ROOT}[sim]"]
        folder = str(ROOT / "interfaces" / "robot_interfaces")
        assert shlex.split(interfaces_command("robot_interfaces")) == ["pip", "install", "--no-deps", folder]

    def test_git_restores_a_damaged_file(self):
        file = ROOT / "socialbot" / "vision" / "models" / "nanodet.onnx"
        assert shlex.split(restore_command(file)) == ["git", "-C", str(ROOT), "checkout", "--", str(file)]


class TestAPackage:
    @pytest.fixture(autouse=True)
    def no_checkout(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(installation, "checkout", lambda: None)
        no_pip(monkeypatch, missing=False)

    @pytest.mark.parametrize(
        ("origin", "requirement"),
        [
            (None, "socialbot[up,sim]"),
            ({"url": "file:///home/me/socialbot-9.whl", "archive_info": {}}, "file:///home/me/socialbot-9.whl"),
            (
                {"url": "https://host/bot.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
                "git+https://host/bot.git@abc",
            ),
        ],
        ids=["index", "wheel", "git"],
    )
    def test_an_extra_comes_from_where_the_package_came(self, monkeypatch, tmp_path, origin, requirement):
        folder = tmp_path / "socialbot-9.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: socialbot\nVersion: 9\n")
        if origin is not None:
            (folder / "direct_url.json").write_text(json.dumps(origin))
            requirement = f"socialbot[up,sim] @ {requirement}"
        monkeypatch.syspath_prepend(tmp_path)
        assert shlex.split(extra_command("up", "sim")) == ["pip", "install", requirement]

    def test_types_of_robots_need_a_checkout(self):
        folder = "./interfaces/robot_interfaces"
        assert interfaces_command("robot_interfaces") == (f"pip install --no-deps {folder} in a checkout of socialbot")


def test_an_environment_without_pip_is_named_to_another_pip(monkeypatch):
    no_pip(monkeypatch, missing=True)
    outside, *command = shlex.split(pip_command("install", "a>=1,<2"))
    assert command == ["-m", "pip", "--python", sys.executable, "install", "a>=1,<2"]
    found = subprocess.run([outside, "-c", "import sys; print(sys.prefix)"], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == sys.base_prefix


@pytest.mark.skipif(not (ROOT / ".venv" / "bin" / "python3").exists(), reason="make has set up no environment here")
def test_make_installs_from_outside_of_its_environment_when_that_is_active():
    """The environment of make has no pip."""
    path = f"{ROOT / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    install = next(line for line in recipe("sim", PATH=path).splitlines() if line.endswith("'.[sim]'"))
    subprocess.run(
        [shlex.split(install)[0], "-m", "pip", "--version"], cwd=ROOT, env={**os.environ, "PATH": path}, check=True
    )


@pytest.mark.parametrize("extra", metadata.metadata("socialbot").get_all("Provides-Extra") or ["none"])
def test_each_extra_has_a_target_that_installs_it(extra):
    options = [word for word in shlex.split(recipe(extra)) if word.startswith(".[")]
    assert any(extra in option.strip(".[]").split(",") for option in options)


def recipe(target: str, **variables: str) -> str:
    """What make does for a target; ``variables`` are added to the environment."""
    command = ["make", "--dry-run", "--always-make", "--no-print-directory", target]
    environment = {**os.environ, **variables}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout
