"""The two hosts made of namespaces are what tests of bad networks take them for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.running import next_line
from tests.system.two_hosts import WORKSTATION, TwoHosts, two_hosts

RECEIVE = """
import socket
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
SO_RCVBUFFORCE = 33  # Python has no name for it.
server.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 1 << 23)
server.bind(("", 5005))
print("ready", flush=True)
input()  # everything is sent, and waits in the buffer
server.settimeout(0.5)
got = 0
try:
    while True:
        server.recv(2000)
        got += 1
except TimeoutError:
    print(got, flush=True)
"""
SEND = f"""
import socket
client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(1000):
    try:
        client.sendto(bytes(1000), ("{WORKSTATION}", 5005))
    except OSError:
        pass
"""


@pytest.fixture(scope="module")
def hosts() -> Iterator[TwoHosts]:
    with two_hosts() as hosts:
        yield hosts


def arrived(hosts: TwoHosts) -> int:
    """Return how many of 1000 packets in one burst arrive."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    receiver = hosts.workstation.start(sys.executable, "-c", RECEIVE, **pipes)
    assert next_line(receiver)
    hosts.robot.run(sys.executable, "-c", SEND)
    return int(receiver.communicate("\n", timeout=180)[0])


def test_the_cable_carries_loses_and_is_cut(hosts: TwoHosts) -> None:
    assert arrived(hosts) == 1000
    hosts.lose(20)
    assert 700 < arrived(hosts) < 900
    hosts.clear()
    hosts.limit(8.0)
    assert arrived(hosts) < 300  # 50 ms and a burst of 8 Mbit/s, and what goes while the rest comes.
    hosts.clear()
    hosts.cut()
    assert arrived(hosts) == 0
    hosts.clear()
    assert arrived(hosts) == 1000


def test_the_hosts_share_no_memory(hosts: TwoHosts) -> None:
    hosts.robot.run("touch", "/dev/shm/socialbot-mark")
    assert "socialbot-mark" in hosts.robot.run("ls", "/dev/shm")
    assert "socialbot-mark" not in hosts.workstation.run("ls", "/dev/shm")
    assert not Path("/dev/shm/socialbot-mark").exists()


def test_nothing_is_left_behind_when_a_test_fails() -> None:
    names: list[str] = []

    def fail() -> None:
        with two_hosts() as hosts:
            names.extend((hosts.robot.name, hosts.workstation.name))
            assert all(name in namespaces() for name in names)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not any(name in namespaces() for name in names)


def namespaces() -> str:
    return subprocess.check_output(["ip", "netns"], text=True)
