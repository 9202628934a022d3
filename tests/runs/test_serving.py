"""Limits of the page server: connections, slow requests and bodies, over real sockets."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

from socialbot.graph.files import load_graph
from socialbot.runs import _access
from socialbot.runs import serving as servers
from socialbot.runs.run import LiveRun
from socialbot.runs.serving import Address, serving

POST = b"POST /api/command HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setattr(servers, "REQUEST_WITHIN_S", 0.5)
    monkeypatch.setattr(servers, "MAX_CONNECTIONS", 5)
    monkeypatch.setattr(_access, "BODY_WITHIN_S", 0.5)
    with serving(LiveRun(load_graph("waldo")), Address(port=0)) as served:
        yield urlsplit(served.url).port or 0


def connection(port: int, data: bytes = b"") -> socket.socket:
    made = socket.create_connection(("127.0.0.1", port), timeout=30.0)
    made.sendall(data)
    return made


def answer(made: socket.socket) -> bytes:
    """Everything until the server closes the connection."""
    data = b""
    while part := made.recv(65536):
        data += part
    return data


@pytest.mark.parametrize("data", [b"", b"GET /api/run HTTP/1.1\r\nHost: localhost\r\nX-Slow: "])
def test_connection_without_a_whole_request_is_closed(port: int, data: bytes) -> None:
    with connection(port, data) as made:
        assert answer(made) == b""


def test_a_request_after_a_slow_answer_has_a_deadline(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    passed = threading.Event()
    monkeypatch.setattr(LiveRun, "picture", lambda *_: None if passed.wait(30.0) else pytest.fail("no deadline"))
    with connection(port, b"GET /api/picture HTTP/1.1\r\nHost: localhost\r\n\r\n") as made:
        with connection(port) as idle:
            assert answer(idle) == b""  # the first deadline of the older connection has passed, too
        passed.set()
        assert made.recv(65536).startswith(b"HTTP/1.1 204 ")
        made.sendall(b"GET /api/run HTTP/1.1\r\nX-Slow: ")
        assert answer(made) == b""


def test_idle_connections_lock_nobody_out_for_long(port: int) -> None:
    idle = [connection(port) for _ in range(5)]
    request = b"GET /api/run HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    with connection(port, request) as made:
        assert answer(made).startswith(b"HTTP/1.1 503 ")
    for each in idle:
        assert answer(each) == b""
        each.close()
    with connection(port, request) as made:
        assert answer(made).startswith(b"HTTP/1.1 200 ")


def test_slow_body_is_refused(port: int) -> None:
    with connection(port, POST + b"Content-Length: 20\r\n\r\n{") as made:
        assert made.recv(65536).startswith(b"HTTP/1.1 408 ")


@pytest.mark.parametrize("size", ["Content-Length: 100000", "Transfer-Encoding: chunked"])
def test_large_body_is_refused(port: int, size: str) -> None:
    body = json.dumps({"text": "x" * 99_000}).encode()
    if size.startswith("Transfer"):
        body = f"{len(body):x}\r\n".encode() + body + b"\r\n0\r\n\r\n"
    with connection(port, POST + size.encode() + b"\r\n\r\n") as made:
        made.sendall(body)
        assert made.recv(65536).startswith(b"HTTP/1.1 413 ")
