"""Two hosts on one machine: network namespaces with a configurable virtual cable.

Each host has its own address and /dev/shm, so that all traffic uses the cable. This needs root, ``ip`` and ``tc``
(iproute2), ``nsenter`` (util-linux) and ``nft`` (nftables).
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROBOT, WORKSTATION = "10.77.0.1", "10.77.0.2"
TOOLS = ("ip", "tc", "nft", "nsenter", "unshare")
LOSS = """
flush ruleset
add table netdev cable
add chain netdev cable arriving {{ type filter hook ingress device {device} priority 0; }}
add rule netdev cable arriving numgen random mod 100 < {percent} drop
"""
CARRIER_WITHIN_S = 10.0
NAMES = re.compile(r"sbt(\d+)_\d+[ab]")

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
        while self.run("cat", f"/sys/class/net/{self.device}/operstate").strip() != "up":
            if time.monotonic() > end:
                raise RuntimeError(f"{self.device}: is not up after {CARRIER_WITHIN_S:g} s")
            time.sleep(0.02)


@dataclass(frozen=True)
class TwoHosts:
    """Hosts ``robot`` and ``workstation`` with their cable."""

    robot: Host
    workstation: Host

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
        self.robot.run("ip", "link", "set", self.robot.device, "down")

    def mend(self) -> None:
        """Bring the cable up."""
        self.robot.run("ip", "link", "set", self.robot.device, "up")

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
    if reason := obstacle():
        raise NoHostsError(reason)
    _remove_stale()
    number = next(_numbers)
    names = [f"sbt{os.getpid()}_{number}{end}" for end in "ab"]
    with ExitStack() as undo:
        hosts = [_host(undo, name, address) for name, address in zip(names, (ROBOT, WORKSTATION), strict=True)]
        _run("ip", "-n", names[0], "link", "add", names[0], "type", "veth", "peer", names[1], "netns", names[1])
        for host in hosts:
            host.run("ip", "address", "add", f"{host.address}/24", "dev", host.device)
            host.run("ip", "link", "set", "lo", "up")
            host.run("ip", "link", "set", host.device, "up")
        for host in hosts:
            host.wait_for_carrier()
        yield TwoHosts(*hosts)


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
            _run("ip", "netns", "delete", path.name)


def _run(*command: str) -> str:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout
