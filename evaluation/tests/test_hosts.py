"""Real datagrams between hosts at a switch and behind a router."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from evaluation import hosts as hosts_module
from evaluation.hosts import (
    FAR_WORKSTATION,
    ROBOT,
    SECOND_ROBOT,
    WORKSTATION,
    Host,
    NoHostsError,
    obstacle,
    routed_hosts,
    switched_hosts,
)
from evaluation.switch import Quality
from tests.system.running import next_line

pytestmark = pytest.mark.slow

ECHO = """
import socket
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as answers:
    answers.bind(("", 9000))
    print("ready", flush=True)
    while True:
        data, sender = answers.recvfrom(65536)
        answers.sendto(data, sender)
"""
ASK = """
import json, socket, sys, time
address, count, size, pause_s = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
came = []
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asks:
    asks.settimeout(0.001)
    begun, end = {}, None
    sent = 0
    while end is None or (time.monotonic() < end and len(came) < count):
        if sent < count:
            begun[sent] = time.monotonic()
            try:
                asks.sendto(sent.to_bytes(4, "big").ljust(size, b"x"), (address, 9000))
            except OSError:
                pass
            sent += 1
            time.sleep(pause_s)
        elif end is None:
            end = time.monotonic() + 1.0
        try:
            while True:
                number = int.from_bytes(asks.recv(65536)[:4], "big")
                came.append((number, time.monotonic() - begun[number]))
        except OSError:
            pass
print(json.dumps(came))
"""


@contextmanager
def echo(host: Host) -> Iterator[None]:
    process = host.start(sys.executable, "-c", ECHO, stdout=subprocess.PIPE)
    assert next_line(process)
    try:
        yield
    finally:
        process.kill()
        process.communicate()


def ask(host: Host, address: str, count: int = 100, size: int = 200, pause_s: float = 0.002) -> list[tuple[int, float]]:
    """Number and time to the answer (s) of each datagram that was answered, in the order of the answers."""
    return [(number, s) for number, s in json.loads(host.run(sys.executable, "-c", ASK, address, count, size, pause_s))]


@pytest.fixture(scope="module")
def net():
    try:
        with (
            switched_hosts(ROBOT, WORKSTATION, SECOND_ROBOT, seed=3) as made,
            echo(made.workstation),
            echo(made.hosts[2]),
        ):
            yield made
    except NoHostsError as reason:
        pytest.skip(f"no hosts: {reason}")


class TestSwitch:
    def test_connects_three_hosts(self, net):
        net.set(Quality())
        assert len(ask(net.robot, WORKSTATION)) == len(ask(net.robot, SECOND_ROBOT)) == 100

    def test_delays_and_reorders(self, net):
        net.set(Quality(delay_ms=40, jitter_ms=30))
        came = ask(net.robot, WORKSTATION)
        assert len(came) == 100
        assert statistics.median(s for _, s in came) >= 0.080
        assert min(s for _, s in came) >= 0.020
        assert [number for number, _ in came] != sorted(number for number, _ in came)

    def test_loses_in_bursts(self, net):
        net.set(Quality(loss=0.2, burst=5))
        lost = set(range(1000)) - {number for number, _ in ask(net.robot, WORKSTATION, 1000, pause_s=0.0005)}
        runs = sum(number - 1 not in lost for number in lost)
        assert 0.25 <= len(lost) / 1000 <= 0.47, "both ways lose a fifth"
        assert 3 <= len(lost) / runs <= 8

    def test_slows_and_drops_what_waits_too_long(self, net):
        net.set(Quality(mbit_s=1.0, queue_ms=50))
        came = ask(net.robot, WORKSTATION, 100, 1250, 0.0)
        assert 5 <= len(came) < 50, "10 ms a packet, and five packets in the queue"

    def test_host_is_cut_off_and_comes_back(self, net):
        net.set(Quality())
        net.hosts[2].cut()
        assert not ask(net.robot, SECOND_ROBOT, 5)
        assert len(ask(net.robot, WORKSTATION, 5)) == 5
        net.hosts[2].mend()
        net.hosts[2].wait_for_carrier()
        assert ask(net.robot, SECOND_ROBOT, 50)


class TestRouter:
    @pytest.mark.parametrize("mtu", [1500, 1280])
    def test_connects_two_subnets(self, mtu):
        with routed_hosts(mtu=mtu) as net, echo(net.workstation):
            came = ask(net.robot, FAR_WORKSTATION, 20, 1400)
            assert len(came) >= 18, "the first teach the host the size"

    def test_hides_addresses(self):
        with routed_hosts(nat=True) as net:
            with echo(net.robot):
                assert len(ask(net.workstation, ROBOT, 20)) == 20
            with echo(net.workstation):
                assert not ask(net.robot, FAR_WORKSTATION, 20)


def test_a_namespace_that_another_run_removes_at_the_same_time_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    if reason := obstacle():
        pytest.skip(reason)
    ended = subprocess.Popen(["true"])
    ended.wait()
    name, run = f"sbt{ended.pid}_0a", hosts_module._run
    run("ip", "netns", "add", name)

    def run_late(*command: str) -> str:
        run(*command)
        return run(*command)

    monkeypatch.setattr(hosts_module, "_run", run_late)
    hosts_module._remove_stale()
    assert name not in run("ip", "netns", "list")
