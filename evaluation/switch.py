"""Ethernet switch in user space, whose cables delay, overtake, lose and slow packets by a seed.

Linux does this with ``tc netem``, which many kernels lack. ``python -m evaluation.switch SEED PID:DEVICE...`` makes a
TAP device in the network namespace of each process and forwards packets between the devices. It answers ``ready``, then
reads the qualities of the cables from standard input, one line of JSON each, and answers each with ``ok``.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import itertools
import json
import math
import os
import random
import selectors
import struct
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
MOST_BYTES = 65536
BROADCAST = 1
"""Bit of the first byte of an Ethernet address of many receivers."""


@dataclass(frozen=True)
class Quality:
    """What a cable does with packets of each direction.

    Attributes:
        delay_ms: Time on the way.
        jitter_ms: Most that a packet is earlier or later, uniformly; packets overtake each other.
        loss: Share of packets lost.
        burst: Mean number of successive packets lost.
        mbit_s: Rate; None: unlimited.
        queue_ms: Most time that a packet waits for the rate; later ones are lost.
    """

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 0.0
    burst: float = 1.0
    mbit_s: float | None = None
    queue_ms: float = 50.0


@dataclass
class Direction:
    """Packets from one device to the others, with the model of losses in bursts by Gilbert (1960)."""

    random: random.Random
    quality: Quality = field(default_factory=Quality)
    _bad: bool = False
    _free_at: float = 0.0

    def due(self, size: int, now: float) -> float | None:
        """Return the arrival time (s) of a packet of ``size`` bytes sent ``now``; None if it is lost."""
        quality = self.quality
        if self._loses():
            return None
        sent = now
        if quality.mbit_s is not None:
            begin = max(now, self._free_at)
            if begin - now > quality.queue_ms / 1e3:
                return None
            self._free_at = sent = begin + size * 8 / (quality.mbit_s * 1e6)
        jitter = self.random.uniform(-quality.jitter_ms, quality.jitter_ms) if quality.jitter_ms else 0.0
        return sent + max(0.0, quality.delay_ms + jitter) / 1e3

    def _loses(self) -> bool:
        loss, burst = self.quality.loss, max(1.0, self.quality.burst)
        if not loss:
            return False
        leaves = 1 / burst
        enters = min(1.0, leaves * loss / (1 - loss)) if loss < 1 else 1.0
        self._bad = self.random.random() < (1 - leaves if self._bad and loss < 1 else enters)
        return self._bad


class Switch:
    """Forwards packets between the files of devices."""

    def __init__(self, devices: Iterable[int], seed: int) -> None:
        self._directions = {device: Direction(random.Random(seed + number)) for number, device in enumerate(devices)}
        self._ports: dict[bytes, int] = {}
        self._order = itertools.count()
        self._travelling: list[tuple[float, int, tuple[int, ...], bytes]] = []

    def set(self, quality: Quality) -> None:
        for direction in self._directions.values():
            direction.quality = quality

    def take(self, device: int, packet: bytes, now: float) -> None:
        """Take a packet that came from ``device``."""
        receiver, sender = packet[:6], packet[6:12]
        self._ports[sender] = device
        known = None if receiver[0] & BROADCAST else self._ports.get(receiver)
        ports = tuple(self._directions.keys() - {device}) if known is None else (known,)
        due = self._directions[device].due(len(packet), now)
        if due is not None and known != device:
            heapq.heappush(self._travelling, (due, next(self._order), ports, packet))

    def deliver(self, now: float) -> float:
        """Write all packets that have arrived, and return the time (s) to the next one; infinite without any."""
        while self._travelling and self._travelling[0][0] <= now:
            _, _, ports, packet = heapq.heappop(self._travelling)
            for port in ports:
                try:
                    os.write(port, packet)
                except OSError:  # the device is down, or full: as with a cable, the packet is lost
                    continue
        return self._travelling[0][0] - now if self._travelling else math.inf


def tap(pid: int, name: str) -> int:
    """Return the file of a new TAP device in the network namespace of a process, which this process then has, too."""
    with open(f"/proc/{pid}/ns/net") as namespace:
        if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace of {pid}")
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return device


def line(quality: Quality) -> str:
    """The line that sets a quality."""
    return json.dumps(asdict(quality)) + "\n"


def forward(switch: Switch, devices: Iterable[int]) -> None:
    """Forward until standard input ends."""
    with selectors.DefaultSelector() as selector:
        for device in devices:
            selector.register(device, selectors.EVENT_READ)
        selector.register(sys.stdin, selectors.EVENT_READ)
        wait_s = math.inf
        while True:
            for key, _ in selector.select(None if math.isinf(wait_s) else max(0.0, wait_s)):
                if key.fileobj is sys.stdin:
                    if not (text := sys.stdin.readline()):
                        return
                    switch.set(Quality(**json.loads(text)))
                    print("ok", flush=True)
                else:
                    _take_all(switch, key.fd)
            wait_s = switch.deliver(time.monotonic())


def _take_all(switch: Switch, device: int) -> None:
    while True:
        try:
            packet = os.read(device, MOST_BYTES)
        except BlockingIOError:
            return
        switch.take(device, packet, time.monotonic())


def main(seed: str, *ports: str) -> None:
    """Make the devices, each given as ``PID:DEVICE``, and forward between them."""
    devices = [tap(int(pid), name) for pid, name in (port.split(":") for port in ports)]
    print("ready", flush=True)
    forward(Switch(devices, int(seed)), devices)


if __name__ == "__main__":
    main(*sys.argv[1:])
