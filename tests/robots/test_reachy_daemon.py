"""Reachy Mini with its real daemon, simulated by ``--mockup-sim``.

``REACHY_MINI_DAEMON`` names the program, unless ``reachy-mini-daemon`` is on the path.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from socialbot.core.errors import DeviceError
from socialbot.robots.daemon_client import DaemonClient
from tests.robots.daemon_server import FIELDS, PATHS
from tests.robots.test_reachy_mini import aim, connected, reachy_head
from tests.system.running import PATIENCE_S, eventually, socialbot

PROGRAM = os.environ.get("REACHY_MINI_DAEMON") or shutil.which("reachy-mini-daemon")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PROGRAM, reason="needs reachy-mini-daemon on the path, or named by REACHY_MINI_DAEMON"),
]


class Daemon:
    """The daemon in a process of its own, with its log."""

    def __init__(self, port: int, log: Path) -> None:
        self.url, self.log = f"http://127.0.0.1:{port}", log
        inherited = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")  # of the wheels of ROS
        offline = {"HF_HUB_OFFLINE": "1", "DO_NOT_TRACK": "1"}
        self.process = subprocess.Popen(
            [str(PROGRAM), "--mockup-sim", "--no-media", "--fastapi-port", str(port)],
            env={**{key: value for key, value in os.environ.items() if key not in inherited}, **offline},
            stdout=log.open("w"),
            stderr=subprocess.STDOUT,
        )
        assert eventually(self.is_up), log.read_text()

    def is_up(self) -> bool:
        try:
            return DaemonClient(self.url).status()["state"] == "running"
        except DeviceError:
            return False

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def targets(self) -> int:
        """Number of targets that it got, by its log of requests."""
        return self.log.read_text().count("POST /api/move/set_target")

    def state(self) -> dict[str, Any]:
        return DaemonClient(self.url).full_state()


@contextmanager
def daemon(port: int, log: Path) -> Iterator[Daemon]:
    made = Daemon(port, log)
    try:
        yield made
    finally:
        made.kill()


@pytest.fixture
def port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_the_server_of_the_quick_tests_has_the_interface_of_the_daemon(port, tmp_path):
    with daemon(port, tmp_path / "daemon.log") as real, urlopen(f"{real.url}/openapi.json", timeout=10) as answer:
        page = json.load(answer)
    offered = {(method, path) for path, methods in page["paths"].items() for method in methods}
    assert offered >= PATHS
    for name, fields in FIELDS.items():
        assert set(page["components"]["schemas"][name]["properties"]) == fields, name


def test_the_head_goes_where_it_should(port, tmp_path):
    with daemon(port, tmp_path / "daemon.log") as real, reachy_head(real.url) as graph:
        assert eventually(lambda: connected(graph))
        aim(graph, 0.5, 0.2)

        def arrived() -> bool:
            graph.run(0.1)
            head = real.state()["head_pose"]
            return abs(head["yaw"] - 0.5) < 0.01 and abs(head["pitch"] + 0.2) < 0.01

        assert eventually(arrived)


def test_waldo_survives_a_killed_daemon_and_commands_nothing_after_down(port, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    profile = tmp_path / "mini.yaml"
    profile.write_text(f"like: reachy_mini\nname: mini\nurl: http://127.0.0.1:{port}\ncamera: {{on_head: false}}\n")
    video = Path(__file__).parents[2] / "data" / "synthetic" / "corridor"
    images = tmp_path / "images"
    images.mkdir()
    write_images(video, images)
    run = [sys.executable, "-m", "socialbot", "up", "--robot", str(profile), "--camera", str(images)]
    options = ["--set", "camera.loop=true", "--out", str(tmp_path / "run")]
    with daemon(port, tmp_path / "first.log") as first:
        up = subprocess.Popen([*run, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            assert eventually(lambda: abs(first.state()["antennas_position"][0]) > 0.3)  # it greets or listens
            assert first.targets() > 0
            first.kill()
            with daemon(port, tmp_path / "second.log") as second:
                assert eventually(lambda: second.targets() > 5)
                assert socialbot("down").returncode == 0
                assert up.wait(PATIENCE_S) == 0
                count = second.targets()
                second.state()  # a request after all earlier ones
                assert second.targets() == count
        finally:
            up.send_signal(signal.SIGINT)
            up.communicate()


def write_images(bag: Path, folder: Path) -> None:
    """Write the frames of the corridor with a person near by as image files."""
    from socialbot.bags.reader import open_bag

    topic = "/camera/image_raw/compressed"
    with open_bag(bag) as opened:
        for number, (_, message) in enumerate(opened.messages({topic: topic})):
            if number < 200:
                (folder / f"{number:04d}.jpg").write_bytes(bytes(message.data))  # type: ignore[attr-defined]
