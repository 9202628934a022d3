"""Network of one machine: its addresses, and the discovery server of Fast DDS."""

from __future__ import annotations

import ipaddress
import logging
import math
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import psutil

from socialbot.bridge.environment import PROFILE_VARIABLE
from socialbot.core.errors import InstallationError
from socialbot.core.process import with_parent
from socialbot.runtime._processes import RestartBackoff, RestartPolicy, how_it_ended, in_time, opened_log

log = logging.getLogger("socialbot.network")

POLL_S = 0.5

UNCERTAIN_S = 5.0  # startup time in which a process may still miss a network


class Network:
    """Monitor of the network of ``address``, in a thread, since name look-ups may block.

    Use it as a context manager. It logs an address that is down at the start.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._wanted: frozenset[str] = frozenset()
        self._missed: tuple[float, float] | None = None
        self._lock = threading.Lock()
        self._down = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="network", daemon=True)

    def __enter__(self) -> Network:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()

    def missed(self) -> tuple[float, float] | None:
        """Start times (monotonic s) of processes that missed the network, returned once after it came up."""
        with self._lock:
            missed, self._missed = self._missed, None
        return missed

    def _watch(self) -> None:
        seen = -math.inf
        self._down = not self._is_up()
        if self._down:
            log.warning("%s is down on this machine: other machines are unreachable", self._address)
        while not self._closed.wait(POLL_S):
            is_up, now = self._is_up(), time.monotonic()
            if is_up and self._down:
                log.warning("%s is up now", self._address)
                with self._lock:  # join with an interval that was not returned yet
                    self._missed = (self._missed[0] if self._missed else seen - UNCERTAIN_S, now)
            if is_up:
                seen = now
            self._down = not is_up

    def _is_up(self) -> bool:
        """Whether this machine has the address and its network is up."""
        try:
            own = own_addresses()
        except OSError as error:  # such as too many open files
            log.debug("cannot read the addresses of this machine: %s", error)
            return not self._down
        if self._wanted.isdisjoint(own):  # the name may resolve to other addresses now
            self._wanted = addresses_of(self._address) or self._wanted
        if self._wanted and not beyond(self._wanted):  # its own host name: any network that other machines reach counts
            return bool(own & self._wanted or beyond(own))
        return not self._wanted.isdisjoint(own)


def addresses_of(name: str) -> frozenset[str]:
    """Return the IPv4 addresses of ``name``, if any."""
    try:
        found = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError:
        return frozenset()
    return frozenset(str(address[0]) for *_, address in found)


def own_addresses() -> frozenset[str]:
    """Return the IPv4 addresses of this machine on active networks."""
    states = psutil.net_if_stats()
    return frozenset(
        each.address
        for name, addresses in psutil.net_if_addrs().items()
        for each in addresses
        if each.family == socket.AF_INET and _is_running(states.get(name.partition(":")[0]))  # eth0:1 is one of eth0
    )


def beyond(addresses: frozenset[str]) -> frozenset[str]:
    """Return the addresses except loopback; a host name often resolves to 127.0.1.1."""
    return frozenset(address for address in addresses if not ipaddress.IPv4Address(address).is_loopback)


def _is_running(states: Any) -> bool:
    return states is not None and "running" in states.flags.split(",")


PROGRAM = "fast-discovery-server"
ENDED_S = 3.0


class DiscoveryServer:
    """Discovery server at ``address`` and ``port``, as a context manager.

    It logs to the file ``output``. Entering raises InstallationError if the program is missing.
    """

    def __init__(self, address: str, port: int, output: Path, policy: RestartPolicy) -> None:
        self._arguments = ("-i", "0", "-l", listening(address), "-p", str(port))
        self._output = output
        self._policy = policy
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = threading.Event()
        self._one_at_a_time = threading.Lock()
        self._keeper = threading.Thread(target=self._keep, name="discovery server", daemon=True)

    @property
    def pid(self) -> int | None:
        """Process id of the running server, else None."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def __enter__(self) -> DiscoveryServer:
        self._program = program()
        self._keeper.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._one_at_a_time:
            self._closed.set()
            if self._process is not None:
                self._process.terminate()
        self._keeper.join(ENDED_S)
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._keeper.join()

    def _keep(self) -> None:
        """Run and restart the server.

        This thread must outlive the server: the kernel kills it together with its parent thread.
        """
        backoff = RestartBackoff(self._policy)
        while (process := self._start()) is not None:
            backoff.started(time.monotonic())
            code = process.wait()
            if self._closed.is_set():
                return
            pause_s = backoff.crashed(time.monotonic())
            if pause_s is None:
                log.error("the discovery server is given up: it %s; its log: %s", how_it_ended(code), self._output)
                return
            log.warning("the discovery server %s; started again %s", how_it_ended(code), in_time(pause_s))
            self._closed.wait(pause_s)

    def _start(self) -> subprocess.Popen[bytes] | None:
        """Start the process, unless the server is closed."""
        with self._one_at_a_time, opened_log(self._output) as output:
            if self._closed.is_set():
                return None
            # Profiles apply to nodes only.
            variables = {name: value for name, value in os.environ.items() if name != PROFILE_VARIABLE}
            self._process = subprocess.Popen(
                with_parent([self._program, *self._arguments]),
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
            return self._process


def listening(address: str) -> str:
    """Return the address to listen on; host names may resolve differently on other machines."""
    try:
        return str(ipaddress.IPv4Address(address))
    except ValueError:
        return "0.0.0.0"


def program() -> str:
    """Return the path of the server. Raises InstallationError when it is missing."""
    beside = str(Path(sys.executable).parent)
    found = shutil.which(PROGRAM, path=os.pathsep.join([beside, os.environ.get("PATH", "")]))
    if found is None:
        raise InstallationError(
            f"there is no {PROGRAM}",
            remedy="it comes with the ROS wheels and with ROS; without it, let machines find each other by `peers`",
        )
    return found
