from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from socialbot.runtime._network import DiscoveryServer, listening
from socialbot.runtime._processes import RestartPolicy
from socialbot.runtime.deployment import Server
from socialbot.runtime.machine import discovery
from tests.runtime.deployments import deployment
from tests.system.running import eventually, is_alive, next_line

pytestmark = pytest.mark.ros

HASTY = RestartPolicy(times=1, first_s=0.01)
PARENT = """
import sys, time
from pathlib import Path
from socialbot.runtime._network import DiscoveryServer
from socialbot.runtime._processes import RestartPolicy
Path(sys.argv[2]).touch()
with DiscoveryServer("127.0.0.1", int(sys.argv[1]), Path(sys.argv[2]), RestartPolicy()) as server:
    while "running" not in Path(sys.argv[2]).read_text():
        time.sleep(0.02)
    print(server.pid, flush=True)
    time.sleep(60)
"""


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_restarts_the_server_and_ends_it(port: int, tmp_path: Path) -> None:
    output = tmp_path / "log" / "server.log"
    with DiscoveryServer("127.0.0.1", port, output, HASTY) as server:
        assert eventually(lambda: output.exists() and "Server is running" in output.read_text())
        first = server.pid
        assert first is not None
        os.kill(first, signal.SIGKILL)
        assert eventually(lambda: server.pid not in (None, first))
        second = server.pid
    assert second is not None
    assert not is_alive(second)


def test_restarts_the_server_without_its_log(port: int, tmp_path: Path) -> None:
    """The folder of the run may have been removed, or the disk may be full."""
    output = tmp_path / "log" / "server.log"
    with DiscoveryServer("127.0.0.1", port, output, HASTY) as server:
        assert eventually(lambda: output.exists() and "Server is running" in output.read_text())
        first = server.pid
        assert first is not None
        shutil.rmtree(output.parent)
        output.parent.touch()  # in the place of a folder
        os.kill(first, signal.SIGKILL)
        assert eventually(lambda: server.pid not in (None, first))


def test_gives_up_if_the_port_is_taken(port: int, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port))
        with DiscoveryServer("127.0.0.1", port, tmp_path / "server.log", HASTY) as server:
            assert eventually(lambda: "given up" in caplog.text)
            assert server.pid is None
    assert str(tmp_path / "server.log") in caplog.text


def test_the_server_ends_with_its_parent(port: int, tmp_path: Path) -> None:
    command = [sys.executable, "-c", PARENT, str(port), str(tmp_path / "server.log")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        pid = int(next_line(parent))
        assert is_alive(pid)
        parent.kill()
    assert eventually(lambda: not is_alive(pid))


def test_listens_on_the_configured_address() -> None:
    assert listening("10.77.0.1") == "10.77.0.1"
    assert listening("robot.local") == "0.0.0.0"


def test_runs_only_on_its_own_machine(tmp_path: Path) -> None:
    here = deployment(("10.77.0.1", "127.0.0.1"), ("discovery: peers", "discovery: {server: robot}"))
    elsewhere = deployment(("discovery: peers", "discovery: {server: robot}"))
    assert here.server == Server("robot")
    assert isinstance(discovery(here, "robot", tmp_path), DiscoveryServer)
    for one, machine in ((here, "workstation"), (elsewhere, "robot"), (deployment(), "robot")):
        assert not isinstance(discovery(one, machine, tmp_path), DiscoveryServer)
