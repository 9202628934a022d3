"""The network of the machine that a half of a deployment runs on, which may come late, and go and come again.

Processes that start without it never get to know of it, as DDS looks for networks once; those that have started with it
find it again. So the former are to be started anew when it has come.
"""

from __future__ import annotations

import ipaddress
import logging
import math
import socket
import threading
import time
from typing import Any

import psutil

LOOK_AGAIN_S = 0.5

UNCERTAIN_S = 5.0
"""Who starts looks for networks within this time."""

log = logging.getLogger("socialbot.network")


class Network:
    """Looks whether ``address`` is there, from a thread of its own, as to look a name up may take long.

    Use it as a context manager. It says so when the address is not there at first.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._wanted: frozenset[str] = frozenset()
        self._missed: tuple[float, float] | None = None
        self._one_at_a_time = threading.Lock()
        self._away = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="network", daemon=True)

    def __enter__(self) -> Network:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()

    def missed(self) -> tuple[float, float] | None:
        """When it has come since this was asked last: who started between these times (monotonic s) has missed it."""
        with self._one_at_a_time:
            missed, self._missed = self._missed, None
        return missed

    def _watch(self) -> None:
        seen = -math.inf
        self._away = not self._is_up()
        if self._away:
            log.warning("%s is not up on this machine: others cannot be reached without", self._address)
        while not self._closed.wait(LOOK_AGAIN_S):
            is_up, now = self._is_up(), time.monotonic()
            if is_up and self._away:
                log.warning("%s is up now", self._address)
                with self._one_at_a_time:  # who asks seldom is told of all times together
                    self._missed = (self._missed[0] if self._missed else seen - UNCERTAIN_S, now)
            if is_up:
                seen = now
            self._away = not is_up

    def _is_up(self) -> bool:
        """Whether the address is one of this machine's, and its network is up."""
        try:
            own = own_addresses()
        except OSError as error:  # such as too many open files
            log.debug("this machine's addresses are not known now: %s", error)
            return not self._away
        if self._wanted.isdisjoint(own):  # what a name stands for may not be known yet, or may have changed
            self._wanted = addresses_of(self._address) or self._wanted
        if self._wanted and not beyond(self._wanted):  # its own name: any network by which others may come counts
            return bool(own & self._wanted or beyond(own))
        return not self._wanted.isdisjoint(own)


def addresses_of(name: str) -> frozenset[str]:
    """The IPv4 addresses that ``name`` stands for, as far as that is known now."""
    try:
        found = socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError:
        return frozenset()
    return frozenset(str(address[0]) for *_, address in found)


def own_addresses() -> frozenset[str]:
    """The IPv4 addresses of this machine whose networks are up: they run, as a cable is plugged in, or Wi-Fi joined."""
    states = psutil.net_if_stats()
    return frozenset(
        each.address
        for name, addresses in psutil.net_if_addrs().items()
        for each in addresses
        if each.family == socket.AF_INET and _is_running(states.get(name.partition(":")[0]))  # eth0:1 is one of eth0
    )


def beyond(addresses: frozenset[str]) -> frozenset[str]:
    """Those that do not just reach this machine, as that does which its own name often stands for (127.0.1.1)."""
    return frozenset(address for address in addresses if not ipaddress.IPv4Address(address).is_loopback)


def _is_running(states: Any) -> bool:
    return states is not None and "running" in states.flags.split(",")
