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
from tests.system.running import eventually

POST = b"POST /api/command HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setattr(servers, "REQUEST_WITHIN_S", 0.5)
    monkeypatch.setattr(servers, "TAKEN_WITHIN_S", 0.5)
    monkeypatch.setattr(servers, "MAX_CONNECTIONS", 5)
    monkeypatch.setattr(_access, "BODY_WITHIN_S", 0.5)
    with serving(LiveRun(load_graph("waldo")), Address(port=0)) as served:
        yield urlsplit(served.url).port or 0


def connection(port: int, data: bytes = b"") -> socket.socket:
    made = socket.create_connection(("127.0.0.1", port), timeout=30.0)
    made.sendall(data)
    return made


def answer(made: socket.socket, size: int = 65536) -> bytes:
    """Everything until the server closes the connection, read in parts of ``size`` bytes."""
    data = b""
    while part := made.recv(size):
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


def is_open(made: socket.socket) -> bool:
    """Whether the server keeps a connection to which it has sent nothing."""
    made.setblocking(False)
    try:
        return bool(made.recv(1))
    except BlockingIOError:
        return True
    except ConnectionResetError:
        return False


def test_idle_connections_take_a_limited_number_of_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or else `up` could start no process and write no record while a stranger opens connections."""
    monkeypatch.setattr(servers, "MAX_CONNECTIONS", 5)
    monkeypatch.setattr(servers, "MAX_REFUSED", 5)
    monkeypatch.setattr(servers, "REQUEST_WITHIN_S", 600.0)
    with serving(LiveRun(load_graph("waldo")), Address(port=0)) as served:
        idle = [connection(urlsplit(served.url).port or 0) for _ in range(100)]
        assert eventually(lambda: sum(map(is_open, idle)) == 10)
        for each in idle:
            each.close()


REQUEST = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


def test_a_client_that_takes_no_answers_is_disconnected(port: int) -> None:
    """It asks again and again, until the buffers are full of answers."""
    with socket.socket() as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        made.connect(("127.0.0.1", port))
        made.settimeout(30.0)
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            made.sendall(REQUEST * 10**6)


def test_a_slow_client_gets_its_answers(port: int) -> None:
    count = 100
    with socket.socket() as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        made.connect(("127.0.0.1", port))
        made.settimeout(30.0)
        made.sendall(REQUEST * count + REQUEST[:-2] + b"Connection: close\r\n\r\n")
        assert answer(made, size=512).count(b"HTTP/1.1 200 ") == count + 1


def test_a_refused_request_ends_its_connection() -> None:
    """So strangers without the token keep no places."""
    with serving(LiveRun(load_graph("waldo")), Address(port=0, token="a-token-of-the-test")) as served:
        for request in (REQUEST, REQUEST.replace(b"localhost", b"evil.example"), POST + b"Origin: http://a\r\n\r\n"):
            with connection(urlsplit(served.url).port or 0, request * 3) as made:
                assert answer(made).count(b"HTTP/1.1 4") == 1


def test_requests_of_strangers_are_not_logged(port: int, caplog: pytest.LogCaptureFixture) -> None:
    idle = [connection(port) for _ in range(5)]
    for data in (REQUEST, b"no request\r\n\r\n"):
        with connection(port, data) as made:
            assert answer(made).startswith((b"HTTP/1.1 503 ", b"HTTP/1.1 400 "))
    for each in idle:
        each.close()
    assert not caplog.records


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


def test_the_end_of_the_server_logs_nothing_of_requests_that_it_breaks_off(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    begun, over = threading.Event(), threading.Event()

    def wait_for_the_end(*_: object) -> None:
        begun.set()
        over.wait(30.0)

    monkeypatch.setattr(LiveRun, "picture", wait_for_the_end)
    with serving(LiveRun(load_graph("waldo")), Address(port=0)) as served:
        made = connection(urlsplit(served.url).port or 0, b"GET /api/picture HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert begun.wait(30.0)
    over.set()
    made.close()
    assert caplog.records == []
