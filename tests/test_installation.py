"""The wheel of `make dist`, installed with each extra in an empty environment, as docs/installation.md says."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.system.running import eventually
from tests.vision.metrics.scenes import drawn_bag

ROOT = Path(__file__).parents[1]
CORRIDOR = ROOT / "data" / "synthetic" / "corridor"
DOMAIN = """\
(define (domain tea) (:requirements :strips) (:predicates (cold) (hot))
  (:action boil :parameters () :precondition (cold) :effect (and (hot) (not (cold)))))
"""
PROBLEM = "(define (problem cup) (:domain tea) (:init (cold)) (:goal (hot)))"
# Extras for people with a checkout: their packages are only resolved.
FOR_CHECKOUTS = ("bench", "dev", "docs", "fuzz", "onnx", "project")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with wheel, source archive and constraints, as `make dist` fills it."""
    folder = tmp_path_factory.mktemp("dist")
    recipe = re.search(r"^dist: setup\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert recipe is not None
    for line in recipe[1].replace("$$", "$").splitlines():
        command = line.strip().replace("$(BIN)/hatchling build", f"{sys.executable} -m hatchling build -d {folder}")
        command = re.sub(r"\bdist(?=/|$)", str(folder), command)
        if not command.startswith("rm "):
            subprocess.run(command, shell=True, cwd=ROOT, check=True, capture_output=True)
    return folder


def need_index(pip: Path) -> None:
    command = [pip, "install", "--quiet", "--dry-run", "--no-deps", "typer"]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("there is no package index")


class Installed:
    """An environment of its own with the wheel and one extra; commands run in an empty folder."""

    def __init__(self, folder: Path, dist: Path, extra: str) -> None:
        self.folder = folder
        self._bin = folder / "venv" / "bin"
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
        need_index(self._bin / "pip")
        (wheel,) = dist.glob("*.whl")
        self.pip("install", "--constraint", dist / "constraints.txt", f"{wheel}[{extra}]" if extra else wheel)

    def pip(self, *arguments: object) -> str:
        return self._run("pip", "--disable-pip-version-check", *arguments)

    def socialbot(self, *arguments: object) -> str:
        return self._run("socialbot", *arguments)

    @contextmanager
    def background(self, program: str, *arguments: object) -> Iterator[subprocess.Popen[str]]:
        """Run a program in the background of the block."""
        command = [self._bin / program, *map(str, arguments)]
        environment = self._environment()
        with subprocess.Popen(command, cwd=self.folder, env=environment, stdout=subprocess.PIPE, text=True) as process:
            try:
                yield process
            finally:
                process.terminate()

    def _run(self, program: str, *arguments: object) -> str:
        command = [self._bin / program, *map(str, arguments)]
        done = subprocess.run(command, cwd=self.folder, env=self._environment(), capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done.stdout

    def _environment(self) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        return {**kept, "PATH": f"{self._bin}:/usr/bin:/bin", "XDG_CACHE_HOME": str(self.folder / "cache")}


@pytest.fixture
def installed(request: pytest.FixtureRequest, dist: Path, tmp_path: Path) -> Iterator[Installed]:
    """The wheel with the extra that the test names; the environment is removed afterwards."""
    yield Installed(tmp_path, dist, request.param)
    shutil.rmtree(tmp_path / "venv")


def with_extra(name: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("installed", [name], ids=[name or "alone"], indirect=True)


@with_extra("")
def test_package_alone(installed: Installed, dist: Path):
    assert installed.socialbot("--version") == "socialbot 0.1.0\n"
    installed.socialbot("demo", "warehouse", "--out", "boxes")
    installed.socialbot("new", "my_robot")
    installed.pip("check")
    (source,) = dist.glob("*.tar.gz")
    installed.pip("wheel", "--no-deps", "--wheel-dir", "built", source)
    (wheel,) = (installed.folder / "built").iterdir()
    assert wheel.name in {each.name for each in dist.iterdir()}
    resolved = "--dry-run", "--constraint", dist / "constraints.txt"
    for extra in FOR_CHECKOUTS:
        installed.pip("install", *resolved, f"{wheel}[{extra}]")


@with_extra("speech")
def test_speech(installed: Installed):
    installed.socialbot("replay", CORRIDOR, "--no-video", "--out", "visit")
    assert list((installed.folder / "visit" / "speech").glob("*.wav"))
    assert "because" in installed.socialbot("why", "visit")


@with_extra("up")
def test_planners_of_unified_planning(installed: Installed):
    for name, text in {"domain.pddl": DOMAIN, "problem.pddl": PROBLEM}.items():
        (installed.folder / name).write_text(text)
    assert "boil" in installed.socialbot("plan", "domain.pddl", "problem.pddl", "--planner", "up:kairos")


@with_extra("rerun")
def test_recordings_of_rerun(installed: Installed):
    installed.socialbot("demo", "cleaner", "--out", "clean")
    installed.socialbot("export", "clean", "clean.rrd")
    assert (installed.folder / "clean.rrd").stat().st_size > 1000


@with_extra("sim")
def test_world_with_physics(installed: Installed):
    installed.socialbot("demo", "warehouse", "--world", "physics", "--out", "boxes")


@with_extra("foxglove")
def test_live_view_in_foxglove(installed: Installed):
    installed.socialbot("demo", "cleaner", "--out", "clean")
    with installed.background("socialbot", "foxglove", "clean", "--port", 0) as server:
        assert server.stdout is not None
        assert any("ws://127.0.0.1:" in line for line in server.stdout)


@with_extra("evaluation")
def test_samples_of_sobol(installed: Installed):
    bag = drawn_bag(installed.folder, frames=10)
    settings = "--set", "waldo.range_m=1:9", "--method", "sobol", "--samples", 2
    assert "2 " in installed.socialbot("sweep", bag, *settings)


@with_extra("dask")
def test_cluster_of_dask(installed: Installed):
    bag = drawn_bag(installed.folder, frames=10)
    file = installed.folder / "scheduler.json"
    here = "--scheduler-file", file, "--no-dashboard"
    with installed.background("dask", "scheduler", "--host", "127.0.0.1", "--port", 0, *here):
        assert eventually(file.exists)
        with installed.background("dask", "worker", "--nworkers", 2, *here):
            address = json.loads(file.read_text())["address"]
            installed.socialbot("sweep", bag, "--set", "waldo.range_m=3,9", "--scheduler", address)


def test_continuous_integration_installs_a_new_project(dist: Path, tmp_path: Path) -> None:
    (line,) = set(re.findall(r"pip install .*\.$", (ROOT / "docs/howto/ci.md").read_text("utf-8"), re.MULTILINE))
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    need_index(tmp_path / "venv/bin/pip")
    subprocess.run([sys.executable, "-m", "socialbot", "new", "my_robot"], cwd=tmp_path, check=True)
    shutil.copytree(dist, tmp_path / "my_robot/wheels")
    path = f"{tmp_path / 'venv/bin'}:/usr/bin:/bin"
    command = ["sh", "-c", f"{line} --dry-run"]
    done = subprocess.run(
        command, cwd=tmp_path / "my_robot", env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    assert "my_robot-0.1.0" in done.stdout, done.stderr
    assert "socialbot-0.1.0" in done.stdout
