from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest
from typer.testing import CliRunner, Result

from socialbot.cli.main import app
from socialbot.core.errors import DeviceError, SocialbotError
from socialbot.graph.node import Graph
from socialbot.runtime import run as running
from socialbot.runtime.deployment import is_deployment
from socialbot.runtime.machine import LiveSource
from tests.runtime.deployments import PAGE


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "waldo.yaml"
    path.write_text(PAGE)
    return path


def test_file_with_machines_is_a_deployment(file: Path, tmp_path: Path):
    assert is_deployment(str(file))
    file.write_text("name: eyes\nnodes:\n  camera: {type: camera}\n")
    assert not any(map(is_deployment, (str(file), "waldo", str(tmp_path), str(tmp_path / "none"))))


@pytest.fixture(autouse=True)
def _environment_of_its_own() -> Iterator[None]:
    with mock.patch.dict(os.environ):
        yield


def test_up_runs_the_nodes_of_a_machine(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ran: list[tuple[Graph, LiveSource]] = []
    monkeypatch.setattr(running, "run", lambda graph, source, *_, **__: ran.append((graph, source)))
    done = run("up", file, "--machine", "robot", "--camera", "0", "--out", tmp_path / "run", "--minds", "kept", "-v")
    assert done.exit_code == 0, done.output
    assert "waldo on robot: camera, speech, head, camera_image_raw_to_workstation" in done.output
    [(graph, source)] = ran
    assert source.nodes == ["camera", "speech", "head", "camera_image_raw_to_workstation"]
    assert graph.node("camera").parameters["source"] == "0"
    assert source.state_folder == Path("kept")


def test_up_refuses_a_missing_video_before_it_starts(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ran: list[Graph] = []
    monkeypatch.setattr(running, "run", lambda graph, *_, **__: ran.append(graph))
    film, folder = tmp_path / "film.avi", tmp_path / "run"
    refused = run("up", "waldo", "--camera", film, "--out", folder).exception
    assert isinstance(refused, DeviceError)
    assert "no such camera, video file or folder" in str(refused)
    assert (ran, folder.exists()) == ([], False)
    done = run("up", file, "--machine", "workstation", "--camera", film, "--out", folder)
    assert (done.exit_code, len(ran)) == (0, 1), "the camera is on the other machine"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--machine", "rowboat"], "no machine 'rowboat'"),
        ([], "robot (10.77.0.1), workstation (10.77.0.2)"),
        (["--machine", "robot", "--composed"], "in its own process"),
        (["--machine", "robot", "--set", "camra.loop=true"], "did you mean 'camera'?"),
    ],
)
def test_up_refuses_wrong_machines(file: Path, tmp_path: Path, arguments: list[str], words: str):
    done = run("up", file, "--out", tmp_path / "run", *arguments)
    assert isinstance(done.exception, SocialbotError)
    assert words in str(done.exception)
    assert not (tmp_path / "run").exists()


def test_a_graph_has_no_machines(tmp_path: Path):
    done = run("up", "waldo", "--machine", "robot", "--out", tmp_path / "run")
    assert "give a deployment file" in str(done.exception)


def test_systemd_prints_a_unit_or_writes_it(file: Path, tmp_path: Path):
    printed = run("systemd", file, "--machine", "robot")
    assert printed.output.startswith("[Unit]")
    written = run("systemd", file, "--machine", "robot", "--out", tmp_path)
    assert (tmp_path / "socialbot-robot.service").read_text() == printed.output
    assert "systemctl enable --now socialbot-robot.service" in written.output


def test_systemd_refuses_unknown_machine_or_folder(file: Path, tmp_path: Path):
    assert "no machine 'desk'" in str(run("systemd", file, "--machine", "desk").exception)
    nowhere = run("systemd", file, "--machine", "robot", "--out", tmp_path / "none")
    assert "cannot be written" in str(nowhere.exception)
