"""The network of the machine that a half of a deployment runs on, which may come late, and go and come again.

Processes that start without it never get to know of it, as DDS looks for networks once; those that have started with it
find it again. So the former are to be started anew when it has come.
"""

from __future__ import annotations

import logging
import math
import socket
import threading
import time

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
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="network", daemon=True)

    def __enter__(self) -> Network:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()

    def missed(self) -> tuple[float, float] | None:
        """When it has come since this was asked last: who started between these times (monotonic s) has missed it."""
        missed, self._missed = self._missed, None
        return missed

    def _watch(self) -> None:
        seen = -math.inf
        away = not self._is_up()
        if away:
            log.warning("%s is not up on this machine: others cannot be reached without", self._address)
        while not self._closed.wait(LOOK_AGAIN_S):
            is_up, now = self._is_up(), time.monotonic()
            if is_up and away:
                log.warning("%s is up now", self._address)
                self._missed = (seen - UNCERTAIN_S, now)
            if is_up:
                seen = now
            away = not is_up

    def _is_up(self) -> bool:
        """Whether the address is one of this machine's, and its network is up."""
        self._wanted = self._wanted or addresses_of(self._address)
        return not self._wanted.isdisjoint(own_addresses())


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
        if each.family == socket.AF_INET and name in states and "running" in states[name].flags.split(",")
    )
