"""Hosts on one machine: network namespaces with a virtual cable, a switch in user space, or a router between them.

Each host has its own address and /dev/shm, so that all traffic uses the network. This needs root, ``ip`` and ``tc``
(iproute2), ``nsenter`` (util-linux) and ``nft`` (nftables); the switch also needs /dev/net/tun.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from evaluation.switch import Quality, line

ROBOT, WORKSTATION, SECOND_ROBOT = "10.77.0.1", "10.77.0.2", "10.77.0.3"
FAR_WORKSTATION = "10.78.0.1"
"""Address in another subnet, behind a router."""
ROUTER = ("10.77.0.254", "10.78.0.254")
ROOT = Path(__file__).parents[1]
TOOLS = ("ip", "tc", "nft", "nsenter", "unshare")
LOSS = """
flush ruleset
add table netdev cable
add chain netdev cable arriving {{ type filter hook ingress device {device} priority 0; }}
add rule netdev cable arriving numgen random mod 100 < {percent} drop
"""
NAT = """
add table ip nat
add chain ip nat leaving { type nat hook postrouting priority 100; }
add rule ip nat leaving oif way0 masquerade
add table ip guard
add chain ip guard passing { type filter hook forward priority 0; }
add rule ip guard passing iif way0 ct state new drop
"""
CARRIER_WITHIN_S = 10.0
NAMES = re.compile(r"sbt(\d+)_\d+[a-z]r?")

_numbers = itertools.count()


class NoHostsError(Exception):
    """Hosts cannot be created; the text gives the reason."""


@dataclass(frozen=True)
class Host:
    """Host; the process ``keeper`` holds its namespaces."""

    name: str
    address: str
    device: str
    keeper: int

    def command(self, *arguments: object) -> list[str]:
        """Return the command line that runs ``arguments`` on this host, in the current folder."""
        inside = ["nsenter", f"--target={self.keeper}", "--net", "--mount", "--"]
        return [*inside, "sh", "-c", 'cd "$0" && exec "$@"', os.getcwd(), *map(str, arguments)]

    def start(self, *arguments: object, variables: Mapping[str, str] | None = None, **options: Any) -> subprocess.Popen:
        """Start a process on this host with additional ``variables``; its pid is that of the command."""
        environment = {**os.environ, **(variables or {})}
        return subprocess.Popen(self.command(*arguments), env=environment, **{"stdin": subprocess.DEVNULL, **options})

    def run(self, *arguments: object) -> str:
        """Return the output of a command.

        Raises:
            RuntimeError: The command fails.
        """
        return _run(*self.command(*arguments))

    def wait_for_carrier(self) -> None:
        """Wait until this end of the cable is up; earlier processes, such as Fast DDS, find no network.

        Raises:
            RuntimeError: It does not come up.
        """
        end = time.monotonic() + CARRIER_WITHIN_S
        while self.run("cat", f"/sys/class/net/{self.device}/operstate").strip() == "down":
            if time.monotonic() > end:
                raise RuntimeError(f"{self.device}: is not up after {CARRIER_WITHIN_S:g} s")
            time.sleep(0.02)

    def cut(self) -> None:
        """Take this end of the cable down."""
        self.run("ip", "link", "set", self.device, "down")

    def mend(self) -> None:
        """Bring this end of the cable up."""
        self.run("ip", "link", "set", self.device, "up")


class Network(Protocol):
    """Hosts by the names of machines of a deployment: at least ``robot`` and ``workstation``."""

    @property
    def machines(self) -> Mapping[str, Host]: ...


N = TypeVar("N", bound=Network)


@dataclass(frozen=True)
class SwitchedHosts:
    """Hosts at a switch in user space, whose cables have a quality."""

    hosts: tuple[Host, ...]
    _switch: subprocess.Popen[str]

    @property
    def machines(self) -> Mapping[str, Host]:
        """The hosts by the names of machines of a deployment; ``second`` is another robot."""
        return dict(zip(("robot", "workstation", "second"), self.hosts, strict=False))

    @property
    def robot(self) -> Host:
        return self.hosts[0]

    @property
    def workstation(self) -> Host:
        return self.hosts[1]

    def set(self, quality: Quality) -> None:
        """Give all cables this quality, for packets that are sent from now on."""
        assert self._switch.stdin is not None
        self._switch.stdin.write(line(quality))
        self._switch.stdin.flush()
        self._await("ok")

    def _await(self, answer: str) -> None:
        assert self._switch.stdout is not None
        if (said := self._switch.stdout.readline().strip()) != answer:
            raise RuntimeError(f"the switch said {said!r} instead of {answer!r}")


@dataclass(frozen=True)
class _Pair:
    robot: Host
    workstation: Host

    @property
    def machines(self) -> Mapping[str, Host]:
        """The hosts by the names of machines of a deployment."""
        return {"robot": self.robot, "workstation": self.workstation}


@dataclass(frozen=True)
class RoutedHosts(_Pair):
    """Hosts ``robot`` and ``workstation`` in two subnets with a router between them."""

    router: str


class TwoHosts(_Pair):
    """Hosts ``robot`` and ``workstation`` with their cable."""

    def limit(self, mbit_s: float, *, queue_ms: int = 50) -> None:
        """Limit each direction to ``mbit_s`` Mbit/s; drop packets queued for more than ``queue_ms``."""
        for host in self._hosts:
            host.run("tc", "qdisc", "replace", "dev", host.device, "root", "tbf", "rate", f"{round(mbit_s * 1000)}kbit",
                     "burst", "4kb", "latency", f"{queue_ms}ms")  # fmt: skip

    def lose(self, percent: int) -> None:
        """Drop ``percent`` of the packets at random in each direction."""
        for host in self._hosts:
            host.run("nft", LOSS.format(device=host.device, percent=percent))

    def cut(self) -> None:
        self.robot.cut()

    def mend(self) -> None:
        """Bring the cable up."""
        self.robot.mend()

    def clear(self) -> None:
        """Restore the cable: no limit, no loss, up."""
        for host in self._hosts:
            host.run("nft", "flush", "ruleset")
            if "tbf" in host.run("tc", "qdisc", "show", "dev", host.device):
                host.run("tc", "qdisc", "del", "dev", host.device, "root")
        self.mend()

    def sent_bytes(self) -> tuple[int, int]:
        """Bytes sent over the cable by robot and workstation since its creation."""
        robot, workstation = (
            int(host.run("cat", f"/sys/class/net/{host.device}/statistics/tx_bytes")) for host in self._hosts
        )
        return robot, workstation

    @property
    def _hosts(self) -> tuple[Host, Host]:
        return self.robot, self.workstation


def obstacle() -> str:
    """Return the reason why hosts cannot be created; empty if they can."""
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        return f"not installed: {', '.join(missing)}"
    if os.geteuid() != 0:
        return "only root can make network namespaces"
    try:
        _run("unshare", "--net", "--mount", "nft", "list", "ruleset")
    except RuntimeError as error:
        return f"no right to make network namespaces: {error}"
    return ""


@contextmanager
def two_hosts() -> Iterator[TwoHosts]:
    """Create two hosts for the block.

    Raises:
        NoHostsError: They cannot be created.
    """
    with _hosts((ROBOT, WORKSTATION)) as hosts:
        robot, workstation = hosts
        _connect(robot.device, robot.device, workstation.device, workstation.device)
        for host in hosts:
            _address(host)
        for host in hosts:
            host.wait_for_carrier()
        yield TwoHosts(*hosts)


@contextmanager
def switched_hosts(*addresses: str, seed: int = 1) -> Iterator[SwitchedHosts]:
    """Create hosts with these addresses for the block, at a switch in user space. The seed is that of its losses.

    Raises:
        NoHostsError: They cannot be created.
    """
    if not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        raise NoHostsError("no TAP devices: /dev/net/tun cannot be opened")
    with _hosts(addresses) as hosts:
        ports = [f"{host.keeper}:{host.device}" for host in hosts]
        switch = subprocess.Popen(
            [sys.executable, "-m", "evaluation.switch", str(seed), *ports],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            made = SwitchedHosts(tuple(hosts), switch)
            made._await("ready")
            for host in hosts:
                _address(host)
            for host in hosts:
                host.wait_for_carrier()
            yield made
        finally:
            switch.communicate()


@contextmanager
def routed_hosts(*, mtu: int = 1500, nat: bool = False) -> Iterator[RoutedHosts]:
    """Create a robot and a workstation in two subnets for the block.

    Args:
        mtu: Largest packet, in bytes, between router and workstation; the robot learns it from the router.
        nat: The robot sees the address of the router instead of that of the workstation, and cannot call it.

    Raises:
        NoHostsError: They cannot be created.
    """
    with _hosts((ROBOT, FAR_WORKSTATION)) as hosts, ExitStack() as undo:
        router = f"{hosts[0].name}r"
        _run("ip", "netns", "add", router)
        undo.callback(_run, "ip", "netns", "delete", router)
        inside = ("ip", "netns", "exec", router)
        for number, (host, way) in enumerate(zip(hosts, ROUTER, strict=True)):
            device = f"way{number}"
            _connect(host.device, host.device, router, device)
            _address(host)
            _run(*inside, "ip", "address", "add", f"{way}/24", "dev", device)
            _run(*inside, "ip", "link", "set", device, "up")
            host.run("ip", "route", "add", "default", "via", way)
        _run(*inside, "ip", "link", "set", "way1", "mtu", str(mtu))
        hosts[1].run("ip", "link", "set", hosts[1].device, "mtu", mtu)
        _run(*inside, "sysctl", "-q", "-w", "net.ipv4.ip_forward=1")
        if nat:
            _run(*inside, "nft", NAT)
        for host in hosts:
            host.wait_for_carrier()
        yield RoutedHosts(*hosts, router=router)


@contextmanager
def _hosts(addresses: Sequence[str]) -> Iterator[list[Host]]:
    if reason := obstacle():
        raise NoHostsError(reason)
    _remove_stale()
    number = next(_numbers)
    with ExitStack() as undo:
        yield [_host(undo, f"sbt{os.getpid()}_{number}{chr(97 + n)}", one) for n, one in enumerate(addresses)]


def _connect(first: str, device: str, second: str, other: str) -> None:
    """Connect two network namespaces by a cable with these devices."""
    _run("ip", "-n", first, "link", "add", device, "type", "veth", "peer", other, "netns", second)


def _address(host: Host) -> None:
    host.run("ip", "address", "add", f"{host.address}/24", "dev", host.device)
    host.run("ip", "link", "set", "lo", "up")
    host.run("ip", "link", "set", host.device, "up")


def _host(undo: ExitStack, name: str, address: str) -> Host:
    _run("ip", "netns", "add", name)
    undo.callback(_run, "ip", "netns", "delete", name)
    keep = "mount -t tmpfs none /dev/shm && echo && exec sleep infinity"
    keeper = subprocess.Popen(
        ["ip", "netns", "exec", name, "unshare", "--mount", "sh", "-c", keep], stdout=subprocess.PIPE, text=True
    )
    undo.callback(_end, keeper)
    assert keeper.stdout is not None
    if not keeper.stdout.readline():
        raise RuntimeError(f"{name}: cannot have a /dev/shm of its own")
    return Host(name, address, name, keeper.pid)


def _end(keeper: subprocess.Popen[str]) -> None:
    keeper.send_signal(signal.SIGKILL)
    keeper.communicate()


def _remove_stale() -> None:
    for path in Path("/run/netns").glob("sbt*"):
        match = NAMES.fullmatch(path.name)
        if match and not Path(f"/proc/{match[1]}").exists():
            try:
                _run("ip", "netns", "delete", path.name)
            except RuntimeError:
                if path.exists():  # no other run has removed it
                    raise


def _run(*command: str) -> str:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout
