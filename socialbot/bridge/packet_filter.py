"""Filter in the kernel for RTPS packets to the lists of nodes, which DDS itself reads (``ros_discovery_info``).

Fast DDS 2.14 can free a message that stays in the queue of a reliable subscription: a GAP about a message of which only
parts have come does that. Reading it never ends, and blocks discovery. `socialbot.bridge.wait_sets` reads other
messages as bytes, but the middleware itself reads the lists of nodes.

These lists come to UDP ports of their own, where packets with a GAP are dropped. They are not needed there: a process
keeps only its last list, and its heartbeats tell that earlier ones are gone.

A filter on all ports is not possible. Classic BPF has no loops, 4096 instructions at most, and no memory between
packets. True packets of discovery have up to 353 submessages (400 topics), and a filter cannot tell how far a HEARTBEAT
jumps.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import stat
import struct
from pathlib import Path

NAMES_PORTS = range(7000, 7400)
"""UDP ports of the lists of nodes, in all domains."""

MAX_SUBMESSAGES = 32
"""Most submessages of a packet that is let through. A list of nodes has three or four."""

_SO_ATTACH_FILTER = 26
_UDP_HEADER_BYTES, _RTPS_HEADER_BYTES = 8, 20
_GAP, _PAD, _INFO_TS = 0x08, 0x01, 0x09
_DROP, _PASS = 0, 0xFFFFFFFF

# Instructions of classic BPF: A is the accumulator, X the place of a submessage, M the memory.
_LOAD_LENGTH, _LOAD_WORD, _LOAD_BYTE, _LOAD_NUMBER = 0x80, 0x20, 0x50, 0x00  # A = size of packet, [k], [X + k], k
_X_NUMBER, _X_MEMORY, _TO_X, _STORE, _STORE_X = 0x01, 0x61, 0x07, 0x02, 0x03  # X = k, M[k], A; M[k] = A, X
_ADD, _ADD_X, _SUBTRACT_X, _SHIFT = 0x04, 0x0C, 0x1C, 0x64
_IF_EQUAL, _IF_AT_LEAST, _IF_BITS, _RETURN = 0x15, 0x35, 0x45, 0x06

_SUBMESSAGE = (
    (_LOAD_LENGTH, 0, 0, 0),
    (_SUBTRACT_X, 0, 0, 0),
    (_IF_EQUAL, 0, 1, 0),
    (_RETURN, 0, 0, _PASS),  # the end of the packet
    (_LOAD_BYTE, 0, 0, 0),
    (_IF_EQUAL, 2, 0, _GAP),
    (_LOAD_BYTE, 0, 0, 1),
    (_IF_BITS, 1, 0, 1),
    (_RETURN, 0, 0, _DROP),  # a GAP, or not in little-endian order
    (_STORE_X, 0, 0, 1),
    (_LOAD_BYTE, 0, 0, 3),
    (_SHIFT, 0, 0, 8),
    (_STORE, 0, 0, 0),
    (_LOAD_BYTE, 0, 0, 2),
    (_X_MEMORY, 0, 0, 0),
    (_ADD_X, 0, 0, 0),
    (_X_MEMORY, 0, 0, 1),
    (_IF_EQUAL, 0, 5, 0),
    (_LOAD_BYTE, 0, 0, 0),  # up to the end of the packet, or empty
    (_IF_EQUAL, 2, 0, _PAD),
    (_IF_EQUAL, 1, 0, _INFO_TS),
    (_RETURN, 0, 0, _PASS),
    (_LOAD_NUMBER, 0, 0, 0),
    (_ADD, 0, 0, 4),
    (_ADD_X, 0, 0, 0),
    (_TO_X, 0, 0, 0),
)
_PROGRAM = (
    (_LOAD_LENGTH, 0, 0, 0),
    (_IF_AT_LEAST, 0, 2, _UDP_HEADER_BYTES + 4),
    (_LOAD_WORD, 0, 0, _UDP_HEADER_BYTES),
    (_IF_EQUAL, 1, 0, int.from_bytes(b"RTPS", "big")),
    (_RETURN, 0, 0, _PASS),  # of another program
    (_X_NUMBER, 0, 0, _UDP_HEADER_BYTES + _RTPS_HEADER_BYTES),
    *_SUBMESSAGE * MAX_SUBMESSAGES,
    (_RETURN, 0, 0, _DROP),
)


def drop_gaps(udp: socket.socket) -> None:
    """Let the kernel drop RTPS packets with a GAP that come to ``udp``."""
    text = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *each) for each in _PROGRAM))
    udp.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("@HP", len(_PROGRAM), ctypes.addressof(text)))


def protect_names() -> None:
    """Let the kernel drop packets with a GAP to the lists of nodes of this process."""
    for path in Path("/proc/self/fd").glob("*"):
        with contextlib.suppress(OSError):  # closed meanwhile
            if stat.S_ISSOCK(path.stat().st_mode):
                with socket.socket(fileno=os.dup(int(path.name))) as one:
                    is_udp = one.family == socket.AF_INET and one.type == socket.SOCK_DGRAM
                    if is_udp and one.getsockname()[1] in NAMES_PORTS:
                        drop_gaps(one)
