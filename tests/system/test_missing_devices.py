"""`socialbot up` with devices and models that are missing: one message about each at once, and the rest goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.system.running import eventually, running, socialbot

pytestmark = [pytest.mark.ros, pytest.mark.slow]

GRAPH = """
name: senses
inputs: [/speech/say]
nodes:
  camera:     {type: camera, parameters: {source: /dev/video97}}
  microphone: {type: microphone, parameters: {source: Studio 9000}}
  hearing:    {type: hearing, parameters: {model: damaged}}
  speech:     {type: speaker, parameters: {playback: 'off'}}
"""
CAMERA = "/dev/video97: no such camera; plug it in, or choose one of /dev/video*; retried every 2 s"


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A graph file beside a speech model that is damaged."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "damaged"
    folder.mkdir()
    for name in ("model.bin", "config.json", "tokenizer.json"):
        (folder / name).write_text("{}")
    (folder / "SHA256SUMS").write_text(f"{64 * '0'}  model.bin\n")
    (tmp_path / "senses.yaml").write_text(GRAPH)
    return tmp_path / "senses.yaml"


def levels_and_texts(names: set[str]) -> dict[str, tuple[bytes, str]]:
    """Level and text of nodes on /diagnostics."""
    from diagnostic_msgs.msg import DiagnosticArray

    from socialbot.bridge.environment import spinning_node

    found: dict[str, tuple[bytes, str]] = {}

    def note(array: Any) -> None:
        found.update((status.name, (status.level, status.message)) for status in array.status)

    with spinning_node("listener") as ros:
        ros.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        assert eventually(lambda: names <= found.keys(), 30)
    return found


def test_up_says_at_once_what_is_missing_and_goes_on(graph: Path, tmp_path: Path) -> None:
    with running("up", graph, "--out", tmp_path / "run") as up:
        assert eventually(lambda: all(name in up.output() for name in ("camera: ", "microphone: ", "hearing ")), 90)
        lines = up.output().splitlines()
        [camera] = [line for line in lines if "camera" in line]
        assert camera.endswith(f"fails    camera: {CAMERA}")
        [microphone] = [line for line in lines if "microphone" in line]
        assert "fails    microphone: Studio 9000: no" in microphone
        assert microphone.endswith("retried every 2 s")
        [hearing] = [line for line in lines if "hearing" in line]
        assert hearing.startswith("hearing cannot start: ")
        assert hearing.endswith("the others go on without it")

        done = socialbot("status", graph)
        assert f"camera: {CAMERA}" in done.stdout
        assert "hearing: its process cannot start: " in done.stdout
        nodes = {one["name"]: one for one in json.loads(socialbot("status", graph, "--json").stdout)["nodes"]}
        assert {name: one["condition"] for name, one in nodes.items()} == {
            "camera": "failed", "microphone": "failed", "hearing": "given up", "speech": "active",
        }  # fmt: skip

        told = levels_and_texts(set(nodes))
        assert told["camera"] == (b"\2", CAMERA)
        assert told["microphone"][0] == told["hearing"][0] == b"\2"
        assert told["hearing"][1].startswith("given up: the process cannot start: ")
        assert told["speech"][1] == "running"
        assert up.poll() is None
