"""A daemon of a Reachy Mini that answers without end, too much, elsewhere, or nonsense."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from socialbot.core.errors import DeviceError
from socialbot.robots.daemon_client import LONGEST_REASON, DaemonClient, TargetStream
from socialbot.robots.reachy_mini import present_pose
from tests.system.running import PATIENCE_S, eventually

LIMIT_S = 0.5
HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
ENDLESS = HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
POSE = {"x": 0.0, "y": 0.0, "z": 0.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}


def whole(body: bytes) -> bytes:
    return HEAD + f"Content-Length: {len(body)}\r\n\r\n".encode() + body


@contextmanager
def daemon(first: bytes, again: bytes = b"", pause_s: float = 0.0) -> Iterator[str]:
    """Address of a server that answers each connection with ``first``, then with ``again`` for ever."""
    listener = socket.create_server(("127.0.0.1", 0))
    ended = threading.Event()

    def answer(connection: socket.socket) -> None:
        with connection, suppress(OSError):
            connection.recv(65536)
            connection.sendall(first)
            while again and not ended.wait(pause_s):
                connection.sendall(again)
            ended.wait(PATIENCE_S)

    def serve() -> None:
        with suppress(OSError):
            while not ended.is_set():
                threading.Thread(target=answer, args=(listener.accept()[0],), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        ended.set()
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


@pytest.mark.parametrize(
    ("first", "again", "pause_s"),
    [
        pytest.param(b"HTTP/1.1 200 OK\r\nX: ", b"x", 0.05, id="head byte by byte"),
        pytest.param(b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.05, id="continue without end"),
        pytest.param(ENDLESS, b"1\r\n \r\n", 0.05, id="body byte by byte"),
        pytest.param(ENDLESS, b"10000\r\n" + b" " * 0x10000 + b"\r\n", 0.0, id="body without end"),
        pytest.param(HEAD + b"Content-Length: 99999999999999\r\n\r\n", b" " * 65536, 0.0, id="length"),
        pytest.param(whole(b"[" * 100_000), b"", 0.0, id="nesting"),
        pytest.param(whole(b'{"state": ' + b"9" * 5000 + b"}"), b"", 0.0, id="digits"),
        pytest.param(whole(b"\xff\xfe"), b"", 0.0, id="encoding"),
        pytest.param(b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 2\r\n\r\n{}", b"", 0.0),
    ],
)
def test_an_answer_without_end_or_sense_is_refused_in_time(first: bytes, again: bytes, pause_s: float) -> None:
    with daemon(first, again, pause_s) as url:
        client = DaemonClient(url, timeout_s=LIMIT_S)
        begin = time.monotonic()
        with pytest.raises(DeviceError):
            client.status()
        assert time.monotonic() - begin < 10 * LIMIT_S
        client.close()


def test_the_reason_of_a_daemon_is_cut() -> None:
    reasons: list[str] = []
    with daemon(whole(json.dumps({"state": "error", "error": "x" * 100_000}).encode())) as url:
        stream = TargetStream(url, lambda _: None, reasons.append)
        assert eventually(lambda: reasons != [])
        stream.close()
    assert len(reasons[0]) < 2 * LONGEST_REASON


@pytest.mark.parametrize(
    "state",
    [
        {},
        {"head_pose": [], "antennas_position": [0.0, 0.0]},
        {"head_pose": POSE, "antennas_position": [0.0]},
        {"head_pose": POSE, "antennas_position": None},
        *(
            {"head_pose": {**POSE, "yaw": value}, "antennas_position": [0.0, 0.0]}
            for value in (float("nan"), float("inf"), 1e300, 10**400, "east", None, {})
        ),
    ],
)
def test_nonsense_is_no_pose(state: dict[str, Any]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError, OverflowError)):
        present_pose(state)
